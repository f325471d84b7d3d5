"""The leader's range of travel: how far on and how far back it goes, and when it first gets somewhere.

Where all handles are depends on how far the leader has gone and not on when, so contact is looked for over places; each
new place is further on or further back than all before.
"""
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf

import numpy as np

from dragon_ros.core.chain.commanded import HeadLaw
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.numerics.roots import bracketed_newton, illinois


@dataclass(frozen=True)
class RangeOfTravel:
    """What a leader goes through by its law, from one time to another."""

    law: HeadLaw
    start_s: float
    end_s: float

    def until(self, end_s: float) -> 'RangeOfTravel':
        """Return the range up to an earlier time."""
        return replace(self, end_s=end_s)

    @property
    def _times(self) -> list[float]:
        """Times between which the leader goes one way."""
        return [self.start_s, *(t_s for t_s in self.law.breaks_s if self.start_s < t_s < self.end_s), self.end_s]

    def gone_m(self, t_s: float) -> float:
        """Return how far the leader has gone since t = 0."""
        return float(self.law.travelled_m(t_s)[0])

    def farthest_s(self, sense: int) -> float:
        """Return when the leader is farthest on (``sense`` 1) or back (-1) for the first time."""
        return max(self._times, key=lambda t_s: sense * self.gone_m(t_s))

    @property
    def senses(self) -> list[int]:
        """The senses in which the leader gets beyond where it starts; none where it rests."""
        here = self.gone_m(self.start_s)
        return [sense for sense in (1, -1) if sense * (self.gone_m(self.farthest_s(sense)) - here) > 0]

    def onwards_m(self, t_s: float, sense: int) -> float:
        """Return how far the leader goes on in a sense after a time before it turns or rests, whenever its run ends."""
        here_m, most_m, last_s = self.gone_m(t_s), 0.0, t_s
        for last_s in (break_s for break_s in self.law.breaks_s if break_s > t_s):
            on_m = sense * (self.gone_m(last_s) - here_m)
            if on_m <= most_m:
                return most_m
            most_m = on_m
        return inf if sense * self.law.speed_at_m_s(last_s) > 0 else most_m

    @property
    def reversals(self) -> list[tuple[float, int]]:
        """Times at which the leader turns round, and the sense in which it went before; a rest turns nothing."""
        out, going, turned_s = list[tuple[float, int]](), 0, self.start_s
        for before, after in pairwise(self._times):
            moved = self.gone_m(after) - self.gone_m(before)
            sense = (moved > 0) - (moved < 0)
            if sense and going and sense != going:
                out.append((turned_s, going))
            if sense:
                going, turned_s = sense, after
        return out

    def passages_s(self, places_m: Sequence[float]) -> list[list[float]]:
        """Return all times at which the leader passes each of some places between those at which it may turn."""
        ways = [(before, after, self.gone_m(before), self.gone_m(after)) for before, after in pairwise(self._times)]
        return [[self._passage_s(place, way) for way in ways if min(way[2:]) <= place <= max(way[2:]) and
                 way[2] != place != way[3]] for place in places_m]

    def _passage_s(self, gone_m: float, way: tuple[float, float, float, float]) -> float:
        before, after, one, two = way
        return illinois(lambda t_s: self.gone_m(t_s) - gone_m, before, after, one - gone_m, two - gone_m)

    def arrival_s(self, gone_m: float, sense: int) -> float:
        """Return when the leader first has gone so far, on or back from its start, or else when it is nearest."""
        if isinstance(self.law, Head):
            return float(np.clip(gone_m / self.law.speed_m_s, self.start_s, self.end_s)) if self.law.speed_m_s else (
                self.start_s)

        def beyond(t_s: float) -> tuple[float, float]:
            hi, lo = self.law.travelled_m(t_s)
            return sense * ((hi - gone_m) + lo), sense * self.law.speed_at_m_s(t_s)

        if beyond(self.start_s)[0] >= 0:        # it may rest there for a while
            return self.start_s
        for before, after in pairwise(self._times):
            if beyond(after)[0] >= 0:
                return bracketed_newton(beyond, before, after, 0.5 * (before + after))[0]
        return self.farthest_s(sense)
