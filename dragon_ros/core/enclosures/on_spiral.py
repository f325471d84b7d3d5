"""How close a bench and its followers can come while its front handle moves between two positions on a spiral segment.

Consider an interval of length h in the polar angle of the leading handle. If B bounds the second derivatives of a
bench's corners in the frame of another bench, the corners deviate by at most B h^2 / 8 from the straight lines between
their positions at the two ends of the interval. Along straight lines the separation from a fixed edge is concave, so it
is never less than the smaller of its values at the two ends. A pair is therefore apart on the whole interval if, for
one side of one edge, this smaller value exceeds B h^2 / 8.

Close to a lock there is no such B, and the bound follows from the distances that the handles of both benches move.
Benches further out are cleared if a circle about the centre separates them from the leading bench. All bounds require
that handles move in one direction: an interval must not contain a position at which a handle turns back.

B follows from the polar angles of the handles at the two ends of the interval; the proofs are in docs/contact.md. A
prime is a derivative with respect to the polar angle of the leading handle. A link with chord c (in units of b) and its
front handle at theta spans delta, the smallest root of F = delta^2 / 2 + theta (theta + delta) (1 - cos delta) = c^2 /
2, so

    d1 = d delta / d theta = -F_theta / F_delta <= 0,    d2 = -(F_tt + 2 F_td d1 + F_dd d1^2) / F_delta,

and the next handle has p_next = p (1 + d1) and a_next = a (1 + d1) + p^2 d2, where p and a are the first and the second
derivative of theta. The link's direction is theta + psi with

    psi1 = d1 / 2 + (sin delta (delta - theta d1) + (theta + delta / 2) delta d1) / c^2.

In the frame of a bench that turns at the rate w, the handle b theta exp(i theta) has, with v = p - w, the acceleration

    b (a - theta v^2)  outwards,     b (2 p v + theta v')  across.

Benches of adjacent layers turn at almost the same rate, so v is small and no large terms cancel. The span delta lies
between its values at the ends, and so does theta on either side of the position where the follower turns back. Every
formula is therefore evaluated once, for all values in these ranges, widened by the position error.

All bounds are rounded outwards: balls by their arithmetic (``ball_arithmetic``), separations by
``signed_distance.rounding_m``, and formulas that combine bounds (sums and products of a few dozen positive numbers) by
the factor ABOVE.

On a spiral that winds in from afar, the chain behind a bench depends only on the polar angle theta of its front handle.
Intervals therefore end at such angles, and benches are sampled there. Leading benches with different followers are
sampled together: the next handles behind all leading benches are placed together, each with its own link length.
"""
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, reduce
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.chain.chain import marched_many
from dragon_ros.core.chain.dragon import AnyDragon, is_even
from dragon_ros.core.enclosures.ball_arithmetic import Ball, between, side_by_side
from dragon_ros.core.geometry.rectangles import axes_of, corner_levers
from dragon_ros.core.geometry.signed_distance import parted_between, rounding_m, seen_from
from dragon_ros.core.numerics.types import Array, Complexes, Floats, Ints
from dragon_ros.core.tracks.composite import Track
from dragon_ros.core.tracks.segments import BEHIND

ABOVE = 1 + 2.0**-40    # factor for bounds that covers more than eight thousand roundings of positive numbers
_SETTLED = 0.5      # a first-order bound above this fraction of the gap is sufficient
_SURE = 8           # multiple of the position error that exceeds any tolerance
_STILL = 1e-9  # margin around the follower's turning position, where motion is below the position error
_COMPLEX = np.array([1, 1j])
_AT_ONCE = 512  # number of positions whose intermediate results fit into the cache
_FEW = 64       # number of followers tried first: more than two layers of the classic dragon near the centre


@dataclass(frozen=True)
class BenchSamples:
    """Samples of leading benches at M positions, each with K - 2 followers, starting with its second one.

    ``lead`` (M,) holds the sampler's indices of the leading benches, ``theta`` (M, K+1) the polar angles of all handles
    from the leading handle on, ``delta`` (M, K) the spans of the links, and ``centre`` and ``axis`` (M, K) the middles
    and axes of the benches as complex numbers. ``apart`` (M, K-2) holds the largest separations along the axes of both
    benches; a separation is positive if the pair is apart.
    """

    lead: Ints
    theta: Floats
    delta: Floats
    centre: Complexes
    axis: Complexes
    apart: Floats

    @property
    def places(self) -> Floats:
        """The polar angles (M,) of the leading handles."""
        return self.theta[:, 0]

    def rows(self, index: Ints | slice) -> 'BenchSamples':
        """Return a subset of the samples."""
        return BenchSamples(*(getattr(self, name)[index] for name in _FIELDS))


_FIELDS = tuple(each.name for each in fields(BenchSamples))


def joined(samples: list[BenchSamples]) -> BenchSamples:
    """Concatenate samples."""
    return BenchSamples(*(np.concatenate([getattr(each, name) for each in samples]) for name in _FIELDS))


def samples_of(track: Track, links_m: Floats, half_m: tuple[Floats, float | Floats], theta: Floats,
               lead: Ints) -> BenchSamples:
    """Return the samples of leading benches at positions (M,), with the same links (K,) for all, or links (M, K).

    ``half_m`` holds half lengths (M or 1, K), and half widths (M, 1) or one half width for all benches.
    """
    leaders = np.zeros(theta.size, dtype=np.int64), theta, np.zeros_like(theta)
    chain = marched_many(track, links_m, leaders, BEHIND)
    z, axis = chain.p @ _COMPLEX, axes_of(chain) @ _COMPLEX
    # Far out, a single float has too few digits for the span of a link; the low parts of the angles provide the rest.
    delta, centre = np.diff(chain.u) + np.diff(chain.u_lo), 0.5 * (z[:, :-1] + z[:, 1:])
    half_length_m, half_width_m = half_m
    pairs = seen_from((centre[:, :1], centre[:, 2:]), (axis[:, :1], axis[:, 2:]),
                      (half_length_m[:, :1], half_width_m), (half_length_m[:, 2:], half_width_m))
    return BenchSamples(lead, chain.u, delta, centre, axis, reduce(np.maximum, pairs.along_axes()))


@dataclass(frozen=True)
class Sizes:
    """The links (L, K), half lengths (L, K) and half width of sampled benches, and bounds on errors, all in metres.

    ``error_m`` bounds the errors of handles, and ``excess_m`` (L, K) the amount by which the error of a bench's corners
    may exceed that of its handles. There is one row per leading bench or, after ``of``, per sample. ``longest_m`` (L,
    1) is the longest of these links and all links behind them, or 0 if all links behind the first are equal. If there
    are fewer than K benches, copies of the last bench are added.
    """

    b_m: float
    error_m: float
    excess_m: Floats
    links_m: Floats
    half_length_m: Floats
    half_width_m: float
    longest_m: Floats

    def of(self, lead: Ints) -> 'Sizes':
        """Return one row per sample; a single row applies to all samples."""
        if self.longest_m.size == 1:
            return self
        rows = (each[lead] for each in (self.excess_m, self.links_m, self.half_length_m, self.longest_m))
        excess_m, links_m, half_length_m, longest_m = rows
        return replace(self, excess_m=excess_m, links_m=links_m, half_length_m=half_length_m, longest_m=longest_m)

    def angle_errors(self, theta: Floats) -> Floats:
        """Return the errors of polar angles (...); a handle at theta moves b sqrt(1 + theta^2) per radian.

        The errors correspond to twice the position error; one half covers the computation of positions from angles.
        """
        out: Floats = (2 * self.error_m / self.b_m) / np.maximum(theta, 1.0)
        return out

    def rounding_m(self, theta: Floats) -> Floats:
        """Return the rounding errors (m) of separations when the last handle is at polar angles (M,)."""
        out = rounding_m(self.b_m * theta, float(np.max(self.half_length_m)) + self.half_width_m)
        assert isinstance(out, np.ndarray)
        return out


@dataclass(frozen=True)
class BenchSampler:
    """A sampler of benches ``leads`` on a first segment that is a spiral, each with ``follow`` - 1 followers.

    Lead 0 is the head. ``error_m`` bounds position errors. If there are several leads, no link may have a length of
    zero or almost zero.
    """

    track: Track
    dragon: AnyDragon
    leads: tuple[int, ...]
    follow: int
    progress: Callable[[int], object]
    error_m: float

    def sample(self, theta: Floats, lead: Ints | None = None) -> BenchSamples:
        """Return the samples at positions (M,) of the leading benches with indices ``lead`` (M,), by default 0."""
        lead = np.zeros(theta.size, dtype=np.int64) if lead is None else lead
        return joined([self._sample(theta[at:at + _AT_ONCE], lead[at:at + _AT_ONCE])
                       for at in range(0, theta.size, _AT_ONCE)])

    def _sample(self, theta: Floats, lead: Ints) -> BenchSamples:
        self.progress(theta.size)
        size = self.sizes.of(lead)
        links_m = size.links_m[0] if len(self.leads) == 1 else size.links_m
        return samples_of(self.track, links_m, (size.half_length_m, size.half_width_m), theta, lead)

    @property
    def b_m(self) -> float:
        """The radial growth of the spiral, in metres per radian."""
        assert self.track.from_afar
        return self.track.from_afar.curve.b_m

    @cached_property
    def sizes(self) -> Sizes:
        """The sizes of the sampled benches."""
        d = self.dragon
        sampled = np.minimum(np.array(self.leads)[:, None] + np.arange(self.follow), d.benches - 1)
        rest = [d.link_lengths_m[lead:] for lead in self.leads]
        longest_m = [[0.0 if is_even(each) else float(np.max(each))] for each in rest]
        excess_m = self.error_m * (corner_levers(d, self.track.bend)[sampled] - 1)
        return Sizes(self.b_m, self.error_m, excess_m, d.link_lengths_m[sampled], 0.5 * d.bench_lengths_m[sampled],
                     0.5 * d.width_m, np.array(longest_m))

    def reaching(self, theta: Floats, lead: Ints | None = None) -> 'BenchSampler':
        """Return a sampler that is limited to the followers within reach at given positions, if they are few."""
        follow, most = _FEW, self.dragon.benches - np.array(self.leads)
        while follow < self.follow:
            fewer = replace(self, follow=follow)
            samples = fewer.sample(theta, lead)
            sizes = fewer.sizes.of(samples.lead)
            away = further(samples, samples, sizes, beyond(samples, samples, sizes)) > 0
            clear = np.all(away | (np.arange(2, follow) >= most[samples.lead][:, None]), axis=0)
            if clear[-1]:
                return replace(self, follow=5 + int(1.1 * np.argmax(clear)))
            follow *= 2
        return self


def beyond(a: BenchSamples, b: BenchSamples, sizes: Sizes) -> Floats:
    """Return how far benches (M, K-2) stay outside the leading bench's circle about the centre between two samples.

    The leading bench extends outwards beyond its rear handle by at most the distance of a corner from this handle. The
    line of a link has the distance H = b (c^2 - delta^2) cot(delta / 2) / 2c from the centre; H decreases as delta
    increases, and therefore increases with theta.
    """
    span, outer = np.maximum(a.delta, b.delta)[:, 2:], np.maximum(a.theta[:, 1], b.theta[:, 1])
    inner, chord = np.minimum(a.theta, b.theta)[:, 2:-1], sizes.links_m[:, 2:] / sizes.b_m
    linked = chord > 0
    across = line_distance(np.where(linked, chord, 1), np.where(linked, span, 1), 2 * sizes.angle_errors(inner))
    along = inner * inner / np.sqrt(1 + inner * inner)      # distance of the tangent, for links of zero length
    overhang = sizes.half_length_m[:, 0] - 0.5 * sizes.links_m[:, 0]
    reach = sizes.b_m * outer + 2 * sizes.error_m + np.hypot(overhang, sizes.half_width_m)
    off = sizes.rounding_m(np.maximum(a.theta[:, -1], b.theta[:, -1]))
    out: Floats = sizes.b_m * np.where(linked, across, along) - sizes.half_width_m - (reach + off)[:, None]
    return out


def line_distance(chord: Floats, delta: Floats, error: Floats) -> Floats:
    """Return lower bounds on the distances of the lines of links from the centre, in units of b.

    Links have the length ``chord`` and span ``delta``, which has an error of at most e. For delta < pi the distance
    (c^2 - delta^2) cot(delta / 2) / 2c changes by at most e (2 / c + 2.5 c / delta^2), because delta cot(delta / 2) <=
    2 and sin(delta / 2) >= delta / pi; from delta = pi on, the distance is not positive. Rounding adds at most 2^-49 c
    / delta.
    """
    distance = (chord - delta) * (chord + delta) / (2 * chord * np.tan(0.5 * delta))
    out: Floats = distance - error * (2 / chord + 2.5 * chord / (delta * delta)) - 2.0**-49 * chord / delta
    return out


def further(a: BenchSamples, b: BenchSamples, sizes: Sizes, circle: Floats) -> Floats:
    """Return how far each bench (M, K-2) and all benches behind it stay outside the leading bench's circle.

    ``circle`` is the result of ``beyond``. If links are equal, the result is the distance of each bench itself, because
    distances increase from bench to bench. Otherwise, a link of length l comes no nearer to the centre than sqrt(r^2 -
    l^2 / 4), because the nearer handle is at most l / 2 from the foot of the perpendicular. The distance r of its front
    handle from the centre increases from bench to bench. No point of a bench is further from its link than a corner is
    from the nearer handle.
    """
    if not np.any(sizes.longest_m):
        return circle
    overhang = np.hypot(sizes.half_length_m[:, :1] - 0.5 * sizes.links_m[:, :1], sizes.half_width_m)
    inner, outer = np.minimum(a.theta, b.theta)[:, 2:-1], np.maximum(a.theta[:, 1], b.theta[:, 1])
    nearest = np.maximum(sizes.b_m * inner - 2 * sizes.error_m, 0.0)
    away = np.sqrt(np.maximum((nearest - 0.5 * sizes.longest_m) * (nearest + 0.5 * sizes.longest_m), 0.0))
    off = sizes.rounding_m(np.maximum(a.theta[:, -1], b.theta[:, -1])) + 2 * sizes.error_m
    out: Floats = np.where(sizes.longest_m > 0, away - 2 * overhang - (sizes.b_m * outer + off)[:, None], circle)
    return out


At = tuple[Any, Any]    # rows and columns


class _Pairs(NamedTuple):
    """The indices, among handles (M, K+1), of the front and rear handles of leading benches and of other benches.

    A bench's link has the index of its front handle.
    """

    lead: At
    lead_rear: At
    other: At
    other_rear: At


def _all_pairs(count: int) -> _Pairs:
    """Return the pairs of bench 0 with benches 2 to ``count`` - 1 in all rows."""
    lead, other = slice(0, 1), slice(2, count)
    return _Pairs(*((slice(None), handles) for handles in (lead, slice(1, 2), other, slice(3, count + 1))))


def _some_pairs(row: Ints, bench: Ints) -> _Pairs:
    """Return the pairs (P,) of bench 0 with the given benches in the given rows."""
    first = np.zeros_like(row)
    return _Pairs((row, first), (row, first + 1), (row, bench), (row, bench + 1))


@dataclass(frozen=True)
class _Slopes:
    """The first and second derivatives (M, K) of delta and psi with respect to theta."""

    delta_1: Ball
    delta_2: Ball
    psi_1: Ball
    psi_2: Ball


@dataclass(frozen=True)
class Spans:
    """Functions of delta, and the inverse of F_delta, for links (M, K) from handles at theta to handles at outer."""

    theta: Ball
    delta: Ball
    outer: Ball
    sin: Ball
    cos: Ball
    less: Ball
    inverse: Ball

    @property
    def both(self) -> Ball:
        """The sum 2 theta + delta."""
        return self.theta + self.outer

    @property
    def area(self) -> Ball:
        """The product theta (theta + delta)."""
        return self.theta * self.outer

    @property
    def delta_1(self) -> Ball:
        """The derivative d1 for a constant chord."""
        return -(self.both * self.less * self.inverse)


@dataclass(frozen=True)
class SpiralMotion:
    """The angles, p, a and ``turned`` of handles (M, K+1), and the turning ``w`` of links (M, K) with its rate.

    ``turned`` and ``w`` exclude the part of p that is common to all handles, because only differences matter.
    """

    theta: Ball
    p: Ball
    a: Ball
    turned: Ball
    w: Ball
    w_rate: Ball


def spans(theta: Ball, delta: Ball) -> Spans:
    """Return links between handles (M, K+1) that span delta (M, K)."""
    (sin, cos), less = delta.sin_cos(), delta.versine()
    theta, outer = theta[:, :-1], theta[:, 1:]
    return Spans(theta, delta, outer, sin, cos, less, (delta + theta * less + theta * outer * sin).inverse())


def bend(theta: Ball, delta: Ball, chord: Ball, arm: Floats, pairs: _Pairs | None = None) -> Floats:
    """Return bounds (M, K-2, 2) on second derivatives over M intervals, in units of b per square radian.

    ``theta`` (M, K+1) encloses the angles of handles on an interval, ``delta`` (M, K) the spans of links; ``chord`` and
    ``arm`` (M or 1, K) are the lengths of links and the half diagonals of benches in units of b. The bounds apply, in
    the frame of bench 0, to the corners of all benches from bench 2 on, and, in the frames of these benches, to the
    corners of bench 0; for selected pairs, they have the shape (P, 2). Bounds are infinite close to a lock.
    """
    with np.errstate(all='ignore'):
        return corners(_motion(theta, _slopes(theta, delta, chord)), arm, pairs=pairs)


def corners(moving: SpiralMotion, arm: Floats, growth: float = 0.0, pairs: _Pairs | None = None) -> Floats:
    """Return bounds as ``bend`` does; per unit of the variable, arms grow by ``growth`` times their length.

    If a bench turns at the rate W relative to the other bench, the second derivative of its arm is the arm times i (W'
    + 2 growth W) - W^2.
    """
    pairs, arm = pairs or _all_pairs(moving.w.mid.shape[1]), np.broadcast_to(arm, moving.w.mid.shape)
    with np.errstate(all='ignore'):
        (lead, lead_rate), (other, other_rate) = ((moving.w[at], moving.w_rate[at]) for at in (pairs.lead, pairs.other))
        dw, dw_rate = other - lead, other_rate - lead_rate
        if growth:
            dw_rate = dw_rate + 2 * growth * dw
        spin = np.hypot(dw_rate.most, dw.most**2)
        in_lead, in_other = _middles(moving, pairs, lead, lead_rate), _middles(moving, pairs, other, other_rate)
        out: Floats = ABOVE * np.stack((in_lead + arm[pairs.other] * spin, in_other + arm[pairs.lead] * spin), axis=-1)
    return np.where(np.isfinite(out), out, np.inf)


def _middles(moving: SpiralMotion, pairs: _Pairs, w: Ball, w_rate: Ball) -> Floats:
    """Return bounds on the accelerations of the middles of benches in the turning frames of leading benches."""
    one, two, three, four = (_acceleration(moving, at, w, w_rate) for at in pairs)
    return 0.5 * (one + two + three + four)


def _acceleration(moving: SpiralMotion, handle: At, w: Ball, w_rate: Ball) -> Floats:
    theta, p, a = moving.theta[handle], moving.p[handle], moving.a[handle]
    v = moving.turned[handle] - w
    outwards, across = a - theta * v.squared(), 2 * p * v + theta * (a - w_rate)
    return np.hypot(outwards.most, across.most)


def _motion(theta: Ball, slopes: _Slopes) -> SpiralMotion:
    p, a = _handles(slopes)
    turned = slopes.psi_1 + 1
    return SpiralMotion(theta, p, a, p, p[:, :-1] * turned, a[:, :-1] * turned + p[:, :-1].squared() * slopes.psi_2)


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
    """Return the slopes, corrected for links of zero length, which lie along the track."""
    none = Ball(np.zeros_like(theta.mid), np.zeros_like(theta.mid))
    flat = (1 + theta.squared()).inverse()
    along = none, none, flat, -2 * theta * flat.squared()
    kept = slopes.delta_1, slopes.delta_2, slopes.psi_1, slopes.psi_2
    return _Slopes(*(Ball(np.where(joined, a.mid, b.mid), np.where(joined, a.rad, b.rad))
                     for a, b in zip(along, kept, strict=True)))


def _handles(slopes: _Slopes) -> tuple[Ball, Ball]:
    """Return p and a of all handles; behind the third handle, a follows from a / p, which is a sum along the chain.

    The second and third handles may turn back, and this quotient is unbounded there.
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


def bounds(a: BenchSamples, b: BenchSamples, sizes: Sizes, behind: Ints) -> tuple[Floats, Floats]:
    """Return lower bounds (M,) on the gaps in the intervals from samples a to b, and a factor for each interval.

    The amounts by which the errors of corners exceed those of handles are subtracted. An interval is cleared if its
    bound exceeds the position errors of two handles. Otherwise it should be cut into parts whose length is at most its
    own length times the factor, which is at most 1. Only the next ``behind`` (M,) benches count. A pair is not examined
    further if the bound from the benches' motion, or the bound from the circle, is not far below its gap.
    """
    sizes = sizes.of(a.lead)
    circle, one, two = beyond(a, b, sizes), a.apart, b.apart
    off = sizes.rounding_m(np.maximum(a.theta[:, -1], b.theta[:, -1]))
    low = np.maximum(np.maximum(one, two) - _way(a, b, sizes), _straight(a, b, sizes)) - off[:, None]
    excess = np.broadcast_to(sizes.excess_m[:, :1] + sizes.excess_m[:, 2:], low.shape)
    low = np.maximum(low, circle) - excess
    there = np.arange(2, circle.shape[1] + 2) <= behind[:, None]
    row, other = np.nonzero(there & (low < np.maximum(_SETTLED * np.minimum(one, two), _SURE * sizes.error_m)))
    room = np.ones(behind.size)
    if row.size:
        bent, enough = _bent(a, b, sizes, row, other)
        low[row, other] = np.maximum(low[row, other], bent - off[row] - excess[row, other])
        np.minimum.at(room, row, enough)
    out: Floats = np.min(low, axis=1, where=there, initial=np.inf)
    unseen = (behind > circle.shape[1] + 1) & (further(a, b, sizes, circle)[:, -1] <= 0)
    return np.where(unseen | _turns_back(a, b), -np.inf, out), room


def _bent(a: BenchSamples, b: BenchSamples, sizes: Sizes, row: Ints, other: Ints) -> tuple[Floats, Floats]:
    """Return second-order bounds (P,) on the gaps of pairs, and factors; ``other`` is 0 for the second bench behind."""
    lengths = np.broadcast_to(sizes.half_length_m, (a.lead.size, sizes.half_length_m.shape[1]))
    half_length_m = lengths[row, 0], lengths[row, other + 2]
    half_m = [(each, sizes.half_width_m) for each in half_length_m]
    seen = [seen_from((each.centre[row, 0], each.centre[row, other + 2]),
                      (each.axis[row, 0], each.axis[row, other + 2]), *half_m) for each in (a, b)]
    sag = _sag(a, b, sizes, row, other + 2)
    low_m, ratio = parted_between(seen, (sag[:, 0], sag[:, 1]))
    return low_m, np.sqrt(ratio)


def _sag(a: BenchSamples, b: BenchSamples, sizes: Sizes, row: Ints, bench: Ints) -> Floats:
    """Return by how many metres corners (P, 2) deviate from straight lines in the frames of leading and other benches.

    Chains are computed up to the last of these benches, and only in the rows that contain at least one of them.
    """
    used, row = np.unique(row, return_inverse=True)
    count = int(np.max(bench)) + 1
    one, two = (each.theta[used, :count + 1] for each in (a, b))
    off = sizes.angle_errors(np.minimum(one, two))
    links, half_length = (each[used if each.shape[0] > 1 else slice(None), :count]
                          for each in (sizes.links_m, sizes.half_length_m))
    theta = between(one, two, off)
    of_both: Floats = 2 * off[:, :-1]
    delta = between(a.delta[used, :count], b.delta[used, :count], of_both)
    chord, arm = links / sizes.b_m, np.hypot(half_length, sizes.half_width_m) / sizes.b_m
    most = bend(theta, delta, between(chord, chord), arm, _some_pairs(row, bench))
    length = (a.places - b.places)[used][row, None]
    with np.errstate(invalid='ignore', over='ignore'):
        out: Floats = most * (sizes.b_m * length * length / 8)
    return np.where(np.isnan(out), np.inf, out)     # infinity times zero length means that there is no bound


def _way(a: BenchSamples, b: BenchSamples, sizes: Sizes) -> Floats:
    """Return upper bounds (m, shape (M, K-2)) on the summed motion of the corners of both benches of each pair.

    The result is the smaller of two bounds. The motion of a corner is at most the motion of a handle times the bench's
    lever. The first bound uses the motion of handles along their track. The second bound uses a frame that turns about
    the centre with the leading handle: there, a handle moves inwards by b times the change of its angle, and around the
    centre by the sum of the changes of all spans before it. Each of these changes is monotone.
    """
    outer = np.maximum(a.theta, b.theta)
    inwards = sizes.b_m * np.abs(a.theta - b.theta)
    along = ABOVE * (inwards * np.sqrt(1 + outer * outer) + 4 * sizes.error_m)
    off = sizes.angle_errors(np.minimum(a.theta, b.theta)[:, :-1])
    around = np.cumsum(np.abs(a.delta - b.delta) + 4 * off, axis=1)
    around = (1 + 2.0**-52 * around.shape[1]) * np.concatenate((np.zeros_like(around[:, :1]), around), axis=1)
    turned = ABOVE * (inwards + sizes.b_m * outer * around + 4 * sizes.error_m)
    lever = levers(sizes)
    ways = [lever * np.maximum(handle[:, :-1], handle[:, 1:]) for handle in (along, turned)]
    out: Floats = np.minimum(*(way[:, :1] + way[:, 2:] for way in ways))
    return out


def levers(sizes: Sizes) -> Floats:
    """Return upper bounds (M, K) on the ratio of a bench's largest corner motion to the larger motion of its handles.

    A bench that rotates about the middle of its link, so that its handles move in opposite directions, comes close to
    this bound.
    """
    overhang = sizes.half_length_m - 0.5 * sizes.links_m + sizes.half_width_m
    out: Floats = 1 + 2 * overhang / np.maximum(sizes.links_m, 1e-12)
    return out


def _straight(a: BenchSamples, b: BenchSamples, sizes: Sizes) -> Floats:
    """Return how far benches (M, K-2) stay behind the leading bench along its axis, if the chain is almost straight.

    The track turns by less than 2 radians per radian of the polar angle, so the directions of any two links between a
    bench's front handle and another bench's rear handle differ by at most twice the span between these handles. This
    value is called the turn. The links in between lead away from the leading bench by at least their lengths times the
    cosine of the turn. The result is minus infinity if the turn exceeds a radian.
    """
    off = sizes.angle_errors(np.minimum(a.theta, b.theta)[:, :-1])
    turn = 2 * np.cumsum(ABOVE * np.maximum(a.delta, b.delta) + 4 * off, axis=1)[:, 2:]
    overhang = sizes.half_length_m - 0.5 * sizes.links_m
    between_m = np.cumsum(sizes.links_m[:, 1:-1], axis=1)
    away = between_m * np.cos(np.minimum(turn, 1.0)) - sizes.half_width_m * turn
    out: Floats = away - ABOVE * (overhang[:, :1] + overhang[:, 2:]) - 4 * sizes.error_m
    return np.where(turn <= 1.0, out, -np.inf)


def _turns_back(a: BenchSamples, b: BenchSamples) -> Array:
    """Return whether the second or third handle moves inwards at one end of an interval and outwards at the other."""
    one, two = (comes_in(each.theta[:, :3], each.delta[:, :2]) for each in (a, b))
    out: Array = np.any((np.minimum(one, two) < -_STILL) & (np.maximum(one, two) > _STILL), axis=1)
    return out


def comes_in(theta: Floats, delta: Floats) -> Floats:
    """Return numbers that are positive if a link's rear handle follows its front handle inwards."""
    inner, outer = theta[..., :-1], theta[..., 1:]
    out: Floats = delta * np.cos(delta) + inner * (outer * np.sin(delta) - 2 * np.sin(0.5 * delta) ** 2)
    return out
