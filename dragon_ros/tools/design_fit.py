"""``design fit``: the smallest square that holds the whole dragon during a whole run, and whether a given one does."""
from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from typing import Any

from tqdm import tqdm

from dragon_ros.core.checks import number
from dragon_ros.core.extent import extent
from dragon_ros.wire import cli


def options(parser: ArgumentParser) -> None:
    """Add the scene options and the square."""
    cli.add_scene_options(parser)
    parser.add_argument('--square', type=float, metavar='METRES', help='side of a square to fit into')


def answer(arguments: Namespace) -> dict[str, Any]:
    """Return the smallest squares, what touches the centred one, and whether the given one holds the run."""
    scene = cli.scene_from(arguments)
    side = None if arguments.square is None else number('--square', arguments.square, above=0.0)
    with tqdm(desc='fit', unit=' states', disable=None, leave=False, delay=1) as bar:
        found = extent(scene, progress=bar.update)
    return {'centred_m': found.centred_m, 'free_m': found.free_m, 'touching': asdict(found.touching),
            'reaches': [asdict(reach) for reach in found.reaches], 'states': found.states, 'square_m': side,
            'fits_centred': side and found.centred_m <= side, 'fits_free': side and found.free_m <= side}


def text(values: dict[str, Any]) -> str:
    """Return the answer in words."""
    at, side = values['touching'], values['square_m']
    x, y = at['point_m']
    lines = [f'the smallest square about the centre that holds the run: {values["centred_m"]:.10g} m',
             f'its side is touched by the {at["corner"]} corner of bench {at["bench"]} at {at["t_s"]:.6f} s, at '
             f'({x:.6f}, {y:.6f}) m',
             f'wherever its centre is, along the axes: {values["free_m"]:.10g} m']
    if side:
        verdict = 'fits' if values['fits_centred'] else 'fits off the centre only' if values['fits_free'] else (
            'does not fit')
        lines.append(f'a square of {side:g} m: the dragon {verdict}')
    return '\n'.join(lines)
