"""Accuracy as a promise in metres, and the errors allowed in shift maps to keep this promise.

A tier promises an upper bound on the position errors of all handles at all times of a scene. Close to a lock, a change
in the last bit of the head's position moves the other handles C times as far (C is ``chain.conditioning``); there the
promise grows by (C - 1) times the resolution of floats. The promise for a speed, relative to that speed, is C^2 times
the promise for positions, divided by the mean link length. All promises are tested against a 50-digit reference in
every case of ``hard_cases``.
"""
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from dragon_ros.core.checks import number
from dragon_ros.core.errors import FieldError, did_you_mean
from dragon_ros.core.numerics.types import Floats

_FLOAT_SIZE_M = 20.0     # beyond this size, floats cannot resolve 2e-12 m, and the promise of the exact tier grows


@dataclass(frozen=True)
class Tier:
    """A named promise in metres."""

    name: str
    promise_m: float

    def promise_for_m(self, size_m: float) -> float:
        """Return the promise for coordinates up to ``size_m``."""
        return max(self.promise_m, best_m(size_m)) if self is EXACT else self.promise_m

    def series_m(self, size_m: Floats) -> Floats:
        """Return the truncation error allowed in a shift map at coordinates ``size_m``: a tenth of the promise.

        For the exact tier, this error is relative to the coordinates and therefore smaller near the origin.
        """
        if self is EXACT:
            return 0.01 * EXACT.promise_m / _FLOAT_SIZE_M * size_m
        return np.full_like(size_m, 0.1 * self.promise_m)


def position_promise_m(tier: Tier, size_m: float, condition: float) -> float:
    """Return the promised position error for coordinates up to ``size_m`` and a given conditioning of the chain."""
    return tier.promise_for_m(size_m) + (condition - 1) * best_m(size_m)


def speed_promise_m_s(tier: Tier, size_m: float, mean_link_m: float, condition: float, head_speed_m_s: float) -> float:
    """Return the promised bound on the error of any handle's speed."""
    relative = tier.promise_for_m(size_m) / max(mean_link_m, 1e-300)
    return relative * condition**3 * abs(head_speed_m_s)


PAPER = Tier('paper', inf)        # no promise: errors reach 14 m
EXACT = Tier('exact', 2e-12)
TIERS = {tier.name: tier for tier in (PAPER, Tier('preview', 1e-3), Tier('standard', 1e-6), Tier('fine', 1e-9), EXACT)}


def best_m(size_m: float) -> float:
    """Return the smallest promise that can be kept with floats for coordinates up to ``size_m``."""
    return EXACT.promise_m * max(1.0, size_m / _FLOAT_SIZE_M)


def tier_for(accuracy: Any, size_m: float = 0.0) -> Tier:
    """Return the named tier, or the cheapest tier that promises an accuracy (m) for coordinates up to ``size_m``.

    Raises FieldError, with the possible values, if floats cannot provide this accuracy. The tier ``paper`` must be
    requested by name.
    """
    if isinstance(accuracy, str):
        if accuracy not in TIERS:
            raise FieldError('accuracy', accuracy, f'the tiers are {", ".join(TIERS)}',
                             did_you_mean(accuracy, TIERS, 'give one of these, or metres'))
        tier = TIERS[accuracy]
        if tier.promise_for_m(size_m) < best_m(size_m):
            raise _beyond_floats(accuracy, size_m)
        return tier
    metres = number('accuracy', accuracy, above=0.0)
    fitting = [tier for tier in TIERS.values()
               if tier is not PAPER and best_m(size_m) <= tier.promise_for_m(size_m) <= metres]
    if not fitting:
        raise _beyond_floats(accuracy, size_m)
    return max(fitting, key=lambda tier: tier.promise_m)


def _beyond_floats(accuracy: Any, size_m: float) -> FieldError:
    best = best_m(size_m)
    return FieldError('accuracy', accuracy, f'with coordinates up to {max(size_m, _FLOAT_SIZE_M):.4g} m floats resolve '
                      f'only {best:.3g} m', f'choose {best:.3g} m or more, or exact')
