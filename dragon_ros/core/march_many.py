"""The march for many instants at once: one vectorised Newton a link, over all instants.

It solves the same equation as ``march`` and agrees with it to the tier's metres, not bit for bit.
"""
from math import pi

import numpy as np

from dragon_ros.core.angle import plus
from dragon_ros.core.chain import SpiralChain
from dragon_ros.core.errors import ChainLockError
from dragon_ros.core.march import TIGHT, Effort, chain_of, first_guess, locked, near_lock, step
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.path import TINY, Spiral


def place_many(spiral: Spiral, links_m: Floats, theta: Floats, theta_lo: Floats, effort: Effort) -> SpiralChain:
    """Place the chains behind many heads, given as (M,) polar angles; the arrays of the result start with M."""
    count = links_m.size
    out = np.empty((count + 1, theta.size))
    low, deltas = np.empty_like(out), np.empty((count, theta.size))
    out[0], low[0], spent, start = theta, theta_lo, 0, 0
    chords, near, close = (links_m / spiral.b_m).tolist(), near_lock(spiral, links_m), True
    for i, chord in enumerate(chords):
        if i and chord != chords[i - 1]:
            start = i
        try:
            close = close and bool(np.min(out[i], initial=np.inf) <= near)
            newton = min(effort.newton, TIGHT) if close else effort.newton
            deltas[i], evaluations = steps(out[i], chord, _guesses(out, deltas, start, i, chord), newton)
        except ChainLockError as error:
            raise locked(spiral, i, error.fields['theta_rad'], chord) from None
        spent += evaluations
        out[i + 1], low[i + 1] = plus(out[i], low[i], deltas[i])
    return chain_of(spiral, links_m, out.T, low.T, deltas.T, spent)


def head_steps(spiral: Spiral, theta: Floats, chord: float, tolerance: float) -> tuple[Floats, int]:
    """Return ``steps`` of the first link behind many heads. Raises ChainLockError."""
    try:
        return steps(theta, chord, first_guesses(theta, chord), tolerance)
    except ChainLockError as error:
        raise locked(spiral, 0, error.fields['theta_rad'], chord) from None


def first_guesses(theta: Floats, chord: float) -> Floats:
    """Return ``first_guess`` of many."""
    out: Floats = 2 * np.arcsin(np.minimum(1.0, chord / (2 * theta + chord / (theta + 1) + TINY)))
    return out


def _guesses(theta: Floats, delta: Floats, start: int, i: int, chord: float) -> Floats:
    """Predict link i from the equal links since ``start``, as ``march.place`` does."""
    if i - start < 3:
        return first_guesses(theta[i], chord)
    square = delta[i - 3:i] * (2 * theta[i - 3:i] + delta[i - 3:i])
    ahead = np.maximum(3 * (square[2] - square[1]) + square[0], 0.0)
    predicted: Floats = ahead / (theta[i] + np.sqrt(theta[i] ** 2 + ahead) + TINY)
    return predicted


def steps(theta: Floats, chord: float | Floats, guess: Floats, tolerance: float) -> tuple[Floats, int]:
    """Return the smallest delta > 0 for each theta, and evaluations summed over the instants (see ``march.step``).

    ``chord`` is one for all, or one for each.
    """
    if not np.any(chord):
        return np.zeros_like(theta), 0
    delta, spent, square = guess.copy(), 0, chord * chord
    wild = np.ones(theta.shape, dtype=bool)
    for _ in range(12):
        half = 0.5 * delta
        s = np.sin(half)
        across, outer = 2 * theta * s, theta + delta
        phi = delta + across * (s + outer * np.cos(half))
        change = 0.5 * (delta * delta + 2 * across * outer * s - square) / np.maximum(phi, 1e-300)
        delta = np.clip(delta - change, 1e-300, pi)
        spent += theta.size
        wild = (np.abs(change) > tolerance * delta) | (delta >= 1.5) | (chord > 2 * theta + pi)
        if not np.any(wild & (delta < 1.5)):
            break
    each = np.broadcast_to(chord, theta.shape)
    for lane in np.flatnonzero(wild):
        delta[lane], evaluations = _alone(float(theta[lane]), float(each[lane]), tolerance)
        spent += evaluations
    return delta, spent


def _alone(theta: float, chord: float, tolerance: float) -> tuple[float, int]:
    """Solve one lane that is not of the common kind; raises ChainLockError with its angle."""
    delta, evaluations = step(theta, chord, first_guess(theta, chord), tolerance)
    if delta == float('inf'):
        raise ChainLockError('locked', theta_rad=theta)
    return delta, evaluations
