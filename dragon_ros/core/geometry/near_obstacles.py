"""Find the closest and the touching pairs of benches and obstacles at successive samples, using a list of near edges.

``with_obstacles`` searches from scratch. ``NearObstacles`` returns the same results, bit for bit, but uses the state of
an earlier sample, which lists all pairs of a bench and an edge whose gaps were at most a given reach. Obstacles are at
rest, so the gap of a bench with half diagonal r has since changed by at most m = |c - c'| + r |w - w'|, where c and w
are the centre and the orientation (a unit complex number) of the bench, and c' and w' are those of the earlier sample.
The gaps of unlisted pairs exceed the reach minus m. A listed pair can be excluded by its gap minus m, or by its
separation along the axis that separated the pair best, as in ``near_pairs``: a bench that moves along a wall stays at
the same distance from the wall. Gaps are computed only for pairs that may be closer than the closest two benches and
the previously nearest edge. The state affects only the time that a sample takes.

A bench on the wrong side of an obstacle's edges (``misplaced_benches``) touches the obstacle even if it meets none of
the edges; its signed gap is then minus its distance from the nearest edge.
"""
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from dragon_ros.core.geometry.contacts import Closeness
from dragon_ros.core.geometry.near_pairs import TOUCH_M, NearPairs
from dragon_ros.core.geometry.rectangles import Benches, together
from dragon_ros.core.geometry.signed_distance import PartedPairs, gap_of, parted_pairs
from dragon_ros.core.geometry.venue import Surroundings
from dragon_ros.core.numerics.types import Complexes, Floats, Ints, complex_of

_SKIN = 0.3             # margin of lists, relative to the mean bench length; long lists last longer, but take more time
_MARGIN = 2.0**-40        # tolerance for rounding errors of gaps and displacements, relative to coordinates and sizes
_FEW = 8                # up to this many pairs are computed one by one; more pairs are computed as arrays


def with_obstacles(around: Surroundings, found: Closeness, benches: Benches) -> Closeness:
    """Return the closeness of benches to each other and to obstacles, which are numbered after the benches."""
    nearest = around.nearest(benches)
    bench, edge = around.near(benches, TOUCH_M)
    gap_m = np.append(around.gaps(benches, bench, edge), nearest.gap_m)
    misplaced = around.misplaced_benches(benches, np.arange(len(benches.half_length)))
    return _together(around, found, benches, (np.append(bench, nearest.bench), np.append(edge, nearest.edge)), gap_m,
                     misplaced)


def _together(around: Surroundings, found: Closeness, benches: Benches, pairs: tuple[Ints, Ints], gap_m: Floats,
              misplaced: tuple[Ints, Ints]) -> Closeness:
    """Add obstacles to a ``Closeness``, given the gaps of pairs that include the nearest and all touched edges."""
    count, names = len(benches.half_length), len(around.names)
    key, index = np.unique(pairs[0] * names + around.owner[pairs[1]], return_inverse=True)
    least_m: Floats = np.full(key.size, inf)
    np.minimum.at(least_m, index, gap_m)
    if misplaced[0].size:
        wrong = misplaced[0] * names + misplaced[1]
        right = np.isin(key, wrong, invert=True)
        deep = [around.gap_to(benches, *pair) for pair in zip(*(one.tolist() for one in misplaced), strict=True)]
        key, least_m = np.concatenate((key[right], wrong)), np.concatenate((least_m[right], deep))
    i, number = np.divmod(key, names)
    j, least_m = count + number, least_m + 0.0      # removes the sign of a zero
    first = int(np.lexsort((key, least_m))[0])
    if least_m[first] < found.clearance_m:
        found = replace(found, clearance_m=float(least_m[first]), closest=(int(i[first]), int(j[first])))
    met = np.flatnonzero(least_m <= TOUCH_M)
    if not met.size:
        return found
    i, j, least_m = (np.concatenate(one) for one in ((found.i, i[met]), (found.j, j[met]), (found.gap_m, least_m[met])))
    order = np.lexsort((j, i, least_m))
    return replace(found, i=i[order], j=j[order], gap_m=least_m[order])


@dataclass(frozen=True, slots=True)
class _Kept:
    """The benches of a sample (centres, axes, half diagonals, sizes), and the pairs with gaps up to ``reach_m``.

    ``list`` holds the axes that separate the pairs; in ``list``, edges (``middles``, ``axes``) are numbered after
    benches. ``nearest`` is the pair with the smallest gap at the last sample for which gaps were computed.
    """

    sizes: bytes
    centre: Complexes
    axis: Complexes
    far: Floats
    bench: Ints
    edge: Ints
    gap_m: Floats
    list: PartedPairs
    middles: Complexes
    axes: Complexes
    reach_m: float
    misplaced: tuple[Ints, Ints]
    nearest: tuple[int, int] | None

    def separations(self, rows: Ints, benches: Benches) -> Floats:
        """Return the current separations of listed pairs along their axes."""
        centre, axis = (np.concatenate(one) for one in zip(_complex(benches), (self.middles, self.axes), strict=True))
        return self.list.rows(rows).separations(centre, axis, axis.conj())


class NearObstacles:
    """Adds obstacles to the closeness of successive samples; this is faster if consecutive samples are similar."""

    def __init__(self, around: Surroundings) -> None:
        """Start without a state."""
        self.around = around
        self._kept: _Kept | None = None

    def look(self, found: Closeness, benches: Benches) -> Closeness:
        """Return the same result as ``with_obstacles``."""
        kept = self._kept
        if kept is None or kept.sizes != benches.sizes:
            kept = None
        limit_m = self._limit_m(kept, found, benches)
        moved_m = _moved_m(kept, benches) if kept else np.empty(0)
        if kept is None or not kept.reach_m - float(np.maximum.reduce(moved_m)) > limit_m:
            kept = self._kept = self._listed(benches, limit_m)
            moved_m = np.zeros(len(benches.half_length))
        return self._decided(kept, found, benches, kept.gap_m - moved_m.take(kept.bench), limit_m)

    def _limit_m(self, kept: _Kept | None, found: Closeness, benches: Benches) -> float:
        """Return an upper bound on the clearance that is at least ``TOUCH_M``."""
        least_m = found.clearance_m
        if kept and kept.nearest:
            least_m = min(least_m, gap_of(benches, *kept.nearest, self.around.edges))
        margin_m = _MARGIN * (self.around.far_m + float(np.max(np.abs(benches.centre))))
        return max(least_m, TOUCH_M) + margin_m

    def _listed(self, benches: Benches, limit_m: float) -> _Kept:
        """Return the state after a search from scratch."""
        if not limit_m < inf:
            limit_m = max(self.around.nearest(benches).gap_m, TOUCH_M)
        reach_m = limit_m + _SKIN * 2 * float(np.mean(benches.half_length))
        bench, edge = self.around.near(benches, reach_m)
        gap_m = self.around.gaps(benches, bench, edge)
        near = np.flatnonzero(gap_m <= reach_m)
        near = near[np.lexsort((edge[near], bench[near]))]
        bench, edge, gap_m = bench[near], edge[near], gap_m[near]
        least = int(np.argmin(gap_m)) if near.size else None
        centre, axis = _complex(benches)
        listed, index = np.unique(edge, return_inverse=True)
        middles, axes = self.around.middle[listed], self.around.axis[listed]
        every = together(benches, self.around.edges.some(listed))
        parted = parted_pairs(*_complex(every), every, bench, len(centre) + index)[0]
        return _Kept(benches.sizes, centre.copy(), axis.copy(), np.hypot(benches.half_length, benches.half_width),
                     bench, edge, gap_m, parted, middles, axes, reach_m,
                     self.around.misplaced_benches(benches, np.arange(len(benches.half_length))),
                     None if least is None else (int(bench[least]), int(edge[least])))

    def _decided(self, kept: _Kept, found: Closeness, benches: Benches, low_m: Floats, limit_m: float) -> Closeness:
        """Return the closeness, given lower bounds on the listed gaps."""
        rows = (low_m <= limit_m).nonzero()[0]
        misplaced = self._misplaced(kept, benches, low_m) if rows.size else kept.misplaced
        if rows.size > _FEW:
            rows = rows[kept.separations(rows, benches) <= limit_m]
        if not rows.size and not misplaced[0].size:
            return found
        bench, edge = kept.bench[rows], kept.edge[rows]
        gap_m = self._gaps(benches, bench, edge)
        if rows.size:
            least = int(np.argmin(gap_m))
            self._kept = replace(kept, nearest=(int(bench[least]), int(edge[least])))
            if gap_m[least] > TOUCH_M and not misplaced[0].size:
                if gap_m[least] >= found.clearance_m:
                    return found
                pair = int(bench[least]), len(benches.half_length) + int(self.around.owner[edge[least]])
                return replace(found, clearance_m=float(gap_m[least]), closest=pair)
        return _together(self.around, found, benches, (bench, edge), gap_m, misplaced)

    def _gaps(self, benches: Benches, bench: Ints, edge: Ints) -> Floats:
        if bench.size > _FEW:
            return self.around.gaps(benches, bench, edge)
        edges = self.around.edges
        return np.array([gap_of(benches, *pair, edges) for pair in zip(bench.tolist(), edge.tolist(), strict=True)])

    def _crossed(self, kept: _Kept, benches: Benches, rows: Ints) -> NDArray[np.bool_]:
        """Return, for each of the listed pairs, whether the centre of the bench has crossed the edge."""
        bench, edge = kept.bench[rows], kept.edge[rows]
        before, now = kept.centre[bench], _complex(benches)[0][bench]
        a, b = self.around.start[edge], self.around.stop[edge]
        out: NDArray[np.bool_] = ((_left(a, b, before) != _left(a, b, now))
                                  & (_left(before, now, a) != _left(before, now, b)))
        return out

    def _misplaced(self, kept: _Kept, benches: Benches, low_m: Floats) -> tuple[Ints, Ints]:
        """Return the misplaced benches; benches that may have crossed an edge are examined again."""
        rows = (low_m <= 0).nonzero()[0]
        if rows.size:
            rows = rows[self._crossed(kept, benches, rows)]
        if not rows.size:
            return kept.misplaced
        crossed = np.unique(kept.bench[rows])
        bench, number = self.around.misplaced_benches(benches, crossed)
        same = np.isin(kept.misplaced[0], crossed, invert=True)
        bench, number = (np.concatenate(one) for one in zip((kept.misplaced[0][same], kept.misplaced[1][same]),
                                                            (bench, number), strict=True))
        order = np.lexsort((number, bench))
        return bench[order], number[order]


def _left(a: Complexes, b: Complexes, c: Complexes) -> NDArray[np.bool_]:
    """Return whether points c lie to the left of lines from a to b."""
    out: NDArray[np.bool_] = (np.conj(b - a) * (c - a)).imag > 0
    return out


def _moved_m(kept: _Kept, benches: Benches) -> Floats:
    """Return upper bounds (N,) on the displacement of the points of each bench since the stored sample."""
    centre, axis = _complex(benches)
    moved: Floats = np.abs(axis - kept.axis)
    moved *= kept.far
    moved += np.abs(centre - kept.centre)
    return moved


def _complex(benches: Benches) -> tuple[Complexes, Complexes]:
    """Return centres and axes as complex numbers."""
    return complex_of(benches.centre), complex_of(benches.axis)


class SmallestGap:
    """Finds the smallest signed gap at successive moments: between benches, or between a bench and an obstacle."""

    def __init__(self, around: Surroundings | None = None) -> None:
        """Start without a state; ``around`` holds the obstacles."""
        self._near = NearPairs()
        self._obstacles: NearObstacles | None = None
        self.surround(around)

    def surround(self, around: Surroundings | None) -> None:
        """Replace the obstacles, if they differ."""
        if around is not (self._obstacles and self._obstacles.around):
            self._obstacles = NearObstacles(around) if around else None

    def at_m(self, p: Floats, benches: Benches) -> float:
        """Return the gap (m), which is inf if no two parts are close."""
        found = self._near.look(p, benches)
        return (self._obstacles.look(found, benches) if self._obstacles else found).clearance_m
