"""Placing a chain block of equal links by block: from shift maps where they serve, link by link where not."""
from dataclasses import dataclass
from functools import cached_property
from math import copysign, hypot, inf
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.chain.chain import Chain, MarchedLink, MarchedLinks, Part, arrays_of, join
from dragon_ros.core.chain.forward import Block, blocks_of, forward, forward_many
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.shift_map.table import Product, ShiftMap, Spot, Spots, links_of_tile
from dragon_ros.core.tracks.chord import TIGHT
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND, Effort

FEWEST = 8              # links, below which marching is faster than a table
_MOST_MAPS = 4          # shift maps of one dragon: of the lengths of its longest blocks
_FARTHEST = 1e300       # a coordinate that no place has: none was found
_TRIES = 8              # links of a block that are marched in search of its table


class TabulatedLinks(NamedTuple):
    """The handles of some ``links`` behind handle ``start`` from the leader, from a tile, at one instant."""

    start: int
    links: int
    at: int                 # where they begin in the numbers of the chain
    spot: Spot
    products: list[Product]
    direction: int
    solver: str = 'table'

    def fill(self, flat: Floats) -> None:
        """Fill in the coordinates."""
        at, basis = self.at, self.spot.basis
        for terms, places, _, start, stop in self.products:
            np.matmul(basis[:terms], places, flat[at + start:at + stop])

    def end(self, direction: int) -> Place:
        """Return the place of the last handle."""
        return self.spot.tile.place_at(self.spot, self.spot.cell.row - direction * self.links)

    def velocities(self, chain: Chain, speed: Any, out: Floats) -> Any:
        """Fill in velocities."""
        some = self._motions(out)
        near, far = (0, some.size - 2) if chain.direction < 0 else (some.size - 2, 0)
        some *= speed / hypot(some.item(near), some.item(near + 1))
        return copysign(hypot(some.item(far), some.item(far + 1)), speed)

    def _motions(self, flat: Floats) -> Floats:
        """Fill in the velocities for unit speed in row 0, and return them, in a row."""
        at, basis = self.at, self.spot.basis
        for terms, _, motions, start, stop in self.products:
            np.matmul(basis[:terms], motions, flat[at + start:at + stop])
        return flat[at:at + 2 * self.links + 2]

    def headings(self, chain: Chain, out: Floats) -> None:
        """Fill in unit tangents."""
        some = self._motions(out).reshape(-1, 2)
        some /= np.hypot(some[:, 0], some[:, 1])[:, None]

    def places(self) -> Places:
        """Return the places."""
        (tile, cell, basis), count = self.spot, self.links + 1
        rows = cell.row - self.direction * np.arange(count)
        many = Spots(tile, rows, np.full(count, cell.part), np.broadcast_to(basis, (count, basis.size)))
        return tile.places_at(many, rows)


@dataclass(frozen=True, eq=False)
class TabulatedStates:
    """As ``TabulatedLinks``, of many instants: ``spots`` by tile, with the instants (S,) that each tile has."""

    start: int
    links: int
    spots: tuple[tuple[Ints, Spots], ...]
    direction: int
    solver: str = 'table'

    def _first(self, spots: Spots) -> Ints:
        return spots.row if self.direction == BEHIND else spots.row - self.links

    def fill(self, out: Floats, motions: bool = False, scales: Floats | None = None) -> None:
        """Fill in coordinates, or motions times a scale for each instant, (S, links + 1, 2)."""
        for rows, spots in self.spots:
            one = spots if scales is None else spots._replace(basis=spots.basis * scales[rows][:, None])
            if len(self.spots) == 1:
                spots.tile.fill_many(one, self._first(spots), out, motions)
                continue
            some = np.empty((rows.size, *out.shape[1:]))
            spots.tile.fill_many(one, self._first(spots), some, motions)
            out[rows] = some

    def _each(self, value: Any) -> Floats:
        """Return a number for each instant."""
        out: Floats = np.empty(sum(rows.size for rows, _ in self.spots))
        for rows, spots in self.spots:
            out[rows] = value(spots)
        return out

    def end(self) -> Places:
        """Return the places of the last handles."""
        return self._places_at(self.links)

    def _places_at(self, link: int) -> Places:
        size = sum(rows.size for rows, _ in self.spots)
        segment, u, lo = np.empty(size, dtype=np.int64), np.empty(size), np.empty(size)
        for rows, spots in self.spots:
            segment[rows], u[rows], lo[rows] = spots.tile.places_at(spots, spots.row - self.direction * link)
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
        """Return the places."""
        segment, u, lo = (np.stack(values, axis=-1) for values in zip(
            *(self._places_at(link) for link in range(self.links + 1)), strict=True))
        return segment, u, lo


@dataclass(frozen=True, eq=False)
class Placement:
    """Places the handles of links (N,) on a track, behind a head (``direction`` BEHIND) or ahead of a tail.

    ``maps`` has the shift map of each length that has one. Without, all links are marched.
    """

    track: Track
    links_m: Floats
    direction: int
    effort: Effort
    maps: dict[float, ShiftMap]

    @cached_property
    def blocks(self) -> tuple[tuple[Block, ShiftMap | None], ...]:
        """The blocks of equal links from the leader on, with their shift maps."""
        return tuple((block, self.maps.get(block.link_m) if block.stop - block.start >= FEWEST else None)
                     for block in blocks_of(self.links_m, self.direction))

    @cached_property
    def _joins(self) -> bool:
        return not np.all(self.links_m)

    @cached_property
    def _edges(self) -> dict[tuple[int, float], tuple[float, float]]:
        """Between which coordinates a link stays on a segment, by number and length."""
        out = {}
        for k, segment in enumerate(self.track.segments):
            for link_m in {block.link_m for block, _ in self.blocks}:
                edge = self.track.edge(k, link_m, self.direction)
                outwards = edge > (segment.last if self.direction == BEHIND else segment.first)
                out[k, link_m] = (-inf, min(edge, _FARTHEST)) if outwards else (max(edge, -_FARTHEST), inf)
        return out

    def place(self, leader: Place) -> Chain:
        """Return the chain of a leader.

        Each part fills in its handles from its first on; a table those of a whole block, its last handle included.
        Raises TrackEndError where there is no track, ChainLockError where a link finds no place.
        """
        track, count, direction = self.track, self.links_m.size, self.direction
        parts: list[Part] = []
        flat, here, spent, filled = np.empty(2 * count + 2), leader, 0, False
        for (i, stop, link_m), shift in self.blocks:
            tries = _TRIES
            while i < stop:
                spot = shift.spot(here) if shift is not None and tries else None
                if spot is not None:
                    tile, cell, _ = spot
                    links = min(stop - i, tile.rows - 1 - cell.row if direction < 0 else cell.row)
                    if links:       # all that the table has
                        part = TabulatedLinks(i, links, 2 * (i if direction < 0 else count - i - links), spot,
                                              tile.products(cell, links, direction), direction)
                        part.fill(flat)
                        parts.append(part)
                        i, filled = i + links, True
                        if i < count:
                            here = part.end(direction)
                        continue
                if i + 1 == stop or (shift is not None and tries):      # one link
                    there, more = self._next(here, i, link_m)
                    parts.append(MarchedLink(i, here, there, '' if shift is None else 'march'))
                    self._put(flat, i, here)
                    here, i, spent, filled, tries = there, i + 1, spent + more, False, tries - 1
                else:                   # the rest of the block
                    handles = forward(track, (Block(i, stop, link_m),), here, direction, self.effort)
                    rest = MarchedLinks(i, arrays_of(handles), '' if shift is None else 'march')
                    low = i if direction < 0 else count - stop
                    flat[2 * low:2 * (low + stop - i) + 2] = track.points(*rest.handles)[::-direction].reshape(-1)
                    parts.append(rest)
                    here, i, spent, filled = handles.place(-1), stop, spent + handles.evaluations, True
        if not filled:
            self._put(flat, count, here)
        p = flat.reshape(-1, 2)
        if self._joins:
            join(p, self.links_m, direction)
        p.setflags(write=False)
        return Chain(p, self.links_m, spent, track, direction, tuple(parts))

    def _put(self, flat: Floats, i: int, place: Place) -> None:
        """Fill in the coordinates of handle i from the leader on."""
        at = 2 * (i if self.direction < 0 else self.links_m.size - i)
        k, (high, low) = place
        z = self.track.segments[k].at(high, low)
        flat[at], flat[at + 1] = z.real, z.imag

    def _next(self, here: Place, i: int, link_m: float) -> tuple[Place, int]:
        """Return the place of the next handle, and evaluations."""
        k, u = here
        following, spent = self.track.segments[k].next(u, link_m, self.direction, TIGHT)
        low, high = self._edges[k, link_m]
        if low <= following.hi <= high:
            return Place(k, following), spent
        handles = forward(self.track, (Block(i, i + 1, link_m),), here, self.direction, self.effort)
        return handles.place(1), spent + handles.evaluations

    def place_many(self, leaders: Places) -> Chain:
        """Return the chains of many leaders in one; a block is marched where its tables do not serve them all."""
        parts: list[Part] = []
        places, spent = leaders, 0
        for block, shift in self.blocks:
            part, more = self._states(block, places, shift)
            parts.append(part)
            spent += more
            if block.stop < self.links_m.size:
                places = part.end() if isinstance(part, TabulatedStates) else _last(part.places())
        return self._chains(parts, spent, leaders[0].size)

    def _states(self, block: Block, places: Places, shift: ShiftMap | None) -> tuple[Part, int]:
        count = block.stop - block.start
        spots = shift.spots(places) if shift else None
        if spots is not None and all(self._reaches(one, count) for _, one in spots):
            return TabulatedStates(block.start, count, tuple(spots), self.direction), 0
        rows, spent = forward_many(self.track, (block,), places, self.direction, self.effort)
        return MarchedLinks(block.start, (rows[0].T, rows[1].T, rows[2].T), 'march' if shift else ''), spent

    def _reaches(self, spots: Spots, count: int) -> bool:
        last = spots.row - self.direction * count
        return bool(np.all((last >= 0) & (last < spots.tile.table.rows)))

    def _chains(self, parts: list[Part], spent: int, instants: int) -> Chain:
        p = np.empty((instants, self.links_m.size + 1, 2))
        chain = Chain(p, self.links_m, spent, self.track, self.direction, tuple(parts))
        for part in parts:
            some = p[:, chain.slice_of(part)]
            if isinstance(part, TabulatedStates):
                part.fill(some)
            else:
                some[:] = self.track.points(*part.places())[:, ::-self.direction]
        if self._joins:
            join(p, self.links_m, self.direction)
        read_only(p)
        return chain


def _last(places: Places) -> Places:
    segment, u, lo = places
    return segment[:, -1], u[:, -1], lo[:, -1]


def lengths_with_maps(links_m: Floats) -> dict[float, int]:
    """Return the lengths of the longest blocks that shift maps serve, with the links of the longest block of each.

    Not those of links so short that a tile is shorter than the dragon: it would serve few states before the next one.
    """
    length_m, out = float(np.sum(links_m)), dict[float, int]()
    longest = sorted(((block.stop - block.start, block.link_m) for block in blocks_of(links_m, BEHIND)
                      if block.stop - block.start >= FEWEST), key=lambda row: -row[0])
    for links, link_m in longest:
        if link_m in out or (len(out) < _MOST_MAPS and link_m and links_of_tile(links) * link_m >= length_m):
            out[link_m] = max(links, out.get(link_m, 0))
    return out
