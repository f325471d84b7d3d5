"""The 50-digit reference of the hard cases, and the error of a solver relative to it."""
import json
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from dragon_ros.core.errors import MissingError
from dragon_ros.core.numerics.types import Array, Floats
from hard_cases.cases import Problem

_FILE = Path(__file__).resolve().with_name('reference.json')
_KEYS = ('x', 'y', 'vx', 'vy')


@dataclass(frozen=True)
class Truth:
    """Reference handles at the times of a problem; each number is the sum of two floats.

    Arrays are (times, handles, 4): x, y, vx, vy.
    """

    high: Floats
    low: Floats

    def distance(self, time: int, p: Floats) -> Floats:
        """Return the Euclidean distances (m) between positions (handles, 2) and the truth."""
        off = (p - self.high[time, :, :2]) - self.low[time, :, :2]
        out: Floats = np.hypot(off[:, 0], off[:, 1])
        return out


def design_figures() -> dict[str, str]:
    """Return the length of the contest's turn and the largest speed of its head, as decimal strings."""
    figures: dict[str, str] = _read()['figures']
    return figures


@lru_cache(maxsize=1)
def _read() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(_FILE.read_text(encoding='ascii'))
    return content


@lru_cache(maxsize=64)
def truth(problem: Problem) -> Truth:
    """Return the reference of a hard case. Raises MissingError if the case's times or handles are missing."""
    row = _read()['problems'].get(problem.name)
    if row is None or tuple(row['times_s']) != problem.times_s or tuple(
            row['handles']) != problem.handles:
        raise MissingError(f'{_FILE}: no reference for the current {problem.name}; run make_reference.py')
    digits: Array = np.array([[state[key] for key in _KEYS] for state in row['states']], dtype=str)
    exact = np.vectorize(Decimal, otypes=[object])(np.moveaxis(digits, 1, 2))
    high = exact.astype(np.float64)
    rest = exact - np.vectorize(Decimal, otypes=[object])(high)
    return Truth(high, rest.astype(np.float64))
