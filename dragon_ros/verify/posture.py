"""The benches of a dragon in balls, for one position of a front handle, and the separation of two benches."""
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from math import sqrt
from typing import NamedTuple

from flint import acb, arb

from dragon_ros.verify.balls import above, exact, hypot_above, up
from dragon_ros.verify.reading import Scene
from dragon_ros.verify.segments import HALF, Link
from dragon_ros.verify.track import Place, Track


class Axis(NamedTuple):
    """The normal of an edge: its bench (first or other), its direction, and the side on which the other bench lies."""

    other: bool
    across: bool
    side: int


AXES = [Axis(other, across, side) for other in (False, True) for across in (False, True) for side in (1, -1)]


@dataclass(frozen=True, eq=False)
class Bench:
    """The shape of a bench in metres: link, half length and half width in balls, and bounds in floats."""

    link: Link
    half_length: arb
    half_width: arb

    @cached_property
    def overhang_m(self) -> float:
        """Largest distance of a point of the bench from its link."""
        return hypot_above(above(self.half_length - HALF * self.link.length), above(self.half_width))

    @cached_property
    def over_m(self) -> float:
        """How far the bench extends beyond its handles, along its link."""
        return max(above(self.half_length - HALF * self.link.length), 0.0)

    @cached_property
    def arm_m(self) -> float:
        """Largest distance of a point of the bench from its middle."""
        return hypot_above(above(self.half_length), above(self.half_width))

    @cached_property
    def lever(self) -> float:
        """The largest error of a corner, relative to the position error of a solver's handles.

        If s is the ratio of length to link, it is max(s, 2 / sqrt(4 - s^2)) plus the width divided by the link
        (docs/contact.md, what the floats are worth).
        """
        length, width = 2 * self.sizes[0], 2 * self.sizes[1]
        ratio = length / self.link.near
        return max(ratio, 2 / sqrt(4 - min(ratio * ratio, 2.0))) + width / self.link.near

    @cached_property
    def sizes(self) -> tuple[float, float]:
        """Approximate half length and half width."""
        return float(self.half_length), float(self.half_width)

    def turned_m(self, moved_m: tuple[float, float], bend: float | None) -> float:
        """Return an upper bound on how far the rotation of the link moves a point while the handles move.

        The link turns by at most the sum of both handles' motions along the track divided by the link's length and,
        if no link can lock, by at most half the curvature times that sum (docs/contact.md, lemma 3).
        """
        ways = moved_m[0] + moved_m[1]
        turned = ways / self.link.near
        return up(self.overhang_m * (turned if bend is None else min(turned, 0.5 * bend * ways)))


class Dragon:
    """All benches from the head on (one object per length), and the largest sizes from each bench on."""

    def __init__(self, scene: Scene) -> None:
        """Read the lengths, the width and the inset from a scene."""
        width, links = HALF * exact(scene.width_m), scene.links_m
        known = {length_m: Bench(Link(exact(link), float(link)), HALF * exact(length_m), width)
                 for length_m, link in zip(scene.lengths_m, links, strict=True)}
        self.lengths_m = scene.lengths_m
        self.benches = [known[length_m] for length_m in scene.lengths_m]
        self.longest_m = max(scene.lengths_m)
        self.longest_links = _largest_from([bench.link.near for bench in self.benches])
        self.overhangs_m = _largest_from([bench.overhang_m for bench in self.benches])


def _largest_from(values: list[float]) -> list[float]:
    """Return, for each index, the largest value from this index on."""
    return list(accumulate(reversed(values), max))[::-1]


class Pose(NamedTuple):
    """The position of a bench: its middle and axis in balls and in floats, and the widths of the balls."""

    shape: Bench
    middle: acb
    axis: acb
    near: complex
    heading: complex
    unsure_m: float
    unsure: float


class Posture:
    """All benches behind one front handle, placed on demand."""

    def __init__(self, track: Track, dragon: Dragon, lead: int, place: Place) -> None:
        """Store the leading bench and the position of its front handle."""
        self._track, self._benches, self._lead = track, dragon.benches, lead
        self._places, self._points, self._poses = [place], [track.point(place)], list[Pose]()

    @property
    def placed(self) -> int:
        """The number of links placed."""
        return len(self._places) - 1

    def place(self, n: int) -> Place:
        """Return the position of the n-th handle behind the front handle. Raises Refused if a link cannot be placed."""
        while len(self._places) <= n:
            link = self._benches[self._lead + len(self._places) - 1].link
            self._places.append(self._track.next(self._places[-1], link, -1))
        return self._places[n]

    def point(self, n: int) -> acb:
        """Return the point of the n-th handle."""
        while len(self._points) <= n:
            self._points.append(self._track.point(self.place(len(self._points))))
        return self._points[n]

    def pose(self, n: int) -> Pose:
        """Return the pose of the n-th bench behind the leading bench."""
        while len(self._poses) <= n:
            k = len(self._poses)
            shape = self._benches[self._lead + k]
            front, rear = self.point(k), self.point(k + 1)
            middle, axis = (front + rear) * HALF, (front - rear) * shape.link.inverse
            self._poses.append(Pose(shape, middle, axis, complex(middle), complex(axis), spread(middle), spread(axis)))
        return self._poses[n]


def spread(value: acb) -> float:
    """Return an upper bound on how far numbers of a complex ball are from its middle."""
    return up(float(value.real.rad()) + float(value.imag.rad()))


def about(one: Pose, two: Pose) -> list[float]:
    """Return the approximate separations of two benches along all AXES."""
    away, turned = two.near - one.near, two.heading * one.heading.conjugate()
    cosine, sine = abs(turned.real), abs(turned.imag)
    (l1, w1), (l2, w2) = one.shape.sizes, two.shape.sizes
    first, second = away * one.heading.conjugate(), -away * two.heading.conjugate()
    reach = (l1 + cosine * l2 + sine * w2, w1 + sine * l2 + cosine * w2,
             l2 + cosine * l1 + sine * w1, w2 + sine * l1 + cosine * w1)
    return [first.real - reach[0], -first.real - reach[0], first.imag - reach[1], -first.imag - reach[1],
            second.real - reach[2], -second.real - reach[2], second.imag - reach[3], -second.imag - reach[3]]


def separation(one: Pose, two: Pose, axis: Axis) -> arb:
    """Return how far the nearest corner of one bench is beyond an edge line of the other bench (negative if inside)."""
    if axis.other:
        one, two = two, one
    seen, turned = (two.middle - one.middle) * one.axis.conjugate(), two.axis * one.axis.conjugate()
    cosine, sine = abs(turned.real), abs(turned.imag)
    shape, other = one.shape, two.shape
    if axis.across:
        return seen.imag * axis.side - (shape.half_width + sine * other.half_length + cosine * other.half_width)
    return seen.real * axis.side - (shape.half_length + cosine * other.half_length + sine * other.half_width)


def gap(one: Pose, two: Pose) -> arb:
    """Return the best separation of two benches, which is a lower bound on their distance if it is positive."""
    rough = about(one, two)
    return separation(one, two, AXES[rough.index(max(rough))])


def overlap(one: Pose, two: Pose) -> bool:
    """Return whether two benches provably overlap because no edge line separates them (separating-axis theorem)."""
    return all(separation(one, two, axis) < 0 for axis in AXES)
