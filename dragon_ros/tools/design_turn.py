"""``design turn``: how long the S-turn is, and what would make it shorter."""
from argparse import ArgumentParser, Namespace
from dataclasses import asdict, replace
from typing import Any

from dragon_ros.core.errors import InputError
from dragon_ros.core.turn import Turn, shortest_bent
from dragon_ros.core.walk import least_radius_m
from dragon_ros.wire import cli


def options(parser: ArgumentParser) -> None:
    """Add the scene options; the scene is the turn's."""
    cli.add_scene_options(parser)
    parser.set_defaults(scene='turning')


def answer(arguments: Namespace) -> dict[str, Any]:
    """Return the length of the scene's turn, and of the ways that would be shorter."""
    scene = cli.scene_from(arguments)
    turn = scene.track
    if not isinstance(turn, Turn):
        raise InputError('--scene: its track has no S-turn; give a scene whose track.kind is turn', field='track.kind')
    return answer_of(turn, least_radius_m(scene.dragon.link_lengths_m))


def answer_of(turn: Turn, least_radius_m: float) -> dict[str, Any]:
    """Return the figures of a turn whose arcs may have a least radius."""
    smallest, bent = turn.smallest_diameter_m(least_radius_m), shortest_bent(turn, least_radius_m)
    return {'length_m': turn.length_m, 'radii_m': list(turn.radii_m), 'angle_rad': turn.angle_rad,
            'shortened_by_ratio': False, 'least_radius_m': least_radius_m,
            'largest_ratio': turn.largest_ratio(least_radius_m), 'smallest_diameter_m': smallest,
            'length_there_m': replace(turn, diameter_m=smallest, ratio=1.0).length_m if smallest else None,
            'with_line': asdict(bent) | {'length_m': bent.length_m} if bent else None}


def text(values: dict[str, Any]) -> str:
    """Return the answer in words."""
    first, second = values['radii_m']
    least = values['least_radius_m']
    lines = [f'the turn is {values["length_m"]:.12g} m long: arcs of {first:.9g} m and {second:.9g} m, each by '
             f'{values["angle_rad"]:.9g} rad',
             'another ratio does not shorten it: in this circle the radii have one sum and both arcs turn by one angle',
             f'what limits the ratio: both radii must be at least {least:.9g} m, a hair over half the longest link, '
             f'or links could lock; that allows ratios up to {values["largest_ratio"]:.9g}']
    if values['length_there_m']:
        lines.append(f'a smaller circle shortens it: down to {values["smallest_diameter_m"]:.9g} m, both arcs of '
                     f'{least:.9g} m, it is {values["length_there_m"]:.12g} m long')
    if bent := values['with_line']:
        lines.append(f'in this circle, arcs of {bent["radius_m"]:.9g} m with a line of {bent["line_m"]:.9g} m between '
                     f'them are shorter: {bent["length_m"]:.12g} m')
    return '\n'.join([*lines, 'contact is not asked here: see contact'])
