"""The shift map in tiles: a position is located in the table of its tile, and one matrix product yields its followers.

All links of a block have the same length, so one map F on the track, from a handle to the next handle behind, applies
to all links at all times. Let u in [-1, 1] cover one span of track, from a position a back to F(a). Row r of a table is
the r-th image of this span, G_r(u) = F^r(a + (1 + u) / 2 (F(a) - a)), as Chebyshev series in u of the coordinates and
of the velocity. If a handle is at G_m(u), the i-th handle behind it is at G_(m + i)(u); the i-th handle ahead of a tail
is at G_(m - i)(u). A single u therefore determines all handles. F is smooth as long as both handles stay on their
segments. The span is therefore cut into parts wherever one of its images passes a joint, and each part has its own
series. This avoids special cases near a joint.

A tile holds the table for the leaders of blocks on one section of track. On tracks with many joints, the parts of the
span are divided into groups, and each group has a tile of its own, because a leader uses only one part at a time. Tiles
are aligned to the track and built on first use. Each tile depends only on the track, so positions are bit-identical
across runs and processes, regardless of the order in which tiles are built.
"""
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property
from math import acos, floor, inf
from threading import Lock
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from dragon_ros.core.numerics.chebyshev import columns_of, in_parts
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.shift_map.build import Span, Stretch, Table, build, span_of
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND

# The maximum number of multiplications per product: BLAS splits larger products among threads, which could change the
# last bits.
TERMS = 9000
_BOUNDARIES = 1024          # number of section boundaries whose positions are cached
_CELL_BYTES = 2048          # approximate size of a cell that is used for single states
_MOST_BYTES = 512_000_000   # memory limit for a shift map's tiles; the least recently used tiles are dropped first
_MOST_TILES = 4096          # maximum number of tiles of a shift map, including tiles without a table
_MOST_SPANS = 512           # maximum number of sections of track whose spans are cached
# The minimum length of a tile, in links; the length of a longer tile is the smallest power of two that is at least the
# length of its blocks.
_FEWEST_LINKS = 128
# The minimum length of a tile on a composite track, in links; a longer tile is at least half as long as its blocks.
_FEWEST_JOINED = 64
_NEAR = 1e-9                # relative distance from a boundary within which rounding could decide a position's side
_BEFORE_LINKS = 64          # number of links from the start of a tile to the track's origin, where runs begin

_Key = TypeVar('_Key', bound=Hashable)
_Value = TypeVar('_Value')


class Product(NamedTuple):
    """One product that fills in handles: its number of terms, series of positions and motions, and range."""

    terms: int
    places: Floats
    motions: Floats
    start: int
    stop: int


class Cell(NamedTuple):
    """One row of one part, stored as floats for fast evaluation of single states; ``products`` is keyed by links."""

    row: int
    part: int
    slack: float
    middle: float
    scale: float
    inverse: list[float]
    products: dict[int, list[Product]]


class Spot(NamedTuple):
    """The location of a handle in a tile: its cell, and the values (K,) of Chebyshev polynomials at its u."""

    tile: 'Tile'
    cell: Cell
    basis: Floats


class Spots(NamedTuple):
    """The locations of many handles in one tile: rows and parts (S,), and values (S, K) of Chebyshev polynomials."""

    tile: 'Tile'
    row: Ints
    part: Ints
    basis: Floats


class Elsewhere(Enum):
    """A sentinel for a position that is not on a section."""

    ELSEWHERE = auto()


_ELSEWHERE = Elsewhere.ELSEWHERE


class _SegmentCells(NamedTuple):
    """The cells on one segment, in order of ``sense`` times the coordinate, which increases towards the rear."""

    sense: float
    front: float        # the foremost position on the section
    rear: float
    begins: list[float]
    cells: list[int]


@dataclass(frozen=True, eq=False)
class Tile:
    """The table for the leaders of blocks in one group on one section of a track, between two positions."""

    track: Track
    table: Table
    span: Span
    group: int
    fore: Place | None      # None at an end of the track
    rear: Place | None

    @property
    def memory_bytes(self) -> int:
        """The size of the table and of the cells used so far, in bytes."""
        return self.table.memory_bytes + _CELL_BYTES * len(self._cells)

    @cached_property
    def rows(self) -> int:
        """The number of rows of the table."""
        return self.table.rows

    @cached_property
    def _orders(self) -> Floats:
        return np.arange(self.table.nodes, dtype=np.float64)

    @cached_property
    def sides(self) -> list[_SegmentCells | None]:
        """The cells by segment; they are numbered by row (from ``table.first`` on) and part, the foremost first."""
        table, out = self.table, list[_SegmentCells | None]()
        rows = slice(table.first, table.first + len(table.slack))
        segment, middle = table.segment[rows].ravel(), table.middle[rows].reshape(-1, 2)
        fore = middle[:, 0] - 1 / middle[:, 1]
        for k in range(len(self.track.segments)):
            cells = np.flatnonzero(segment == k)
            ahead, behind = self.fore and k > self.fore.segment, self.rear and k < self.rear.segment
            if not cells.size or ahead or behind:       # rows extend beyond the section
                out.append(None)
                continue
            sense = float(np.sign(middle[cells[0], 1]))
            low = sense * self.fore.u if self.fore and self.fore.segment == k else -inf
            high = sense * self.rear.u if self.rear and self.rear.segment == k else inf
            out.append(_SegmentCells(sense, low, high, (sense * fore[cells]).tolist(), cells.tolist()))
        return out

    @cached_property
    def _cells(self) -> dict[int, Cell]:
        return {}

    def _cell(self, number: int) -> Cell:
        """Return a cell, converted to floats."""
        table, (row, part) = self.table, divmod(number, self.table.parts)
        middle, scale = table.middle[table.first + row, part].tolist()
        cell = Cell(table.first + row, part, 1 + table.slack.item(row, part), middle, scale,
                    table.inverse[row, part].tolist(), {})
        self._cells[number] = cell
        return cell

    def spot(self, place: Place) -> Spot | Elsewhere | None:
        """Return the location of a position, None if the table does not cover it, ELSEWHERE if it is off the section.

        The section is half open: it includes its rear end but not its front end. If it has several groups, only the
        leaders in the group of the tile are on it.
        """
        side = self.sides[place[0]]
        if side is None:
            return _ELSEWHERE
        sense, front, rear, begins, cells = side
        along = sense * place[1]
        if not front < along <= rear:
            return _ELSEWHERE
        if self.span.lookup is not None:     # as ``Groups.of``, without a call
            _, fronts, groups = self.span.lookup.sides[place[0]]
            if groups[bisect_right(fronts, along)] != self.group:
                return _ELSEWHERE
        # A position before the first cell is in the first cell or in no cell.
        number = cells[bisect_right(begins, along, 1) - 1]
        cell = self._cells.get(number) or self._cell(number)
        _, _, slack, middle, scale, inverse, _ = cell
        x = (place[1] - middle) * scale
        if not -slack <= x <= slack:
            return None
        u = 0.0
        for coefficient in inverse:
            u = u * x + coefficient
        basis = self._orders * acos(u if -1.0 <= u <= 1.0 else 1.0 if u > 0 else -1.0)
        return Spot(self, cell, np.cos(basis, basis))

    def spots(self, places: Places) -> tuple[Spots, Array]:
        """Return the locations of many positions on the section, and whether the table covers each position."""
        (segment, u), table = places, self.table
        cell, known = np.zeros_like(segment), np.zeros(segment.shape, dtype=bool)
        for k in self.track.present(segment):
            side, on = self.sides[k], segment == k
            if side:
                at = np.searchsorted(side.begins, side.sense * u[on], side='right') - 1
                cell[on] = np.array(side.cells)[np.maximum(0, at)]
                known[on] = True
        row, part = np.divmod(cell, table.parts)
        middle, slack, inverse = table.middle[table.first + row, part], table.slack[row, part], table.inverse[row, part]
        x = (u - middle[:, 0]) * middle[:, 1]
        known &= np.abs(x) <= 1 + slack
        value = np.zeros_like(x)
        for coefficient in inverse.T:
            value = value * x + coefficient
        basis = np.cos(np.arccos(np.clip(np.where(known, value, 0.0), -1.0, 1.0))[:, None] * self._orders)
        return Spots(self, table.first + row, part, basis), known

    def place_at(self, spot: Spot, row: int) -> Place:
        """Return the position of the handle in another row."""
        part = spot.cell.part
        middle, scale = self.table.middle[row, part].tolist()
        x = float(spot.basis @ self.table.coordinates[part, :, row])
        return Place(int(self.table.segment[row, part]), middle + x / scale)

    def places_at(self, spots: Spots, row: Ints) -> Places:
        """Return the positions of many handles in other rows."""
        middle = self.table.middle[row, spots.part]
        x = np.einsum('sk,sk->s', spots.basis, self.table.coordinates[spots.part, :, row])
        return self.table.segment[row, spots.part], middle[:, 0] + x / middle[:, 1]

    def products(self, cell: Cell, links: int, direction: int) -> list[Product]:
        """Return the products for ``links`` links beyond a cell, head to tail, each small enough for one thread."""
        table, size = self.table, 2 * links + 2
        first = cell.row if direction == BEHIND else cell.row - links
        terms = int(table.terms[cell.part, first])
        places, motions = (series[cell.part, :terms, 2 * first:2 * first + size]
                           for series in (table.places, table.motions))
        width = TERMS // terms // 2 * 2
        return [Product(terms, places[:, low:stop], motions[:, low:stop], low, stop)
                for low in range(0, size, width) for stop in [min(low + width, size)]]

    def fill_many(self, spots: Spots, first: Ints, out: Floats, motions: bool = False) -> None:
        """Fill ``out`` (S, n, 2) with positions or motions; states in the same row and part share a product."""
        flat, table, basis = out.reshape(out.shape[0], 2 * out.shape[1]), self.table, spots.basis
        series, width = table.motions if motions else table.places, flat.shape[1]
        for low, end, row, part in self._runs(spots, first):
            terms = table.terms.item(part, row)
            of_cell = series[part, :terms, 2 * row:2 * row + width]
            batch = columns_of(of_cell.size)
            for at in range(low, end, batch):
                stop = min(at + batch, end)
                np.matmul(basis[at:stop, :terms], of_cell, flat[at:stop])

    def _runs(self, spots: Spots, first: Ints) -> list[tuple[int, int, int, int]]:
        """Return the runs (begin, end, row, part) of consecutive states whose handles begin in the same cell."""
        cell = first * self.table.parts + spots.part
        begins = np.concatenate(([0], np.flatnonzero(np.diff(cell)) + 1)) if cell.size else np.empty(0, dtype=np.int64)
        return [*zip(begins.tolist(), [*begins[1:].tolist(), cell.size], first[begins].tolist(),
                     spots.part[begins].tolist(), strict=False)]

    def places_many(self, spots: Spots, first: Ints, count: int) -> Places:
        """Return the positions (S, count) of handles in ``count`` rows from ``first`` (S,) on."""
        table, shape = self.table, (first.size, count)
        segment, u = np.empty(shape, dtype=np.int64), np.empty(shape)
        for low, end, row, part in self._runs(spots, first):
            rows = slice(row, row + count)
            middle, scale = table.middle[rows, part].T
            x = in_parts(spots.basis[low:end], table.coordinates[part, :, rows])
            segment[low:end] = table.segment[rows, part]
            u[low:end] = middle + x / scale
        return segment, u

    def paces(self, spots: Spots) -> Floats:
        """Return the speeds of many handles for unit speed in row 0."""
        x, y = (np.einsum('sk,sk->s', spots.basis, self.table.motions[spots.part, :, 2 * spots.row + n])
                for n in (0, 1))
        out: Floats = np.hypot(x, y)
        return out


class BuildCache(Generic[_Key, _Value]):
    """Values by key, built on first use; the least recently used values are dropped while there are too many.

    Threads that need a value wait while another thread builds one, so that nothing is built twice.
    """

    def __init__(self, are_too_many: Callable[[list[_Value]], bool]) -> None:
        """Store the function that decides whether there are too many values."""
        self._are_too_many = are_too_many
        self._values: OrderedDict[_Key, _Value] = OrderedDict()
        self._building = Lock()

    def get(self, key: _Key, build: Callable[[_Key], _Value]) -> _Value:
        """Return a value, built on first use; the latest value is never dropped.

        The cache does not store ``build``, which is usually a method of its owner: both would wait for the garbage
        collector.
        """
        try:
            self._values.move_to_end(key)
            return self._values[key]
        except KeyError:        # not yet built, or dropped
            pass
        with self._building:
            if key in self._values:
                return self._values[key]
            value = self._values[key] = build(key)
            while len(self._values) > 1 and self._are_too_many(self.values):
                self._values.popitem(last=False)
            return value

    @property
    def values(self) -> list[_Value]:
        """The values, the least recently used first."""
        return list(self._values.values())


def _memory_bytes(tiles: list[Tile | None]) -> int:
    """Return the size of the arrays of all tiles, in bytes."""
    return sum(tile.memory_bytes for tile in tiles if tile)


def _are_too_many(tiles: list[Tile | None]) -> bool:
    return len(tiles) > _MOST_TILES or _memory_bytes(tiles) > _MOST_BYTES


def links_of_tile(links: int, segments: int = 1) -> int:
    """Return a tile's length in links for blocks of up to ``links`` links on a track of ``segments`` segments."""
    whole: int = 1 << (links - 1).bit_length()
    return max(_FEWEST_LINKS, whole) if segments == 1 else max(_FEWEST_JOINED, whole // 2)


class ShiftMap:
    """The map from a handle to its followers, for blocks of up to ``links`` links of one length on a track."""

    def __init__(self, track: Track, link_m: float, links: int, direction: int) -> None:
        """Lay out the tiles without building any."""
        self.track, self.link_m, self.links, self.direction = track, link_m, links, direction
        self.section_m, self._before_m = links_of_tile(links, len(track.segments)) * link_m, _BEFORE_LINKS * link_m
        self._spans = BuildCache[int, Span | None](lambda spans: len(spans) > _MOST_SPANS)      # by section
        self._tiles = BuildCache[tuple[int, int], Tile | None](_are_too_many)       # by section and group
        self._last: Tile | None = None
        self._edges: dict[int, Place | None] = {}

    @property
    def tiles(self) -> list[Tile]:
        """The tiles built so far."""
        return [tile for tile in self._tiles.values if tile]

    @property
    def memory_bytes(self) -> int:
        """The size of the arrays of all tiles, in bytes."""
        return _memory_bytes(self._tiles.values)

    def spot(self, place: Place) -> Spot | None:
        """Return the location of a position, or None if no table covers it."""
        last = self._last       # another thread may replace ``_last``
        found = last.spot(place) if last is not None else _ELSEWHERE
        if found is _ELSEWHERE:
            section = self._number(place)
            span = self._span(section)
            tile = self._tile(section, span.lookup.of(place) if span and span.lookup else 0)
            if tile is None:
                return None
            self._last = tile
            found = tile.spot(place)
        return None if found is _ELSEWHERE else found       # if not found, the segment is too short for a part

    def build_all(self, place: Place) -> None:
        """Build the tables of all groups for leaders on the section of a leader."""
        number = self._number(place)
        span = self._span(number)
        for group in range(len(span.groups) if span else 0):
            self._tile(number, group)

    def spots(self, places: Places) -> list[tuple[Ints, Spots]] | None:
        """Return the indices and the locations of many positions, by tile, or None if any is not in a table."""
        segment, u = places
        numbers = self._numbers(places)
        sections = sorted(set(numbers.tolist()))       # np.unique would import masked arrays
        each = [(np.flatnonzero(numbers == one) if len(sections) > 1 else np.arange(segment.size), one)
                for one in sections]
        out = []
        for of_section, one in each:
            for rows, group in self._by_group(one, of_section, places):
                tile = self._tile(one, group)
                if tile is None:
                    return None
                spots, known = tile.spots((segment[rows], u[rows]))
                if not np.all(known):
                    return None
                out.append((rows, spots))
        return out

    def _by_group(self, number: int, rows: Ints, places: Places) -> list[tuple[Ints, int]]:
        """Return the rows of positions in a section, by the group that covers them."""
        span = self._span(number)
        if span is None or span.lookup is None:
            return [(rows, 0)]
        group = span.lookup.of_many((places[0][rows], places[1][rows]))
        return [(rows[group == one], one) for one in sorted(set(group.tolist()))]

    def _numbers(self, places: Places) -> Ints:
        """Return the indices of the sections of many positions."""
        share = (self.track.distances(*places) + self._before_m) / self.section_m
        number: Ints = np.floor(share).astype(np.int64)
        for n in np.flatnonzero(np.abs(share - np.rint(share)) <= _NEAR * (1 + np.abs(share))).tolist():
            number[n] = self._number(Place.of(*(values[n] for values in places)))
        return number

    def _number(self, place: Place) -> int:
        """Return the index of the section that contains a position."""
        number = floor((self.track.distance_of(place) + self._before_m) / self.section_m)
        while self._is_behind(place, number):
            number -= 1
        while not self._is_behind(place, number + 1):
            number += 1
        return number

    def _is_behind(self, place: Place, number: int) -> bool:
        """Return whether a position is behind the start of a section."""
        begin = self._boundary(number)
        if begin is None:
            return self._section(number)[0] >= self.track.end_m
        if place.segment != begin.segment:
            return place.segment < begin.segment
        return bool((place.u - begin.u) * self.track.segments[place.segment].rate(place.u) < 0)

    def _boundary(self, number: int) -> Place | None:
        """Return the cached position at which a section begins, or None if it is beyond the track."""
        if number not in self._edges:
            if len(self._edges) >= _BOUNDARIES:
                self._edges.clear()
            metres = self._section(number)[0]
            on_track = self.track.begin_m < metres < self.track.end_m
            self._edges[number] = self.track.place_at(metres) if on_track else None
        return self._edges[number]

    def _section(self, number: int) -> tuple[float, float]:
        """Return the distances of both ends of a section along the track, in metres."""
        return number * self.section_m - self._before_m, (number + 1) * self.section_m - self._before_m

    def _span(self, number: int) -> Span | None:
        """Return the span of a section of track, computed on first use, or None if it has no tables."""
        return self._spans.get(number, self._cut)

    def _cut(self, number: int) -> Span | None:
        return span_of(self.track, self.link_m, Stretch(*self._section(number), self.links, self.direction))

    def _tile(self, number: int, group: int) -> Tile | None:
        """Return the tile of a group of a section, built on first use, or None if it has no table."""
        return self._tiles.get((number, group), self._built)

    def _built(self, key: tuple[int, int]) -> Tile | None:
        number, group = key
        span = self._span(number)
        table = build(span, group) if span else None
        if span is None or table is None:
            return None
        return Tile(self.track, table, span, group, self._boundary(number + 1), self._boundary(number))
