"""Velocities and accelerations of handles and benches, for a head that moves at a steady speed.

Twice differentiating |q[m+1] - q[m]|^2 = l^2 with q'' = s' T + s^2 kappa N gives the tangential acceleration s' of each
handle from the one before it (s is the speed along the outward tangent T, N its left normal, kappa the curvature).
"""
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from dragon_ros.core.chain import SpiralChain
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.path import tangents
from dragon_ros.core.rates import speeds


@dataclass(frozen=True)
class Motion:
    """Of each bench: velocity and acceleration of its centre (..., N, 2), turning rate and its rate (..., N).

    In units of the leading handle's way: m/m, m/m^2, rad/m, rad/m^2.
    """

    velocity: Floats
    acceleration: Floats
    turning: Floats
    turning_rate: Floats


def curvature(b_m: float, theta: Floats) -> Floats:
    """Return the track's curvature in 1/m (it turns left outwards)."""
    out: Floats = (2 + theta * theta) / (b_m * (1 + theta * theta) ** 1.5)
    return out


def left(vectors: Floats) -> Floats:
    """Return vectors turned left by a quarter."""
    return np.stack((-vectors[..., 1], vectors[..., 0]), axis=-1)


def dot(a: Floats, b: Floats) -> Floats:
    """Return scalar products of vectors (..., 2)."""
    out: Floats = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]
    return out


def handle_motion(b_m: float, chain: SpiralChain, axis: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return velocity and acceleration (..., N+1, 2) of the handles, and speed and tangential acceleration (..., N+1).

    The head moves inwards by one metre a unit of time; speeds count outwards.
    """
    t = tangents(chain.theta)
    s = -speeds(chain, 1.0)
    bend = s * s * curvature(b_m, chain.theta)
    v = s[..., None] * t
    tangential = _tangential(chain, axis, t, bend, v)
    return v, tangential[..., None] * t + bend[..., None] * left(t), s, tangential


def motion(b_m: float, chain: SpiralChain, axis: Floats) -> Motion:
    """Return how the benches of a chain move while its head moves inwards by one metre a unit of time."""
    v, a, s, tangential = handle_motion(b_m, chain, axis)
    joined = chain.links_m == 0
    length = np.where(joined, 1.0, chain.links_m)
    side = left(axis)
    turning = dot(np.diff(-v, axis=-2), side) / length
    turning_rate = dot(np.diff(-a, axis=-2), side) / length
    if np.any(joined):      # such a bench lies along the track and turns with it
        kappa, rear = curvature(b_m, chain.theta[..., :-1]), s[..., :-1]
        turning = np.where(joined, kappa * rear, turning)
        turning_rate = np.where(joined, kappa * tangential[..., :-1] + kappa * kappa * rear * rear, turning_rate)
    return Motion(0.5 * (v[..., 1:, :] + v[..., :-1, :]), 0.5 * (a[..., 1:, :] + a[..., :-1, :]), turning, turning_rate)


def _tangential(chain: SpiralChain, axis: Floats, t: Floats, bend: Floats, v: Floats) -> Floats:
    """Return s' of every handle, shape (..., N+1); the head's is 0."""
    front, rear = dot(axis, t[..., :-1, :]), dot(axis, t[..., 1:, :])
    pull = dot(axis, left(t[..., :-1, :])) * bend[..., :-1] - dot(axis, left(t[..., 1:, :])) * bend[..., 1:]
    spread = np.diff(v, axis=-2)
    joined = chain.links_m == 0
    pull += dot(spread, spread) / np.where(joined, 1.0, chain.links_m)
    if np.any(joined):      # a link of zero length carries it over
        front, rear, pull = np.where(joined, 1.0, front), np.where(joined, 1.0, rear), np.where(joined, 0.0, pull)
    return carried(np.zeros(chain.theta.shape[:-1]), front / rear, pull / rear)


def carried(start: Floats, ratio: Floats, added: Floats) -> Floats:
    """Return y (..., N+1) with y[0] = start (...) and y[m+1] = ratio[m] y[m] + added[m], both (..., N)."""
    if ratio.ndim == 1:
        steps = zip(ratio.tolist(), added.tolist(), strict=True)
        return np.array(list(accumulate(steps, lambda y, step: step[0] * y + step[1], initial=float(start))))
    out = np.empty((*ratio.shape[:-1], ratio.shape[-1] + 1))
    out[..., 0] = start
    for m in range(ratio.shape[-1]):
        out[..., m + 1] = ratio[..., m] * out[..., m] + added[..., m]
    return out
