"""How near a bench and those behind it can come between two places of its front handle on a spiral segment.

On an interval of length h (in the polar angle of the leading handle) the corners of a bench, seen in the frame of
another, leave the straight lines between their places at its ends by at most B h^2 / 8, B a bound on their second
derivative there. Along straight lines the separation from a fixed edge is concave, so it is nowhere less than the
smaller of its values at the two ends. Hence a pair is apart on the whole interval if, for one edge and one side of it,
that smaller value exceeds B h^2 / 8.

Close to a lock, where no such B exists, what counts is how far the handles of both benches go at all. Benches further
out are cleared by the circle about the centre that parts them. All this takes handles that move one way on an interval:
it must not contain the place where one turns back.

B follows from the polar angles of the handles at the two ends of the interval; docs/contact.md has the proofs.
A prime is a derivative by the polar angle of the leading handle. A link of chord c (in units of b) from a handle at
theta spans delta, the smallest root of F = delta^2 / 2 + theta (theta + delta) (1 - cos delta) = c^2 / 2, so

    d1 = d delta / d theta = -F_theta / F_delta <= 0,    d2 = -(F_tt + 2 F_td d1 + F_dd d1^2) / F_delta,

and handles follow each other by p_next = p (1 + d1), a_next = a (1 + d1) + p^2 d2 (p and a: first and second
derivative of theta). The link's direction is theta + psi with

    psi1 = d1 / 2 + (sin delta (delta - theta d1) + (theta + delta / 2) delta d1) / c^2.

In the frame of a bench that turns by w, the handle b theta exp(i theta) has the acceleration, with v = p - w,

    b (a - theta v^2)  outwards,     b (2 p v + theta v')  across.

Benches of adjacent layers turn almost alike, so v is small and nothing large cancels. delta and, on either side of the
place where the follower turns back, theta lie between their values at the ends: every formula is evaluated once, for
all that they may be, and by as much more as positions may err.

All is rounded outwards: balls by themselves (``ball_arithmetic``), separations by ``signed_distance.rounding_m``, and
the formulas that put bounds together, sums and products of a few dozen positive numbers, by the factor ABOVE.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.contact.narrow_phase import BenchSamples, Sizes, beyond, further
from dragon_ros.core.numerics.ball_arithmetic import Ball, between, side_by_side
from dragon_ros.core.numerics.types import Array, Floats, Ints

ABOVE = 1 + 2.0**-40    # of bounds: more than eight thousand roundings of positive numbers take away
_STILL = 1e-9       # of a turn of the follower: nearer to it nothing moves by more than positions may err


@dataclass(frozen=True)
class _Slopes:
    """First and second derivatives of delta and psi by theta, each (M, K)."""

    delta_1: Ball
    delta_2: Ball
    psi_1: Ball
    psi_2: Ball


@dataclass(frozen=True)
class Spans:
    """Links (M, K): handles at theta and outer, what is between them, F_delta's inverse, and ratio = 1 + d1."""

    theta: Ball
    delta: Ball
    outer: Ball
    sin: Ball
    cos: Ball
    less: Ball
    inverse: Ball

    @property
    def both(self) -> Ball:
        """2 theta + delta."""
        return self.theta + self.outer

    @property
    def area(self) -> Ball:
        """Theta (theta + delta)."""
        return self.theta * self.outer

    @property
    def delta_1(self) -> Ball:
        """d1, of a chord that does not change."""
        return -(self.both * self.less * self.inverse)


@dataclass(frozen=True)
class Motion:
    """Handles (M, K+1): angle, p, a, and ``turned``: p less what is common to all; links (M, K): turning and its rate.

    What is common to all is left out of the links' turning too: only differences count there.
    """

    theta: Ball
    p: Ball
    a: Ball
    turned: Ball
    w: Ball
    w_rate: Ball


def spans(theta: Ball, delta: Ball) -> Spans:
    """Return links between handles (M, K+1) that span delta (M, K)."""
    sin, cos, less = delta.trig()
    theta, outer = theta[:, :-1], theta[:, 1:]
    return Spans(theta, delta, outer, sin, cos, less, (delta + theta * less + theta * outer * sin).inverse())


def bend(theta: Ball, delta: Ball, chord: Ball, arm: Floats) -> Floats:
    """Return bounds (M, K-2, 2) of second derivatives on M intervals, in units of b per square radian.

    ``theta`` (M, K+1) are all angles that handles have on an interval, ``delta`` (M, K) all that links span, ``chord``
    and ``arm`` (M or 1, K) their lengths and the half diagonals of the benches in units of b. The bounds are those of
    the corners of benches 2 and on in the frame of bench 0, and of the corners of bench 0 in theirs. Infinite where
    nothing is known: close to a lock.
    """
    with np.errstate(all='ignore'):
        return corners(_motion(theta, _slopes(theta, delta, chord)), arm)


def corners(moving: Motion, arm: Floats, growth: float = 0.0) -> Floats:
    """Return bounds as ``bend`` does; arms grow by ``growth`` of their length for each unit, steadily."""
    with np.errstate(all='ignore'):
        in_lead, in_other = _middles(moving, slice(0, 1)), _middles(moving, slice(2, None))
        dw, dw_rate = moving.w[:, 2:] - moving.w[:, :1], moving.w_rate[:, 2:] - moving.w_rate[:, :1]
        spin = np.hypot(dw_rate.most, dw.most**2) + 2 * growth * dw.most
        out: Floats = ABOVE * np.stack((in_lead + arm[:, 2:] * spin, in_other + arm[:, :1] * spin), axis=-1)
    return np.where(np.isfinite(out), out, np.inf)


def _middles(moving: Motion, frame: slice) -> Floats:
    """Return bounds of how middles of benches accelerate as seen from the middle of bench 0, in the frame of some."""
    handles = slice(0, 1), slice(1, 2), slice(2, -1), slice(3, None)
    one, two, three, four = (_acceleration(moving, frame, handle) for handle in handles)
    return 0.5 * (one + two + three + four)


def _acceleration(moving: Motion, frame: slice, handle: slice) -> Floats:
    theta, p, a = moving.theta[:, handle], moving.p[:, handle], moving.a[:, handle]
    v = moving.turned[:, handle] - moving.w[:, frame]
    outwards, across = a - theta * v.squared(), 2 * p * v + theta * (a - moving.w_rate[:, frame])
    return np.hypot(outwards.most, across.most)


def _motion(theta: Ball, slopes: _Slopes) -> Motion:
    p, a = _handles(slopes)
    turned = slopes.psi_1 + 1
    return Motion(theta, p, a, p, p[:, :-1] * turned, a[:, :-1] * turned + p[:, :-1].squared() * slopes.psi_2)


def _slopes(theta: Ball, delta: Ball, chord: Ball) -> _Slopes:
    """Differentiate F = c^2 / 2 and the link's direction."""
    link = spans(theta, delta)
    theta, sin, cos, less, both, one = link.theta, link.sin, link.cos, link.less, link.both, link.delta_1
    two = -((2 * less + 2 * (less + both * sin) * one + (1 + 2 * theta * sin + link.area * cos) * one.squared())
            * link.inverse)
    rest = delta - theta * one
    psi_1 = sin * rest + 0.5 * both * delta * one
    psi_2 = (cos * one * rest - theta * sin * two + 0.5 * (2 + one) * delta * one
             + 0.5 * both * (one.squared() + delta * two))
    share, joined = chord.squared().inverse(), chord.most == 0
    slopes = _Slopes(one, two, 0.5 * one + share * psi_1, 0.5 * two + share * psi_2)
    return _with_joined(slopes, theta, joined) if np.any(joined) else slopes


def _with_joined(slopes: _Slopes, theta: Ball, joined: Array) -> _Slopes:
    """Return the slopes with those of links of no length, which lie along the track."""
    none = Ball(np.zeros_like(theta.mid), np.zeros_like(theta.mid))
    flat = (1 + theta.squared()).inverse()
    along = none, none, flat, -2 * theta * flat.squared()
    kept = slopes.delta_1, slopes.delta_2, slopes.psi_1, slopes.psi_2
    return _Slopes(*(Ball(np.where(joined, a.mid, b.mid), np.where(joined, a.rad, b.rad))
                     for a, b in zip(along, kept, strict=True)))


def _handles(slopes: _Slopes) -> tuple[Ball, Ball]:
    """Return p and a of all handles: those behind the third first by its angle, a / p being a sum along the chain.

    The second and third handle may turn back, where such a quotient says nothing.
    """
    ratio, rate = 1 + slopes.delta_1, slopes.delta_2
    none = Ball(np.zeros_like(ratio.mid[:, :1]), np.zeros_like(ratio.mid[:, :1]))
    p, a = [none + 1.0], [none]
    for link in (slice(0, 1), slice(1, 2)):
        a.append(a[-1] * ratio[:, link] + p[-1].squared() * rate[:, link])
        p.append(p[-1] * ratio[:, link])
    after = ratio[:, 2:].running_product()
    bent = after * (side_by_side([p[0], after[:, :-1]]) * rate[:, 2:] * ratio[:, 2:].inverse()).running_sum()
    return (side_by_side([*p, after * p[-1]]),
            side_by_side([*a, bent * p[-1].squared() + after * a[-1]]))


def bounds(a: BenchSamples, b: BenchSamples, sizes: Sizes, behind: Ints) -> Floats:
    """Return lower bounds (M,) of the gaps on intervals between samples a and b; not positive: not cleared.

    Only the next ``behind`` (M,) benches count.
    """
    sides = [np.minimum(side * a.offset - a.extent, side * b.offset - b.extent) for side in (1, -1)]
    separation, sag = np.maximum(*sides), _sag(a, b, sizes)
    low = np.maximum(np.max(separation[..., :2], axis=-1) - sag[..., 0],
                     np.max(separation[..., 2:], axis=-1) - sag[..., 1])
    way = _way(a, b, sizes)
    low = np.maximum(low, np.maximum(a.apart, b.apart) - way[:, :1] - way[:, 2:])
    low -= sizes.rounding_m(np.maximum(a.theta[:, -1], b.theta[:, -1]))[:, None]
    circle = beyond(a, b, sizes)
    out: Floats = np.min(np.where(_there(circle, behind), np.maximum(low, circle), np.inf), axis=1)
    unseen = (behind > circle.shape[1] + 1) & (further(a, b, sizes, circle)[:, -1] <= 0)
    return np.where(unseen | _turns_back(a, b), -np.inf, out)


def _there(gap: Floats, behind: Ints) -> Array:
    """Return which of the benches (M, K-2) are there at all."""
    out: Array = np.arange(2, gap.shape[1] + 2) <= behind[:, None]
    return out


def _sag(a: BenchSamples, b: BenchSamples, sizes: Sizes) -> Floats:
    """Return how far corners leave straight lines, (M, K-2, 2) in metres: in the leading bench's frame, and others'."""
    arm = np.hypot(sizes.half_length_m, sizes.half_width_m)[None] / sizes.b_m
    chord = sizes.links_m[None] / sizes.b_m
    length = (a.places - b.places)[:, None, None]
    off = sizes.angle_errors(np.minimum(a.theta, b.theta))
    theta, delta = between(a.theta, b.theta, off), between(a.delta, b.delta, 2 * off[:, :-1])
    most = bend(theta, delta, between(chord, chord), arm)
    out: Floats = most * (sizes.b_m * length * length / 8)
    return out


def _way(a: BenchSamples, b: BenchSamples, sizes: Sizes) -> Floats:
    """Return how far corners go at most (M, K) in metres: as far as a handle, times the bench's lever."""
    outer = np.maximum(a.theta, b.theta)
    handle = ABOVE * (sizes.b_m * np.abs(a.theta - b.theta) * np.sqrt(1 + outer * outer) + 4 * sizes.error_m)
    overhang = sizes.half_length_m - 0.5 * sizes.links_m + sizes.half_width_m
    lever = 1 + 2 * overhang / np.maximum(sizes.links_m, 1e-12)
    out: Floats = lever * np.maximum(handle[:, :-1], handle[:, 1:])
    return out


def _turns_back(a: BenchSamples, b: BenchSamples) -> Array:
    """Return where the second or third handle comes in at one end of an interval and goes out at the other."""
    one, two = (comes_in(each.theta[:, :3], each.delta[:, :2]) for each in (a, b))
    out: Array = np.any((np.minimum(one, two) < -_STILL) & (np.maximum(one, two) > _STILL), axis=1)
    return out


def comes_in(theta: Floats, delta: Floats) -> Floats:
    """Return numbers that are positive where a link's rear handle follows its front handle inwards."""
    inner, outer = theta[..., :-1], theta[..., 1:]
    out: Floats = delta * np.cos(delta) + inner * (outer * np.sin(delta) - 2 * np.sin(0.5 * delta) ** 2)
    return out
