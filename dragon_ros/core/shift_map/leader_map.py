"""The leader map: the positions of all handles as series in the position of the leader, whatever the links' lengths.

A shift map serves one block of equal links. A dragon of several blocks would need a lookup for each block, and the
links between blocks would be solved one by one. Also, a leader's link across a joint of an arc that is almost too tight
for this link has no series in the parameter of its block. As long as no handle passes a joint, however, the positions
of all handles are smooth functions of the leader's coordinate alone. The leader's range of travel is therefore cut into
cells wherever a handle passes a joint, and in each cell all handles and their velocities have Chebyshev series in the
leader's coordinate. No function has to be inverted, and one product yields the whole chain.

Unlike the rows of a shift map, these series are not shared by the handles. A leader map is therefore only used where no
shift map covers the whole chain, for chains of at most ``MOST_LINKS`` links, and on stretches with few cells. Cells are
built stretch by stretch, when the leader first reaches a stretch. Stretches are aligned to the track, so positions are
bit-identical across runs and processes.
"""
from bisect import bisect_right
from collections.abc import Callable
from functools import cached_property, partial
from math import acos, ceil, copysign, floor, hypot, inf, ulp
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.chain.forward import blocks_of, forward
from dragon_ros.core.chain.leader import head_in_front_m, tail_behind_m
from dragon_ros.core.errors import ChainLockError, TrackEndError
from dragon_ros.core.numerics.chebyshev import series_of
from dragon_ros.core.numerics.double_double import plus
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.shift_map.build import (
    NODES,
    NOISE,
    TRUNCATION,
    SpanPart,
    equal_parts,
    on_one_segment,
    part_between,
)
from dragon_ros.core.shift_map.cache import BuildCache
from dragon_ros.core.shift_map.table import TERMS, Product
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND

MOST_LINKS = 512            # maximum number of links of a chain; the series of longer chains would take too much memory
_STRETCH_LINKS = 2          # length of a stretch, in units of the longest link
_MOST_CELLS = 64            # maximum number of cells of a stretch; with more, building them would take too long
_MOST_BYTES = 256_000_000   # memory limit for all stretches; the least recently used ones are dropped first
_MOST_STRETCHES = 4096      # maximum number of stretches, including stretches without cells
_ROUNDS = 6                 # maximum number of times that a part is cut into thirds
_LONGEST = 1.0              # length of the longest cell, relative to the longest link; few longer series converge
_SHORTEST = 1e-6            # length of the shortest cell, relative to the longest link
_COARSEST = 1e-6            # largest spacing of floats for distances along the track, relative to a stretch


class LeaderCell(NamedTuple):
    """All handles of a chain as functions of the leader's coordinate, in one cell.

    ``middle`` and ``middle_lo`` hold the coordinate in the middle of the cell, and x = (coordinate - middle) * scale
    lies in [-1, 1]. Rounding may make |x| exceed 1 by up to ``slack``. The ``products`` yield the positions of the
    handles, and their velocities for unit speed of the leader. The coordinates of the handles, in order from the
    leader, are ``origin`` (2, N+1), as (hi, lo), plus the series ``coordinates`` (K, N+1).
    """

    middle: float
    middle_lo: float
    scale: float
    slack: float
    orders: Floats
    products: list[Product]
    segment: Ints
    origin: Floats
    coordinates: Floats

    @property
    def memory_bytes(self) -> int:
        """The size of all arrays in bytes."""
        return sum(values.nbytes for values in (self.orders, self.segment, self.origin, self.coordinates)) + sum(
            one.places.nbytes + one.motions.nbytes for one in self.products)


class MappedLinks(NamedTuple):
    """All links of a chain at one instant, computed from a cell; ``basis`` (K,) holds Chebyshev polynomials at x."""

    cell: LeaderCell
    basis: Floats
    links: int
    start: int = 0
    solver: str = 'table'

    @property
    def products(self) -> list[Product]:
        """The products that fill in the handles."""
        return self.cell.products

    def fill(self, flat: Floats) -> None:
        """Write the coordinates into ``flat``."""
        for times, _, places, _, start, stop in self.cell.products:
            times(self.basis, places, flat[start:stop])

    def _fill_motions(self, flat: Floats) -> None:
        """Write the velocities for unit speed of the leader into ``flat``."""
        for times, _, _, motions, start, stop in self.cell.products:
            times(self.basis, motions, flat[start:stop])

    def velocities(self, chain: Chain, speed: Any, out: Floats) -> Any:
        """Fill in velocities."""
        self._fill_motions(out)
        near = 0 if chain.direction == BEHIND else 2 * self.links
        out *= speed / hypot(out.item(near), out.item(near + 1))
        return speed

    def headings(self, chain: Chain, out: Floats) -> None:
        """Fill in unit tangents."""
        self._fill_motions(out)
        some = out.reshape(-1, 2)
        some /= np.hypot(some[:, 0], some[:, 1])[:, None]

    def places(self) -> Places:
        """Return the positions."""
        cell = self.cell
        return cell.segment, *plus(cell.origin[0], cell.origin[1], self.basis @ cell.coordinates)


class _SegmentCells(NamedTuple):
    """The cells on one segment, in order of ``sense`` times the coordinate, which increases towards the rear."""

    sense: float
    begins: list[float]
    cells: list[LeaderCell]


class _Stretch(NamedTuple):
    """The cells of one stretch, by segment, and the size of their arrays in bytes."""

    sides: dict[int, _SegmentCells]
    memory_bytes: int


def _memory_bytes(stretches: list[_Stretch]) -> int:
    return sum(stretch.memory_bytes for stretch in stretches)


def _are_too_many(stretches: list[_Stretch]) -> bool:
    return len(stretches) > _MOST_STRETCHES or _memory_bytes(stretches) > _MOST_BYTES


class LeaderMap:
    """The map from the leader to all handles of a chain."""

    def __init__(self, track: Track, links_m: Floats, direction: int, place_many: Callable[[Places], Chain]) -> None:
        """Lay out the stretches without building any; ``place_many`` places the chains of many leaders."""
        self.track, self.links_m, self.direction, self._place_many = track, links_m, direction, place_many
        self.stretch_m = _STRETCH_LINKS * float(np.max(links_m))
        self._stretches = BuildCache[int, _Stretch](_are_too_many)

    @property
    def memory_bytes(self) -> int:
        """The size of the arrays of all stretches, in bytes."""
        return _memory_bytes(self._stretches.values)

    @property
    def cells(self) -> list[LeaderCell]:
        """The cells built so far."""
        return [cell for stretch in self._stretches.values for side in stretch.sides.values()
                for cell in side.cells]

    def links_of(self, leader: Place) -> MappedLinks | None:
        """Return the links that follow a leader, or None if no cell covers it."""
        k, (high, low) = leader
        side = self._stretches.get(floor(self.track.about_m(leader) / self.stretch_m), self._built).sides.get(k)
        if side is None:
            return None
        # A position before the first cell is in the first cell or in no cell.
        sense, begins, cells = side
        cell = cells[bisect_right(begins, sense * high, 1) - 1]
        x = ((high - cell.middle) + (low - cell.middle_lo)) * cell.scale
        if not -cell.slack <= x <= cell.slack:
            return None
        basis = cell.orders * acos(x if -1.0 <= x <= 1.0 else 1.0 if x > 0 else -1.0)
        return MappedLinks(cell, np.cos(basis, basis), self.links_m.size)

    def _built(self, number: int) -> _Stretch:
        low_m, high_m = self._range_m
        low_m, high_m = max(low_m, number * self.stretch_m), min(high_m, (number + 1) * self.stretch_m)
        sides, size = dict[int, list[tuple[float, LeaderCell]]](), 0
        if low_m < high_m and ulp(max(abs(low_m), abs(high_m))) <= _COARSEST * self.stretch_m:
            for part, cell in self._cells(low_m, high_m):
                sides.setdefault(part.segment, []).append((part.fore.item(0), cell))
                size += cell.memory_bytes
        return _Stretch({k: _in_order(cells) for k, cells in sides.items()}, size)

    def _cells(self, low_m: float, high_m: float) -> list[tuple[SpanPart, LeaderCell]]:
        """Return the cells for leaders on an interval of the track, or an empty list if there would be too many.

        No cell covers positions at which series do not converge.
        """
        track, out = self.track, list[tuple[SpanPart, LeaderCell]]()
        try:
            parts = _parts(track, self.links_m, self.direction, (track.place_at(low_m), track.place_at(high_m)))
            wanted = [(part, inf) for part in parts]
            for _ in range(_ROUNDS):
                if not wanted:
                    break
                cells = self._fitted([part for part, _ in wanted])
                over = [(part, *cell, before) for (part, before), cell in zip(wanted, cells, strict=True)]
                out += [(part, cell) for part, cell, excess, _ in over if excess <= NOISE]
                # Cutting would not reduce an error that rounding causes.
                wanted = [(third, excess) for part, _, excess, before in over if NOISE < excess < 0.5 * before
                          for third in equal_parts(part, 3)]
        except (TrackEndError, ChainLockError):
            return []
        return out

    def _fitted(self, parts: list[SpanPart]) -> list[tuple[LeaderCell, float]]:
        """Return the cells of parts, each with its truncation error in units of the allowed error."""
        nodes: Floats = np.array([part.nodes() for part in parts])
        numbers: Ints = np.repeat([part.segment for part in parts], NODES)
        chains = self._place_many((numbers, nodes[:, 0].ravel(), nodes[:, 1].ravel()))
        shape = len(parts), NODES, -1
        p, v = chains.p.reshape(shape), chains.velocities(-float(self.direction)).reshape(shape)
        of_handles: list[Any] = [values[:, ::-self.direction].reshape(shape).transpose(0, 2, 1)
                                 for values in chains.places]
        placed: Any = on_one_segment(
            self.track, (of_handles[0].ravel(), of_handles[1].ravel(), of_handles[2].ravel()))
        segment, u, lo = (values.reshape(of_handles[0].shape) for values in placed)
        origin = np.stack((u[..., NODES // 2], lo[..., NODES // 2]), axis=1)
        coordinates = ((u - origin[:, 0, :, None]) + (lo - origin[:, 1, :, None])).transpose(0, 2, 1)
        series = [series_of(np.ascontiguousarray(values)) for values in (p, v, coordinates)]
        link_m, far_m = float(np.mean(self.links_m)), np.max(np.abs(p), axis=(1, 2))
        error_m = TRUNCATION * np.maximum(far_m, link_m * np.sqrt(self.links_m.size))
        return [_cell(part, segment[n, :, 0], origin[n], (series[0][n], series[1][n], series[2][n]), link_m,
                      float(error_m[n])) for n, part in enumerate(parts)]

    @cached_property
    def _range_m(self) -> tuple[float, float]:
        """The range of leaders (m along the track) for which the chain is on the track and certainly does not lock."""
        track, links_m = self.track.without_locks(float(np.max(self.links_m))), self.links_m
        if track is None:
            return inf, -inf
        begin_m, end_m = track.begin_m, track.end_m
        try:
            if self.direction == BEHIND:
                return begin_m if begin_m == -inf else head_in_front_m(track, links_m, begin_m), end_m
            return begin_m, end_m if end_m == inf else tail_behind_m(track, links_m, end_m)
        except TrackEndError:
            return inf, -inf


def _in_order(cells: list[tuple[float, LeaderCell]]) -> _SegmentCells:
    """Return the cells of one segment, given with the coordinates of their fronts."""
    sense = 1.0 if cells[0][1].scale > 0 else -1.0
    ordered = sorted(cells, key=lambda one: sense * one[0])
    return _SegmentCells(sense, [sense * fore for fore, _ in ordered], [cell for _, cell in ordered])


def _parts(track: Track, links_m: Floats, direction: int, ends: tuple[Place, Place]) -> list[SpanPart]:
    """Return the parts of an interval, cut wherever a handle passes a joint, from the front; [] if there are many."""
    low, high = ends
    blocks = blocks_of(links_m, direction)
    before, after = (forward(track, blocks, leader, direction).segment for leader in ends)
    passed = [(handle, k) for handle, (first, last) in enumerate(zip(before, after, strict=True))
              for k in range(first + 1, last + 1)]
    if len(passed) >= _MOST_CELLS:
        return []
    cuts = sorted((_leader_at(track, links_m, direction, one) for one in passed), key=partial(_order, track),
                  reverse=True)
    out, fore, longest_m = list[SpanPart](), high, float(np.max(links_m))
    for rear in [*cuts, low]:
        length_m = _length_m(track, fore, rear)
        if length_m > _SHORTEST * longest_m:
            out += equal_parts(part_between(track, fore, rear), ceil(length_m / (_LONGEST * longest_m)))
        if length_m > 0:        # rounding may put a cut beyond an end of the interval
            fore = rear
    return out


def _order(track: Track, place: Place) -> tuple[int, float, float]:
    """Return a key that sorts positions from the rear to the front, where distances would be rounded too coarsely."""
    k, (high, low) = place
    sense = copysign(1.0, track.segments[k].rate(high))
    return k, sense * high, sense * low


def _length_m(track: Track, fore: Place, rear: Place) -> float:
    """Return the approximate length of the track between two positions, accurate if they are close to each other."""
    if fore.segment == rear.segment:
        segment = track.segments[fore.segment]
        return float(((fore.u.hi - rear.u.hi) + (fore.u.lo - rear.u.lo)) * segment.rate(rear.u.hi))
    if fore.segment < rear.segment:
        return -_length_m(track, rear, fore)
    ends = [(rear.segment, rear.u.hi, track.segments[rear.segment].last),
            (fore.segment, fore.u.hi, track.segments[fore.segment].first),
            *((k, track.segments[k].first, track.segments[k].last) for k in range(rear.segment + 1, fore.segment))]
    return float(sum(track.segments[k].metres_between(a, b) for k, a, b in ends))


def _leader_at(track: Track, links_m: Floats, direction: int, passed: tuple[int, int]) -> Place:
    """Return the position of the leader when a handle, counted from the leader, is at the start of a segment."""
    handle, k = passed
    between_m = links_m[:handle] if direction == BEHIND else links_m[links_m.size - handle:]
    joint = Place.of(k, track.segments[k].first, 0.0)
    return forward(track, blocks_of(between_m, -direction), joint, -direction).place(-1)


def _cell(part: SpanPart, segment: Ints, origin: Floats, series: tuple[Floats, Floats, Floats], link_m: float,
          error_m: float) -> tuple[LeaderCell, float]:
    """Return a cell with as many terms as its longest series needs, and its truncation error (see ``_fitted``)."""
    places, motions, coordinates = series
    places_size, motions_size = (np.max(np.abs(each), axis=1) / error_m for each in (places, link_m * motions))
    left = float(max(np.max(places_size[-2:]), np.max(motions_size[-2:])))
    # A velocity is a product of many ratios, so its rounding error may exceed the error at which its series is cut off.
    noise = max(1.0, 2 * float(np.max(motions_size[-2:])))
    terms = 1 + int(np.max(np.flatnonzero((places_size > 1) | (motions_size > noise)), initial=0))
    length = (part.rear[0] - part.fore[0]) + (part.rear[1] - part.fore[1])
    middle, middle_lo = plus(part.fore.item(0), part.fore.item(1), 0.5 * float(length))
    half_m = float(np.hypot(*places[1, :2]))
    return LeaderCell(middle, middle_lo, 2 / float(length), 1 + NOISE * error_m / half_m, np.arange(terms, dtype=float),
                      _products(places[:terms], motions[:terms]), segment, origin, coordinates[:terms].copy()), left


def _products(places: Floats, motions: Floats) -> list[Product]:
    """Return the products for series (K, M), each small enough for one thread."""
    terms, size = places.shape
    width, out = TERMS // terms // 2 * 2, list[Product]()
    for first in range(0, size, width):
        stop = min(first + width, size)
        some = [read_only(np.ascontiguousarray(series[:, first:stop])) for series in (places, motions)]
        out.append(Product(np.dot, terms, some[0], some[1], first, stop))
    return out
