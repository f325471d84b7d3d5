"""Velocities of all handles from the rigid-link constraint v[i+1] cos(beta) = v[i] cos(alpha).

alpha and beta are the angles between a link and the track's tangents at its two handles. With the link seen in the
polar frame of either handle both cosines are sums of like terms, so nothing cancels and coordinates do not matter.
"""
from math import cos, sin, sqrt
from typing import TYPE_CHECKING

import numpy as np

from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.path import tangents

if TYPE_CHECKING:
    from dragon_ros.core.chain import Chain, SpiralChain


def along_track(theta: Floats, delta: Floats) -> tuple[Floats, Floats]:
    """Return (cos alpha, cos beta) of each link times its chord in units of b, shapes (..., N)."""
    inner = theta[..., :-1]
    s, c = np.sin(0.5 * delta), np.cos(0.5 * delta)
    across = 2 * inner * s
    turn = across * (inner + delta) * c
    w_inner, w_outer = np.sqrt(1 + inner * inner), np.sqrt(1 + theta[..., 1:] ** 2)
    front = delta * (1 - 2 * s * s) - across * s + turn
    back = delta + across * s + turn
    return front / w_inner, back / w_outer


def speed_ratio(theta: float, delta: float) -> float:
    """Return the speed of the handle behind one at polar angle ``theta``, for each of its own, across a link."""
    s, c = sin(0.5 * delta), cos(0.5 * delta)
    across, outer = 2 * theta * s, theta + delta
    front, back = delta * (1 - 2 * s * s) - across * s + across * outer * c, delta + across * (s + outer * c)
    return front / back * sqrt((1 + outer * outer) / (1 + theta * theta))


def speed_ratios(theta: Floats, delta: Floats) -> Floats:
    """Return ``speed_ratio`` of many links."""
    cos_alpha, cos_beta = along_track(np.stack((theta, theta + delta), axis=-1), delta[..., None])
    return (cos_alpha / cos_beta)[..., 0]


def speeds(chain: 'SpiralChain', head_speed_m_s: float | Floats) -> Floats:
    """Return signed speeds along the track, shape (..., N+1), positive inwards (the sign of the head's speed).

    A link of zero length carries the speed over unchanged.
    """
    cos_alpha, cos_beta = along_track(chain.theta, chain.delta)
    joined = chain.delta == 0
    ratio = np.where(joined, 1.0, cos_alpha) / np.where(joined, 1.0, cos_beta)
    out = np.empty_like(chain.theta)
    out[..., 0] = head_speed_m_s
    np.multiply(np.cumprod(ratio, axis=-1), out[..., :1], out=out[..., 1:])
    return out


def velocities(chain: 'SpiralChain', head_speed_m_s: float | Floats) -> Floats:
    """Return velocity vectors in m/s, shape (..., N+1, 2)."""
    return read_only(-speeds(chain, head_speed_m_s)[..., None] * tangents(chain.theta))


def conditioning(chain: 'Chain') -> float:
    """Return how much faster than the head the fastest handle is, at least 1.

    Close to a lock it grows without bound, and with it what the last bit of the head's place does to the handles: a
    position error is promised in metres times this number. A speed is promised relative to the speed itself over
    cos^2 beta, that is times the square of it.
    """
    v = chain.velocities(1.0)
    return max(1.0, float(np.max(np.hypot(v[..., 0], v[..., 1]))))
