"""The chain: where all handles are, whatever solver placed them."""
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dragon_ros.core import rates
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.path import tangents


@dataclass(frozen=True)
class Chain:
    """All handles at one instant (or at many: the arrays then have a leading axis).

    ``p`` (..., N+1, 2) are coordinates in metres, ``links_m`` (N,) the spacing of the handles, ``evaluations`` how
    often an equation was evaluated.
    """

    p: Floats
    links_m: Floats
    evaluations: int

    @property
    def solver(self) -> str:
        """Who placed the handles."""
        raise NotImplementedError

    @cached_property
    def residuals_m(self) -> Floats:
        """Distance of consecutive handles minus link length, from the coordinates, shape (..., N)."""
        step = np.diff(self.p, axis=-2)
        out: Floats = np.hypot(step[..., 0], step[..., 1]) - self.links_m
        return out

    @cached_property
    def worst(self) -> tuple[float, int]:
        """Largest |residual| in metres and its link."""
        link = int(np.argmax(np.abs(self.residuals_m)) % self.links_m.size)
        return float(np.max(np.abs(self.residuals_m))), link

    @property
    def tangents(self) -> Floats:
        """Unit tangents of the track at the handles, outwards, towards the tail, shape (..., N+1, 2)."""
        raise NotImplementedError

    def velocities(self, head_speed_m_s: float | Floats) -> Floats:
        """Return velocity vectors in m/s, shape (..., N+1, 2); the head's speed is positive inwards."""
        raise NotImplementedError


@dataclass(frozen=True)
class SpiralChain(Chain):
    """A chain marched along a spiral: ``theta + theta_lo`` (..., N+1) are polar angles, ``delta`` (..., N) spans."""

    theta: Floats
    theta_lo: Floats
    delta: Floats
    solver = 'march'

    @property
    def tangents(self) -> Floats:
        """Unit tangents of the spiral, outwards."""
        return tangents(self.theta)

    def velocities(self, head_speed_m_s: float | Floats) -> Floats:
        """Return velocity vectors in m/s from the rigid-link constraint."""
        return rates.velocities(self, head_speed_m_s)


def stack(chains: Sequence[SpiralChain]) -> SpiralChain:
    """Return chains of one dragon as one, with a leading axis."""
    p, theta, theta_lo, delta = (read_only(np.stack([getattr(chain, name) for chain in chains]))
                                 for name in ('p', 'theta', 'theta_lo', 'delta'))
    return type(chains[0])(p, chains[0].links_m, sum(chain.evaluations for chain in chains), theta, theta_lo, delta)
