"""Clear an interval of a Lipschitz function: where it stays positive, and where it first does not."""
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np

from dragon_ros.core.types import Floats

Look = Callable[[Floats], tuple[Floats, Floats]]

_MARGIN = 1.25      # rates are taken at the ends of a stretch; inside they differ by a few percent


@dataclass(frozen=True)
class Clearing:
    """``hit`` is None or a bracket (clear, not clear) of the first place where the function is not positive."""

    hit: tuple[float, float] | None
    looks: int


def clear(look: Look, start: float, stop: float, spacing: float, finest: float) -> Clearing:
    """Look for the first x in [start, stop], start <= stop, at which the function is not positive.

    ``look(x)`` returns values (M,) and bounds on their rates of change. A stretch [a, b] is clear if the mean of
    its end values exceeds half its length times the larger rate; others are halved, down to ``finest``.
    """
    x = np.linspace(start, stop, max(2, ceil((stop - start) / spacing) + 1), dtype=np.float64)
    value, rate = look(x)
    looks, hit = x.size, np.inf
    stretches: Floats = np.stack((x[:-1], x[1:], value[:-1], value[1:], rate[:-1], rate[1:]))
    if value[0] <= 0:
        return Clearing((start, start), looks)
    narrow: Floats = np.empty((2, 0))
    while stretches.size:
        a, b, value_a, value_b, rate_a, rate_b = stretches
        hit = min(hit, np.min(b[value_b <= 0], initial=np.inf))
        unclear = (value_a + value_b <= _MARGIN * np.maximum(rate_a, rate_b) * (b - a)) & (a < hit)
        fine = b - a <= finest
        narrow = np.concatenate((narrow, stretches[:2, unclear & fine & (value_b <= 0)]), axis=1)
        stretches = stretches[:, unclear & ~fine]
        middle = 0.5 * (stretches[0] + stretches[1])
        if middle.size:
            value, rate = look(middle)
            looks += middle.size
            stretches = np.concatenate((_with(stretches, 1, middle, value, rate),
                                        _with(stretches, 0, middle, value, rate)), axis=1)
    if not narrow.size:
        return Clearing(None, looks)
    first = int(np.argmin(narrow[1]))
    return Clearing((float(narrow[0, first]), float(narrow[1, first])), looks)


def _with(stretches: Floats, end: int, x: Floats, value: Floats, rate: Floats) -> Floats:
    """Return the stretches with one end (0 or 1) replaced."""
    out: Floats = stretches.copy()
    out[end], out[2 + end], out[4 + end] = x, value, rate
    return out
