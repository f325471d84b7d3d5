"""The space of a contact search: the leader's range of travel, and the chains while the leader moves in one direction.

Handle positions depend on how far the leader has travelled, not on time. The search therefore runs over leader
positions, in increasing or in decreasing order. A position in the domain is the distance travelled by the leader, in
metres. Positions of handles are distances along the track.

A pair that can touch consists of two benches, or of a bench and an edge of the venue's obstacles. Edges are numbered
after the benches and are treated as rectangles of zero width.
"""
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Optional

import numpy as np

from dragon_ros.core.chain.chain import Chain, marched_many, stack
from dragon_ros.core.chain.commanded import HeadLaw, times_between
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of, corner_levers
from dragon_ros.core.model import Simulation
from dragon_ros.core.numerics.roots import bracketed_newton, illinois
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.tracks.segments import BEHIND

if TYPE_CHECKING:       # scenes without a venue do not need this module
    from dragon_ros.core.geometry.venue import Surroundings

_SLACK_M, _PROMISES = 1e-9, 8   # slack of a claim: leader travel in metres, or this many promises if that is more
_KEPT = 6               # number of cached chains; the ends of domains and phases are used repeatedly
_FEW = 12               # up to this number of chains, placing them one by one is faster than placing them together
_MANY = 30              # above this number of chains, tables are built, which are also used for later chains


@dataclass(frozen=True)
class RangeOfTravel:
    """The leader's range of travel under its law, from one time to another."""

    law: HeadLaw
    start_s: float
    end_s: float

    @classmethod
    def of(cls, simulation: Simulation) -> 'RangeOfTravel':
        """Return the range of a whole run."""
        run = simulation.scene.run
        return cls(simulation.scene.head, run.start_s, simulation.end.t_s)

    def until(self, end_s: float) -> 'RangeOfTravel':
        """Return the range up to an earlier time."""
        return replace(self, end_s=end_s)

    @property
    def times_s(self) -> list[float]:
        """Times between which the leader moves in one direction."""
        return times_between(self.law, self.start_s, self.end_s)

    def travel_m(self, t_s: float) -> float:
        """Return the distance travelled by the leader since t = 0."""
        return float(self.law.travelled_m(t_s))

    def farthest_s(self, sense: int) -> float:
        """Return the first time when the leader is furthest forward (``sense`` 1) or furthest back (-1)."""
        return max(self.times_s, key=lambda t_s: sense * self.travel_m(t_s))

    @property
    def senses(self) -> list[int]:
        """The senses in which the leader moves beyond its start; empty if it rests."""
        here = self.travel_m(self.start_s)
        return [sense for sense in (1, -1) if sense * (self.travel_m(self.farthest_s(sense)) - here) > 0]

    def arrival_s(self, travel_m: float, sense: int) -> float:
        """Return when the leader, moving in one sense, first reaches a distance or comes nearest to it."""
        if isinstance(self.law, Head):
            return float(np.clip(travel_m / self.law.speed_m_s, self.start_s, self.end_s)) if self.law.speed_m_s else (
                self.start_s)

        def beyond(t_s: float) -> tuple[float, float]:
            return sense * (self.travel_m(t_s) - travel_m), sense * self.law.speed_at_m_s(t_s)

        if beyond(self.start_s)[0] >= 0:        # the leader may rest at its start for a while
            return self.start_s
        for before, after in pairwise(self.times_s):
            if beyond(after)[0] >= 0:
                return bracketed_newton(beyond, before, after, 0.5 * (before + after))[0]
        return self.farthest_s(sense)


Pair = tuple[int, int]


class SearchDomain:
    """The chains of a scene while its leader moves from ``start_m`` to ``stop_m``; ``states`` counts the samples."""

    def __init__(self, simulation: Simulation, travel: RangeOfTravel, sense: int,
                 progress: Callable[[int], object]) -> None:
        """Cover travel forwards (``sense`` 1) or backwards (-1)."""
        self.scene, self.dragon, self.sense, self.states = simulation.scene, simulation.scene.dragon, sense, 0
        self.simulation, self.leader, self.track = simulation, simulation.model.leader, simulation.model.track
        self._travel, self._tell = travel, progress
        # The errors of handles and of gaps, and what a lower bound on a gap must exceed: the gap's error at two states.
        self.error_m = simulation.promise_m
        self.gap_error_m = 2 * self.error_m * float(np.max(corner_levers(self.dragon)))
        self.tolerance_m = 2 * self.gap_error_m
        self.slack_m = max(_SLACK_M, _PROMISES * self.error_m)
        self._kept: dict[float, Chain] = {}
        stop_s = travel.farthest_s(sense)
        self.start_m, self.stop_m = travel.travel_m(travel.start_s), travel.travel_m(stop_s)

    @cached_property
    def around(self) -> Optional['Surroundings']:
        """The edges of the venue's obstacles, if the scene has a venue."""
        if self.scene.venue is None:
            return None
        from dragon_ros.core.geometry.venue import surroundings_of
        return surroundings_of(self.scene.venue)

    def count(self, states: int) -> None:
        """Count sampled states."""
        self.states += states
        self._tell(states)

    def chain(self, travel_m: float) -> Chain:
        """Return all handles when the leader has travelled a distance; the last few results are cached."""
        if travel_m not in self._kept:
            self._kept = dict([*self._kept.items()][1 - _KEPT:])
            self._kept[travel_m] = self.simulation.model.march(travel_m)
        return self._kept[travel_m]

    def chains(self, travel_m: Floats) -> Chain:
        """Return all handles at many leader positions (M,)."""
        if travel_m.size <= _FEW:
            return stack([self.chain(one) for one in travel_m.tolist()])
        if travel_m.size > _MANY:
            return self.simulation.model.place_many(travel_m)
        return marched_many(self.track, self.dragon.link_lengths_m, self.leader.places(travel_m), self.leader.direction)

    def benches(self, travel_m: float) -> Benches:
        """Return all benches when the leader has travelled a distance."""
        chain = self.chain(travel_m)
        return benches_of(chain, self.dragon, axes_of(chain))

    def phases(self, start_m: float, stop_m: float) -> list[tuple[float, float]]:
        """Split the leader's travel between two positions into parts in which every handle moves in one direction."""
        turns = self.leader.turning_m(start_m, stop_m)[::1 if start_m < stop_m else -1]
        return [] if start_m == stop_m else [*pairwise(dict.fromkeys([start_m, *turns, stop_m]))]

    def along_m(self, travel_m: float) -> Floats:
        """Return the distances (N+1,) of all handles along the track."""
        chain = self.chain(travel_m)
        return self.track.distances(chain.segment, chain.u)

    def travel_at(self, bench: int, along_m: float, within: tuple[float, float]) -> float:
        """Return the distance travelled by the leader when a bench's front handle is ``along_m`` along the track.

        The handle must move in one direction between the two leader positions ``within``. If the handle never reaches
        the distance there, the nearer of these two positions is returned.
        """
        if bench == 0 and self.leader.direction == BEHIND:
            travel_m = self.leader.travel_m(self.track.place_at(along_m))
            return min(max(travel_m, min(within)), max(within))

        def beyond(travel_m: float) -> float:
            return float(self.along_m(travel_m)[bench]) - along_m

        low, high = (beyond(end) for end in within)
        if low == 0 or (low * high > 0 and abs(low) <= abs(high)):
            return within[0]
        return within[1] if high == 0 or low * high > 0 else illinois(beyond, *within, low, high)

    def edge_of(self, pair: tuple[int, int]) -> int | None:
        """Return the edge of a pair, or None for two benches."""
        return pair[1] - self.dragon.benches if pair[1] >= self.dragon.benches else None

    def time_s(self, travel_m: float) -> float:
        """Return when the leader has first travelled a distance."""
        return self._travel.arrival_s(travel_m, self.sense)

    def speed_m_s(self, t_s: float) -> float:
        """Return the leader's speed."""
        return abs(self.scene.head.speed_at_m_s(t_s))

    def travel_m(self, t_s: float) -> float:
        """Return the distance travelled by the leader at a time."""
        return self._travel.travel_m(t_s)
