"""The shift map in tiles: where a place is in the table of its tile, and the handles behind it as one matrix product.

All links of a block have one length. So one map F on the track, from a handle to the next one behind, serves all of
them at all times. Let u in [-1, 1] run over one span of track, from a place a back to F(a). Row r of a table is the
r-th image of that span, G_r(u) = F^r(a + (1 + u) / 2 (F(a) - a)), as Chebyshev series in u of its coordinates and of
its velocity. Where a handle is at G_m(u), the i-th behind it is at G_(m + i)(u), and ahead of a tail the i-th is at
G_(m - i)(u): one u serves them all. F is smooth as long as both handles stay on their segments, so the span is cut into
parts where any of its images passes a joint, and each part has series of its own: near a joint there is nothing to
decide.

A tile holds the table for the leaders of blocks on one stretch of track. Tiles are aligned to the track and built when
a place on them is first asked for, each from the track alone: a place has the same bits in any run and any process, in
whatever order tiles are built.
"""
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import acos, floor, inf
from typing import NamedTuple

import numpy as np

from dragon_ros.core.numerics.double_double import DoubleDouble, plus
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.shift_map.build import Stretch, Table, build
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND

_TERMS = 9000               # of one product: BLAS shares larger ones among threads, which could change the last bits
_BATCH = 256                # states of one batch of products: what they fill stays in the cache
_MOST_CELLS = 4096          # that a tile keeps for single states
_MOST_BYTES = 512_000_000   # of the tiles of one shift map; the least recently used go first
_FEWEST_LINKS = 512         # length of a tile, in links: a power of two, and no less than its blocks have
_SHORTEST = 1e-12           # of the coordinates: floats cannot tell the directions of shorter links
_BEFORE_LINKS = 64          # so far before the track's origin a tile begins: runs begin near the origin


class Product(NamedTuple):
    """One product of a fill: how many terms it takes, the series of places and of motions, and what it fills."""

    terms: int
    places: Floats
    motions: Floats
    start: int
    stop: int


class Cell(NamedTuple):
    """A row of a part in which leaders can be, as a single state reads it fastest: floats, and views by their links."""

    row: int
    part: int
    slack: float
    middle: float
    middle_lo: float
    scale: float
    inverse: list[float]
    products: dict[int, list[Product]]


class Spot(NamedTuple):
    """Where a handle is in a tile: its cell, and the Chebyshev polynomials (K,) of its u."""

    tile: 'Tile'
    cell: Cell
    basis: Floats


class Spots(NamedTuple):
    """Where many handles are in one tile: rows and parts (S,), and polynomials (S, K)."""

    tile: 'Tile'
    row: Ints
    part: Ints
    basis: Floats


class _Side(NamedTuple):
    """The cells of a tile on one segment, in the order of ``sense`` times the coordinate, which grows backwards."""

    sense: float
    front: float        # of the tile's stretch
    rear: float
    begins: list[float]
    cells: list[int]


@dataclass(frozen=True, eq=False)
class Tile:
    """The table for the leaders of blocks on one stretch of a track, between two places."""

    track: Track
    table: Table
    fore: Place
    rear: Place

    @cached_property
    def rows(self) -> int:
        """Number of rows of the table."""
        return self.table.rows

    @cached_property
    def _orders(self) -> Floats:
        return np.arange(self.table.nodes, dtype=np.float64)

    @cached_property
    def _sides(self) -> list[_Side | None]:
        table, out = self.table, list[_Side | None]()
        rows = slice(table.first, table.first + len(table.slack))
        segment, fore = table.segment[rows].reshape(-1), (table.middle[rows, :, 0] - 1 / table.middle[rows, :, 2])
        for k in range(len(self.track.segments)):
            cells = np.flatnonzero(segment == k)
            if not (cells.size and self.rear.segment <= k <= self.fore.segment):     # rows reach beyond the stretch
                out.append(None)
                continue
            sense = float(np.sign(table.middle[rows, :, 2].reshape(-1)[cells[0]]))
            begins = sense * fore.reshape(-1)[cells]
            low = sense * self.fore.u.hi if self.fore.segment == k else -inf
            high = sense * self.rear.u.hi if self.rear.segment == k else inf
            out.append(_Side(sense, low, high, begins.tolist(), cells.tolist()))
        return out

    @cached_property
    def _cells(self) -> dict[int, Cell]:
        return {}

    def _cell(self, number: int) -> Cell:
        """Return a cell, as floats."""
        cell = self._cells.get(number)
        if cell is None:
            table = self.table
            row, part = divmod(number, table.parts)
            middle, middle_lo, scale = table.middle[table.first + row, part].tolist()
            cell = Cell(table.first + row, part, float(table.slack[row, part]), middle, middle_lo, scale,
                        table.inverse[row, part].tolist(), {})
            if len(self._cells) >= _MOST_CELLS:
                self._cells.clear()
            self._cells[number] = cell
        return cell

    def spot(self, place: Place) -> Spot | None:
        """Return where a place is; None where the table has no track for it. Raises LookupError off the stretch.

        The stretch is half open: it holds its rear end.
        """
        side, (high, low) = self._sides[place[0]], place[1]
        if side is None:
            raise LookupError
        sense, front, rear, begins, cells = side
        along = sense * high
        if not front < along <= rear:
            raise LookupError
        number = cells[max(0, bisect_right(begins, along) - 1)]
        cell = self._cells.get(number) or self._cell(number)
        _, _, slack, middle, middle_lo, scale, inverse, _ = cell
        x = ((high - middle) + (low - middle_lo)) * scale
        if not -1 - slack <= x <= 1 + slack:
            return None
        u = 0.0
        for coefficient in inverse:
            u = u * x + coefficient
        basis = self._orders * acos(u if -1.0 <= u <= 1.0 else 1.0 if u > 0 else -1.0)
        np.cos(basis, basis)
        return Spot(self, cell, basis)

    def spots(self, places: Places) -> tuple[Spots, Array]:
        """Return where many places on the stretch are, and which of them are in the table."""
        (segment, u, lo), table = places, self.table
        cell, known = np.zeros_like(segment), np.zeros(segment.shape, dtype=bool)
        for k in np.unique(segment).tolist():
            side, on = self._sides[k], segment == k
            if side:
                at = np.searchsorted(side.begins, side.sense * u[on], side='right') - 1
                cell[on] = np.array(side.cells)[np.maximum(0, at)]
                known[on] = True
        row, part = np.divmod(cell, table.parts)
        middle, slack, inverse = table.middle[table.first + row, part], table.slack[row, part], table.inverse[row, part]
        x = ((u - middle[:, 0]) + (lo - middle[:, 1])) * middle[:, 2]
        known &= np.abs(x) <= 1 + slack
        value = np.zeros_like(x)
        for coefficient in inverse.T:
            value = value * x + coefficient
        basis = np.cos(np.arccos(np.clip(np.where(known, value, 0.0), -1.0, 1.0))[:, None] * self._orders)
        return Spots(self, table.first + row, part, basis), known

    def place_at(self, spot: Spot, row: int) -> Place:
        """Return the place of the handle in another row."""
        part = spot.cell.part
        middle, middle_lo, scale = self.table.middle[row, part].tolist()
        x = float(spot.basis @ self.table.coordinates[part, :, row])
        return Place(int(self.table.segment[row, part]), DoubleDouble(*plus(middle, middle_lo, x / scale)))

    def places_at(self, spots: Spots, row: Ints) -> Places:
        """Return ``place_at`` of many."""
        middle = self.table.middle[row, spots.part]
        x = np.einsum('sk,sk->s', spots.basis, self.table.coordinates[spots.part, :, row])
        return self.table.segment[row, spots.part], *plus(middle[:, 0], middle[:, 1], x / middle[:, 2])

    def products(self, cell: Cell, links: int, direction: int) -> list[Product]:
        """Return the products that give the handle in a cell and ``links`` beyond it, from head to tail."""
        out = cell.products.get(links)
        if out is None:
            first, size = cell.row if direction == BEHIND else cell.row - links, 2 * links + 2
            terms = int(self.table.terms[cell.part, first])
            width, out = _TERMS // terms // 2 * 2, []
            for low in range(0, size, width):
                stop = min(low + width, size)
                places, motions = (series[cell.part, :terms, 2 * first + low:2 * first + stop]
                                   for series in (self.table.places, self.table.motions))
                out.append(Product(terms, places, motions, low, stop))
            cell.products[links] = out
        return out

    def fill_many(self, spots: Spots, first: Ints, out: Floats, motions: bool = False) -> None:
        """Fill ``out`` (S, n, 2) as ``fill`` does; states of one row and part share a product."""
        flat, table = out.reshape(out.shape[0], 2 * out.shape[1]), self.table
        series = table.motions if motions else table.places
        for some, cell in _same_cells(first * table.parts + spots.part):
            row, part = divmod(cell, table.parts)
            terms = int(table.terms[part, row])
            np.matmul(spots.basis[some, :terms], series[part, :terms, 2 * row:2 * row + flat.shape[1]], out=flat[some])

    def paces(self, spots: Spots) -> Floats:
        """Return the speeds of many handles for unit speed in row 0."""
        x, y = (np.einsum('sk,sk->s', spots.basis, self.table.motions[spots.part, :, 2 * spots.row + n])
                for n in (0, 1))
        out: Floats = np.hypot(x, y)
        return out


def _same_cells(cell: Ints) -> list[tuple[slice, int]]:
    """Return runs of states in one cell, as (slice, cell), none longer than a batch."""
    ends = [0, *(np.flatnonzero(np.diff(cell)) + 1).tolist(), cell.size]
    return [(slice(low, min(low + _BATCH, end)), int(cell[start])) for start, end in pairwise(ends)
            for low in range(start, end, _BATCH)]


def links_of_tile(links: int) -> int:
    """Return how many links long the tiles for blocks of up to ``links`` links are."""
    return max(_FEWEST_LINKS, 1 << (links - 1).bit_length())


class ShiftMap:
    """The map from a handle to those that follow it, for blocks of up to ``links`` links of one length on a track.

    ``series_m`` tells from a tile's foremost place, and then from how far out places are, where series are cut.
    """

    def __init__(self, track: Track, link_m: float, links: int, direction: int,
                 series_m: Callable[[Place], Callable[[Floats], Floats]]) -> None:
        """Lay out the tiles; none is built yet."""
        self.track, self.link_m, self.links, self.direction = track, link_m, links, direction
        self._series_m = series_m
        self._length_m, self._before_m = links_of_tile(links) * link_m, _BEFORE_LINKS * link_m
        self._tiles: OrderedDict[int, Tile | None] = OrderedDict()
        self._last: Tile | None = None

    @property
    def tiles(self) -> list[Tile]:
        """The tiles built so far."""
        return [tile for tile in self._tiles.values() if tile]

    @property
    def memory_bytes(self) -> int:
        """What the arrays of the tiles take."""
        return sum(tile.table.memory_bytes for tile in self.tiles)

    def spot(self, place: Place) -> Spot | None:
        """Return where a place is; None where no table serves it."""
        try:
            return self._last.spot(place)       # type: ignore[union-attr]
        except (LookupError, AttributeError):   # on another tile than the last place, or no tile yet
            tile = self._tile(self._number(place))
            self._last = tile or self._last
            return tile.spot(place) if tile else None

    def spots(self, places: Places) -> list[tuple[Ints, Spots]] | None:
        """Return the tiles of many places: which places each has, and where; None where any is in no table."""
        segment, u, lo = places
        number = np.array([self._number(Place.of(*place)) for place in self._ends(places)])
        if number.size and number.min() == number.max():
            each = [(np.arange(segment.size), int(number[0]))]
        else:
            numbers = np.array([self._number(Place.of(*place)) for place in zip(segment, u, lo, strict=True)],
                               dtype=np.int64)
            each = [(np.flatnonzero(numbers == one), one) for one in np.unique(numbers).tolist()]
        out = []
        for rows, one in each:
            tile = self._tile(one)
            if tile is None:
                return None
            spots, known = tile.spots((segment[rows], u[rows], lo[rows]))
            if not np.all(known):
                return None
            out.append((rows, spots))
        return out

    def _ends(self, places: Places) -> list[tuple[int, float, float]]:
        """Return the first and the last of many places along the track."""
        if not places[0].size:
            return []
        along = self.track.distances(*places[:2])
        return [tuple(float(value[n]) for value in places) for n in (np.argmin(along), np.argmax(along))]  # type: ignore[misc]

    def _number(self, place: Place) -> int:
        """Return the number of a place's tile: the boundaries are places, and decide."""
        number = floor((self.track.distance_of(place)[0] + self._before_m) / self._length_m)
        while self._is_behind(place, number):
            number -= 1
        while not self._is_behind(place, number + 1):
            number += 1
        return number

    def _is_behind(self, place: Place, number: int) -> bool:
        """Return whether a place is behind the beginning of a tile."""
        begin = self._boundary(number)
        if begin is None:
            return number * self._length_m - self._before_m > 0
        if place.segment != begin.segment:
            return place.segment < begin.segment
        return bool((place.u.hi - begin.u.hi) * self.track.segments[place.segment].rate(place.u.hi) < 0)

    def _boundary(self, number: int) -> Place | None:
        """Return the place at which a tile begins; None beyond the track."""
        metres = number * self._length_m - self._before_m
        return self.track.place_at(metres) if self.track.begin_m < metres < self.track.end_m else None

    def _tile(self, number: int) -> Tile | None:
        """Return a tile, built when it is first asked for; None where no table serves."""
        if number in self._tiles:
            self._tiles.move_to_end(number)
            return self._tiles[number]
        tile = self._tiles[number] = self._built(number)
        while len(self._tiles) > 1 and self.memory_bytes > _MOST_BYTES:
            self._tiles.popitem(last=False)
        return tile

    def _built(self, number: int) -> Tile | None:
        track = self.track
        low_m, high_m = (n * self._length_m - self._before_m for n in (number, number + 1))
        ends = [self._boundary(number + 1) or self._end(1), self._boundary(number) or self._end(-1)]
        far_m = track.far_m(max(low_m, track.begin_m), min(high_m, track.end_m))
        if self.link_m <= _SHORTEST * far_m:
            return None
        table = build(track, self.link_m, Stretch(low_m, high_m, self.links, self.direction),
                      self._series_m(ends[0]))
        return Tile(track, table, *ends) if table else None

    def _end(self, side: int) -> Place:
        """Return the track's own end, ahead (1) or behind; infinitely far where it is open."""
        last = len(self.track.segments) - 1
        segment = self.track.segments[last if side > 0 else 0]
        u = segment.last if side > 0 else segment.first
        sense = side if abs(u) == inf else 0
        return Place(last if side > 0 else 0, DoubleDouble(u if sense else u + self._beyond(segment, u, side), 0.0))

    @staticmethod
    def _beyond(segment: object, u: float, side: int) -> float:
        """Return a change of coordinate that leaves out nothing at a closed end."""
        rate = segment.rate(u)      # type: ignore[attr-defined]
        return float(side * (1.0 if rate > 0 else -1.0) * (1 + abs(u)))
