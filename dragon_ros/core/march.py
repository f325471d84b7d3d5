"""Handle after handle along the spiral: the chord equation, solved by safeguarded Newton.

Between handles at polar angles theta and theta + delta the chord in units of b obeys

    c^2 = delta^2 + 4 theta (theta + delta) sin^2(delta / 2),

the paper's equation 15 in a form without cancellation. Its smallest root delta > 0 is the next handle. Half its
slope, ``phi`` below, is positive up to delta = pi, where c = 2 theta + pi: shorter links have one root there.
"""
from dataclasses import dataclass
from math import asin, cos, inf, pi, sin, sqrt

import numpy as np

from dragon_ros.core.angle import Angle
from dragon_ros.core.chain import SpiralChain
from dragon_ros.core.errors import ChainLockError
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.path import TINY, Spiral, points

TIGHT = 1e-8        # a Newton step that leaves no error that floats can keep
_TRUSTED = 3        # links that follow unchecked, at most


@dataclass(frozen=True)
class Effort:
    """How hard to work on one link, relative to the angle that it spans.

    Newton stops at a step below ``newton``: its next error is about half the square. A prediction is taken unchecked
    while the last check changed less than ``trust`` (0: never).
    """

    newton: float
    trust: float = 0.0


def place(spiral: Spiral, links_m: Floats, head: Angle, effort: Effort) -> SpiralChain:
    """Place every handle behind ``head``. Raises ChainLockError where a link has no place.

    The next link is predicted from theta'^2 - theta^2, which is almost 2 chord: by the parabola through the last
    three, d1, d2 and d3 (this loop is the hot one: it calls little and makes no objects).
    """
    (theta, low), newton, trust = head, effort.newton, effort.trust
    thetas, lows, deltas, spent = [theta], [low], [], 0
    near, tight = near_lock(spiral, links_m), min(newton, TIGHT)
    last, unchecked, d1, d2, d3 = -1.0, 0, 0.0, 0.0, 0.0
    for number, chord in enumerate((links_m / spiral.b_m).tolist()):
        if chord != last:
            last, unchecked, d1, d2, d3 = chord, 0, 0.0, 0.0, 0.0
        square = 3 * (d1 - d2) + d3 if d3 else d1
        guess = delta = square / (theta + sqrt(theta * theta + square)) if square > 0 else first_guess(theta, chord)
        if unchecked:
            unchecked -= 1
        else:
            delta, evaluations = step(theta, chord, guess, newton if theta > near else tight)
            if delta == inf:
                raise locked(spiral, number, theta, chord)
            spent += evaluations
            if d3 and theta > near and abs(delta - guess) < trust * delta:
                unchecked = _TRUSTED
        d1, d2, d3 = delta * (2 * theta + delta), d1, d2
        more = delta + low                  # angle.plus, written out
        outer = theta + more
        theta, low = outer, more - (outer - theta)
        deltas.append(delta)
        thetas.append(theta)
        lows.append(low)
    return chain_of(spiral, links_m, np.array(thetas), np.array(lows), np.array(deltas), spent)


def near_lock(spiral: Spiral, links_m: Floats) -> float:
    """Return a polar angle beyond which no link but the first makes an error of its front handle larger.

    One that does has turned its follower back (``lock``), which it does where it is longer than twice the radius. Up to
    there handles are placed as floats can, for all tiers: what is off before a lock is the more so behind it.
    """
    return 0.5 * float(np.max(links_m[1:], initial=0.0)) / spiral.b_m


def chain_of(spiral: Spiral, links_m: Floats, theta: Floats, theta_lo: Floats, delta: Floats,
             spent: int) -> SpiralChain:
    """Return the chain with its coordinates, closed for writing."""
    p = points(spiral.b_m, theta, theta_lo)
    return SpiralChain(read_only(p), links_m, spent, read_only(theta), read_only(theta_lo), read_only(delta))


def locked(spiral: Spiral, link: int, theta: float, chord: float) -> ChainLockError:
    """Return the error that names the link without a place."""
    radius = spiral.b_m * theta
    return ChainLockError(
        f'the chain locks: link {link} of {chord * spiral.b_m:.6g} m finds no place behind its front handle at radius '
        f'{radius:.6f} m; end the scene earlier, or use shorter benches or a larger pitch',
        link=link, radius_m=radius, theta_rad=theta)


def first_guess(theta: float, chord: float) -> float:
    """Return about the angle that a chord spans, from a circle as wide as the spiral half that angle further out."""
    return 2 * asin(min(1.0, chord / (2 * theta + chord / (theta + 1) + TINY)))


def step(theta: float, chord: float, guess: float, tolerance: float) -> tuple[float, int]:
    """Return (smallest delta > 0 with the given chord, evaluations); inf where the chain locks.

    ``chord`` is in units of b. Newton's next error is about half the square of its last relative step, so a step
    below ``tolerance`` leaves an error below tolerance^2 / 2 of the link.
    """
    if chord > 2 * theta + pi:
        return _far_step(theta, chord)
    if chord == 0.0:
        return 0.0, 0
    square, delta = chord * chord, guess
    for evaluations in range(1, 12):
        half = 0.5 * delta
        s = sin(half)
        across = 2 * theta * s
        outer = theta + delta
        phi = delta + across * s + across * outer * cos(half)
        change = 0.5 * (delta * delta + 2 * across * outer * s - square) / phi
        delta -= change
        if not 0.0 < delta <= pi:
            break
        if -tolerance * delta <= change <= tolerance * delta and delta < 1.5:
            return delta, evaluations
    delta, more = bracketed_newton(lambda d: chord_excess(theta, chord, d), 0.0, pi, guess)
    return delta, evaluations + more


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
