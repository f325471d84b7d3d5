"""Lower bounds on the gap between a bench and an edge of an obstacle while the bench moves between two positions.

The pose of a bench depends on its length and on the position of its front handle, so an interval of the track
represents all benches of one length that pass through it. The larger of two bounds is used. Both bounds hold over the
whole interval if the rear handle moves in one direction. *By motion:* if no corner moves further than M, no point of
the bench does, so the gap is at least (g0 + g1 - M) / 2, where g0 and g1 are the gaps at the two ends. *By direction:*
let d be the direction of the largest separation at one end. The derivative of a corner's coordinate along d lies in the
ball of ``SweptBench.slopes``, so the coordinate changes by at most V and is never less than the mean of its values at
the two ends minus V / 2. The smallest of these lower bounds over all corners, minus the larger coordinate of the edge's
end points, is a lower bound on the gap. As the interval shrinks, V converges quadratically to the corner's motion along
d.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.enclosures.ball_arithmetic import Ball
from dragon_ros.core.geometry.signed_distance import rounding_m
from dragon_ros.core.geometry.venue import Surroundings
from dragon_ros.core.numerics.types import Complexes, Floats, Ints
from dragon_ros.core.search.bounding_box import BenchStates, SweptBench

# The smallest gap, relative to the bench, at which the nearest points define a direction; for smaller gaps, the axes of
# the bench and the edge are tried.
_APART_M = 1e-9


@dataclass(frozen=True)
class ObstacleBounds:
    """The gaps between a bench that moves along a track and the edges of a venue, at positions and between them.

    ``error_m`` is a bound on position errors; the bounds on gaps hold for benches with such errors.
    """

    bench: SweptBench
    around: Surroundings
    error_m: float = 0.0

    @property
    def half_m(self) -> tuple[float, float]:
        """Half the length and half the width of the bench."""
        return self.bench.half_length_m, self.bench.half_width_m

    def gaps(self, states: BenchStates, edge: Ints) -> Floats:
        """Return the signed gaps of benches (M,) to edges (M,)."""
        centre, axis = self._seats(corners_of(states))
        return self.around.gaps_of(centre, axis, self.half_m, edge)

    def motions_m(self, a: BenchStates, b: BenchStates) -> Floats:
        """Return upper bounds (M, 4) on the motion of the corners between states; infinite if unknown."""
        out: Floats = self.bench.slopes(a, b)[1][..., 0]
        return out

    def bounds(self, a: BenchStates, b: BenchStates, gaps: tuple[Floats, Floats], edge: Ints) -> Floats:
        """Return lower bounds on the gaps to edges between states a and b, given the gaps at both states."""
        slope, crude = self.bench.slopes(a, b)
        corners = corners_of(a), corners_of(b)
        with np.errstate(all='ignore'):
            moved_m, h = crude[..., 0], np.abs(b.link.along_m - a.link.along_m)[:, :1]
            low = 0.5 * (gaps[0] + gaps[1] - np.max(moved_m, axis=1))
            for one, gap_m in zip(corners, gaps, strict=True):
                d = self._directions(one, gap_m, edge)
                least = np.min(least_along(d, corners, slope, self._unsure, h, moved_m), axis=1)
                beyond = [(np.conj(d) * end[edge]).real for end in (self.around.start, self.around.stop)]
                low = np.fmax(low, least - np.maximum(*beyond))
            low -= self.rounding_m(edge)
        return np.where(np.isnan(low), -np.inf, low)

    def rounding_m(self, edge: Ints) -> Floats:
        """Return the largest error of gaps to edges due to rounding alone."""
        far_m = np.maximum(np.abs(self.around.start[edge]), np.abs(self.around.stop[edge]))
        out: Floats = np.asarray(rounding_m(far_m, far_m + sum(self.half_m)))
        return out

    @property
    def _unsure(self) -> float:
        """The error of the derivatives of the corners' coordinates due to position errors of the handles."""
        bench = self.bench
        lever = 2 + (bench.half_length_m + bench.half_width_m) / bench.link_m
        return 8 * self.error_m * (bench.track.bend + 1 / bench.link_m) * lever

    def _seats(self, corners: Complexes) -> tuple[Complexes, Complexes]:
        """Return the middles and axes of benches with these corners."""
        front, rear, rear_right = corners[:, 0], corners[:, 1], corners[:, 2]
        axis: Complexes = (front - rear) / (2 * self.bench.half_length_m)
        return 0.5 * (front + rear_right), axis

    def _directions(self, corners: Complexes, gap_m: Floats, edge: Ints) -> Complexes:
        """Return directions in which each bench and its edge are as far apart as possible, or nearly so."""
        apart = gap_m > _APART_M * sum(self.half_m)
        out = np.empty(edge.size, dtype=np.complex128)
        if np.any(apart):
            out[apart] = self._to_bench(corners[apart], edge[apart])
        if not np.all(apart):
            out[~apart] = self._along_axes(corners[~apart], edge[~apart])
        return out

    def _to_bench(self, corners: Complexes, edge: Ints) -> Complexes:
        """Return the directions from the nearest points of edges to those of benches, provided that no pair touches."""
        around, half, (centre, axis) = self.around, self.half_m, self._seats(corners)
        seen = (corners - around.middle[edge][:, None]) * np.conj(around.axis[edge])[:, None]
        long = around.half_m[edge][:, None]
        to_edge = (seen - np.clip(seen.real, -long, long)) * around.axis[edge][:, None]
        to_ends = []
        for end in (around.start, around.stop):
            z = (end[edge] - centre) * np.conj(axis)
            inside = np.clip(z.real, -half[0], half[0]) + 1j * np.clip(z.imag, -half[1], half[1])
            to_ends.append((inside - z) * axis)
        vectors = np.concatenate((to_edge, np.stack(to_ends, axis=1)), axis=1)
        size = np.abs(vectors)
        nearest = np.argmin(size, axis=1)[:, None]
        out: Complexes = (np.take_along_axis(vectors, nearest, 1) / np.take_along_axis(size, nearest, 1))[:, 0]
        return out

    def _along_axes(self, corners: Complexes, edge: Ints) -> Complexes:
        """For each pair, return the bench or edge axis along which the two are furthest apart or overlap least."""
        around, (_, axis) = self.around, self._seats(corners)
        across = 1j * around.axis[edge]
        axes = np.stack((across, -across, axis, -axis, 1j * axis, -1j * axis))
        axes /= np.abs(axes)
        beyond = [(np.conj(axes) * end[edge]).real for end in (around.start, around.stop)]
        apart = np.min((np.conj(axes)[..., None] * corners).real, axis=-1) - np.maximum(*beyond)
        out: Complexes = axes[np.argmax(apart, axis=0), np.arange(edge.size)]
        return out


def least_along(d: Complexes, ends: tuple[Complexes, Complexes], slope: Ball, unsure: float, h: Floats,
                moved_m: Floats) -> Floats:
    """Return the smallest coordinates (m) along directions d (M,) that corners (M, 4) may have between two states.

    ``slope`` (M, 4, 3) holds the derivatives of the corners' coordinates with respect to a variable that grows by ``h``
    (M, 1): the derivative of x first and that of y last, with errors of up to ``unsure``. The corners move by at most
    ``moved_m`` (M, 4).
    """
    back, middle = np.conj(d)[:, None], slope.mid[..., 0] + 1j * slope.mid[..., 2]
    rad = slope.rad[..., 0] + slope.rad[..., 2] + unsure
    goes = np.fmin(moved_m, (np.abs((back * middle).real) + rad) * h)
    out: Floats = 0.5 * ((back * (ends[0] + ends[1])).real - goes)
    return out


def corners_of(states: BenchStates) -> Complexes:
    """Return the corners (M, 4) of benches."""
    out: Complexes = states.value[..., 0] + 1j * states.value[..., 2]
    return out
