"""Pieces of track where they lie in the plane: lines, arcs and spirals, each with one coordinate u along it.

Points and directions are complex numbers, floats or arrays of them; ``heading`` is the head's way along the piece. u is
metres on a line, radians turned on an arc and the polar angle on a spiral, kept as (hi, lo).
"""
import cmath
from dataclasses import dataclass
from functools import cached_property
from math import asin, inf, sqrt
from typing import Any, Protocol

import numpy as np

from dragon_ros.core.chord import reach_m, step_in
from dragon_ros.core.march import first_guess, step
from dragon_ros.core.numerics.double_double import DoubleDouble, plus
from dragon_ros.core.path import Spiral, arc_between

BACK, AHEAD = -1, 1         # against the head's way, and along it


class Placed(Protocol):
    """What a walk asks of a piece. An open end has an infinite coordinate."""

    @property
    def first(self) -> float:
        """Coordinate at the beginning."""
        ...

    @property
    def last(self) -> float:
        """Coordinate at the end."""
        ...

    @property
    def bend(self) -> float:
        """Largest curvature in 1/m."""
        ...

    def at(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the point."""
        ...

    def heading(self, u: Any) -> Any:
        """Return the unit tangent in the head's way."""
        ...

    def rate(self, u: float) -> float:
        """Return metres in the head's way for each unit of u (negative where u falls)."""
        ...

    def metres(self, u: Any) -> Any:
        """Return the way from the anchor to u, positive in the head's way."""
        ...

    def curvature(self, u: Any) -> Any:
        """Return the curvature in 1/m, positive where the head's way turns left; monotone along the piece."""
        ...

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u so many metres from the anchor in the head's way."""
        ...

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        ...

    def next(self, u: DoubleDouble, chord_m: float, way: int, tolerance: float) -> tuple[DoubleDouble, int]:
        """Return the nearest place at a chord, on this curve however long, and evaluations."""
        ...


@dataclass(frozen=True)
class PlacedLine:
    """A straight line from ``start`` along ``direction``; the anchor is its start."""

    start: complex
    direction: complex
    first: float
    last: float
    bend = 0.0

    def at(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the point."""
        return self.start + self.direction * u + self.direction * lo

    def heading(self, u: Any) -> Any:
        """Return the unit tangent in the head's way."""
        return self.direction + 0 * u

    def rate(self, u: float) -> float:
        """Return metres for each unit of u."""
        return 1.0

    def metres(self, u: Any) -> Any:
        """Return the way from the start to u."""
        return u

    def curvature(self, u: Any) -> Any:
        """Return 0."""
        return np.zeros_like(u)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u so many metres from the start."""
        return DoubleDouble(*plus(metres, lo, 0.0))

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        return max(abs(complex(self.at(a))), abs(complex(self.at(b))))

    def next(self, u: DoubleDouble, chord_m: float, way: int, tolerance: float) -> tuple[DoubleDouble, int]:
        """Return the place at a chord."""
        return DoubleDouble(*plus(*u, way * chord_m)), 1


@dataclass(frozen=True)
class PlacedArc:
    """An arc about ``centre``; ``spoke`` goes from there to its start, the anchor; ``side`` 1 turns left, -1 right."""

    centre: complex
    spoke: complex
    radius_m: float
    side: int
    first: float
    last: float

    @property
    def bend(self) -> float:
        """Curvature in 1/m."""
        return 1 / self.radius_m

    def at(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the point."""
        turned = 1j * self.side
        return self.centre + self.spoke * (_exp(turned * u) * (1 + turned * lo))

    def heading(self, u: Any) -> Any:
        """Return the unit tangent in the head's way."""
        turned = 1j * self.side
        return turned * self.spoke / self.radius_m * _exp(turned * u)

    def rate(self, u: float) -> float:
        """Return metres for each unit of u."""
        return self.radius_m

    def metres(self, u: Any) -> Any:
        """Return the way from the start to u."""
        return self.radius_m * u

    def curvature(self, u: Any) -> Any:
        """Return the signed curvature."""
        return np.full_like(u, self.side / self.radius_m)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u so many metres from the start."""
        return DoubleDouble(*plus(metres / self.radius_m, lo / self.radius_m, 0.0))

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        return abs(self.centre) + self.radius_m

    def next(self, u: DoubleDouble, chord_m: float, way: int, tolerance: float) -> tuple[DoubleDouble, int]:
        """Return the place at a chord."""
        return DoubleDouble(*plus(*u, way * 2 * asin(chord_m / (2 * self.radius_m)))), 1


def arc_from(start: complex, direction: complex, radius_m: float, side: int, angle_rad: float) -> PlacedArc:
    """Return the arc that leaves a point in a direction and turns to a side."""
    spoke = -1j * side * radius_m * direction
    return PlacedArc(start - spoke, spoke, radius_m, side, 0.0, angle_rad)


@dataclass(frozen=True)
class PlacedSpiral:
    """r = pitch / 2 pi * theta about ``centre``, turned by ``rotation``; ``side`` 1 winds out leftwards, -1 rightwards.

    ``way`` is 1 where the head winds out, -1 where it winds in; the anchor is at ``spiral.start``.
    """

    spiral: Spiral
    centre: complex
    rotation: complex
    side: int
    way: int
    first: float
    last: float

    @cached_property
    def bend(self) -> float:
        """Curvature at the inner end in 1/m."""
        theta = min(self.first, self.last)
        return (2 + theta * theta) / (self.spiral.b_m * (1 + theta * theta) * sqrt(1 + theta * theta))

    def at(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the point."""
        turned = 1j * self.side
        return self.centre + self.rotation * (self.spiral.b_m * u) * (_exp(turned * u) * (1 + turned * lo))

    def heading(self, u: Any) -> Any:
        """Return the unit tangent in the head's way."""
        turned = 1j * self.side
        return self.way * self.rotation * _exp(turned * u) * (1 + turned * u) / np.sqrt(1 + u * u)

    def rate(self, u: float) -> float:
        """Return metres for each radian."""
        return self.way * self.spiral.b_m * sqrt(1 + u * u)

    def metres(self, u: Any) -> Any:
        """Return the way from the anchor to u."""
        start = self.spiral.start.hi
        return -self.way * self.spiral.b_m * arc_between(start, start - u)

    def curvature(self, u: Any) -> Any:
        """Return the signed curvature; 0 infinitely far out."""
        square = 1 + u * u
        return self.side * self.way / self.spiral.b_m * (1 + 1 / square) / np.sqrt(square)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u so many metres from the anchor."""
        return self.spiral.inward(-self.way * metres, -self.way * lo)

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        return abs(self.centre) + self.spiral.b_m * max(a, b)

    def next(self, u: DoubleDouble, chord_m: float, way: int, tolerance: float) -> tuple[DoubleDouble, int]:
        """Return the nearest place at a chord: further out, or further in."""
        chord = chord_m / self.spiral.b_m
        if way == self.way:
            delta, spent = step(u.hi, chord, first_guess(u.hi, chord), tolerance)
            return DoubleDouble(*plus(*u, delta)) if delta < inf else DoubleDouble(inf, 0.0), spent
        arc = reach_m(self.bend, chord_m) / self.spiral.b_m
        delta, spent = step_in(u.hi, chord, arc, tolerance)
        return DoubleDouble(*plus(*u, -delta)) if delta < inf else DoubleDouble(-inf, 0.0), spent


def _exp(z: Any) -> Any:
    """Return exp(z) of one or many: for one, numpy takes several times as long."""
    return cmath.exp(z) if isinstance(z, complex) else np.exp(z)


def metres_between(piece: Placed, a: float, b: float) -> float:
    """Return the length of the piece between two coordinates."""
    if isinstance(piece, PlacedSpiral):
        outer, inner = max(a, b), min(a, b)
        return float(piece.spiral.b_m * arc_between(outer, outer - inner))
    return float(abs(piece.metres(b) - piece.metres(a)))


