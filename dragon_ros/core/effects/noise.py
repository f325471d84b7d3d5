"""Handles as observed by a noisy sensor: a function of (seed, tick), so ticks can be computed in any order."""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.flags import Noise
from dragon_ros.core.numerics.types import Floats, read_only


@dataclass(frozen=True)
class NoisyHandles:
    """Noisy handle positions (m, shape (N+1, 2)) and noisy unit directions of the links (shape (N, 2))."""

    p: Floats
    axis: Floats


def noisy_handles(noise: Noise, k: int | None, t_ns: int, p: Floats, axis: Floats) -> NoisyHandles:
    """Return handles (N+1, 2) and directions (N, 2) of tick k, or of a time between ticks, with independent errors."""
    handles = p.shape[0]
    draw = normal(noise.seed, t_ns if k is None else k, k is None, 3 * handles - 1)
    seen = p + noise.position_m * draw[:2 * handles].reshape(handles, 2)
    angle = noise.yaw_rad * draw[2 * handles:]
    turn = (np.cos(angle) + 1j * np.sin(angle)) * (axis[:, 0] + 1j * axis[:, 1])
    return NoisyHandles(read_only(seen), read_only(np.stack((turn.real, turn.imag), axis=1)))


def normal(seed: int, number: int, off_tick: bool, count: int) -> Floats:
    """Return ``count`` standard normal random numbers for a seed and a tick (or, between ticks, a time in ns).

    The bits come from Philox (Salmon et al. 2011), which numpy keeps stable; the Box-Muller method converts them to
    normal numbers.
    """
    half = (count + 1) // 2
    bits = np.random.Philox(key=seed, counter=[0, number, int(off_tick), 0]).random_raw(2 * half)
    even = ((bits >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    size, angle = np.sqrt(-2 * np.log(even[:half])), 2 * np.pi * even[half:]
    out: Floats = np.concatenate((size * np.cos(angle), size * np.sin(angle)))[:count]
    return out
