"""How handles and links move while the front handle of a leading bench goes over an interval of the track, in balls.

A dash is a derivative by the coordinate u of the leading handle on its segment. Each handle has bounds of its own
coordinate and of that one's first two derivatives p and a on the whole interval; each link those of how fast it turns, w,
and of w'. docs/contact.md derives the formulas:

- on one line or arc all handles go alike, and so do links turn;
- on one spiral the handle at theta draws the one at theta + delta by p (1 + d1), a (1 + d1) + p^2 d2;
- across a joint, and on it, what counts are speed v and its rate along the track: v cos alpha is the same at both ends.
"""
from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from dragon_ros.verify.balls import UNIT, above, direction, up
from dragon_ros.verify.posture import Posture
from dragon_ros.verify.segments import HALF, ONE, TWO, ZERO, ArcSegment, LineSegment, Link, SpiralSegment, root_of
from dragon_ros.verify.track import AnySegment, Place, Track

NAN = arb('nan')


@dataclass(frozen=True, eq=False)
class Speeds:
    """A handle along the track: speed v and its rate in metres, unit tangent and signed curvature, on an interval."""

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
class Turning:
    """How fast a link turns, and the rate of that."""

    w: arb
    rate: arb


@dataclass(frozen=True, eq=False)
class Handle:
    """A handle on an interval; ``low`` and ``high`` bound its coordinate where it stays on one segment.

    ``ends`` number the ends of the interval at which it is there (None: at neither). ``moved_m`` bounds the way that it
    goes along the track, there and back where it may turn. ``across`` has its speeds where it passes a joint.
    """

    track: Track
    segment: int | None
    low: arb
    high: arb
    ends: tuple[int | None, int | None]
    p: arb
    a: arb
    moved_m: float
    across: Speeds | None = None

    @cached_property
    def u(self) -> arb:
        """All coordinates that it may have."""
        return self.low.union(self.high)

    @property
    def on(self) -> AnySegment:
        """The segment that it stays on."""
        assert self.segment is not None
        return self.track.segments[self.segment]

    @cached_property
    def speeds(self) -> Speeds:
        """Speeds along the track."""
        if self.across is not None:
            return self.across
        segment, u = self.on, self.u
        v, rate = segment.speed(u) * self.p * segment.sense, segment.speed(u) * self.a * segment.sense
        if isinstance(segment, SpiralSegment):
            rate += segment.b * u / root_of(u) * self.p * self.p * segment.sense
        return Speeds(v, rate, segment.heading(u), segment.curvature(u))

    @cached_property
    def pole(self) -> int | None:
        """The number of the centre that it turns about; None where it has none."""
        if self.segment is None or isinstance(self.on, LineSegment):
            return None
        return self.track.poles[self.segment]

    @cached_property
    def radial(self) -> tuple[arb, arb, arb, arb, arb]:
        """Distance from the centre, its two derivatives, and those of the angle there."""
        segment = self.on
        if isinstance(segment, SpiralSegment):
            b = segment.b
            return b * self.u, b * self.p, b * self.a, self.p * segment.side, self.a * segment.side
        assert isinstance(segment, ArcSegment)
        return segment.radius, ZERO, ZERO, self.p * segment.side, self.a * segment.side


def leading(track: Track, one: Place, two: Place) -> Handle:
    """Return the leading handle between two places, by the coordinate there, or across a joint by metres."""
    moved_m = track.apart_m(one, two)
    if _stays(one, two):
        return Handle(track, one.segment, *_ordered(one, two), ONE, ZERO, moved_m)
    return Handle(track, None, ZERO, ZERO, (None, None), NAN, NAN, moved_m,
                  Speeds(ONE, ZERO, *_joint_between(track, one, two, moved_m)))


def _stays(one: Place, two: Place) -> bool:
    """Return whether a handle that goes from one place to another stays on a segment, as far as is known."""
    return one.segment == two.segment and not one.loose and not two.loose


def _ordered(one: Place, two: Place) -> tuple[arb, arb, tuple[int | None, int | None]]:
    return (one.u, two.u, (0, 1)) if float(one.u) < float(two.u) else (two.u, one.u, (1, 0))


def _joint_between(track: Track, one: Place, two: Place, moved_m: float) -> tuple[acb, arb]:
    """Return the tangents and the curvatures of the track between two places on either side of a joint."""
    headings = (track.segments[place.segment].heading(place.u) for place in (one, two))
    return between(*headings, up(0.5 * track.bend * moved_m)), track.curvatures(one, two)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """First and second derivatives by theta of a link's span delta and of its direction, theta + psi."""

    delta_1: arb
    delta_2: arb
    psi_1: arb
    psi_2: arb


def _slopes(theta: arb, delta: arb, square: arb) -> _Slopes:
    """Differentiate F(theta, delta) = chord^2 / 2 and the direction; ``square`` is chord^2 in units of b."""
    half, cosine = (HALF * delta).sin_cos()
    less, sine = TWO * half * half, TWO * half * cosine
    cos = ONE - less
    both, area = TWO * theta + delta, theta * (theta + delta)
    inverse = ONE / (delta + theta * less + area * sine)
    one = -both * less * inverse
    one_square = one * one
    two = -TWO * (less + (less + both * sine) * one + (HALF + theta * sine + HALF * area * cos) * one_square) * inverse
    rest, turned = delta - theta * one, delta * one
    psi_1 = sine * rest + HALF * both * turned
    psi_2 = (cos * one * rest - theta * sine * two + (ONE + HALF * one) * turned
             + HALF * both * (one_square + delta * two))
    share = ONE / square
    return _Slopes(one, two, HALF * one + share * psi_1, HALF * two + share * psi_2)


def _tangent_slopes(theta: arb) -> _Slopes:
    """Return the slopes of a link of no length, which lies along the track."""
    inverse = ONE / (ONE + theta * theta)
    return _Slopes(ZERO, ZERO, inverse, -TWO * theta * inverse * inverse)


def follow(front: Handle, ends: tuple[Posture, Posture], n: int, link: Link, bend: float | None
           ) -> tuple[Handle, Turning]:
    """Return the handle behind another one, n and n + 1 behind the leading one, and how the link between them turns.

    ``ends`` are the dragon at both ends of the interval; ``bend`` is the track's largest curvature, or None where
    handles may turn back and only spans say where the next one is.
    """
    one, two = (end.place(n + 1) for end in ends)
    if bend is not None and (front.segment != one.segment or not _stays(one, two)):
        return _across(front, ends, n, link, bend)
    if isinstance(front.on, SpiralSegment):
        if front.on.sense > 0:
            return _inwards(front, one, two, link)
        return _outwards(front, ends, n, link, bend is None)
    side = front.on.side if isinstance(front.on, ArcSegment) else 0
    return (Handle(front.track, front.segment, *_ordered(one, two), front.p, front.a, front.moved_m),
            Turning(front.p * side, front.a * side))


def spiral_slopes(segment: SpiralSegment, theta: arb, delta: arb, link: Link) -> _Slopes:
    """Return the slopes of a link between handles of a spiral that winds in."""
    return _slopes(theta, delta, link.square / (segment.b * segment.b)) if link.near else _tangent_slopes(theta)


def _outwards(front: Handle, ends: tuple[Posture, Posture], n: int, link: Link, may_turn: bool
              ) -> tuple[Handle, Turning]:
    """Return the handle further out on a spiral that winds in; it may turn back where links are long for it."""
    segment = front.on
    assert isinstance(segment, SpiralSegment)
    low, high = (u + segment.span(u, link) if end is None else ends[end].place(n + 1).u
                 for u, end in zip((front.low, front.high), front.ends, strict=True))
    spans = low - front.low, high - front.high
    slopes = spiral_slopes(segment, front.u, spans[0].union(spans[1]), link)   # spans fall as theta grows (lemma 1)
    ratio, numbers, times = ONE + slopes.delta_1, front.ends, 1.0
    if may_turn and not ratio > 0:
        if ratio < 0:
            low, high, numbers = high, low, numbers[::-1]
        else:
            low, high, numbers, times = *_turning(front, (low, high), spans, ratio), (None, None), 2.0
    p, a = front.p * ratio, front.a * ratio + front.p * front.p * slopes.delta_2
    moved_m = up(times * above(segment.b * abs(high - low) * root_of(high)))
    return Handle(front.track, front.segment, low, high, numbers, p, a, moved_m), _turned(segment, front.p, front.a, slopes)


def _turned(segment: SpiralSegment, p: arb, a: arb, slopes: _Slopes) -> Turning:
    """Return how a link turns whose inner handle goes by p and a: its direction is theta + psi."""
    turned = ONE + slopes.psi_1
    return Turning(p * turned * segment.side, (a * turned + p * p * slopes.psi_2) * segment.side)


def _turning(front: Handle, images: tuple[arb, arb], spans: tuple[arb, arb], ratio: arb) -> tuple[arb, arb]:
    """Return bounds of a handle that may turn back: by spans that only fall, and by the mean value theorem."""
    lows, highs = [front.low + spans[1]], [front.high + spans[0]]
    change = ratio * (front.high - front.low) * ZERO.union(ONE)
    if change.is_finite():
        means = images[0] + change, images[1] - change
        lows, highs = [*lows, *means], [*highs, *means]
    return max((one.lower() for one in lows), key=float), min((one.upper() for one in highs), key=float)


def _inwards(front: Handle, one: Place, two: Place, link: Link) -> tuple[Handle, Turning]:
    """Return the handle further in on a spiral that winds out: the one in front follows from it as on the way in."""
    segment = front.on
    assert isinstance(segment, SpiralSegment)
    low, high, numbers = _ordered(one, two)
    slopes = spiral_slopes(segment, low.union(high), (front.low - low).union(front.high - high), link)
    p = front.p / (ONE + slopes.delta_1)
    a = (front.a - p * p * slopes.delta_2) / (ONE + slopes.delta_1)
    return (Handle(front.track, front.segment, low, high, numbers, p, a, front.track.apart_m(one, two)),
            _turned(segment, p, a, slopes))


def _across(front: Handle, ends: tuple[Posture, Posture], n: int, link: Link, bend: float) -> tuple[Handle, Turning]:
    """Return the handle behind where a link or a handle crosses a joint."""
    track, ahead = front.track, front.speeds
    one, two = (end.place(n + 1) for end in ends)
    moved_m = track.apart_m(one, two)
    if link.inverse is None:    # on a joint its direction has no second derivative
        return (Handle(track, front.segment, front.low, front.high, front.ends, front.p, front.a, moved_m, front.across),
                Turning(ahead.curvature * ahead.v, NAN))
    # A link turns by half the curvature times both ways at most; from half way between its ends by half of that.
    axis = between(*((end.point(n) - end.point(n + 1)) * link.inverse for end in ends),
                   up(0.25 * bend * (front.moved_m + moved_m)))
    stays = _stays(one, two)
    if stays:
        segment, u = track.segments[one.segment], one.u.union(two.u)
        tangent, curvature = segment.heading(u), segment.curvature(u)
    else:
        tangent, curvature = _joint_between(track, one, two, moved_m)
    alpha, beta = (axis.conjugate() * heading for heading in (ahead.tangent, tangent))
    v = ahead.v * alpha.real / beta.real
    w = (ahead.v * alpha.imag - v * beta.imag) * link.inverse
    alpha_rate, beta_rate = ahead.curvature * ahead.v - w, curvature * v - w
    rate = (ahead.rate * alpha.real - ahead.v * alpha.imag * alpha_rate + v * beta.imag * beta_rate) / beta.real
    w_rate = (ahead.rate * alpha.imag + ahead.v * alpha.real * alpha_rate
              - rate * beta.imag - v * beta.real * beta_rate) * link.inverse
    speeds, turning = Speeds(v, rate, tangent, curvature), Turning(w, w_rate)
    if stays:
        return _settled(track, one, two, speeds, moved_m), turning
    return Handle(track, None, ZERO, ZERO, (None, None), NAN, NAN, moved_m, speeds), turning


def _settled(track: Track, one: Place, two: Place, speeds: Speeds, moved_m: float) -> Handle:
    """Return a handle that stays on a segment by its speeds along the track."""
    low, high, numbers = _ordered(one, two)
    segment, u, rate = track.segments[one.segment], low.union(high), speeds.rate
    speed = segment.speed(u) * segment.sense
    p = speeds.v / speed
    if isinstance(segment, SpiralSegment):
        rate = rate - segment.b * u / root_of(u) * p * p * segment.sense
    return Handle(track, one.segment, low, high, numbers, p, rate / speed, moved_m)


def between(one: acb, two: acb, turned: float) -> acb:
    """Return all directions that are no more than an angle from the one half way between two."""
    middle = one + two
    length = abs(middle)
    return middle / length * direction(UNIT * turned) if length > 0 else acb(UNIT, UNIT)
