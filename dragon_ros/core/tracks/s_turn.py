"""The S-turn (``spec.STurn``): two tangent arcs from the inward spiral to the same spiral, rotated by half a turn."""
from dataclasses import dataclass, replace
from fractions import Fraction
from math import asin, inf, pi, sin, sqrt

from dragon_ros.core.numerics.double_double import from_turns
from dragon_ros.core.tracks.segments import AHEAD, BEHIND, Segment, arc_from
from dragon_ros.core.tracks.spec import STurn
from dragon_ros.core.tracks.spiral import SpiralCurve, SpiralSegment


def s_turn_segments(turn: STurn) -> tuple[tuple[Segment, ...], tuple[float, ...]]:
    """Return the segments, open at both ends, and the distances of their anchors from the entry."""
    # With a single float for the entry's angle, both spirals would be off by half an ulp of the angle times the radius.
    curve = SpiralCurve(turn.pitch_m, from_turns(Fraction(turn.diameter_m) / 2 / Fraction(turn.pitch_m)))
    theta = curve.start.hi
    way_in = SpiralSegment(curve, 0j, 1 + 0j, 1, BEHIND, inf, theta)
    way_out = SpiralSegment(curve, 0j, -1 + 0j, 1, AHEAD, theta, inf)
    first = arc_from(complex(way_in.at(*curve.start)), complex(way_in.heading(*curve.start)), turn.radii_m[0], -1,
                     turn.angle_rad)
    turned = first.last
    second = arc_from(complex(first.at(turned)), complex(first.heading(turned)), turn.radii_m[1], 1, turned)
    return (way_in, first, second, way_out), (0.0, 0.0, turn.radii_m[0] * turned, turn.length_m)


@dataclass(frozen=True)
class Bent:
    """A path from entry to exit of an S-turn: two arcs of one radius with a straight line between them."""

    radius_m: float
    angle_rad: float
    line_m: float

    @property
    def length_m(self) -> float:
        """Length of the whole path."""
        return 2 * self.radius_m * self.angle_rad + self.line_m


@dataclass(frozen=True)
class TurnAnswer:
    """The length of an S-turn, and whether it can be shortened with arcs no tighter than ``least_radius_m``.

    The length does not depend on the ratio of the radii. ``smallest_diameter_m`` is the
    diameter of the smallest circle with two equal arcs of that radius (0 if there is no lower limit), and
    ``length_there_m`` is the turn's length in it. ``with_line`` replaces the arcs in the same circle by tighter ones
    and a line; it is None if that is no shorter.
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
    """Return the length of a turn, and the ways to shorten it."""
    smallest = turn.smallest_diameter_m(least_radius_m)
    there_m = replace(turn, diameter_m=smallest, ratio=1.0).length_m if smallest else None
    return TurnAnswer(turn.length_m, turn.radii_m, turn.angle_rad, least_radius_m, turn.largest_ratio(least_radius_m),
                      smallest, there_m, shortest_bent(turn, least_radius_m))


def shortest_bent(turn: STurn, least_radius_m: float) -> Bent | None:
    """Return the shortest path between the turn's entry and exit that turns right, then left, no tighter than a radius.

    The shortest curve of bounded curvature consists of arcs of that radius and lines (Dubins 1957); this one turns
    once in each direction. The result is None if the radius exceeds that of two equal arcs. The first arc's
    centre is at distance m from the circle's, m^2 = R^2 + r^2 - 2 R r sin gamma; the line is tangent to both arcs and
    passes through the circle's centre.
    """
    big, r, gamma = turn.radius_m, least_radius_m, turn.gamma_rad
    if 2 * r > sum(turn.radii_m):
        return None
    m = sqrt(big * big + r * r - 2 * big * r * sin(gamma))
    turned = asin(min(1.0, (big - r * sin(gamma)) / m)) + asin(min(1.0, r / m)) - (0.5 * pi - gamma)
    return Bent(r, turned, 2 * sqrt(max(m * m - r * r, 0.0)))
