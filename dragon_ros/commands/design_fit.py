"""``design fit``: the smallest square that holds the whole dragon during a whole run, and whether a given one does."""
from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from typing import Any

from tqdm import tqdm

from dragon_ros.cli import command_line
from dragon_ros.core.checks import number
from dragon_ros.core.design.bounding_box import bounding_box, fits


def options(parser: ArgumentParser) -> None:
    """Add the scene options and the square."""
    command_line.add_scene_options(parser)
    parser.add_argument('--square', type=float, metavar='METRES', help='side of a square to fit into')


def answer(arguments: Namespace) -> dict[str, Any]:
    """Return the smallest squares, what touches the centred one, and whether the run fits into the given one."""
    scene = command_line.scene_from(arguments)
    side = None if arguments.square is None else number('--square', arguments.square, above=0.0)
    with tqdm(desc='fit', unit=' looks', disable=None, leave=False, delay=1) as bar:
        found = bounding_box(scene, progress=bar.update)
    return {'centred_m': found.centred_m, 'free_m': found.free_m, 'touching': asdict(found.touching),
            'reaches': [asdict(reach) for reach in found.reaches], 'looks': found.looks, 'square_m': side,
            'fits_centred': side and fits(found.centred_m, side), 'fits_free': side and fits(found.free_m, side)}


def text(values: dict[str, Any]) -> str:
    """Return the answer as text."""
    at, side = values['touching'], values['square_m']
    x, y = at['point_m']
    lines = [f'the smallest square about the origin that contains the run: {_bounds(values["centred_m"])}',
             f'its side is touched by the {at["corner"]} corner of bench {at["bench"]} at {at["t_s"]:.6f} s, at '
             f'({x:.6f}, {y:.6f}) m',
             f'wherever its centre is, along the axes: {_bounds(values["free_m"])}']
    if side:
        lines.append(f'a square of {side:.12g} m: {_verdict(values["fits_centred"], values["fits_free"])}')
    return '\n'.join(lines)


def _bounds(bounds_m: tuple[float, float]) -> str:
    """Return a lower bound that is attained, and how far above it the proved bound lies."""
    low, high = bounds_m
    return f'{low:.10f} m, and no more than {high - low:.1e} m larger'


def _verdict(centred: bool | None, free: bool | None) -> str:
    """Return as text whether the dragon fits."""
    if free is False:
        return 'the dragon does not fit'
    if centred is None or free is None:
        return 'that is between the bounds: whether the dragon fits is undecided'
    return 'the dragon fits' if centred else 'the dragon fits off the centre only'
