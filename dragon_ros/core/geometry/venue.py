"""The edges of a venue, and the signed gaps of benches to them.

An edge is a rectangle of zero width, so ``signed_distance`` gives its gap to a bench: their distance or, if they
overlap, minus the shortest move that separates them. A bench that starts outside an obstacle and never meets one of its
edges stays outside, and one that starts within the inside and never meets its edges stays within. So the edges alone
determine contact.
"""
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple
from weakref import ref

import numpy as np

from dragon_ros.core.geometry.contacts import OBSTACLE, Closeness, ObstacleTouch
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import Witness, seen_from, signed_gap, witness
from dragon_ros.core.numerics.types import Array, Complexes, Floats, Ints, read_only
from dragon_ros.core.venue import INSIDE, LineObstacle, Points, PolygonObstacle, Venue

if TYPE_CHECKING:
    from shapely import STRtree

_FIRST_REACH_M = 1.0    # search radius for the nearest edge; it doubles until an edge is found
_FARTHEST_M = 4e9       # no edge is further from a bench: coordinates are below 1e9 m


class Nearest(NamedTuple):
    """The smallest signed gap in metres of some benches to a venue, with its bench and its edge."""

    gap_m: float
    bench: int
    edge: int


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Edges (E,) of a venue from ``start`` to ``stop``, and the index of the name to which each belongs (``owner``).

    ``areas_m`` has the indices of the names of polygons, and their rings; ``inside`` is the index of the inside, if
    there is one.
    """

    names: tuple[str, ...]
    start: Complexes
    stop: Complexes
    owner: Ints
    areas_m: tuple[tuple[int, tuple[Points, ...]], ...]

    @property
    def inside(self) -> int | None:
        """The index of the inside among the names."""
        return len(self.names) - 1 if self.names[-1] == INSIDE else None

    @cached_property
    def middle(self) -> Complexes:
        """The middles of the edges (E,)."""
        return _kept(0.5 * (self.start + self.stop))

    @cached_property
    def half_m(self) -> Floats:
        """Half the lengths of the edges (E,)."""
        return read_only(0.5 * np.abs(self.stop - self.start))

    @cached_property
    def axis(self) -> Complexes:
        """The directions of the edges (E,)."""
        way = self.stop - self.start
        return _kept(way / np.abs(way))

    def rectangle(self, benches: Benches, bench: int, edge: int) -> Benches:
        """Return a bench, and an edge as a rectangle of zero width."""
        middle, axis = (np.array([[one[edge].real, one[edge].imag]]) for one in (self.middle, self.axis))
        one = slice(bench, bench + 1)
        return Benches(np.concatenate((benches.centre[one], middle)), np.concatenate((benches.axis[one], axis)),
                       np.append(benches.half_length[one], self.half_m[edge]), np.append(benches.half_width[one], 0.0))

    def touch(self, benches: Benches, bench: int, edge: int) -> tuple[ObstacleTouch, Witness]:
        """Return the contact of a bench with an edge, and its witness, in which the obstacle has the index OBSTACLE."""
        seen = witness(self.rectangle(benches, bench, edge), 0, 1)
        start, stop = ((float(end[edge].real), float(end[edge].imag)) for end in (self.start, self.stop))
        numbers = [bench, OBSTACLE]
        own = seen.owner == 1       # a corner of the edge; its axis goes from start to stop
        corner = (stop if seen.corner.startswith('front') else start) if own else None
        seen = replace(seen, owner=numbers[seen.owner], other=numbers[seen.other],
                       corner='corner' if own else seen.corner, edge=seen.edge if own else 'edge')
        return ObstacleTouch(self.names[self.owner[edge]], (start, stop), corner), seen

    @cached_property
    def far_m(self) -> float:
        """The largest coordinate."""
        return float(np.max(np.abs(np.concatenate((self.start, self.stop)).view(np.float64))))

    @cached_property
    def tree(self) -> 'STRtree':
        """A spatial index of the edges, by boxes."""
        from shapely import STRtree, linestrings
        ends = np.stack((self.start, self.stop), axis=1)
        return STRtree(linestrings(np.stack((ends.real, ends.imag), axis=-1)))

    def in_boxes(self, low: Floats, high: Floats) -> tuple[Ints, Ints]:
        """Return the indices of boxes (M, 2), and of edges that may reach into them."""
        from shapely import box
        found = self.tree.query(box(*low.T, *high.T))
        return found[0], found[1]

    def near(self, benches: Benches, reach_m: Floats | float) -> tuple[Ints, Ints]:
        """Return benches and edges: all pairs within a distance of each other, and some more."""
        corners = benches.corners
        reach = np.broadcast_to(np.asarray(reach_m), corners.shape[:1])[:, None]
        return self.in_boxes(corners.min(axis=1) - reach, corners.max(axis=1) + reach)

    def gaps(self, benches: Benches, bench: Ints, edge: Ints) -> Floats:
        """Return the signed gaps (M,) in metres of benches to edges."""
        centre, axis = (one.view(np.complex128)[..., 0] for one in (benches.centre, benches.axis))
        return self.gaps_of(centre[bench], axis[bench], (benches.half_length[bench], benches.half_width[bench]), edge)

    def gaps_of(self, centre: Complexes, axis: Complexes, half: tuple[Floats | float, Floats | float],
                edge: Ints) -> Floats:
        """Return the signed gaps (M,) of rectangles with half sizes to edges (M,)."""
        length = self.half_m[edge]
        return signed_gap(seen_from((centre, self.middle[edge]), (axis, self.axis[edge]),
                                    half, (length, np.zeros_like(length))))

    def nearest(self, benches: Benches) -> Nearest:
        """Return the smallest gap of the benches; in a tie, that of the first bench."""
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
        """Return benches, indices of names, and their smallest gaps (K,): all pairs within a reach, and some more."""
        bench, edge = self.near(benches, reach_m)
        pair, index = np.unique(bench * len(self.names) + self.owner[edge], return_inverse=True)
        least: Floats = np.full(pair.size, np.inf)
        np.minimum.at(least, index, self.gaps(benches, bench, edge))
        return *np.divmod(pair, len(self.names)), least

    def together(self, found: Closeness, benches: Benches, touch_m: float) -> Closeness:
        """Return the closeness of benches to each other and to obstacles, which are numbered after the benches.

        Gaps up to ``touch_m`` count as contact.
        """
        nearest, count = self.nearest(benches), len(benches.half_length)
        bench, number, gap_m = self.closest(benches, touch_m)
        met = gap_m <= touch_m
        i, j = (np.concatenate(pair) for pair in ((found.i, bench[met]), (found.j, count + number[met])))
        gap = np.concatenate((found.gap_m, gap_m[met] + 0.0))       # no negative zero
        order = np.argsort(gap, kind='stable')
        if nearest.gap_m < found.clearance_m:
            found = replace(found, clearance_m=nearest.gap_m + 0.0,
                            closest=(nearest.bench, count + int(self.owner[nearest.edge])))
        return replace(found, i=i[order], j=j[order], gap_m=gap[order])

    def points(self, benches: Benches, bench: Ints, number: Ints) -> Floats:
        """Return where benches touch obstacles (K, 2), by the indices of their names."""
        return np.array([self._point(benches, *pair) for pair in zip(bench.tolist(), number.tolist(), strict=True)])

    def _point(self, benches: Benches, bench: int, number: int) -> tuple[float, float]:
        edge = np.flatnonzero(self.owner == number)
        deepest = int(edge[np.argmin(self.gaps(benches, np.full(edge.size, bench), edge))])
        return self.touch(benches, bench, deepest)[1].point_m

    def gaps_to(self, benches: Benches, bench: Ints, number: Ints) -> Floats:
        """Return the gaps (K,) of benches to whole obstacles, by the indices of their names."""
        out: Floats = np.array([np.min(self.gaps(benches, np.full(edge.size, one), edge)) for one, n in zip(
            bench.tolist(), number.tolist(), strict=True) for edge in [np.flatnonzero(self.owner == n)]])
        return out

    def touching(self, benches: Benches) -> tuple[Ints, Ints, Floats]:
        """Return the benches that touch, the index of the name that each touches, and their smallest gaps (K,).

        The deepest come first.
        """
        bench, number, gap_m = self.closest(benches, 0.0)
        met = np.flatnonzero(gap_m <= 0)
        order = met[np.lexsort((bench[met] * len(self.names) + number[met], gap_m[met]))]
        return bench[order], number[order], gap_m[order]

    @cached_property
    def _areas(self) -> tuple[Array, Ints]:
        """The polygons, and the index of the name of each."""
        from shapely import Polygon
        areas = np.array([Polygon(ring, holes) for _, (ring, *holes) in self.areas_m], dtype=object)
        return areas, np.array([number for number, _ in self.areas_m], dtype=np.int64)

    def misplaced(self, x: float, y: float) -> int | None:
        """Return the index of the first polygon that covers a point, or of the inside if it does not cover it."""
        from shapely import contains_xy
        areas, number = self._areas
        wrong: Array = contains_xy(areas, x, y) if areas.size else np.empty(0, dtype=bool)
        wrong = wrong ^ (number == self.inside)
        return int(number[wrong][0]) if np.any(wrong) else None


def _kept(values: Complexes) -> Complexes:
    values.setflags(write=False)
    return values


_KEPT: dict[int, tuple['ref[Venue]', Surroundings]] = {}  # by id: hashing a large venue is slow


def surroundings_of(venue: Venue) -> Surroundings:
    """Return the edges of a venue; they are cached as long as the venue exists."""
    known = _KEPT.get(id(venue))
    if known is None or known[0]() is not venue:
        key = id(venue)
        known = _KEPT[key] = ref(venue, lambda _: _KEPT.pop(key, None)), _laid_out(venue)
    return known[1]


def _laid_out(venue: Venue) -> Surroundings:
    """Return a venue's edges in the order of its names."""
    areas = [(n, one.rings_m) for n, one in enumerate(venue.obstacles) if isinstance(one, PolygonObstacle)]
    areas += [(len(venue.obstacles), (venue.inside,))] if venue.inside is not None else []
    lines = [(ring, True, n) for n, rings in areas for ring in rings]
    lines += [(one.points_m, False, n) for n, one in enumerate(venue.obstacles) if isinstance(one, LineObstacle)]
    starts, stops, owner = [], [], []
    for points, closed, n in sorted(lines, key=lambda line: line[2]):
        z = np.array(points).view(np.complex128)[:, 0]
        starts.append(z if closed else z[:-1])
        stops.append(np.roll(z, -1) if closed else z[1:])
        owner.append(np.full(starts[-1].size, n))
    return Surroundings(venue.names, _kept(np.concatenate(starts)), _kept(np.concatenate(stops)),
                        np.concatenate(owner), tuple(areas))
