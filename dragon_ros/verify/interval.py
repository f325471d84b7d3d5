"""One interval of positions of a leading bench, and the proof that it stays clear of the benches behind it.

There are three bounds (docs/contact.md). If the track between two benches is nearly straight, they cannot touch. By
the second-order bound, the corners of one bench in the frame of another deviate by at most B h^2 / 8 from the
straight lines between their positions at both ends. An edge line that separates the benches by more than that at both
ends therefore also separates them in between. By the first-order bound, a gap shrinks by at most the motion of the
benches. The first-order bound also holds close to a lock, where B does not exist.
"""
from collections.abc import Callable
from functools import cached_property
from math import asin, inf

from flint import acb, arb

from dragon_ros.verify.balls import ROUNDED, above, below, hypot_above, size, up
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.motion import (
    Handle,
    Motion,
    Postures,
    Turning,
    leading_handle,
    leading_motion,
    next_handle,
    next_motion,
)
from dragon_ros.verify.posture import AXES, Dragon, Pose, about, gap, overlap, separation
from dragon_ros.verify.segments import HALF, SpiralSegment
from dragon_ros.verify.track import Track

_OFTEN = 0.5            # above this ratio to the best separation, the leading bench's frame is tried first


class Overlap(Refused):
    """Two benches provably overlap at an end of an interval."""

    def __init__(self, benches: tuple[int, int], end: int) -> None:
        """Store the benches and the index of the end."""
        super().__init__(f'benches {benches[0]} and {benches[1]} overlap')
        self.benches, self.end = benches, end


class Interval:
    """The benches behind a leading bench while its front handle moves between two positions."""

    def __init__(self, track: Track, dragon: Dragon, lead: int, ends: Postures, bend: float | None) -> None:
        """Store the postures at both ends; ``bend`` is the largest curvature, or None if handles may turn back."""
        self._track, self._dragon, self._lead, self._ends, self._bend = track, dragon, lead, ends, bend
        self._benches = dragon.benches
        first = leading_handle(track, ends)
        self._handles, self._motions = [first], [leading_motion(first, ends)]
        self._turnings: list[Turning] = []
        self._moved: list[float] = []
        self._in_lead: list[float] = []
        self._turns, self._between_m = list[float](), list[float]()     # cumulative sums up to each bench
        self._length = size(first.high - first.low) if first.segment is not None else first.moved_m
        self._outer: float | None = None
        self.tested = 1

    def clear(self, first: int, last: int) -> int | None:
        """Return the offset of the nearest bench that is not proved clear of the leading bench, or None.

        The benches at the offsets ``first`` to ``last`` behind the leading bench are tested. The test ends early at a
        bench that is out of reach together with all benches behind it. Raises Overlap if benches overlap at an end, and
        Refused if a handle cannot be placed.
        """
        for n in range(first, last + 1):
            self.tested += 1
            if self._straight(n):
                continue
            if self._out_of_reach(n):
                return None
            if not (self._far(n) or self._by_bending(n) or self._by_going(n)):
                self._refuse_overlap(n)
                return n
        return None

    def _refuse_overlap(self, n: int) -> None:
        for number, end in enumerate(self._ends):
            if overlap(end.pose(0), end.pose(n)):
                raise Overlap((self._lead, self._lead + n), number)

    def _handle(self, n: int) -> Handle:
        while len(self._handles) <= n:
            k = len(self._handles) - 1
            link = self._benches[self._lead + k].link
            self._handles.append(next_handle(self._handles[k], self._ends, k, link, self._bend is None))
        return self._handles[n]

    def _motion(self, n: int) -> Motion:
        while len(self._motions) <= n:
            k = len(self._motions) - 1
            link = self._benches[self._lead + k].link
            motion, turning = next_motion(self._motions[k], self._handle(k + 1), self._ends, k, link)
            self._motions.append(motion)
            self._turnings.append(turning)
        return self._motions[n]

    def _turning(self, n: int) -> Turning:
        self._motion(n + 1)
        return self._turnings[n]

    def _moved_m(self, n: int) -> float:
        """Return an upper bound on the distance that a point of the n-th bench moves."""
        while len(self._moved) <= n:
            k = len(self._moved)
            ways = self._handle(k).moved_m, self._handle(k + 1).moved_m
            self._moved.append(up(max(ways) + self._benches[self._lead + k].turned_m(ways, self._bend)))
        return self._moved[n]

    def _straight(self, n: int) -> bool:
        """Return whether the track bends so little that the links between two benches lead away from the leading bench.

        The directions of two links differ by at most the total angle that the links in between span on the tightest
        bend (docs/contact-lemmas.md).
        """
        turned = self._turned(n)
        if not turned < 1:
            return False
        lead, other = (self._benches[self._lead + k] for k in (0, n))
        away_m = self._between_m[n] * (1 - 0.5 * turned * turned) * (1 - ROUNDED * n)
        return away_m > up(lead.over_m + other.over_m + other.sizes[1] * turned)

    def _turned(self, n: int) -> float:
        """Return the largest turn of the track along the links up to the n-th bench; also accumulate the lengths."""
        while len(self._turns) <= n:
            k = len(self._turns)
            half = up(0.5 * self._tightest * self._benches[self._lead + k].link.near)
            self._turns.append(up((self._turns[-1] if k else 0.0) + 2 * asin(half)) if half < 1 else inf)
            self._between_m.append(self._between_m[-1] + self._benches[self._lead + k - 1].link.near if k > 1 else 0.0)
        return self._turns[n]

    @cached_property
    def _tightest(self) -> float:
        """The largest curvature under the leading bench and the benches behind it; infinite if they may turn back.

        If the track begins with an inward spiral, this is the curvature at the front handle, because the curvature
        decreases towards the tail.
        """
        handle, bend = self._handle(0), inf if self._bend is None else self._bend
        segment = self._track.segments[0]
        if handle.segment != 0 or not isinstance(segment, SpiralSegment) or segment.first is not None:
            return bend
        return above(abs(segment.curvature(handle.low)))

    def _out_of_reach(self, n: int) -> bool:
        """Return whether the n-th bench and all benches behind it lie outside a circle around the leading bench.

        This requires that the first segment is a spiral on which the radius increases from handle to handle. No point
        of a link is then closer to the centre than the root of r^2 - l^2 / 4, where r is the distance of its front
        handle from the centre.
        """
        handle, spiral = self._handle(n), self._track.segments[0]
        if handle.segment != 0 or not isinstance(spiral, SpiralSegment) or spiral.first is not None:
            return False
        r, link = below(spiral.b * handle.low), self._dragon.longest_links[self._lead + n]
        inner = max(r * r - 0.25 * link * link, 0.0)**0.5 - self._dragon.overhangs_m[self._lead + n]
        return bool(inner > self._outer_m(spiral) + ROUNDED * (abs(r) + link))

    def _outer_m(self, spiral: SpiralSegment) -> float:
        """Return the largest distance of the leading bench from the centre of a spiral."""
        if self._outer is None:
            handles = self._handle(0), self._handle(1)
            self._outer = self._benches[self._lead].overhang_m + max(
                above(spiral.b * handle.high) if handle.segment == 0 else
                size_of(self._ends[0].point(k) - spiral.centre) + handle.moved_m for k, handle in enumerate(handles))
        return self._outer

    def _far(self, n: int) -> bool:
        """Return whether, in floats, two benches are too far apart at one end to meet in the interval."""
        one, two = self._ends[0].pose(0), self._ends[0].pose(n)
        away = abs(one.near - two.near)
        reach = one.shape.arm_m + two.shape.arm_m + self._moved_m(0) + self._moved_m(n)
        return away > reach + _unsure_m(one, two, reach)

    def _by_bending(self, n: int) -> bool:
        """Return whether an edge line separates two benches at both ends by more than the deviation of the corners."""
        return parted([(end.pose(0), end.pose(n)) for end in self._ends], lambda other: self._sag(n, other))

    def _sag(self, n: int, other: bool) -> float:
        """Return how far corners deviate from straight lines in the frame of the leading or of the other bench."""
        arm_m = self._benches[self._lead + (0 if other else n)].arm_m
        one, two = self._turning(0), self._turning(n)
        turning, rate = size(two.w - one.w), size(two.rate - one.rate)
        bend = self._middles(n, other) + arm_m * hypot_above(rate, up(turning * turning))
        return up(bend * up(self._length * self._length) / 8)

    def _middles(self, n: int, other: bool) -> float:
        """Return a bound on the relative acceleration of the midpoints of two benches in the frame of one bench.

        If all four handles turn about a common centre, each handle accelerates little in that frame, and the bounds
        of the handles are added. Otherwise, velocities and accelerations in the plane are combined.
        """
        pole = self._handle(0).pole
        if pole is None or any(self._handle(k).pole != pole for k in (1, n, n + 1)):
            return self._in_plane(n, self._turning(n if other else 0))
        if other:
            return up(0.5 * sum(_in_frame(self._motion(k), self._turning(n)) for k in (0, 1, n, n + 1)))
        return up(0.5 * sum(self._in_lead_frame(k) for k in (0, 1, n, n + 1)))

    def _in_lead_frame(self, k: int) -> float:
        """Return a bound on a handle's acceleration in the leading bench's frame; infinite if its centre differs."""
        while len(self._in_lead) <= k:
            m = len(self._in_lead)
            same = self._handle(m).pole == self._handle(0).pole
            self._in_lead.append(_in_frame(self._motion(m), self._turning(0)) if same else inf)
        return self._in_lead[k]

    def _in_plane(self, n: int, turning: Turning) -> float:
        """Return a bound on the relative acceleration of the midpoints, from motions in the plane."""
        front, rear, other_front, other_rear = (self._motion(k).speeds for k in (0, 1, n, n + 1))
        velocity = HALF * (other_front.velocity + other_rear.velocity - front.velocity - rear.velocity)
        acceleration = HALF * (other_front.acceleration + other_rear.acceleration - front.acceleration
                               - rear.acceleration)
        away = self._middle(n) - self._middle(0)
        seen = acceleration - velocity * acb(0, 2 * turning.w) - away * acb(turning.w * turning.w, turning.rate)
        return size_of(seen)

    def _middle(self, n: int) -> acb:
        """Return a ball for a bench's midpoint: the mean of both ends, to within a quarter of its handles' travel."""
        one, two = (end.pose(n).middle for end in self._ends)
        unit = arb(0, up(0.25 * (self._handle(n).moved_m + self._handle(n + 1).moved_m)))
        return HALF * (one + two) + acb(unit, unit)

    def _by_going(self, n: int) -> bool:
        """Return whether the sum of the gaps at both ends exceeds the motion of both benches in between."""
        return kept_apart([(end.pose(0), end.pose(n)) for end in self._ends], self._moved_m(0) + self._moved_m(n))


def parted(ends: list[tuple[Pose, Pose]], sag: Callable[[bool], float]) -> bool:
    """Return whether an edge line separates two benches at both ends by more than the deviation of the corners.

    ``sag(other)`` is a bound on this deviation in the frame of the first or of the other bench.
    """
    rough = [min(both) for both in zip(*(about(*pair) for pair in ends), strict=True)]
    half = len(AXES) // 2
    lead, other = (max(range(*part), key=rough.__getitem__) for part in ((0, half), (half, len(AXES))))
    for k in (lead, other) if rough[lead] > _OFTEN * rough[other] else (other, lead):
        if rough[k] > 0:
            most = sag(AXES[k].other)
            if rough[k] > most and _exceeds(ends, k, rough[k], most):
                return True
    return False


def kept_apart(ends: list[tuple[Pose, Pose]], moved_m: float) -> bool:
    """Return whether the sum of the gaps of two benches at both ends exceeds the motion of both in between."""
    return sum(below(gap(*pair)) for pair in ends) > up(moved_m)


def _exceeds(ends: list[tuple[Pose, Pose]], k: int, rough: float, sag: float) -> bool:
    """Return whether the separations at both ends exceed a bound, using floats if decisive and balls otherwise."""
    if rough > sag + max(_unsure_m(*pair, sag) for pair in ends):
        return True
    return all(below(separation(*pair, AXES[k])) > sag for pair in ends)


def _unsure_m(one: Pose, two: Pose, reach: float) -> float:
    """Return a bound on the rounding errors, in floats, of a distance or a separation of two benches."""
    lengths = abs(one.near) + abs(two.near) + one.shape.arm_m + two.shape.arm_m
    return (ROUNDED * (lengths + reach) + 4 * (one.unsure_m + two.unsure_m) + 4 * (one.unsure + two.unsure) * lengths)


def size_of(value: acb) -> float:
    """Return a float that is an upper bound on the absolute values in a complex ball."""
    return hypot_above(size(value.real), size(value.imag))


def _in_frame(motion: Motion, turning: Turning) -> float:
    """Return a bound on a handle's acceleration in a frame that turns about the centre of its segment."""
    rho, rho_1, rho_2, angle_1, angle_2 = motion.radial
    v = angle_1 - turning.w
    outwards, across = rho_2 - rho * (v * v), 2 * rho_1 * v + rho * (angle_2 - turning.rate)
    return hypot_above(size(outwards), size(across))
