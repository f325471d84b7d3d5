"""Reads certificates as plain numbers; a certificate must be complete, within limits and free of unknown keys.

A certificate is untrusted input. A value that cannot belong to a scene is rejected with its location in the file. An
unknown key is also rejected, because nothing would check it.
"""
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

from dragon_ros.verify.errors import Refused
from dragon_ros.verify.law import Law

VERSION = 4         # certificates of dragon_ros 0.1 to 0.3 have the versions 1 (which is not written), 2 and 3
MOST_BYTES = 64 * 2**20
MOST_CORNERS = 100_000
_LONGEST_NAME = 100     # characters
_INSIDE = 'inside'      # name of the outline that benches must not leave
_DIGITS = 400           # maximum number of digits of a whole number; the largest float has 309
# The world in which claims hold: a copy of ``core.domain``, which a test holds equal.
WORLD: dict[str, tuple[float, float]] = {
    'LINK': (0.05, 50.0), 'LONGEST_BENCH': (1.0, 20.0), 'WIDTH': (0.001, 100.0), 'BENCHES': (1, 20_000),
    'PITCH': (0.01, 100.0), 'COORDINATE': (-1e4, 1e4), 'TRACK': (0.0, 1e6), 'RADIUS': (0.01, 1e9), 'PIECES': (1, 1000),
    'SPEED': (-100.0, 100.0), 'KNOTS': (1, 10_000), 'TIME': (0.0, 1e6), 'RATE': (1e-3, 1e4), 'VENUE': (-1e5, 1e5)}
_LATEST_S, _LONGEST_M, _MOST_BENCHES = WORLD['TIME'][1], WORLD['TRACK'][1], int(WORLD['BENCHES'][1])
MOST_KNOTS, MOST_PIECES = int(WORLD['KNOTS'][1]), int(WORLD['PIECES'][1])
_OUTSIDE = 'dragon_ros 0.3 verifies certificates of scenes outside the world of later versions'


@dataclass(frozen=True)
class Line:
    """A straight line."""

    length_m: float


@dataclass(frozen=True)
class Arc:
    """A circular arc; ``angle_deg`` is positive if the arc turns left."""

    radius_m: float
    angle_deg: float


@dataclass(frozen=True)
class Coil:
    """A part of a spiral r = pitch_m * turns; ``left`` is True if the spiral turns left."""

    pitch_m: float
    from_turns: float
    to_turns: float
    left: bool


Piece = Line | Arc | Coil


@dataclass(frozen=True)
class Pose:
    """A point and a heading in degrees; each of them is None if it is not given."""

    at_m: tuple[float, float] | None
    heading_deg: float | None


@dataclass(frozen=True)
class Spiral:
    """The spiral r = pitch_m / (2 pi) * angle about the origin; the head starts at 2 pi start_turns and winds in."""

    pitch_m: float
    start_turns: float


@dataclass(frozen=True)
class Turn:
    """An inward spiral, two arcs in a circle, and an outward spiral; the head starts ``before_m`` before the entry."""

    pitch_m: float
    diameter_m: float
    ratio: float
    before_m: float


@dataclass(frozen=True)
class Pieces:
    """Lines, arcs and spirals with their stated start poses; the head starts ``start_m`` along the track."""

    pieces: tuple[Piece, ...]
    poses: tuple[Pose, ...]
    start_m: float


@dataclass(frozen=True)
class Obstacle:
    """Lines (each a sequence of points) that no bench may touch; the lines around an ``area`` are closed."""

    name: str
    lines: tuple[tuple[tuple[float, float], ...], ...]
    area: bool


@dataclass(frozen=True)
class Venue:
    """Obstacles, and the outline that benches must not leave."""

    obstacles: tuple[Obstacle, ...]
    inside: Obstacle | None

    @property
    def all(self) -> tuple[Obstacle, ...]:
        """All obstacles, followed by the inside polygon, if there is one."""
        return (*self.obstacles, *([self.inside] if self.inside else []))


@dataclass(frozen=True)
class Scene:
    """The numbers that determine contacts; if ``stop_s`` is None, the run lasts until the model ends."""

    lengths_m: tuple[float, ...]
    width_m: float
    inset_m: float
    track: Spiral | Turn | Pieces
    law: Law
    tail_leads: bool
    start_s: float
    stop_s: float | None
    venue: Venue | None = None

    @property
    def links_m(self) -> tuple[Fraction, ...]:
        """Exact distances in metres between the two handles of each bench."""
        known = {length_m: Fraction(length_m) - 2 * Fraction(self.inset_m) for length_m in set(self.lengths_m)}
        return tuple(known[length_m] for length_m in self.lengths_m)


@dataclass(frozen=True)
class Contact:
    """The claimed contact of two benches, or of a bench and an obstacle; ``grazing`` contacts are undecided."""

    t_s: float
    benches: tuple[int, ...]
    grazing: bool
    obstacle: str | None = None


@dataclass(frozen=True)
class Claims:
    """The content of a certificate; ``contact`` is None if the run has no contact."""

    scene: Scene
    contact: Contact | None


def read(path: Path) -> Claims:
    """Return the content of a certificate file; ``-`` is standard input. Raises Refused."""
    try:
        with sys.stdin.buffer if str(path) == '-' else path.open('rb') as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise Refused(f'it cannot be read: {error.strerror}') from None
    if len(data) > MOST_BYTES:
        raise Refused(f'it is larger than the limit of {MOST_BYTES} bytes')
    return claims_of(data)


def claims_of(data: bytes) -> Claims:
    """Return the content of a certificate that is encoded in UTF-8. Raises Refused."""
    try:
        values = json.loads(data.decode(), parse_constant=_no_number, parse_int=_whole, object_pairs_hook=_once)
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused(f'it is not a certificate: {str(error)[:160]}') from None
    return _claims(values)


def _no_number(text: str) -> Any:
    raise ValueError(f'{text} is not a number')


def _whole(text: str) -> int | float:
    if len(text) > _DIGITS:
        raise ValueError(f'a number has {len(text)} digits; the limit is {_DIGITS}')
    return int(text)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object. Reject duplicate keys: json would use the last value, but other readers might use the first."""
    out = dict(pairs)
    if len(out) < len(pairs):
        raise ValueError(f'a key occurs twice: {sorted(key for key, _ in pairs)}')
    return out


def _claims(values: Any) -> Claims:
    if isinstance(values, dict) and ('family' in values or values.get('version', 1) in (1, 2, 3)):
        raise Refused('it is a certificate of dragon_ros 0.1 to 0.3; dragon_ros 0.3.0 verifies it')
    top = _keys('', values, {'version', 'scene', 'contact'})
    if not isinstance(top['version'], int) or top['version'] != VERSION:
        raise Refused(f'version: {_shown(top["version"])} is not {VERSION}, which this checker verifies')
    scene = _scene(top['scene'])
    return Claims(scene, _contact(top['contact'], scene))


def _contact(value: Any, scene: Scene) -> Contact | None:
    given = _keys('contact', value, {'t_s'}, {'benches', 'grazing', 'obstacle'})
    if given['t_s'] is None:
        if given.get('benches') is not None or given.get('grazing') or given.get('obstacle') is not None:
            raise Refused('contact: if there is no contact, there must be no benches')
        return None
    t_s = _number('contact.t_s', given['t_s'], scene.start_s, _LATEST_S)
    obstacle = given.get('obstacle')
    if obstacle is not None and obstacle not in [one.name for one in (scene.venue.all if scene.venue else ())]:
        raise Refused(f'contact.obstacle: {_shown(obstacle)} is not in the venue')
    count = 2 if obstacle is None else 1
    benches = tuple(int(_number(f'contact.benches[{n}]', bench, 0, len(scene.lengths_m) - 1, whole=True))
                    for n, bench in enumerate(_list('contact.benches', given.get('benches'), count, count)))
    if obstacle is None and benches[0] > benches[1] - 2:
        raise Refused(f'contact.benches: {benches[0]} and {benches[1]} are not two benches with another one in '
                      'between, the inner one first')
    grazing = given.get('grazing', False)
    if not isinstance(grazing, bool):
        raise Refused(f'contact.grazing: {_shown(grazing)} is neither true nor false')
    return Contact(t_s, benches, grazing, obstacle)


def _scene(value: Any) -> Scene:
    # The optional keys other than venue affect how a run is shown, recorded or computed, but not the benches'
    # positions.
    scene = _keys('scene', value, {'dragon', 'track', 'head', 'run'},
                  {'noise', 'trails', 'accuracy', 'effects', 'solver', 'markers', 'about', 'venue'})
    lengths, width_m, inset_m = _dragon(scene['dragon'])
    law, tail_leads = _head(scene['head'])
    run = _keys('scene.run', scene['run'], {'start_s', 'stop_s'}, {'rate_hz', 'stamp_offset_s'})
    start_s = _number('scene.run.start_s', run['start_s'], 0, _LATEST_S)
    stop_s = None if run['stop_s'] is None else _number('scene.run.stop_s', run['stop_s'], start_s, _LATEST_S)
    venue = None if scene.get('venue') is None else _venue(scene['venue'])
    return Scene(lengths, width_m, inset_m, _kind('scene.track', scene['track'], _TRACKS), law, tail_leads, start_s,
                 stop_s, venue)


def _venue(value: Any) -> Venue:
    """Return a venue, which must not have a margin, because a certificate proves only that nothing touches."""
    given = _keys('scene.venue', value, set(), {'obstacles', 'inside'})
    listed = _list('scene.venue.obstacles', given.get('obstacles') or [], 0, MOST_CORNERS)
    obstacles = tuple(_kind(f'scene.venue.obstacles[{n}]', one, _OBSTACLES) for n, one in enumerate(listed))
    inside = None if given.get('inside') is None else Obstacle(
        _INSIDE, (_points('scene.venue.inside', given['inside'], 3),), True)
    out = Venue(obstacles, inside)
    names = [one.name for one in out.all]
    if len(set(names)) < len(names) or not names:
        raise Refused('scene.venue: it has no obstacle, or two obstacles with the same name')
    if sum(len(line) for one in out.all for line in one.lines) > 2 * MOST_CORNERS:
        raise Refused(f'scene.venue: it has more than {MOST_CORNERS} corners')
    return out


def _polygon(name: str, value: dict[str, Any]) -> Obstacle:
    _keys(name, value, {'kind', 'name', 'points_m'}, {'holes_m'})
    holes = _list(f'{name}.holes_m', value.get('holes_m') or [], 0, MOST_CORNERS)
    rings = [_points(f'{name}.points_m', value['points_m'], 3),
             *(_points(f'{name}.holes_m[{n}]', hole, 3) for n, hole in enumerate(holes))]
    return Obstacle(_named(name, value['name']), tuple(rings), True)


def _wall(name: str, value: dict[str, Any]) -> Obstacle:
    _keys(name, value, {'kind', 'name', 'points_m'})
    return Obstacle(_named(name, value['name']), (_points(f'{name}.points_m', value['points_m'], 2),), False)


_OBSTACLES: dict[str, Callable[[str, dict[str, Any]], Obstacle]] = {'polygon': _polygon, 'line': _wall}


def _named(name: str, value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= _LONGEST_NAME or not value.isprintable() or value == _INSIDE:
        raise Refused(f'{name}.name: {_shown(value)} is not a valid name for an obstacle')
    return value


def _points(name: str, value: Any, fewest: int) -> tuple[tuple[float, float], ...]:
    """Return the points of a line or, if ``fewest`` is at least 3, of a closed ring."""
    points = []
    for n, one in enumerate(_list(name, value, fewest, MOST_CORNERS)):
        x, y = (_in_world(f'{name}[{n}]', each, 'VENUE') for each in _list(f'{name}[{n}]', one, 2, 2))
        points.append((x, y))
    points += points[:1] if fewest > 2 else []
    if any(one == two for one, two in pairwise(points)):
        raise Refused(f'{name}: two successive points coincide')
    return tuple(points)


def _dragon(value: Any) -> tuple[tuple[float, ...], float, float]:
    name = 'scene.dragon'
    lengths = _kind(name, value, _DRAGONS)
    width_m = _in_world(f'{name}.width_m', value['width_m'], 'WIDTH')
    inset_m = _number(f'{name}.hole_inset_m', value['hole_inset_m'], 0, 1e3)
    for length_m in set(lengths):
        link_m = round(length_m - 2 * inset_m, 12)
        _in_world(f'{name}: the link of a bench of {length_m!r} m', link_m, 'LINK')
        _in_world(f'{name}: the length of a bench of {length_m!r} m in links', round(length_m / link_m, 9),
                  'LONGEST_BENCH')
    return lengths, width_m, inset_m


def _equal(name: str, value: dict[str, Any]) -> tuple[float, ...]:
    _keys(name, value, {'kind', 'benches', 'head_length_m', 'body_length_m', 'width_m', 'hole_inset_m'})
    benches = int(_number(f'{name}.benches', value['benches'], 1, _MOST_BENCHES, whole=True))
    head_m, body_m = (_number(f'{name}.{key}', value[key], 0, 1e3) for key in ('head_length_m', 'body_length_m'))
    return (head_m,) + (body_m,) * (benches - 1)


def _mixed(name: str, value: dict[str, Any]) -> tuple[float, ...]:
    _keys(name, value, {'kind', 'groups', 'width_m', 'hole_inset_m'})
    out: list[float] = []
    for n, one in enumerate(_list(f'{name}.groups', value['groups'], 1, _MOST_BENCHES)):
        group = _keys(f'{name}.groups[{n}]', one, {'length_m', 'count'})
        count = int(_number(f'{name}.groups[{n}].count', group['count'], 1, _MOST_BENCHES - len(out), whole=True))
        out += [_number(f'{name}.groups[{n}].length_m', group['length_m'], 0, 1e3)] * count
    return tuple(out)


_DRAGONS: dict[str, Callable[[str, dict[str, Any]], tuple[float, ...]]] = {'equal': _equal, 'mixed': _mixed}


def _spiral(name: str, value: dict[str, Any]) -> Spiral:
    _keys(name, value, {'kind', 'pitch_m', 'start_turns'})
    return Spiral(_in_world(f'{name}.pitch_m', value['pitch_m'], 'PITCH'),
                  _number(f'{name}.start_turns', value['start_turns'], 0, 1e4))


def _turn(name: str, value: dict[str, Any]) -> Turn:
    _keys(name, value, {'kind', 'pitch_m', 'diameter_m', 'ratio', 'before_m'})
    return Turn(_in_world(f'{name}.pitch_m', value['pitch_m'], 'PITCH'),
                _number(f'{name}.diameter_m', value['diameter_m'], WORLD['RADIUS'][0], 2 * WORLD['COORDINATE'][1]),
                _number(f'{name}.ratio', value['ratio'], 1e-3, 1e3),
                _number(f'{name}.before_m', value['before_m'], -_LONGEST_M, _LONGEST_M))


def _joined(name: str, value: dict[str, Any]) -> Pieces:
    _keys(name, value, {'kind', 'pieces', 'start_m'})
    pieces, poses = [], []
    for n, one in enumerate(_list(f'{name}.pieces', value['pieces'], 1, MOST_PIECES)):
        here = f'{name}.pieces[{n}]'
        pieces.append(_kind(here, one, _PIECES))
        poses.append(_pose(here, one))
    return Pieces(tuple(pieces), tuple(poses), _number(f'{name}.start_m', value['start_m'], -_LONGEST_M, _LONGEST_M))


_TRACKS: dict[str, Callable[[str, dict[str, Any]], Any]] = {'spiral': _spiral, 'turn': _turn, 'joined': _joined}
_POSE = {'at_m', 'heading_deg'}


def _pose(name: str, value: dict[str, Any]) -> Pose:
    at_m, heading = value.get('at_m'), value.get('heading_deg')
    if at_m is not None:
        x, y = (_in_world(f'{name}.at_m', one, 'COORDINATE') for one in _list(f'{name}.at_m', at_m, 2, 2))
        at_m = x, y
    return Pose(at_m, None if heading is None else _number(f'{name}.heading_deg', heading, -1e6, 1e6))


def _line(name: str, value: dict[str, Any]) -> Line:
    _keys(name, value, {'kind', 'length_m'}, _POSE)
    return Line(_number(f'{name}.length_m', value['length_m'], 1e-12, _LONGEST_M))


def _arc(name: str, value: dict[str, Any]) -> Arc:
    _keys(name, value, {'kind', 'radius_m', 'angle_deg'}, _POSE)
    angle = _number(f'{name}.angle_deg', value['angle_deg'], -1e6, 1e6)
    if not angle:
        raise Refused(f'{name}.angle_deg: an arc must turn')
    return Arc(_in_world(f'{name}.radius_m', value['radius_m'], 'RADIUS'), angle)


def _coil(name: str, value: dict[str, Any]) -> Coil:
    _keys(name, value, {'kind', 'pitch_m', 'from_turns', 'to_turns', 'side'}, _POSE)
    first, last = (_number(f'{name}.{key}', value[key], 1e-3, 1e4) for key in ('from_turns', 'to_turns'))
    if first == last or value['side'] not in ('left', 'right'):
        raise Refused(f'{name}: from_turns and to_turns of a spiral must differ, and its side must be left or right')
    return Coil(_in_world(f'{name}.pitch_m', value['pitch_m'], 'PITCH'), first, last, value['side'] == 'left')


_PIECES: dict[str, Callable[[str, dict[str, Any]], Piece]] = {'line': _line, 'arc': _arc, 'spiral': _coil}


def _head(value: Any) -> tuple[Law, bool]:
    name = 'scene.head'
    law = _kind(name, value, _LAWS)
    if value['lead'] not in ('head', 'tail'):
        raise Refused(f'{name}.lead: {_shown(value["lead"])} is neither head nor tail')
    return law, value['lead'] == 'tail'


def _constant(name: str, value: dict[str, Any]) -> Law:
    _keys(name, value, {'kind', 'speed_m_s', 'lead'})
    return Law(((Fraction(0), Fraction(_in_world(f'{name}.speed_m_s', value['speed_m_s'], 'SPEED'))),))


def _profile(name: str, value: dict[str, Any]) -> Law:
    _keys(name, value, {'kind', 'knots', 'ramps', 'lead'})
    if value['ramps'] not in ('linear', 'smooth'):
        raise Refused(f'{name}.ramps: {_shown(value["ramps"])} is neither linear nor smooth')
    knots: list[tuple[Fraction, Fraction]] = []
    for n, knot in enumerate(_list(f'{name}.knots', value['knots'], 1, MOST_KNOTS)):
        here = f'{name}.knots[{n}]'
        t_s, speed = _list(here, knot, 2, 2)
        knots.append((Fraction(_number(here, t_s, knots[-1][0] if knots else 0, _LATEST_S if knots else 0)),
                      Fraction(_in_world(here, speed, 'SPEED'))))
    return Law(tuple(knots), value['ramps'] == 'smooth')


_LAWS: dict[str, Callable[[str, dict[str, Any]], Law]] = {'constant': _constant, 'profile': _profile}


def _kind(name: str, value: Any, kinds: dict[str, Callable[[str, dict[str, Any]], Any]]) -> Any:
    """Read a mapping with the reader for its kind."""
    if not isinstance(value, dict) or not isinstance(value.get('kind'), str) or value['kind'] not in kinds:
        raise Refused(f'{name}: {_shown(value)} is not one of the kinds {", ".join(kinds)}')
    return kinds[value['kind']](name, value)


def _keys(name: str, value: Any, needed: set[str], allowed: set[str] = frozenset()) -> dict[str, Any]:  # type: ignore[assignment]
    """Return a mapping that has all required keys and no unknown keys."""
    if not isinstance(value, dict):
        raise Refused(f'{name or "certificate"}: {_shown(value)} is not a mapping')
    if value.keys() != needed:
        for key in sorted(needed - value.keys()):
            raise Refused(f'{name}{"." if name else ""}{key}: it is missing')
        for key in sorted(value.keys() - needed - allowed):
            raise Refused(f'{name}{"." if name else ""}{key[:60]}: this key is not checked; leave it out')
    return value


def _list(name: str, value: Any, fewest: int, most: int) -> list[Any]:
    if not isinstance(value, list) or not fewest <= len(value) <= most:
        found = f'{len(value)} entries' if isinstance(value, list) else _shown(value)
        raise Refused(f'{name}: {found}; it must be a list of {fewest} to {most} entries' if fewest < most else
                      f'{name}: {found}; it must be a list of {most} entries')
    return value


def _number(name: str, value: Any, low: float | Fraction, high: float, whole: bool = False) -> float:
    """Return a number within limits, as a float."""
    if isinstance(value, bool) or not isinstance(value, int | float) or (whole and not isinstance(value, int)):
        raise Refused(f'{name}: {_shown(value)} is not a {"whole " if whole else ""}number')
    try:
        number = float(value)
    except OverflowError:
        number = float('inf')
    if not isfinite(number) or not low <= number <= high:
        raise Refused(f'{name}: {number!r} is not between {float(low)!r} and {float(high)!r}')
    return number


def _in_world(name: str, value: Any, quantity: str) -> float:
    """Return a number within the limits of a quantity of the world, as a float."""
    low, high = WORLD[quantity]
    number = _number(name, value, -1e300, 1e300)
    if not low <= number <= high:
        raise Refused(f'{name}: {number!r} is not between {low!r} and {high!r}; {_OUTSIDE}')
    return number


def _shown(value: Any) -> str:
    return repr(value)[:60]
