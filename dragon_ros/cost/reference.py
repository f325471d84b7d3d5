"""True positions and velocities of handles, computed with mpmath in the precision that ``mp.dps`` sets.

Nothing numerical is shared with the rest of the package: the track is laid out anew from the scene's floats, which are
exact numbers, and handles are placed one by one in steps that cannot overshoot. If a position is g metres short of the
chord, there is no root within the next g metres of track. ``hard_cases`` stores results of this module with more
digits.
"""
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import mpmath
from mpmath import mp, mpc, mpf

from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import DragonError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.spec import Arc, Line, Spiral, SpiralArc, STurn

_DIGITS = 40
_MOST_STEPS = 1_000_000
_NEAR = 1e-13           # gap, relative to the chord, from which on Newton's method converges to the first root
BEHIND, AHEAD = -1, 1
Number = Any                    # mpmath creates its types at run time
Place = tuple[int, Number]      # the number of a piece, and the coordinate on it
State = tuple[Number, Number]   # the point and the velocity of a handle, as complex numbers


class NoReference(DragonError):
    """A link could not be placed, for example because a handle is at the very end of the track."""


@dataclass(frozen=True)
class Reference:
    """The true states of handles in m and m/s, from the head backwards."""

    states: list[State]

    def error_m(self, handles_m: Floats) -> float:
        """Return the largest distance (m) between handles (N+1 or more, 2) and the reference."""
        return _largest_distance(handles_m, [point for point, _ in self.states])

    def speed_error_m_s(self, velocity_m_s: Floats) -> float:
        """Return the largest difference (m/s) between velocities (N+1 or more, 2) and the reference."""
        return _largest_distance(velocity_m_s, [velocity for _, velocity in self.states])


def _largest_distance(found: Floats, true: list[Number]) -> float:
    with mp.workdps(_DIGITS):
        return max(float(abs(mpc(*vector) - one)) for vector, one in zip(found.tolist(), true, strict=False))


@dataclass(frozen=True)
class Piece:
    """A piece of a track from the coordinate ``first`` to ``last``; None: without end.

    u is the distance on a line, the angle turned on an arc, and the polar angle on a spiral, on which it increases
    (``way`` 1) or decreases (-1) in the head's direction. ``metres`` is the distance along the track from the piece's
    origin, and ``slope`` the derivative of ``at``. ``steepest(u, gap)`` is an upper bound on the absolute slope up to
    ``gap`` metres from u.
    """

    at: Callable[[Number], Number]
    slope: Callable[[Number], Number]
    metres: Callable[[Number], Number]
    steepest: Callable[[Number, Number], Number]
    first: Number | None
    last: Number | None
    way: int = 1

    def heading(self, u: Number) -> Number:
        """Return the unit tangent in the head's direction."""
        return self.way * mpmath.sign(self.slope(u))


def _line(start: Number, direction: Number, first: Number | None, length: Number) -> Piece:
    return Piece(lambda u: start + direction * u, lambda u: direction, lambda u: u, lambda u, gap: mp.one,
                 first, length)


def _arc(start: Number, direction: Number, radius: Number, side: int, first: Number | None, angle: Number) -> Piece:
    return Piece(lambda u: start + side * mpc(0, 1) * radius * direction * (1 - mp.expj(side * u)),
                 lambda u: radius * direction * mp.expj(side * u), lambda u: radius * u, lambda u, gap: radius,
                 first, angle)


def _spiral(b: Number, origin: Number, first: Number | None, last: Number | None, way: int, side: int = 1,
            rotation: Number = 1, centre: Number = 0) -> Piece:
    return Piece(lambda u: centre + rotation * b * u * mp.expj(side * u),
                 lambda u: rotation * b * mp.expj(side * u) * mpc(1, side * u),
                 lambda u: way * b * (_length(u) - _length(origin)),
                 lambda u, gap: b * mp.sqrt(1 + (u + gap / (b * mp.sqrt(1 + u * u))) ** 2), first, last, way)


def _length(u: Number) -> Number:
    """Return the length of a spiral from its centre, in units of b."""
    return (u * mp.sqrt(1 + u * u) + mp.asinh(u)) / 2


@dataclass(frozen=True)
class Track:
    """The pieces of a track, and the distances of their origins along it."""

    pieces: list[Piece]
    origins: list[Number]

    def place(self, distance: Number) -> Place:
        """Return the place at a distance along the track."""
        k = max([k for k in range(1, len(self.pieces)) if self.origins[k] <= distance], default=0)
        piece, origin = self.pieces[k], self.origins[k]
        end = piece.first if piece.last is None else piece.last
        return k, _root(lambda u: (origin + piece.metres(u) - distance, piece.way * abs(piece.slope(u))), end)

    def places(self, leader: Place, links: list[Number], way: int) -> Iterator[Place]:
        """Yield the places of the handles, from the leader on, which follow BEHIND or AHEAD of it."""
        yield leader
        for chord in links:
            leader = self._next(*leader, chord, way)
            yield leader

    def _next(self, k: int, u: Number, chord: Number, way: int) -> Place:
        """Return the first place that is one chord away."""
        here = self.pieces[k].at(u)
        for number in range(k, len(self.pieces) if way == AHEAD else -1, way):
            piece = self.pieces[number]
            begin, end = (piece.last, piece.first) if way == BEHIND else (piece.first, piece.last)
            found = _on(piece, here, u if number == k else begin, end, chord, way * piece.way)
            if found is not None:
                return number, found
        raise NoReference('the reference cannot place a link')


def _on(piece: Piece, here: Number, u: Number, end: Number | None, chord: Number, sense: int) -> Number | None:
    """Return the first coordinate from u on that is one chord away from ``here``; None if the piece ends first."""
    for _ in range(_MOST_STEPS):
        gap = chord - abs(piece.at(u) - here)
        if gap < _NEAR * chord:
            return _root(lambda u: _excess(piece.at(u) - here, piece.slope(u), chord), u)
        u += sense * gap / piece.steepest(u, gap)
        if end is not None and sense * (u - end) > 0:
            return None
    raise NoReference('the reference cannot place a link')


def _excess(link: Number, slope: Number, chord: Number) -> tuple[Number, Number]:
    """Return half the excess of a squared link over a squared chord, and its derivative."""
    return (abs(link) ** 2 - chord * chord) / 2, (mp.conj(link) * slope).real


def _root(function: Callable[[Number], tuple[Number, Number]], u: Number) -> Number:
    """Return the root of a function that returns its value and its slope, by Newton's method from u."""
    for _ in range(100):
        value, slope = function(u)
        step = value / slope
        u -= step
        if abs(step) <= mpf(10) ** (8 - mp.dps) * (1 + abs(u)):
            return u
    raise NoReference('the reference cannot place a link')


def track_of(scene: Scene) -> tuple[Track, Number]:
    """Return the track of a scene, and the head's distance along it at t = 0."""
    spec = scene.track
    if isinstance(spec, Spiral):
        b, start = mpf(spec.pitch_m) / (2 * mp.pi), 2 * mp.pi * mpf(spec.start_turns)
        return Track([_spiral(b, start, None, mp.zero, BEHIND)], [mp.zero]), mp.zero
    if isinstance(spec, STurn):
        return _turn(spec), -mpf(spec.before_m)
    at_m, heading_deg = spec.pieces[0].at_m or (0.0, 0.0), spec.pieces[0].heading_deg or 0.0
    point, heading = mpc(*at_m), mp.expj(mp.radians(mpf(heading_deg)))
    pieces, origins = list[Piece](), [mp.zero]
    for one in spec.pieces:
        pieces.append(_joined(one, point, heading, open_ended=not pieces))
        origins.append(origins[-1] + pieces[-1].metres(pieces[-1].last))
        point, heading = pieces[-1].at(pieces[-1].last), pieces[-1].heading(pieces[-1].last)
    return Track(pieces, origins[:-1]), mpf(spec.start_m)


def _joined(spec: Line | Arc | SpiralArc, point: Number, heading: Number, open_ended: bool) -> Piece:
    """Return a piece that starts at a point with a heading; an open-ended piece extends backwards without end."""
    first = None if open_ended else mp.zero
    if isinstance(spec, Line):
        return _line(point, heading, first, mpf(spec.length_m))
    if isinstance(spec, Arc):
        return _arc(point, heading, mpf(spec.radius_m), 1 if spec.angle_deg > 0 else -1, first,
                    mp.radians(abs(mpf(spec.angle_deg))))
    b, start, last = mpf(spec.pitch_m) / (2 * mp.pi), *(2 * mp.pi * mpf(n) for n in (spec.from_turns, spec.to_turns))
    way = AHEAD if last > start else BEHIND
    side = 1 if (spec.side == 'left') == (way == AHEAD) else -1
    bare = _spiral(b, start, start, last, way, side)
    rotation = heading / bare.heading(start)
    return _spiral(b, start, None if open_ended and way == BEHIND else start, last, way, side, rotation,
                   point - rotation * bare.at(start))


def _turn(turn: STurn) -> Track:
    """Return an S-turn; each arc turns by 2 gamma, where gamma = atan(theta) is the angle between track and radius."""
    b, radius = mpf(turn.pitch_m) / (2 * mp.pi), mpf(turn.diameter_m) / 2
    theta = radius / b
    gamma = mp.atan(theta)
    second = radius / mp.sin(gamma) / (1 + mpf(turn.ratio))
    radii = mpf(turn.ratio) * second, second
    into, out = _spiral(b, theta, None, theta, BEHIND), _spiral(b, theta, theta, None, AHEAD, rotation=-1)
    one = _arc(into.at(theta), into.heading(theta), radii[0], -1, mp.zero, 2 * gamma)
    two = _arc(one.at(2 * gamma), one.heading(2 * gamma), radii[1], 1, mp.zero, 2 * gamma)
    return Track([into, one, two, out], [mp.zero, mp.zero, 2 * gamma * radii[0], 2 * gamma * (radii[0] + radii[1])])


def _travelled(scene: Scene, t: Number) -> tuple[Number, Number]:
    """Return the leader's distance travelled (m) and its speed (m/s); profiles are integrated ramp by ramp."""
    law = scene.head
    if isinstance(law, Head):
        return mpf(law.speed_m_s) * t, mpf(law.speed_m_s)
    assert isinstance(law, Profile)
    far, knots = mpf(0), [(mpf(at), mpf(v)) for at, v in law.knots]
    for (t0, v0), (t1, v1) in pairwise(knots):
        length, rise = t1 - t0, v1 - v0
        if t1 <= t:
            far += length * (v0 + v1) / 2
        elif t0 <= t:
            x = (t - t0) / length
            if law.ramps == 'linear':
                return far + length * (v0 * x + rise * x * x / 2), v0 + rise * x
            return far + length * (v0 * x + rise * (x**3 - x**4 / 2)), v0 + rise * (3 * x * x - 2 * x**3)
    return far + (t - knots[-1][0]) * knots[-1][1], knots[-1][1]


def followed(track: Track, leader: Place, links: list[Number], way: int, speed: Number) -> Iterator[State]:
    """Yield the point and the velocity of each handle as complex numbers, from a leader that has a given speed on."""
    before = None
    for k, u in track.places(leader, links, way):
        point, heading = track.pieces[k].at(u), track.pieces[k].heading(u)
        if before is not None:
            link = mp.conj(point - before[0])
            speed *= (link * before[1]).real / (link * heading).real     # the same along the link
        before = point, heading
        yield point, speed * heading


def chain_at(scene: Scene, t_s: float, most: int | None = None) -> list[State]:
    """Return the point and the velocity of ``most`` handles (None: all) at a time (s), from the head on.

    If the tail leads, the result has all handles.
    """
    track, start = track_of(scene)
    far, speed = _travelled(scene, mpf(t_s))
    links = [mpf(link) for link in scene.dragon.link_lengths_m.tolist()]
    if scene.head.lead == 'head':
        some = links if most is None else links[:most - 1]
        return list(followed(track, track.place(start + far), some, BEHIND, speed))
    *_, (k, u) = track.places(track.place(start), links, BEHIND)
    tail = track.origins[k] + track.pieces[k].metres(u)
    return list(followed(track, track.place(tail - far), links[::-1], AHEAD, -speed))[::-1]


def reference(scene: Scene, t_s: float, most: int | None = None) -> Reference:
    """Return the true states at a time (s), with 40 digits: see ``chain_at``."""
    with mp.workdps(_DIGITS):
        return Reference(chain_at(scene, t_s, most))
