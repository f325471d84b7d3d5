"""Segments of a track in the plane, each with a coordinate u along it: the interface, and lines and arcs.

Points and directions are complex numbers, floats or arrays of them; ``heading`` is the head's direction along the
segment. u is metres on a line, radians turned on an arc and the polar angle on a spiral (``spiral``), stored as a
double-double (hi, lo).
"""
import cmath
from dataclasses import dataclass
from math import asin
from typing import Any, NamedTuple, Protocol

import numpy as np

from dragon_ros.core.numerics.double_double import DoubleDouble, plus, product
from dragon_ros.core.numerics.types import Array, Floats

BEHIND, AHEAD = -1, 1         # against the head's direction, and along it
LARGEST_BEND = 1.98     # limit of curvature times chord: links may lock at 2; roots are well conditioned 1 % below


class Past(NamedTuple):
    """The predictor's state for many positions: the differences of squared angles (M,) over the last three links."""

    d1: Floats
    d2: Floats
    d3: Floats


class Segment(Protocol):
    """The interface of segments. An open end has an infinite coordinate."""

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

    def poses(self, u: Floats, lo: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents at many positions."""
        ...

    def heading(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the unit tangent in the head's direction."""
        ...

    def rate(self, u: Any) -> Any:
        """Return metres in the head's direction per unit of u (negative if u decreases in that direction)."""
        ...

    def metres(self, u: Any) -> Any:
        """Return the distance from the anchor to u, positive in the head's direction."""
        ...

    def metres_lo(self, u: Any, lo: Any) -> Any:
        """Return the difference between the distance from the anchor to u + lo and ``metres(u)``, as one float."""
        ...

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length of the segment between coordinates, without cancellation."""
        ...

    def curvature(self, u: Any) -> Any:
        """Return the curvature in 1/m, positive if the head turns left; monotone along the segment."""
        ...

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u at a distance in metres from the anchor in the head's direction."""
        ...

    def after_many(self, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return ``after`` for many distances, as (hi, lo)."""
        ...

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        ...

    def next(self, u: DoubleDouble, chord_m: float, direction: int) -> tuple[DoubleDouble, int]:
        """Return the nearest position at a chord, even off the segment, or inf, and the number of evaluations."""
        ...

    def pace(self, u: DoubleDouble, to: DoubleDouble) -> float:
        """Return the speed of the handle at ``to`` for unit speed at ``u``, both handles of one link."""
        ...

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past | None) -> tuple[Floats, int]:
        """Return the coordinate changes to the next positions (inf without one), and the number of evaluations.

        ``past`` helps to predict them. Raises ChainLockError if a link locks.
        """
        ...

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return the predictor's state after changes of coordinates."""
        ...

    def march(self, u: DoubleDouble, links: tuple[int, float], direction: int,
              edge: float) -> tuple[list[float], list[float], int]:
        """Return the coordinates (hi, lo) of up to ``links`` = (count, chord_m) handles, and the number of evaluations.

        The march stops before the first handle that is beyond ``edge`` or cannot be placed.
        """
        ...


@dataclass(frozen=True)
class LineSegment:
    """A straight line from ``start`` along ``direction``; the anchor is its start."""

    start: complex
    direction: complex
    first: float
    last: float
    bend = 0.0

    def at(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the point."""
        return self.start + self.direction * u + self.direction * lo

    def heading(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the unit tangent in the head's direction."""
        return self.direction + 0 * u

    def poses(self, u: Floats, lo: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents at many positions."""
        return self.at(u, lo), self.heading(u)

    def rate(self, u: Any) -> Any:
        """Return metres per unit of u."""
        return 1.0

    def metres(self, u: Any) -> Any:
        """Return the distance from the start to u."""
        return u

    def metres_lo(self, u: Any, lo: Any) -> Any:
        """Return the low part of ``metres``."""
        return lo

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between coordinates."""
        return abs(a - b)

    def curvature(self, u: Any) -> Any:
        """Return 0."""
        return np.zeros_like(u)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u at a distance in metres from the start."""
        return DoubleDouble(*plus(metres, lo, 0.0))

    def after_many(self, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return ``after`` for many distances."""
        return plus(metres, lo, 0.0)

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        return max(abs(complex(self.at(a))), abs(complex(self.at(b))))

    def next(self, u: DoubleDouble, chord_m: float, direction: int) -> tuple[DoubleDouble, int]:
        """Return the position at a chord."""
        return DoubleDouble(*plus(*u, direction * chord_m)), 1

    def pace(self, u: DoubleDouble, to: DoubleDouble) -> float:
        """Return 1: both ends of a link have the same speed."""
        return 1.0

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past | None) -> tuple[Floats, int]:
        """Return the coordinate changes to the next positions, and the number of evaluations."""
        return np.full_like(u, direction * chord_m), 0

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return an empty state: everything is in closed form."""
        return shift

    def march(self, u: DoubleDouble, links: tuple[int, float], direction: int,
              edge: float) -> tuple[list[float], list[float], int]:
        """Return the coordinates of up to ``links[0]`` handles."""
        return _equal_shifts(u, links[0], direction * links[1], direction, edge)


@dataclass(frozen=True)
class ArcSegment:
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
        return self.centre + self.spoke * (_turn(self.side * u) * (1 + turned * lo))

    def heading(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the unit tangent in the head's direction."""
        turned = 1j * self.side
        return turned * self.spoke / self.radius_m * (_turn(self.side * u) * (1 + turned * lo))

    def poses(self, u: Floats, lo: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents at many positions, with each sine and cosine computed once."""
        turned = 1j * self.side
        turn = np.exp(1j * (self.side * u)) * (1 + turned * lo)
        return self.centre + self.spoke * turn, turned * self.spoke / self.radius_m * turn

    def rate(self, u: Any) -> Any:
        """Return metres per unit of u."""
        return self.radius_m

    def metres(self, u: Any) -> Any:
        """Return the distance from the start to u."""
        return self.radius_m * u

    def metres_lo(self, u: Any, lo: Any) -> Any:
        """Return the low part of ``metres``."""
        return product(self.radius_m, u)[1] + self.radius_m * lo

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between coordinates."""
        return self.radius_m * abs(a - b)

    def curvature(self, u: Any) -> Any:
        """Return the signed curvature."""
        return np.full_like(u, self.side / self.radius_m)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u at a distance in metres from the start, without loss of digits after any number of turns."""
        return DoubleDouble(*self._after(metres, lo))

    def after_many(self, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return ``after`` for many distances."""
        return self._after(metres, lo)

    def _after(self, metres: Any, lo: Any) -> tuple[Any, Any]:
        u = metres / self.radius_m
        near_m, less_m = product(u, self.radius_m)
        return plus(u, ((metres - near_m) - less_m + lo) / self.radius_m, 0.0)

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        return abs(self.centre) + self.radius_m

    def next(self, u: DoubleDouble, chord_m: float, direction: int) -> tuple[DoubleDouble, int]:
        """Return the position at a chord."""
        return DoubleDouble(*plus(*u, direction * arc_span(self.radius_m, chord_m))), 1

    def pace(self, u: DoubleDouble, to: DoubleDouble) -> float:
        """Return 1: both ends of a link have the same speed."""
        return 1.0

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past | None) -> tuple[Floats, int]:
        """Return the coordinate changes to the next positions, and the number of evaluations."""
        return np.full_like(u, direction * arc_span(self.radius_m, chord_m)), 0

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return an empty state: everything is in closed form."""
        return shift

    def march(self, u: DoubleDouble, links: tuple[int, float], direction: int,
              edge: float) -> tuple[list[float], list[float], int]:
        """Return the coordinates of up to ``links[0]`` handles."""
        return _equal_shifts(u, links[0], direction * arc_span(self.radius_m, links[1]), direction, edge)


def reach_m(bend: float, chord_m: float) -> float:
    """Return the longest arc that a chord can span on a track whose curvature in 1/m is at most ``bend``.

    If the curvature times the chord is below 2, the chord from a position grows along the track until the arc is pi /
    bend: the tangent at arc s differs from that at an earlier sigma by an angle of at most bend (s - sigma), so the
    chord grows at least at the rate sin(bend s) / (bend chord) > 0. By Schur's comparison with a circle the chord is at
    least 2 sin(bend s / 2) / bend. It therefore reaches ``chord_m`` once, within 2 asin(bend chord_m / 2) / bend.
    """
    return 2 * asin(0.5 * bend * chord_m) / bend if bend else chord_m


def arc_span(radius_m: float, chord_m: float) -> float:
    """Return the angle that a chord spans on a circle."""
    return 2 * asin(chord_m / (2 * radius_m))


def _equal_shifts(u: DoubleDouble, count: int, shift: float, direction: int,
                  edge: float) -> tuple[list[float], list[float], int]:
    """Return coordinates at equal spacing, up to an edge."""
    high, low, highs, lows = *u, list[float](), list[float]()
    for _ in range(count):
        high, low = plus(high, low, shift)
        if (edge - high) * direction < 0:
            break
        highs.append(high)
        lows.append(low)
    return highs, lows, len(highs)


def arc_from(start: complex, heading: complex, radius_m: float, side: int, angle_rad: float) -> ArcSegment:
    """Return the arc from a point with a heading that turns to one side."""
    spoke = -1j * side * radius_m * heading
    return ArcSegment(start - spoke, spoke, radius_m, side, 0.0, angle_rad)


def _turn(angle: Any) -> Any:
    """Return exp(i angle) for one angle or many; for a single angle, numpy would take several times as long."""
    return cmath.rect(1.0, angle) if type(angle) is float else np.exp(1j * angle)
