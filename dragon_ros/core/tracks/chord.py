"""The chord equations: the next place along a segment at a chord's length, one equation a kind of segment.

On a spiral, between polar angles theta and theta + delta, the chord in units of b obeys

    c^2 = delta^2 + 4 theta (theta + delta) sin^2(delta / 2),

the law of cosines, the paper's equation 15, in a form without cancellation; inwards it is the same with -delta. Its
smallest root delta > 0 is the next handle. Half its slope, ``phi`` below, is positive outwards up to delta = pi, where
c = 2 theta + pi: shorter links have one root there. On a line and an arc the answer is in closed form.

Each equation has a scalar solver, one for many places at once, and one predictor: along a spiral the difference of the
squared angles is almost 2 chord, so a parabola through the last three foretells the next.
"""
from math import asin, cos, inf, pi, sin, sqrt

import numpy as np

from dragon_ros.core.errors import ChainLockError
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.tracks.spiral import TINY

LARGEST_BEND = 1.98     # of curvature times chord: at 2 a link may lock; 1 % short of it roots stay well conditioned
TIGHT = 1e-8            # a Newton step, relative to the angle: half its square is less than floats can keep
_TAME_RAD = 1.5         # spans below this are solved by plain Newton, which converges from any of the guesses here
_NEWTON_STEPS = 12      # more than Newton ever takes there; then the bracketed solver takes over


def reach_m(bend: float, chord_m: float) -> float:
    """Return the longest arc that a chord can span on a track whose curvature in 1/m is at most ``bend``.

    Where the curvature times the chord is below 2, the chord from a place grows along the track until the arc is
    pi / bend: the tangent at arc s differs from those before it, at sigma, by an angle of bend (s - sigma) at most, so
    the chord grows at least as sin(bend s) / (bend chord) > 0. By Schur's comparison with a circle the chord is no
    shorter than 2 sin(bend s / 2) / bend. So it reaches ``chord_m`` once, within 2 asin(bend chord_m / 2) / bend.
    """
    return 2 * asin(0.5 * bend * chord_m) / bend if bend else chord_m


def arc_span(radius_m: float, chord_m: float) -> float:
    """Return the angle that a chord spans on a circle."""
    return 2 * asin(chord_m / (2 * radius_m))


def first_guess(theta: float, chord: float) -> float:
    """Return about the angle that a chord spans, from a circle as wide as the spiral half that angle further out."""
    return 2 * asin(min(1.0, chord / (2 * theta + chord / (theta + 1) + TINY)))


def first_guess_in(theta: float, chord: float) -> float:
    """Return about the angle that a chord spans inwards, from the circle half way."""
    return 2 * asin(min(1.0, chord / (2 * theta - min(theta, chord / theta))))


def next_square(d1: float, d2: float, d3: float) -> float:
    """Predict a difference of squared angles from the last three, d1 the latest: the parabola through them."""
    return 3 * (d1 - d2) + d3


def step(theta: float, chord: float, guess: float) -> tuple[float, int]:
    """Return (smallest delta > 0 with the given chord, evaluations); inf where the chain locks.

    ``chord`` is in units of b. Newton's next error is about half the square of its last relative step, so a step
    below ``TIGHT`` leaves an error below TIGHT^2 / 2 of the link.
    """
    if chord > 2 * theta + pi:
        return _far_step(theta, chord)
    if chord == 0.0:
        return 0.0, 0
    square, delta = chord * chord, guess
    for evaluations in range(1, _NEWTON_STEPS):
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
    """Return (angle to the next place inwards with a chord, in units of b, evaluations); inf where there is none.

    From theta to theta - delta the chord obeys c^2 = delta^2 + 4 theta (theta - delta) sin^2(delta / 2), as outwards.
    ``arc`` is a length of track on which the chord grows to c at least (see ``reach_m``); ``high`` is a hair more.
    """
    square = chord * chord

    def excess(delta: float) -> tuple[float, float]:
        s, inner = sin(0.5 * delta), theta - delta
        across = 2 * theta * s
        value = 0.5 * (delta * delta - square) + across * inner * s
        return value, delta - across * s + theta * inner * sin(delta)

    if chord == 0.0:
        return 0.0, 0
    high, delta = _furthest_in(theta, arc), guess
    for evaluations in range(1, _NEWTON_STEPS):
        value, slope = excess(delta)
        change = value / slope if slope > 0 else inf
        delta -= change
        if not 0.0 < delta <= high:
            break
        if -TIGHT * delta <= change <= TIGHT * delta:
            return delta, evaluations
    if excess(high)[0] < 0:
        return inf, evaluations + 1
    delta, more = bracketed_newton(excess, 0.0, high, 0.5 * high, TIGHT)
    return delta, evaluations + 1 + more


def _furthest_in(theta: float, arc: float) -> float:
    """Return an angle that is at least ``arc`` (in units of b) inwards from theta, or the centre."""
    return 2 * arc / (theta + sqrt(theta * theta - 2 * arc)) if 2 * arc < theta * theta else theta


def first_guesses(theta: Floats, chord: float | Floats) -> Floats:
    """Return ``first_guess`` of many."""
    out: Floats = 2 * np.arcsin(np.minimum(1.0, chord / (2 * theta + chord / (theta + 1) + TINY)))
    return out


def steps(theta: Floats, chord: float | Floats, guess: Floats) -> tuple[Floats, int]:
    """Return the smallest delta > 0 for each theta, and evaluations summed over them (see ``step``).

    ``chord`` is one for all, or one for each. Raises ChainLockError, with its ``theta_rad``, where any has no place.
    """
    if not np.any(chord):
        return np.zeros_like(theta), 0
    plain = _plain_steps(theta, chord * chord, guess) if theta.size else None
    if plain:
        return plain
    delta, spent, square = guess.copy(), 0, chord * chord
    wild = np.ones(theta.shape, dtype=bool)
    for _ in range(_NEWTON_STEPS):
        half = 0.5 * delta
        s = np.sin(half)
        across, outer = 2 * theta * s, theta + delta
        phi = delta + across * (s + outer * np.cos(half))
        change = 0.5 * (delta * delta + 2 * across * outer * s - square) / np.maximum(phi, 1e-300)
        delta = np.clip(delta - change, 1e-300, pi)
        spent += theta.size
        wild = (np.abs(change) > TIGHT * delta) | (delta >= _TAME_RAD) | (chord > 2 * theta + pi)
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
    """Return ``steps`` by plain Newton where all settle on short links, the usual case; else None."""
    for evaluations in range(1, _NEWTON_STEPS):
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
    """Return Newton steps of many delta, of either sign, to their chords, and derivatives of theta + delta by theta."""
    half, outer = 0.5 * delta, theta + delta
    s = np.sin(half)
    across = 2 * theta * s
    phi = delta + across * (s + outer * np.cos(half))
    return ((0.5 * (chord * chord - delta * delta) - across * outer * s) / phi,
            1 - 2 * (theta + outer) * s * s / phi)


def first_guesses_in(theta: Floats, chord: float) -> Floats:
    """Return ``first_guess_in`` of many."""
    out: Floats = 2 * np.arcsin(np.minimum(1.0, chord / (2 * theta - np.minimum(theta, chord / theta))))
    return out


def steps_in(theta: Floats, chord: float, guess: Floats, arc: float) -> tuple[Floats, int]:
    """Return ``step_in`` of many, by Newton, and one by one where that does not settle."""
    if not chord:
        return np.zeros_like(theta), 0
    delta, change, slope, spent = guess, np.zeros_like(theta), np.ones_like(theta), 0
    with np.errstate(all='ignore'):
        for _ in range(_NEWTON_STEPS):
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
    """Return the smallest root beyond delta = pi; inf where the chord turns back before it reaches the link."""
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
    """Return where the chord first stops growing in [low, low + pi], low an odd multiple of pi; inf if nowhere.

    There phi starts positive, falls to one lowest place and rises again.
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
