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
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property, partial
from math import acos, floor, inf
from typing import NamedTuple

import numpy as np

from dragon_ros.core.numerics.chebyshev import columns_of, in_parts
from dragon_ros.core.numerics.double_double import DoubleDouble, plus
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.shift_map.build import Span, Stretch, Table, build, span_of
from dragon_ros.core.shift_map.cache import BuildCache
from dragon_ros.core.shift_map.lead_in import Chart, LeadIn, chart_of, lead_in, towards_leader
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND

# The maximum number of multiplications per product: BLAS splits larger products among threads, which could change the
# last bits.
TERMS = 9000
_BOUNDARIES = 1024          # number of stretch boundaries whose positions are cached
# The maximum number of cells that a shift map caches for single states, at most 144 kB each; the oldest cells are
# dropped first.
_MOST_CELLS = 64
_MOST_BYTES = 512_000_000   # memory limit for a shift map's tiles; the least recently used tiles are dropped first
_MOST_TILES = 4096          # maximum number of tiles of a shift map, including tiles without a table
_MOST_LAYOUTS = 512         # maximum number of sections of track whose spans are cached
# The minimum length of a tile, in links; the length of a longer tile is the smallest power of two that is at least the
# length of its blocks.
_FEWEST_LINKS = 512
# The minimum length of a tile on a composite track, in links; a longer tile is at least half as long as its blocks.
_FEWEST_JOINED = 64
# The length of a tile's stretches, in links; the series for the leader's link are built when the leader reaches a
# stretch.
_STRETCH_LINKS = 64
_STRETCH_JOINED = 32        # number of links per stretch on a composite track
_SHORTEST = 1e-12           # shortest link, relative to coordinates, whose direction floats can resolve
_NEAR = 1e-9                # relative distance from a boundary within which rounding could decide a position's side
_BEFORE_LINKS = 64          # number of links from the start of a tile to the track's origin, where runs begin


class Product(NamedTuple):
    """One product that fills in handles: its function, number of terms, series of positions and motions, and range."""

    times: Callable[[Floats, Floats, Floats], Floats]
    terms: int
    places: Floats
    motions: Floats
    start: int
    stop: int


class Cell(NamedTuple):
    """One row of one part, stored as floats for fast evaluation of single states; ``products`` is keyed by link count.

    ``before`` holds the series (K, 2) of the leader's position and of its motion if the leader is one link before this
    row.
    """

    row: int
    part: int
    slack: float
    middle: float
    middle_lo: float
    scale: float
    inverse: list[float]
    before: tuple[Floats, Floats] | None
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
    """A sentinel for a position that is not on a stretch."""

    ELSEWHERE = auto()


_ELSEWHERE = Elsewhere.ELSEWHERE


class _SegmentCells(NamedTuple):
    """The cells on one segment, in order of ``sense`` times the coordinate, which increases towards the rear."""

    sense: float
    front: float        # the foremost position on the stretch
    rear: float
    begins: list[float]
    cells: list[int]


class Groups:
    """A lookup of the group of parts that covers a position, by the positions at which groups begin, from the front."""

    def __init__(self, track: Track, begins: list[tuple[Place, int]], count: int) -> None:
        """Arrange the positions by segment; each comes with the number of its group, from 0 to ``count`` - 1."""
        self._track = track
        # For each segment, a sign, and the beginnings of groups in order of this sign times the coordinate, which
        # increases towards the rear; the first of the groups has no beginning on the segment.
        self.sides = dict[int, tuple[float, list[float], list[int]]]()
        before = (begins[0][1] - 1) % count
        for k in reversed(range(len(track.segments))):
            on = [(place.u.hi, group) for place, group in begins if place.segment == k]
            sense = -1.0 if track.segments[k].rate(track.segments[k].last) > 0 else 1.0
            self.sides[k] = sense, [sense * u for u, _ in on], [before, *(group for _, group in on)]
            before = self.sides[k][2][-1]

    def of(self, place: Place) -> int:
        """Return the group that covers a position."""
        sense, begins, groups = self.sides[place[0]]
        return groups[bisect_right(begins, sense * place[1][0])]

    def of_many(self, places: Places) -> Ints:
        """Return the groups that cover many positions."""
        (segment, u, _), out = places, np.empty_like(places[0])
        for k in self._track.present(segment):
            (sense, begins, groups), on = self.sides[k], segment == k
            out[on] = np.array(groups)[np.searchsorted(begins, sense * u[on], side='right')]
        return out


class Layout:
    """The span of a section of track, and the group of its parts that covers each leader on this section."""

    def __init__(self, span: Span, direction: int) -> None:
        """Store a span; positions are computed on first use."""
        self.span, self.direction = span, direction
        self._groups = dict[float, Groups | None]()

    def groups(self, link_m: float = 0.0) -> Groups | None:
        """Return the groups of leaders one link before a block (of the block's own leaders, if ``link_m`` is 0).

        The result is None if there is a single group, or if there are no such leaders.
        """
        if link_m not in self._groups:
            self._groups[link_m] = self._groups_of(link_m) if len(self.span.groups) > 1 else None
        return self._groups[link_m]

    def _groups_of(self, link_m: float) -> Groups | None:
        track, begins = self.span.track, self.span.begins()
        if link_m:
            leaders = ((towards_leader(track, place, link_m, self.direction), group) for place, group in begins)
            begins = [(leader, group) for leader, group in leaders if leader]
        return Groups(track, begins, len(self.span.groups)) if begins else None


@dataclass(frozen=True, eq=False)
class Entrance:
    """A lookup of a tile's cells by the coordinates of leaders on a stretch between two positions.

    Leaders of blocks are in rows of the table. Leaders one link before a block are not in any row; ``lead_in`` holds
    their series. ``chart`` holds the charts of the cells. If there are several ``groups``, only the leaders in the
    group of the tile are on the stretch.
    """

    tile: 'Tile'
    chart: Chart
    fore: Place
    rear: Place
    groups: Groups | None
    lead_in: LeadIn | None = None

    @cached_property
    def _orders(self) -> Floats:
        return np.arange(self.lead_in.nodes if self.lead_in else self.tile.table.nodes, dtype=np.float64)

    @cached_property
    def sides(self) -> list[_SegmentCells | None]:
        """The cells by segment."""
        (_, _, segment, middle, _, _), out = self.chart, list[_SegmentCells | None]()
        fore = middle[:, 0] - 1 / middle[:, 2]
        for k in range(len(self.tile.track.segments)):
            cells = np.flatnonzero(segment == k)
            if not (cells.size and self.rear.segment <= k <= self.fore.segment):     # rows extend beyond the stretch
                out.append(None)
                continue
            sense = float(np.sign(middle[cells[0], 2]))
            low = sense * self.fore.u.hi if self.fore.segment == k else -inf
            high = sense * self.rear.u.hi if self.rear.segment == k else inf
            out.append(_SegmentCells(sense, low, high, (sense * fore[cells]).tolist(), cells.tolist()))
        return out

    @cached_property
    def _cells(self) -> dict[int, Cell]:
        return {}

    def _cell(self, number: int) -> Cell:
        """Return the cell of a chart, converted to floats."""
        first, cell_of, _, middle, slack, inverse = self.chart
        row, part = divmod(cell_of.item(number), self.tile.table.parts)
        before = self.lead_in.leader(number) if self.lead_in else None
        high, low, scale = middle[number].tolist()
        powers = inverse[number].tolist()
        cell = Cell(first + row, part, 1 + float(slack[number]), high, low, scale, powers, before, {})
        kept = self.tile.kept
        if len(kept) >= _MOST_CELLS:
            entrance, oldest = kept.popleft()
            entrance._cells.pop(oldest, None)
        kept.append((self, number))
        self._cells[number] = cell
        return cell

    def spot(self, place: Place) -> Spot | Elsewhere | None:
        """Return the location of a position, None if the table does not cover it, ELSEWHERE if it is off the stretch.

        The stretch is half open: it includes its rear end but not its front end.
        """
        side = self.sides[place[0]]
        if side is None:
            return _ELSEWHERE
        high, low = place[1]
        sense, front, rear, begins, cells = side
        along = sense * high
        if not front < along <= rear:
            return _ELSEWHERE
        if self.groups is not None:     # as ``Groups.of``, without a call
            _, fronts, groups = self.groups.sides[place[0]]
            if groups[bisect_right(fronts, along)] != self.tile.group:
                return _ELSEWHERE
        # A position before the first cell is in the first cell or in no cell.
        number = cells[bisect_right(begins, along, 1) - 1]
        cell = self._cells.get(number) or self._cell(number)
        _, _, slack, middle, middle_lo, scale, inverse, _, _ = cell
        x = ((high - middle) + (low - middle_lo)) * scale
        if not -slack <= x <= slack:
            return None
        u = 0.0
        for coefficient in inverse:
            u = u * x + coefficient
        basis = self._orders * acos(u if -1.0 <= u <= 1.0 else 1.0 if u > 0 else -1.0)
        return Spot(self.tile, cell, np.cos(basis, basis))


@dataclass(frozen=True, eq=False)
class Tile:
    """The table for the leaders of blocks in one group on one section of a track, between two positions."""

    track: Track
    table: Table
    layout: Layout
    group: int
    fore: Place
    rear: Place
    entrances: dict[tuple[float, int], Entrance | None]     # for leaders one link before a block, by link and stretch
    kept: deque[tuple[Entrance, int]]       # all cells that the shift map caches for single states

    @property
    def memory_bytes(self) -> int:
        """The size of all arrays in bytes."""
        return self.table.memory_bytes + sum(one.lead_in.memory_bytes for one in list(self.entrances.values())
                                             if one and one.lead_in)

    @cached_property
    def rows(self) -> int:
        """The number of rows of the table."""
        return self.table.rows

    @cached_property
    def _orders(self) -> Floats:
        return np.arange(self.table.nodes, dtype=np.float64)

    @cached_property
    def entrance(self) -> Entrance:
        """The entrance for the leaders of blocks."""
        return Entrance(self, chart_of(self.table), self.fore, self.rear, self.layout.groups())

    def spots(self, places: Places) -> tuple[Spots, Array]:
        """Return the locations of many positions on the stretch, and whether the table covers each position."""
        (segment, u, lo), table = places, self.table
        cell, known = np.zeros_like(segment), np.zeros(segment.shape, dtype=bool)
        for k in self.track.present(segment):
            side, on = self.entrance.sides[k], segment == k
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
        """Return the position of the handle in another row."""
        part = spot.cell.part
        middle, middle_lo, scale = self.table.middle[row, part].tolist()
        x = float(spot.basis[:self.table.nodes] @ self.table.coordinates[part, :, row])
        return Place(int(self.table.segment[row, part]), DoubleDouble(*plus(middle, middle_lo, x / scale)))

    def places_at(self, spots: Spots, row: Ints) -> Places:
        """Return the positions of many handles in other rows."""
        middle = self.table.middle[row, spots.part]
        x = np.einsum('sk,sk->s', spots.basis, self.table.coordinates[spots.part, :, row])
        return self.table.segment[row, spots.part], *plus(middle[:, 0], middle[:, 1], x / middle[:, 2])

    def products(self, cell: Cell, links: int, direction: int) -> list[Product]:
        """Return the products for ``links`` links from head to tail: the links beyond a cell, and any link before it.

        A single product uses ``dot`` on a contiguous copy of its series, which is fastest; several products use views.
        """
        table, before, size = self.table, cell.before, 2 * links + 2
        behind = links - 1 if before else links
        first, columns = cell.row if direction == BEHIND else cell.row - behind, 2 * behind + 2
        terms = int(table.terms[cell.part, first])
        of_leader = len(before[0]) if before else 0     # number of terms, the same for both series
        places, motions = (series[cell.part, :terms, 2 * first:2 * first + columns]
                           for series in (table.places, table.motions))
        if max(terms, of_leader) * size <= TERMS:
            if before:
                places, motions = (_joined(*pair, direction) for pair in zip(before, (places, motions), strict=True))
            return [Product(np.dot, len(places), np.ascontiguousarray(places), np.ascontiguousarray(motions), 0, size)]
        width, at = TERMS // terms // 2 * 2, 2 if before and direction == BEHIND else 0
        out = [Product(np.matmul, terms, places[:, low:stop], motions[:, low:stop], at + low, at + stop)
               for low in range(0, columns, width) for stop in [min(low + width, columns)]]
        if before:
            at = 0 if direction == BEHIND else size - 2
            out.append(Product(np.matmul, of_leader, *before, at, at + 2))
        return out

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
        segment, u, lo = np.empty(shape, dtype=np.int64), np.empty(shape), np.empty(shape)
        for low, end, row, part in self._runs(spots, first):
            rows = slice(row, row + count)
            middle, middle_lo, scale = table.middle[rows, part].T
            x = in_parts(spots.basis[low:end], table.coordinates[part, :, rows])
            segment[low:end] = table.segment[rows, part]
            u[low:end], lo[low:end] = plus(middle, middle_lo, x / scale)
        return segment, u, lo

    def paces(self, spots: Spots) -> Floats:
        """Return the speeds of many handles for unit speed in row 0."""
        x, y = (np.einsum('sk,sk->s', spots.basis, self.table.motions[spots.part, :, 2 * spots.row + n])
                for n in (0, 1))
        out: Floats = np.hypot(x, y)
        return out


def _joined(leader: Floats, block: Floats, direction: int) -> Floats:
    """Join the series of a leader and of a block's handles, from head to tail; shorter series end in zeros."""
    out = np.zeros((max(len(leader), len(block)), block.shape[1] + 2))
    head = direction == BEHIND
    out[:len(leader), :2 if head else None][:, None if head else -2:] = leader
    out[:len(block), 2 if head else 0:None if head else -2] = block
    return out


def _memory_bytes(tiles: list[Tile | None]) -> int:
    """Return the size of the arrays of all tiles, in bytes."""
    return sum(tile.memory_bytes for tile in tiles if tile)


def _are_too_many(tiles: list[Tile | None]) -> bool:
    return len(tiles) > _MOST_TILES or _memory_bytes(tiles) > _MOST_BYTES


def _forget(kept: deque[tuple[Entrance, int]], gone: Tile | None) -> None:
    """Forget the cells of a tile that is dropped, because they would keep it in memory."""
    stay = [one for one in kept if one[0].tile is not gone]
    kept.clear()
    kept.extend(stay)


def links_of_tile(links: int, segments: int = 1) -> int:
    """Return a tile's length in links for blocks of up to ``links`` links on a track of ``segments`` segments."""
    whole: int = 1 << (links - 1).bit_length()
    return max(_FEWEST_LINKS, whole) if segments == 1 else max(_FEWEST_JOINED, whole // 2)


class ShiftMap:
    """The map from a handle to its followers, for blocks of up to ``links`` links of one length on a track."""

    def __init__(self, track: Track, link_m: float, links: int, direction: int) -> None:
        """Lay out the tiles without building any."""
        self.track, self.link_m, self.links, self.direction = track, link_m, links, direction
        stretch = _STRETCH_LINKS if len(track.segments) == 1 else _STRETCH_JOINED
        self._stretches = links_of_tile(links, len(track.segments)) // stretch    # number per tile
        self.stretch_m, self._before_m = stretch * link_m, _BEFORE_LINKS * link_m
        self._kept: deque[tuple[Entrance, int]] = deque()
        self._layouts = BuildCache[int, Layout | None](lambda layouts: len(layouts) > _MOST_LAYOUTS)    # by section
        self._tiles = BuildCache[tuple[int, int], Tile | None](     # by section and group
            _are_too_many, partial(_forget, self._kept))
        self._last: Entrance | None = None
        self._last_before: Entrance | None = None
        self._edges: dict[tuple[int, float], Place | None] = {}

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
            tile = self._tile_of(self._number(place), place)
            if tile is None:
                return None
            self._last = entrance = tile.entrance
            found = entrance.spot(place)
        return None if found is _ELSEWHERE else found       # if not found, the segment is too short for a part

    def spot_behind(self, leader: Place, link_m: float) -> Spot | None:
        """Return the location of a leader's follower across a link of other length, or None if no series covers it."""
        last = self._last_before
        found = last.spot(leader) if last is not None else _ELSEWHERE
        if found is _ELSEWHERE:
            number = self._number(leader, link_m)
            tile = self._tile_of(number, leader, link_m)
            entrance = self._entrance_before(tile, number, link_m) if tile else None
            if entrance is None:
                return None
            self._last_before = entrance
            found = entrance.spot(leader)
        return None if found is _ELSEWHERE else found       # if not found, no series converges on the segment

    def _entrance_before(self, tile: Tile, number: int, link_m: float) -> Entrance | None:
        """Return the entrance for leaders one link before blocks on a stretch, or None if there are no such leaders."""
        if (link_m, number) not in tile.entrances:
            found = lead_in(self.track, tile.table, (link_m, self.link_m), self.direction, self._stretch_of(number, 1))
            tile.entrances[link_m, number] = None if found is None else Entrance(
                tile, found.chart, self._leader_at(number + 1, link_m) or self._end(1),
                self._leader_at(number, link_m) or self._end(-1), tile.layout.groups(link_m), found)
        return tile.entrances[link_m, number]

    def build_all(self, leader: Place, link_m: float = 0.0) -> None:
        """Build the tables of all groups for leaders on the stretch of a leader, with the series for its link."""
        number = self._number(leader, link_m)
        layout = self._layout(number // self._stretches)
        for group in range(len(layout.span.groups) if layout else 0):
            tile = self._tile(number // self._stretches, group)
            if tile and link_m:
                self._entrance_before(tile, number, link_m)

    def spots(self, places: Places) -> list[tuple[Ints, Spots]] | None:
        """Return the indices and the locations of many positions, by tile, or None if any is not in a table."""
        segment, u, lo = places
        numbers = self._numbers(places)
        if numbers is None:
            return None
        numbers //= self._stretches
        sections = sorted(set(numbers.tolist()))       # np.unique would import masked arrays
        each = [(np.flatnonzero(numbers == one) if len(sections) > 1 else np.arange(segment.size), one)
                for one in sections]
        out = []
        for of_section, one in each:
            for rows, group in self._by_group(one, of_section, places):
                tile = self._tile(one, group)
                if tile is None:
                    return None
                spots, known = tile.spots((segment[rows], u[rows], lo[rows]))
                if not np.all(known):
                    return None
                out.append((rows, spots))
        return out

    def _by_group(self, number: int, rows: Ints, places: Places) -> list[tuple[Ints, int]]:
        """Return the rows of positions in a section, by the group that covers them."""
        layout = self._layout(number)
        groups = layout.groups() if layout else None
        if groups is None:
            return [(rows, 0)]
        group = groups.of_many((places[0][rows], places[1][rows], places[2][rows]))
        return [(rows[group == one], one) for one in sorted(set(group.tolist()))]

    def _numbers(self, places: Places) -> Ints | None:
        """Return the indices of the stretches of many positions, or None if floats cannot resolve links there."""
        share = (self.track.distances(*places[:2]) + self._before_m) / self.stretch_m
        if np.max(np.abs(share), initial=0.0) > 1 / _SHORTEST:
            return None
        number: Ints = np.floor(share).astype(np.int64)
        for n in np.flatnonzero(np.abs(share - np.rint(share)) <= _NEAR * (1 + np.abs(share))).tolist():
            number[n] = self._number(Place.of(*(values[n] for values in places)))
        return number

    def _number(self, place: Place, link_m: float = 0.0) -> int:
        """Return the index of the stretch that contains a position, or its follower across a link."""
        along_m = self.track.about_m(place) + self.direction * link_m
        number = floor((along_m + self._before_m) / self.stretch_m)
        while self._is_behind(place, number, link_m):
            number -= 1
        while not self._is_behind(place, number + 1, link_m):
            number += 1
        return number

    def _is_behind(self, place: Place, number: int, link_m: float) -> bool:
        """Return whether a position, or its follower across a link, is behind the start of a stretch."""
        begin = self._boundary(number)
        if begin is None:
            return self._stretch_of(number, 1)[0] >= self.track.end_m
        if link_m:
            begin = self._leader_at(number, link_m)
            if begin is None:
                return self.direction == BEHIND
        if place.segment != begin.segment:
            return place.segment < begin.segment
        return bool((place.u.hi - begin.u.hi) * self.track.segments[place.segment].rate(place.u.hi) < 0)

    def _leader_at(self, number: int, link_m: float) -> Place | None:
        """Return the cached position of the leader whose follower is at the start of a stretch, or None.

        Without a link, the leader is itself at the start of the stretch.
        """
        key = number, link_m
        try:
            return self._edges[key]
        except KeyError:
            pass
        begin = self._boundary(number) if link_m else self._begin(number)
        place = towards_leader(self.track, begin, link_m, self.direction) if begin and link_m else begin
        if len(self._edges) >= _BOUNDARIES:
            self._edges.clear()
        self._edges[key] = place
        return place

    def _boundary(self, number: int) -> Place | None:
        """Return the position at which a stretch begins, or None if it is beyond the track."""
        return self._leader_at(number, 0.0)

    def _begin(self, number: int) -> Place | None:
        metres = self._stretch_of(number, 1)[0]
        return self.track.place_at(metres) if self.track.begin_m < metres < self.track.end_m else None

    def _stretch_of(self, number: int, stretches: int) -> tuple[float, float]:
        """Return the distances of both ends of consecutive stretches along the track, in metres."""
        return number * self.stretch_m - self._before_m, (number + stretches) * self.stretch_m - self._before_m

    def _layout(self, number: int) -> Layout | None:
        """Return the layout of a section of track, computed on first use, or None if it has no tables."""
        return self._layouts.get(number, self._laid_out)

    def _laid_out(self, number: int) -> Layout | None:
        track, (low_m, high_m) = self.track, self._stretch_of(number * self._stretches, self._stretches)
        far_m = track.far_m(max(low_m, track.begin_m), min(high_m, track.end_m))
        if self.link_m <= _SHORTEST * far_m:
            return None
        span = span_of(track, self.link_m, Stretch(low_m, high_m, self.links, self.direction))
        return Layout(span, self.direction) if span else None

    def _tile_of(self, number: int, place: Place, link_m: float = 0.0) -> Tile | None:
        """Return the tile for a leader on a stretch, one link before a block if ``link_m`` is given."""
        section = number // self._stretches
        layout = self._layout(section)
        groups = layout.groups(link_m) if layout else None
        return self._tile(section, groups.of(place) if groups else 0)

    def _tile(self, number: int, group: int) -> Tile | None:
        """Return the tile of a group of a section, built on first use, or None if it has no table."""
        return self._tiles.get((number, group), self._built)

    def _built(self, key: tuple[int, int]) -> Tile | None:
        number, group = key
        layout = self._layout(number)
        table = build(layout.span, group) if layout else None
        if layout is None or table is None:
            return None
        first = number * self._stretches
        fore = self._boundary(first + self._stretches) or self._end(1)
        rear = self._boundary(first) or self._end(-1)
        return Tile(self.track, table, layout, group, fore, rear, {}, self._kept)

    def _end(self, side: int) -> Place:
        """Return the end of the track ahead (``side`` 1) or behind; an open track ends infinitely far away."""
        last = len(self.track.segments) - 1
        segment = self.track.segments[last if side > 0 else 0]
        u = segment.last if side > 0 else segment.first
        sense = side if abs(u) == inf else 0
        return Place(last if side > 0 else 0, DoubleDouble(u if sense else u + self._beyond(segment, u, side), 0.0))

    @staticmethod
    def _beyond(segment: object, u: float, side: int) -> float:
        """Return a change of coordinate so large that no position at a closed end is excluded."""
        rate = segment.rate(u)      # type: ignore[attr-defined]
        return float(side * (1.0 if rate > 0 else -1.0) * (1 + abs(u)))
