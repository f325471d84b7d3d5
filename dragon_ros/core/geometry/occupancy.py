"""Convert a grid of occupied cells into obstacles: the boundary of each connected part, as merged edges.

Only the boundary matters, because a bench that overlaps no edge is either inside or outside an obstacle. Cells are
processed as arrays of runs, so the number of cells affects the time only through a few numpy passes.
"""
import numpy as np
from numpy.typing import NDArray

from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry.venue import OUTSIDE, Surroundings
from dragon_ros.core.limits import MAP_EDGES
from dragon_ros.core.numerics.types import Complexes, Ints

Bools = NDArray[np.bool_]
_MOST_SIDES = 20 * MAP_EDGES        # limit on the number of sides before they are merged


def outlines(occupied: Bools, name: str, corner: complex, across: complex) -> Surroundings | None:
    """Return the boundaries of occupied cells (shape (rows, columns)), or None if no cell is occupied.

    ``corner`` is the outer corner of the first cell, and ``across`` is the vector along a cell of the first row;
    further rows follow to the left of this vector. Cells that touch, even if only at a corner, form one obstacle.
    Several obstacles are numbered after ``name``, in order of their first cells. Raises InputError if there are too
    many edges.
    """
    along = _changes(occupied)      # both sides of each run of occupied cells, row by row
    up = np.flatnonzero(np.diff(occupied, axis=0, prepend=False, append=False))
    if along.size + up.size > _MOST_SIDES:
        raise InputError(f'the map has {along.size + up.size} boundaries between occupied and free cells; the limit is '
                         f'{_MOST_SIDES}; filter its noise, or reduce its resolution')
    if not along.size:
        return None
    columns = occupied.shape[1]
    first, last = along[::2], along[1::2]
    label, parts = _labels(first, last, columns + 1)

    def owner(row: Ints, column: Ints) -> Ints:
        out: Ints = label[np.searchsorted(first, row * (columns + 1) + column, side='right') - 1]
        return out

    row, column = np.divmod(up, columns)
    below = np.where(row == 0, False, occupied[row - 1, column])
    flat = _merged(row, column, below)
    level = 1j * row[flat[0]]
    start, stop = column[flat[0]] + level, column[flat[1]] + 1 + level
    mine = owner(row[flat[0]] - below[flat[0]], column[flat[0]])
    out = [(start, stop, mine)]
    for side, inwards in ((first, 0), (last, 1)):
        row, column = np.divmod(side, columns + 1)
        order = np.lexsort((row, column))
        row, column = row[order], column[order]
        flat = _merged(column, row, np.zeros(row.size, bool))
        out.append((column[flat[0]] + 1j * row[flat[0]], column[flat[1]] + 1j * (row[flat[1]] + 1),
                    owner(row[flat[0]], column[flat[0]] - inwards)))
    start, stop, mine = (np.concatenate(one) for one in zip(*out, strict=True))
    if start.size > MAP_EDGES:
        raise InputError(f'the map has {start.size} edges; the limit is {MAP_EDGES}; filter its noise, or reduce its '
                         'resolution')
    order = np.argsort(mine, kind='stable')
    names = (name,) if parts == 1 else tuple(f'{name} {n}' for n in range(1, parts + 1))
    start, stop = (_placed(one[order], corner, across) for one in (start, stop))
    return Surroundings(names, start, stop, mine[order], np.full(parts, OUTSIDE))


def _placed(cells: Complexes, corner: complex, across: complex) -> Complexes:
    out: Complexes = corner + cells * across
    out.setflags(write=False)
    return out


def _changes(occupied: Bools) -> Ints:
    """Return the sides between occupied and free cells of the same row, as row * (columns + 1) + column."""
    return np.flatnonzero(np.diff(occupied, axis=1, prepend=False, append=False))


def _merged(line: Ints, place: Ints, kind: Bools) -> tuple[Ints, Ints]:
    """Return the indices of the first and last item of each run of consecutive positions of the same line and kind."""
    ends = (line[1:] != line[:-1]) | (place[1:] != place[:-1] + 1) | (kind[1:] != kind[:-1])
    return np.flatnonzero(np.append(True, ends)), np.flatnonzero(np.append(ends, True))


def _labels(first: Ints, last: Ints, width: int) -> tuple[Ints, int]:
    """Return the index of the connected part that contains each run, and the number of parts.

    Parts are numbered in the order of their first runs.

    Runs of cells extend from ``first`` to ``last``, as row * width + column. Runs that touch in consecutive rows are
    joined until nothing changes: each pass propagates the smallest number between touching runs, and then follows the
    numbers until they are stable.
    """
    begin = np.searchsorted(last, first + width, side='left')
    count = np.maximum(np.searchsorted(first, last + width, side='right') - begin, 0)
    a = np.repeat(np.arange(first.size), count)
    b = np.arange(a.size) - np.repeat(np.cumsum(count) - count - begin, count)
    label = np.arange(first.size)
    while True:
        one, two = label[a], label[b]
        apart = one != two
        if not np.any(apart):
            break
        a, b, one, two = a[apart], b[apart], one[apart], two[apart]
        np.minimum.at(label, np.maximum(one, two), np.minimum(one, two))
        while np.any((further := label[label]) != label):
            label = further
    parts, label = np.unique(label, return_inverse=True)
    return label, int(parts.size)
