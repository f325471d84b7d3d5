"""Chords of a track that bends no tighter than half their length: how far they reach, and the next place inwards."""
from math import asin, inf, sin, sqrt

from dragon_ros.core.numerics.roots import bracketed_newton


def step_in(theta: float, chord: float, arc: float, tolerance: float) -> tuple[float, int]:
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

    high = 2 * arc / (theta + sqrt(theta * theta - 2 * arc)) if 2 * arc < theta * theta else theta
    if chord == 0.0:
        return 0.0, 0
    delta = 2 * asin(min(1.0, chord / (2 * theta - min(theta, chord / theta))))     # on the circle half way
    for evaluations in range(1, 12):
        value, slope = excess(delta)
        change = value / slope if slope > 0 else inf
        delta -= change
        if not 0.0 < delta <= high:
            break
        if -tolerance * delta <= change <= tolerance * delta:
            return delta, evaluations
    if excess(high)[0] < 0:
        return inf, evaluations + 1
    delta, more = bracketed_newton(excess, 0.0, high, 0.5 * high, tolerance)
    return delta, evaluations + 1 + more


def reach_m(bend: float, chord_m: float) -> float:
    """Return the longest arc that a chord can span on a track whose curvature in 1/m is at most ``bend``.

    Where the curvature times the chord is below 2, the chord from a place grows along the track until the arc is
    pi / bend: the tangent at arc s differs from those before it, at sigma, by an angle of bend (s - sigma) at most, so
    the chord grows at least as sin(bend s) / (bend chord) > 0. By Schur's comparison with a circle the chord is no
    shorter than 2 sin(bend s / 2) / bend. So it reaches ``chord_m`` once, within 2 asin(bend chord_m / 2) / bend.
    """
    return 2 * asin(0.5 * bend * chord_m) / bend if bend else chord_m
