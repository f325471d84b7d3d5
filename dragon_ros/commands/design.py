"""``design``: answer design questions; each question is a subcommand, and each answer has bounds."""
import json
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.inputs import counted, number
from dragon_ros.cli.progress import Progress

Values = dict[str, Any]
_DOES_NOT_FIT = 1        # exit code
_PITCH_OPTIONS = {'diameter_m': '--diameter', 'largest_m': '--largest', 'within_m': '--within',
                  'smallest_m': '--smallest', 'start_turns': 'track.start_turns'}


class Question(NamedTuple):
    """A subcommand: its question, a function that adds its options, and functions that find and print the answer."""

    help: str
    example: str
    options: Callable[[ArgumentParser], None]
    answer: Callable[[Namespace], Values]
    text: Callable[[Values], str]


def main(argv: list[str]) -> int:
    """Answer a design question; return the exit code."""
    options = command_line.parser('design', 'Answer a design question.',
                                  'design turn')
    questions = options.add_subparsers(dest='question', required=True, metavar='QUESTION')
    for name, question in QUESTIONS.items():
        one = questions.add_parser(name, help=question.help, description=f'Find {question.help}.', allow_abbrev=False,
                                   epilog=f'example: {command_line.program()} design {question.example}')
        question.options(one)
        command_line.add_output_options(one, ('text', 'json'))
    arguments = options.parse_args(argv)
    return command_line.guarded('design', partial(_run, QUESTIONS[arguments.question], arguments))


def _run(question: Question, arguments: Namespace) -> int:
    values = question.answer(arguments)
    text = json.dumps(values) if arguments.format == 'json' else question.text(values)
    command_line.write_output(arguments.output, text)
    return command_line.OK if values.get('fits', True) else _DOES_NOT_FIT


def _turn_options(parser: ArgumentParser) -> None:
    """Add the scene options and --contact; the default scene is turning."""
    command_line.add_scene_options(parser, 'turning')
    parser.add_argument('--contact', action='store_true', help='also search for a contact in the smallest circle')


def _turn_answer(arguments: Namespace) -> dict[str, Any]:
    """Return the lengths of the scene's turn and of shorter alternatives."""
    from dataclasses import asdict
    scene = command_line.scene_from(arguments)
    found = dr.design.turn(scene)
    bent = found.with_line
    values = {**asdict(found), 'radii_m': list(found.radii_m), 'shortened_by_ratio': False,
              'largest_ratio': found.largest_ratio,
              'with_line': asdict(bent) | {'length_m': bent.length_m} if bent else None}
    if arguments.contact and found.smallest_diameter_m:
        values['contact_there_m'] = _contact_m(scene, found.smallest_diameter_m)
    return values


def _contact_m(scene: 'dr.Scene', diameter_m: float) -> float | None:
    """Return the head's distance (m) from the smallest turn's entry at the first contact, or None if there is none.

    The search covers the run from the head's entry until the whole dragon has left the turn.
    """
    from dataclasses import replace
    assert isinstance(scene.track, dr.STurn)
    turn = dr.STurn(scene.track.pitch_m, diameter_m * (1 + 1e-9), 1.0)
    run = dr.Run(0.0, 2 * (turn.length_m + float(scene.dragon.link_lengths_m.sum())))
    walk = replace(scene, track=turn, head=dr.scene('turning').head, run=run, venue=None)
    with Progress('turn', 'states') as bar:
        found = dr.compile(walk).contact(progress=bar.update)
    return found.t_s if found else None


def _turn_text(values: dict[str, Any]) -> str:
    """Return the answer as text."""
    first, second = values['radii_m']
    least = values['least_radius_m']
    lines = [f'the turn is {values["length_m"]:.12g} m long: arcs with radii of {first:.9g} m and {second:.9g} m, '
             f'each turning by {values["angle_rad"]:.9g} rad',
             'another ratio does not shorten the turn: in this circle, the sum of the radii and the angle of the arcs '
             'are fixed']
    lines.append(_ratio_line(values['least_radius_m'], values['largest_ratio']))
    if values['length_there_m']:
        lines.append(f'a smaller circle shortens the turn: in a circle {values["smallest_diameter_m"]:.9g} m in '
                     f'diameter, with two arcs of radius {least:.9g} m, the turn is {values["length_there_m"]:.12g} m '
                     'long')
    if bent := values['with_line']:
        lines.append(f'in this circle, arcs of radius {bent["radius_m"]:.9g} m with a line of {bent["line_m"]:.9g} m '
                     f'between them are shorter: {bent["length_m"]:.12g} m')
    if 'contact_there_m' in values:
        at = values['contact_there_m']
        what = ('no benches touch until the whole dragon has left the turn' if at is None else
                f'benches touch when the head is {at:.9g} m past the entry')
        lines.append(f'in the smallest circle, {what}')
    return '\n'.join(lines)


def _ratio_line(least_m: float, largest: float) -> str:
    """Return the limits of the ratio as text."""
    return (f'limits of the ratio: both radii must be at least {least_m:.9g} m, 1.01 times half the longest link, so '
            f'that links cannot lock; this allows ratios from {1 / largest:.9g} to {largest:.9g}')


def _max_speed_options(parser: ArgumentParser) -> None:
    """Add the scene options and --limit; the default scene is turning."""
    command_line.add_scene_options(parser, 'turning')
    parser.add_argument('--limit', type=float, default=2.0, metavar='M_S', help='speed limit of every handle, in m/s '
                                                                                '(%(default)g)')


def _max_speed_answer(arguments: Namespace) -> dict[str, Any]:
    """Return the largest leader speed (profiles are scaled), and the handle that reaches the limit and its position."""
    from dataclasses import asdict

    from dragon_ros.cli.inputs import SPEED
    limit = number('--limit', arguments.limit, above=0.0, high=SPEED.high)
    scene = command_line.scene_from(arguments)
    with Progress('max-speed', 'positions') as bar:
        found = dr.design.max_speed(scene, progress=bar.update)
    speed, uncertainty = found.leader_m_s(limit)
    return {'speed_m_s': speed, 'uncertainty_m_s': uncertainty, 'limit_m_s': limit, **asdict(found)}


def _max_speed_text(values: dict[str, Any]) -> str:
    """Return the answer as text."""
    return (f'at a leader speed of {values["speed_m_s"]:.12g} m/s (accurate to {values["uncertainty_m_s"]:.1g} m/s; '
            f'for a profile, the peak speed), no handle exceeds {values["limit_m_s"]:.9g} m/s\n'
            f'{_fastest(values)}\n{counted(values["looks"], "position", form=",")} computed')


def _fastest(values: dict[str, Any]) -> str:
    if values['ratio'] == 1:
        return 'no handle is faster than the leader'
    return (f'handle {values["handle"]} is the fastest: {values["ratio"]:.12g} times as fast as the leader, with the '
            f'leader {values["along_m"]:.7g} m along the track (on a turn: from its entry)')


def _min_pitch_options(parser: ArgumentParser) -> None:
    """Add the scene options, and the options for the circle, the bounds and the bracket."""
    command_line.add_scene_options(parser)
    parser.add_argument('--diameter', type=float, default=9.0, metavar='METRES',
                        help='diameter of the turning circle (%(default)g)')
    parser.add_argument('--largest', type=float, default=1.0, metavar='METRES',
                        help='largest pitch considered (%(default)g)')
    parser.add_argument('--within', type=float, default=4e-11, metavar='METRES',
                        help='width of the bracket (%(default)g)')
    parser.add_argument('--smallest', type=float, metavar='METRES',
                        help='a pitch at which benches touch (by default, where the head starts on the circle)')


def _min_pitch_answer(arguments: Namespace) -> dict[str, Any]:
    """Return the bracket around the smallest pitch, for the scene's dragon and the scene's track.start_turns."""
    from dataclasses import asdict
    scene = command_line.scene_from(arguments)
    if scene.venue is not None:
        raise dr.InputError('venue: min-pitch does not take obstacles into account; omit the venue (--set venue=null)')
    with Progress('min-pitch', 'states') as bar:
        try:
            found = dr.design.min_pitch(scene, diameter_m=arguments.diameter, largest_m=arguments.largest,
                                        within_m=arguments.within, smallest_m=arguments.smallest, progress=bar.update)
        except dr.FieldError as error:
            known = error.fields
            raise dr.FieldError(_PITCH_OPTIONS.get(known['field'], known['field']), known['value'], known['limit'],
                             known['cure']) from None
    return asdict(found)


def _min_pitch_text(values: dict[str, Any]) -> str:
    """Return the answer as text."""
    inner, outer = values['benches']
    return '\n'.join([
        f'the smallest pitch is {values["high_m"]:.12f} m: a run at this pitch is proved to have no contact on the way '
        'in',
        f'at {values["low_m"]:.12f} m, benches {inner} and {outer} overlap, with the head at radius '
        f'{values["radius_m"]:.6f} m',
        f'runs at {len(values["clear_m"])} larger pitches up to {values["largest_m"]:g} m are also proved to have no '
        'contact; between them, nothing is proved',
        f'{counted(values["states"], "state", form=",")} computed'])


def _fit_options(parser: ArgumentParser) -> None:
    """Add the scene options and --square."""
    command_line.add_scene_options(parser)
    parser.add_argument('--square', type=float, metavar='METRES', help='side length of a square into which the '
                        'run should fit')


def _fit_answer(arguments: Namespace) -> dict[str, Any]:
    """Return the smallest squares, the bench that touches the centred square, and whether the given square suffices."""
    from dataclasses import asdict
    scene = command_line.scene_from(arguments)
    if scene.venue is not None:
        return _venue_answer(scene, arguments)
    side = None if arguments.square is None else number('--square', arguments.square, above=0.0)
    with Progress('fit', 'looks') as bar:
        found: Any = dr.design.fit(scene, progress=bar.update)
    return {'centred_m': found.centred_m, 'free_m': found.free_m, 'touching': asdict(found.touching),
            'reaches': [asdict(reach) for reach in found.reaches], 'looks': found.looks, 'square_m': side,
            'fits_centred': side and found.fits_centred(side), 'fits_free': side and found.fits_free(side)}


def _venue_answer(scene: 'dr.Scene', arguments: Namespace) -> dict[str, Any]:
    """Return the smallest gap to each obstacle of a scene's venue, and whether all gaps are large enough."""
    from dataclasses import asdict
    if arguments.square is not None:
        raise dr.InputError('--square: it is not available for a scene with a venue; omit it, or the venue (--set '
                            'venue=null)')
    with Progress('fit', 'looks') as bar:
        found: Any = dr.design.fit(scene, progress=bar.update)
    room = dr.design.room(scene)
    return {'venue': [asdict(one) for one in found.gaps],
            'room': {'sampled_m': room.sampled_m, 'at_m': room.at_m.tolist(), 'left_m': room.left_m.tolist(),
                     'right_m': room.right_m.tolist()},
            'margin_m': found.margin_m, 'lacking': [one.name for one in found.lacking], 'fits': found.fits,
            'looks': found.looks}


def _room_text(room: Values) -> list[str]:
    """Return the street width that the run requires as lines of text, or no lines for a run shorter than a metre."""
    if not room['at_m']:
        return []
    rows = zip(room['left_m'], room['right_m'], room['at_m'], strict=True)
    left, right, at = max(rows, key=lambda row: row[0] + row[1])
    return [f'the street must be at least {left + right:.3f} m wide, at {at:g} m along the track: {left:.3f} m to its '
            f'left and {right:.3f} m to its right; sampled every {100 * room["sampled_m"]:.0f} cm, not proved '
            '(--format json lists every metre)']


def _venue_text(values: dict[str, Any]) -> str:
    """Return the answer for a venue as text, with the smallest gap first."""
    lines = []
    for one in values['venue']:
        x, y = one['point_m']
        gap = (f'{one["high_m"]:.6f} m, accurate to {one["high_m"] - one["low_m"]:.1e} m, to' if one['high_m'] > 0 else
               'touched by')
        lines.append(f'{one["name"]}: {gap} bench {one["bench"]} at {one["t_s"]:.3f} s, with its centre at ({x:.3f}, '
                     f'{y:.3f}) m')
    lines += _room_text(values['room'])
    margin = f'a gap of at least {values["margin_m"]:g} m'
    lacking = ', '.join(values['lacking'])
    lines.append(f'the dragon does not fit, because the gap is less than {values["margin_m"]:g} m to {lacking}'
                 if lacking else f'the dragon fits, with {margin} to all obstacles' if values['fits'] else
                 f'it is undecided whether the dragon fits with {margin}, which is between the bounds')
    return '\n'.join(lines)


def _fit_text(values: dict[str, Any]) -> str:
    """Return the answer as text."""
    if 'venue' in values:
        return _venue_text(values)
    at, side = values['touching'], values['square_m']
    x, y = at['point_m']
    lines = [f'the smallest square about the origin that contains the run: {_bounds(values["centred_m"])}',
             f'the {at["corner"]} corner of bench {at["bench"]} touches its side at {at["t_s"]:.6f} s, at '
             f'({x:.6f}, {y:.6f}) m',
             f'the smallest axis-aligned square anywhere: {_bounds(values["free_m"])}']
    if side:
        lines.append(f'a square of {side:.12g} m: {_verdict(values["fits_centred"], values["fits_free"])}')
    return '\n'.join(lines)


def _bounds(bounds_m: tuple[float, float]) -> str:
    """Return an attained lower bound, and the amount by which the proved upper bound exceeds it, as text."""
    low, high = bounds_m
    return f'{low:.10f} m, accurate to {high - low:.1e} m'


def _verdict(centred: bool | None, free: bool | None) -> str:
    """Return the text that states whether the dragon fits."""
    if free is False:
        return 'the dragon does not fit'
    if centred is None or free is None:
        return 'it is undecided whether the dragon fits, because the side of the square is between the bounds'
    return 'the dragon fits' if centred else 'the dragon fits only off the centre'


QUESTIONS = {
    'turn': Question('the length of the S-turn, and whether it can be shortened', 'turn --set track.ratio=3',
                     _turn_options, _turn_answer, _turn_text),
    'max-speed': Question('the largest speed of the leader at which no handle exceeds a limit',
                          'max-speed --limit 2', _max_speed_options, _max_speed_answer, _max_speed_text),
    'min-pitch': Question('the smallest pitch at which the head reaches a circle without a contact',
                          'min-pitch --diameter 9', _min_pitch_options, _min_pitch_answer, _min_pitch_text),
    'fit': Question('the smallest square that contains the dragon throughout a run, and whether it fits into a given '
                    'square',
                    'fit --square 24', _fit_options, _fit_answer, _fit_text),
}
