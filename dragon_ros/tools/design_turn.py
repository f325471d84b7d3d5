"""``design turn``: how long the S-turn is, and what would make it shorter."""
from argparse import ArgumentParser, Namespace
from dataclasses import asdict, replace
from typing import Any

from tqdm import tqdm

from dragon_ros.core.contact.certificate import Contact
from dragon_ros.core.contact.first_contact import first_contact
from dragon_ros.core.errors import InputError
from dragon_ros.core.head import Head
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.turn import Turn, shortest_bent
from dragon_ros.core.walk import least_radius_m
from dragon_ros.wire import cli


def options(parser: ArgumentParser) -> None:
    """Add the scene options and --contact; the scene is the turn's."""
    cli.add_scene_options(parser)
    parser.set_defaults(scene='turning')
    parser.add_argument('--contact', action='store_true', help='also look for a contact in the smallest circle')


def answer(arguments: Namespace) -> dict[str, Any]:
    """Return the length of the scene's turn, and of the ways that would be shorter."""
    scene = cli.scene_from(arguments)
    turn = _turn_of(scene)
    values = answer_of(turn, least_radius_m(scene.dragon.link_lengths_m))
    if arguments.contact and values['smallest_diameter_m']:
        values['contact_there_m'] = _contact_m(scene, values['smallest_diameter_m'])
    return values


def _contact_m(scene: Scene, diameter_m: float) -> float | None:
    """Return how far the head is from the entry of the smallest turn at the first contact there; None if none comes.

    Looked for from the head's entry until the whole dragon has left the turn.
    """
    turn = Turn(_turn_of(scene).pitch_m, diameter_m * (1 + 1e-9), 1.0)
    run = Run(0.0, 2 * (turn.length_m + scene.length_m))
    with tqdm(desc='turn', unit=' states', disable=None, leave=False, delay=1) as bar:
        found = first_contact(replace(scene, track=turn, head=Head(), run=run), bar.update)
    return found.t_s if isinstance(found, Contact) else None


def _turn_of(scene: Scene) -> Turn:
    if isinstance(scene.track, Turn):
        return scene.track
    raise InputError('--scene: its track has no S-turn; give a scene whose track.kind is turn', field='track.kind')


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
             f'or links could lock; that allows ratios from {1 / values["largest_ratio"]:.9g} to '
             f'{values["largest_ratio"]:.9g}']
    if values['length_there_m']:
        lines.append(f'a smaller circle shortens it: down to {values["smallest_diameter_m"]:.9g} m, both arcs of '
                     f'{least:.9g} m, it is {values["length_there_m"]:.12g} m long')
    if bent := values['with_line']:
        lines.append(f'in this circle, arcs of {bent["radius_m"]:.9g} m with a line of {bent["line_m"]:.9g} m between '
                     f'them are shorter: {bent["length_m"]:.12g} m')
    if 'contact_there_m' in values:
        at = values['contact_there_m']
        what = ('no benches touch until the whole dragon has left the turn' if at is None else
                f'benches touch when the head has gone {at:.9g} m from the entry')
        lines.append(f'in that smallest circle {what}')
    return '\n'.join(lines)
