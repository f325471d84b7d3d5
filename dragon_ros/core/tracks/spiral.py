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
from dataclasses import dataclass
from functools import cached_property
from math import asin, asinh, copysign, cos, inf, pi, sin, sqrt
from typing import Any

import numpy as np

from dragon_ros.core.errors import ChainLockError, TrackEndError
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.core.tracks.segments import NEW, Past, direction_at, reach_m
from dragon_ros.core.tracks.spec import Spiral

TINY = 1e-300           # added to a denominator so that 0 / 0 becomes 0
BENT = 1.09             # the curvature of any spiral is at most 1.09 / r: (u^3 + 4 u^2 + 4 u) / (1 + u)^3 <= 32 / 27
BEYOND_M = 1e-6         # how far rounding may put a handle beyond an end of the track: more than any promise
_NEWTON_STEPS = 20
TIGHT = 1e-8            # final Newton step, relative to the angle; half its square is below the resolution of floats
_TAME_RAD = 1.5         # for smaller spans outwards, plain Newton iteration converges from any initial guess used here
_CHORD_STEPS = 12       # maximum number of plain Newton steps, after which the bracketed solver is used


@dataclass(frozen=True, eq=False)
class SpiralCurve:
    """A spiral of a given pitch, whose arc lengths are measured from the polar angle ``start``."""

    pitch_m: float
    start: float

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
        return float(self.distance_to(0.0))

    def inward(self, distance_m: Any) -> Any:
        """Return the position at an arc length inwards from the start (outwards if it is negative), for one or many.

        Newton's method finds the angle turned, from a difference of arc lengths without cancellation. The arc is
        concave in the angle, so the steps converge from one side. Raises TrackEndError beyond the centre.
        """
        many = isinstance(distance_m, np.ndarray)
        root, asinh_of, every = (np.sqrt, np.arcsinh, np.all) if many else (sqrt, asinh, bool)
        furthest = float(np.max(distance_m, initial=-inf)) if many else distance_m
        if furthest > self.length_m + BEYOND_M:
            raise TrackEndError(f'{furthest:.9g} m along the track is beyond the centre, where the track ends at '
                                f'{self.length_m:.9g} m', distance_m=furthest, limit_m=self.length_m)
        arc, theta = distance_m / self.b_m, self.start
        squared = theta * theta - 2 * arc
        turned = 2 * arc / (theta + root(squared * (squared > 0)) + TINY)
        for _ in range(_NEWTON_STEPS):
            between, slope = _arc_and_slope(theta, turned, root, asinh_of)
            change = (between - arc) / slope
            turned = turned - change
            if every(abs(change) <= TIGHT * abs(turned)):
                break
        inner = theta - turned
        return inner * (inner > 0)

    def distance_to(self, theta: Any) -> Any:
        """Return the arc length (m) from the start inwards to polar angle ``theta``; the inverse of ``inward``."""
        return self.b_m * arc_between(self.start, self.start - theta)


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


def first_guess(theta: Any, chord: Any, sense: float = 1.0) -> Any:
    """Return the approximate angle that a chord spans, using the spiral's radius halfway along the chord.

    ``sense`` is 1 outwards and -1 inwards.
    """
    arcsine, least = (asin, min) if type(theta) is float else (np.arcsin, np.minimum)
    rise = chord / (theta + 1) if sense > 0 else -least(theta, chord / theta)
    return 2 * sense * arcsine(least(1.0, chord / (2 * theta + rise + TINY)))


def step(theta: float, chord: float, guess: float, furthest: float = _TAME_RAD) -> tuple[float, int]:
    """Return the nearest delta with the given chord, and the number of evaluations; infinite if there is none.

    ``chord`` is in units of b. Outwards, delta is positive and infinite if the chain locks. Inwards, delta and
    ``furthest`` are negative; between 0 and ``furthest``, the chord grows to at least the given one if it fits on the
    spiral. After a relative Newton step x, the remaining error is about x^2 / 2, so a step below ``TIGHT`` leaves an
    error below TIGHT^2 / 2 of the link.
    """
    square, delta, evaluations = chord * chord, guess, 0
    for evaluations in range(1, _CHORD_STEPS):
        half = 0.5 * delta
        s = sin(half)
        across, outer = 2 * theta * s, theta + delta
        phi = delta + across * (s + outer * cos(half))
        change = 0.5 * (delta * delta + 2 * across * outer * s - square) / phi if phi else inf
        delta -= change
        if not (0.0 < delta <= furthest or furthest <= delta < 0.0):
            break
        if -TIGHT <= change / delta <= TIGHT:
            return delta, evaluations
    found, more = (_wide_step if furthest > 0 else _wide_step_in)(theta, chord, guess, furthest)
    return found, evaluations + more


def _wide_step(theta: float, chord: float, guess: float, _: float) -> tuple[float, int]:
    """Return the result of ``step`` outwards for a link of any span."""
    if chord > 2 * theta + pi:
        return _far_step(theta, chord)
    return bracketed_newton(lambda delta: chord_excess(theta, chord, delta), 0.0, pi, guess)


def _wide_step_in(theta: float, chord: float, _: float, furthest: float) -> tuple[float, int]:
    """Return the result of ``step`` inwards for a link of any span."""
    def excess(turned: float) -> tuple[float, float]:
        value, phi = chord_excess(theta, chord, -turned)
        return value, -phi

    if excess(-furthest)[0] < 0:
        return -inf, 1
    turned, spent = bracketed_newton(excess, 0.0, -furthest, -0.5 * furthest, TIGHT)
    return -turned, 1 + spent


def furthest_in(theta: Any, arc: float) -> Any:
    """Return the change of angle inwards from theta over an arc (in units of b), or to the centre, for one or many."""
    left = theta * theta - 2 * arc
    root = np.sqrt if isinstance(theta, np.ndarray) else sqrt
    return (left <= 0) * -theta - (left > 0) * 2 * arc / (theta + root(left * (left > 0)))


def steps(theta: Floats, chord: float | Floats, guess: Floats,
          furthest: float | Floats = _TAME_RAD) -> tuple[Floats, int]:
    """Return the results of ``step`` for many angles; those that do not converge together are solved one by one.

    ``chord`` is one value for all angles, or one for each. Raises ChainLockError with the first ``theta_rad`` at which
    a link locks.
    """
    delta, spent, settled = guess, 0, np.zeros(theta.shape, dtype=bool)
    with np.errstate(all='ignore'):
        for _ in range(_CHORD_STEPS):
            change, phi, _ = newton_steps(theta, delta, chord)
            delta = delta - change
            spent += theta.size
            settled = np.abs(change) <= TIGHT * np.abs(delta)
            if np.all(settled | (np.abs(delta) > np.abs(furthest))):
                break
        settled &= (delta * furthest > 0) & (np.abs(delta) <= np.abs(furthest)) & (phi * delta > 0)
    if np.all(settled):
        return delta, spent
    each, far = np.broadcast_to(chord, theta.shape), np.broadcast_to(furthest, theta.shape)
    for n in np.flatnonzero(~settled).tolist():
        one, length, limit = theta.item(n), each.item(n), far.item(n)
        delta[n], evaluations = step(one, length, first_guess(one, length, copysign(1.0, limit)), limit)
        spent += evaluations
        if delta[n] == inf:
            raise ChainLockError('locked', theta_rad=one)
    return delta, spent


def newton_steps(theta: Floats, delta: Floats, chord: Floats | float) -> tuple[Floats, Floats, Floats]:
    """Return the Newton steps that many ``delta`` exceed the root by, half the slopes of c^2, and sin(delta / 2)."""
    half = 0.5 * delta
    s, outer = np.sin(half), theta + delta
    across = 2 * theta * s
    phi = delta + across * (s + outer * np.cos(half))
    return (0.5 * (delta * delta - chord * chord) + across * outer * s) / phi, phi, s


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


@dataclass(frozen=True)
class SpiralSegment:
    """A part of the spiral r = pitch / 2 pi * theta about ``centre``, rotated by ``rotation``.

    ``side`` is 1 if the spiral winds out to the left, and -1 otherwise. ``winding`` is 1 if the head winds out, and -1
    if it winds in. The anchor is at ``curve.start``.
    """

    curve: SpiralCurve
    centre: complex
    rotation: complex
    side: int
    winding: int
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
        return self.rotation * self.winding

    def at(self, u: Any) -> Any:
        """Return the point."""
        return self.centre + self._scaled * u * direction_at(self.side * u)

    def heading(self, u: Any) -> Any:
        """Return the unit tangent in the head's direction."""
        root = sqrt if type(u) is float else np.sqrt
        return self._ahead * (direction_at(self.side * u) * ((1 + 1j * self.side * u) / root(1 + u * u)))

    def poses(self, u: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents at many positions, with each sine and cosine computed once."""
        return self.posed(u, direction_at(self.side * u))

    def posed(self, u: Any, turn: Any) -> tuple[Any, Any]:
        """Return the point and the unit tangent; ``turn`` is exp(i side u)."""
        return (self.centre + self._scaled * u * turn,
                self._ahead * (turn * ((1 + 1j * self.side * u) / np.sqrt(1 + u * u))))

    def rate(self, u: Any) -> Any:
        """Return the distance in metres per radian."""
        root = sqrt if type(u) is float else np.sqrt
        return self.winding * self.curve.b_m * root(1 + u * u)

    def metres(self, u: Any) -> Any:
        """Return the distance from the anchor to u."""
        return -self.winding * self.curve.distance_to(u)

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between two coordinates, computed without cancellation."""
        return abs(self.curve.b_m * arc_between(b, b - a))

    def curvature(self, u: Any) -> Any:
        """Return the signed curvature (1/m), which is 0 at infinity."""
        square = 1 + u * u
        return self.side * self.winding / self.curve.b_m * (1 + 1 / square) / np.sqrt(square)

    def after(self, metres: Any) -> Any:
        """Return the coordinate at a distance in metres from the anchor."""
        return self.curve.inward(-self.winding * metres)

    def far_m(self, a: float, b: float) -> float:
        """Return an upper bound on the distance from the origin to the segment between two coordinates."""
        return abs(self.centre) + self.curve.b_m * max(a, b)

    def _arc(self, chord_m: float) -> float:
        """Return the longest arc that a chord spans on this segment, in units of b."""
        return reach_m(self.bend, chord_m) / self.curve.b_m

    def shifts(self, u: Floats, chord_m: float | Floats, direction: int, past: Past = NEW) -> tuple[Floats, int]:
        """Return the coordinate changes to the next positions (inf if there is none), and the number of evaluations.

        Outwards, ``chord_m`` is one value for all positions or one for each.
        """
        sense, chord = float(direction * self.winding), chord_m / self.curve.b_m
        guess = None
        if len(past.squares) == 3:      # the parabola through the last three
            square = 3 * (past.squares[0] - past.squares[1]) + past.squares[2]
            if np.all((u * u + square > 0) & (sense * square > 0)):
                guess = square / (u + np.sqrt(u * u + square))
        guess = first_guess(u, chord, sense) if guess is None else guess
        return steps(u, chord, guess, _TAME_RAD if sense > 0 else furthest_in(u, self._arc(chord_m)))   # type: ignore

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
        out: Floats = shift * (2 * u + shift)
        return out

    def march(self, u: float, links_m: list[float], direction: int, edge: float) -> tuple[list[float], int]:
        """Return the coordinates of at most ``len(links_m)`` further handles; the loop creates no objects."""
        sense, b_m, spent = float(direction * self.winding), self.curve.b_m, 0
        out: list[float] = []
        bound, arc, furthest = edge * sense, 0.0 if sense > 0 else self._arc(max(links_m)), _TAME_RAD
        before = d1 = d2 = d3 = rest = 0.0
        for link_m in links_m:
            square, chord = 3 * (d1 - d2) + d3 if d3 else d1, link_m / b_m     # the parabola through the last three
            if link_m != before:
                square, before = d1 * link_m / before if before else 0.0, link_m
                d1 = d2 = 0.0
            whole = u * u + square
            guess = square / (u + sqrt(whole)) if whole > 0 and sense * square > 0 else first_guess(u, chord, sense)
            if sense < 0:
                furthest = furthest_in(u, arc)
            delta, evaluations = step(u, chord, guess, furthest)
            spent += evaluations
            change = delta + rest       # Kahan's summation
            following = u + change
            if not following * sense <= bound or delta == inf:
                break
            d1, d2, d3 = delta * (2 * u + delta), d1, d2
            u, rest = following, change - (following - u)
            out.append(u)
        return out, spent
