"""Accuracy as a promise in metres, and the only tolerances of the core.

A tier promises the largest position error over all handles and times of a scene, for coordinates up to 20 m; beyond
that the promise grows with the coordinates, since a float holds no more digits.
"""
from dataclasses import dataclass
from typing import Any

from dragon_ros.core.checks import number
from dragon_ros.core.errors import FieldError


@dataclass(frozen=True)
class Tier:
    """A named promise: ``promise_m`` metres, kept by stopping Newton at the relative step ``step_tolerance``."""

    name: str
    promise_m: float
    step_tolerance: float


EXACT = Tier('exact', 2e-12, 1e-8)
TIERS = {tier.name: tier for tier in (EXACT,)}


def tier_for(accuracy: Any) -> Tier:
    """Return the cheapest tier that keeps ``accuracy``: a tier's name, or metres."""
    if isinstance(accuracy, str):
        if accuracy not in TIERS:
            raise FieldError('accuracy', accuracy, f'the tiers are {", ".join(TIERS)}', 'give one of these, or metres')
        return TIERS[accuracy]
    metres = number('accuracy', accuracy, above=0.0)
    fitting = [tier for tier in TIERS.values() if tier.promise_m <= metres]
    if not fitting:
        raise FieldError('accuracy', accuracy, f'floats keep no more than {EXACT.promise_m:g} m',
                         f'ask for {EXACT.promise_m:g} m or more')
    return max(fitting, key=lambda tier: tier.promise_m)
