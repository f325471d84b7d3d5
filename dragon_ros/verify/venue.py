"""Prove, in balls, that benches stay clear of a venue's edges and that the dragon starts on the correct side.

An edge is a rectangle of zero width. The bounds that separate two benches (``interval``) also separate a bench and an
edge at rest. In the frame of the edge, the middle and the rotation of the bench determine the acceleration of its
corners. In the frame of the bench, the ends of the edge have the acceleration of points that are at rest in the plane.
Only the part of an edge that the bench can reach matters; the rest is further away than the bench moves. Benches are
linked, so if no bench meets an edge, all benches stay on one side of every outline.
"""
from cmath import rect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, floor

from flint import acb, arb

from dragon_ros.verify.balls import ROUNDED, exact, hypot_above, size, up
from dragon_ros.verify.cover import Cover, Stuck, Way
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.interval import Interval, kept_apart, parted, size_of
from dragon_ros.verify.posture import Bench, Dragon, Pose, Posture, about, overlap, spread
from dragon_ros.verify.reading import Obstacle, Venue
from dragon_ros.verify.segments import HALF, ZERO, Link

_CELL = 4.0         # side of a cell of the index, relative to the longest bench
_MOST_CELLS = 1000  # largest number of cells along an edge; longer edges are always checked
_REACH = 2.0        # intervals in which a bench moves further, relative to the longest bench, are cut without a check
_NEAR_M = 1e-3      # edges of an obstacle this close to a bench may touch it
_INSIDE_HEAD = [rect(0.5, n) for n in range(6)]     # points of a bench, relative to its half length and half width


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge of an obstacle between two points, which are exact floats."""

    name: str
    start: complex
    stop: complex

    def near(self, point: complex, reach_m: float) -> Pose | None:
        """Return a part that contains all points of the edge within a distance of a given point, or None.

        A point of the edge is at least as far from the given point as from the foot of the perpendicular.
        """
        way, seen = self.stop - self.start, point - self.start
        length = abs(way)
        reach_m += ROUNDED * (abs(point) + abs(self.start) + abs(self.stop))
        along, aside = ((seen * way.conjugate()).real / length, abs((seen * way.conjugate()).imag) / length)
        low, high = max(0.0, (along - reach_m) / length), min(1.0, (along + reach_m) / length)
        return None if aside > reach_m or low > high else self._part(low, high)

    def _part(self, low: float, high: float) -> Pose:
        """Return the part between two fractions of the edge."""
        start, stop = _exact(self.start), _exact(self.stop)
        way = stop - start
        one, two = start + way * exact(low), start + way * exact(high)
        length, middle = abs(way), (one + two) * HALF
        axis = way / length
        shape = Bench(Link(ZERO, 0.0), HALF * (exact(high) - exact(low)) * length, ZERO)
        return Pose(shape, middle, axis, complex(middle), complex(axis), spread(middle), spread(axis))


def _exact(z: complex) -> acb:
    return acb(exact(z.real), exact(z.imag))


class Edges:
    """All edges of a venue, indexed by the cells of a grid through which they pass."""

    def __init__(self, venue: Venue, longest_m: float) -> None:
        """Index a venue; ``longest_m`` is the length of the longest bench."""
        self.every = [Edge(one.name, *pair) for one in venue.all for line in one.lines for pair in _pairs(line)]
        self._cell, self._long = _CELL * longest_m, list[Edge]()
        self._cells: dict[tuple[int, int], list[Edge]] = {}
        for edge in self.every:
            count = ceil(abs(edge.stop - edge.start) / self._cell)
            if count > _MOST_CELLS:
                self._long.append(edge)
                continue
            for cell in {cell for n in range(count) for cell in self._passed(edge, n / count, (n + 1) / count)}:
                self._cells.setdefault(cell, []).append(edge)

    def _passed(self, edge: Edge, low: float, high: float) -> Iterator[tuple[int, int]]:
        """Return the cells through which a part of an edge may pass."""
        one, two = (edge.start + share * (edge.stop - edge.start) for share in (low, high))
        return self._within(min(one.real, two.real), max(one.real, two.real), min(one.imag, two.imag),
                            max(one.imag, two.imag))

    def _within(self, left: float, right: float, bottom: float, top: float) -> Iterator[tuple[int, int]]:
        """Yield the cells of a box that is widened by the rounding error."""
        margin = ROUNDED * (abs(left) + abs(right) + abs(bottom) + abs(top) + self._cell)
        for i in range(floor((left - margin) / self._cell), floor((right + margin) / self._cell) + 1):
            for j in range(floor((bottom - margin) / self._cell), floor((top + margin) / self._cell) + 1):
                yield i, j

    def near(self, point: complex, reach_m: float) -> list[Edge]:
        """Return the edges that may be within a distance of a point."""
        x, y = point.real, point.imag
        found = {id(edge): edge for cell in self._within(x - reach_m, x + reach_m, y - reach_m, y + reach_m)
                 for edge in self._cells.get(cell, ())}
        return [*found.values(), *self._long]

    def met(self, bench: Pose, name: str) -> list[Pose]:
        """Return the edges of an obstacle that a bench may touch or be close to, nearest first."""
        reach_m = 2 * (bench.shape.arm_m + bench.unsure_m + _NEAR_M)
        parts = [part for edge in self.every if edge.name == name and (part := edge.near(bench.near, reach_m))]
        return sorted(parts, key=lambda part: max(about(bench, part)))


def _pairs(line: Sequence[tuple[float, float]]) -> list[tuple[complex, complex]]:
    return list(pairwise(complex(x, y) for x, y in line))


class SweptBench(Interval):
    """The leading bench of an interval, which is to be proved clear of edges."""

    def meets(self, edges: Edges, reach_m: float) -> str | None:
        """Return the name of the obstacle of the first edge that is not proved clear of the bench, or None.

        Raises Met if the bench and an edge overlap at an end.
        """
        moved_m = self._moved_m(0)
        if not moved_m <= reach_m:
            return 'nearby obstacles'
        pose = self._ends[0].pose(0)
        reach_m = up(pose.shape.arm_m + moved_m) + pose.unsure_m
        for edge in edges.near(pose.near, reach_m):
            part = edge.near(pose.near, reach_m)
            self.tested += part is not None
            if part and not self._is_clear(part, moved_m):
                for number, end in enumerate(self._ends):
                    if overlap(end.pose(0), part):
                        raise Met(edge.name, number)
                return repr(edge.name)
        return None

    def _is_clear(self, part: Pose, moved_m: float) -> bool:
        """Return whether the bench is proved clear of an edge by the second-order or by the first-order bound."""
        ends = [(end.pose(0), part) for end in self._ends]
        return parted(ends, lambda other: self._sag_at(part, other)) or kept_apart(ends, moved_m)

    def _sag_at(self, part: Pose, other: bool) -> float:
        """Return how far the corners of the bench (or the ends of the edge) deviate from lines in the other's frame."""
        front, rear, turning = self._motion(0).speeds, self._motion(1).speeds, self._turning(0)
        acceleration = HALF * (front.acceleration + rear.acceleration)
        turned = hypot_above(size(turning.rate), up(size(turning.w) * size(turning.w)))
        if other:
            bend = size_of(acceleration) + self._benches[self._lead].arm_m * turned
        else:
            velocity = HALF * (front.velocity + rear.velocity)
            away = part.middle - self._middle(0)
            seen = acceleration - velocity * acb(0, 2 * turning.w) + away * acb(turning.w * turning.w, turning.rate)
            bend = size_of(seen) + part.shape.arm_m * turned
        return up(up(bend) * up(self._length * self._length) / 8)


class Met(Refused):
    """The bench provably overlaps an edge at an end of an interval."""

    def __init__(self, name: str, end: int) -> None:
        """Store the obstacle and the index of the end."""
        super().__init__(f'it overlaps {name!r}')
        self.name, self.end = name, end


class ObstacleCover(Cover):
    """Proves all benches clear of the edges of a venue, treating benches of equal length together."""

    edges: Edges

    def _stuck(self, way: Way, low: arb, high: arb, begin: Posture, end: Posture) -> Stuck | None:
        """Return why benches of equal length are not proved clear of obstacles between two positions, or None."""
        placed = begin.placed + end.placed
        interval = SweptBench(self._track, self._dragon, way.lead, (begin, end), self._bend)
        try:
            name = interval.meets(self.edges, _REACH * self._dragon.longest_m)
        except Met as found:
            place = (low, high)[found.end]
            raise Refused(f'a bench of {self._dragon.lengths_m[way.lead]!r} m overlaps {found.name!r} when its front '
                          f'handle is {float(place):.12g} m along the track') from None
        finally:
            self.budget.spend(begin.placed + end.placed - placed + interval.tested)
            self.budget.check()
        length_m = self._dragon.lengths_m[way.lead]
        return None if name is None else Stuck(f'a bench of {length_m!r} m and {name} could not be proved to be apart')


def ways_by_length(dragon: Dragon, places: Sequence[tuple[arb, arb]]) -> list[Way]:
    """Return the positions of the benches of each length; the pose of a bench depends only on length and position."""
    sets: dict[float, list[int]] = {}
    for bench, length_m in enumerate(dragon.lengths_m):
        sets.setdefault(length_m, []).append(bench)
    return [Way(benches[0], tuple((bench, places[bench]) for bench in benches)) for benches in sets.values()]


def check_sides(venue: Venue, head: Pose) -> None:
    """Reject a venue in which the dragon starts within an obstacle or outside the inside polygon.

    One point of the head is checked: if no bench touches an edge, all benches are on the same side as this point.
    """
    areas = [one for one in venue.all if one.area]
    for inside in _INSIDE_HEAD:
        lever = acb(head.shape.half_length * exact(inside.real), head.shape.half_width * exact(inside.imag))
        point = head.middle + head.axis * lever
        sides = [_covers(one, point) for one in areas]
        if None not in sides:
            for one, covered in zip(areas, sides, strict=True):
                if covered != (one is venue.inside):
                    raise Refused(f'scene.venue: the run starts {"within" if covered else "outside"} {one.name!r}')
            return
    raise Refused('scene.venue: it could not be proved on which side of an outline the run starts')


def _covers(area: Obstacle, point: acb) -> bool | None:
    """Return whether a point lies within an odd number of an area's rings; None if its ball is too wide to tell."""
    odd = False
    for line in area.lines:
        for one, two in _pairs(line):
            over = [_over(end, point) for end in (one, two)]
            if None in over:
                return None
            if over[0] == over[1]:
                continue
            start, way = _exact(one), _exact(two) - _exact(one)
            cross = way.real * (point.imag - start.imag) - way.imag * (point.real - start.real)
            if not (cross > 0 or cross < 0):
                return None
            odd ^= bool(cross > 0) == bool(over[1])     # the edge passes to the right of the point
    return odd


def _over(end: complex, point: acb) -> bool | None:
    """Return whether a corner is above a point; None if the ball of the point is too wide to decide this."""
    y = exact(end.imag)
    return True if y > point.imag else False if y < point.imag else None
