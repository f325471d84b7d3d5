"""A chain whose equal links follow each other in runs: each run from a table, the links between marched.

Links are counted from the leader. The head's link may be longer, and a dragon may be of mixed benches. Where a table
does not reach, links are marched until it does.
"""
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, groupby, pairwise
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from dragon_ros.core.dragon import is_even
from dragon_ros.core.errors import ChainLockError
from dragon_ros.core.joined import wound
from dragon_ros.core.march import TIGHT, Effort, locked, near_lock, place
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.placed import BACK
from dragon_ros.core.run_chain import Hop, Hops, Ride, Rides, RunChain, RunChains
from dragon_ros.core.tiers import EXACT, PAPER
from dragon_ros.core.track_rows import track_table
from dragon_ros.core.track_table import TrackTable
from dragon_ros.core.walk import Place, Walk
from dragon_ros.core.walk_many import Places, next_places

if TYPE_CHECKING:
    from dragon_ros.core.scene import Scene

FEWEST = 8              # links, below which marching is faster than a table
_MOST_TABLES = 4
_TRIES = 8              # links of a first run that are marched in search of its table


@dataclass(frozen=True)
class Run:
    """Links ``start`` to ``stop`` from the leader, all of ``link_m``, and the table for them."""

    start: int
    stop: int
    link_m: float
    table: TrackTable | None


@dataclass(frozen=True, eq=False)
class Runs:
    """Chains of links (N,) on a walk, behind a head (``way`` BACK) or ahead of a tail, for handles on a stretch."""

    walk: Walk
    links_m: Floats
    way: int
    stretch_m: tuple[float, float]
    effort: Effort
    error_m: float

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """The runs from the leader on. Each length has one table, the lengths of the longest runs first."""
        links = (self.links_m if self.way == BACK else self.links_m[::-1]).tolist()
        ends = [*accumulate((len(list(group)) for _, group in groupby(links)), initial=0)]
        longest = sorted(((start - stop, links[start]) for start, stop in pairwise(ends) if stop - start >= FEWEST))
        lengths = list(dict.fromkeys(link_m for _, link_m in longest))[:_MOST_TABLES]
        tables = {link_m: track_table(self.walk, link_m, self.stretch_m, self.error_m) for link_m in lengths}
        return tuple(Run(start, stop, links[start], tables.get(links[start])) for start, stop in pairwise(ends))

    @property
    def tables(self) -> list[TrackTable]:
        """The tables."""
        return list({run.link_m: run.table for run in self.runs if run.table}.values())

    def place(self, leader: Place) -> RunChain | None:
        """Return the chain of a leader; None where no table reaches it.

        Raises TrackEndError where there is no track, ChainLockError where a link finds no place.
        """
        parts: list[Hop | Ride] = []
        here, spent, marched, rides = leader, 0, False, 0
        for run in self.runs:
            i = run.start
            while i < run.stop:
                part, more = self._part(run, i, here)
                parts.append(part)
                if isinstance(part, Ride):
                    i, rides = i + part.links, rides + 1
                    here = part.end(self.way) if i < self.links_m.size else here
                    continue
                i, here, spent = i + 1, part.following, spent + more
                marched = marched or run.stop - run.start >= FEWEST
                if not rides and run.table and i - run.start == _TRIES:
                    return None
        return RunChain.of(self.links_m, spent, self.way, tuple(parts), marched) if rides else None

    def _part(self, run: Run, i: int, place: Place) -> tuple[Hop | Ride, int]:
        """Return what comes behind a handle of a run, and evaluations: all of it that a table has, or one link."""
        spot = run.table.spot(place) if run.table else None
        if run.table and spot:
            links = min(run.stop - i, run.table.reach(spot, self.way))
            if links:
                return Ride(i, links, run.table, spot), 0
        following, spent = self._next(place, run.link_m, i)
        return Hop(i, self.walk, place, following), spent

    def _next(self, place: Place, link_m: float, i: int) -> tuple[Place, int]:
        """Return ``walk.next``; all behind a spiral that winds in from afar is on it, and there links may lock."""
        if self.way != BACK or place.piece or not self.walk.afar:
            return self.walk.next(place, link_m, self.way, self.effort.newton)
        u, spent = self.walk.pieces[0].next(place.u, link_m, BACK, self.effort.newton)
        if u.hi == inf:
            raise locked(self.walk.afar, i, place.u.hi, link_m / self.walk.afar.b_m)
        return Place(0, u), spent

    def place_many(self, leaders: Places) -> RunChains:
        """Return the chains of many leaders in one; a run is marched where its table does not serve them all."""
        parts: list[Hops | Rides] = []
        places, spent, marched = leaders, 0, False
        for run in self.runs:
            rides = self._rides(run, places)
            if rides:
                parts.append(rides)
                places = rides.end(self.way) if run.stop < self.links_m.size else places
                continue
            marched = marched or run.stop - run.start >= FEWEST
            for i in range(run.start, run.stop):
                following, more = self._next_many(places, run.link_m, i)
                parts.append(Hops(i, self.walk, places, following))
                places, spent = following, spent + more
        return RunChains.of(self.links_m, spent, self.way, tuple(parts), marched, leaders[0].size)

    def _next_many(self, places: Places, link_m: float, i: int) -> tuple[Places, int]:
        """Return ``_next`` of many."""
        try:
            return next_places(self.walk, places, link_m, self.way, self.effort.newton)
        except ChainLockError as error:
            assert self.walk.afar
            raise locked(self.walk.afar, i, error.fields['theta_rad'], link_m / self.walk.afar.b_m) from None

    def _rides(self, run: Run, places: Places) -> Rides | None:
        """Return a run behind many places; None where the table does not have all of it."""
        if not run.table:
            return None
        spots, known = run.table.spots(places)
        last = spots.row - self.way * (run.stop - run.start)
        whole = np.all(known & (last >= 0) & (last < run.table.rows))
        return Rides(run.start, run.stop - run.start, run.table, spots) if whole else None


def runs_of(scene: 'Scene') -> Runs | None:
    """Return the runs of a scene on pieces, behind a tail or of mixed benches, with tables over the places of its run.

    None elsewhere, where it asks for the march, and where nothing ends the run.
    """
    links, open_ended = scene.dragon.link_lengths_m, scene.run.stop_s is None and scene.limit is None
    if scene.solver == 'march' or scene.tier is PAPER or open_ended or links.size < FEWEST:
        return None
    extent = scene.head.extent_m(scene.end.t_s)
    if scene.led:
        work = scene.effort, scene.tier.series_m(scene.size_m)
        return Runs(scene.led.walk, links, scene.led.way, scene.led.span_m(extent), *work)
    return None if is_even(links) else _on_spiral(scene, links, extent)


def _on_spiral(scene: 'Scene', links_m: Floats, extent_m: tuple[float, float]) -> Runs:
    """Return the runs behind a head that goes between two distances; ``march.near_lock`` tells how exact they are."""
    spiral, walk = scene.spiral, wound(scene.spiral, 0.0)
    tail = place(spiral, links_m, spiral.inward(extent_m[0]), scene.effort).theta[-1]
    stretch_m = walk.distance_of(Place.of(0, tail, 0.0))[0], min(extent_m[1], walk.end_m)
    close = spiral.inward(stretch_m[1]).hi <= near_lock(spiral, links_m)
    effort, tier = (Effort(TIGHT), EXACT) if close else (scene.effort, scene.tier)
    return Runs(walk, links_m, BACK, stretch_m, effort, tier.series_m(scene.size_m))
