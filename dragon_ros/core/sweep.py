"""Gaps of a bench to its candidates behind it, for many places of that bench at once, and how fast they can close.

Benches walk one track at equal spacing, so what follows a bench at polar angle theta is the same whenever it is there.
"""
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, pi

import numpy as np

from dragon_ros.core.benches import Benches, axes_of, benches_of
from dragon_ros.core.contact import gaps
from dragon_ros.core.dragon import Dragon
from dragon_ros.core.march import Chain, Effort
from dragon_ros.core.march_many import place_many
from dragon_ros.core.path import Spiral
from dragon_ros.core.rates import velocities
from dragon_ros.core.types import Floats, Ints

_CHUNK = 512


@dataclass(frozen=True)
class Leader:
    """A bench and those behind it: the head's (``first`` 0) or any other (``first`` 1), at most ``follow`` of them."""

    spiral: Spiral
    dragon: Dragon
    first: int
    follow: int
    effort: Effort
    progress: Callable[[int], object]

    def closest(self, theta: Floats) -> tuple[Floats, Floats, Ints]:
        """Return, for places (M,) of the front handle: smallest gap in m, its rate bound in m/rad, and its bench.

        The rate bound is the largest sum of the two benches' fastest points, for one radian of the front handle.
        """
        out = [self._closest(part) for part in np.array_split(theta, ceil(theta.size / _CHUNK))]
        gap, rate, bench = (np.concatenate(column) for column in zip(*out, strict=True))
        return gap, rate, bench

    def _closest(self, theta: Floats) -> tuple[Floats, Floats, Ints]:
        self.progress(theta.size)
        links = self.dragon.link_lengths_m[self.first:self.first + self._reach(theta)]
        chain = place_many(self.spiral, links, theta, np.zeros_like(theta), self.effort)
        benches = benches_of(chain, self.dragon if self.first == 0 else self._body, axes_of(chain))
        later, valid = window(chain.theta)
        row = np.arange(theta.size)[:, None]
        lead = np.zeros_like(later)
        gap = np.where(valid, gaps(_of_each_row(benches), (row, lead), (row, later)), np.inf)
        b_m = self.spiral.b_m
        fastest = fastest_points(b_m, chain, benches, b_m * np.sqrt(1 + theta * theta))
        rate = fastest[:, 0] + np.max(np.where(valid, fastest[row, later], 0.0), axis=1)
        nearest = np.argmin(gap, axis=1)
        return gap[row[:, 0], nearest], rate, self.first + later[row[:, 0], nearest]

    @property
    def _body(self) -> Dragon:
        d = self.dragon
        return Dragon(d.benches, d.body_length_m, d.body_length_m, d.width_m, d.hole_inset_m)

    def _reach(self, theta: Floats) -> int:
        """Return how many links cover the next layer behind the outermost place."""
        chord = self.dragon.body_link_m / self.spiral.b_m
        if chord == 0.0:
            return self.follow
        smallest = chord / (float(np.max(theta)) + 4 * pi + chord + 1)
        return min(self.follow, ceil(3 * pi / smallest) + 5)


def _of_each_row(benches: Benches) -> Benches:
    """Return the benches with their sizes repeated for each row, so that (row, bench) finds them."""
    shape = benches.axis.shape[:-1]
    return Benches(benches.centre, benches.axis, np.broadcast_to(benches.half_length, shape),
                   np.broadcast_to(benches.half_width, shape))


def window(angle: Floats) -> tuple[Ints, Floats]:
    """Return candidate benches (M, W) of the first bench, from handle angles (M, K+1), and which of them exist.

    The next layer out behind the first bench, from one bench before its front handle to one behind its rear handle,
    and the next but one and two in the chain.
    """
    count = angle.shape[1] - 1
    first = np.sum(angle <= angle[:, :1] + 2 * pi, axis=1) - 2
    last = np.sum(angle <= angle[:, 1:2] + 2 * pi, axis=1)
    first = np.maximum(first, 4)
    width = max(0, int(np.max(np.minimum(last, count - 1) - first)) + 1)
    layer = first[:, None] + np.arange(width)
    valid = (layer <= last[:, None]) & (layer < count)
    near = np.broadcast_to(np.array([2, 3]), (angle.shape[0], 2))
    later = np.concatenate((near, layer), axis=1)
    return np.minimum(later, count - 1), np.concatenate((near < count, valid), axis=1)


def fastest_points(b_m: float, chain: Chain, benches: Benches, head_speed: float | Floats) -> Floats:
    """Return a bound on the speed of any point of each bench, shape (..., N), in units of the head's speed.

    A rigid bench's point moves at most as fast as its faster handle plus |omega| times its distance from it. A bench
    whose handles coincide turns with the track.
    """
    v = velocities(chain, head_speed)
    handle = np.hypot(v[..., 0], v[..., 1])
    difference = np.diff(v, axis=-2)
    joined = chain.links_m == 0
    inner = chain.theta[..., :-1]
    curvature = (2 + inner * inner) / (b_m * (1 + inner * inner) ** 1.5)
    omega = np.where(joined, handle[..., :-1] * curvature,
                     np.hypot(difference[..., 0], difference[..., 1]) / np.where(joined, 1.0, chain.links_m))
    overhang = np.hypot(benches.half_length - 0.5 * chain.links_m, benches.half_width)
    out: Floats = np.maximum(handle[..., 1:], handle[..., :-1]) + omega * overhang
    return out
