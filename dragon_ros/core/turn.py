"""The S-turn: from a spiral in to the same spiral out, turned by half a turn, along two tangent arcs.

The spiral enters the turning circle of radius R at polar angle theta = R / b, its tangent at the angle gamma from the
radius, tan gamma = theta. Entry and exit lie opposite, with one heading. Two arcs that touch and turn by the same
angle, one right and one left, join them; both chords lie on the line between, so each arc turns by 2 gamma, and

    r1 + r2 = R / sin gamma,     length = 2 gamma R / sin gamma:

the length does not depend on the ratio of the radii, only on the circle.
"""
from dataclasses import dataclass
from functools import cached_property
from math import asin, atan, inf, pi, sin, sqrt

from dragon_ros.core.checks import number
from dragon_ros.core.path import Spiral
from dragon_ros.core.placed import PlacedSpiral, arc_from
from dragon_ros.core.walk import Walk


@dataclass(frozen=True)
class Turn:
    """Spiral in, arc of ``ratio`` times the second's radius, second arc, spiral out, within a circle of ``diameter_m``.

    The spirals are r = pitch_m / (2 pi) theta about the origin and its opposite. At t = 0 the head is ``before_m`` in
    front of the turn's entry: with 100 and a head of 1 m/s the contest's -100 s is 0 s here, since stamps of ROS and
    of bags cannot be negative.
    """

    pitch_m: float = 1.7
    diameter_m: float = 9.0
    ratio: float = 2.0
    before_m: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a turn that is not one."""
        number('track.pitch_m', self.pitch_m, low=1e-9, high=1e9)
        number('track.diameter_m', self.diameter_m, low=1e-9, high=1e9)
        number('track.ratio', self.ratio, low=1e-6, high=1e6)
        number('track.before_m', self.before_m, low=-1e9, high=1e9)

    @property
    def radius_m(self) -> float:
        """Radius of the turning circle."""
        return 0.5 * self.diameter_m

    @property
    def entry_turns(self) -> float:
        """Turns of the spiral from its centre to the entry."""
        return self.radius_m / self.pitch_m

    @cached_property
    def gamma_rad(self) -> float:
        """DoubleDouble between the track and the radius at the entry."""
        return atan(2 * pi * self.entry_turns)

    @cached_property
    def radii_m(self) -> tuple[float, float]:
        """Radii of the two arcs, in the order of the head's way."""
        second = self.radius_m / sin(self.gamma_rad) / (1 + self.ratio)
        return self.ratio * second, second

    def largest_ratio(self, least_radius_m: float) -> float:
        """Return the largest ratio at which both radii are at least ``least_radius_m``; below 1 there is none."""
        return sum(self.radii_m) / least_radius_m - 1

    def smallest_diameter_m(self, least_radius_m: float) -> float:
        """Return the diameter of the smallest circle with arcs of at least that radius (both have it, ratio 1).

        In units of b, R is theta and r1 + r2 is sqrt(1 + theta^2).
        """
        b_m = self.pitch_m / (2 * pi)
        return 2 * sqrt(max(4 * least_radius_m * least_radius_m - b_m * b_m, 0.0))

    @property
    def start_m(self) -> float:
        """Distance along the walk, from the entry, at which the head is at t = 0."""
        return -self.before_m

    @cached_property
    def walk(self) -> Walk:
        """The whole track, open at both ends; distances count from the entry."""
        spiral = Spiral(self.pitch_m, self.entry_turns)
        theta = spiral.start.hi
        way_in = PlacedSpiral(spiral, 0j, 1 + 0j, 1, -1, inf, theta)
        way_out = PlacedSpiral(spiral, 0j, -1 + 0j, 1, 1, theta, inf)
        first = arc_from(complex(way_in.at(*spiral.start)), complex(way_in.heading(theta)), self.radii_m[0], -1,
                         self.angle_rad)
        turned = first.last
        second = arc_from(complex(first.at(turned)), complex(first.heading(turned)), self.radii_m[1], 1, turned)
        return Walk((way_in, first, second, way_out), (0.0, 0.0, self.radii_m[0] * turned, self.length_m))

    @property
    def angle_rad(self) -> float:
        """DoubleDouble by which each arc turns."""
        return 2 * self.gamma_rad

    @cached_property
    def length_m(self) -> float:
        """Length of both arcs."""
        return self.angle_rad * sum(self.radii_m)


@dataclass(frozen=True)
class Bent:
    """A way from entry to exit of an S-turn: two arcs of one radius with a straight line between them."""

    radius_m: float
    angle_rad: float
    line_m: float

    @property
    def length_m(self) -> float:
        """Length of the whole way."""
        return 2 * self.radius_m * self.angle_rad + self.line_m


def shortest_bent(turn: Turn, least_radius_m: float) -> Bent | None:
    """Return the shortest way between the turn's entry and exit that turns right, then left, no tighter than a radius.

    Of all curves of bounded curvature the shortest is made of arcs of that radius and lines (Dubins 1957); this is the
    one that turns once each way. None where the radius is larger than that of two equal arcs. The first arc's centre is
    at distance m from the circle's, m^2 = R^2 + r^2 - 2 R r sin gamma; the line touches both arcs and goes through it.
    """
    big, r, gamma = turn.radius_m, least_radius_m, turn.gamma_rad
    if 2 * r > sum(turn.radii_m):
        return None
    m = sqrt(big * big + r * r - 2 * big * r * sin(gamma))
    turned = asin(min(1.0, (big - r * sin(gamma)) / m)) + asin(min(1.0, r / m)) - (0.5 * pi - gamma)
    return Bent(r, turned, 2 * sqrt(max(m * m - r * r, 0.0)))
