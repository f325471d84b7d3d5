"""Where pictures and the web view take a dragon from: a scene that is computed, or a bag that was recorded."""
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from dragon_ros.core.benches import Benches, axes_of, benches_of
from dragon_ros.core.contact import Witness, gaps, witness
from dragon_ros.core.errors import InputError
from dragon_ros.core.first_contact import Contact, first_contact
from dragon_ros.core.neighbours import candidates
from dragon_ros.core.path import points
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import state, states, velocity_of
from dragon_ros.core.types import Floats

_AT_ONCE = 64               # states that are computed together
_TRACK_POINTS = 6000
Progress = Callable[[Iterable[Any]], Iterable[Any]]


@dataclass(frozen=True)
class Moment:
    """A dragon at one time: handles (N+1, 2) in m, benches, and speeds (N+1,) in m/s, None where nobody knows them."""

    t_s: float
    p: Floats
    benches: Benches
    speed_m_s: Floats | None

    @property
    def clearance_m(self) -> float:
        """The smallest signed gap of benches that are not neighbours in the chain; inf without any."""
        return float(np.min(gaps(self.benches, *candidates(self.p, self.benches)), initial=np.inf))


@dataclass(frozen=True)
class Touch:
    """A first contact: when, between which benches (inner first), where, and which corner meets which edge."""

    t_s: float
    benches: tuple[int, int]
    point_m: tuple[float, float]
    witness: Witness


class Source(Protocol):
    """A dragon over time."""

    @property
    def name(self) -> str:
        """What pictures call it."""

    @property
    def ticks_s(self) -> Floats:
        """Times (T,) of its ticks."""

    @property
    def track(self) -> Floats | None:
        """Points (P, 2) of the line that it walks, where that is known."""

    def moments(self, times_s: Floats) -> Iterator[Moment]:
        """Yield the dragon at times that grow; what has only ticks gives the tick nearest to each."""

    def first_touch(self, progress: Progress) -> Touch | None:
        """Return the first contact, None if there is none."""


@dataclass(frozen=True)
class SceneSource:
    """A dragon that is computed when it is looked at."""

    name: str
    scene: Scene

    @cached_property
    def ticks_s(self) -> Floats:
        """The run's ticks."""
        run = self.scene.run
        return np.array([run.time_ns(k) for k in range(self.scene.last_tick + 1)]) / NS

    @cached_property
    def track(self) -> Floats:
        """The spiral from the centre to beyond the tail at the start and at the end of the run."""
        run, scene = self.scene.run, self.scene
        ends = (run.start_s, run.time_ns(scene.last_tick) / NS)
        outer = max(float(state(scene, t_s).theta[-1]) for t_s in ends)
        theta: Floats = np.linspace(0.0, outer + np.pi, _TRACK_POINTS)
        return points(scene.track.b_m, theta, np.zeros_like(theta))

    def moments(self, times_s: Floats) -> Iterator[Moment]:
        """Yield the dragon at these times."""
        for first in range(0, len(times_s), _AT_ONCE):
            group = times_s[first:first + _AT_ONCE].tolist()
            chain = states(self.scene, group)
            benches, velocity = benches_of(chain, self.scene.dragon, axes_of(chain)), velocity_of(self.scene, chain)
            speed = np.hypot(velocity[..., 0], velocity[..., 1])
            for n, t_s in enumerate(group):
                one = Benches(benches.centre[n], benches.axis[n], benches.half_length, benches.half_width)
                yield Moment(t_s, chain.p[n], one, speed[n])

    def first_touch(self, progress: Progress = iter) -> Touch | None:
        """Return the first contact of the run, exactly."""
        found = first_contact(self.scene)
        return Touch(found.t_s, found.benches, found.point_m, found.witness) if isinstance(found, Contact) else None


def moment(source: Source, t_s: float) -> Moment:
    """Return the dragon at one time. Raises InputError outside the source's ticks."""
    check_times(source, [t_s])
    return next(source.moments(np.array([t_s])))


def check_times(source: Source, times_s: Iterable[float]) -> None:
    """Raise InputError for a time at which there is nothing to see."""
    first, last = float(source.ticks_s[0]), float(source.ticks_s[-1])
    for t_s in times_s:
        if not first - 1e-9 <= t_s <= last + 1e-9:
            raise InputError(f'--time {t_s:g}: {source.name} goes from {first:g} to {last:g} s; ask for a time between')


def spread(source: Source, start_s: float, stop_s: float, most: int) -> Floats:
    """Return at most ``most`` ticks between two times, both included, evenly spread."""
    ticks = source.ticks_s
    rows = np.flatnonzero((ticks >= start_s - 1e-9) & (ticks <= stop_s + 1e-9))
    if rows.size > most:
        rows = rows[np.unique(np.linspace(0, rows.size - 1, most).round().astype(int))]
    out: Floats = ticks[rows]
    return out


def witness_at(moment: Moment, pair: tuple[int, int]) -> Witness:
    """Return how two benches meet at a moment."""
    return witness(moment.benches, *pair)
