"""Contact episodes of many pairs at once, as arrays: who touches, how deep it got and when, and who has been told."""
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dragon_ros.core.numerics.types import Floats, Ints

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Episodes:
    """Pairs that touch, by growing ``key`` (M,); the deepest gap in m and its time in ns; whether it was reported."""

    key: Ints
    deepest_m: Floats
    deepest_ns: Ints
    told: Bools

    def advance(self, t_ns: int, key: Ints, gap_m: Floats) -> tuple['Episodes', Bools, Bools]:
        """Return the episodes at ``t_ns``, which of them are new, and which of these here have ended.

        ``key`` (K,) are the pairs that touch now, growing, each once; ``gap_m`` (K,) their gaps.
        """
        _, old, now = np.intersect1d(self.key, key, assume_unique=True, return_indices=True)
        deepest, times = gap_m.copy(), np.full(key.size, t_ns, dtype=np.int64)
        told, new, ended = np.zeros(key.size, bool), np.ones(key.size, bool), np.ones(self.key.size, bool)
        keep = self.deepest_m[old] <= gap_m[now]
        deepest[now[keep]], times[now[keep]] = self.deepest_m[old[keep]], self.deepest_ns[old[keep]]
        told[now], new[now], ended[old] = self.told[old], False, False
        return Episodes(key, deepest, times, told), new, ended


def no_episodes() -> Episodes:
    """Return the state in which nothing touches."""
    none = np.empty(0, np.int64)
    return Episodes(none, np.empty(0), none, np.empty(0, bool))
