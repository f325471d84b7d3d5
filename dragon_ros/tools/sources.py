"""Where pictures and the web view take a dragon from: a scene that is computed, or a bag that was recorded."""
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from dragon_ros.core.benches import Benches, axes_of, benches_of
from dragon_ros.core.contact.broad_phase import candidates
from dragon_ros.core.contact.certificate import Contact
from dragon_ros.core.contact.first_contact import first_contact
from dragon_ros.core.contact.signed_distance import Witness, gaps, witness
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.outline import outline
from dragon_ros.core.path import points
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import state, states, velocity_of

_AT_ONCE = 64               # states that are computed together
_EACH_RAD = 12              # points of the drawn track
_MOST_TRACK_RAD = 2000
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
    def span_s(self) -> tuple[float, float]:
        """Times of its first and last tick."""

    @property
    def track(self) -> Floats | None:
        """Points (P, 2) of the line that it walks, where that is known."""

    def ticks_s(self, start_s: float, stop_s: float, most: int) -> Floats:
        """Return at most ``most`` ticks between two times, both included, evenly spread."""

    def moments(self, times_s: Floats) -> Iterator[Moment]:
        """Yield the dragon at times that grow; what has only ticks gives the tick nearest to each."""

    def first_touch(self, progress: Progress) -> Touch | None:
        """Return the first contact, None if there is none."""


@dataclass(frozen=True)
class SceneSource:
    """A dragon that is computed when it is looked at."""

    name: str
    scene: Scene

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the run's first and last tick."""
        run = self.scene.run
        return run.start_ns / NS, run.time_ns(self.scene.last_tick) / NS

    @cached_property
    def track(self) -> Floats:
        """The track that the run walks; a spiral from the centre to beyond the tail at the run's ends."""
        if self.scene.led:
            return outline(self.scene)
        b_m = self.scene.spiral.b_m
        outer = max(float(np.hypot(*state(self.scene, t_s).p[-1])) for t_s in self.span_s) / b_m
        theta: Floats = np.linspace(0.0, outer + np.pi, 2000 + int(min(outer, _MOST_TRACK_RAD) * _EACH_RAD))
        return points(b_m, theta, np.zeros_like(theta))

    def ticks_s(self, start_s: float, stop_s: float, most: int) -> Floats:
        """Return at most ``most`` of the run's ticks between two times, evenly spread."""
        run = self.scene.run
        first, last = (run.tick_at(round(t_s * NS)) for t_s in (start_s, stop_s))
        numbers = thinned(max(0, first + (run.time_ns(first) < round(start_s * NS))), last, most)
        return np.array([run.time_ns(k) for k in numbers.tolist()]) / NS

    def moments(self, times_s: Floats) -> Iterator[Moment]:
        """Yield the dragon at these times."""
        for first in range(0, len(times_s), _AT_ONCE):
            group = times_s[first:first + _AT_ONCE].tolist()
            chain = states(self.scene, group)
            benches = benches_of(chain, self.scene.dragon, axes_of(chain))
            velocity = velocity_of(self.scene, chain, group)
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
    for one in source.moments(np.array([t_s])):
        return one
    raise InputError(f'{source.name}: has handles but no benches at {t_s:g} s')


def check_times(source: Source, times_s: Iterable[float]) -> None:
    """Raise InputError for a time at which there is nothing to see."""
    first, last = source.span_s
    for t_s in times_s:
        if not first - 1e-9 <= t_s <= last + 1e-9:
            raise InputError(f'--time {t_s:g}: {source.name} goes from {first:g} to {last:g} s; ask for a time between')


def clearances(source: Source, times_s: Floats, progress: Progress) -> tuple[Floats, Floats]:
    """Return times (T,) and the smallest signed gap in m at each (T,), nan where no bench is near another."""
    rows = np.array([(one.t_s, one.clearance_m) for one in progress(source.moments(times_s))]).reshape(-1, 2)
    return rows[:, 0], np.where(np.isfinite(rows[:, 1]), rows[:, 1], np.nan)


def thinned(first: int, last: int, most: int) -> Ints:
    """Return the whole numbers from first to last, or ``most`` of them, evenly spread, with both ends."""
    count = last - first + 1
    return np.linspace(first, last, min(count, most)).round().astype(int) if count > most else np.arange(
        first, last + 1)


def witness_at(moment: Moment, pair: tuple[int, int]) -> Witness:
    """Return how two benches meet at a moment."""
    return witness(moment.benches, *pair)
