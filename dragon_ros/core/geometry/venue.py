"""The edges of a venue, and signed gaps between benches and these edges.

An edge is a rectangle of zero width, so ``signed_distance`` computes its gap to a bench: the distance or, if the two
overlap, minus the shortest translation that separates them. A bench that starts outside an obstacle and never meets the
obstacle's edges stays outside. Likewise, a bench that starts in the venue's inside and never meets its boundary stays
inside. Therefore, the edges alone determine contact during a motion. At a single instant, a bench that meets no edge
may still be on the wrong side of the edges (``misplaced_benches``), for example if a map covers the bench or a run is
sampled coarsely.
"""
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple
from weakref import ref

import numpy as np

from dragon_ros.core.geometry.contacts import OBSTACLE, ObstacleTouch, Pair
from dragon_ros.core.geometry.rectangles import Benches, together
from dragon_ros.core.geometry.signed_distance import Witness, gaps, seen_from, signed_gap, witness
from dragon_ros.core.numerics.types import Complexes, Floats, Ints, read_only
from dragon_ros.core.venue import LineObstacle, Venue

if TYPE_CHECKING:
    from shapely import STRtree

_FIRST_REACH_M = 1.0    # first search radius for the nearest edge, doubled until an edge is found
_FARTHEST_M = 4e9       # no edge is farther from a bench, because coordinates are below 1e9 m
OUTSIDE, LINE, WITHIN = 1, 0, -1        # where benches must stay: outside an area, clear of a line, or within an area

PlanePose = tuple[complex, complex]     # pose of a frame: its origin (m) and its x axis (unit length)


class Nearest(NamedTuple):
    """The smallest signed gap (m) between benches and a venue, and the bench and the edge that have this gap."""

    gap_m: float
    bench: int
    edge: int


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The edges (E,) of a venue from ``start`` to ``stop``; ``owner`` holds the index of each edge's name.

    For each name, ``side`` holds the side on which benches must stay: OUTSIDE, LINE or WITHIN.
    """

    names: tuple[str, ...]
    start: Complexes
    stop: Complexes
    owner: Ints
    side: Ints

    @property
    def inside(self) -> int | None:
        """The index of the inside among the names; None if the venue has no inside."""
        return next(iter(np.flatnonzero(self.side == WITHIN).tolist()), None)

    def moved(self, pose: PlanePose) -> 'Surroundings':
        """Return the surroundings in another frame; ``pose`` is the pose of their current frame in that frame."""
        shift, turn = pose
        return replace(self, start=_kept(shift + self.start * turn), stop=_kept(shift + self.stop * turn))

    @cached_property
    def middle(self) -> Complexes:
        """The midpoints of the edges (E,)."""
        return _kept(0.5 * (self.start + self.stop))

    @cached_property
    def half_m(self) -> Floats:
        """Half the lengths of the edges (E,)."""
        return read_only(0.5 * np.abs(self.stop - self.start))

    @cached_property
    def axis(self) -> Complexes:
        """The directions of the edges (E,)."""
        edge = self.stop - self.start
        return _kept(edge / np.abs(edge))

    @cached_property
    def edges(self) -> Benches:
        """The edges as rectangles of zero width."""
        middle, axis = (read_only(one.view(np.float64).reshape(-1, 2)) for one in (self.middle, self.axis))
        return Benches(middle, axis, self.half_m, read_only(np.zeros(self.half_m.size)))

    def rectangle(self, benches: Benches, bench: int, edge: int) -> Benches:
        """Return a bench and an edge as rectangles, the edge with zero width."""
        return together(benches.some(np.array([bench])), self.edges.some(np.array([edge])))

    def two(self, benches: Benches, pair: Pair) -> tuple[Benches, int, int]:
        """Return the rectangles of a pair; an obstacle (numbered after benches) is represented by its nearest edge."""
        count = len(benches.half_length)
        if pair[1] < count:
            return benches, *pair
        return self.rectangle(benches, pair[0], self.nearest_edge(benches, pair[0], pair[1] - count)), 0, 1

    def nearest_edge(self, benches: Benches, bench: int, number: int) -> int:
        """Return the edge with the smallest gap to a bench, among the edges of the name with index ``number``."""
        edge = self.edges_of(number)
        return int(edge[np.argmin(self.gaps(benches, np.full(edge.size, bench), edge))])

    def edges_of(self, number: int) -> Ints:
        """Return the edges of an obstacle, given the index of its name."""
        return np.flatnonzero(self.owner == number)

    def touch(self, benches: Benches, bench: int, edge: int) -> tuple[ObstacleTouch, Witness]:
        """Return the contact of a bench with an edge, and the witness, in which the obstacle has the index OBSTACLE."""
        seen = witness(self.rectangle(benches, bench, edge), 0, 1)
        start, stop = ((float(end[edge].real), float(end[edge].imag)) for end in (self.start, self.stop))
        numbers = [bench, OBSTACLE]
        own = seen.owner == 1       # the corner is an end of the edge, whose axis points from start to stop
        corner = (stop if seen.corner.startswith('front') else start) if own else None
        seen = replace(seen, owner=numbers[seen.owner], other=numbers[seen.other],
                       corner='corner' if own else seen.corner, edge=seen.edge if own else 'edge')
        return ObstacleTouch(self.names[self.owner[edge]], (start, stop), corner), seen

    @cached_property
    def far_m(self) -> float:
        """The largest absolute coordinate of the edges."""
        return float(np.max(np.abs(np.concatenate((self.start, self.stop)).view(np.float64))))

    @cached_property
    def tree(self) -> 'STRtree':
        """A spatial index of the edges' bounding boxes."""
        from shapely import STRtree, linestrings
        ends = np.stack((self.start, self.stop), axis=1)
        return STRtree(linestrings(np.stack((ends.real, ends.imag), axis=-1)))

    def in_boxes(self, low: Floats, high: Floats) -> tuple[Ints, Ints]:
        """Return the indices of all boxes (given by their corners, each (M, 2)) and edges that may intersect."""
        from shapely import box
        found = self.tree.query(box(*low.T, *high.T))
        return found[0], found[1]

    def near(self, benches: Benches, reach_m: Floats | float) -> tuple[Ints, Ints]:
        """Return all pairs of benches and edges within a reach, and possibly other pairs, as two arrays of indices."""
        corners = benches.corners
        reach = np.broadcast_to(np.asarray(reach_m), corners.shape[:1])[:, None]
        return self.in_boxes(corners.min(axis=1) - reach, corners.max(axis=1) + reach)

    def gaps(self, benches: Benches, bench: Ints, edge: Ints) -> Floats:
        """Return the signed gaps (m, shape (M,)) between benches (M,) and edges (M,)."""
        return gaps(benches, bench, edge, self.edges)

    def gaps_of(self, centre: Complexes, axis: Complexes, half: tuple[Floats | float, Floats | float],
                edge: Ints) -> Floats:
        """Return the signed gaps (m, shape (M,)) between rectangles with half sizes ``half`` and edges (M,)."""
        length = self.half_m[edge]
        return signed_gap(seen_from((centre, self.middle[edge]), (axis, self.axis[edge]),
                                    half, (length, np.zeros_like(length))))

    def nearest(self, benches: Benches) -> Nearest:
        """Return the smallest gap between benches and edges; in a tie, the gap of the first bench is chosen."""
        reach_m = _FIRST_REACH_M
        while True:
            bench, edge = self.near(benches, reach_m)
            gap_m = self.gaps(benches, bench, edge)
            if gap_m.size:
                least = np.lexsort((edge, bench, gap_m))[0]
                if gap_m[least] <= reach_m or reach_m > _FARTHEST_M:
                    return Nearest(float(gap_m[least]), int(bench[least]), int(edge[least]))
            reach_m *= 2

    def closest(self, benches: Benches, reach_m: float) -> tuple[Ints, Ints, Floats]:
        """Return benches, name indices and smallest gaps (K,) of all pairs within a reach, and possibly of others."""
        bench, edge = self.near(benches, reach_m)
        pair, index = np.unique(bench * len(self.names) + self.owner[edge], return_inverse=True)
        least: Floats = np.full(pair.size, np.inf)
        np.minimum.at(least, index, self.gaps(benches, bench, edge))
        return *np.divmod(pair, len(self.names)), least

    def points(self, benches: Benches, bench: Ints, number: Ints) -> Floats:
        """Return the points (K, 2) at which benches touch obstacles, whose names have the indices ``number``."""
        return np.array([self._point(benches, *pair) for pair in zip(bench.tolist(), number.tolist(), strict=True)])

    def _point(self, benches: Benches, bench: int, number: int) -> tuple[float, float]:
        return witness(*self.two(benches, (bench, len(benches.half_length) + number))).point_m

    def gap_to(self, benches: Benches, bench: int, number: int) -> float:
        """Return the gap between a bench and a whole obstacle; it is negated if the bench is on the wrong side."""
        edge = self.edges_of(number)
        gap_m = float(np.min(self.gaps(benches, np.full(edge.size, bench), edge))) + 0.0    # removes the sign of a zero
        wrong = gap_m > 0 and number in self.misplaced_benches(benches, np.array([bench]))[1]
        return -gap_m if wrong else gap_m

    def touching(self, benches: Benches) -> tuple[Ints, Ints, Floats]:
        """Return the benches that touch obstacles, the indices of obstacle names, and the smallest gaps, each (K,).

        The pairs with the deepest contacts come first.
        """
        bench, number, gap_m = self.closest(benches, 0.0)
        met = np.flatnonzero(gap_m <= 0)
        order = met[np.argsort(gap_m[met], kind='stable')]      # equal gaps stay in the order of their pairs
        return bench[order], number[order], gap_m[order]

    def misplaced(self, x: float, y: float) -> int | None:
        """Return the lowest index of a polygon that covers a point or an inside that does not, or None."""
        number = self.misplaced_points(np.array([[x, y]]))[1]
        return int(number[0]) if number.size else None

    def misplaced_benches(self, benches: Benches, which: Ints) -> tuple[Ints, Ints]:
        """Return the benches with centres in a polygon or outside the venue's inside, and these areas' name indices."""
        row, number = self.misplaced_points(benches.centre[which])
        return which[row], number

    def misplaced_points(self, points_m: Floats) -> tuple[Ints, Ints]:
        """Return the indices of misplaced points (K, 2), and of polygons that cover them or an inside that does not.

        A point is covered by an area if a ray from it crosses the area's edges an odd number of times.
        """
        row, number = self._covered(points_m)
        within = np.flatnonzero(self.side == WITHIN)
        key, count = row * len(self.names) + number, len(self.names)
        wrong = key[self.side[number] == OUTSIDE]
        if within.size:
            every = (np.arange(len(points_m))[:, None] * count + within).ravel()
            wrong = np.concatenate((wrong, np.setdiff1d(every, key)))
        row, number = np.divmod(np.sort(wrong), count)
        return row, number

    def _covered(self, points_m: Floats) -> tuple[Ints, Ints]:
        """Return the indices of points, and of the names of the areas that cover these points."""
        from shapely import linestrings
        end = np.stack((np.full(len(points_m), self.far_m + 1.0), points_m[:, 1]), axis=1)
        row, edge = self.tree.query(linestrings(np.stack((points_m, end), axis=1)))
        (x, y), a, b = points_m[row].T, self.start[edge], self.stop[edge]
        above = a.imag > y
        slanted = above != (b.imag > y)
        row, number, above, x, y, a, b = (one[slanted] for one in (row, self.owner[edge], above, x, y, a, b))
        to_left = (b.real - a.real) * (y - a.imag) - (b.imag - a.imag) * (x - a.real)
        crossed = (to_left > 0) != above
        key, times = np.unique((row * len(self.names) + number)[crossed], return_counts=True)
        row, number = np.divmod(key[times % 2 == 1], len(self.names))
        return row, number


def joined(parts: Sequence[Surroundings]) -> Surroundings:
    """Combine several surroundings into one, in the given order."""
    first = np.cumsum([0, *(len(one.names) for one in parts)])
    return Surroundings(tuple(name for one in parts for name in one.names),
                        _kept(np.concatenate([one.start for one in parts])),
                        _kept(np.concatenate([one.stop for one in parts])),
                        np.concatenate([one.owner + n for one, n in zip(parts, first[:-1], strict=True)]),
                        np.concatenate([one.side for one in parts]))


def _kept(values: Complexes) -> Complexes:
    values.setflags(write=False)
    return values


_KEPT: dict[int, tuple['ref[Venue]', Surroundings]] = {}  # the keys are ids because hashing a large venue is slow


def surroundings_of(venue: Venue) -> Surroundings:
    """Return the edges of a venue, which are cached as long as the venue exists."""
    known = _KEPT.get(id(venue))
    if known is None or known[0]() is not venue:
        key = id(venue)
        known = _KEPT[key] = ref(venue, lambda _: _KEPT.pop(key, None)), _laid_out(venue)
    return known[1]


def _laid_out(venue: Venue) -> Surroundings:
    """Return the edges of a venue in the order of the names."""
    lines = [([one.points_m], LINE) if isinstance(one, LineObstacle) else (one.rings_m, OUTSIDE)
             for one in venue.obstacles]
    lines += [([venue.inside], WITHIN)] if venue.inside is not None else []
    starts, stops, owner = [], [], []
    for n, (rings, side) in enumerate(lines):
        for points in rings:
            z = np.array(points).view(np.complex128)[:, 0]
            starts.append(z[:-1] if side == LINE else z)
            stops.append(z[1:] if side == LINE else np.roll(z, -1))
            owner.append(np.full(starts[-1].size, n))
    return Surroundings(venue.names, _kept(np.concatenate(starts)), _kept(np.concatenate(stops)),
                        np.concatenate(owner), np.array([side for _, side in lines]))
