"""Reference positions and velocities of handles, computed without the solvers' arithmetic, equations and searches.

A reference is computed with 60 decimal digits and rounded once, to double-doubles. Its errors are below 1e-30 relative
to the coordinates, unless a link is so close to locking that the last digit of the leader's distance has a larger
effect. The scene's floats are treated as exact numbers. Independent code lays out the pieces of a track, and Newton's
method finds each handle in a bracket in which the distance from the previous handle increases. The distance increases
along arcs shorter than pi / bend, where bend is the largest curvature. On a single spiral, the distance increases up to
half a turn behind the previous handle; if the link is longer than the distance there, the bracket is the next interval
in which the distance increases.
"""
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from functools import cached_property
from itertools import islice, pairwise
from math import asin, pi, sqrt

import numpy as np

from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import DragonError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn

_CONTEXT = Context(prec=60)
_PI = Decimal('3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803')
_DONE = Decimal('1e-32')        # relative size of the last Newton step; the remaining error is about its square
_ZERO, _ONE, _TWO, _HALF = Decimal(0), Decimal(1), Decimal(2), Decimal('0.5')
_HAIR = Decimal('1e-40')
_RISE = Decimal('0.0625')       # step (rad) of the search for the first rise of the distance
_MOST_STEPS = 400
_BACK, _AHEAD = -1, 1
_OFF = 'the reference cannot place a link'

Number = Decimal
Pair = tuple[Number, Number]        # a vector
Point = tuple[Number, Number, Number, Number]       # a point, and its derivative with respect to the coordinate


@dataclass(frozen=True)
class Reference:
    """Handles (m), from the head backwards, as ``high`` + ``low``, and velocities (m/s), all of shape (N+1, 2)."""

    high: Floats
    low: Floats
    velocity_m_s: Floats

    def error_m(self, handles_m: Floats) -> float:
        """Return the largest distance (m) between handles (N+1 or more, 2) and the reference."""
        off = (handles_m[:len(self.high)] - self.high) - self.low
        return float(np.max(np.hypot(off[:, 0], off[:, 1])))

    def speed_error_m_s(self, velocity_m_s: Floats) -> float:
        """Return the largest difference (m/s) between velocities (N+1 or more, 2) and the reference."""
        off = velocity_m_s[:len(self.velocity_m_s)] - self.velocity_m_s
        return float(np.max(np.hypot(off[:, 0], off[:, 1])))


def reference(scene: Scene, t_s: float, most: int | None = None) -> Reference:
    """Return the reference of a scene at a time; ``most`` limits the number of handles if the head leads.

    Raises DragonError if a link cannot be placed.
    """
    with localcontext(_CONTEXT):
        digits = chain_at(scene, t_s, most)
        high = np.array([[float(x), float(y)] for x, y, _, _ in digits])
        low = np.array([[float(x - Decimal(a)), float(y - Decimal(b))]
                        for (x, y, _, _), (a, b) in zip(digits, high.tolist(), strict=True)])
        return Reference(high, low, np.array([[float(vx), float(vy)] for _, _, vx, vy in digits]))


def chain_at(scene: Scene, t_s: float, most: int | None = None) -> list[Point]:
    """Return (x, y, vx, vy) of all handles, from the head backwards, with the precision of the decimal context."""
    track = _track_of(scene)
    gone, speed = _gone(scene, Decimal(t_s))
    links = [Decimal(link) for link in scene.dragon.link_lengths_m.tolist()]
    if scene.head.lead == 'head':
        leader = track.place(track.start + gone)
        return list(islice(_followed(track, leader, links, _BACK, speed), most))
    *_, tail = _places(track, track.place(track.start), links, _BACK)
    leader = track.place(track.metres(*tail) - gone)
    return list(_followed(track, leader, links[::-1], _AHEAD, -speed))[::-1]


def cos_sin(angle: Number) -> Pair:
    """Return cosine and sine; the angle is reduced to a quarter turn and divided by 8 for the sine's power series."""
    quarters = int((angle / (_PI * _HALF)).to_integral_value())
    left = (angle - quarters * (_PI * _HALF)) / 8
    square, total = left * left, _ZERO
    for factor in _SINE:
        total = total * square + factor
    sin = total * left
    cos = (1 - sin * sin).sqrt()
    for _ in range(3):
        cos, sin = 1 - 2 * sin * sin, 2 * sin * cos
    return ((cos, sin), (-sin, cos), (-cos, -sin), (sin, -cos))[quarters % 4]


def _sine_series() -> list[Number]:
    factors = [_ONE]
    for n in range(1, 18):
        factors.append(-factors[-1] / (2 * n * (2 * n + 1)))
    return factors[::-1]


with localcontext(_CONTEXT):
    _SINE = _sine_series()


class _ByMetres:
    """A piece on which u is the distance (m) from the start of the piece."""

    way = 1

    def metres(self, u: Number) -> Number:
        return u

    def after(self, metres: Number) -> Number:
        return metres

    def within(self, u: Number, arc_m: float) -> float:
        """Return the change in u along a length (m) of track."""
        return abs(arc_m)


@dataclass
class _Straight(_ByMetres):
    """A straight line."""

    start: Pair
    heading: Pair
    first: Number | None
    last: Number
    bend = 0.0

    def at(self, u: Number) -> Point:
        (x, y), (dx, dy) = self.start, self.heading
        return x + dx * u, y + dy * u, dx, dy


@dataclass
class _Round(_ByMetres):
    """An arc that turns left if ``side`` is 1."""

    start: Pair
    heading: Pair
    radius: Number
    side: int
    first: Number | None
    last: Number

    @property
    def bend(self) -> float:
        return 1 / float(self.radius)

    def at(self, u: Number) -> Point:
        (x, y), (hx, hy) = self.start, self.heading
        cos, sin = cos_sin(u / self.radius)
        along, aside = self.radius * sin, self.side * self.radius * (1 - cos)
        turned = self.side * sin
        return x + hx * along - hy * aside, y + hy * along + hx * aside, hx * cos - hy * turned, hy * cos + hx * turned


@dataclass
class _Winding:
    """A spiral that turns left in the outward direction if ``side`` is 1; the head moves outwards if ``way`` is 1.

    The coordinate u is the polar angle from ``axis``.
    """

    b: Number
    centre: Pair
    axis: Pair
    side: int
    way: int
    anchor: Number
    first: Number | None
    last: Number

    @property
    def bend(self) -> float:
        u = float(min(self.last, self.anchor))
        return (2 + u * u) / (float(self.b) * sqrt(1 + u * u) ** 3)

    def at(self, u: Number) -> Point:
        (x, y), (ax, ay) = self.centre, self.axis
        cos, sin = cos_sin(u)
        r, sin = self.b * u, self.side * sin
        dx, dy = self.b * cos - self.side * r * sin, self.b * sin + self.side * r * cos
        return (x + r * (ax * cos - ay * sin), y + r * (ay * cos + ax * sin), ax * dx - ay * dy, ay * dx + ax * dy)

    def metres(self, u: Number) -> Number:
        return self.way * self.b * (_arc(u) - _arc(self.anchor))

    def after(self, metres: Number) -> Number:
        wanted = _arc(self.anchor) + self.way * metres / self.b
        # The arc length is convex, so Newton's method converges monotonically from the outside.
        u = (2 * max(wanted, _ZERO)).sqrt()
        for _ in range(_MOST_STEPS):
            step = (_arc(u) - wanted) / (1 + u * u).sqrt()
            u -= step
            if abs(step) <= _DONE * (1 + u):
                return u
        raise DragonError(_OFF)

    def within(self, u: Number, arc_m: float) -> float:
        """Return the approximate change in u along a length (m) of track; positive lengths lead outwards."""
        start, change = float(u), 0.0
        for _ in range(3):
            middle = max(0.0, start + 0.5 * change)
            change = arc_m / (float(self.b) * sqrt(1 + middle * middle))
        return abs(change)


_Piece = _Straight | _Round | _Winding
_Place = tuple[int, Number]         # the number of a piece, and u on that piece


def _arc(u: Number) -> Number:
    """Return the arc length from a spiral's centre, in units of b."""
    root = (1 + u * u).sqrt()
    return (u * root + (u + root).ln()) / 2


@dataclass
class _DecimalTrack:
    """The pieces of a track, the distance along the track at each piece's anchor, and the head's distance at t = 0."""

    pieces: list[_Piece]
    origins: list[Number]
    start: Number
    may_lock: bool = False

    def place(self, metres: Number) -> _Place:
        """Return the place at a given distance along the track."""
        k = max((k for k in range(1, len(self.pieces)) if self.origins[k] <= metres), default=0)
        return k, self.pieces[k].after(metres - self.origins[k])

    def metres(self, k: int, u: Number) -> Number:
        """Return the distance (m) of a place along the track."""
        return self.origins[k] + self.pieces[k].metres(u)

    @cached_property
    def bend(self) -> float:
        """The largest curvature (1/m)."""
        return max(piece.bend for piece in self.pieces)

    def _hair(self, k: int, u: Number) -> Number:
        """Return the largest amount, in u, by which rounding may move a handle beyond an end of the track."""
        return _ZERO if 0 <= k < len(self.pieces) else _HAIR * (1 + abs(u))

    def next(self, place: _Place, chord: Number, way: int, guess: Number | None) -> _Place:
        """Return the nearest place, behind or ahead, that is one chord away; ``guess`` is the expected change in u."""
        k, u = place
        if not chord:
            return place
        x, y, *_ = self.pieces[k].at(u)
        if self.may_lock:
            return k, u + _on_spiral(_excess(self.pieces[k], (x, y), chord, u, 1), chord, guess)
        left_m = _longest_m(self.bend, float(chord))
        while True:
            piece = self.pieces[k]
            sense = way * piece.way
            end = piece.first if way == _BACK else piece.last
            most = Decimal(piece.within(u, sense * left_m))
            room = most if end is None else min(most, max(_ZERO, sense * (end - u)) + self._hair(k + way, u))
            excess = _excess(piece, (x, y), chord, u, sense)
            if excess(room)[0] >= 0:
                return k, u + sense * _root(excess, _ZERO, room, guess)
            k += way
            if end is None or room == most or not 0 <= k < len(self.pieces):
                raise DragonError(_OFF)
            left_m -= float(abs(piece.metres(end) - piece.metres(u)))
            following = self.pieces[k]
            u, guess = (following.last if way == _BACK else following.first or _ZERO), None


def _longest_m(bend: float, chord_m: float) -> float:
    """Return an arc length (m) that is longer than any arc with this chord, and along which chords still increase."""
    if not bend:
        return 1.1 * chord_m
    reach_m = 2 / bend * asin(min(1.0, 0.5 * bend * chord_m))
    return min(1.1 * reach_m, 0.5 * (reach_m + pi / bend))


_Excess = Callable[[Number], Pair]


def _excess(piece: _Piece, here: Pair, chord: Number, start: Number, sense: int) -> _Excess:
    """Return the function x -> ((squared distance - squared chord) / 2, slope) at u = start + sense x."""
    def excess(x: Number) -> Pair:
        px, py, dx, dy = piece.at(start + sense * x)
        px, py = px - here[0], py - here[1]
        return _HALF * (px * px + py * py - chord * chord), sense * (px * dx + py * dy)
    return excess


def _on_spiral(excess: _Excess, chord: Number, guess: Number | None) -> Number:
    """Return the smallest outward angle at which a point on a single spiral is one chord away.

    Up to half a turn, the distance grows monotonically: half the slope of its square is d + 2 t sin^2(d/2) + t (t + d)
    sin d.
    """
    low, high = _ZERO, _PI
    if excess(high)[0] < 0:
        low, high = high, high + _RISE
        while excess(high)[0] < 0 < excess(high)[1]:
            low, high = high, high + _RISE
        if excess(high)[0] < 0:         # the maximum is between low and high, where the slope vanishes
            high = _root(lambda x: (-excess(x)[1], _falling(excess, x)), low, high, None)
    if excess(high)[0] < 0:
        raise DragonError(_OFF)
    return _root(excess, low, high, guess)


def _falling(excess: _Excess, x: Number) -> Number:
    """Return an approximation of the negative second derivative, which suffices to find the maximum."""
    step = Decimal('1e-20')
    return (excess(x - step)[1] - excess(x + step)[1]) / (2 * step)


def _root(function: _Excess, low: Number, high: Number, guess: Number | None) -> Number:
    """Return the root of an increasing function, found by Newton's method with bisection as a fallback."""
    x = guess if guess is not None and low < guess < high else low + (high - low) * _HALF
    for _ in range(_MOST_STEPS):
        value, slope = function(x)
        low, high = (low, x) if value > 0 else (x, high)
        step = value / slope if slope > 0 else None
        if step is not None and abs(step) <= _DONE * abs(x):
            return x - step
        if high - low <= _DONE * _DONE * abs(x):
            return x
        x = x - step if step is not None and low < x - step < high else low + (high - low) * _HALF
    raise DragonError(_OFF)


def _track_of(scene: Scene) -> _DecimalTrack:
    spec = scene.track
    if isinstance(spec, Spiral):
        start = 2 * _PI * Decimal(spec.start_turns)
        winding = _Winding(Decimal(spec.pitch_m) / (2 * _PI), (_ZERO, _ZERO), (_ONE, _ZERO), 1, _BACK, start, None,
                           _ZERO if scene.head.lead == 'head' else start)
        return _DecimalTrack([winding], [_ZERO], _ZERO, scene.head.lead == 'head')
    return _turn(spec) if isinstance(spec, STurn) else _laid(spec)


def _turn(turn: STurn) -> _DecimalTrack:
    """Return an S-turn; each arc turns by 2 gamma, where gamma = atan(theta) is the angle between track and radius."""
    b, radius = Decimal(turn.pitch_m) / (2 * _PI), Decimal(turn.diameter_m) / 2
    theta = radius / b
    gamma = _arctangent(theta)
    second = radius / cos_sin(gamma)[1] / (1 + Decimal(turn.ratio))
    first = Decimal(turn.ratio) * second
    into = _Winding(b, (_ZERO, _ZERO), (_ONE, _ZERO), 1, _BACK, theta, None, theta)
    out = _Winding(b, (_ZERO, _ZERO), (-_ONE, _ZERO), 1, _AHEAD, theta, theta, Decimal(10) ** 12)
    one = _Round(*_end_of(into), first, -1, _ZERO, 2 * gamma * first)
    two = _Round(*_end_of(one), second, 1, _ZERO, 2 * gamma * second)
    return _DecimalTrack([into, one, two, out], [_ZERO, _ZERO, one.last, one.last + two.last], -Decimal(turn.before_m))


def _arctangent(tangent: Number) -> Number:
    """Return the arctangent, found by Newton's method as the root of tangent * cos - sin."""
    angle = Decimal(float(np.arctan(float(tangent))))
    for _ in range(_MOST_STEPS):
        cos, sin = cos_sin(angle)
        step = (tangent * cos - sin) / (tangent * sin + cos)
        angle += step
        if abs(step) <= _DONE:
            return angle
    raise DragonError(_OFF)


def _end_of(piece: _Piece) -> tuple[Pair, Pair]:
    """Return the end of a piece, and the unit vector in the head's direction there."""
    x, y, dx, dy = piece.at(piece.last)
    length = piece.way * (dx * dx + dy * dy).sqrt()
    return (x, y), (dx / length, dy / length)


def _laid(track: Composite) -> _DecimalTrack:
    """Return a track of pieces joined end to end; the first piece extends backwards unless it winds outwards."""
    pieces, origins = list[_Piece](), [_ZERO]
    begin = track.pieces[0]
    x, y = begin.at_m or (0.0, 0.0)
    point, heading = (Decimal(x), Decimal(y)), cos_sin(Decimal(begin.heading_deg or 0.0) * _PI / 180)
    for spec in track.pieces:
        first = _ZERO if pieces else None
        if isinstance(spec, Line):
            pieces.append(_Straight(point, heading, first, Decimal(spec.length_m)))
        elif isinstance(spec, Arc):
            radius = Decimal(spec.radius_m)
            pieces.append(_Round(point, heading, radius, 1 if spec.angle_deg > 0 else -1, first,
                                 abs(Decimal(spec.angle_deg)) * _PI / 180 * radius))
        else:
            pieces.append(_wound(spec, point, heading, first))
        origins.append(origins[-1] + pieces[-1].metres(pieces[-1].last))
        point, heading = _end_of(pieces[-1])
    return _DecimalTrack(pieces, origins[:-1], Decimal(track.start_m))


def _wound(spec: SpiralArc, point: Pair, heading: Pair, first: Number | None) -> _Winding:
    """Return a spiral that starts at a point with a heading."""
    start, last = 2 * _PI * Decimal(spec.from_turns), 2 * _PI * Decimal(spec.to_turns)
    way = _AHEAD if last > start else _BACK
    side = 1 if (spec.side == 'left') == (way == _AHEAD) else -1
    open_ended = first is None and way == _BACK
    bare = _Winding(Decimal(spec.pitch_m) / (2 * _PI), (_ZERO, _ZERO), (_ONE, _ZERO), side, way, start,
                    None if open_ended else start, last)
    x, y, dx, dy = bare.at(start)
    length = way * (dx * dx + dy * dy).sqrt()
    dx, dy = dx / length, dy / length
    (hx, hy), (px, py) = heading, point
    ax, ay = hx * dx + hy * dy, hy * dx - hx * dy
    centre = px - (ax * x - ay * y), py - (ay * x + ax * y)
    return _Winding(bare.b, centre, (ax, ay), side, way, start, bare.first, last)


def _gone(scene: Scene, t: Number) -> Pair:
    """Return the leader's distance travelled (m) and its speed (m/s); profiles are integrated ramp by ramp."""
    law = scene.head
    if isinstance(law, Head):
        return Decimal(law.speed_m_s) * t, Decimal(law.speed_m_s)
    if not isinstance(law, Profile):
        high, low = law.travelled_m(float(t))
        return Decimal(float(high)) + Decimal(float(low)), Decimal(law.speed_at_m_s(float(t)))
    far, knots = _ZERO, [(Decimal(at), Decimal(v)) for at, v in law.knots]
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


def _places(track: _DecimalTrack, place: _Place, links: list[Number], way: int) -> Iterator[_Place]:
    """Yield the places of the handles, starting with the leader; guesses are extrapolated from earlier equal links."""
    yield place
    before, last = list[Number](), None
    for chord in links:
        k, u = place
        if chord != last:
            before = []
        place = track.next(place, chord, way, _guessed(before))
        before = [abs(place[1] - u), *before[:3]] if place[0] == k else []
        last = chord
        yield place


def _guessed(before: list[Number]) -> Number | None:
    """Return the next number in a sequence, extrapolated by a cubic from its last four numbers, newest first."""
    if len(before) < 4:
        return before[0] if before else None
    return 4 * (before[0] + before[2]) - 6 * before[1] - before[3]


def _followed(track: _DecimalTrack, leader: _Place, links: list[Number], way: int, speed: Number) -> Iterator[Point]:
    """Yield the handles' positions and velocities, leader first; both ends of a link have the same speed along it."""
    before: tuple[Pair, Pair] | None = None
    for k, u in _places(track, leader, links, way):
        x, y, dx, dy = track.pieces[k].at(u)
        length = track.pieces[k].way * (dx * dx + dy * dy).sqrt()
        dx, dy = dx / length, dy / length
        if before is not None and before[0] != (x, y):
            (px, py), (bx, by) = before
            speed *= ((x - px) * bx + (y - py) * by) / ((x - px) * dx + (y - py) * dy)
        before = (x, y), (dx, dy)
        yield x, y, speed * dx, speed * dy
