"""One interval of places of a leading bench, and the proof that it keeps clear of benches behind it on all of it.

Two bounds stand beside each other (docs/contact.md). By the second-order bound the corners of one bench, seen from
another, leave the straight lines between their places at both ends by B h^2 / 8 at most: so an edge line that parts the
benches at both ends by more than that does in between. By the one-way bound gaps shrink by no more than benches go: it
holds where no B exists, close to a lock.
"""
from math import inf

from flint import acb, arb

from dragon_ros.verify.balls import above, below, hypot_above, size, up
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.motion import Handle, Turning, follow, leading
from dragon_ros.verify.posture import AXES, Dragon, Pose, Posture, about, overlap, separation
from dragon_ros.verify.segments import HALF, SpiralSegment
from dragon_ros.verify.track import Track

_ROUNDED = 1e-12        # of coordinates: more than floats can lose in the distance of two benches


class Overlap(Refused):
    """Two benches are proved to overlap at an end of an interval."""

    def __init__(self, benches: tuple[int, int], end: int) -> None:
        """Take the benches and the number of the end."""
        super().__init__(f'benches {benches[0]} and {benches[1]} overlap')
        self.benches, self.end = benches, end


class Interval:
    """The benches behind a leading one while its front handle goes between two places."""

    def __init__(self, track: Track, dragon: Dragon, lead: int, ends: tuple[Posture, Posture],
                 bend: float | None) -> None:
        """Take the dragon at both ends; ``bend`` is the largest curvature, or None where handles may turn back."""
        self._dragon, self._lead, self._ends, self._bend = dragon, lead, ends, bend
        self._benches, self._track = dragon.benches, track
        self._handles = [leading(track, ends[0].place(0), ends[1].place(0))]
        self._turnings: list[Turning] = []
        one, two = self._handles[0].low, self._handles[0].high
        self._length = size(two - one) if self._handles[0].segment is not None else self._handles[0].moved_m
        self._seen: dict[tuple[int, int], float] = {}
        self._outer: float | None = None

    def _handle(self, n: int) -> Handle:
        while len(self._handles) <= n:
            k = len(self._handles) - 1
            link = self._benches[self._lead + k].link
            handle, turning = follow(self._handles[k], self._ends, k, link, self._bend)
            self._handles.append(handle)
            self._turnings.append(turning)
        return self._handles[n]

    def _poses(self, n: int) -> tuple[Pose, Pose]:
        return self._ends[0].pose(n), self._ends[1].pose(n)

    def _moved_m(self, n: int) -> float:
        """Return how far a point of the n-th bench goes at most."""
        ways = self._handle(n).moved_m, self._handle(n + 1).moved_m
        shape = self._benches[self._lead + n]
        turned = shape.turned_m(ways, None)
        return up(max(ways) + (turned if self._bend is None else min(turned, shape.turned_m(ways, self._bend))))

    def clear(self, first: int, last: int) -> int | None:
        """Return the number behind of the nearest bench from which the leading one is not proved clear; None if of all.

        Those from ``first`` to ``last`` behind count, or up to the first beyond which all are out of reach.
        """
        n = first
        while n <= last:
            if self._out_of_reach(n):
                return None
            if not (self._far(n) or self._by_bending(n) or self._by_going(n)):
                self._refuse_overlap(n)
                return n
            n += 1
        return None

    def _refuse_overlap(self, n: int) -> None:
        for number, end in enumerate(self._ends):
            if overlap(end.pose(0), end.pose(n)):
                raise Overlap((self._lead, self._lead + n), number)

    def _out_of_reach(self, n: int) -> bool:
        """Return whether the n-th bench and all behind it lie outside of a circle that holds the leading one.

        They do where their handles go further and further out on the spiral that the track comes from: no point of a
        link is nearer to the centre than the root of r^2 - l^2 / 4, r the distance of its front handle.
        """
        handle, spiral = self._handle(n), self._track.segments[0]
        if handle.segment != 0 or not isinstance(spiral, SpiralSegment) or spiral.first is not None:
            return False
        r, link = below(spiral.b * handle.low), self._dragon.longest_links[self._lead + n]
        inner = (max(r * r - 0.25 * link * link, 0.0))**0.5 - self._dragon.overhangs_m[self._lead + n]
        return inner > self._outer_m(spiral) + _ROUNDED * (abs(r) + link)

    def _outer_m(self, spiral: SpiralSegment) -> float:
        """Return how far from a spiral's centre the leading bench is at most."""
        if self._outer is None:
            handles = self._handle(0), self._handle(1)
            self._outer = self._dragon.benches[self._lead].overhang_m + max(
                above(spiral.b * handle.high) if handle.segment == 0 else
                size_of(self._ends[0].point(k) - spiral.centre) + handle.moved_m for k, handle in enumerate(handles))
        return self._outer

    def _far(self, n: int) -> bool:
        """Return whether two benches are so far apart at one end that they cannot meet, by floats."""
        one, two = self._ends[0].pose(0), self._ends[0].pose(n)
        away = abs(one.near - two.near)
        reach = one.shape.arm_m + two.shape.arm_m + self._moved_m(0) + self._moved_m(n)
        return away > reach + one.unsure_m + two.unsure_m + _ROUNDED * (abs(one.near) + abs(two.near) + reach)

    def _by_bending(self, n: int) -> bool:
        """Return whether an edge line parts two benches at both ends by more than corners leave straight lines."""
        ends = [(end.pose(0), end.pose(n)) for end in self._ends]
        rough = [min(both) for both in zip(*(about(*pair) for pair in ends), strict=True)]
        best = sorted(range(len(AXES)), key=lambda k: -rough[k])
        for k in best[:3]:
            if rough[k] <= 0:
                return False
            sag = self._sag(n, AXES[k].other)
            if rough[k] > sag and all(below(separation(*pair, AXES[k])) > sag for pair in ends):
                return True
        return False

    def _sag(self, n: int, other: bool) -> float:
        """Return how far corners leave straight lines, in the frame of the leading bench or of the other one."""
        key = n, int(other)
        if key not in self._seen:
            frame = n if other else 0
            arm_m = self._benches[self._lead + (0 if other else n)].arm_m
            one, two = self._turning(0), self._turning(n)
            turning, rate = size(two.w - one.w), size(two.rate - one.rate)
            bend = self._middles(n, frame) + arm_m * hypot_above(rate, up(turning * turning))
            sag = up(bend * up(self._length * self._length) / 8)
            self._seen[key] = sag if sag == sag else inf
        return self._seen[key]

    def _turning(self, n: int) -> Turning:
        self._handle(n + 1)
        return self._turnings[n]

    def _middles(self, n: int, frame: int) -> float:
        """Return a bound of how the middles of two benches accelerate against each other, in the frame of one.

        About a common centre each handle accelerates little in that frame, and the bounds of all four are added. Else
        velocities and accelerations in the plane are.
        """
        turning = self._turning(frame)
        handles = [self._handle(k) for k in (0, 1, n, n + 1)]
        if handles[0].pole is not None and all(handle.pole == handles[0].pole for handle in handles):
            return up(0.5 * sum(_in_frame(handle, turning) for handle in handles))
        return self._in_plane(n, handles, turning)

    def _in_plane(self, n: int, handles: list[Handle], turning: Turning) -> float:
        front, rear, other_front, other_rear = (handle.speeds for handle in handles)
        velocity = HALF * (other_front.velocity + other_rear.velocity - front.velocity - rear.velocity)
        acceleration = HALF * (other_front.acceleration + other_rear.acceleration - front.acceleration
                               - rear.acceleration)
        away = self._middle(n) - self._middle(0)
        seen = acceleration - velocity * acb(0, 2 * turning.w) - away * acb(turning.w * turning.w, turning.rate)
        return size_of(seen)

    def _middle(self, n: int) -> acb:
        """Return all places of a bench's middle: its handles go no further from half way than half their ways."""
        one, two = self._poses(n)
        moved = 0.25 * (self._handle(n).moved_m + self._handle(n + 1).moved_m)
        unit = arb(0, up(moved))
        return HALF * (one.middle + two.middle) + acb(unit, unit)

    def _by_going(self, n: int) -> bool:
        """Return whether gaps at both ends exceed all that two benches go in between."""
        moved = self._moved_m(0) + self._moved_m(n)
        gaps = 0.0
        for end in self._ends:
            pair = end.pose(0), end.pose(n)
            rough = about(*pair)
            gaps += below(separation(*pair, AXES[rough.index(max(rough))]))
        return gaps > up(moved)


def size_of(value: acb) -> float:
    """Return a float that no absolute value in a complex ball exceeds."""
    return hypot_above(size(value.real), size(value.imag))


def _in_frame(handle: Handle, turning: Turning) -> float:
    """Return a bound of a handle's acceleration in a frame that turns about the centre of its segment."""
    rho, rho_1, rho_2, angle_1, angle_2 = handle.radial
    v = angle_1 - turning.w
    outwards, across = rho_2 - rho * (v * v), 2 * rho_1 * v + rho * (angle_2 - turning.rate)
    return hypot_above(size(outwards), size(across))
