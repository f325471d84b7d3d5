"""Chebyshev series of many functions at once: from values at the nodes, inverted, and as powers of the variable."""
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from dragon_ros.core.numerics.types import Floats

_ENOUGH = 1e-9         # a Newton step, of the interval: the next error is about its square
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
    slope = chebyshev.chebder(series)
    u = wanted = np.repeat(x[:, None], series.shape[1], axis=1)
    for _ in range(_NEWTON_STEPS):
        change = (chebyshev.chebval(u, series[:, None, :], tensor=False) - wanted) / chebyshev.chebval(
            u, slope[:, None, :], tensor=False)
        u = u - change
        if np.max(np.abs(change), initial=0.0) < _ENOUGH:
            break
    out: Floats = matrix @ u
    return out


def powers_of(series: Floats) -> Floats:
    """Return series (K, M) as powers of their variable (M, K), the highest first."""
    nodes = series.shape[0]
    powers = np.array([np.append(chebyshev.cheb2poly(row), np.zeros(nodes - k - 1))
                       for k, row in ((k, np.eye(nodes)[k, :k + 1]) for k in range(nodes))])
    return np.ascontiguousarray((powers.T @ series)[::-1].T)
