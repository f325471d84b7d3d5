"""Segments of a track where they lie in the plane: lines, arcs and spirals, each with one coordinate u along it.

Points and directions are complex numbers, floats or arrays of them; ``heading`` is the head's way along the segment. u
is metres on a line, radians turned on an arc and the polar angle on a spiral, kept as a double-double (hi, lo).
"""
import cmath
from dataclasses import dataclass
from functools import cached_property
from math import cos, inf, pi, sin, sqrt
from typing import Any, NamedTuple, Protocol

import numpy as np

from dragon_ros.core.numerics.double_double import DoubleDouble, plus, product
from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.core.tracks.chord import (
    arc_span,
    first_guess,
    first_guess_in,
    first_guesses,
    first_guesses_in,
    next_square,
    reach_m,
    step,
    step_in,
    steps,
    steps_in,
)
from dragon_ros.core.tracks.spiral import TINY, SpiralCurve, arc_between

_NOWHERE_OUT, _NOWHERE_IN = DoubleDouble(inf, 0.0), DoubleDouble(-inf, 0.0)
BEHIND, AHEAD = -1, 1         # against the head's way, and along it


class Past(NamedTuple):
    """What the predictor knows of many places: differences of squared angles (M,) of the last three equal links."""

    d1: Floats
    d2: Floats
    d3: Floats


def _ahead(past: Past | None) -> Floats | None:
    """Return the predicted differences of squared angles."""
    return np.maximum(next_square(past.d1, past.d2, past.d3), 0.0) if past else None    # type: ignore[arg-type]


class Segment(Protocol):
    """What a track asks of a segment. An open end has an infinite coordinate."""

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
        """Return points and unit tangents of many places."""
        ...

    def heading(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the unit tangent in the head's way."""
        ...

    def rate(self, u: Any) -> Any:
        """Return metres in the head's way for each unit of u (negative where u falls)."""
        ...

    def metres(self, u: Any) -> Any:
        """Return the distance from the anchor to u, positive in the head's way."""
        ...

    def metres_lo(self, u: Any, lo: Any) -> Any:
        """Return what the distance from the anchor to u + lo is more than ``metres(u)``, one float."""
        ...

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length of the segment between coordinates, without cancellation."""
        ...

    def curvature(self, u: Any) -> Any:
        """Return the curvature in 1/m, positive where the head's way turns left; monotone along the segment."""
        ...

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u so many metres from the anchor in the head's way."""
        ...

    def after_many(self, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return ``after`` of many, as (hi, lo)."""
        ...

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        ...

    def next(self, u: DoubleDouble, chord_m: float, direction: int) -> tuple[DoubleDouble, int]:
        """Return the nearest place at a chord, on this curve however long, and evaluations; infinite if none."""
        ...

    def pace(self, u: DoubleDouble, to: DoubleDouble) -> float:
        """Return the speed of the handle at ``to`` for unit speed at ``u``: both ends of a link on this segment."""
        ...

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past | None) -> tuple[Floats, int]:
        """Return the changes of many coordinates to the next places, infinite where there is none, and evaluations.

        ``past`` helps to predict them. Raises ChainLockError where a link locks.
        """
        ...

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return what the predictor keeps of changes of coordinates."""
        ...

    def march(self, u: DoubleDouble, links: tuple[int, float], direction: int,
              edge: float) -> tuple[list[float], list[float], int]:
        """Return the coordinates (hi, lo) of up to ``links`` = (count, chord_m) handles, and evaluations.

        It stops before the first that is beyond ``edge`` or has no place.
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
        """Return the unit tangent in the head's way."""
        return self.direction + 0 * u

    def poses(self, u: Floats, lo: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents of many places."""
        return self.at(u, lo), self.heading(u)

    def rate(self, u: Any) -> Any:
        """Return metres for each unit of u."""
        return 1.0

    def metres(self, u: Any) -> Any:
        """Return the distance from the start to u."""
        return u

    def metres_lo(self, u: Any, lo: Any) -> Any:
        """Return what ``metres`` leaves out."""
        return lo

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between coordinates."""
        return abs(a - b)

    def curvature(self, u: Any) -> Any:
        """Return 0."""
        return np.zeros_like(u)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u so many metres from the start."""
        return DoubleDouble(*plus(metres, lo, 0.0))

    def after_many(self, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return ``after`` of many."""
        return plus(metres, lo, 0.0)

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        return max(abs(complex(self.at(a))), abs(complex(self.at(b))))

    def next(self, u: DoubleDouble, chord_m: float, direction: int) -> tuple[DoubleDouble, int]:
        """Return the place at a chord."""
        return DoubleDouble(*plus(*u, direction * chord_m)), 1

    def pace(self, u: DoubleDouble, to: DoubleDouble) -> float:
        """Return 1: both ends of a link have the same speed."""
        return 1.0

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past | None) -> tuple[Floats, int]:
        """Return the changes of many coordinates to the next places."""
        return np.full_like(u, direction * chord_m), 0

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return nothing of use: all is in closed form."""
        return shift

    def march(self, u: DoubleDouble, links: tuple[int, float], direction: int,
              edge: float) -> tuple[list[float], list[float], int]:
        """Return the coordinates of up to so many handles."""
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
        """Return the unit tangent in the head's way."""
        turned = 1j * self.side
        return turned * self.spoke / self.radius_m * (_turn(self.side * u) * (1 + turned * lo))

    def poses(self, u: Floats, lo: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents of many places, each angle's sine and cosine computed once."""
        turned = 1j * self.side
        turn = np.exp(1j * (self.side * u)) * (1 + turned * lo)
        return self.centre + self.spoke * turn, turned * self.spoke / self.radius_m * turn

    def rate(self, u: Any) -> Any:
        """Return metres for each unit of u."""
        return self.radius_m

    def metres(self, u: Any) -> Any:
        """Return the distance from the start to u."""
        return self.radius_m * u

    def metres_lo(self, u: Any, lo: Any) -> Any:
        """Return what ``metres`` leaves out."""
        return product(self.radius_m, u)[1] + self.radius_m * lo

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between coordinates."""
        return self.radius_m * abs(a - b)

    def curvature(self, u: Any) -> Any:
        """Return the signed curvature."""
        return np.full_like(u, self.side / self.radius_m)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u so many metres from the start, with all digits however many rounds that is."""
        return DoubleDouble(*self._after(metres, lo))

    def after_many(self, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return ``after`` of many."""
        return self._after(metres, lo)

    def _after(self, metres: Any, lo: Any) -> tuple[Any, Any]:
        u = metres / self.radius_m
        near_m, less_m = product(u, self.radius_m)
        return plus(u, ((metres - near_m) - less_m + lo) / self.radius_m, 0.0)

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        return abs(self.centre) + self.radius_m

    def next(self, u: DoubleDouble, chord_m: float, direction: int) -> tuple[DoubleDouble, int]:
        """Return the place at a chord."""
        return DoubleDouble(*plus(*u, direction * arc_span(self.radius_m, chord_m))), 1

    def pace(self, u: DoubleDouble, to: DoubleDouble) -> float:
        """Return 1: both ends of a link have the same speed."""
        return 1.0

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past | None) -> tuple[Floats, int]:
        """Return the changes of many coordinates to the next places."""
        return np.full_like(u, direction * arc_span(self.radius_m, chord_m)), 0

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return nothing of use: all is in closed form."""
        return shift

    def march(self, u: DoubleDouble, links: tuple[int, float], direction: int,
              edge: float) -> tuple[list[float], list[float], int]:
        """Return the coordinates of up to so many handles."""
        return _equal_shifts(u, links[0], direction * arc_span(self.radius_m, links[1]), direction, edge)


def _equal_shifts(u: DoubleDouble, count: int, shift: float, direction: int,
                  edge: float) -> tuple[list[float], list[float], int]:
    """Return coordinates that lie one shift apart, up to an edge."""
    high, low, highs, lows = *u, list[float](), list[float]()
    for _ in range(count):
        high, low = plus(high, low, shift)
        if (edge - high) * direction < 0:
            break
        highs.append(high)
        lows.append(low)
    return highs, lows, len(highs)


def arc_from(start: complex, heading: complex, radius_m: float, side: int, angle_rad: float) -> ArcSegment:
    """Return the arc that leaves a point with a heading and turns to a side."""
    spoke = -1j * side * radius_m * heading
    return ArcSegment(start - spoke, spoke, radius_m, side, 0.0, angle_rad)


@dataclass(frozen=True)
class SpiralSegment:
    """r = pitch / 2 pi * theta about ``centre``, turned by ``rotation``; ``side`` 1 winds out leftwards, -1 rightwards.

    ``way`` is 1 where the head winds out, -1 where it winds in; the anchor is at ``curve.start``.
    """

    curve: SpiralCurve
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
        return (2 + theta * theta) / (self.curve.b_m * (1 + theta * theta) * sqrt(1 + theta * theta))

    @cached_property
    def _scaled(self) -> complex:
        return self.rotation * self.curve.b_m

    @cached_property
    def _ahead(self) -> complex:
        return self.rotation * self.way

    def at(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the point."""
        if type(u) is float:
            return self.centre + self._scaled * u * (cmath.rect(1.0, self.side * u) * complex(1.0, self.side * lo))
        return self.centre + self._scaled * u * (np.exp(1j * self.side * u) * (1 + 1j * self.side * lo))

    def heading(self, u: Any, lo: Any = 0.0) -> Any:
        """Return the unit tangent in the head's way."""
        if type(u) is float:
            short = 1 / sqrt(1 + u * u)
            return self._ahead * (cmath.rect(1.0, self.side * u)
                                  * complex((1.0 - u * lo) * short, self.side * u * short))
        return self._ahead * (np.exp(1j * self.side * u) * ((1 - u * lo + 1j * self.side * u) / np.sqrt(1 + u * u)))

    def poses(self, u: Floats, lo: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents of many places, each angle's sine and cosine computed once."""
        turn, turned = np.exp(1j * self.side * u), 1j * self.side
        return (self.centre + self._scaled * u * (turn * (1 + turned * lo)),
                self._ahead * (turn * ((1 - u * lo + turned * u) / np.sqrt(1 + u * u))))

    def rate(self, u: Any) -> Any:
        """Return metres for each radian."""
        root = sqrt if type(u) is float else np.sqrt
        return self.way * self.curve.b_m * root(1 + u * u)

    def metres(self, u: Any) -> Any:
        """Return the distance from the anchor to u."""
        start = self.curve.start.hi
        return -self.way * self.curve.b_m * arc_between(start, start - u)

    def metres_lo(self, u: Any, lo: Any) -> Any:
        """Return what ``metres`` leaves out."""
        metres, more = self.curve.distance_of(u, lo)
        return (-self.way * metres - self.metres(u)) - self.way * more

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between coordinates, without cancellation."""
        return abs(self.curve.b_m * arc_between(b, b - a))

    def curvature(self, u: Any) -> Any:
        """Return the signed curvature; 0 infinitely far out."""
        square = 1 + u * u
        return self.side * self.way / self.curve.b_m * (1 + 1 / square) / np.sqrt(square)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return u so many metres from the anchor."""
        return self.curve.inward(-self.way * metres, -self.way * lo)

    def after_many(self, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return ``after`` of many."""
        return self.curve.inward_many(-self.way * metres, -self.way * lo)

    def far_m(self, a: float, b: float) -> float:
        """Return a bound on the distance from the origin between two coordinates."""
        return abs(self.centre) + self.curve.b_m * max(a, b)

    def next(self, u: DoubleDouble, chord_m: float, direction: int) -> tuple[DoubleDouble, int]:
        """Return the nearest place at a chord: further out, or further in."""
        (theta, low), chord = u, chord_m / self._b_m
        if direction == self.way:
            delta, spent = step(theta, chord, first_guess(theta, chord))
            more = delta + low              # double_double.plus, written out
            outer = theta + more
            return DoubleDouble(outer, more - (outer - theta)) if delta < inf else _NOWHERE_OUT, spent
        delta, spent = step_in(theta, chord, first_guess_in(theta, chord), self._arc(chord_m))
        return DoubleDouble(*plus(theta, low, -delta)) if delta < inf else _NOWHERE_IN, spent

    def pace(self, u: DoubleDouble, to: DoubleDouble) -> float:
        """Return the speed of the handle at ``to`` for unit speed at ``u``: cos alpha / cos beta of their link.

        With s = sin(delta / 2) the link's way along the tangent at theta is that of ``front`` over sqrt(1 + theta^2).
        """
        inner, outer = (u, to) if u < to else (to, u)
        theta, far, delta = inner[0], outer[0], (outer[0] - inner[0]) + (outer[1] - inner[1])
        s, c = sin(0.5 * delta), cos(0.5 * delta)
        across = 2 * theta * s
        front, back = delta * (1 - 2 * s * s) - across * s + across * far * c, delta + across * (s + far * c)
        w_inner, w_outer = front * sqrt(1 + far * far), back * sqrt(1 + theta * theta)
        return w_inner / w_outer if inner is u else w_outer / w_inner

    @cached_property
    def _b_m(self) -> float:
        return self.curve.b_m

    def _arc(self, chord_m: float) -> float:
        """Return the longest arc that a chord spans on this segment, in units of b."""
        return reach_m(self.bend, chord_m) / self.curve.b_m

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past | None) -> tuple[Floats, int]:
        """Return the changes of many coordinates to the next places, infinite where there is none, and evaluations."""
        if direction == self.way:
            return self.shifts_outwards(u, chord_m, past)
        chord, ahead = chord_m / self.curve.b_m, _ahead(past)
        inner = None if ahead is None else u * u - ahead
        guess = (first_guesses_in(u, chord) if inner is None or np.any(inner <= 0) else
                 ahead / (u + np.sqrt(inner)))
        delta, spent = steps_in(u, chord, guess, self._arc(chord_m))
        return -delta, spent

    def shifts_outwards(self, u: Floats, chord_m: float | Floats, past: Past | None) -> tuple[Floats, int]:
        """Return ``shifts`` to places further out, at one chord for all or at one for each."""
        chord, ahead = chord_m / self.curve.b_m, _ahead(past)
        guess = first_guesses(u, chord) if ahead is None else ahead / (u + np.sqrt(u * u + ahead) + TINY)
        return steps(u, chord, guess)

    def reaches_once(self, u: Floats, shift: Floats) -> bool:
        """Return whether chords grow all the way over changes of coordinates of one sign, so that no nearer places are.

        Outwards they do up to half a turn (``tracks.chord``), inwards up to an arc of pi / bend (``chord.reach_m``).
        """
        if shift.flat[0] > 0:
            return float(np.max(shift)) <= pi
        return self.bend * self.curve.b_m * float(np.max(-shift * np.sqrt(1 + u * u))) <= pi

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return the differences of squared angles of changes of coordinates."""
        out: Floats = np.abs(shift * (2 * u + shift))
        return out

    def march(self, u: DoubleDouble, links: tuple[int, float], direction: int,
              edge: float) -> tuple[list[float], list[float], int]:
        """Return the coordinates of up to so many handles (this loop is the hot one: it makes no objects)."""
        return self._march_out(u, links, edge) if direction == self.way else self._march_in(u, links, edge)

    def _march_out(self, u: DoubleDouble, links: tuple[int, float],
                   edge: float) -> tuple[list[float], list[float], int]:
        (theta, low), (count, chord_m) = u, links
        highs, lows, spent, chord = list[float](), list[float](), 0, chord_m / self.curve.b_m
        d1 = d2 = d3 = 0.0
        for _ in range(count):
            square = 3 * (d1 - d2) + d3 if d3 else d1       # next_square
            guess = square / (theta + sqrt(theta * theta + square)) if square > 0 else first_guess(theta, chord)
            delta, evaluations = step(theta, chord, guess)
            spent += evaluations
            more = delta + low                  # double_double.plus, written out
            outer = theta + more
            if outer > edge or delta == inf:
                break
            d1, d2, d3 = delta * (2 * theta + delta), d1, d2
            theta, low = outer, more - (outer - theta)
            highs.append(theta)
            lows.append(low)
        return highs, lows, spent

    def _march_in(self, u: DoubleDouble, links: tuple[int, float], edge: float) -> tuple[list[float], list[float], int]:
        (theta, low), (count, chord_m), b_m = u, links, self.curve.b_m
        highs, lows, spent, chord, arc = list[float](), list[float](), 0, chord_m / b_m, self._arc(chord_m)
        d1 = d2 = d3 = 0.0
        for _ in range(count):
            square = 3 * (d1 - d2) + d3 if d3 else d1       # next_square
            guess = (square / (theta + sqrt(theta * theta - square)) if 0 < square < theta * theta else
                     first_guess_in(theta, chord))
            delta, evaluations = step_in(theta, chord, guess, arc)
            spent += evaluations
            inner, inner_lo = plus(theta, low, -delta)
            if not inner >= edge:
                break
            d1, d2, d3 = delta * (2 * theta - delta), d1, d2
            theta, low = inner, inner_lo
            highs.append(theta)
            lows.append(low)
        return highs, lows, spent


def _turn(angle: Any) -> Any:
    """Return exp(i angle) of one or many: for one, numpy takes several times as long."""
    return cmath.rect(1.0, angle) if type(angle) is float else np.exp(1j * angle)
