"""Which benches are near each other at one instant, which of them touch, and where."""
from dataclasses import dataclass
from math import inf

import numpy as np

from dragon_ros.core.contact import gaps, witnesses
from dragon_ros.core.neighbours import candidates
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import Frame
from dragon_ros.core.watch import NEAR_M, TOUCH_M


@dataclass(frozen=True)
class Closeness:
    """Pairs (i, j) of benches that may be near each other, (K,), and their signed gaps in metres."""

    i: Ints
    j: Ints
    gap_m: Floats

    @property
    def clearance_m(self) -> float:
        """Smallest signed gap; inf where no pair is near."""
        return float(np.min(self.gap_m, initial=inf))


@dataclass(frozen=True)
class Contacts:
    """Pairs that touch, (M, 2), deepest first, their signed gaps (M,) in m, and points (M, 2) of contact."""

    benches: Ints
    gap_m: Floats
    point_m: Floats


def closeness(_: Scene, frame: Frame) -> Closeness:
    """Return all pairs within ``NEAR_M`` of each other, and others, with their gaps, as the monitor sees them."""
    assert frame.benches is not None
    i, j = candidates(frame.chain.p, frame.benches, NEAR_M)
    return Closeness(i, j, gaps(frame.benches, i, j))


def contacts(_: Scene, frame: Frame) -> Contacts:
    """Return the pairs that touch."""
    near, benches = frame.closeness, frame.benches
    assert near is not None
    assert benches is not None
    rows = np.flatnonzero(near.gap_m <= TOUCH_M)
    rows = rows[np.argsort(near.gap_m[rows], kind='stable')]
    pairs = np.stack((near.i[rows], near.j[rows]), axis=1)
    point: Floats = witnesses(benches, near.i[rows], near.j[rows]).point_m if rows.size else np.empty((0, 2))
    return Contacts(pairs, near.gap_m[rows], point)
