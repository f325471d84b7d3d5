"""Chebyshev series of many functions at once: from values at the nodes, inverted, and as powers of the variable."""
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from dragon_ros.core.numerics.types import Floats

_ENOUGH = 1e-9         # a Newton step, of the interval: the next error is about its square
_NOTHING = 1e-19       # of the interval: terms that no sum of doubles shows
_NEWTON_STEPS = 6       # from within a tenth of the interval: quadratic convergence reaches the last digit in five


@lru_cache(maxsize=64)
def transform(nodes: int) -> tuple[Floats, Floats]:
    """Return the Chebyshev nodes in [-1, 1] and the matrix from values there to the coefficients."""
    quarter = np.cos(np.arange(4 * nodes) * (np.pi / (2 * nodes)))     # whole turns are taken off in integers
    odd = 2 * np.arange(nodes) + 1
    matrix = 2 / nodes * quarter[np.outer(np.arange(nodes), odd) % (4 * nodes)]
    matrix[0] *= 0.5
    return quarter[odd], matrix


def inverse_series(series: Floats) -> Floats:
    """Return the inverses u(x) of monotone series x(u) (K, M) from [-1, 1] to itself, as series in x (K, M)."""
    x, matrix = transform(series.shape[0])
    at = chebyshev.chebvander(x, series.shape[0] - 1)
    series = series[:1 + max(1, int(np.max(np.flatnonzero(np.abs(series).max(axis=1, initial=0.0) > _NOTHING),
                                           initial=0)))]
    slope, wanted = np.asarray(chebyshev.chebder(series), dtype=np.float64), x[:, None]
    # The first step starts at the nodes, where a product has all values.
    change = (at[:, :len(series)] @ series - wanted) / (at[:, :len(slope)] @ slope)
    u = wanted - change
    for _ in range(_NEWTON_STEPS - 1):
        if np.max(np.abs(change), initial=0.0) < _ENOUGH:
            break
        change = (_values(series, u) - wanted) / _values(slope, u)
        u -= change
    out: Floats = matrix @ u
    return out


def _values(series: Floats, u: Floats) -> Floats:
    """Return the values (N, M) of series (K, M), each at its own points (N, M), by Clenshaw's recurrence in place."""
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
    """Return the coefficients (K, K) of Chebyshev polynomials in powers of their variable, the lowest first."""
    out = np.eye(nodes)
    for k in range(2, nodes):
        out[k] = -out[k - 2]
        out[k, 1:] += 2 * out[k - 1, :-1]
    return out


def powers_of(series: Floats) -> Floats:
    """Return series (K, M) as powers of their variable (M, K), the highest first."""
    out: Floats = np.ascontiguousarray((_powers(series.shape[0]).T @ series)[::-1].T)
    return out
