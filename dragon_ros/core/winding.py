"""Spirals of any pitch at once: chains on them, and how the benches lie in them.

All is seen in units of b = pitch / 2 pi, where there is one spiral, r = theta, and a dragon ``scale`` = 1 / b times as
large: a smaller pitch is a larger dragon. A place is the radius in metres of the leading handle.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.chain.dragon import AnyDragon
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.numerics.vectors import dot, left
from dragon_ros.core.tracks.chord import steps
from dragon_ros.core.tracks.segments import Effort
from dragon_ros.core.tracks.spiral import points


@dataclass(frozen=True)
class Windings:
    """M windings, in units of b: handles, what links span, and their directions ``axis`` (M, N, 2) to the front."""

    theta: Floats
    delta: Floats
    p: Floats
    axis: Floats
    scale: Floats


def windings(dragon: AnyDragon, first: int, follow: int, radius_m: Floats, scale: Floats, effort: Effort) -> Windings:
    """Place ``follow`` benches behind radii (M,) on spirals of the given scales; the first is bench ``first``.

    Raises ChainLockError where a link finds no place.
    """
    links = dragon.link_lengths_m[first:first + follow]
    theta, delta = [scale * radius_m], list[Floats]()
    for i, link in enumerate(links.tolist()):
        chord = link * scale
        if i < 2 or link != links[i - 1]:
            guess = 2 * np.arcsin(np.minimum(1.0, chord / (2 * theta[i] + np.pi)))
        else:
            square = delta[-1] * (theta[i] + theta[i - 1])
            guess = square / (theta[i] + np.sqrt(theta[i] ** 2 + square))
        delta.append(steps(theta[i], chord, guess, effort.newton)[0])
        theta.append(theta[i] + delta[i])
    places = np.stack(theta, axis=1)
    p = points(1.0, places, np.zeros_like(places))
    axis = p[:, :-1] - p[:, 1:]
    return Windings(places, np.stack(delta, axis=1), p, axis / np.hypot(axis[..., 0], axis[..., 1])[..., None], scale)


def separations(dragon: AnyDragon, first: int, winding: Windings) -> Floats:
    """Return how far the leading bench and those from the second behind it on are apart, (M, K, 8), in units of b.

    Along four edges (two of the leading bench, two of the other), on either side: apart where any is positive.
    """
    count = winding.delta.shape[1]
    half = 0.5 * dragon.bench_lengths_m[first:first + count] * winding.scale[:, None]
    side = np.broadcast_to(0.5 * dragon.width_m * winding.scale[:, None], half.shape)
    centre, u = 0.5 * (winding.p[:, :-1] + winding.p[:, 1:]), winding.axis
    d, lead, other = centre[:, 2:] - centre[:, :1], u[:, :1], u[:, 2:]
    c, s = np.abs(dot(lead, other)), np.abs(dot(left(lead), other))
    offset = np.stack((dot(d, lead), dot(d, left(lead)), dot(d, other), dot(d, left(other))), axis=-1)
    extent = np.stack((half[:, :1] + half[:, 2:] * c + side[:, 2:] * s, side[:, :1] + half[:, 2:] * s + side[:, 2:] * c,
                       half[:, 2:] + half[:, :1] * c + side[:, :1] * s, side[:, 2:] + half[:, :1] * s
                       + side[:, :1] * c), axis=-1)
    return np.concatenate((offset - extent, -offset - extent), axis=-1)
