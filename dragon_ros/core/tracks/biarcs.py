"""Biarcs (two tangent arcs that join two points with given headings) and curves composed of biarcs.

A biarc leads from a point p with heading t to a point q with heading s. If the tangent legs of both arcs have length d,
the arcs meet halfway between the corners p + d t and q - d s, which are 2 d apart (K. M. Bolton, Biarc curves,
Computer-Aided Design 7, 1975):

    d = v.v / (v.(t + s) + sqrt((v.(t + s))^2 + |t - s|^2 v.v)),     v = q - p.
"""
import cmath
from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, cos, inf, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from dragon_ros.core.numerics.types import Complexes, Floats

_STRAIGHT_RAD = 1e-9    # an arc that turns by a smaller angle is treated as a line
_FLAT_M = 1e7           # an arc with a larger radius cannot be distinguished from a line in floats
_LONGEST_RAD = 2.5      # the largest turn of an arc in a fitted curve


class Bow(NamedTuple):
    """An arc from ``start`` that turns by ``angle_rad`` (positive to the left), or a line if this angle is 0.

    ``heading`` is the unit tangent at the start.
    """

    start: complex
    heading: complex
    length_m: float
    angle_rad: float

    @property
    def is_straight(self) -> bool:
        """Whether the arc is a line."""
        return abs(self.angle_rad) < _STRAIGHT_RAD

    @property
    def radius_m(self) -> float:
        """Radius of the arc; infinite for a line."""
        return inf if self.is_straight else self.length_m / abs(self.angle_rad)

    @property
    def end(self) -> complex:
        """The end point."""
        half = 0.5 * self.angle_rad
        chord_m = self.length_m * (sin(half) / half if half else 1.0)
        return self.start + chord_m * self.heading * complex(cos(half), sin(half))

    @property
    def leaving(self) -> complex:
        """The heading at the end."""
        return self.heading * cmath.rect(1.0, self.angle_rad)

    @property
    def _spoke(self) -> complex:
        """The vector from the centre to the start."""
        return -1j * copysign(self.radius_m, self.angle_rad) * self.heading

    def distances_m(self, points: Complexes) -> Floats:
        """Return the distances of points (n,) from the arc."""
        here = points - self.start
        ends = np.minimum(np.abs(here), np.abs(points - self.end))
        if self.radius_m > _FLAT_M:
            along = here * self.heading.conjugate()
            return np.where((along.real >= 0) & (along.real <= self.length_m), np.abs(along.imag), ends)
        seen = here + self._spoke
        on = copysign(1.0, self.angle_rad) * np.angle(seen / self._spoke) % (2 * pi) <= abs(self.angle_rad)
        return np.where(on, np.abs(np.abs(seen) - self.radius_m), ends)

    def points(self, sag_m: float) -> Complexes:
        """Return points along the arc, including both ends; chords between them deviate by at most ``sag_m``."""
        if self.radius_m > _FLAT_M:
            return np.array((self.start, self.end))
        count = 2 + int(abs(self.angle_rad) * sqrt(self.radius_m / (8 * sag_m)))
        out: Complexes = self.start - self._spoke * (1 - np.exp(1j * self.angle_rad * np.linspace(0.0, 1.0, count)))
        return out


def _bow(start: complex, heading: complex, end: complex, half_rad: float) -> Bow:
    """Return the arc over a chord; the angle between heading and chord is ``half_rad``, half the angle of the arc."""
    return Bow(start, heading, abs(end - start) * (half_rad / sin(half_rad) if half_rad else 1.0), 2 * half_rad)


def biarc(start: complex, heading: complex, end: complex, leaving: complex) -> tuple[Bow, Bow] | None:
    """Return the biarc from one point and heading to another, or None if it would start backwards."""
    chord, both, apart = end - start, heading + leaving, abs(heading - leaving)
    square, along = abs(chord) ** 2, (chord.conjugate() * both).real
    root = along + sqrt(along * along + apart * apart * square)
    if not root > 1e-12 * abs(chord):
        return None
    leg = square / root
    joint = 0.5 * (start + end + leg * (heading - leaving))     # long legs cancel
    if joint in (start, end):
        return None
    one, two = joint - start, end - joint
    halves = cmath.phase(one / heading), cmath.phase(leaving / two)
    # The rounded joint may turn a short chord, so the heading at the joint follows from the longer chord.
    meeting = heading * cmath.rect(1.0, 2 * halves[0]) if abs(one) >= abs(two) else (
        leaving * cmath.rect(1.0, -2 * halves[1]))
    return (_bow(start, heading, joint, _half_turn(heading, meeting, halves[0])),
            _bow(joint, meeting, end, _half_turn(meeting, leaving, halves[1])))


def _half_turn(heading: complex, leaving: complex, about_rad: float) -> float:
    """Return half the turn from one heading to another, given its approximate value."""
    return about_rad + 0.5 * cmath.phase(leaving / (heading * cmath.rect(1.0, 2 * about_rad)))


@dataclass(frozen=True, eq=False)
class Fitted:
    """Biarcs along a curve, each over a span (first, last) of points; None replaces a biarc that bends too tightly."""

    spans: tuple[tuple[int, int], ...]
    biarcs: tuple[tuple[Bow, Bow] | None, ...]


def fitted(points: Complexes, headings: Complexes, tolerance_m: float, least_m: float,
           spend: Callable[[int], None]) -> Fitted:
    """Return a sequence of biarcs that follows the points (n,) of a curve within a tolerance.

    Each biarc is as long as possible with a deviation of at most ``tolerance_m`` and radii of at least ``least_m``.
    ``spend`` is told the number of points that each attempt examines.
    """
    spans, biarcs, first = list[tuple[int, int]](), list[tuple[Bow, Bow] | None](), 0
    while first < len(points) - 1:
        last, best = _longest(points, headings, first, (tolerance_m, least_m), spend)
        spans.append((first, last))
        biarcs.append(best)
        first = last
    return Fitted(tuple(spans), tuple(biarcs))


def _longest(points: Complexes, headings: Complexes, first: int,
             limits_m: tuple[float, float], spend: Callable[[int], None]) -> tuple[int, tuple[Bow, Bow] | None]:
    """Return the last point that a single biarc can reach within the limits, and that biarc.

    If no biarc satisfies the limits, return the next point and None.
    """
    good, best, beyond, ahead = first + 1, None, len(points), 1
    while first + ahead < beyond:
        tried = first + ahead
        spend(tried - first)
        found = _within(points[first:tried + 1], headings[first], headings[tried], limits_m)
        if found is None:
            beyond = tried
        else:
            good, best = tried, found
            ahead = min(2 * ahead, max(len(points) - 1 - first, ahead + 1))
    while beyond - good > 1:
        tried = (good + beyond) // 2
        spend(tried - first)
        found = _within(points[first:tried + 1], headings[first], headings[tried], limits_m)
        if found is None:
            beyond = tried
        else:
            good, best = tried, found
    return good, best


def _within(points: Complexes, heading: complex, leaving: complex,
            limits_m: tuple[float, float]) -> tuple[Bow, Bow] | None:
    """Return the biarc from the first point to the last if it satisfies the limits, else None."""
    tolerance_m, least_m = limits_m
    found = biarc(complex(points[0]), complex(heading), complex(points[-1]), complex(leaving))
    if found is None or any(abs(bow.angle_rad) > _LONGEST_RAD or bow.radius_m < least_m for bow in found):
        return None
    checked = np.concatenate((points, 0.5 * (points[1:] + points[:-1])))
    return found if strays_m(found, checked) <= tolerance_m else None


def strays_m(bows: tuple[Bow, ...], points: Complexes) -> float:
    """Return the largest distance from any of the points (n,) to the nearest arc."""
    return float(np.max(np.min([bow.distances_m(points) for bow in bows], axis=0), initial=0.0))
