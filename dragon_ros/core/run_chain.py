"""Chains of runs from tables and of marched links between them, at one instant or at many."""
from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign, hypot
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.chain import Chain
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.placed import BACK
from dragon_ros.core.track_table import Spot, Spots, TrackTable
from dragon_ros.core.walk import Place, Walk
from dragon_ros.core.walk_many import Places


class Ride(NamedTuple):
    """The handles of some ``links`` behind handle ``start`` from the leader, from a table; ``spot`` is where it is."""

    start: int
    links: int
    table: TrackTable
    spot: Spot

    def end(self, way: int) -> Place:
        """Return the place of the last handle."""
        return self.table.place_at(self.spot, self.spot.row - way * self.links)


class Hop(NamedTuple):
    """The link behind handle ``start`` from the leader, marched: the places of both its handles."""

    start: int
    walk: Walk
    place: Place
    following: Place

    def points(self) -> list[complex]:
        """Return both handles."""
        return [complex(self.walk.pieces[k].at(*u)) for k, u in (self.place, self.following)]

    def headings(self) -> list[complex]:
        """Return the unit tangents at both handles, in the head's way."""
        return [complex(self.walk.pieces[k].heading(u.hi)) for k, u in (self.place, self.following)]


class Rides(NamedTuple):
    """As ``Ride``, of many instants."""

    start: int
    links: int
    table: TrackTable
    spots: Spots

    def end(self, way: int) -> Places:
        """Return the places of the last handles."""
        return self.table.places_at(self.spots, self.spots.row - way * self.links)


class Hops(NamedTuple):
    """As ``Hop``, of many instants."""

    start: int
    walk: Walk
    places: Places
    following: Places


class _Order(NamedTuple):
    """How handles from the leader are numbered in a chain of ``links``, which goes from head to tail."""

    links: int
    way: int

    def one(self, i: int) -> int:
        """Return the number of a handle."""
        return i if self.way == BACK else self.links - i

    def some(self, i: int, links: int) -> slice:
        """Return the numbers of a handle and of those of some links behind it."""
        return slice(i, i + links + 1) if self.way == BACK else slice(self.links - i - links, self.links - i + 1)

    def first_row(self, row: Any, links: int) -> Any:
        """Return the row of the handle nearest to the head."""
        return row if self.way == BACK else row - links


@dataclass(frozen=True)
class RunChain(Chain):
    """A chain at one instant, its parts in order from the leader; ``way`` is BACK where the head leads."""

    way: int
    parts: tuple[Hop | Ride, ...]
    marched: bool

    @property
    def solver(self) -> str:
        """Who placed it."""
        return _solver(self.parts, self.marched)

    @classmethod
    def of(cls, links_m: Floats, spent: int, way: int, parts: tuple[Hop | Ride, ...], marched: bool) -> 'RunChain':
        """Return the chain with its coordinates; ``marched`` where a table did not reach all along a run."""
        order = _Order(links_m.size, way)
        p = np.empty((links_m.size + 1, 2))
        for part in parts:
            if isinstance(part, Ride):
                first = order.first_row(part.spot.row, part.links)
                part.table.fill(part.table.places, part.spot, first, p[order.some(part.start, part.links)])
                continue
            here, following = part.points()
            if not part.start:
                p[order.one(0)] = here.real, here.imag
            p[order.one(part.start + 1)] = following.real, following.imag
        _join(p, links_m, order, parts)
        p.setflags(write=False)
        return cls(p, links_m, spent, way, parts, marched)

    def velocities(self, head_speed_m_s: Any) -> Floats:
        """Return velocity vectors in m/s, shape (N+1, 2); the leader's speed is positive in its own way."""
        order, out = _Order(self.links_m.size, self.way), np.empty_like(self.p)
        speed = -self.way * float(head_speed_m_s)
        for part in self.parts:
            if isinstance(part, Hop):
                speed = self._hop(part, speed, order, out)
                continue
            some = out[order.some(part.start, part.links)]
            part.table.fill(part.table.motions, part.spot, order.first_row(part.spot.row, part.links), some)
            some *= speed / hypot(*out[order.one(part.start)].tolist())
            speed = copysign(hypot(*out[order.one(part.start + part.links)].tolist()), speed)
        out.setflags(write=False)
        return out

    def _hop(self, hop: Hop, speed: float, order: _Order, out: Floats) -> float:
        """Fill in the velocities at both ends of a link; the speed along it is one (see ``rates``)."""
        here, following = order.one(hop.start), order.one(hop.start + 1)
        link = complex(*self.p[here].tolist()) - complex(*self.p[following].tolist())
        one, two = hop.headings()
        after = speed
        if link:
            after *= (link.conjugate() * one).real / (link.conjugate() * two).real
        out[here] = speed * one.real, speed * one.imag
        out[following] = after * two.real, after * two.imag
        return after

    @property
    def tangents(self) -> Floats:
        """Unit tangents against the head's way, towards the tail, also of handles that go back for a while."""
        order, out = _Order(self.links_m.size, self.way), np.empty_like(self.p)
        for part in self.parts:
            if isinstance(part, Ride):
                first, some = order.first_row(part.spot.row, part.links), out[order.some(part.start, part.links)]
                part.table.fill(part.table.motions, part.spot, first, some)
                continue
            for i, forward in enumerate(part.headings(), part.start):
                out[order.one(i)] = forward.real, forward.imag
        return _against(out)


@dataclass(frozen=True)
class RunChains(Chain):
    """Chains of many instants; arrays start with the instants."""

    way: int
    parts: tuple[Hops | Rides, ...]
    marched: bool

    @property
    def solver(self) -> str:
        """Who placed them."""
        return _solver(self.parts, self.marched)

    @classmethod
    def of(cls, links_m: Floats, spent: int, way: int, parts: tuple[Hops | Rides, ...], marched: bool,
           instants: int) -> 'RunChains':
        """Return the chains with their coordinates."""
        order = _Order(links_m.size, way)
        p = np.empty((instants, links_m.size + 1, 2))
        for part in parts:
            if isinstance(part, Rides):
                first = order.first_row(part.spots.row, part.links)
                part.table.fill_many(part.table.places, part.spots, first, p[:, order.some(part.start, part.links)])
                continue
            if not part.start:
                p[:, order.one(0)] = part.walk.points(*part.places)[0]
            p[:, order.one(part.start + 1)] = part.walk.points(*part.following)[0]
        _join(p, links_m, order, parts)
        return cls(read_only(p), links_m, spent, way, parts, marched)

    def velocities(self, head_speed_m_s: float | Floats) -> Floats:
        """Return velocity vectors in m/s, shape (S, N+1, 2)."""
        order, out = _Order(self.links_m.size, self.way), np.empty_like(self.p)
        speed: Floats = -self.way * np.broadcast_to(np.asarray(head_speed_m_s, dtype=np.float64), self.p.shape[:1])
        for part in self.parts:
            if isinstance(part, Hops):
                speed = self._hop(part, speed, order, out)
                continue
            table, spots = part.table, part.spots
            first, some = order.first_row(spots.row, part.links), out[:, order.some(part.start, part.links)]
            scaled = spots._replace(basis=spots.basis * (speed / table.paces(spots))[:, None])
            table.fill_many(table.motions, scaled, first, some)
            speed = np.copysign(np.hypot(*out[:, order.one(part.start + part.links)].T), speed)
        return read_only(out)

    def _hop(self, hops: Hops, speed: Floats, order: _Order, out: Floats) -> Floats:
        here, following = order.one(hops.start), order.one(hops.start + 1)
        link = self.p[:, here] - self.p[:, following]
        one, two = (hops.walk.points(*places)[1] for places in (hops.places, hops.following))
        front, rear = np.sum(link * one, axis=1), np.sum(link * two, axis=1)
        joined = rear == 0
        after: Floats = speed * np.where(joined, 1.0, front) / np.where(joined, 1.0, rear)
        out[:, here], out[:, following] = speed[:, None] * one, after[:, None] * two
        return after

    @property
    def tangents(self) -> Floats:
        """Unit tangents as ``RunChain`` has them."""
        order, out = _Order(self.links_m.size, self.way), np.empty_like(self.p)
        for part in self.parts:
            if isinstance(part, Rides):
                first, some = order.first_row(part.spots.row, part.links), out[:, order.some(part.start, part.links)]
                part.table.fill_many(part.table.motions, part.spots, first, some)
                continue
            for i, places in enumerate((part.places, part.following), part.start):
                out[:, order.one(i)] = part.walk.points(*places)[1]
        return _against(out)


def _join(p: Floats, links_m: Floats, order: _Order, parts: Sequence[Hop | Ride | Hops | Rides]) -> None:
    """Put both handles of a link without length on one point, which a table and the march round apart."""
    for part in parts:
        if isinstance(part, (Hop, Hops)):
            here, following = order.one(part.start), order.one(part.start + 1)
            if not links_m[min(here, following)]:
                p[..., following, :] = p[..., here, :]


def _against(forward: Floats) -> Floats:
    """Return unit vectors against some in the head's way."""
    return read_only(-forward / np.hypot(forward[..., 0], forward[..., 1])[..., None])


def _solver(parts: Sequence[object], marched: bool) -> str:
    """Name who placed a chain: tables, or, where they did not reach all along a run, both, or none."""
    if not any(isinstance(part, (Ride, Rides)) for part in parts):
        return 'walk'
    return 'table+march' if marched else 'table'
