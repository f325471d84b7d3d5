"""What the leader goes through in a run: how far on and how far back, and when it first gets somewhere.

Where all handles are depends on how far the leader has gone and not on when, so contact is looked for over places; each
new place is further on or further back than all before.
"""
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.scene import Scene


@dataclass(frozen=True)
class Course:
    """A leader by its law, from one time to another."""

    law: Head | Profile
    start_s: float
    end_s: float

    def until(self, end_s: float) -> 'Course':
        """Return the course up to an earlier time."""
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


def course_of(scene: Scene) -> Course:
    """Return the course of a scene's run."""
    return Course(scene.head, scene.run.start_s, compile_scene(scene).end.t_s)
