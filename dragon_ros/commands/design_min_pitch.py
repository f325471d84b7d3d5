"""``design min-pitch``: the smallest pitch at which the head reaches a circle without any contact on the way in."""
from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from typing import Any

from tqdm import tqdm

from dragon_ros.cli import command_line
from dragon_ros.core.design.min_pitch import min_pitch
from dragon_ros.core.errors import FieldError

_OPTIONS = {'diameter_m': '--diameter', 'largest_m': '--largest', 'within_m': '--within',
            'start_turns': 'track.start_turns'}


def options(parser: ArgumentParser) -> None:
    """Add the scene options, the circle and the bounds."""
    command_line.add_scene_options(parser)
    parser.add_argument('--diameter', type=float, default=9.0, metavar='METRES', help='of the turning circle (9)')
    parser.add_argument('--largest', type=float, default=1.0, metavar='METRES', help='largest pitch considered (1)')
    parser.add_argument('--within', type=float, default=2e-11, metavar='METRES', help='width of the bracket (2e-11)')


def answer(arguments: Namespace) -> dict[str, Any]:
    """Return the bracket of the smallest pitch; only the scene's dragon and track.start_turns are used."""
    scene = command_line.scene_from(arguments)
    with tqdm(desc='min-pitch', unit=' states', disable=None, leave=False, delay=1) as bar:
        try:
            found = min_pitch(scene.dragon, arguments.diameter, scene.spiral.start_turns, arguments.largest,
                              arguments.within, bar.update)
        except FieldError as error:
            known = error.fields
            raise FieldError(_OPTIONS.get(known['field'], known['field']), known['value'], known['limit'],
                             known['cure']) from None
    return asdict(found)


def text(values: dict[str, Any]) -> str:
    """Return the answer as text."""
    inner, outer = values['benches']
    return '\n'.join([
        f'the smallest pitch is {values["high_m"]:.12f} m: from there to {values["largest_m"]:g} m there is no '
        'contact on the way in',
        f'at {values["low_m"]:.12f} m benches {inner} and {outer} touch, with the head at radius '
        f'{values["radius_m"]:.6f} m',
        f'{values["states"]:,} windings were examined'])
