"""Bounds on how close the benches of a run come to each obstacle of a venue, by branch and bound.

The pose of a bench depends on its length and on the position of its front handle. A cell is therefore an interval of
the track that the front handles of benches of one length pass through, paired with one edge of an obstacle
(``obstacle_bounds``).
"""
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.rectangles import corner_levers
from dragon_ros.core.geometry.signed_distance import rounding_m
from dragon_ros.core.geometry.venue import Surroundings, surroundings_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Array, Complexes, Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.bounding_box import HandleRanges, SweptBench, by_length, intervals_of
from dragon_ros.core.search.driver import Boxes, InOrder, divisible, run
from dragon_ros.core.search.obstacle_bounds import ObstacleBounds, corners_of
from dragon_ros.core.search.venue import check_sides

_AT_ONCE = 8192     # number of cells that are judged together
_PARTS = 4          # number of parts into which a cell is cut
_FIRST_M = 2.0      # approximate length of the first intervals
_MOST_FIRST = 20_000    # maximum number of first intervals per kind of bench
_PAIRS_AT_ONCE = 2_000_000      # maximum number of distances from positions to edges that are computed together
_MOST = 3_000_000   # maximum number of cells that are examined


@dataclass(frozen=True)
class ObstacleGap:
    """The smallest signed gap to an obstacle: a bench has the gap ``high_m`` at ``t_s``, and no gap is below ``low_m``.

    ``high_m`` is computed and has an error of up to ``error_m``, which ``low_m`` allows for. ``point_m`` is the middle
    of the bench at this time.
    """

    name: str
    low_m: float
    high_m: float
    bench: int
    t_s: float
    point_m: tuple[float, float]
    error_m: float


@dataclass(frozen=True)
class VenueFit:
    """The smallest gaps to the obstacles, in increasing order, and the required gap ``margin_m``."""

    gaps: tuple[ObstacleGap, ...]
    margin_m: float
    looks: int

    @property
    def lacking(self) -> tuple[ObstacleGap, ...]:
        """The obstacles that a bench touches, or approaches closer than the margin, in order of increasing gap."""
        return tuple(one for one in self.gaps if one.high_m < self.margin_m - one.error_m or one.high_m <= 0)

    @property
    def fits(self) -> bool | None:
        """Whether all gaps are at least the margin and no obstacle is touched; None if the bounds cannot decide."""
        if self.lacking:
            return False
        return True if all(one.low_m >= self.margin_m and one.low_m > 0 for one in self.gaps) else None


def venue_fit(scene: Scene, within_m: float = 1e-6, progress: Callable[[int], object] = lambda looks: None) -> VenueFit:
    """Return the smallest gap to each obstacle of the scene's venue, between bounds about ``within_m`` apart.

    The bounds are further apart if the search reaches its limit of ``_MOST`` cells. ``progress(looks)`` is called with
    the number of cells judged since the last call. Raises FieldError if there is no venue, or if the dragon starts in
    an obstacle or outside the venue.
    """
    if scene.venue is None:
        raise FieldError('venue', None, 'the scene has no venue', 'give obstacles or an inside polygon')
    around, ranges = surroundings_of(scene.venue), HandleRanges(scene)
    check_sides(compile_scene(scene))
    search = _Nearing(around, within_m, progress)
    kinds = by_length(scene.dragon.bench_lengths_m)
    for kind, benches in enumerate(kinds):
        search.run(SweptBench.of(ranges.track, scene.dragon, int(benches[0])), intervals_of(ranges, benches), kind)
    found = _gaps(ranges, kinds, search)
    return VenueFit(tuple(sorted(found, key=lambda one: one.high_m)), scene.venue.margin_m, search.looks)


@dataclass(frozen=True)
class _EdgeIntervals:
    """Intervals (2, M) of the track, each paired with an edge of an obstacle."""

    ends: Floats
    edge: Ints

    @property
    def size(self) -> int:
        """The number of intervals."""
        return int(self.edge.size)

    @property
    def low(self) -> Floats:
        """The starts (1, M) of the intervals."""
        return self.ends[:1]

    def some(self, which: Array) -> '_EdgeIntervals':
        """Return a subset of the intervals."""
        return _EdgeIntervals(self.ends[:, which], self.edge[which])

    def cut(self) -> '_EdgeIntervals':
        """Cut each interval into equal parts."""
        parts = Boxes(self.ends[:1], self.ends[1:]).cut(_PARTS)
        return _EdgeIntervals(np.concatenate((parts.low, parts.high)), np.repeat(self.edge, _PARTS))


class _Nearing(InOrder):
    """A search for the smallest gap to each obstacle, with the best gaps so far and bounds on finished intervals."""

    at_once = _AT_ONCE

    def __init__(self, around: Surroundings, within_m: float, progress: Callable[[int], object]) -> None:
        self.looks, self._around, self._within_m, self._tell = 0, around, within_m, progress
        count = len(around.names)
        self.best: Floats = np.full(count, np.inf)
        self.low: Floats = np.full(count, np.inf)
        self.where = [(0, 0.0)] * count
        self._kind = 0
        self._bounds: ObstacleBounds = ObstacleBounds.__new__(ObstacleBounds)

    def run(self, bench: SweptBench, intervals: Floats, kind: int) -> None:
        """Search intervals (2, M) of the track for one kind of bench."""
        self._bounds, self._kind = ObstacleBounds(bench, self._around), kind
        run(self, self._roots(Boxes(*intervals[:, None])))

    def _roots(self, boxes: Boxes) -> _EdgeIntervals:
        """Return the cells that may matter, judged by the distance of the edge from the bench's middle.

        This distance, minus the bench's motion and arm, is a lower bound on the gap. The smallest distance of an
        obstacle's edges from any middle is an upper bound on the gap to this obstacle.
        """
        longest = float(np.max(boxes.high - boxes.low, initial=0.0))
        boxes = boxes.cut(int(min(max(1, np.ceil(longest / _FIRST_M)), max(1, _MOST_FIRST // boxes.size))))
        ends = np.stack((boxes.low[0], boxes.high[0]))
        places, index = np.unique(ends, return_inverse=True)
        index = index.reshape(ends.shape)
        states = self._bounds.bench.states(places)
        middle = np.mean(corners_of(states), axis=1)
        moved_m = np.max(self._bounds.motions_m(states.rows(index[0]), states.rows(index[1])), axis=1)
        arm = float(np.hypot(*self._bounds.half_m))
        count, owner = boxes.size, self._around.owner
        every = max(1, _PAIRS_AT_ONCE // owner.size)
        firsts = np.flatnonzero(np.concatenate(([True], owner[1:] != owner[:-1])))      # owners increase
        nearest, kept = self.best.copy(), list[tuple[Ints, Ints, Floats]]()
        for first in range(0, count, every):
            rows = np.arange(first, min(first + every, count))
            used, at = np.unique(pairs := index[:, rows], return_inverse=True)
            away, at = self._away(middle[used]), at.reshape(pairs.shape)
            least = np.min(np.minimum.reduceat(away, firsts, axis=1), axis=0)
            nearest[owner[firsts]] = np.minimum(nearest[owner[firsts]], least)
            low = 0.5 * (away[at[0]] + away[at[1]] - moved_m[rows, None]) - arm
            row, edge = np.nonzero(low <= nearest[owner])       # edges that may be the nearest
            kept.append((rows[row], edge, low[row, edge]))
        cells = list[_EdgeIntervals]()
        for rows, edge, low in kept:
            near = low <= nearest[owner[edge]]
            cells.append(_EdgeIntervals(np.stack((boxes.low[0, rows[near]], boxes.high[0, rows[near]])), edge[near]))
        return _EdgeIntervals(np.concatenate([one.ends for one in cells], axis=1),
                              np.concatenate([one.edge for one in cells]))

    def _away(self, points: Complexes) -> Floats:
        """Return distances (M, E) of points from edges."""
        around = self._around
        seen = (points[:, None] - around.middle) * np.conj(around.axis)
        out: Floats = np.hypot(np.maximum(np.abs(seen.real) - around.half_m, 0.0), seen.imag)
        return out

    def judge(self, cells: _EdgeIntervals) -> _EdgeIntervals:
        """Bound the gaps of cells, record the bounds of those that contain no smaller gap, and cut the others."""
        places, index = np.unique(cells.ends, return_inverse=True)
        states, owner = self._bounds.bench.states(places), self._around.owner[cells.edge]
        self.looks += cells.size
        self._tell(cells.size)
        ends = [states.rows(rows) for rows in index.reshape(cells.ends.shape)]
        gaps = self._bounds.gaps(ends[0], cells.edge), self._bounds.gaps(ends[1], cells.edge)
        for row, gap_m in zip(cells.ends, gaps, strict=True):
            self._note(gap_m, row, owner)
        low = self._bounds.bounds(ends[0], ends[1], gaps, cells.edge)
        more = (low < self.best[owner] - self._within_m) & divisible(*cells.ends) & (self.looks < _MOST)
        np.minimum.at(self.low, owner[~more], low[~more])
        return cells.some(more).cut()

    def _note(self, gap_m: Floats, places: Floats, owner: Ints) -> None:
        """Record the smallest gaps to obstacles, and where they occur."""
        before = self.best.copy()
        np.minimum.at(self.best, owner, gap_m)
        met = np.flatnonzero((gap_m == self.best[owner]) & (gap_m < before[owner]))
        for n in met.tolist():
            self.where[owner[n]] = self._kind, float(places[n])


def _gaps(ranges: HandleRanges, kinds: list[Ints], search: '_Nearing') -> list[ObstacleGap]:
    """Return the result for each obstacle, with the bench that comes closest and the time when it does."""
    scene, around = ranges.scene, search._around
    simulation = compile_scene(scene)
    size_m, levers = simulation.size_m, corner_levers(scene.dragon)
    off_m = float(rounding_m(max(size_m, around.far_m), float(np.max(scene.dragon.bench_lengths_m)
                                                              + scene.dragon.width_m)))
    out, firsts = dict[int, ObstacleGap](), np.searchsorted(around.owner, np.arange(len(around.names) + 1))
    for kind, benches in enumerate(kinds):
        numbers = [number for number, (found, _) in enumerate(search.where) if found == kind]
        if not numbers:
            continue
        places = np.array([search.where[number][1] for number in numbers])
        bounds = ObstacleBounds(SweptBench.of(ranges.track, scene.dragon, int(benches[0])), around)
        states, (low, high) = bounds.bench.states(places), ranges.ranges_m[:, benches]
        middles, sizes = np.mean(corners_of(states), axis=1), np.diff(firsts)[numbers]
        edges = np.concatenate([np.arange(firsts[number], firsts[number + 1]) for number in numbers])
        gap_m = bounds.gaps(states.rows(np.repeat(np.arange(len(numbers)), sizes)), edges)
        least = np.minimum.reduceat(gap_m, np.cumsum(sizes) - sizes)
        error_m = float(levers[benches[0]]) * simulation.promise_m + off_m
        for row, number in enumerate(numbers):
            high_m = float(least[row])
            bench = int(benches[np.argmax(np.minimum(places[row] - low, high - places[row]))])
            low_m = min(high_m, float(min(search.low[number], search.best[number]))) - error_m
            out[number] = ObstacleGap(around.names[number], low_m, high_m, bench, ranges.when_s(
                bench, float(places[row])), (float(middles[row].real), float(middles[row].imag)), error_m)
    return [out[number] for number in range(len(around.names))]
