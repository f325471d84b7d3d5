"""The shift table: all handles at once, as products of small matrices.

Every link behind the head's has one length, so one map F on the track, from a handle to the next, serves all handles at
all times. Let u in [-1, 1] run over one span, from a place a to F(a), at the inner end of a run. Row r of the table is
the r-th image of that span, G_r(u) = F^r(a + (1 + u) / 2 (F(a) - a)), as Chebyshev series in u of its coordinates and
of its velocity. Where the second handle is at G_m(u), handle i is at G_(m + i - 1)(u): one u serves them all.
"""
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import acos, copysign, hypot, inf
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.angle import Angle, plus
from dragon_ros.core.chain import Chain
from dragon_ros.core.march import first_guess, locked, step
from dragon_ros.core.march_many import head_steps
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.path import Spiral, point, points, tangent, tangents
from dragon_ros.core.rates import speed_ratio, speed_ratios

TERMS = 9000        # of one product: BLAS shares larger ones among threads, which could change the last bits
_BATCH = 256        # states of one batch of products: what they fill stays in the cache


@dataclass(frozen=True)
class ShiftTable:
    """A table for one spiral, one dragon of equal body links and the places of one run (``table_rows.table_for``).

    ``edges`` (M+1,) are the polar angles between the M rows where the second handle can be. In row m its angle less
    ``centre`` + ``centre_lo`` (M,), times ``scale`` (M,), is x in [-1, 1], and ``inverse`` (M, K) are the coefficients
    of u(x), the highest power first. ``places`` and ``motions`` (K, 2 R) are the series of x and y of all R rows, in m,
    and of their velocities for a unit speed in row 0; from row r on the first ``terms[r]`` (R,) terms are enough.
    """

    spiral: Spiral
    links_m: Floats
    newton: float
    edges: Floats
    centre: Floats
    centre_lo: Floats
    scale: Floats
    inverse: Floats
    places: Floats
    motions: Floats
    terms: Ints

    @property
    def nodes(self) -> int:
        """Number of terms of the series."""
        return int(self.places.shape[0])

    @property
    def rows(self) -> int:
        """Number of images of the span."""
        return int(self.places.shape[1] // 2)

    @property
    def memory_bytes(self) -> int:
        """What the arrays of the table take."""
        return sum(value.nbytes for value in vars(self).values() if isinstance(value, np.ndarray))

    @cached_property
    def _chord(self) -> float:
        return float(self.links_m[0] / self.spiral.b_m)

    @cached_property
    def _rows(self) -> tuple[list[float], list['_Row']]:
        """The edges, and each row as a single tick reads it fastest: floats and views."""
        columns = (self.centre.tolist(), self.centre_lo.tolist(), self.scale.tolist(), self.inverse.tolist())
        rows = [_Row(*values, self._part(self.places, row, 0), self._part(self.motions, row, 0),
                     self._orders[:self.terms[row]]) for row, values in enumerate(zip(*columns, strict=True))]
        return self.edges.tolist(), rows

    def _part(self, series: Floats, row: int, start: int) -> Floats:
        """View what one product takes of the series of a chain from ``row`` on, ``start`` columns further."""
        first = 2 * row + start
        terms = int(self.terms[first // 2])
        return series[:terms, first:min(first + TERMS // terms // 2 * 2, 2 * (row + self.links_m.size))]

    @cached_property
    def _orders(self) -> Floats:
        return np.arange(self.nodes, dtype=np.float64)

    def place(self, head: Angle) -> 'TableChain | None':
        """Return the chain behind ``head``; None where the second handle is outside the table.

        Raises ChainLockError where the head's link finds no place.
        """
        theta, low = head
        delta, evaluations = step(theta, self._chord, first_guess(theta, self._chord), self.newton)
        if delta == inf:
            raise locked(self.spiral, 0, theta, self._chord)
        second, second_lo = plus(theta, low, delta)
        edges, rows = self._rows
        row = bisect_right(edges, second) - 1
        if not 0 <= row < len(rows):
            return None
        centre, centre_lo, scale, inverse, series, _, orders = rows[row]
        x = ((second - centre) + (second_lo - centre_lo)) * scale
        u = 0.0
        for coefficient in inverse:
            u = u * x + coefficient
        basis = orders * acos(u if -1.0 <= u <= 1.0 else copysign(1.0, u))
        np.cos(basis, basis)
        flat = self._sums(self.places, series, row, basis)
        flat[0], flat[1] = point(self.spiral.b_m, theta, low)
        return TableChain(_closed(flat), self.links_m, evaluations, _Spot(self, row, basis, theta, delta))

    def _sums(self, series: Floats, first: Floats, row: int, basis: Floats) -> Floats:
        """Return room for the head's pair and the sums of the series from ``row`` on; ``first`` views some of them."""
        flat = np.empty(2 * self.links_m.size + 2)
        start = 2 + first.shape[1]
        np.matmul(basis, first, flat[2:start])
        while start < flat.size:
            part = self._part(series, row, start - 2)
            np.matmul(basis[:part.shape[0]], part, flat[start:start + part.shape[1]])
            start += part.shape[1]
        return flat

    def velocities(self, spot: '_Spot', head_speed_m_s: float) -> Floats:
        """Return the velocities (N+1, 2) of a chain that the table placed."""
        _, row, basis, head, delta = spot
        flat = self._sums(self.motions, self._rows[1][row].motions, row, basis)
        behind = flat[2:]
        behind *= head_speed_m_s * speed_ratio(head, delta) / hypot(flat[2], flat[3])
        x, y = tangent(head)
        flat[0], flat[1] = -head_speed_m_s * x, -head_speed_m_s * y
        return _closed(flat)

    def place_many(self, theta: Floats, theta_lo: Floats) -> 'TableChains | None':
        """Return the chains behind many heads (S,) in one; None where any second handle is outside the table."""
        delta, evaluations = head_steps(self.spiral, theta, self._chord, self.newton)
        second, second_lo = plus(theta, theta_lo, delta)
        row = np.searchsorted(self.edges, second, side='right') - 1
        if row.size and not 0 <= row.min() <= row.max() < self.centre.size:
            return None
        x = ((second - self.centre[row]) + (second_lo - self.centre_lo[row])) * self.scale[row]
        u = np.zeros_like(x)
        for coefficient in self.inverse.T:
            u = u * x + coefficient[row]
        basis = np.cos(np.arccos(np.clip(u, -1.0, 1.0))[:, None] * self._orders)
        p = np.empty((theta.size, self.links_m.size + 1, 2))
        p[:, 0] = points(self.spiral.b_m, theta, theta_lo)
        self._sum_many(self.places, row, basis, p)
        return TableChains(read_only(p), self.links_m, evaluations, self, row, basis, theta, delta)

    def velocities_many(self, chains: 'TableChains', head_speed_m_s: float | Floats) -> Floats:
        """Return the velocities (S, N+1, 2) of chains that the table placed."""
        speed: Floats = np.broadcast_to(head_speed_m_s, chains.head.shape)
        x, y = (np.einsum('sk,ks->s', chains.basis, self.motions[:, 2 * chains.row + k]) for k in (0, 1))
        second = speed * speed_ratios(chains.head, chains.delta) / np.hypot(x, y)
        out = np.empty_like(chains.p)
        out[:, 0] = -speed[:, None] * tangents(chains.head)
        self._sum_many(self.motions, chains.row, chains.basis * second[:, None], out)
        return read_only(out)

    def directions_many(self, row: Ints, basis: Floats, out: Floats) -> Floats:
        """Fill ``out`` (S, N+1, 2) behind the first handles with unit tangents, outwards."""
        self._sum_many(self.motions, row, -basis, out)
        out[:, 1:] /= np.hypot(out[:, 1:, 0], out[:, 1:, 1])[..., None]
        return out

    def _sum_many(self, series: Floats, row: Ints, basis: Floats, out: Floats) -> None:
        """Fill ``out`` (S, N+1, 2) behind the first handles; states of one row share a product."""
        width = 2 * self.links_m.size
        flat = out.reshape(out.shape[0], 2 + width)
        for part, first in same_rows(row):
            terms = int(self.terms[first])
            np.matmul(basis[part, :terms], series[:terms, 2 * first:2 * first + width], out=flat[part, 2:])


def _closed(flat: Floats) -> Floats:
    """Return the pairs (N+1, 2) that lie in ``flat``, closed for writing."""
    out = flat.reshape(-1, 2)
    out.setflags(write=False)
    return out


def same_rows(row: Ints) -> list[tuple[slice, int]]:
    """Return runs of states in one row, as (slice, row), none longer than a batch."""
    ends = [0, *(np.flatnonzero(np.diff(row)) + 1).tolist(), row.size]
    return [(slice(low, min(low + _BATCH, end)), int(row[start])) for start, end in pairwise(ends)
            for low in range(start, end, _BATCH)]


class _Row(NamedTuple):
    """A row where the second handle can be, with its series and those of the followers that share the first product."""

    centre: float
    centre_lo: float
    scale: float
    inverse: list[float]
    places: Floats
    motions: Floats
    orders: Floats      # of the terms


class _Spot(NamedTuple):
    """Where a chain is: row and basis (K,) of its second handle, the head's polar angle and the span of its link."""

    table: ShiftTable
    row: int
    basis: Floats
    head: float
    delta: float


@dataclass(frozen=True)
class TableChain(Chain):
    """A chain from the table."""

    spot: _Spot
    solver = 'table'

    def velocities(self, head_speed_m_s: Any) -> Floats:
        """Return velocity vectors in m/s, shape (N+1, 2): the head's from its tangent, the others from the table."""
        return self.spot.table.velocities(self.spot, head_speed_m_s)

    @property
    def tangents(self) -> Floats:
        """Unit tangents of the spiral, outwards."""
        table, row, basis, head, _ = self.spot
        chains = TableChains(self.p[None], self.links_m, 0, table, np.array([row]), basis[None], np.array([head]),
                             np.array([self.spot.delta]))
        return read_only(chains.tangents[0])


@dataclass(frozen=True)
class TableChains(Chain):
    """Chains of many instants from the table; arrays start with the instants."""

    table: ShiftTable
    row: Ints
    basis: Floats
    head: Floats
    delta: Floats
    solver = 'table'

    def velocities(self, head_speed_m_s: float | Floats) -> Floats:
        """Return velocity vectors in m/s, shape (S, N+1, 2)."""
        return self.table.velocities_many(self, head_speed_m_s)

    @property
    def tangents(self) -> Floats:
        """Unit tangents of the spiral, outwards."""
        out = self.table.directions_many(self.row, self.basis, np.empty_like(self.p))
        out[:, 0] = tangents(self.head)
        return read_only(out)
