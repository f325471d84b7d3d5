"""The first contact of a run, by clearing whole stretches of track instead of sampling times.

Benches follow each other on one track at one spacing, so whether bench i >= 1 meets a bench behind it depends only on
where bench i is: the body's whole stretch is cleared once, and the head's pairs along the head's way. Where the body
does not clear, all pairs are followed along the head's way.
"""
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.angle import Angle
from dragon_ros.core.benches import Benches, axes_of, benches_of
from dragon_ros.core.clearing import Clearing, clear
from dragon_ros.core.contact import gaps, witness
from dragon_ros.core.errors import FieldError
from dragon_ros.core.lock import follower, follower_turns, lock_angle
from dragon_ros.core.march import Chain, place
from dragon_ros.core.neighbours import candidates
from dragon_ros.core.root import illinois
from dragon_ros.core.scene import End, Scene
from dragon_ros.core.sweep import Leader, fastest_points
from dragon_ros.core.tiers import EXACT
from dragon_ros.core.types import Floats

_FIRST_M = 0.25         # distance of the places looked at first
_LONGEST_M = 1e5        # of the head's way: 400,000 places
_FINEST_M = 1e-7        # stretches are not halved below this


@dataclass(frozen=True)
class Contact:
    """A first contact: when, between which benches (the inner first), where, and how many states were looked at."""

    t_s: float
    benches: tuple[int, int]
    point_m: tuple[float, float]
    states: int


@dataclass(frozen=True)
class NoContact:
    """The run ended without one."""

    end: End
    states: int


def first_contact(scene: Scene, progress: Callable[[int], object] = lambda states: None) -> Contact | NoContact:
    """Return the first contact of the scene's run, at the exact tier, or how the run ended without one.

    ``progress(states)`` is called with every number of states just looked at. Raises FieldError where the way is so
    long that the search would not end.
    """
    way = _Way(scene, progress)
    found = way.clear(way.head_pairs())
    looks = found.looks
    last = found.hit[1] if found.hit else way.stop
    if scene.dragon.benches > 3:
        body = way.clear_body(last)
        looks += body.looks
        if body.hit:
            found = clear(way.all_pairs, way.start, last, way.radians(_FIRST_M), way.radians(_FINEST_M))
            looks += found.looks
    return way.contact(*found.hit, looks) if found.hit else NoContact(scene.end, looks)


class _Way:
    """The head's way through a run; a place x is -theta of the head where it moves in, theta where it moves out."""

    def __init__(self, scene: Scene, progress: Callable[[int], object]) -> None:
        self.scene, self.dragon, self.spiral, self.progress = scene, scene.dragon, scene.track, progress
        length_m = abs(scene.head.speed_m_s) * (scene.end.t_s - scene.run.start_s)
        if length_m > _LONGEST_M:
            raise FieldError('run.stop_s', scene.run.stop_s, f'the head goes {length_m:.3g} m and no more than '
                             f'{_LONGEST_M:.3g} m can be searched', 'stop earlier, or start later')
        self.effort = EXACT.effort(scene.size_m, scene.length_m)
        self.sign = -1.0 if scene.head.speed_m_s > 0 else 1.0
        self.start, stop = (self.sign * self._theta(t_s) for t_s in (scene.run.start_s, scene.end.t_s))
        # The model's own end is left out by a hair: speeds are infinite at a lock.
        self.stop = stop if scene.end.reason == 'stop' else max(self.start, stop - 1e-12 * (1 + abs(stop)))

    def _theta(self, t_s: float) -> float:
        return self.spiral.inward(*self.scene.head.travelled_m(t_s)).hi

    def radians(self, metres: float) -> float:
        """Return the turn of the head for some metres where it is furthest out."""
        return metres / (self.spiral.b_m * (1 + max(abs(self.start), abs(self.stop))))

    def head_pairs(self) -> Leader:
        return Leader(self.spiral, self.dragon, 0, self.dragon.benches, self.effort, self.progress)

    def clear(self, leader: Leader) -> Clearing:
        return clear(lambda x: leader.closest(self.sign * x)[:2], self.start, self.stop,
                     self.radians(_FIRST_M), self.radians(_FINEST_M))

    def clear_body(self, last: float) -> Clearing:
        """Clear every place where a body bench is between the start and ``last``."""
        places = self.chain(self.start).theta, self.chain(last).theta
        inner = min(float(theta[1]) for theta in places)
        chord = float(self.dragon.head_link_m / self.spiral.b_m)
        head = sorted(self.sign * x for x in (self.start, last))
        turning = follower_turns(lock_angle(chord), head[1], chord)
        if head[0] < turning:
            inner = min(inner, follower(turning, chord))
        outer = max(float(theta[-2]) for theta in places)
        leader = Leader(self.spiral, self.dragon, 1, self.dragon.benches - 1, self.effort, self.progress)
        spacing = _FIRST_M / (self.spiral.b_m * (1 + outer))
        return clear(lambda x: leader.closest(-x)[:2], -outer, -inner, spacing, spacing * _FINEST_M / _FIRST_M)

    def chain(self, x: float) -> Chain:
        return place(self.spiral, self.dragon.link_lengths_m, Angle(self.sign * x, 0.0), self.effort)

    def all_pairs(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the smallest gap of all pairs and a bound on its rate, at each place."""
        rows = []
        for place_ in x.tolist():
            rows.append(self._all_pairs(place_))
            self.progress(1)
        gap, rate = np.array(rows).T
        return gap, rate

    def _all_pairs(self, x: float) -> tuple[float, float]:
        chain, benches = self._benches(x)
        i, j = candidates(chain.p, benches)
        speed = self.spiral.b_m * float(np.hypot(1.0, x))
        fastest = fastest_points(self.spiral.b_m, chain, benches, speed)
        return float(np.min(gaps(benches, i, j), initial=np.inf)), 2 * float(np.max(fastest))

    def _benches(self, x: float) -> tuple[Chain, Benches]:
        chain = self.chain(x)
        return chain, benches_of(chain, self.dragon, axes_of(chain))

    def contact(self, low: float, high: float, looks: int) -> Contact:
        """Return the contact in the bracket (clear, touching]."""
        chain, benches = self._benches(high)
        i, j = candidates(chain.p, benches)
        touching = np.flatnonzero(gaps(benches, i, j) <= 0)
        if low == high:
            touching = touching[[np.argmin(gaps(benches, i[touching], j[touching]))]]
        pairs = [(int(i[n]), int(j[n])) for n in touching]
        x, (inner, outer) = min((self._touch(pair, low, high), pair) for pair in pairs)
        run = self.scene.run
        t_s = run.start_s if x == self.start else self._time(x)
        return Contact(t_s, (inner, outer), witness(self._benches(x)[1], inner, outer).point_m, looks)

    def _touch(self, pair: tuple[int, int], low: float, high: float) -> float:
        """Return where the gap of a pair vanishes in a bracket."""
        def gap(x: float) -> float:
            return float(gaps(self._benches(x)[1], *(np.array([bench]) for bench in pair))[0])
        return high if low == high else illinois(gap, low, high, gap(low), gap(high))

    def _time(self, x: float) -> float:
        return self.spiral.distance_to(self.sign * x) / self.scene.head.speed_m_s


