"""The motion of handles and links, in balls, while the front handle of a leading bench moves over an interval.

A prime is a derivative with respect to the coordinate u of the leading handle on its segment. For each handle there
are bounds on its coordinate and on the first two derivatives p and a over the whole interval, and for each link
bounds on its turning rate w and on w'. docs/contact-lemmas.md derives the formulas:

- on one line or arc, all handles move at the same rate, and all links turn at the same rate;
- on one spiral the handle at theta + delta follows the handle at theta with p (1 + d1), a (1 + d1) + p^2 d2;
- at and across a joint, the speed v along the track and its rate are used; v cos alpha is equal at both ends of a
  link.
"""
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from flint import acb, arb

from dragon_ros.verify.balls import UNIT, above, direction, up
from dragon_ros.verify.posture import Posture
from dragon_ros.verify.segments import HALF, ONE, TWO, ZERO, ArcSegment, LineSegment, Link, SpiralSegment, root_of
from dragon_ros.verify.track import AnySegment, Place, Track

NAN = arb('nan')
Postures = tuple[Posture, Posture]


class Slopes(NamedTuple):
    """First and second derivatives, with respect to theta, of a link's span delta and of its direction theta + psi."""

    delta_1: arb
    delta_2: arb
    psi_1: arb
    psi_2: arb


@dataclass(frozen=True, eq=False)
class Handle:
    """A handle on an interval: its segment (None if it passes a joint) and bounds on its coordinate.

    ``ends`` holds, for each bound, the index of the interval's end at which the handle is there (None if it is at
    neither). ``moved_m`` is a bound on the distance along the track from one end to any position in between and on to
    the other end. ``slopes`` holds the slopes of the link to the handle in front, if they were computed.
    """

    track: Track
    segment: int | None
    low: arb
    high: arb
    ends: tuple[int | None, int | None]
    moved_m: float
    slopes: Slopes | None = None

    @cached_property
    def u(self) -> arb:
        """The ball of all possible coordinates of the handle."""
        return self.low.union(self.high)

    @property
    def on(self) -> AnySegment:
        """The segment on which the handle stays."""
        assert self.segment is not None
        return self.track.segments[self.segment]

    @cached_property
    def pole(self) -> int | None:
        """The index of the centre about which the handle turns; None if there is none."""
        if self.segment is None or isinstance(self.on, LineSegment):
            return None
        return self.track.poles[self.segment]


@dataclass(frozen=True, eq=False)
class Speeds:
    """A handle's motion along the track: speed v and its rate (m), unit tangent, and signed curvature, in balls."""

    v: arb
    rate: arb
    tangent: acb
    curvature: arb

    @cached_property
    def velocity(self) -> acb:
        """Derivative of the point."""
        return self.tangent * self.v

    @cached_property
    def acceleration(self) -> acb:
        """Second derivative of the point."""
        return self.tangent * acb(self.rate, self.curvature * self.v * self.v)


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of a handle: derivatives p and a of its coordinate or, across a joint, speeds along the track."""

    handle: Handle
    p: arb
    a: arb
    across: Speeds | None = None

    @cached_property
    def speeds(self) -> Speeds:
        """Speeds along the track."""
        if self.across is not None:
            return self.across
        segment, u = self.handle.on, self.handle.u
        speed = segment.speed(u) * segment.sense
        rate = speed * self.a
        if isinstance(segment, SpiralSegment):
            rate += segment.b * u / root_of(u) * self.p * self.p * segment.sense
        return Speeds(speed * self.p, rate, segment.heading(u), segment.curvature(u))

    @cached_property
    def radial(self) -> tuple[arb, arb, arb, arb, arb]:
        """Distance from the segment's centre with its two derivatives, and the two derivatives of the angle."""
        segment = self.handle.on
        angle = self.p * segment.side, self.a * segment.side     # type: ignore[union-attr]
        if isinstance(segment, SpiralSegment):
            return segment.b * self.handle.u, segment.b * self.p, segment.b * self.a, *angle
        assert isinstance(segment, ArcSegment)
        return segment.radius, ZERO, ZERO, *angle


class Turning(NamedTuple):
    """The turning rate of a link, and its derivative."""

    w: arb
    rate: arb


# Positions of handles


def leading_handle(track: Track, ends: Postures) -> Handle:
    """Return the leading handle of an interval."""
    return _bounded(track, *(end.place(0) for end in ends))


def next_handle(front: Handle, ends: Postures, n: int, link: Link, may_turn: bool) -> Handle:
    """Return the handle behind ``front``; the two are the (n + 1)-th and the n-th handle behind the leading handle.

    ``ends`` holds the postures at both ends of the interval. If handles ``may_turn`` (on a spiral that leads to its
    centre), the spans of links bound the next handle; otherwise each handle moves in the same direction as the leader.
    """
    if may_turn and not (isinstance(front.on, SpiralSegment) and front.on.is_wide(front.low, link)
                         and None not in front.ends):
        return _that_may_turn(front, ends, n, link)
    return _bounded(front.track, *(end.place(n + 1) for end in ends))


def _bounded(track: Track, one: Place, two: Place) -> Handle:
    """Return a handle that moves in one direction between two positions."""
    moved_m = track.apart_m(one, two)
    if one.segment == two.segment and not one.loose and not two.loose:
        low, high, numbers = (two.u, one.u, (1, 0)) if two.u < one.u else (one.u, two.u, (0, 1))
        return Handle(track, one.segment, low, high, numbers, moved_m)
    return Handle(track, None, ZERO, ZERO, (None, None), moved_m)


def _that_may_turn(front: Handle, ends: Postures, n: int, link: Link) -> Handle:
    """Return the handle further out on an inward spiral, using slopes and spans; spans only decrease (lemma 1)."""
    segment = front.on
    assert isinstance(segment, SpiralSegment)
    low, high = (u + segment.span(u, link) if end is None else ends[end].place(n + 1).u
                 for u, end in zip((front.low, front.high), front.ends, strict=True))
    spans = low - front.low, high - front.high
    slopes = spiral_slopes(segment, front.u, spans[0].union(spans[1]), link)
    ratio, numbers = ONE + slopes.delta_1, front.ends
    if ratio < 0:
        low, high, numbers = high, low, numbers[::-1]
    elif not ratio > 0:
        low, high, numbers = *_turning(front, (low, high), spans, ratio), (None, None)
    ways = furthest(low, high, ends[0].place(n + 1).u + ends[1].place(n + 1).u)
    return Handle(front.track, front.segment, low, high, numbers, up(ways * above(segment.speed(high))), slopes)


def furthest(low: arb, high: arb, both: arb) -> float:
    """Return the largest sum of distances from a position between bounds to two positions that add up to ``both``.

    Beyond the two positions the sum grows with the distance, so it is largest at a bound.
    """
    return max(above(TWO * high - both), above(both - TWO * low))


def _turning(front: Handle, images: tuple[arb, arb], spans: tuple[arb, arb], ratio: arb) -> tuple[arb, arb]:
    """Return bounds on a handle that may turn back, from spans and from the mean value theorem."""
    lows, highs = [front.low + spans[1]], [front.high + spans[0]]
    change = ratio * (front.high - front.low) * ZERO.union(ONE)
    if change.is_finite():
        means = images[0] + change, images[1] - change
        lows, highs = [*lows, *means], [*highs, *means]
    return max((one.lower() for one in lows), key=float), min((one.upper() for one in highs), key=float)


# Motion of handles and links


def leading_motion(handle: Handle, ends: Postures) -> Motion:
    """Return the motion of the leading handle in terms of its coordinate or, across a joint, in metres."""
    if handle.segment is not None:
        return Motion(handle, ONE, ZERO)
    return Motion(handle, NAN, NAN, Speeds(ONE, ZERO, *_joint(handle, ends, 0)))


def next_motion(front: Motion, handle: Handle, ends: Postures, n: int, link: Link) -> tuple[Motion, Turning]:
    """Return the motion of handle n + 1 behind handle n (``front``), and the turning of their link."""
    ahead = front.handle
    if ahead.segment is None or handle.segment != ahead.segment:
        return _across(front, handle, ends, n, link)
    segment = ahead.on
    if isinstance(segment, SpiralSegment):
        return (_outwards if segment.sense < 0 else _inwards)(front, handle, segment, link)
    side = segment.side if isinstance(segment, ArcSegment) else 0
    return Motion(handle, front.p, front.a), Turning(front.p * side, front.a * side)


def _outwards(front: Motion, handle: Handle, segment: SpiralSegment, link: Link) -> tuple[Motion, Turning]:
    """On a spiral that winds in, return the motion of the handle further out and of the link."""
    slopes, ahead = handle.slopes, front.handle
    if slopes is None:
        slopes = spiral_slopes(segment, ahead.u, (handle.low - ahead.low).union(handle.high - ahead.high), link)
    ratio = ONE + slopes.delta_1
    motion = Motion(handle, front.p * ratio, front.a * ratio + front.p * front.p * slopes.delta_2)
    return motion, _turned(segment, front.p, front.a, slopes)


def _inwards(front: Motion, handle: Handle, segment: SpiralSegment, link: Link) -> tuple[Motion, Turning]:
    """On a spiral that winds out, return the motion of the handle further in and of the link."""
    ahead = front.handle
    slopes = spiral_slopes(segment, handle.u, (ahead.low - handle.low).union(ahead.high - handle.high), link)
    inverse = ONE / (ONE + slopes.delta_1)
    p = front.p * inverse
    a = (front.a - p * p * slopes.delta_2) * inverse
    return Motion(handle, p, a), _turned(segment, p, a, slopes)


def _turned(segment: SpiralSegment, p: arb, a: arb, slopes: Slopes) -> Turning:
    """Return the turning of a link in direction theta + psi whose inner handle moves with speed p and rate a."""
    turned = ONE + slopes.psi_1
    return Turning(p * turned * segment.side, (a * turned + p * p * slopes.psi_2) * segment.side)


def _across(front: Motion, handle: Handle, ends: Postures, n: int, link: Link) -> tuple[Motion, Turning]:
    """Return the motion of the handle behind and of the link, if the link or a handle crosses a joint."""
    ahead = front.speeds
    axis = _axis(front.handle, handle, ends, n, link.inverse)
    tangent, curvature = ((handle.on.heading(handle.u), handle.on.curvature(handle.u)) if handle.segment is not None
                          else _joint(handle, ends, n + 1))
    alpha, beta = (axis.conjugate() * heading for heading in (ahead.tangent, tangent))
    v = ahead.v * alpha.real / beta.real
    w = (ahead.v * alpha.imag - v * beta.imag) * link.inverse
    alpha_rate, beta_rate = ahead.curvature * ahead.v - w, curvature * v - w
    rate = (ahead.rate * alpha.real - ahead.v * alpha.imag * alpha_rate + v * beta.imag * beta_rate) / beta.real
    w_rate = (ahead.rate * alpha.imag + ahead.v * alpha.real * alpha_rate
              - rate * beta.imag - v * beta.real * beta_rate) * link.inverse
    return _settled(handle, Speeds(v, rate, tangent, curvature)), Turning(w, w_rate)


def _axis(ahead: Handle, handle: Handle, ends: Postures, n: int, inverse: arb) -> acb:
    """Return a ball of a link's directions; a link turns by at most half the curvature times both handles' travel."""
    one, two = ((end.point(n) - end.point(n + 1)) * inverse for end in ends)
    return between(one, two, up(0.25 * handle.track.bend * (ahead.moved_m + handle.moved_m)))


def _settled(handle: Handle, speeds: Speeds) -> Motion:
    """Express a motion along the track in terms of the segment's coordinate, if the handle stays on one segment."""
    if handle.segment is None:
        return Motion(handle, NAN, NAN, speeds)
    segment, u, rate = handle.on, handle.u, speeds.rate
    speed = segment.speed(u) * segment.sense
    p = speeds.v / speed
    if isinstance(segment, SpiralSegment):
        rate = rate - segment.b * u / root_of(u) * p * p * segment.sense
    return Motion(handle, p, rate / speed)


def _joint(handle: Handle, ends: Postures, n: int) -> tuple[acb, arb]:
    """Return balls of the tangents and of the curvatures of the track while a handle passes a joint."""
    track, places = handle.track, [end.place(n) for end in ends]
    one, two = map(track.heading, places)
    return between(one, two, up(0.5 * track.bend * handle.moved_m)), track.curvatures(*places)


def between(one: acb, two: acb, turned: float) -> acb:
    """Return a ball of all directions within an angle of the bisector of two directions."""
    middle = one + two
    length = abs(middle)
    return middle / length * direction(UNIT * turned) if length > 0 else acb(UNIT, UNIT)


def spiral_slopes(segment: SpiralSegment, theta: arb, delta: arb, link: Link) -> Slopes:
    """Return the slopes of a link between theta and theta + delta on a spiral."""
    return _slopes(theta, delta, segment.chord(link).inverse_square)


def _slopes(theta: arb, delta: arb, share: arb) -> Slopes:
    """Differentiate F(theta, delta) = chord^2 / 2 and the direction; ``share`` is 1 / chord^2, with b as the unit."""
    half, cosine = (HALF * delta).sin_cos()
    less, sine = TWO * half * half, TWO * half * cosine
    both, area = TWO * theta + delta, theta * (theta + delta)
    inverse = ONE / (delta + theta * less + area * sine)
    one = -both * less * inverse
    square = one * one
    bent = HALF + theta * sine + HALF * area * (ONE - less)
    two = -TWO * (less + (less + both * sine) * one + bent * square) * inverse
    rest, turned = delta - theta * one, delta * one
    psi_1 = sine * rest + HALF * both * turned
    psi_2 = ((ONE - less) * one * rest - theta * sine * two + (ONE + HALF * one) * turned
             + HALF * both * (square + delta * two))
    return Slopes(one, two, HALF * one + share * psi_1, HALF * two + share * psi_2)
