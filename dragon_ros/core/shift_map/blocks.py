"""Placement of a chain: each long block of equal links by its shift map, and all other links one by one."""
from dataclasses import dataclass
from functools import cached_property
from math import copysign, hypot, inf
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.chain.chain import Chain, MarchedLink, MarchedLinks, PlacedLinks, arrays_of
from dragon_ros.core.chain.forward import Block, blocks_of, forward, forward_many, in_order, next_place
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.shift_map.table import Product, ShiftMap, Spot, Spots
from dragon_ros.core.tracks.composite import Place, Places, Track
from dragon_ros.core.tracks.segments import BEHIND

FEWEST = 8              # minimum number of links for a table; with fewer links, marching is faster
_LONG = 512             # the length of the longest dragon with a map for a short block, in links of this block
_MOST_MAPS = 4          # maximum number of shift maps per dragon, for the link lengths of its longest blocks


class TabulatedLinks(NamedTuple):
    """The handles of the ``links`` links that follow handle ``start`` at one instant, computed from a tile.

    Handles are counted from the leader.
    """

    start: int
    links: int
    at: int                 # the index of the first coordinate in the flat array of the chain
    spot: Spot
    products: list[Product]
    direction: int
    solver: str = 'table'

    def fill(self, flat: Floats) -> None:
        """Write the coordinates into ``flat``."""
        at, basis = self.at, self.spot.basis
        for terms, places, _, start, stop in self.products:
            np.matmul(basis[:terms], places, flat[at + start:at + stop])

    def end(self, direction: int) -> Place:
        """Return the position of the last handle."""
        return self.spot.tile.place_at(self.spot, self.spot.cell.row - direction * self.links)

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
        for terms, _, motions, start, stop in self.products:
            np.matmul(basis[:terms], motions, flat[at + start:at + stop])
        return flat[at:at + 2 * self.links + 2]

    def headings(self, chain: Chain, out: Floats) -> None:
        """Fill in unit tangents."""
        some = self._motions(out).reshape(-1, 2)
        some /= np.hypot(some[:, 0], some[:, 1])[:, None]

    def places(self) -> Places:
        """Return the positions."""
        (tile, cell, basis), count = self.spot, self.links + 1
        rows = cell.row - self.direction * np.arange(count)
        many = Spots(tile, rows, np.full(count, cell.part), np.broadcast_to(basis, (count, basis.size)))
        return tile.places_at(many, rows)


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
        segment, u = np.empty(size, dtype=np.int64), np.empty(size)
        for rows, spots in self.spots:
            segment[rows], u[rows] = spots.tile.places_at(spots, spots.row - self.direction * self.links)
        return segment, u

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
        segment, u = np.empty(shape, dtype=np.int64), np.empty(shape)
        for rows, spots in self.spots:
            each = spots.tile.places_many(spots, self._first(spots), self.links + 1)
            segment[rows], u[rows] = (values[:, ::-self.direction] for values in each)
        return segment, u


class Run(NamedTuple):
    """Consecutive links ``start`` to ``stop - 1``, counted from the leader: a block with a map, or marched blocks."""

    start: int
    stop: int
    links_m: list[float]
    blocks: tuple[Block, ...]
    shift: ShiftMap | None


@dataclass(frozen=True, eq=False)
class Placement:
    """A solver that places the handles of N links on a track, behind a head (``direction`` BEHIND) or ahead of a tail.

    ``maps`` holds shift maps for some link lengths; blocks with other link lengths are marched.
    """

    track: Track
    links_m: Floats
    direction: int
    maps: dict[float, ShiftMap]

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """The runs of links in order from the leader; neighbouring blocks without a map are marched together."""
        out, links_m = list[Run](), in_order(self.links_m, self.direction)
        for block in blocks_of(self.links_m, self.direction):
            shift = self.maps.get(block.link_m) if block.stop - block.start >= FEWEST else None
            joins = out and not shift and not out[-1].shift
            blocks = (*out.pop().blocks, block) if joins else (block,)
            start, stop = blocks[0].start, block.stop
            out.append(Run(start, stop, links_m[start:stop], blocks, shift))
        return tuple(out)

    @property
    def memory_bytes(self) -> int:
        """The size of all tables built so far, in bytes."""
        return sum(shift.memory_bytes for shift in self.maps.values())

    @cached_property
    def section_m(self) -> float:
        """The length of the shortest section of track whose tables are built together (m); inf without tables."""
        return min((shift.section_m for shift in self.maps.values()), default=inf)

    def place(self, leader: Place) -> Chain:
        """Return the chain for one position of the leader.

        A run is marched from the first handle on that its tables do not cover. Raises TrackEndError if the track is too
        short, and ChainLockError if a link cannot be placed.
        """
        count, direction, spent, here = len(self.links_m), self.direction, 0, leader
        parts: list[PlacedLinks] = []
        flat = np.empty(2 * count + 2)
        for start, stop, links_m, _, shift in self.runs:
            spot = shift.spot(here) if shift else None
            some = self._tabulated(flat, start, stop, spot) if spot else None
            if some:
                parts.append(some)
                start += some.links
                if start < count:
                    here = some.end(direction)
            if start < stop:
                part, here, more = self._marched(flat, start, here, links_m[start - stop:], 'march' if shift else '')
                parts.append(part)
                spent += more
        p = flat.reshape(-1, 2)
        p.setflags(write=False)
        return Chain(p, self.links_m, spent, self.track, direction, tuple(parts))

    def build_near(self, leader: Place) -> None:
        """Build the tables of all blocks for leaders near a leader. Raises the same errors as ``place``."""
        segment, u = (values[::-self.direction] for values in self.place(leader).places)
        for run in self.runs:
            if run.shift:
                run.shift.build_all(Place.of(segment[run.start], u[run.start]))

    def _marched(self, flat: Floats, start: int, here: Place, links_m: list[float], solver: str
                 ) -> tuple[PlacedLinks, Place, int]:
        """March links from a handle and write their handles; return them, the last handle and the evaluation count."""
        track, direction = self.track, self.direction
        if len(links_m) == 1:       # the head, mostly
            there, spent = next_place(track, here, links_m[0], direction, start)
            link, segments = MarchedLink(start, here, there, solver), track.segments
            link.fill((segments[here.segment].at(here.u), segments[there.segment].at(there.u)), direction, flat)
            return link, there, spent
        handles = forward(track, links_m, here, direction, start)
        part = MarchedLinks(start, arrays_of(handles), solver)
        first = 2 * (start if direction == BEHIND else len(self.links_m) - start - part.links)
        points = track.points(*part.handles)[::-direction]
        flat[first:first + points.size] = points.ravel()
        return part, handles.place(-1), handles.evaluations

    def _tabulated(self, flat: Floats, start: int, stop: int, spot: Spot) -> TabulatedLinks | None:
        """Write the links that the table of a spot covers; return None if it covers no link."""
        (tile, cell, _), direction = spot, self.direction
        links = min(tile.rows - 1 - cell.row if direction == BEHIND else cell.row, stop - start)
        if not links:
            return None
        products = cell.products.get(links)
        if products is None:
            products = cell.products[links] = tile.products(cell, links, direction)
        first = start if direction == BEHIND else len(self.links_m) - start - links
        part = TabulatedLinks(start, links, 2 * first, spot, products, direction)
        part.fill(flat)
        return part

    def place_many(self, leaders: Places, out: Floats | None = None) -> Chain:
        """Return the chains for many positions (S,) of the leader as one Chain.

        A block is marched unless its tables cover all positions. If ``out`` (S, N+1, 2) is given, the handles are
        written into it.
        """
        parts: list[PlacedLinks] = []
        places, spent = leaders, 0
        for run in self.runs:
            part, more = self._states(run, places)
            parts.append(part)
            spent += more
            if run.stop < self.links_m.size:
                places = part.end() if isinstance(part, TabulatedStates) else _last(part.places())
        return self._chains(parts, spent, np.empty((leaders[0].size, self.links_m.size + 1, 2)) if out is None else out)

    def _states(self, run: Run, places: Places) -> tuple[PlacedLinks, int]:
        start, stop, _, blocks, shift = run
        spots = shift.spots(places) if shift else None
        if spots is not None and all(self._reaches(one, stop - start) for _, one in spots):
            return TabulatedStates(start, stop - start, tuple(spots), self.direction), 0
        rows, spent = forward_many(self.track, blocks, places, self.direction)
        return MarchedLinks(start, (rows[0].T, rows[1].T), 'march' if shift else ''), spent

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
    segment, u = places
    return segment[:, -1], u[:, -1]


def lengths_with_maps(links_m: Floats) -> dict[float, int]:
    """Return the link lengths that have a shift map, and for each length the number of links in its longest block.

    Links so short that ``_LONG`` of them are shorter than the dragon have no map, because few links would gain by it.
    """
    length_m, out = float(np.sum(links_m)), dict[float, int]()
    longest = sorted(((block.stop - block.start, block.link_m) for block in blocks_of(links_m, BEHIND)
                      if block.stop - block.start >= FEWEST), key=lambda row: -row[0])
    for links, link_m in longest:
        if link_m in out or (len(out) < _MOST_MAPS and max(2 * links, _LONG) * link_m >= length_m):
            out[link_m] = max(links, out.get(link_m, 0))
    return out
