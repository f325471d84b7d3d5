"""The curve r = b theta, b = pitch / 2 pi (paper, equation 1): arc length and its inverse, points, tangents.

Places are polar angles, counted from the centre outwards, so they grow from the head to the tail of a dragon that
winds in.
"""
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import asinh, pi, sqrt
from math import log as log_of
from typing import Any

import numpy as np

from dragon_ros.core.errors import TrackEndError
from dragon_ros.core.numerics.double_double import DoubleDouble, from_turns, per_radian, plus, product
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.tracks.spec import Spiral

TINY = 1e-300           # keeps a quotient of nothing by nothing at nothing
_ROUNDING = 1e-15       # of the length: a distance to the centre may exceed it by rounding
_NEWTON_STEPS = 20
_NEAR_RAD = 1e-6        # a Newton step towards an angle: the next error is smaller by four digits at least
_SMOOTH_RAD = 10.0      # from here on one Newton step from the asymptotic series is right to 1e-9


@dataclass(frozen=True, eq=False)
class SpiralCurve:
    """The spiral of a pitch, with arc lengths counted from the polar angle ``start``."""

    pitch_m: float
    start: DoubleDouble

    @classmethod
    def of(cls, spiral: Spiral) -> 'SpiralCurve':
        """Return the curve of a spec; distances count from where the head starts."""
        return cls(spiral.pitch_m, spiral.start)

    @cached_property
    def b_m(self) -> float:
        """Radius gained for each radian."""
        return self.pitch_m / (2 * pi)

    @cached_property
    def length_m(self) -> float:
        """Arc length from the start to the centre: S(theta) = b/2 (theta sqrt(1 + theta^2) + asinh theta)."""
        return self.distance_to(0.0)

    def inward(self, distance_m: float, distance_lo_m: float = 0.0) -> DoubleDouble:
        """Return the place that lies some arc length further in than the start (negative: further out).

        Solved for the angle turned, from a difference of arc lengths, in floats; what floats then miss is made up for
        with twice their digits, so that none are lost far from the centre or after a long way.
        Raises TrackEndError beyond the centre.
        """
        if distance_m > self.length_m * (1 + _ROUNDING):
            raise TrackEndError(f'{distance_m:.9g} m along the track is beyond its end, the centre, at '
                                f'{self.length_m:.9g} m', distance_m=distance_m, limit_m=self.length_m)
        if distance_m == 0 or distance_m >= self.length_m:
            return DoubleDouble(0.0, 0.0) if distance_m else self.start
        return DoubleDouble(*self._corrected(self._turned(distance_m / self.b_m), distance_m, distance_lo_m))

    def inward_many(self, distance_m: Floats, distance_lo_m: Floats) -> tuple[Floats, Floats]:
        """Return ``inward`` of many distances at once as (hi, lo), to the last digits and not bit for bit."""
        arc, theta = distance_m / self.b_m, self.start.hi
        if np.all(_is_smooth(theta, arc)):
            return self._corrected(_almost_turned(theta, arc, *_ARRAYS), distance_m, distance_lo_m, *_ARRAYS[:2])
        inside = (distance_m < self.length_m) & (distance_m != 0)
        self.inward(float(np.max(distance_m)))      # beyond the centre it raises
        turned = 2 * arc / (theta + np.sqrt(np.maximum(theta * theta - 2 * arc, 0.0)))
        for _ in range(_NEWTON_STEPS):      # the arc is concave in the angle: from the first step on they come nearer
            between, slope = _arc_and_slope(theta, turned, *_ARRAYS[:2])
            step = np.where(inside, (between - arc) / slope, 0.0)
            turned = turned - step
            if np.max(np.abs(step)) < _NEAR_RAD:
                break
        high, low = self._corrected(turned, distance_m, distance_lo_m, *_ARRAYS[:2])
        ends = np.where(distance_m == 0, self.start.hi, 0.0), np.where(distance_m == 0, self.start.lo, 0.0)
        return np.where(inside, high, ends[0]), np.where(inside, low, ends[1])

    @cached_property
    def _per_b(self) -> DoubleDouble:
        """1 / b in 1/m."""
        return from_turns(1 / Fraction(self.pitch_m))

    @cached_property
    def _outer(self) -> tuple[float, float]:
        """At the start: w = sqrt(1 + theta^2) and theta / (w + theta)."""
        theta = self.start.hi
        w = sqrt(1 + theta * theta)
        return w, theta / (theta + w)

    def _corrected(self, turned: Any, distance_m: Any, distance_lo_m: Any, root: Any = sqrt,
                   asinh_of: Any = asinh) -> tuple[Any, Any]:
        """Return the place after an angle turned that is right to 1e-9, made right to the last digit.

        2 S = theta^2 + theta / (w + theta) + asinh theta, w^2 = 1 + theta^2: only the squares need many digits.
        """
        (theta, theta_lo), (w_outer, rest), (per_b, per_b_lo) = self.start, self._outer, self._per_b
        inner = theta - turned
        w_inner = root(1 + inner * inner)
        asinh_between = asinh_of(turned * (theta + inner) / (theta * w_inner + inner * w_outer + TINY))
        both, both_lo = plus(2 * theta, 2 * theta_lo, -turned)
        squares, squares_lo = product(turned, both)
        squares_lo += turned * both_lo + (rest - inner / (inner + w_inner)) + asinh_between
        wanted, wanted_lo = product(distance_m, per_b)
        wanted_lo += distance_m * per_b_lo + distance_lo_m * per_b
        missing = (wanted - 0.5 * squares) + (wanted_lo - 0.5 * squares_lo)
        return plus(theta, theta_lo - missing / w_inner, -turned)

    def distance_to(self, theta: float) -> float:
        """Return the arc length from the start inwards to polar angle ``theta``, in metres."""
        return float(self.b_m * arc_between(self.start.hi, self.start.hi - theta))

    def distance_of(self, theta: float, lo: float) -> tuple[float, float]:
        """Return the arc length from the start inwards to polar angle theta + lo in metres, as (hi, lo): ``inward``."""
        (start, start_lo), (w_outer, rest), (b_m, b_lo_m) = self.start, self._outer, per_radian(self.pitch_m)
        w_inner = sqrt(1 + theta * theta)
        turned, turned_lo = plus(start, start_lo - lo, -theta)
        both, both_lo = plus(start, start_lo + lo, theta)
        squares, squares_lo = product(turned, both)
        squares_lo += turned * both_lo + turned_lo * both + (rest - theta / (theta + w_inner))
        squares_lo += asinh(turned * both / (start * w_inner + theta * w_outer + TINY))
        metres, metres_lo = product(0.5 * squares, b_m)
        return metres, metres_lo + 0.5 * (squares * b_lo_m + squares_lo * b_m)

    def _turned(self, arc: float) -> float:
        """Return the angle between the start and the place ``arc`` (in units of b) further in."""
        theta = self.start.hi
        if _is_smooth(theta, arc):
            return float(_almost_turned(theta, arc))
        squared = theta * theta - 2 * arc
        guess = 2 * arc / (theta + sqrt(max(squared, 0.0))) if arc else 0.0
        low, high = (0.0, theta) if arc >= 0 else (-2 * sqrt(-2 * arc) - 1.0, 0.0)

        def beyond(turned: float) -> tuple[float, float]:
            between, slope = _arc_and_slope(theta, turned)
            return between - arc, slope

        return bracketed_newton(beyond, low, high, guess, 1e-16)[0] if arc else 0.0


_ARRAYS = np.sqrt, np.arcsinh, np.log      # in place of the functions of floats


def _is_smooth(theta: float, arc: Any) -> Any:
    """Say where ``_almost_turned`` is right to 1e-9: start and end some turns away from the centre."""
    return (theta > _SMOOTH_RAD) & (theta * theta - 2 * arc > _SMOOTH_RAD * _SMOOTH_RAD)


def _almost_turned(theta: float, arc: Any, root: Any = sqrt, asinh_of: Any = asinh, log: Any = log_of) -> Any:
    """Return about the angle turned over an arc (in units of b): one Newton step from theta^2 + log theta = 2 S + c."""
    squared = theta * theta - 2 * arc
    bent = log(theta / root(squared))
    turned = (2 * arc - bent) / (theta + root(squared + bent))
    between, w_inner = _arc_and_slope(theta, turned, root, asinh_of)
    return turned - (between - arc) / w_inner


def arc_between(theta: Any, turned: Any) -> Any:
    """Return the arc length from theta - turned to theta in units of b, without cancellation, floats or arrays.

    Each difference of the closed form is written as ``turned`` times a positive factor.
    """
    if isinstance(turned, np.ndarray):
        return _arc_and_slope(theta, turned, np.sqrt, np.arcsinh)[0]
    return _arc_and_slope(theta, turned)[0]


def _arc_and_slope(theta: Any, turned: Any, root: Any = sqrt, asinh_of: Any = asinh) -> tuple[Any, Any]:
    """Return ``arc_between`` and its slope by ``turned``, sqrt(1 + (theta - turned)^2)."""
    inner, w_outer = theta - turned, root(1 + theta * theta)
    w_inner, change = root(1 + inner * inner), turned * (theta + inner)
    along = turned * w_outer + inner * change / (w_outer + w_inner)
    return 0.5 * (along + asinh_of(change / (theta * w_inner + inner * w_outer + TINY))), w_inner


def points(b_m: float, theta: Floats, theta_lo: Floats) -> Floats:
    """Return the places at polar angles theta + theta_lo as (..., 2) coordinates in metres about the centre."""
    cos, sin = np.cos(theta), np.sin(theta)
    radius = b_m * theta
    out = np.empty((*theta.shape, 2))
    out[..., 0] = radius * (cos - theta_lo * sin)
    out[..., 1] = radius * (sin + theta_lo * cos)
    return out


def tangents(theta: Floats) -> Floats:
    """Return unit tangents pointing outwards, shape (..., 2)."""
    cos, sin = np.cos(theta), np.sin(theta)
    out = np.empty((*theta.shape, 2))
    out[..., 0] = cos - theta * sin
    out[..., 1] = sin + theta * cos
    out /= np.sqrt(1 + theta * theta)[..., None]
    return out
