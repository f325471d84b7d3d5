"""Chebyshev series of many functions at once: fits to values at the nodes, inverses, and powers of the variable."""
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from dragon_ros.core.numerics.types import Floats

_ENOUGH = 1e-12        # size of a Newton step, relative to the interval, below which no further step is needed
_NOTHING = 5e-16       # smallest coefficient that is used, relative to the interval: about the rounding error of values
_NEWTON_STEPS = 6       # maximum number of steps; from a start within a tenth of the interval, three are enough
# The maximum number of multiplications per product. BLAS splits larger products among threads; on a busy machine,
# synchronising these threads takes longer than computing on a single thread.
_WORK = 200_000


@lru_cache(maxsize=64)
def transform(nodes: int) -> tuple[Floats, Floats]:
    """Return the Chebyshev nodes in [-1, 1] and the matrix that maps values at the nodes to coefficients."""
    quarter = np.cos(np.arange(4 * nodes) * (np.pi / (2 * nodes)))     # integer arithmetic removes whole turns
    odd = 2 * np.arange(nodes) + 1
    matrix = 2 / nodes * quarter[np.outer(np.arange(nodes), odd) % (4 * nodes)]
    matrix[0] *= 0.5
    return quarter[odd], matrix


def in_parts(matrix: Floats, values: Floats) -> Floats:
    """Return the product (..., L, M) of a matrix (L, K) and values (..., K, M), computed several columns at a time."""
    columns = columns_of(matrix.size)
    out: Floats = np.empty((*values.shape[:-2], len(matrix), values.shape[-1]))
    for first in range(0, values.shape[-1], columns):
        some = slice(first, first + columns)
        np.matmul(matrix, values[..., some], out=out[..., some])
    return out


def columns_of(size: int) -> int:
    """Return the largest number of columns for which a product with a matrix of this size stays on one thread."""
    return max(1, _WORK // max(1, size))


def series_of(values: Floats) -> Floats:
    """Return the series (..., K, M) of functions from their values (..., K, M) at the nodes."""
    return in_parts(transform(values.shape[-2])[1], values)


def inverse_series(series: Floats) -> Floats:
    """Return the inverses u(x) of monotone series x(u) (K, M) from [-1, 1] to itself, as series in x (K, M)."""
    columns, out = columns_of(series.shape[0]**2), np.empty(series.shape)
    for first in range(0, series.shape[1], columns):
        some = slice(first, first + columns)
        out[:, some] = _inverse(np.ascontiguousarray(series[:, some]))
    return out


@lru_cache(maxsize=256)
def _derivatives(nodes: int, terms: int) -> tuple[Floats, ...]:
    """Return the matrices (N, K) that map leading coefficients to values and to four derivatives at the nodes."""
    at, unit = chebyshev.chebvander(transform(nodes)[0], terms - 1), np.eye(terms)
    each = [np.asarray(chebyshev.chebder(unit, order), dtype=np.float64) for order in range(5)]
    return tuple(at[:, :len(one)] @ one for one in each)


def _inverse(series: Floats) -> Floats:
    """Return the result of ``inverse_series`` for a group of columns.

    Matrix products give the values and four derivatives at the nodes, which define a polynomial around each node.
    Newton's method starts from the root of this polynomial; it keeps the slopes and recomputes only the values.
    """
    x, matrix = transform(series.shape[0])
    wanted = x[:, None]
    terms = 1 + max(1, int(np.max(np.flatnonzero(np.abs(series).max(axis=1) > _NOTHING), initial=0)))
    some = series[:terms]
    zeroth, first, second, third, fourth = (at @ some for at in _derivatives(series.shape[0], terms))
    zeroth -= wanted
    change = -zeroth / first
    for _ in range(2):
        value = (((fourth * (change / 24) + third / 6) * change + second / 2) * change + first) * change + zeroth
        change -= value / (((fourth * (change / 6) + third / 2) * change + second) * change + first)
    slope = ((fourth * (change / 6) + third / 2) * change + second) * change + first
    u = wanted + change
    for _ in range(_NEWTON_STEPS):
        change = (_values(some, u) - wanted) / slope
        u -= change
        if np.max(np.abs(change)) < _ENOUGH:
            break
    out: Floats = matrix @ u
    return out


def _values(series: Floats, u: Floats) -> Floats:
    """Return the values (N, M) of series (K, M) at their own points (N, M), using Clenshaw's recurrence in place."""
    if len(series) == 1:
        return np.broadcast_to(series[0], u.shape)
    twice = 2 * u
    room: Floats = np.empty_like(u)
    c_0, c_1 = (np.broadcast_to(series[n], u.shape).copy() for n in (-2, -1))
    for row in series[-3::-1]:
        np.multiply(c_1, twice, out=room)
        room += c_0
        np.subtract(row, c_1, out=c_0)
        c_1, room = room, c_1
    out: Floats = c_0 + c_1 * u
    return out


@lru_cache(maxsize=64)
def _powers(nodes: int) -> Floats:
    """Return the coefficients (K, K) of Chebyshev polynomials in powers of their variable, the lowest power first."""
    out = np.eye(nodes)
    for k in range(2, nodes):
        out[k] = -out[k - 2]
        out[k, 1:] += 2 * out[k - 1, :-1]
    return out


def powers_of(series: Floats) -> Floats:
    """Return the coefficients (M, K) of series (K, M) in powers of their variable, the highest power first."""
    out: Floats = np.ascontiguousarray((_powers(series.shape[0]).T @ series)[::-1].T)
    return out
