"""The 50-digit reference of the hard cases, and how far a solver is from it."""
import json
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from dragon_ros.core.errors import MissingError
from dragon_ros.core.types import Array, Floats
from dragon_ros.cost.problems import Problem

_FILE = Path(__file__).resolve().parents[2] / 'test' / 'data' / 'reference.json'
Solve = Callable[[float], tuple[Floats, Floats]]


@dataclass(frozen=True)
class Truth:
    """Wanted handles at the times of a problem: x, y, speed (times, handles, 3), each as a float and what it misses."""

    high: Floats
    low: Floats

    def distance(self, time: int, p: Floats) -> Floats:
        """Return the Euclidean distances of positions (handles, 2) from the truth, in metres."""
        off = (p - self.high[time, :, :2]) - self.low[time, :, :2]
        out: Floats = np.hypot(off[:, 0], off[:, 1])
        return out

    def speed_error(self, time: int, speed: Floats) -> Floats:
        """Return the absolute errors of signed speeds (handles,) in m/s."""
        out: Floats = np.abs((speed - self.high[time, :, 2]) - self.low[time, :, 2])
        return out


@lru_cache(maxsize=1)
def _everything() -> dict[str, Any]:
    try:
        out: dict[str, Any] = json.loads(_FILE.read_text(encoding='ascii'))['problems']
    except OSError as error:
        raise MissingError(f'{_FILE}: cannot be read: {error.strerror}; the cost pages run from a checkout') from None
    return out


@lru_cache(maxsize=64)
def truth(problem: Problem) -> Truth:
    """Return the reference of a hard case. Raises MissingError where it has none for these times and handles."""
    row = _everything().get(problem.name)
    if row is None or tuple(row['times_s']) != problem.times_s or tuple(
            row['handles']) != problem.handles:
        raise MissingError(f'{_FILE}: has nothing for {problem.name} as it is now; run make_reference.py beside it')
    digits: Array = np.array([[state[key] for key in ('x', 'y', 'speed')] for state in row['states']], dtype=str)
    exact = np.vectorize(Decimal, otypes=[object])(np.moveaxis(digits, 1, 2))
    high = exact.astype(np.float64)
    rest = exact - np.vectorize(Decimal, otypes=[object])(high)
    return Truth(high, rest.astype(np.float64))
