"""A table's errors by handle and time, stored compactly enough for one file to report on many teams."""
from typing import NamedTuple

import numpy as np

from dragon_ros.cli.inputs import Floats

_MOST_ROWS, _MOST_COLUMNS = 76, 112     # largest number of rows (handles) and of columns (times)
LEAST, MOST = -7.0, 1.0                 # smallest and largest error shown, as powers of ten
_SHADES = 63


class Heat(NamedTuple):
    """The largest error in each cell of a grid, as logarithmic shades from 1 to 63; cells without values are 0.

    ``grid`` has one byte per cell, row by row, starting with handle 0; ``by_handle`` and ``by_time`` contain the
    largest errors.
    """

    rows: int
    columns: int
    grid: bytes
    first_s: float
    last_s: float
    by_handle: tuple[float, ...]
    by_time: tuple[float, ...]


def heat_of(times_s: Floats, given: Floats, right: Floats) -> Heat:
    """Return the heat map for the errors of given values (T, 224, D)."""
    error = np.sqrt(np.sum(np.square(given - right), axis=-1)).T            # handles, times
    known = np.where(np.isfinite(error), error, -1.0)
    pooled = _pooled(_pooled(known, _MOST_ROWS).T, _MOST_COLUMNS).T
    level = (np.log10(np.maximum(pooled, 10.0 ** LEAST)) - LEAST) / (MOST - LEAST)
    grid = np.where(pooled < 0, 0, 1 + np.clip(np.round(level * (_SHADES - 1)), 0, _SHADES - 1)).astype(np.uint8)
    ends = (float(times_s[0]), float(times_s[-1])) if np.isfinite(times_s).all() else (0.0, 0.0)
    return Heat(grid.shape[0], grid.shape[1], grid.tobytes(), *ends, tuple(np.maximum(known.max(axis=1), 0).tolist()),
                tuple(np.maximum(known.max(axis=0), 0).tolist()))


def _pooled(values: Floats, most: int) -> Floats:
    """Return the maxima of groups of neighbouring rows; there are at most ``most`` groups."""
    size = -(-len(values) // most)
    return np.maximum.reduceat(values, np.arange(0, len(values), size), axis=0)
