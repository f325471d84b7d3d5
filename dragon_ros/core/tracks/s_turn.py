"""The S-turn (``spec.STurn``): two tangent arcs from the inward spiral to a copy of it rotated by half a turn."""
from dataclasses import dataclass, replace
from math import asin, inf, pi, sin, sqrt

from dragon_ros.core.tracks.segments import AHEAD, BEHIND, ArcSegment, Segment
from dragon_ros.core.tracks.spec import STurn
from dragon_ros.core.tracks.spiral import SpiralCurve, SpiralSegment


def s_turn_segments(turn: STurn) -> tuple[tuple[Segment, ...], tuple[float, ...]]:
    """Return the segments of a track that is open at both ends, and the distances of their anchors from the entry."""
    curve = SpiralCurve(turn.pitch_m, 2 * pi * turn.entry_turns)
    theta, turned, (first_m, second_m) = curve.start, turn.angle_rad, turn.radii_m
    way_in = SpiralSegment(curve, 0j, 1 + 0j, 1, BEHIND, inf, theta)
    way_out = SpiralSegment(curve, 0j, -1 + 0j, 1, AHEAD, theta, inf)
    first = ArcSegment(complex(way_in.at(theta)), complex(way_in.heading(theta)), first_m, -1, 0.0, turned)
    second = ArcSegment(complex(first.at(turned)), complex(first.heading(turned)), second_m, 1, 0.0, turned)
    return (way_in, first, second, way_out), (0.0, 0.0, first_m * turned, turn.length_m)


@dataclass(frozen=True)
class Bent:
    """A path from the entry to the exit of an S-turn: two arcs of equal radius and a straight line between them."""

    radius_m: float
    angle_rad: float
    line_m: float

    @property
    def length_m(self) -> float:
        """Length of the whole path."""
        return 2 * self.radius_m * self.angle_rad + self.line_m


@dataclass(frozen=True)
class TurnAnswer:
    """The length of an S-turn, and how arcs with a radius of at least ``least_radius_m`` can shorten it.

    The length does not depend on the ratio of the radii. ``smallest_diameter_m`` is the diameter of the turning
    circle in which both arcs have the radius ``least_radius_m`` (0 if they are larger in any circle), and
    ``length_there_m`` is the length of the turn in that circle. ``with_line`` is a path in the original circle that
    consists of two tighter arcs and a line; it is None if no such path is shorter.
    """

    length_m: float
    radii_m: tuple[float, float]
    angle_rad: float
    least_radius_m: float
    largest_ratio: float
    smallest_diameter_m: float
    length_there_m: float | None
    with_line: Bent | None


def turn_answer(turn: STurn, least_radius_m: float) -> TurnAnswer:
    """Return the length of a turn and ways to shorten it."""
    smallest = turn.smallest_diameter_m(least_radius_m)
    there_m = replace(turn, diameter_m=smallest, ratio=1.0).length_m if smallest else None
    return TurnAnswer(turn.length_m, turn.radii_m, turn.angle_rad, least_radius_m, turn.largest_ratio(least_radius_m),
                      smallest, there_m, shortest_bent(turn, least_radius_m))


def shortest_bent(turn: STurn, least_radius_m: float) -> Bent | None:
    """Return the shortest path from entry to exit that turns right and then left, within the limit on the radii.

    The shortest curve of bounded curvature consists of lines and arcs of the smallest allowed radius (Dubins 1957); the
    returned path turns once in each direction. The radii are at least ``least_radius_m``; the result is None if this
    exceeds the radius that two equal arcs would have. The centre of the first arc is at a distance m from the centre of
    the turning circle, where m^2 = R^2 + r^2 - 2 R r sin gamma. The line is tangent to both arcs and passes through the
    centre of the turning circle.
    """
    big, r, gamma = turn.radius_m, least_radius_m, turn.gamma_rad
    if 2 * r > sum(turn.radii_m):
        return None
    m = sqrt(big * big + r * r - 2 * big * r * sin(gamma))
    turned = asin(min(1.0, (big - r * sin(gamma)) / m)) + asin(min(1.0, r / m)) - (0.5 * pi - gamma)
    return Bent(r, turned, 2 * sqrt(max(m * m - r * r, 0.0)))
