"""Bounds on the motion of handles, links and benches between two states of a chain on any track.

One enclosure is used for the first contact (corners as seen from other benches), the fastest handle (ratios of speeds
and their changes) and the bounding box (the motion of one bench). Between the states, the leader moves from one
position to another and every handle moves in one direction. The exception is a follower that turns back, near the
centre of a single spiral; ``Leader.turning_m`` returns the positions at which intervals must be cut for this reason.

A prime denotes a derivative with respect to the leader's distance, and a dot denotes a derivative with respect to a
handle's own distance. For each link, let A be the handle nearer to the leader and B the other handle, let e be the
link's unit vector in the direction of the track, and let alpha and beta be the angles from e to the track at A and B.
The length l is constant, so speeds v and curvatures k satisfy

    v_B = r v_A,  r = cos alpha / cos beta,      omega = w v_A,  w = (sin alpha - r sin beta) / l,
    alpha. = k_A - w,      beta. = r k_B - w,      r. = r g,  g = tan beta beta. - tan alpha alpha.,
    w. = (cos alpha alpha. - r. sin beta - r cos beta beta.) / l,
    v_B' = r v_A' + r. v_A^2, that is (log |v_B|)' = (log |v_A|)' + v_A g,      omega' = w v_A' + w. v_A^2

(behind a leading tail, e points away from A, so w, w. and the prime have the opposite sign).

The ranges of angles between two states follow from their variation: a quantity with a total variation of at most L lies
within L / 2 of the mean of its values at the two states, or between these values if they are further apart. The turning
of a link, and of the track under its handles, bounds the change of angles (``swing_rad``). If k l < 2 for the largest
curvature k in between, the directions of a chord and of the track at its ends always differ by at most asin(k l / 2)
(Schur). In this case each pass bounds the rates of the angles and, from these rates, the angles. If both handles stay
on one line or arc, the angles are constant.

For two benches, let x be the middle of the second bench in the frame of the first bench, whose origin is the first
bench's middle and whose x axis is the first bench's axis. Let tau be the angles of the track at the handles in this
frame. Then

    x' = V_2 - V_1 - omega J x,      x'' = A_2 - A_1 - 2 omega J x' - omega' J x + omega^2 x,

where V and A are the means, over both handles of a bench, of v (cos tau, sin tau) and of v' (cos tau, sin tau) + k v^2
(-sin tau, cos tau), and J is a quarter turn. If everything turns together, x' vanishes and all terms of x'' cancel up
to rounding. In the frame of the other bench, which turns faster by D, the bound is |x''| + 2 |D| |x'| + (|D'| + D^2)
|x|; a corner at a distance from the middle adds this distance times |(D', D^2)|. Curvatures jump at joints, so first
derivatives have kinks there; the argument only requires bounded second derivatives.

All bounds are evaluated in ball arithmetic and rounded outwards: balls by their arithmetic, combinations of balls by
the factor ABOVE. States are known only to within the position error e. The direction of a link of
length l is therefore uncertain by at most 2 e / l, and the direction of the track by at most k e. The curvatures of
lines and arcs are exact, and the curvatures of spirals are uncertain by at most k^2 e.
"""
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property, reduce
from typing import Protocol

import numpy as np

from dragon_ros.core.enclosures.ball_arithmetic import ABOVE, Ball, between, side_by_side
from dragon_ros.core.numerics.types import Array, Floats, Index, Ints

_ROUNDED_RAD = 2.0**-46     # rounding error of an angle between unit vectors
_PASSES = 8     # maximum number of passes; each pass multiplies the excess at the ends by about motion / (2 link)
_WORTH = 0.9    # passes end when almost all radii stay above this fraction of their previous values
_FEW = 0.02     # fraction of the radii that may still fall below ``_WORTH``

Range = tuple[Floats, Floats]


@dataclass(frozen=True)
class LinkStates:
    """The links of M chains at one state each, from the leader on: N + 1 handles, and angles from links to the track.

    ``along_m`` holds the distances of handles along the track, and ``segment`` and ``curvature`` (1/m, signed) the
    values of the track there. ``near`` and ``far`` hold the angles at a link's handle nearer to the leader and at its
    other handle.
    """

    along_m: Floats
    segment: Ints
    curvature: Floats
    near: Floats
    far: Floats

    def rows(self, index: Index) -> 'LinkStates':
        """Return a subset of the states."""
        return LinkStates(*(getattr(self, each.name)[index] for each in fields(self)))

    def links(self, row: Ints, link: Ints) -> 'LinkStates':
        """Return a subset of the links, each as a chain of one link."""
        handles = row[:, None], np.stack((link, link + 1), axis=1)
        return LinkStates(self.along_m[handles], self.segment[handles], self.curvature[handles],
                          self.near[row, link, None], self.far[row, link, None])


def link_states(along_m: Floats, segment: Ints, curvature: Floats, headings: Floats, axis: Floats,
                leader: int) -> LinkStates:
    """Return the link states of chains from head to tail with link axes ``axis`` (M, N, 2); ``leader`` is 0 or -1."""
    ends = _angle(axis, headings[:, :-1]), _angle(axis, headings[:, 1:])
    if leader == 0:
        return LinkStates(along_m, segment, curvature, *ends)
    rear, front = (end[:, ::-1] for end in ends[::-1])
    return LinkStates(along_m[:, ::-1], segment[:, ::-1], curvature[:, ::-1], rear, front)


def _angle(axis: Floats, headings: Floats) -> Floats:
    """Return angles from axes (..., 2) to headings."""
    cross = axis[..., 0] * headings[..., 1] - axis[..., 1] * headings[..., 0]
    out: Floats = np.arctan2(cross, axis[..., 0] * headings[..., 0] + axis[..., 1] * headings[..., 1])
    return out


def curvature_range(bends: Range, segments: Sequence[Ints], curvatures: Sequence[Floats]) -> Range:
    """Return the smallest and largest curvatures (1/m) of the track between positions on given segments.

    ``bends`` holds the smallest and largest curvatures (P, P) over any two segments and all segments between them.
    Curvature is monotone on a segment, so if all positions are on one segment, the curvature lies between the given
    values; otherwise the whole range of each of these segments counts.
    """
    first, last = reduce(np.minimum, segments), reduce(np.maximum, segments)
    one = first == last
    return (np.where(one, reduce(np.minimum, curvatures), bends[0][first, last]),
            np.where(one, reduce(np.maximum, curvatures), bends[1][first, last]))


def swing_rad(most: Floats, link_m: float | Floats, moved_m: Floats) -> Floats:
    """Return the largest total angle by which a link turns while its two handles move by ``moved_m`` in total.

    ``most`` is the largest curvature (1/m) between the rear handle's first position and the front handle's last
    position. A link turns at the rate (v_rear sin beta - v_front sin alpha) / link. No sine exceeds 1 or, if ``most``
    times the link is below 2, half of this product (Schur's comparison with a circle).
    """
    out: Floats = np.minimum(0.5 * most, np.divide(1.0, link_m)) * moved_m
    return out


@dataclass(frozen=True)
class LinkMotion:
    """Enclosures of links (M, N) and their handles (M, N+1), from the leader on, over M intervals.

    ``k`` holds curvatures, ``near`` and ``far`` the sines and cosines of the angles, and ``inverse_l`` the inverse
    lengths with the sign of e. ``rigid`` links have constant angles. Rates are derivatives with respect to the distance
    of the nearer handle.
    """

    k: Ball
    near: tuple[Ball, Ball]
    far: tuple[Ball, Ball]
    inverse_l: Floats
    rigid: Array

    @cached_property
    def r(self) -> Ball:
        """The ratio of the farther handle's speed to the nearer handle's speed."""
        return self.near[1] * self.far[1].inverse()

    @cached_property
    def w(self) -> Ball:
        """The rate at which a link turns."""
        return (self.near[0] - self.r * self.far[0]) * self.inverse_l

    @cached_property
    def _dots(self) -> tuple[Ball, Ball]:
        """The rates of both angles."""
        return self.k[:, :-1] - self.w, self.r * self.k[:, 1:] - self.w

    @cached_property
    def g(self) -> Ball:
        """The rate of log |r|."""
        (sin_n, cos_n), (sin_f, cos_f), (near, far) = self.near, self.far, self._dots
        rate = sin_f * cos_f.inverse() * far - sin_n * cos_n.inverse() * near
        return self._unless_rigid(rate)

    @cached_property
    def w_dot(self) -> Ball:
        """The rate of ``w``."""
        (sin_f, cos_f), (near, far) = self.far, self._dots
        return self._unless_rigid((self.near[1] * near - self.r * (self.g * sin_f + cos_f * far)) * self.inverse_l)

    def _unless_rigid(self, rate: Ball) -> Ball:
        return Ball(np.where(self.rigid, 0.0, rate.mid), np.where(self.rigid, 0.0, rate.rad))


def speeds_along(r: Ball, g: Ball) -> tuple[Ball, Ball]:
    """Return handle speeds (M, N+1) relative to the leader, and the rates of their logs per metre of leader travel.

    ``r`` and ``g`` (M, N) have the same meaning as in ``LinkMotion``.
    """
    leader = Ball(np.zeros((len(r.mid), 1)), np.zeros((len(r.mid), 1)))
    v = side_by_side([leader + 1.0, r.running_product()])
    return v, side_by_side([leader, (v[:, :-1] * g).running_sum()])


def enclosed(one: LinkStates, two: LinkStates, links_m: Floats, bends: Range, sign: float = 1.0,
             error_m: float = 0.0, passes: int = _PASSES) -> LinkMotion:
    """Return the enclosures of links (N,), from the leader on, between states of M chains.

    ``bends`` holds the smallest and largest curvatures (P, P) over any two segments and all segments between them,
    ``sign`` is 1.0 behind a leading head and -1.0 ahead of a leading tail, and ``error_m`` bounds position errors. At
    most ``passes`` passes narrow the ranges of angles; if there are none, these ranges reflect only the turning of
    links and of the track.
    """
    with np.errstate(all='ignore'):
        low, high = curvature_range(bends, (one.segment, two.segment), (one.curvature, two.curvature))
        k, even = between(low, high, error_m * np.maximum(low * low, high * high)), low == high
        rigid = even[:, :-1] & even[:, 1:] & (one.segment[:, :-1] == one.segment[:, 1:])
        axis_error, track_error = direction_errors(links_m, bends, error_m)
        off = axis_error + track_error
        moved_m = np.abs(two.along_m - one.along_m) + 2 * error_m
        ends = [between(a, b, off) for a, b in ((one.near, two.near), (one.far, two.far))]
        most = largest_curvatures(one, two, bends)
        angles = _first_angles(ends, k, most + most * most * error_m, moved_m, links_m, off)
        inverse_l = sign / links_m
        near, far = _narrowed(angles, ends, k, moved_m, rigid, inverse_l, off, passes)
        return LinkMotion(k, near.sin_cos(), far.sin_cos(), inverse_l, rigid)


def speeds_enclosed(one: LinkStates, two: LinkStates, links_m: Floats, bends: Range, sign: float) -> tuple[Ball, Ball]:
    """Return ``LinkMotion.r`` (M, N) and the rates of the logs of speeds (M, N+1), between states as in ``enclosed``.

    Only links that span several segments or lie on a spiral are enclosed, because both ends of any other link have
    exactly the same speed. On a track of lines and arcs, about two links per joint remain.
    """
    same = one.segment[:, :-1]
    even = bends[0].diagonal() == bends[1].diagonal()
    steady = even[same] & (same == one.segment[:, 1:]) & (same == two.segment[:, :-1]) & (same == two.segment[:, 1:])
    row, link = np.nonzero(~steady)
    moving = enclosed(one.links(row, link), two.links(row, link), links_m[link, None], bends, sign)
    r, g = Ball(np.ones(same.shape), np.zeros(same.shape)), Ball(np.zeros(same.shape), np.zeros(same.shape))
    with np.errstate(all='ignore'):
        for ball, found in ((r, moving.r), (g, moving.g)):
            ball.mid[row, link], ball.rad[row, link] = found.mid[:, 0], found.rad[:, 0]
        return r, speeds_along(r, g)[1]


def direction_errors(links_m: Floats, bends: Range, error_m: float) -> tuple[Floats, float]:
    """Return the direction errors (rad) of links (N,) and of the track, given the position error."""
    return 2 * error_m / links_m + _ROUNDED_RAD, float(np.max(np.abs(bends))) * error_m + _ROUNDED_RAD


class OnTrack(Protocol):
    """The segments and curvatures (1/m) of the track at the handles (M, N+1) of chains."""

    @property
    def segment(self) -> Ints:
        """The indices of segments."""
        ...

    @property
    def curvature(self) -> Floats:
        """The curvatures."""
        ...


def largest_curvatures(one: OnTrack, two: OnTrack, bends: Range) -> Floats:
    """Return upper bounds on the absolute curvatures between the handles of links (M, N), between two states."""
    places = [(state.segment[:, part], state.curvature[:, part]) for state in (one, two)
              for part in (slice(None, -1), slice(1, None))]
    low, high = curvature_range(bends, [segment for segment, _ in places], [curvature for _, curvature in places])
    out: Floats = np.maximum(np.abs(low), np.abs(high))
    return out


def _first_angles(ends: list[Ball], k: Ball, most: Floats, moved_m: Floats, links_m: Floats, off: Floats) -> list[Ball]:
    """Return enclosures of both angles from the largest turning of links and the track, and from Schur's bound."""
    half = ABOVE * 0.5 * most * links_m
    widest = np.where(half < 1, ABOVE * np.arcsin(np.minimum(half, 1.0)), np.inf)
    swing = swing_rad(most, links_m, moved_m[:, :-1] + moved_m[:, 1:])
    turned = k.most * moved_m
    return [Ball(end.mid, np.fmin(ABOVE * (widest + end.most), np.maximum(
        end.rad, ABOVE * (0.5 * (swing + own) + off))))
        for end, own in zip(ends, (turned[:, :-1], turned[:, 1:]), strict=True)]


def _narrowed(angles: list[Ball], ends: list[Ball], k: Ball, moved_m: Floats, rigid: Array, inverse_l: Floats,
              off: Floats, passes: int) -> list[Ball]:
    """Return enclosures of both angles; each pass narrows them using the rates of the angles."""
    each_m = moved_m[:, :-1], moved_m[:, 1:]
    for _ in range(passes):
        (sin_n, cos_n), (sin_f, cos_f) = (angle.sin_cos() for angle in angles)
        rates = (k[:, :-1] - (sin_n - cos_n * cos_f.inverse() * sin_f) * inverse_l,
                 k[:, 1:] - (sin_n * cos_f * cos_n.inverse() - sin_f) * inverse_l)
        reach = [ABOVE * (0.5 * rate.most * moved + off) for rate, moved in zip(rates, each_m, strict=True)]
        before = angles
        angles = [Ball(end.mid, np.where(rigid, end.rad, np.fmin(angle.rad, np.maximum(end.rad, most))))
                  for angle, end, most in zip(angles, ends, reach, strict=True)]
        if _settled(before, angles):
            break
    return angles


def _settled(before: Sequence[Ball], now: Sequence[Ball]) -> bool:
    """Return whether a pass has left almost all radii almost unchanged."""
    return not any(np.count_nonzero(b.rad < _WORTH * a.rad) > _FEW * b.rad.size
                   for a, b in zip(before, now, strict=True))


@dataclass(frozen=True)
class Kinematics:
    """Enclosures of handles (M, N+1) and links (M, N), from head to tail, over intervals of the leader's distance.

    ``v`` and ``a`` hold the speeds of handles and their rates, ``w`` and ``w_rate`` the turning of links and its rates,
    and ``k`` the curvatures at handles. ``axis_error`` (N,) and ``track_error`` bound the errors of the directions of
    links and of the track, and ``error_m`` bounds position errors.
    """

    v: Ball
    a: Ball
    k: Ball
    w: Ball
    w_rate: Ball
    axis_error: Floats
    track_error: float
    error_m: float


def kinematics(one: LinkStates, two: LinkStates, links_m: Floats, bends: Range, leader: int,
               error_m: float) -> Kinematics:
    """Return the enclosures of handles and links between states of M chains, in order from head to tail."""
    back = slice(None) if leader == 0 else slice(None, None, -1)
    moving = enclosed(one, two, links_m[back], bends, 1.0 if leader == 0 else -1.0, error_m)
    with np.errstate(all='ignore'):
        v, v_rate = speeds_along(moving.r, moving.g)
        a, near = v * v_rate, v[:, :-1]
        w, w_rate = moving.w * near, moving.w * a[:, :-1] + moving.w_dot * near.squared()
    v, a, k, w, w_rate = (ball[:, back] for ball in (v, a, moving.k, w, w_rate))
    return Kinematics(v, a, k, w, w_rate, *direction_errors(links_m, bends, error_m), error_m)


@dataclass(frozen=True)
class Views:
    """K pairs of benches at one state, each in the frame of its first bench.

    ``middle`` holds the coordinates of the middles of the second benches. ``track`` (K, 4, 2) holds the cosines and
    sines of the track's headings at both handles of the first benches and then of the second benches.
    """

    middle: tuple[Floats, Floats]
    track: Floats


def views(p: Floats, axis: Floats, headings: Floats, row: Ints, i: Ints, j: Ints) -> Views:
    """Return pairs of benches i and j of chains ``row``, given the handles ``p`` (M, N+1, 2) and link axes ``axis``."""
    u = axis[row, i]
    middle = 0.5 * (p[row, j] + p[row, j + 1] - p[row, i] - p[row, i + 1])
    x, y = _turned(u, middle)
    track = np.stack([np.stack(_turned(u, headings[row, handle]), axis=-1) for handle in (i, i + 1, j, j + 1)], axis=1)
    return Views((x, y), track)


def _turned(u: Floats, vectors: Floats) -> tuple[Floats, Floats]:
    """Return the components of vectors along and across axes."""
    return (u[:, 0] * vectors[:, 0] + u[:, 1] * vectors[:, 1], u[:, 0] * vectors[:, 1] - u[:, 1] * vectors[:, 0])


def second_derivatives(moving: Kinematics, one: Views, two: Views, row: Ints, i: Ints, j: Ints, travel_m: Floats,
                       arm: Floats) -> tuple[Floats, Floats]:
    """Return bounds (K,) on second derivatives of either bench's corners in the frame of the other bench.

    ``travel_m`` (K,) holds the distances that the leader moves, and ``arm`` (N,) the distances of corners from middles.
    A bound is infinite if the derivative is unbounded.
    """
    with np.errstate(all='ignore'):
        turn, turn_rate = _at(moving.w, row, i), _at(moving.w_rate, row, i)
        axis_error = moving.axis_error[i]
        handles = [_handle(moving, row, handle, (one.track[:, n], two.track[:, n]), turn, travel_m,
                           axis_error + moving.track_error)
                   for n, handle in enumerate((i, i + 1, j, j + 1))]
        (v_x, v_y), (a_x, a_y) = ([0.5 * (c + d - a - b) for a, b, c, d in zip(*parts, strict=True)]
                                  for parts in zip(*handles, strict=True))
        x, y, u_x, u_y = _middle(one, two, (v_x, v_y), turn, travel_m, _off_m(one, two, axis_error, moving.error_m))
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
    """Return one element of a ball for each pair of a row and a column."""
    return Ball(ball.mid[row, column], ball.rad[row, column])


def _handle(moving: Kinematics, row: Ints, handle: Ints, track: tuple[Floats, Floats], turn: Ball, travel_m: Floats,
            off: Floats) -> tuple[tuple[Ball, Ball], tuple[Ball, Ball]]:
    """Return a handle's velocity and acceleration in a fixed frame, as components along and across the first bench."""
    v, a, k = (_at(ball, row, handle) for ball in (moving.v, moving.a, moving.k))
    start, stop = (np.arctan2(each[:, 1], each[:, 0]) for each in track)
    stop = start + np.remainder(stop - start + np.pi, 2 * np.pi) - np.pi
    reach = ABOVE * (0.5 * (k * v - turn).most * travel_m + off)
    ends = between(start, stop, off)
    # ``stop`` assumes the shorter turn from ``start``, which is certain if the angle changes by less than half a turn.
    sin, cos = Ball(ends.mid, np.where(reach < 0.5 * np.pi, np.maximum(ends.rad, reach), np.inf)).sin_cos()
    bent = k * v.squared()
    return (v * cos, v * sin), (a * cos - bent * sin, a * sin + bent * cos)


def _off_m(one: Views, two: Views, axis_error: Floats, error_m: float) -> Floats:
    """Return the error (m), at either state, of the second bench's middle in the frame of the first bench."""
    out: Floats = 3 * error_m + axis_error * np.maximum(np.hypot(*one.middle), np.hypot(*two.middle))
    return out


def _middle(one: Views, two: Views, v: tuple[Ball, Ball], turn: Ball, travel_m: Floats,
            off: Floats) -> tuple[Ball, Ball, Ball, Ball]:
    """Return enclosures of the second bench's middle in the frame of the first bench, and of this middle's velocity.

    The rotation of the first bench does not change the distance between the middles, so their velocities bound its
    change. At the two states, the middles may have errors of up to ``off`` (K,) metres.
    """
    far = np.minimum(np.hypot(*one.middle), np.hypot(*two.middle)) + off
    far = ABOVE * (far + travel_m * np.hypot(v[0].most, v[1].most))
    ends = [between(a, b, off) for a, b in zip(one.middle, two.middle, strict=True)]
    x, y = (Ball(end.mid, ABOVE * (far + end.most)) for end in ends)
    for _ in range(_PASSES):
        u, before = (v[0] + turn * y, v[1] - turn * x), (x, y)
        x, y = (Ball(end.mid, np.fmin(ball.rad, np.maximum(end.rad, ABOVE * (0.5 * rate.most * travel_m + off))))
                for end, ball, rate in zip(ends, (x, y), u, strict=True))
        if _settled(before, (x, y)):
            break
    return x, y, v[0] + turn * y, v[1] - turn * x
