"""The spiral r = b theta with b = pitch / 2 pi (the paper's eq. 1): arc lengths, chords, and segments in the plane.

Positions are polar angles that grow outwards from the centre, so they increase from the head to the tail of a dragon
that winds in. The chord c between polar angles theta and theta + delta, in units of b, satisfies

    c^2 = delta^2 + 4 theta (theta + delta) sin^2(delta / 2),

which is the law of cosines (the paper's equation 15) in a form without cancellation. Inwards, delta has the opposite
sign. The smallest root delta > 0 gives the next handle. Half the slope of c^2 (``phi`` below) is positive for outward
steps up to delta = pi, where c = 2 theta + pi. Links with smaller chords therefore have exactly one root in this range.

The equation is solved for one position or for many positions at once, with the same predictor. Along a spiral, the
squared angles of consecutive handles differ by almost twice the chord, so a parabola through the last three
differences predicts the next difference.
"""
import cmath
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import asin, asinh, cos, inf, pi, sin, sqrt
from math import log as log_of
from typing import Any

import numpy as np

from dragon_ros.core.errors import ChainLockError, TrackEndError
from dragon_ros.core.numerics.double_double import DoubleDouble, from_turns, per_radian, plus, product
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.core.tracks.segments import Past, reach_m
from dragon_ros.core.tracks.spec import Spiral

TINY = 1e-300           # added to a denominator so that 0 / 0 becomes 0
_ROUNDING = 1e-15       # how far rounding may put a distance beyond the centre, relative to the length of the spiral
_NEWTON_STEPS = 20
_NEAR_RAD = 1e-6        # after a Newton step smaller than this angle, the error is at least four digits smaller still
_SMOOTH_RAD = 10.0      # from this angle on, one Newton step from the asymptotic series is accurate to 1e-7
TIGHT = 1e-8            # final Newton step, relative to the angle; half its square is below the resolution of floats
_TAME_RAD = 1.5         # for smaller spans, plain Newton iteration converges from any initial guess used here
_CHORD_STEPS = 12       # maximum number of plain Newton steps, after which the bracketed solver is used
_NOWHERE_OUT, _NOWHERE_IN = DoubleDouble(inf, 0.0), DoubleDouble(-inf, 0.0)


@dataclass(frozen=True, eq=False)
class SpiralCurve:
    """A spiral of a given pitch, whose arc lengths are measured from the polar angle ``start``."""

    pitch_m: float
    start: DoubleDouble

    @classmethod
    def of(cls, spiral: Spiral) -> 'SpiralCurve':
        """Return the curve of a spec; distances are measured from the head's initial position."""
        return cls(spiral.pitch_m, spiral.start)

    @cached_property
    def b_m(self) -> float:
        """Increase of the radius per radian of polar angle, in metres."""
        return self.pitch_m / (2 * pi)

    @cached_property
    def length_m(self) -> float:
        """Arc length from the start to the centre: S(theta) = b/2 (theta sqrt(1 + theta^2) + asinh theta)."""
        return self.distance_to(0.0)

    def inward(self, distance_m: float, distance_lo_m: float = 0.0) -> DoubleDouble:
        """Return the position at an arc length inwards from the start (outwards if it is negative).

        The angle turned is first computed in floats from a difference of arc lengths. Double-double arithmetic then
        corrects the rounding error, so that no digits are lost far from the centre or after a long distance. Raises
        TrackEndError beyond the centre.
        """
        if distance_m > self.length_m * (1 + _ROUNDING):
            raise TrackEndError(f'{distance_m:.9g} m along the track is beyond the centre, where the track ends at '
                                f'{self.length_m:.9g} m', distance_m=distance_m, limit_m=self.length_m)
        if distance_m == 0 or distance_m >= self.length_m:
            return DoubleDouble(0.0, 0.0) if distance_m else self.start
        return DoubleDouble(*self._corrected(self._turned(distance_m / self.b_m), distance_m, distance_lo_m))

    def inward_many(self, distance_m: Floats, distance_lo_m: Floats) -> tuple[Floats, Floats]:
        """Return the positions for many distances, as (hi, lo); they may differ from ``inward`` in the last digits."""
        arc, theta = distance_m / self.b_m, self.start.hi
        if np.all(_is_smooth(theta, arc)):
            return self._corrected(_almost_turned(theta, arc, *_ARRAYS), distance_m, distance_lo_m, *_ARRAYS[:2])
        inside = (distance_m < self.length_m) & (distance_m != 0)
        self.inward(float(np.max(distance_m)))      # raises an error beyond the centre
        turned = 2 * arc / (theta + np.sqrt(np.maximum(theta * theta - 2 * arc, 0.0)))
        for _ in range(_NEWTON_STEPS):      # the arc is concave in the angle, so steps converge from one side
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
        """The values of w = sqrt(1 + theta^2) and theta / (w + theta) at the start."""
        theta = self.start.hi
        w = sqrt(1 + theta * theta)
        return w, theta / (theta + w)

    def _corrected(self, turned: Any, distance_m: Any, distance_lo_m: Any, root: Any = sqrt,
                   asinh_of: Any = asinh) -> tuple[Any, Any]:
        """Return the position after turning by an angle, whose error of up to 1e-7 is corrected to the last digit.

        With 2 S = theta^2 + theta / (w + theta) + asinh theta and w^2 = 1 + theta^2, only the squares need extra
        digits.
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
        """Return the arc length from the start to polar angle theta + lo as (hi, lo), the inverse of ``inward``."""
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
        """Return the angle between the start and the position at an arc length ``arc`` (in units of b) inwards."""
        theta = self.start.hi
        if _is_smooth(theta, arc):
            return float(_almost_turned(theta, arc))
        squared = theta * theta - 2 * arc
        guess = 2 * arc / (theta + sqrt(max(squared, 0.0)) + TINY)
        low, high = (0.0, theta) if arc >= 0 else (-2 * sqrt(-2 * arc) - 1.0, 0.0)

        def beyond(turned: float) -> tuple[float, float]:
            between, slope = _arc_and_slope(theta, turned)
            return between - arc, slope

        return bracketed_newton(beyond, low, high, guess, 1e-16)[0]


_ARRAYS = np.sqrt, np.arcsinh, np.log      # array versions of the functions for floats


def _is_smooth(theta: float, arc: Any) -> Any:
    """Return whether both ends of an arc are so far from the centre that ``_almost_turned`` is accurate to 1e-7."""
    return (theta > _SMOOTH_RAD) & (theta * theta - 2 * arc > _SMOOTH_RAD * _SMOOTH_RAD)


def _almost_turned(theta: float, arc: Any, root: Any = sqrt, asinh_of: Any = asinh, log: Any = log_of) -> Any:
    """Return the approximate angle over an arc in units of b: a Newton step from theta^2 + log theta = 2 S + c."""
    squared = theta * theta - 2 * arc
    bent = log(theta / root(squared))
    turned = (2 * arc - bent) / (theta + root(squared + bent))
    between, w_inner = _arc_and_slope(theta, turned, root, asinh_of)
    return turned - (between - arc) / w_inner


def arc_between(theta: Any, turned: Any) -> Any:
    """Return the arc length from theta - turned to theta in units of b, without cancellation, for floats or arrays.

    Each difference in the closed form is written as ``turned`` times a positive factor.
    """
    if isinstance(turned, np.ndarray):
        return _arc_and_slope(theta, turned, np.sqrt, np.arcsinh)[0]
    return _arc_and_slope(theta, turned)[0]


def _arc_and_slope(theta: Any, turned: Any, root: Any = sqrt, asinh_of: Any = asinh) -> tuple[Any, Any]:
    """Return ``arc_between`` and its derivative with respect to ``turned``, sqrt(1 + (theta - turned)^2)."""
    inner, w_outer = theta - turned, root(1 + theta * theta)
    w_inner, change = root(1 + inner * inner), turned * (theta + inner)
    along = turned * w_outer + inner * change / (w_outer + w_inner)
    return 0.5 * (along + asinh_of(change / (theta * w_inner + inner * w_outer + TINY))), w_inner


def points(b_m: float, theta: Floats, theta_lo: Floats) -> Floats:
    """Return the points at polar angles theta + theta_lo, relative to the centre (m, shape (..., 2))."""
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


def first_guess(theta: float, chord: float) -> float:
    """Return the approximate angle that a chord spans, using the spiral's radius halfway along the chord."""
    return 2 * asin(min(1.0, chord / (2 * theta + chord / (theta + 1) + TINY)))


def first_guess_in(theta: float, chord: float) -> float:
    """Return the approximate angle that a chord spans inwards, using the spiral's radius halfway along the chord."""
    return 2 * asin(min(1.0, chord / (2 * theta - min(theta, chord / theta))))


def next_square(d1: float, d2: float, d3: float) -> float:
    """Predict a difference of squared angles from the parabola through the last three; d1 is the latest."""
    return 3 * (d1 - d2) + d3


def step(theta: float, chord: float, guess: float) -> tuple[float, int]:
    """Return the smallest delta > 0 with the given chord (inf if the chain locks), and the number of evaluations.

    ``chord`` is in units of b. After a relative Newton step x, the remaining error is about x^2 / 2, so a step below
    ``TIGHT`` leaves an error below TIGHT^2 / 2 of the link.
    """
    if chord > 2 * theta + pi:
        return _far_step(theta, chord)
    square, delta = chord * chord, guess
    for evaluations in range(1, _CHORD_STEPS):
        half = 0.5 * delta
        s = sin(half)
        across = 2 * theta * s
        outer = theta + delta
        phi = delta + across * s + across * outer * cos(half)
        change = 0.5 * (delta * delta + 2 * across * outer * s - square) / phi
        delta -= change
        if not 0.0 < delta <= pi:
            break
        if -TIGHT * delta <= change <= TIGHT * delta and delta < _TAME_RAD:
            return delta, evaluations
    delta, more = bracketed_newton(lambda d: chord_excess(theta, chord, d), 0.0, pi, guess)
    return delta, evaluations + more


def step_in(theta: float, chord: float, guess: float, arc: float) -> tuple[float, int]:
    """Return the inward angle to the next position (inf if there is none), and the number of evaluations.

    ``chord`` is in units of b. From theta to theta - delta, the chord satisfies c^2 = delta^2 + 4 theta (theta -
    delta) sin^2(delta / 2). ``arc`` is an arc length within which the chord grows to at least c (see ``reach_m``).
    The search ends at ``high``, an angle that spans slightly more than this arc.
    """
    square, high, delta = chord * chord, _furthest_in(theta, arc), guess
    for evaluations in range(1, _CHORD_STEPS):
        half = 0.5 * delta
        s, inner = sin(half), theta - delta
        across = 2 * theta * s
        slope = delta - across * s + across * inner * cos(half)
        change = (0.5 * (delta * delta - square) + across * inner * s) / slope if slope > 0 else inf
        delta -= change
        if not 0.0 < delta <= high:
            break
        if -TIGHT * delta <= change <= TIGHT * delta:
            return delta, evaluations

    def excess(delta: float) -> tuple[float, float]:
        value, phi = chord_excess(theta, chord, -delta)
        return value, -phi

    if excess(high)[0] < 0:
        return inf, evaluations + 1
    delta, more = bracketed_newton(excess, 0.0, high, 0.5 * high, TIGHT)
    return delta, evaluations + 1 + more


def _furthest_in(theta: float, arc: float) -> float:
    """Return an inward angle from theta that spans at least ``arc`` (in units of b), or the angle to the centre."""
    return 2 * arc / (theta + sqrt(theta * theta - 2 * arc)) if 2 * arc < theta * theta else theta


def first_guesses(theta: Floats, chord: float | Floats) -> Floats:
    """Return the results of ``first_guess`` for many angles."""
    out: Floats = 2 * np.arcsin(np.minimum(1.0, chord / (2 * theta + chord / (theta + 1) + TINY)))
    return out


def steps(theta: Floats, chord: float | Floats, guess: Floats) -> tuple[Floats, int]:
    """Return the smallest delta > 0 for each theta (see ``step``), and the total number of evaluations.

    ``chord`` is one value for all angles, or one value for each. Raises ChainLockError with the first ``theta_rad``
    for which no such delta exists.
    """
    if not np.any(chord):
        return np.zeros_like(theta), 0
    plain = _plain_steps(theta, chord * chord, guess) if theta.size else None
    if plain:
        return plain
    delta, spent, square = guess.copy(), 0, chord * chord
    wild = np.ones(theta.shape, dtype=bool)
    for _ in range(_CHORD_STEPS):
        half = 0.5 * delta
        s = np.sin(half)
        across, outer = 2 * theta * s, theta + delta
        phi = delta + across * (s + outer * np.cos(half))
        change = 0.5 * (delta * delta + 2 * across * outer * s - square) / np.maximum(phi, 1e-300)
        delta = np.clip(delta - change, 1e-300, pi)
        spent += theta.size
        wild = (np.abs(change) > TIGHT * delta) | (delta >= _TAME_RAD)
        if not np.any(wild & (delta < _TAME_RAD)):
            break
    each = np.broadcast_to(chord, theta.shape)
    for lane in np.flatnonzero(wild):
        one, length = float(theta[lane]), float(each[lane])
        delta[lane], evaluations = step(one, length, first_guess(one, length))
        spent += evaluations
        if delta[lane] == inf:
            raise ChainLockError('locked', theta_rad=one)
    return delta, spent


def _plain_steps(theta: Floats, square: float | Floats, delta: Floats) -> tuple[Floats, int] | None:
    """Return the result of ``steps`` by plain Newton iteration, or None unless all links are short and converge."""
    for evaluations in range(1, _CHORD_STEPS):
        half = 0.5 * delta
        s = np.sin(half)
        across, outer = 2 * theta * s, theta + delta
        change = 0.5 * (delta * delta + 2 * across * outer * s - square) / (delta + across * (s + outer * np.cos(half)))
        delta = delta - change
        if not (delta.min() > 0 and delta.max() < _TAME_RAD):
            return None
        if (np.abs(change) <= TIGHT * delta).all():
            return delta, evaluations * theta.size
    return None


def corrections(theta: Floats, delta: Floats, chord: Floats | float) -> tuple[Floats, Floats]:
    """Return the Newton steps of many ``delta`` (of either sign) towards ``chord``, and d(theta + delta) / d theta."""
    half, outer = 0.5 * delta, theta + delta
    s = np.sin(half)
    across = 2 * theta * s
    phi = delta + across * (s + outer * np.cos(half))
    return ((0.5 * (chord * chord - delta * delta) - across * outer * s) / phi,
            1 - 2 * (theta + outer) * s * s / phi)


def first_guesses_in(theta: Floats, chord: float) -> Floats:
    """Return the results of ``first_guess_in`` for many angles."""
    out: Floats = 2 * np.arcsin(np.minimum(1.0, chord / (2 * theta - np.minimum(theta, chord / theta))))
    return out


def steps_in(theta: Floats, chord: float, guess: Floats, arc: float) -> tuple[Floats, int]:
    """Return the results of ``step_in`` for many angles; angles that do not converge jointly are solved one by one."""
    delta, change, slope, spent = guess, np.zeros_like(theta), np.ones_like(theta), 0
    with np.errstate(all='ignore'):
        for _ in range(_CHORD_STEPS):
            s, inner = np.sin(0.5 * delta), theta - delta
            across = 2 * theta * s
            slope = delta - across * s + theta * inner * np.sin(delta)
            change = (0.5 * (delta * delta - chord * chord) + across * inner * s) / slope
            delta = delta - change
            spent += theta.size
            if np.all(np.abs(change) <= TIGHT * delta):
                break
        high = np.minimum(theta, 2 * arc / (theta + np.sqrt(np.maximum(theta * theta - 2 * arc, 0.0))))
        settled = (np.abs(change) <= TIGHT * delta) & (slope > 0) & (delta > 0) & (delta <= high)
    for n in np.flatnonzero(~settled):
        one = float(theta[n])
        delta[n], evaluations = step_in(one, chord, first_guess_in(one, chord), arc)
        spent += evaluations
    return delta, spent


def chord_excess(theta: float, chord: float, delta: float) -> tuple[float, float]:
    """Return (c(delta)^2 - chord^2) / 2 and its slope phi(delta)."""
    s = sin(0.5 * delta)
    half = 0.5 * (delta * delta - chord * chord) + 2 * theta * (theta + delta) * s * s
    return half, phi_of(theta, delta)


def phi_of(theta: float, delta: float) -> float:
    """Return half the slope of the squared chord, delta + 2 theta sin^2(delta/2) + theta (theta + delta) sin(delta)."""
    s = sin(0.5 * delta)
    return delta + 2 * theta * s * (s + (theta + delta) * cos(0.5 * delta))


def chord_of(theta: float, delta: float) -> float:
    """Return the chord in units of b."""
    s = sin(0.5 * delta)
    return sqrt(delta * delta + 4 * theta * (theta + delta) * s * s)


def _far_step(theta: float, chord: float) -> tuple[float, int]:
    """Return the smallest root beyond delta = pi, or inf if the chord shrinks before it reaches the link's length."""
    low, spent = pi, 0
    while low < chord:
        peak, evaluations = first_peak(theta, low)
        spent += evaluations
        high = low + 2 * pi if peak == inf else peak
        if chord_of(theta, high) >= chord:
            delta, evaluations = bracketed_newton(lambda d: chord_excess(theta, chord, d), low, high, low)
            return delta, spent + evaluations
        if peak < inf:
            return inf, spent
        low = high
    return inf, spent  # pragma: no cover - the chord is at least delta


def first_peak(theta: float, low: float) -> tuple[float, int]:
    """Return the first delta in [low, low + pi] at which the chord stops growing, or inf, and the evaluation count.

    ``low`` is an odd multiple of pi. In this interval, phi is positive at first, falls to a single minimum and rises
    again.
    """
    def phi_slope(delta: float) -> tuple[float, float]:
        s, c = sin(delta), cos(delta)
        outer = theta * (theta + delta)
        return 1 + 2 * theta * s + outer * c, 3 * theta * c - outer * s

    high = low + pi
    if phi_slope(low)[0] >= 0:
        return inf, 1
    lowest, spent = bracketed_newton(phi_slope, low, high, low + 0.5 * pi)
    if phi_of(theta, lowest) > 0:
        return inf, spent
    peak, more = bracketed_newton(lambda d: (-phi_of(theta, d), -phi_slope(d)[0]), low, lowest, low)
    return peak, spent + more


def _ahead(past: Past | None) -> Floats | None:
    """Return the predicted differences of squared angles."""
    return np.maximum(next_square(past.d1, past.d2, past.d3), 0.0) if past else None    # type: ignore[arg-type]


@dataclass(frozen=True)
class SpiralSegment:
    """A part of the spiral r = pitch / 2 pi * theta about ``centre``, rotated by ``rotation``.

    ``side`` is 1 if the spiral winds out to the left, and -1 otherwise. ``way`` is 1 if the head winds out, and -1 if
    it winds in. The anchor is at ``curve.start``.
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
        """Largest curvature (1/m), which occurs at the inner end."""
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
        """Return the unit tangent in the head's direction."""
        if type(u) is float:
            short = 1 / sqrt(1 + u * u)
            return self._ahead * (cmath.rect(1.0, self.side * u)
                                  * complex((1.0 - u * lo) * short, self.side * u * short))
        return self._ahead * (np.exp(1j * self.side * u) * ((1 - u * lo + 1j * self.side * u) / np.sqrt(1 + u * u)))

    def poses(self, u: Floats, lo: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents at many positions, with each sine and cosine computed once."""
        turn, turned = np.exp(1j * self.side * u), 1j * self.side
        return (self.centre + self._scaled * u * (turn * (1 + turned * lo)),
                self._ahead * (turn * ((1 - u * lo + turned * u) / np.sqrt(1 + u * u))))

    def rate(self, u: Any) -> Any:
        """Return the distance in metres per radian."""
        root = sqrt if type(u) is float else np.sqrt
        return self.way * self.curve.b_m * root(1 + u * u)

    def metres(self, u: Any) -> Any:
        """Return the distance from the anchor to u."""
        start = self.curve.start.hi
        return -self.way * self.curve.b_m * arc_between(start, start - u)

    def metres_lo(self, u: Any, lo: Any) -> Any:
        """Return the low part of ``metres``."""
        metres, more = self.curve.distance_of(u, lo)
        return (-self.way * metres - self.metres(u)) - self.way * more

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between two coordinates, computed without cancellation."""
        return abs(self.curve.b_m * arc_between(b, b - a))

    def curvature(self, u: Any) -> Any:
        """Return the signed curvature (1/m), which is 0 at infinity."""
        square = 1 + u * u
        return self.side * self.way / self.curve.b_m * (1 + 1 / square) / np.sqrt(square)

    def after(self, metres: float, lo: float = 0.0) -> DoubleDouble:
        """Return the coordinate at a distance in metres from the anchor."""
        return self.curve.inward(-self.way * metres, -self.way * lo)

    def after_many(self, metres: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return the results of ``after`` for many distances."""
        return self.curve.inward_many(-self.way * metres, -self.way * lo)

    def far_m(self, a: float, b: float) -> float:
        """Return an upper bound on the distance from the origin to the segment between two coordinates."""
        return abs(self.centre) + self.curve.b_m * max(a, b)

    def next(self, u: DoubleDouble, chord_m: float, direction: int) -> tuple[DoubleDouble, int]:
        """Return the nearest position that is one chord away, either further out or further in."""
        (theta, low), chord = u, chord_m / self._b_m
        if direction == self.way:
            delta, spent = step(theta, chord, first_guess(theta, chord))
            more = delta + low              # double_double.plus, inlined
            outer = theta + more
            return DoubleDouble(outer, more - (outer - theta)) if delta < inf else _NOWHERE_OUT, spent
        delta, spent = step_in(theta, chord, first_guess_in(theta, chord), self._arc(chord_m))
        return DoubleDouble(*plus(theta, low, -delta)) if delta < inf else _NOWHERE_IN, spent

    @cached_property
    def _b_m(self) -> float:
        return self.curve.b_m

    def _arc(self, chord_m: float) -> float:
        """Return the longest arc that a chord spans on this segment, in units of b."""
        return reach_m(self.bend, chord_m) / self.curve.b_m

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past | None) -> tuple[Floats, int]:
        """Return the coordinate changes to the next positions (inf if there is none), and the number of evaluations."""
        if direction == self.way:
            return self.shifts_outwards(u, chord_m, past)
        chord, ahead = chord_m / self.curve.b_m, _ahead(past)
        guess = (first_guesses_in(u, chord) if ahead is None or np.any((inner := u * u - ahead) <= 0) else
                 ahead / (u + np.sqrt(inner)))
        delta, spent = steps_in(u, chord, guess, self._arc(chord_m))
        return -delta, spent

    def shifts_outwards(self, u: Floats, chord_m: float | Floats, past: Past | None) -> tuple[Floats, int]:
        """Return the result of ``shifts`` for outward steps; ``chord_m`` is one value for all positions or for each."""
        chord, ahead = chord_m / self.curve.b_m, _ahead(past)
        guess = first_guesses(u, chord) if ahead is None else ahead / (u + np.sqrt(u * u + ahead) + TINY)
        return steps(u, chord, guess)

    def reaches_once(self, u: Floats, shift: Floats) -> bool:
        """Return whether chords grow throughout coordinate changes of equal sign, so that no nearer position exists.

        Outwards, chords grow up to half a turn (``phi_of``); inwards, up to an arc length of pi / bend
        (``segments.reach_m``).
        """
        if shift.flat[0] > 0:
            return float(np.max(shift)) <= pi
        return self.bend * self.curve.b_m * float(np.max(-shift * np.sqrt(1 + u * u))) <= pi

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return the differences of squared angles for the given coordinate changes."""
        out: Floats = np.abs(shift * (2 * u + shift))
        return out

    def march(self, u: DoubleDouble, links_m: list[float], direction: int,
              edge: float) -> tuple[list[float], list[float], int]:
        """Return the coordinates of at most ``len(links_m)`` further handles; the loops create no objects."""
        b_m = self.curve.b_m
        chords = [link_m / b_m for link_m in links_m]
        if direction == self.way:
            return self._march_out(u, chords, edge)
        return self._march_in(u, chords, edge, self._arc(max(links_m)))

    @staticmethod
    def _march_out(u: DoubleDouble, chords: list[float], edge: float) -> tuple[list[float], list[float], int]:
        (theta, low), highs, lows, spent = u, list[float](), list[float](), 0
        d1 = d2 = d3 = 0.0
        before = 1.0
        for chord in chords:
            square = 3 * (d1 - d2) + d3 if d3 else d1       # next_square
            if chord != before:
                square, before = d1 * chord / before, chord
                d1 = d2 = 0.0
            guess = square / (theta + sqrt(theta * theta + square)) if square > 0 else first_guess(theta, chord)
            delta, evaluations = step(theta, chord, guess)
            spent += evaluations
            more = delta + low                  # double_double.plus, inlined
            outer = theta + more
            if outer > edge or delta == inf:
                break
            d1, d2, d3 = delta * (2 * theta + delta), d1, d2
            theta, low = outer, more - (outer - theta)
            highs.append(theta)
            lows.append(low)
        return highs, lows, spent

    @staticmethod
    def _march_in(u: DoubleDouble, chords: list[float], edge: float,
                  arc: float) -> tuple[list[float], list[float], int]:
        (theta, low), highs, lows, spent = u, list[float](), list[float](), 0
        d1 = d2 = d3 = 0.0
        before = 1.0
        for chord in chords:
            square = 3 * (d1 - d2) + d3 if d3 else d1       # next_square
            if chord != before:
                square, before = d1 * chord / before, chord
                d1 = d2 = 0.0
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
