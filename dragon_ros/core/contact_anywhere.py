"""The first contact on any track and for any head law, followed in time over all pairs.

Between two looks at the chain a gap shrinks at most by the time between them times the speeds of the two benches'
fastest points. Those are taken at both looks, where the law does not change between them, with a margin
(``clearing.clear``): that the speeds inside exceed the larger end by no more is tested and not derived, so there is no
certificate.
"""
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from dragon_ros.core import clearing
from dragon_ros.core.benches import Benches, axes_of, benches_of
from dragon_ros.core.chain import Chain
from dragon_ros.core.contact import gaps
from dragon_ros.core.errors import FieldError
from dragon_ros.core.neighbours import candidates
from dragon_ros.core.root import illinois
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state, velocity_of
from dragon_ros.core.types import Floats

_SPACING_M = 0.25       # of the leader's way, between first looks
_FINEST_S = 1e-7
_MOST = 4_000_000
Pair = tuple[int, int]


class Follower:
    """Follows a scene, which must be of the exact tier, in time; ``states`` counts the looks."""

    def __init__(self, scene: Scene, progress: Callable[[int], object]) -> None:
        """Take the time to the end of the run; a lock is left out by a hair, since speeds are infinite there."""
        self.scene, self._tell, self.states = scene, progress, 0
        self.start, stop = scene.run.start_s, scene.end.t_s
        self.stop = stop if scene.end.reason == 'stop' else max(self.start, stop - 1e-9 * (1 + stop))
        self._bend = scene.led.walk.bend if scene.led else 2 / scene.spiral.b_m
        self._reach_m = float(np.max(scene.dragon.bench_lengths_m)) / 2

    def hit(self) -> tuple[float, float] | None:
        """Return (a time without contact, a time with one) around the first contact; None without any."""
        law = self.scene.head
        times = [self.start, *(t_s for t_s in law.breaks_s if self.start < t_s < self.stop), self.stop]
        for before, after in pairwise(times):
            middle = 0.5 * (before + after)
            speed = max(abs(law.speed_at_m_s(t_s)) for t_s in (before, middle, np.nextafter(after, before)))
            if (after - before) * speed > _MOST * _SPACING_M:
                raise FieldError('run.stop_s', self.scene.run.stop_s, f'the leader goes {(after - before) * speed:.3g} '
                                 f'm and no more than {_MOST * _SPACING_M:.3g} m can be searched', 'stop earlier')
            spacing = _SPACING_M / speed if speed else after - before
            found = clearing.clear(self._look, before, after, spacing, _FINEST_S)
            if found.hit:
                return found.hit
        return None

    def benches(self, t_s: float) -> tuple[Chain, Benches]:
        """Return the chain and the rectangles."""
        self.states += 1
        chain = state(self.scene, t_s)
        return chain, benches_of(chain, self.scene.dragon, axes_of(chain))

    def gap(self, pair: Pair, t_s: float) -> float:
        """Return the gap of a pair."""
        return float(gaps(self.benches(t_s)[1], *(np.array([bench]) for bench in pair))[0])

    def touching(self, before: float, after: float) -> list[tuple[float, Pair]]:
        """Return when which pairs that touch at ``after`` begin to, in order."""
        chain, benches = self.benches(after)
        i, j = candidates(chain.p, benches)
        touching = np.flatnonzero(gaps(benches, i, j) <= 0)
        return sorted((self._touch((int(i[n]), int(j[n])), before, after), (int(i[n]), int(j[n]))) for n in touching)

    def _touch(self, pair: Pair, before: float, after: float) -> float:
        if before == after or self.gap(pair, before) <= 0:
            return before
        return illinois(lambda t_s: self.gap(pair, t_s), before, after, self.gap(pair, before), self.gap(pair, after))

    def approach_m_s(self, pair: Pair, t_s: float) -> float:
        """Return how fast the gap closes, from before the contact."""
        step = min(1e-6, 0.5 * (t_s - self.start)) or 1e-6
        early, late = max(self.start, t_s - step), min(self.stop, t_s + step)
        return (self.gap(pair, early) - self.gap(pair, late)) / (late - early)

    def gap_at(self, t_s: float) -> float:
        """Return the smallest gap at a time, in as far as benches are near each other."""
        return float(self._look(np.array([t_s]))[0][0])

    def _look(self, times: Floats) -> tuple[Floats, Floats]:
        """Return the smallest gap of all pairs and a bound on its rate in m/s, at each time."""
        rows = []
        for t_s in times.tolist():
            chain, benches = self.benches(t_s)
            i, j = candidates(chain.p, benches, self._reach_m)
            # Beyond the reach of the candidates all that is known is that every gap exceeds it.
            smallest = float(np.min(gaps(benches, i, j), initial=self._reach_m))
            rows.append((smallest, 2 * float(np.max(self._fastest(chain, benches, t_s)))))
            self._tell(1)
        gap, rate = np.array(rows).T
        return gap, rate

    def _fastest(self, chain: Chain, benches: Benches, t_s: float) -> Floats:
        """Return a bound on the speed of any point of each bench: its faster handle's, and what its turning adds."""
        v = velocity_of(self.scene, chain, t_s)
        handle, difference = np.hypot(v[:, 0], v[:, 1]), np.diff(v, axis=0)
        joined = chain.links_m == 0
        turning = np.where(joined, handle[:-1] * self._bend, np.hypot(difference[:, 0], difference[:, 1])
                           / np.where(joined, 1.0, chain.links_m))
        overhang = np.hypot(benches.half_length - 0.5 * chain.links_m, benches.half_width)
        out: Floats = np.maximum(handle[1:], handle[:-1]) + turning * overhang
        return out
