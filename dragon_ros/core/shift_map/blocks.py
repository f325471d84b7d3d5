"""Placement of a chain: in one product if a map covers it; otherwise in blocks of equal links.

A block is placed by a shift map if one covers it, and link by link otherwise.
"""
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import copysign, hypot, inf
from sys import float_info
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.chain.chain import Chain, MarchedLink, MarchedLinks, PlacedLinks, arrays_of, marched_many
from dragon_ros.core.chain.forward import Block, blocks_of, forward, forward_many, locked
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.shift_map.leader_map import MOST_LINKS, LeaderMap, MappedLinks
from dragon_ros.core.shift_map.table import Product, ShiftMap, Spot, Spots, links_of_tile
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND

FEWEST = 8              # minimum number of links for a table; with fewer links, marching is faster
_MOST_MAPS = 4          # maximum number of shift maps per dragon, for the link lengths of its longest blocks
# The minimum length of a leader's link with a series, relative to the block's links; a shorter link would lose too many
# digits.
_SHORTEST_LEAD = 0.05
# The maximum number of links of a block that are marched one by one in search of a table; if none is found, the
# remaining links are marched in a single call.
_TRIES = 8


class _NextPlace(NamedTuple):
    """The solver for the next position on a segment, its range of coordinates, and a function that returns points."""

    next: Callable[[DoubleDouble, float, int], tuple[DoubleDouble, int]]
    low: float
    high: float
    at: Callable[[float, float], complex]


class TabulatedLinks(NamedTuple):
    """The handles of the ``links`` links that follow handle ``start`` at one instant, computed from a tile.

    Handles are counted from the leader.

    If ``leader`` is given, the first link joins the leader to the first handle of the table.
    """

    start: int
    links: int
    at: int                 # the index of the first coordinate in the flat array of the chain
    spot: Spot
    products: list[Product]
    direction: int
    leader: Place | None = None
    solver: str = 'table'

    def fill(self, flat: Floats) -> None:
        """Write the coordinates into ``flat``."""
        at, basis = self.at, self.spot.basis
        for times, terms, places, _, start, stop in self.products:
            times(basis[:terms], places, flat[at + start:at + stop])

    def end(self, direction: int) -> Place:
        """Return the position of the last handle."""
        behind = self.links - 1 if self.leader else self.links
        return self.spot.tile.place_at(self.spot, self.spot.cell.row - direction * behind)

    def velocities(self, chain: Chain, speed: Any, out: Floats) -> Any:
        """Fill in velocities."""
        some, end = self._motions(out), 2 * self.links
        near = 0 if self.direction == BEHIND else end
        some *= speed / hypot(some.item(near), some.item(near + 1))
        if self.start + self.links < len(chain.links_m):
            far = end - near
            speed = copysign(hypot(some.item(far), some.item(far + 1)), speed)
        return speed

    def _motions(self, flat: Floats) -> Floats:
        """Write the velocities for unit speed in row 0 into ``flat``, and return that part of ``flat``."""
        at, basis = self.at, self.spot.basis
        for times, terms, _, motions, start, stop in self.products:
            times(basis[:terms], motions, flat[at + start:at + stop])
        return flat[at:at + 2 * self.links + 2]

    def headings(self, chain: Chain, out: Floats) -> None:
        """Fill in unit tangents."""
        some = self._motions(out).reshape(-1, 2)
        some /= np.hypot(some[:, 0], some[:, 1])[:, None]

    def places(self) -> Places:
        """Return the positions."""
        (tile, cell, basis), count = self.spot, self.links if self.leader else self.links + 1
        rows, basis = cell.row - self.direction * np.arange(count), basis[:tile.table.nodes]
        many = Spots(tile, rows, np.full(count, cell.part), np.broadcast_to(basis, (count, basis.size)))
        segment, u, lo = tile.places_at(many, rows)
        if not self.leader:
            return segment, u, lo
        k, (high, low) = self.leader
        return np.append(k, segment), np.append(high, u), np.append(low, lo)


@dataclass(frozen=True, eq=False)
class TabulatedStates:
    """``TabulatedLinks`` for many instants; ``spots`` holds the indices and the locations of the instants, by tile."""

    start: int
    links: int
    spots: tuple[tuple[Ints, Spots], ...]
    direction: int
    solver: str = 'table'

    def _first(self, spots: Spots) -> Ints:
        return spots.row if self.direction == BEHIND else spots.row - self.links

    def fill(self, out: Floats, motions: bool = False, scales: Floats | None = None) -> None:
        """Write coordinates (S, links + 1, 2), or motions times one scale per instant, into ``out``."""
        for rows, spots in self.spots:
            one = spots if scales is None else spots._replace(basis=spots.basis * scales[rows][:, None])
            first, last = rows[[0, -1]].tolist()
            if last - first + 1 == rows.size:       # consecutive instants, as in a run
                spots.tile.fill_many(one, self._first(spots), out[first:last + 1], motions)
                continue
            some = np.empty((rows.size, *out.shape[1:]))
            spots.tile.fill_many(one, self._first(spots), some, motions)
            out[rows] = some

    def _each(self, value: Any) -> Floats:
        """Apply ``value`` to the locations in each tile, and return one number per instant."""
        out: Floats = np.empty(sum(rows.size for rows, _ in self.spots))
        for rows, spots in self.spots:
            out[rows] = value(spots)
        return out

    def end(self) -> Places:
        """Return the positions of the last handles."""
        size = sum(rows.size for rows, _ in self.spots)
        segment, u, lo = np.empty(size, dtype=np.int64), np.empty(size), np.empty(size)
        for rows, spots in self.spots:
            segment[rows], u[rows], lo[rows] = spots.tile.places_at(spots, spots.row - self.direction * self.links)
        return segment, u, lo

    def velocities(self, chain: Chain, speed: Floats, out: Floats) -> Floats:
        """Fill in velocities."""
        some = out[:, chain.slice_of(self)]
        self.fill(some, True, speed / self._each(lambda spots: spots.tile.paces(spots)))
        after: Floats = np.copysign(np.hypot(*some[:, -1 if self.direction == BEHIND else 0].T), speed)
        return after

    def headings(self, chain: Chain, out: Floats) -> None:
        """Fill in unit tangents."""
        some = out[:, chain.slice_of(self)]
        self.fill(some, True)
        some /= np.hypot(some[..., 0], some[..., 1])[..., None]

    def places(self) -> Places:
        """Return the positions."""
        shape = sum(rows.size for rows, _ in self.spots), self.links + 1
        segment, u, lo = np.empty(shape, dtype=np.int64), np.empty(shape), np.empty(shape)
        for rows, spots in self.spots:
            each = spots.tile.places_many(spots, self._first(spots), self.links + 1)
            segment[rows], u[rows], lo[rows] = (values[:, ::-self.direction] for values in each)
        return segment, u, lo


@dataclass(frozen=True, eq=False)
class Placement:
    """A solver that places the handles of N links on a track, behind a head (``direction`` BEHIND) or ahead of a tail.

    ``maps`` holds shift maps for some link lengths; blocks with other link lengths are marched. If ``uses_leader_map``
    is false, chains are only placed block by block.
    """

    track: Track
    links_m: Floats
    direction: int
    maps: dict[float, ShiftMap]
    uses_leader_map: bool = True

    @cached_property
    def blocks(self) -> tuple[tuple[Block, ShiftMap | None], ...]:
        """The blocks of equal links in order from the leader, each with its shift map or None."""
        return tuple((block, self.maps.get(block.link_m) if block.stop - block.start >= FEWEST else None)
                     for block in blocks_of(self.links_m, self.direction))

    @property
    def memory_bytes(self) -> int:
        """The size of all tables built so far, in bytes."""
        leader_map: LeaderMap | None = vars(self).get('leader_map')     # None if it has not been used yet
        return sum(shift.memory_bytes for shift in self.maps.values()) + (leader_map.memory_bytes if leader_map else 0)

    @cached_property
    def stretch_m(self) -> float:
        """The length of the shortest stretch whose tables are built together (m); inf if there are no tables."""
        lengths_m = [shift.stretch_m for shift in self.maps.values()]
        return min([*lengths_m, self.leader_map.stretch_m] if self.leader_map else lengths_m, default=inf)

    @cached_property
    def _plan(self) -> tuple[tuple[int, int, float, ShiftMap | None, list[_NextPlace]], ...]:
        """For each block: its first and last handles, link length, shift map, and the step on each segment."""
        return tuple((*block, shift, [self._step(k, block.link_m) for k in range(len(self.track.segments))])
                     for block, shift in self.blocks)

    def _step(self, k: int, link_m: float) -> _NextPlace:
        """Return the step on a segment: its solver, and the range of coordinates on the segment."""
        segment = self.track.segments[k]
        edge = self.track.edge(k, link_m, self.direction)
        outwards = edge > (segment.last if self.direction == BEHIND else segment.first)
        low, high = (-inf, min(edge, float_info.max)) if outwards else (max(edge, -float_info.max), inf)
        return _NextPlace(segment.next, low, high, segment.at)

    @cached_property
    def _lead(self) -> tuple[float, int, ShiftMap] | None:
        """The leader's link if it alone precedes a block with a shift map: its length, and that block's end and map."""
        if len(self.blocks) < 2:
            return None
        (first, own), (second, shift) = self.blocks[:2]
        leads = shift and not own and first.stop == 1 and first.link_m >= _SHORTEST_LEAD * second.link_m
        return (first.link_m, second.stop, shift) if shift and leads else None

    def place(self, leader: Place) -> Chain:
        """Return the chain for one position of the leader.

        Raises TrackEndError if the track is too short, and ChainLockError if a link cannot be placed.
        """
        count, spent = len(self.links_m), 0
        flat = np.empty(2 * count + 2)
        led = self._led(flat, leader) if self._is_one_block else None
        whole = led if led and led.links == count else self._mapped(flat, leader)
        parts: list[PlacedLinks] = [whole] if whole else []
        if not whole:
            spent = self._place_blocks(flat, leader, led if self._is_one_block else self._led(flat, leader), parts)
        p = flat.reshape(-1, 2)
        p.setflags(write=False)
        return Chain(p, self.links_m, spent, self.track, self.direction, tuple(parts))

    def build_near(self, leader: Place) -> None:
        """Build the tables for all leaders on the stretch of a leader. Raises the same errors as ``place``.

        If no leader map covers the chain, the tables of the other blocks are also built, each for the stretch on which
        the first handle of the block is.
        """
        chain = self.place(leader)
        link_m, shift = (self._lead[0], self._lead[2]) if self._lead else (0.0, self.blocks[0][1])
        if shift:
            shift.build_all(leader, link_m)
        if not isinstance(chain.parts[0], MappedLinks):
            segment, u, lo = (values[::-self.direction] for values in chain.places)
            for block, own in self.blocks[2 if self._lead else 1:]:
                if own:
                    own.build_all(Place.of(segment[block.start], u[block.start], lo[block.start]))

    @cached_property
    def _is_one_block(self) -> bool:
        """Whether a shift map may cover the whole chain, with or without the leader's link."""
        return bool(self.blocks[0][1] if len(self.blocks) == 1 else self._lead and len(self.blocks) == 2)

    @cached_property
    def leader_map(self) -> LeaderMap | None:
        """The leader map, for chains that are neither too short nor too long.

        If a single shift map covers almost all links accurately, it also places the chains from which the leader map is
        fitted.
        """
        if not self.uses_leader_map or not FEWEST <= self.links_m.size <= MOST_LINKS:
            return None
        others = sum(block.stop - block.start for block, shift in self.blocks if not shift)
        if len(self.maps) == 1 and others < FEWEST:
            # A copy of this placement, because a reference to itself would keep its tables in memory.
            return LeaderMap(self.track, self.links_m, self.direction, replace(self).place_many)
        return LeaderMap(self.track, self.links_m, self.direction,
                         partial(marched_many, self.track, self.links_m, direction=self.direction))

    def _led(self, flat: Floats, leader: Place) -> TabulatedLinks | None:
        """Write the links that one product of a shift map yields together with the leader."""
        if len(self.blocks) == 1:
            (block, shift), = self.blocks
            spot = shift.spot(leader) if shift else None
            return self._tabulated(flat, 0, block.stop, spot) if spot else None
        if not self._lead:
            return None
        link_m, stop, shift = self._lead
        spot = shift.spot_behind(leader, link_m)
        return self._tabulated(flat, 0, stop, spot, leader) if spot else None

    def _mapped(self, flat: Floats, leader: Place) -> MappedLinks | None:
        """Write all links if one product of the leader map yields them."""
        mapped = self.leader_map.links_of(leader) if self.leader_map else None
        if mapped:
            mapped.fill(flat)
        return mapped

    def _place_blocks(self, flat: Floats, leader: Place, led: TabulatedLinks | None, parts: list[PlacedLinks]) -> int:
        """Add the parts that begin with ``led``, block by block, and return the number of evaluations.

        A single marched link writes only its first handle; all other parts also write their last handle.
        """
        if led:
            parts.append(led)
        count, direction, spent, filled, begin, here = len(self.links_m), self.direction, 0, False, 0, leader
        if led:
            begin, here, filled = led.links, led.end(direction), True
        part: PlacedLinks
        for i, stop, link_m, shift, steps in self._plan:
            i, tries = max(i, begin), _TRIES if shift else 0
            while i < stop:
                spot = shift.spot(here) if shift and tries else None
                some = self._tabulated(flat, i, stop, spot) if spot else None
                if some:
                    i, filled, part = i + some.links, True, some
                    if i < count:
                        here = some.end(direction)
                elif tries or i + 1 == stop:      # one link
                    at, z = 2 * (i if direction == BEHIND else count - i), steps[here[0]].at(*here[1])
                    flat[at], flat[at + 1] = z.real, z.imag
                    there, more = self._next(steps[here[0]], here, i, link_m)
                    part = MarchedLink(i, here, there, 'march' if shift else '')
                    here, i, spent, filled, tries = there, i + 1, spent + more, False, tries - 1
                else:                   # the rest of the block
                    handles = forward(self.track, (Block(i, stop, link_m),), here, direction)
                    rows, first = arrays_of(handles), 2 * (i if direction == BEHIND else count - stop)
                    part = MarchedLinks(i, rows, 'march' if shift else '')
                    flat[first:first + 2 * (stop - i) + 2] = self.track.points(*rows)[::-direction].ravel()
                    here, i, spent, filled = handles.place(-1), stop, spent + handles.evaluations, True
                parts.append(part)
        if not filled:
            at, z = 2 * count if direction == BEHIND else 0, self.track.segments[here[0]].at(*here[1])
            flat[at], flat[at + 1] = z.real, z.imag
        return spent

    def _next(self, step: _NextPlace, here: Place, i: int, link_m: float) -> tuple[Place, int]:
        """Return the position of the next handle, and the number of evaluations.

        The result is bit-identical to that of ``forward``. This function is faster for the single links of live ticks,
        because ``step`` holds the values that ``forward`` would look up for each block, and no lists are created.
        """
        following, spent = step.next(here[1], link_m, self.direction)
        if step.low <= following[0] <= step.high:
            return Place(here[0], following), spent
        if self.direction == BEHIND and here[0] == 0 and self.track.from_afar:
            raise locked(self.track, i, here[1][0], link_m)
        there, more = self.track.across(here, link_m, self.direction)
        return there, spent + more

    def _tabulated(self, flat: Floats, i: int, stop: int, spot: Spot,
                   leader: Place | None = None) -> TabulatedLinks | None:
        """Write the links from ``i`` to ``stop`` that the table of a spot covers; return None if it covers no link."""
        (tile, cell, _), direction = spot, self.direction
        links = (tile.rows - 1 - cell.row if direction == BEHIND else cell.row) + (leader is not None)
        if links > stop - i:
            links = stop - i
        elif not links:
            return None
        products = cell.products.get(links)
        if products is None:
            products = cell.products[links] = tile.products(cell, links, direction)
        first = i if direction == BEHIND else len(self.links_m) - i - links
        part = TabulatedLinks(i, links, 2 * first, spot, products, direction, leader)
        part.fill(flat)
        return part

    def place_many(self, leaders: Places, out: Floats | None = None) -> Chain:
        """Return the chains for many positions (S,) of the leader as one Chain.

        A block is marched unless its tables cover all positions. If ``out`` (S, N+1, 2) is given, the handles are
        written into it.
        """
        parts: list[PlacedLinks] = []
        places, spent = leaders, 0
        for block, shift in self.blocks:
            part, more = self._states(block, places, shift)
            parts.append(part)
            spent += more
            if block.stop < self.links_m.size:
                places = part.end() if isinstance(part, TabulatedStates) else _last(part.places())
        return self._chains(parts, spent, np.empty((leaders[0].size, self.links_m.size + 1, 2)) if out is None else out)

    def _states(self, block: Block, places: Places, shift: ShiftMap | None) -> tuple[PlacedLinks, int]:
        count = block.stop - block.start
        spots = shift.spots(places) if shift else None
        if spots is not None and all(self._reaches(one, count) for _, one in spots):
            return TabulatedStates(block.start, count, tuple(spots), self.direction), 0
        rows, spent = forward_many(self.track, (block,), places, self.direction)
        return MarchedLinks(block.start, (rows[0].T, rows[1].T, rows[2].T), 'march' if shift else ''), spent

    def _reaches(self, spots: Spots, count: int) -> bool:
        last = spots.row - self.direction * count
        return bool(np.all((last >= 0) & (last < spots.tile.table.rows)))

    def _chains(self, parts: list[PlacedLinks], spent: int, out: Floats) -> Chain:
        p = out.view()      # this view becomes read-only below; ``out`` stays writable
        chain = Chain(p, self.links_m, spent, self.track, self.direction, tuple(parts))
        for part in parts:
            some = p[:, chain.slice_of(part)]
            if isinstance(part, TabulatedStates):
                part.fill(some)
            else:
                some[:] = self.track.points(*part.places())[:, ::-self.direction]
        read_only(p)
        return chain


def _last(places: Places) -> Places:
    segment, u, lo = places
    return segment[:, -1], u[:, -1], lo[:, -1]


def lengths_with_maps(links_m: Floats) -> dict[float, int]:
    """Return the link lengths that have a shift map, and for each length the number of links in its longest block.

    If links are so short that a tile of a spiral is shorter than the dragon, they have no map, because a map would
    cover few states.
    """
    length_m, out = float(np.sum(links_m)), dict[float, int]()
    longest = sorted(((block.stop - block.start, block.link_m) for block in blocks_of(links_m, BEHIND)
                      if block.stop - block.start >= FEWEST), key=lambda row: -row[0])
    for links, link_m in longest:
        if link_m in out or (len(out) < _MOST_MAPS and link_m and links_of_tile(links) * link_m >= length_m):
            out[link_m] = max(links, out.get(link_m, 0))
    return out
