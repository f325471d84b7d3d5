"""How far corners of benches, seen from other benches, can leave straight lines while the leader goes on, on any track.

It holds where no link can lock. A prime is a derivative by the leader's way, a dot one by a handle's own. Of each link
let A be the handle nearer to the leader and B the other one, e its unit vector in the direction of the track, and alpha
and beta the angles from e to the track at A and B. The length l does not change, so with speeds v and curvatures k

    v_B = r v_A,  r = cos alpha / cos beta,      omega = w v_A,  w = (sin alpha - r sin beta) / l,
    alpha. = k_A - w,      beta. = r k_B - w,      r. = r (tan beta beta. - tan alpha alpha.),
    w. = (cos alpha alpha. - r. sin beta - r cos beta beta.) / l,
    v_B' = r v_A' + r. v_A^2,      omega' = w v_A' + w. v_A^2

(behind a tail that leads e points away from A, and w and w. have the other sign). Of two benches let x be the middle of
the second as the first sees it, from its middle and along its axis, and tau the angles of handles' tracks seen from it:

    x' = V_2 - V_1 - omega J x,      x'' = A_2 - A_1 - 2 omega J x' - omega' J x + omega^2 x,

V and A the means of v (cos tau, sin tau) and of v' (cos tau, sin tau) + k v^2 (-sin tau, cos tau) over both handles, J
a quarter turn. Where all turns together nothing is left of x', and all terms of x'' cancel but for rounding. From the
other bench, which turns by D more, it is no more than |x''| + 2 |D| |x'| + (|D'| + D^2) |x|; a corner at a distance
from the middle adds that times |(D', D^2)|. All is evaluated in ball arithmetic, for everything that the angles and
places can be between two states: what they are at both, and half of what a bound on their rates leaves beyond that.
Curvatures jump at joints, so first derivatives have kinks there; what follows needs no more than that they are bounded.

All is rounded outwards: balls by themselves, what puts them together by the factor ABOVE (``on_spiral``).
What is known at states is known as well as positions p are, to within an error e: the axis of a link of length l turns
by no more than 2 e / l, one of a link of no length with the track, and the track by k e; curvatures of lines and arcs
do not change, and those of spirals by no more than k^2 e.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.enclosures.ball_arithmetic import Ball, between, side_by_side
from dragon_ros.core.enclosures.on_spiral import ABOVE
from dragon_ros.core.numerics.types import Array, Floats, Ints

_ROUNDED_RAD = 2.0**-46 # of an angle between unit vectors
_PASSES = 8     # at most; each makes what is left beyond the ends smaller by about the way over twice the link's length
_WORTH = 0.9    # of a radius: where a pass leaves more of nearly all of them, it is the last one
_FEW = 0.02     # of the radii may still shrink by more


@dataclass(frozen=True)
class Handles:
    """States of M chains: distances along the track, curvatures in 1/m, and segments' numbers (M, N+1); headings."""

    along_m: Floats
    curvature: Floats
    segment: Ints
    headings: Floats


@dataclass(frozen=True)
class Kinematics:
    """What handles (M, N+1) and links (M, N) can do over intervals, by the leader's way: speeds, turning, their rates.

    ``k`` are curvatures; ``axis_error`` (N,) and ``track_error`` what directions of links and of the track may err by,
    and ``error_m`` what positions may.
    """

    v: Ball
    a: Ball
    k: Ball
    w: Ball
    w_rate: Ball
    axis_error: Floats
    track_error: float
    error_m: float


def kinematics(one: Handles, two: Handles, axis: tuple[Floats, Floats], links_m: Floats, bends: tuple[Floats, Floats],
               leader: int, error_m: float) -> Kinematics:
    """Return what handles and links can do between states of M chains; ``axis`` (M, N, 2) are of links at either.

    ``bends`` are the least and greatest curvatures from one segment to another, (P, P); ``leader`` is 0 or -1;
    ``error_m`` is what positions may err by. A chord and the track at its ends differ by asin(k l / 2) at most, k the
    largest curvature in between (Schur).
    """
    with np.errstate(all='ignore'):
        k, even = _curvatures(one, two, bends, error_m)
        track_error = float(np.max(np.abs(bends))) * error_m + _ROUNDED_RAD
        axis_error = np.where(links_m > 0, 2 * error_m / links_m + _ROUNDED_RAD, track_error)
        errors, off = (axis_error, track_error, error_m), axis_error + track_error
        at_one, at_two = ((_angle(u, each.headings[:, :-1]), _angle(u, each.headings[:, 1:]))
                          for u, each in zip(axis, (one, two), strict=True))
        way = np.abs(two.along_m - one.along_m) + 2 * error_m
        rigid = even[:, :-1] & even[:, 1:] & (one.segment[:, :-1] == one.segment[:, 1:])
        largest = _largest(one, two, bends)
        widest = ABOVE * np.arcsin(np.minimum(ABOVE * 0.5 * (largest + largest * largest * error_m) * links_m, 1.0))
        front, rear = (between(a, b, off) for a, b in zip(at_one, at_two, strict=True))
        if leader == 0:
            link = _link((k[:, :-1], k[:, 1:]), (front, rear), (way[:, :-1], way[:, 1:]), links_m, rigid, widest, off,
                         1.0)
            v, a = _carried(link)
            w, w_rate = _turning(link, v[:, :-1], a[:, :-1])
            return Kinematics(v, a, k, w, w_rate, *errors)
        back = (slice(None), slice(None, None, -1))
        near, far = (slice(None), slice(None, 0, -1)), (slice(None), slice(-2, None, -1))
        link = _link((k[near], k[far]), (rear[back], front[back]), (way[near], way[far]), links_m[::-1], rigid[back],
                     widest[back], off[::-1], -1.0)
        v, a = _carried(link)
        w, w_rate = _turning(link, v[:, :-1], a[:, :-1])
        return Kinematics(v[back], a[back], k, w[back], w_rate[back], *errors)


@dataclass(frozen=True)
class _Link:
    """Of links: r, w and their derivatives."""

    r: Ball
    w: Ball
    r_dot: Ball
    w_dot: Ball


def _curvatures(one: Handles, two: Handles, bends: tuple[Floats, Floats], error_m: float) -> tuple[Ball, Array]:
    """Return what curvatures can be at handles, and where they are one number all the way."""
    same = one.segment == two.segment
    low = np.where(same, np.minimum(one.curvature, two.curvature), bends[0][one.segment, two.segment])
    high = np.where(same, np.maximum(one.curvature, two.curvature), bends[1][one.segment, two.segment])
    return between(low, high, error_m * np.maximum(low * low, high * high)), low == high


def _largest(one: Handles, two: Handles, bends: tuple[Floats, Floats]) -> Floats:
    """Return the largest curvatures that links (M, N) can have between their handles."""
    segment = np.stack((one.segment[:, :-1], one.segment[:, 1:], two.segment[:, :-1], two.segment[:, 1:]))
    first, last = np.min(segment, axis=0), np.max(segment, axis=0)
    across = np.maximum(np.abs(bends[0]), np.abs(bends[1]))[first, last]
    most = np.maximum(np.abs(one.curvature), np.abs(two.curvature))
    return np.where(first == last, np.maximum(most[:, :-1], most[:, 1:]), across)


def _angle(axis: Floats, headings: Floats) -> Floats:
    """Return angles from axes (..., 2) to headings."""
    cross = axis[..., 0] * headings[..., 1] - axis[..., 1] * headings[..., 0]
    out: Floats = np.arctan2(cross, axis[..., 0] * headings[..., 0] + axis[..., 1] * headings[..., 1])
    return out


def _link(k: tuple[Ball, Ball], ends: tuple[Ball, Ball], way: tuple[Floats, Floats], links_m: Floats, rigid: Array,
          widest: Floats, off: Floats, sign: float) -> _Link:
    """Return links' ratios over intervals; each pair is for the handles nearer to and farther from the leader.

    Angles begin with what they can be at all, ``widest``; each pass bounds their rates, and with these the angles. What
    is known of them at the states may be ``off``.
    """
    inverse_l, joined = sign / np.where(links_m > 0, links_m, 1.0), links_m == 0
    none = np.zeros_like(way[0])
    sin_n = sin_f = Ball(none, none + np.sin(widest))
    cos_n = cos_f = between(none + np.cos(widest), none + 1.0)
    near, far = (Ball(each.mid, ABOVE * (widest + each.most)) for each in ends)
    for _ in range(_PASSES):
        w = (sin_n - cos_n * cos_f.inverse() * sin_f) * inverse_l
        rates = k[0] - w, k[1] - (sin_n * cos_f * cos_n.inverse() - sin_f) * inverse_l
        reach = [ABOVE * (0.5 * rate.most * gone + off) for rate, gone in zip(rates, way, strict=True)]
        before = near, far
        near, far = (Ball(ball.mid, np.where(rigid, end.rad, np.fmin(ball.rad, np.maximum(end.rad, most))))
                     for ball, end, most in zip((near, far), ends, reach, strict=True))
        (sin_n, cos_n), (sin_f, cos_f) = near.sin_cos(), far.sin_cos()
        if _settled(before, (near, far)):
            break
    r = cos_n * cos_f.inverse()
    w = (sin_n - r * sin_f) * inverse_l
    near_dot, far_dot = k[0] - w, r * k[1] - w
    r_dot = r * (sin_f * cos_f.inverse() * far_dot - sin_n * cos_n.inverse() * near_dot)
    w_dot = (cos_n * near_dot - r_dot * sin_f - r * cos_f * far_dot) * inverse_l
    r, r_dot = _where(joined, Ball(none, none) + 1.0, r), _where(rigid | joined, Ball(none, none), r_dot)
    unknown = Ball(none, np.where(k[0].rad > 0, np.inf, 0.0))
    w, w_dot = _where(joined, k[0], w), _where(joined, unknown, _where(rigid, Ball(none, none), w_dot))
    return _Link(r, w, r_dot, w_dot)


def _settled(before: tuple[Ball, Ball], now: tuple[Ball, Ball]) -> bool:
    """Return whether a pass has left most of nearly all radii."""
    return not any(np.mean(b.rad < _WORTH * a.rad) > _FEW for a, b in zip(before, now, strict=True))


def _where(chosen: Array, one: Ball, other: Ball) -> Ball:
    """Return one ball or another, number by number."""
    return Ball(np.where(chosen, one.mid, other.mid), np.where(chosen, one.rad, other.rad))


def _carried(link: _Link) -> tuple[Ball, Ball]:
    """Return v and v' of handles from the leader on."""
    none = Ball(np.zeros_like(link.r.mid[:, :1]), np.zeros_like(link.r.mid[:, :1]))
    v = side_by_side([none + 1.0, link.r.running_product()])
    # v' / v is a sum along the chain.
    share = (v[:, :-1] * link.r_dot * link.r.inverse()).running_sum()
    return v, side_by_side([none, v[:, 1:] * share])


def _turning(link: _Link, v: Ball, a: Ball) -> tuple[Ball, Ball]:
    return link.w * v, link.w * a + link.w_dot * v.squared()


@dataclass(frozen=True)
class Views:
    """Pairs of benches (K,) at one state: the second's middle and axis as the first sees them, and its handles' tracks.

    ``track`` are the cosines and sines (K, 4, 2) of both handles' headings of the first bench and then of the second.
    """

    middle: tuple[Floats, Floats]
    track: Floats


def views(p: Floats, axis: Floats, headings: Floats, row: Ints, i: Ints, j: Ints) -> Views:
    """Return pairs of benches i, j of the chains in rows, with handles (M, N+1, 2) at ``p``, and links' axes."""
    u = axis[row, i]
    middle = 0.5 * (p[row, j] + p[row, j + 1] - p[row, i] - p[row, i + 1])
    x, y = _turned(u, middle)
    track = np.stack([np.stack(_turned(u, headings[row, handle]), axis=-1) for handle in (i, i + 1, j, j + 1)], axis=1)
    return Views((x, y), track)


def _turned(u: Floats, vectors: Floats) -> tuple[Floats, Floats]:
    """Return vectors along and across axes."""
    return (u[:, 0] * vectors[:, 0] + u[:, 1] * vectors[:, 1], u[:, 0] * vectors[:, 1] - u[:, 1] * vectors[:, 0])


def second_derivatives(moving: Kinematics, one: Views, two: Views, row: Ints, i: Ints, j: Ints, gone_m: Floats,
                       arm: Floats) -> tuple[Floats, Floats]:
    """Return bounds (K,) of corners' second derivatives: of the second bench's seen from the first, and the reverse.

    ``gone_m`` (K,) are the leader's ways, ``arm`` (N,) corners' distances from middles. Infinite where nothing is
    known.
    """
    with np.errstate(all='ignore'):
        turn, turn_rate = _at(moving.w, row, i), _at(moving.w_rate, row, i)
        axis_error = moving.axis_error[i]
        handles = [_handle(moving, row, handle, (one.track[:, n], two.track[:, n]), turn, gone_m,
                           axis_error + moving.track_error)
                   for n, handle in enumerate((i, i + 1, j, j + 1))]
        (v_x, v_y), (a_x, a_y) = ([0.5 * (c + d - a - b) for a, b, c, d in zip(*parts, strict=True)]
                                  for parts in zip(*handles, strict=True))
        off_m = 3 * moving.error_m + axis_error * np.maximum(np.hypot(*one.middle), np.hypot(*two.middle))
        x, y, u_x, u_y = _middle(one, two, (v_x, v_y), turn, gone_m, off_m)
        square = turn.squared()
        first = ABOVE * np.hypot((a_x + 2 * turn * u_y + turn_rate * y + square * x).most,
                         (a_y - 2 * turn * u_x - turn_rate * x + square * y).most)
        more, more_rate = (_at(moving.w, row, j) - turn).most, (_at(moving.w_rate, row, j) - turn_rate).most
        spin = ABOVE * np.hypot(more_rate, more * more)
        second = first + 2 * more * np.hypot(u_x.most, u_y.most) + (more_rate + more * more) * np.hypot(x.most, y.most)
        out = ABOVE * (first + arm[j] * spin), ABOVE * (second + arm[i] * spin)
    low, high = (np.where(np.isfinite(each), each, np.inf) for each in out)
    return low, high


def _at(ball: Ball, row: Ints, column: Ints) -> Ball:
    """Return numbers of a ball, one for each row and column."""
    return Ball(ball.mid[row, column], ball.rad[row, column])


def _handle(moving: Kinematics, row: Ints, handle: Ints, track: tuple[Floats, Floats], turn: Ball, gone_m: Floats,
            off: Floats) -> tuple[tuple[Ball, Ball], tuple[Ball, Ball]]:
    """Return a handle's velocity and its change along and across the first bench, from where that does not turn."""
    v, a, k = (_at(ball, row, handle) for ball in (moving.v, moving.a, moving.k))
    start, stop = (np.arctan2(each[:, 1], each[:, 0]) for each in track)
    stop = start + np.remainder(stop - start + np.pi, 2 * np.pi) - np.pi
    reach = ABOVE * (0.5 * (k * v - turn).most * gone_m + off)
    ends = between(start, stop, off)
    # With less than half a turn on the way the angle went the short way from one end to the other.
    sin, cos = Ball(ends.mid, np.where(reach < 0.5 * np.pi, np.maximum(ends.rad, reach), np.inf)).sin_cos()
    bent = k * v.squared()
    return (v * cos, v * sin), (a * cos - bent * sin, a * sin + bent * cos)


def _middle(one: Views, two: Views, v: tuple[Ball, Ball], turn: Ball, gone_m: Floats,
            off: Floats) -> tuple[Ball, Ball, Ball, Ball]:
    """Return what the second bench's middle, seen from the first, and its velocity can be.

    Middles go no further from each other than their velocities say, however the first bench turns. What is known of
    them at the states may be ``off`` (K,) in metres.
    """
    far = np.minimum(np.hypot(*one.middle), np.hypot(*two.middle)) + off
    far = ABOVE * (far + gone_m * np.hypot(v[0].most, v[1].most))
    ends = [between(a, b, off) for a, b in zip(one.middle, two.middle, strict=True)]
    x, y = (Ball(end.mid, ABOVE * (far + end.most)) for end in ends)
    for _ in range(_PASSES):
        u, before = (v[0] + turn * y, v[1] - turn * x), (x, y)
        x, y = (Ball(end.mid, np.fmin(ball.rad, np.maximum(end.rad, ABOVE * (0.5 * rate.most * gone_m + off))))
                for end, ball, rate in zip(ends, (x, y), u, strict=True))
        if _settled(before, (x, y)):
            break
    return x, y, v[0] + turn * y, v[1] - turn * x
