"""The shift table on a track of pieces: all handles of a run of equal links at once.

As in ``table``, with any track in place of one spiral. Let F be the map from a handle to the next one behind. On a walk
that place is the only one a link away within reach (``chord.reach_m``), and so is the place of a handle within reach of
the next one: F is one to one, and ahead of a tail the same rows are read the other way. F is smooth as long as both
handles stay on their pieces. So the span, from the foremost place a back to F(a), is cut into parts where any of its
images passes a joint, and each part has series of its own: near a joint there is nothing to decide.
"""
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from math import acos
from typing import NamedTuple

import numpy as np

from dragon_ros.core.angle import Angle, plus
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.placed import BACK
from dragon_ros.core.table import TERMS, same_rows
from dragon_ros.core.walk import Place, Walk
from dragon_ros.core.walk_many import Places


class Spot(NamedTuple):
    """Where a handle is in a table: its row, its part of the span, and the Chebyshev polynomials (K,) of its u."""

    row: int
    part: int
    basis: Floats


class Spots(NamedTuple):
    """Where many handles are: (S,), (S,) and (S, K)."""

    row: Ints
    part: Ints
    basis: Floats


@dataclass(frozen=True)
class TrackTable:
    """R rows of S parts of a span of places, for links of one length (``track_rows.track_table`` makes it).

    Part s of row r lies on the piece ``piece[r, s]``. ``charts[r, s]`` is how far |x| may be beyond 1 by rounding, the
    piece's coordinate in the middle as (hi, lo) and the scale, with x = (coordinate - middle) * scale in [-1, 1], and
    the coefficients of u(x), the highest power first. Series by part: ``coordinates`` (S, K, R) of x, ``places`` and
    ``motions`` (S, K, 2 R) of x and y in m and of velocities for unit speed in row 0. From row r on ``terms[s, r]``
    terms are enough.
    """

    walk: Walk
    piece: Ints
    charts: Floats
    coordinates: Floats
    places: Floats
    motions: Floats
    terms: Ints

    @property
    def rows(self) -> int:
        """Number of images of the span."""
        return int(self.piece.shape[0])

    @property
    def parts(self) -> int:
        """Number of parts of the span."""
        return int(self.piece.shape[1])

    @property
    def nodes(self) -> int:
        """Number of terms of the series."""
        return int(self.places.shape[1])

    @property
    def memory_bytes(self) -> int:
        """What the arrays of the table take."""
        return sum(value.nbytes for value in vars(self).values() if isinstance(value, np.ndarray))

    @cached_property
    def _orders(self) -> Floats:
        return np.arange(self.nodes, dtype=np.float64)

    @cached_property
    def _ways(self) -> list[tuple[float, Floats, Ints, list[float]]]:
        """For each piece: the sense in which its coordinate grows backwards, and where its cells begin, in order."""
        out, fore = [], self.charts[..., 1] - 1 / self.charts[..., 3]
        for k in range(len(self.walk.pieces)):
            cells = np.flatnonzero(self.piece.reshape(-1) == k)
            sense = float(np.sign(self.charts.reshape(-1, self.charts.shape[-1])[cells[:1], 3].sum()))
            begins = sense * fore.reshape(-1)[cells]
            out.append((sense, begins, cells, begins.tolist()))
        return out

    def spot(self, place: Place) -> Spot | None:
        """Return where a place is; None outside the table."""
        sense, _, cells, begins = self._ways[place.piece]
        if not begins:
            return None
        (high, low), cell = place.u, max(0, bisect_right(begins, sense * place.u.hi) - 1)
        row, part = divmod(int(cells[cell]), self.parts)
        slack, middle, middle_lo, scale, *inverse = self.charts[row, part].tolist()
        x = ((high - middle) + (low - middle_lo)) * scale
        if not -1 - slack <= x <= 1 + slack:
            return None
        u = 0.0
        for coefficient in inverse:
            u = u * x + coefficient
        basis = self._orders * acos(min(1.0, max(-1.0, u)))
        np.cos(basis, basis)
        return Spot(row, part, basis)

    def spots(self, places: Places) -> tuple[Spots, Array]:
        """Return where many places are, and which of them are in the table."""
        piece, u, lo = places
        cell, known = np.zeros_like(piece), np.zeros(piece.shape, dtype=bool)
        for k in np.unique(piece).tolist():
            sense, begins, cells, _ = self._ways[k]
            on = piece == k
            if begins.size:
                cell[on] = cells[np.maximum(0, np.searchsorted(begins, sense * u[on], side='right') - 1)]
                known[on] = True
        row, part = np.divmod(cell, self.parts)
        chart = self.charts[row, part]
        x = ((u - chart[:, 1]) + (lo - chart[:, 2])) * chart[:, 3]
        known &= np.abs(x) <= 1 + chart[:, 0]
        value = np.zeros_like(x)
        for coefficient in chart[:, 4:].T:
            value = value * x + coefficient
        basis = np.cos(np.arccos(np.clip(np.where(known, value, 0.0), -1.0, 1.0))[:, None] * self._orders)
        return Spots(row, part, basis), known

    def reach(self, spot: Spot, way: int) -> int:
        """Return how many handles beyond a spot the table has."""
        return self.rows - 1 - spot.row if way == BACK else spot.row

    def place_at(self, spot: Spot, row: int) -> Place:
        """Return the place of the handle in another row."""
        _, middle, middle_lo, scale = self.charts[row, spot.part, :4].tolist()
        x = float(spot.basis @ self.coordinates[spot.part, :, row])
        return Place(int(self.piece[row, spot.part]), Angle(*plus(middle, middle_lo, x / scale)))

    def places_at(self, spots: Spots, row: Ints) -> Places:
        """Return ``place_at`` of many."""
        chart = self.charts[row, spots.part]
        x = np.einsum('sk,sk->s', spots.basis, self.coordinates[spots.part, :, row])
        return self.piece[row, spots.part], *plus(chart[:, 1], chart[:, 2], x / chart[:, 3])

    def fill(self, series: Floats, spot: Spot, first: int, out: Floats) -> None:
        """Fill ``out`` (n, 2) with the sums of places or motions of the handles in n rows from ``first`` on."""
        flat, terms, basis = out.reshape(-1), int(self.terms[spot.part, first]), spot.basis
        width = TERMS // terms // 2 * 2
        for low in range(0, flat.size, width):
            part = flat[low:low + width]
            start = 2 * first + low
            np.matmul(basis[:terms], series[spot.part, :terms, start:start + part.size], part)

    def fill_many(self, series: Floats, spots: Spots, first: Ints, out: Floats) -> None:
        """Fill ``out`` (S, n, 2) as ``fill`` does; states of one row and part share a product."""
        flat = out.reshape(out.shape[0], 2 * out.shape[1])
        for some, cell in same_rows(first * self.parts + spots.part):
            row, part = divmod(cell, self.parts)
            terms = int(self.terms[part, row])
            np.matmul(spots.basis[some, :terms], series[part, :terms, 2 * row:2 * row + flat.shape[1]], out=flat[some])

    def paces(self, spots: Spots) -> Floats:
        """Return the speeds of many handles for unit speed in row 0."""
        x, y = (np.einsum('sk,sk->s', spots.basis, self.motions[spots.part, :, 2 * spots.row + n]) for n in (0, 1))
        out: Floats = np.hypot(x, y)
        return out
