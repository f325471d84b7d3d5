"""Separating axes and signed gaps of rectangles: their distance, or minus the shortest translation that parts them.

The shortest translation that separates two overlapping convex polygons is normal to an edge, so the separating-axis
value is its length. If the polygons are apart, that value is only a lower bound, and the nearest corner determines
the gap.

The rounding errors are as follows, for handles given as floats. Let S be a bound on the coordinates and L a bound on
the sum of half length and half width of a bench, and let u = 2^-53. The error of a centre is u S. The axis of a bench
is the quotient of a difference and its length, with an error of 4 u. A vector between centres has a length D <= 2.9 S
and an error of 2.9 u S. The error of its components along an axis is 2.9 u S + 9 u D. Rotation into the axes of the
other bench multiplies this error by 1.5 and adds 14 u D; the total is 80 u S. The error of a rectangle's extent along
an axis is 20 u L, and the error of the root of a sum of squares is 1.5 times the error of the terms. The error of any
separation or gap of two benches is therefore at most 128 u (S + L).
"""
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.numerics.types import Array, Complexes, Floats, Index, Ints, left

CORNERS = ('front left', 'rear left', 'rear right', 'front right')     # in the order of Benches.corners
EDGES = ('front', 'rear', 'left', 'right')
_ROUNDED = 2.0**-46     # largest rounding error of a separation or gap, relative to coordinates and sizes
_AT_ONCE = 4096     # number of pairs whose intermediate results fit in the cache
_SAME = 1e-12       # largest difference that counts as a tie, relative to the sizes
_STRAIGHT_M = 1e-200    # avoids a division by zero
_ALONG: Floats = np.array([[1.0], [-1], [-1], [1]])
_ASIDE: Floats = np.array([[1.0], [1], [-1], [-1]])


@dataclass(frozen=True)
class RelativePoses:
    """Pairs of rectangles A and B: the centre (x, y) and axis (cos, sin) of B relative to A, and all half sizes."""

    x: Floats
    y: Floats
    cos: Floats
    sin: Floats
    a: tuple[Floats, Floats]
    b: tuple[Floats, Floats]

    def mirrored(self) -> 'RelativePoses':
        """Return the poses of A relative to B."""
        return RelativePoses(-self.x * self.cos - self.y * self.sin, self.x * self.sin - self.y * self.cos,
                             self.cos, -self.sin, self.b, self.a)

    @property
    def _extents(self) -> tuple[Floats, Floats]:
        """Distances between the centres along each axis of A at which the rectangles just touch along this axis."""
        (a_x, a_y), (half, side), c, s = self.a, self.b, np.abs(self.cos), np.abs(self.sin)
        return a_x + half * c + side * s, a_y + half * s + side * c

    def from_edges(self) -> list[Floats]:
        """Return how far B lies beyond each edge of A (front, rear, left, right); negative if part of B is inside."""
        along, aside = self._extents
        return [self.x - along, -self.x - along, self.y - aside, -self.y - aside]

    def along_axes(self) -> list[Floats]:
        """Return the four separations along the axes of A and B, each the larger of the values for its two sides."""
        pairs = (self, *self._extents), (other := self.mirrored(), *other._extents)
        return [each for one, along, aside in pairs for each in (np.abs(one.x) - along, np.abs(one.y) - aside)]

    def separations(self) -> tuple[Floats, Floats]:
        """Return the larger separation along A's two axes (negative if both overlap), and the squared distance.

        The distance is measured between A and the nearer of B's two leading corners. If B is reflected so that its
        centre has x, y >= 0, the leading corners are the ones with the smallest x and with the smallest y. The other
        two corners need not be considered, because a point of the edge between the leading corners is always at least
        as near.
        """
        x, y, c, s = np.abs(self.x), np.abs(self.y), np.abs(self.cos), np.abs(self.sin)
        (a_x, a_y), (half, side) = self.a, self.b
        along_x, along_y, across_x, across_y = half * c, half * s, side * s, side * c
        tilt = np.where((self.cos < 0) ^ (self.sin < 0) ^ (self.x < 0) ^ (self.y < 0), -1.0, 1.0)
        x_1, y_2 = x - along_x - across_x, y - along_y - across_y
        y_1, x_2 = np.abs(y - tilt * (along_y - across_y)), np.abs(x - tilt * (along_x - across_x))
        axis: Floats = np.maximum(x_1 - a_x, y_2 - a_y)
        first = np.maximum(np.abs(x_1) - a_x, 0) ** 2 + np.maximum(y_1 - a_y, 0) ** 2
        second = np.maximum(x_2 - a_x, 0) ** 2 + np.maximum(np.abs(y_2) - a_y, 0) ** 2
        near: Floats = np.minimum(first, second)
        return axis, near


def rounding_m(far_m: Floats | float, half_m: Floats | float) -> Floats | float:
    """Return an upper bound on the error of separations and gaps for handles whose coordinates do not exceed ``far_m``.

    ``half_m`` is the largest sum of a bench's half length and half width.
    """
    return _ROUNDED * (far_m + half_m)


def placement(benches: Benches, i: Index, j: Index, others: Benches | None = None) -> RelativePoses:
    """Return the poses of benches j relative to benches i (indices along the second-to-last axis of ``centre``).

    If ``others`` are given, j are indices of ``others``.
    """
    others = benches if others is None else others
    offset = _at(others.centre, j) - _at(benches.centre, i)
    u, w = _at(benches.axis, i), _at(others.axis, j)
    x, y, u_x, u_y, w_x, w_y = offset[..., 0], offset[..., 1], u[..., 0], u[..., 1], w[..., 0], w[..., 1]
    return RelativePoses(x * u_x + y * u_y, y * u_x - x * u_y, u_x * w_x + u_y * w_y, u_x * w_y - u_y * w_x,
                         (_at(benches.half_length, i), _at(benches.half_width, i)),
                         (_at(others.half_length, j), _at(others.half_width, j)))


def seen_from(centre: tuple[Complexes, Complexes], axis: tuple[Complexes, Complexes], a: tuple[Any, Any],
              b: tuple[Any, Any]) -> RelativePoses:
    """Return the poses of rectangles with half sizes ``b`` relative to rectangles with half sizes ``a``.

    ``centre`` and ``axis`` hold the centres and axes of both as complex numbers.
    """
    back = np.conj(axis[0])
    offset, turn = (centre[1] - centre[0]) * back, axis[1] * back
    return RelativePoses(offset.real, offset.imag, turn.real, turn.imag, a, b)


def parted_between(states: Sequence[RelativePoses], sag: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Return a lower bound on the separation of pairs between ``states``, and the largest ratio of separation to sag.

    Between the states, corners deviate by at most ``sag`` from the lines (or the bilinear surface) through their
    positions at the states. ``sag`` has two elements, for the corners of B relative to A and for the corners of A
    relative to B. Along these lines, the separation from an edge is concave.
    """
    low, ratio = [], []
    for bent, views in zip(sag, (states, [each.mirrored() for each in states]), strict=True):
        edges = zip(*(view.from_edges() for view in views), strict=True)
        apart = reduce(np.maximum, [reduce(np.minimum, edge) for edge in edges])
        low.append(apart - bent)
        ratio.append(np.maximum(apart, 0.0) / np.maximum(bent, _STRAIGHT_M))
    return np.maximum(*low), np.maximum(*ratio)


class PartedPairs(NamedTuple):
    """Pairs (P,), each with the axis that separates it best, the owner of the axis, the other bench, and projections.

    ``towards`` is the conjugate of the direction to the other bench in the owner's axes, ``extent`` is the owner's half
    size in this direction, and ``sizes`` (P, 2) holds the half sizes of the other bench. The axis turns with its owner.
    """

    owner: Ints
    other: Ints
    towards: Complexes
    extent: Floats
    sizes: Floats

    def separations(self, centre: Complexes, axis: Complexes, back: Complexes) -> Floats:
        """Return the separation (..., P) of each pair along its axis (at most the gap).

        ``centre`` and ``axis`` have the shape (..., N), and ``back`` holds the conjugate axes.
        """
        towards = back.take(self.owner, axis=-1)
        towards *= self.towards
        offset = centre.take(self.other, axis=-1)
        offset -= centre.take(self.owner, axis=-1)
        offset *= towards
        towards *= axis.take(self.other, axis=-1)
        reach = np.abs(towards.view(np.float64)).reshape(*towards.shape, 2)
        reach *= self.sizes
        out: Floats = offset.real - self.extent
        out -= reach[..., 0]
        out -= reach[..., 1]
        return out

    def rows(self, index: Ints) -> 'PartedPairs':
        """Return a subset of the pairs."""
        return PartedPairs(self.owner[index], self.other[index], self.towards[index], self.extent[index],
                           self.sizes[index])

    @property
    def pairs(self) -> tuple[Ints, Ints]:
        """The pairs (i, j), i < j."""
        return np.minimum(self.owner, self.other), np.maximum(self.owner, self.other)


def parted_pairs(centre: Complexes, axis: Complexes, benches: Benches, i: Ints, j: Ints) -> tuple[PartedPairs, Floats]:
    """Return pairs with the axes that separate them best, and the separations along these axes."""
    half, side = benches.half_length, benches.half_width
    a, b = ((half.take(n), side.take(n)) for n in (i, j))
    view = seen_from((centre.take(i), centre.take(j)), (axis.take(i), axis.take(j)), a, b)
    apart = np.stack(view.along_axes())
    best = np.argmax(apart, axis=0)
    ahead, aside, back = best < 2, best % 2 == 1, view.mirrored()
    x, y = np.where(ahead, view.x, back.x), np.where(ahead, view.y, back.y)
    towards = np.where(aside, np.where(y < 0, 1j, -1j), np.where(x < 0, -1.0, 1.0))
    owner, other = np.where(ahead, i, j), np.where(ahead, j, i)
    return (PartedPairs(owner, other, towards, np.where(aside, side.take(owner), half.take(owner)),
                        np.stack((half.take(other), side.take(other)), axis=1)),
            apart[best, np.arange(best.size)])


def signed_gap(pairs: RelativePoses) -> Floats:
    """Return the signed gap of each pair, in metres."""
    axis_a, near_a = pairs.separations()
    axis_b, near_b = pairs.mirrored().separations()
    gap = np.maximum(axis_a, axis_b)
    out: Floats = np.where(gap > 0, np.maximum(np.sqrt(np.minimum(near_a, near_b)), gap), gap)
    return out


def gaps(benches: Benches, i: Index, j: Index, others: Benches | None = None) -> Floats:
    """Return the signed gaps (m) between benches i and j. If ``others`` are given, j are indices of ``others``."""
    if isinstance(i, tuple) or isinstance(j, tuple) or i.ndim != 1 or i.shape != j.shape or i.size <= _AT_ONCE:
        return signed_gap(placement(benches, i, j, others))
    parts = range(0, i.size, _AT_ONCE)
    return np.concatenate([signed_gap(placement(benches, i[n:n + _AT_ONCE], j[n:n + _AT_ONCE], others))
                           for n in parts])


def gap_of(benches: Benches, i: int, j: int, others: Benches | None = None) -> float:
    """Return the signed gap (m) between benches i and j, bit-identical to the result of ``gaps``.

    For a single pair, the same float operations take a tenth of the time of array operations. If ``others`` are given,
    j is an index of ``others``.
    """
    others = benches if others is None else others
    (x_i, y_i), (x_j, y_j) = benches.centre[i].tolist(), others.centre[j].tolist()
    (u_x, u_y), (w_x, w_y) = benches.axis[i].tolist(), others.axis[j].tolist()
    a = benches.half_length.item(i), benches.half_width.item(i)
    b = others.half_length.item(j), others.half_width.item(j)
    offset_x, offset_y = x_j - x_i, y_j - y_i
    x, y = offset_x * u_x + offset_y * u_y, offset_y * u_x - offset_x * u_y
    cos, sin = u_x * w_x + u_y * w_y, u_x * w_y - u_y * w_x
    axis_a, near_a = _separation(x, y, cos, sin, a, b)
    axis_b, near_b = _separation(-x * cos - y * sin, x * sin - y * cos, cos, -sin, b, a)
    gap = max(axis_a, axis_b)
    return max(sqrt(min(near_a, near_b)), gap) if gap > 0 else gap


def _separation(x: float, y: float, cos: float, sin: float, a: tuple[float, float],
                b: tuple[float, float]) -> tuple[float, float]:
    """Return the result of ``RelativePoses.separations`` for one pair."""
    turned = (cos < 0) ^ (sin < 0) ^ (x < 0) ^ (y < 0)
    x, y, c, s = abs(x), abs(y), abs(cos), abs(sin)
    (a_x, a_y), (half, side) = a, b
    along_x, along_y, across_x, across_y = half * c, half * s, side * s, side * c
    tilt = -1.0 if turned else 1.0
    x_1, y_2 = x - along_x - across_x, y - along_y - across_y
    y_1, x_2 = abs(y - tilt * (along_y - across_y)), abs(x - tilt * (along_x - across_x))
    first_x, first_y = max(abs(x_1) - a_x, 0.0), max(y_1 - a_y, 0.0)
    second_x, second_y = max(x_2 - a_x, 0.0), max(abs(y_2) - a_y, 0.0)
    return max(x_1 - a_x, y_2 - a_y), min(first_x * first_x + first_y * first_y,
                                          second_x * second_x + second_y * second_y)


def _at(array: Array, index: Index) -> Floats:
    """Return ``array[index]``; for a single array of indices, ``take`` is used, because it is faster."""
    out: Floats = array[index] if isinstance(index, tuple) else array.take(index, axis=0)
    return out


@dataclass(frozen=True)
class Witness:
    """The closest features of two benches: ``corner`` of bench ``owner`` and ``edge`` of bench ``other``.

    ``point_m`` is halfway between the corner and the edge, and ``gap_m`` is the signed gap (negative for overlap). If
    the benches overlap, the shortest translation that separates them moves this corner out through this edge.
    """

    point_m: tuple[float, float]
    gap_m: float
    owner: int
    corner: str
    other: int
    edge: str


@dataclass(frozen=True)
class Witnesses:
    """Witnesses of M pairs: points (M, 2), gaps (M,), benches (M,), and indices into CORNERS and EDGES (M,)."""

    point_m: Floats
    gap_m: Floats
    owner: Ints
    corner: Ints
    other: Ints
    edge: Ints

    def __getitem__(self, n: int) -> Witness:
        """Return the witness of a pair."""
        x, y = self.point_m[n].tolist()
        return Witness((x, y), float(self.gap_m[n]), int(self.owner[n]), CORNERS[self.corner[n]], int(self.other[n]),
                       EDGES[self.edge[n]])


@dataclass(frozen=True)
class _CornersOnEdges:
    """Corners of owners that face edges of other benches: separations, distances past the edges' ends, and indices."""

    separation: Floats
    past: Floats
    corner: Ints
    edge: Ints
    middle: Floats


def witness(benches: Benches, i: int, j: int) -> Witness:
    """Return the witness of benches i and j. If corners of both benches qualify, the corner of bench i is chosen."""
    return witnesses(benches, np.array([i]), np.array([j]))[0]


def shortest_vector(benches: Benches, i: int, j: int) -> tuple[float, float]:
    """Return the vector (m) from bench i to bench j between their nearest points; its length is the gap.

    If the benches overlap, the vector is the shortest translation of bench j that ends the overlap.
    """
    seen = witness(benches, i, j)
    sense = 1.0 if seen.owner == j else -1.0
    corner = benches.corners[seen.owner][CORNERS.index(seen.corner)]
    if seen.gap_m > 0:
        x, y = (2 * sense * (corner - np.array(seen.point_m))).tolist()
        return x, y
    along, edge = benches.axis[seen.other], EDGES.index(seen.edge)
    outwards = (1 - 2 * (edge % 2)) * (along if edge < 2 else np.array([-along[1], along[0]]))
    x, y = (-sense * seen.gap_m * outwards).tolist()
    return x, y


def witnesses(benches: Benches, i: Ints, j: Ints) -> Witnesses:
    """Return the witnesses of benches i (M,) and j (M,)."""
    gap = gaps(benches, i, j)
    one, two = _side(benches, i, j, gap), _side(benches, j, i, gap)
    same = _SAME * (benches.half_length[i] + benches.half_width[i] + benches.half_length[j] + benches.half_width[j])
    nearer = np.where(gap > 0, one.separation - two.separation, two.separation - one.separation)
    second = (nearer > same) | ((np.abs(nearer) <= same) & (two.past < one.past - same))
    other = np.where(second, i, j)
    axis, middle = benches.axis[other], np.where(second[:, None], two.middle, one.middle)
    point = benches.centre[other] + middle[:, :1] * axis + middle[:, 1:] * left(axis)
    return Witnesses(point, gap, np.where(second, j, i), np.where(second, two.corner, one.corner), other,
                     np.where(second, two.edge, one.edge))


def _side(benches: Benches, owner: Ints, other: Ints, gap: Floats) -> _CornersOnEdges:
    """Return the corner of each owner that is nearest to, or deepest in, the other bench."""
    view = placement(benches, other, owner)
    half, side = view.b
    corners = np.stack((view.x + _ALONG * half * view.cos - _ASIDE * side * view.sin,
                        view.y + _ALONG * half * view.sin + _ASIDE * side * view.cos))
    size = np.stack(view.a)
    apart, inside = _apart(corners, size), _overlapping(corners, size, np.stack((view.x, view.y)))
    chosen = [np.where(gap > 0, a, b) for a, b in zip(apart, inside, strict=True)]
    separation, past, corner, edge, x, y = chosen
    return _CornersOnEdges(separation, past, corner, edge, np.stack((x, y), axis=-1))


def _apart(corners: Floats, size: Floats) -> tuple[Array, ...]:
    """Return (distance, 0, corner, edge, middle x, middle y) for corners (2, 4, M) and half sizes (2, M)."""
    outside = np.abs(corners) - size[:, None]
    distance = np.hypot(*np.maximum(outside, 0))
    corner = np.argmin(distance, axis=0)
    pick = np.arange(corner.size)
    place, over = corners[:, corner, pick], outside[:, corner, pick]
    edge = np.where(over[0] > over[1], place[0] < 0, 2 + (place[1] < 0))
    middle = 0.5 * (place + np.clip(place, -size, size))
    return distance[corner, pick], np.zeros(corner.size), corner, edge, *middle


def _overlapping(corners: Floats, size: Floats, centre: Floats) -> tuple[Array, ...]:
    """Return (negative separation, distance past the edge, corner, edge, middle x, middle y), as in ``_apart``."""
    sign = np.where(centre < 0, -1.0, 1.0)
    depth = sign[:, None] * corners - size[:, None]
    deepest = depth.min(axis=1)
    aside = (deepest[1] >= deepest[0]).astype(np.int64)
    pick = np.arange(aside.size)
    past = np.maximum(np.abs(corners) - size[:, None], 0)[1 - aside, :, pick].T
    own = depth[aside, :, pick].T
    tied = own <= deepest[aside, pick] + _SAME * size.sum(axis=0)
    corner = np.argmin(np.where(tied, past, np.inf), axis=0)
    place = corners[:, corner, pick]
    place[aside, pick] = sign[aside, pick] * (size[aside, pick] + 0.5 * own[corner, pick])
    middle = np.clip(place, -size, size)
    return deepest[aside, pick], past[corner, pick], corner, 2 * aside + (sign[aside, pick] < 0), *middle
