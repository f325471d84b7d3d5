"""Building a shift table: push the nodes of one span outward, once, and turn what they met into series."""
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, pi

import numpy as np
from numpy.polynomial import chebyshev

from dragon_ros.core.angle import plus
from dragon_ros.core.march import first_guess, step
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.path import Spiral, arc_between, points, tangents
from dragon_ros.core.rates import along_track
from dragon_ros.core.table import ShiftTable

_MOST_NODES = 32
_MOST_BYTES = 256_000_000
_MOST_PLACES = 20_000   # rows where the second handle can be
_PROBE_ROWS = 3
_NOISE = 4              # what rounding may add to the last terms, in units of the error
_STEP = 1e-8            # the error of a Newton step is about half its square


@dataclass(frozen=True)
class _Rows:
    """Polar angles of the nodes in each row, and of the row's inner edge as the last lane: (K+1, R)."""

    theta: Floats
    low: Floats
    delta: Floats       # (K+1, R-1)


def table_for(spiral: Spiral, links_m: Floats, second: tuple[float, float], newton: float,
              error_m: float) -> ShiftTable | None:
    """Return the table for a second handle between two polar angles, its series cut at ``error_m``.

    ``links_m`` (N,) are equal behind the first; ``newton`` as in ``march.Effort``. None where no table serves: a link
    spans half a turn or locks, the series need more than 32 terms, or there would be too many rows.
    """
    chord = float(links_m[1] / spiral.b_m)
    low, high = second[0] * (1 - 1e-12), second[1] * (1 + 1e-12)
    delta = step(low, chord, first_guess(low, chord), _STEP)[0] if chord > 0 else 0.0
    if not 0 < delta < 1.5:
        return None
    count = ceil(arc_between(high, high - low) / chord) + 1
    if count > _MOST_PLACES:
        return None
    for nodes in range(_nodes(spiral, chord, (low, delta), error_m), _MOST_NODES + 1, 3):
        if 32 * nodes * (count + links_m.size) > _MOST_BYTES:
            return None
        rows = push(chord, _span(low, delta, nodes), count + links_m.size)
        table = _table(spiral, links_m, rows, high, newton, error_m) if rows else None
        if table is None or _tail_m(table) <= _NOISE * error_m:
            return table
    return None


@lru_cache(maxsize=64)
def transform(nodes: int) -> tuple[Floats, Floats]:
    """Return the Chebyshev nodes in [-1, 1] and the matrix from values there to the series."""
    quarter = np.cos(np.arange(4 * nodes) * (np.pi / (2 * nodes)))     # whole turns are taken off in integers
    odd = 2 * np.arange(nodes) + 1
    matrix = 2 / nodes * quarter[np.outer(np.arange(nodes), odd) % (4 * nodes)]
    matrix[0] *= 0.5
    return quarter[odd], matrix


def _span(low: float, delta: float, nodes: int) -> tuple[Floats, Floats]:
    """Return the polar angles (hi, lo) of the nodes in the span from ``low``, and of its inner edge."""
    inner = np.full(nodes + 1, low)
    return plus(inner, np.zeros_like(inner), np.append(0.5 * (1 + transform(nodes)[0]), 0.0) * delta)


def _nodes(spiral: Spiral, chord: float, span: tuple[float, float], error_m: float) -> int:
    """Return how many terms the series of the innermost rows need, which bend the most."""
    rows = push(chord, _span(*span, _MOST_NODES), _PROBE_ROWS)
    if rows is None:
        return _MOST_NODES + 1
    p = points(spiral.b_m, rows.theta[:-1], rows.low[:-1]).reshape(_MOST_NODES, -1)
    size = np.max(np.abs(transform(_MOST_NODES)[1] @ p), axis=1)
    return min(_MOST_NODES, 2 + int(np.max(np.flatnonzero(size > error_m), initial=2)))


def push(chord: float, first: tuple[Floats, Floats], count: int) -> _Rows | None:
    """Return ``count`` rows, of which the first is given; None where Newton does not settle on a short link.

    The predictor is that of ``march.place`` with one difference more; the chord equation is solved row after row, for
    all nodes at once, and every link is checked in the end.
    """
    out, low = np.empty((2, count, first[0].size))
    delta = np.empty((count - 1, first[0].size))
    out[0], low[0] = first
    square = chord * chord
    past: list[Floats] = []
    for r in range(count - 1):
        inner = out[r]
        if len(past) == 4:
            ahead = 4 * (past[3] + past[1]) - 6 * past[2] - past[0]
            guess = ahead / (inner + np.sqrt(inner * inner + ahead))
        else:
            guess = 2 * np.arcsin(np.minimum(1.0, chord / (2 * inner + pi)))
        solved = _solve(inner, square, guess)
        if solved is None:
            return None
        delta[r] = solved
        past = [*past[-3:], solved * (2 * inner + solved)]
        out[r + 1], low[r + 1] = plus(inner, low[r], solved)
    return _Rows(out.T, low.T, delta.T)


def _solve(theta: Floats, square: float, delta: Floats) -> Floats | None:
    """Return the spans of links with a squared chord, by Newton (see ``march.step``)."""
    for _ in range(8):
        half = 0.5 * delta
        s = np.sin(half)
        across, outer = 2 * theta * s, theta + delta
        phi = delta + across * (s + outer * np.cos(half))
        change = 0.5 * (delta * delta + 2 * across * outer * s - square) / phi
        delta = delta - change
        size = np.abs(change)
        if not np.all((delta > 0) & (delta < 1.5)):
            return None
        if np.all(size < _STEP * delta):
            return delta
    return None


def _table(spiral: Spiral, links_m: Floats, rows: _Rows, high: float, newton: float, error_m: float) -> ShiftTable:
    """Return the table of some rows; those from which the last handle is beyond them are for its followers only."""
    nodes = rows.theta.shape[0] - 1
    edges, matrix = rows.theta[-1], transform(nodes)[1]
    few = min(int(np.searchsorted(edges, high)), edges.size - links_m.size + 1)
    count = few + links_m.size - 1
    theta, low = rows.theta[:-1, :count], rows.low[:-1, :count]
    cos_alpha, cos_beta = along_track(theta, rows.delta[:-1, :count - 1])
    speed = np.cumprod(np.concatenate((np.ones((nodes, 1)), cos_alpha / cos_beta), axis=1), axis=1)
    p, v = points(spiral.b_m, theta, low), -speed[..., None] * tangents(theta)
    edge, edge_lo = edges[:few + 1], rows.low[-1, :few + 1]
    width = (edge[1:] - edge[:-1]) + (edge_lo[1:] - edge_lo[:-1])
    x = 2 * ((theta[:, :few] - edge[:-1]) + (low[:, :few] - edge_lo[:-1])) / width - 1
    centre, centre_lo = plus(edge[:-1], edge_lo[:-1], 0.5 * width)
    places, motions = matrix @ p.reshape(nodes, -1), matrix @ v.reshape(nodes, -1)
    return ShiftTable(spiral, links_m, newton, read_only(edge), read_only(centre), read_only(centre_lo),
                      read_only(2 / width), read_only(powers_of(inverse_series(matrix @ x))), read_only(places),
                      read_only(motions), _terms(places, float(links_m[1]) * motions, error_m))


def _terms(places: Floats, motions: Floats, error_m: float) -> Ints:
    """Return how many terms the series need from each row on, to be cut at ``error_m``."""
    size = np.maximum(np.abs(places), np.abs(motions)).reshape(len(places), -1, 2).max(axis=2)
    needed = len(places) - np.argmax(size[::-1] > error_m, axis=0)
    return np.maximum.accumulate(needed[::-1])[::-1]


def inverse_series(series: Floats) -> Floats:
    """Return the inverses u(x) of series x(u) (K, M), as series in x (K, M)."""
    x, matrix = transform(series.shape[0])
    slope = chebyshev.chebder(series)
    u = wanted = np.repeat(x[:, None], series.shape[1], axis=1)
    for _ in range(6):
        u = u - (chebyshev.chebval(u, series[:, None, :], tensor=False) - wanted) / chebyshev.chebval(
            u, slope[:, None, :], tensor=False)
    out: Floats = matrix @ u
    return out


def powers_of(series: Floats) -> Floats:
    """Return series (K, M) as powers of their variable (M, K), the highest first."""
    nodes = series.shape[0]
    powers = np.array([np.append(chebyshev.cheb2poly(row), np.zeros(nodes - k - 1))
                       for k, row in ((k, np.eye(nodes)[k, :k + 1]) for k in range(nodes))])
    return np.ascontiguousarray((powers.T @ series)[::-1].T)


def _tail_m(table: ShiftTable) -> float:
    """Return about what the series leave out, in metres: their last terms, over all rows."""
    span_m = float(np.max(table.links_m[1:]))
    return max(float(np.max(np.abs(table.places[-2:]))), span_m * float(np.max(np.abs(table.motions[-2:]))),
               span_m * float(np.max(np.abs(table.inverse[:, 0]))) / 2.0 ** (table.nodes - 2))
