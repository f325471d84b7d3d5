"""Track the contacts of a dragon tick by tick, and bracket each in time: the monitor without its ROS part.

A tracker receives only ticks. For each contact, the tracker reports the last tick without contact, the first tick
with contact, and the time between them at which the signed gap, interpolated through the latest ticks, vanishes. Each
episode of a pair has a start, a deepest gap and an end. If the surroundings are known, obstacles are included; they
are numbered after the benches.

Observations may arrive late, more than once or from a restarted run; ``ReorderBuffer`` passes them on in order.
``Episodes`` holds the open contacts of all pairs as arrays: the pairs, the deepest gaps with their times, and whether
the contacts were reported.
"""
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, prod
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from dragon_ros.core.geometry.contacts import Closeness, Observation, Pair
from dragon_ros.core.geometry.near_obstacles import NearObstacles
from dragon_ros.core.geometry.near_pairs import TOUCH_M, NearPairs
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import gap_of, witness
from dragon_ros.core.geometry.venue import Surroundings
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Floats, Ints

NS = 10**9
NEAR_M = 0.02           # a smaller clearance triggers a warning
MOST_REPORTED = 32      # maximum number of episodes reported at a time; the deepest are reported first
_SHOWN = 8
_UNEVEN = 4             # largest ratio between the time steps of ticks that are interpolated together

_KEY = 2**32        # a pair (i, j) has the key i * _KEY + j
_LAST = 8           # number of latest observations; an observation newer than the oldest of them may merely be delayed
_LATE_NS = 10**9    # the longest time by which an observation may be late
_IN_A_ROW = 3       # number of consecutive late observations that indicates a restarted run

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Event:
    """The start of a contact: benches (inner first), bracket (ns), interpolated time (s), point (m) and gap (m).

    If the second member of the pair is an obstacle, ``obstacle`` is its name.

    ``before_ns`` is None if the contact already existed when it could first be observed. ``gap_m`` is the signed gap at
    ``after_ns``, which is negative for overlap. ``approach_m_s`` is the rate at which the gap shrank at the contact;
    nan if it is unknown.
    """

    benches: Pair
    before_ns: int | None
    after_ns: int
    t_contact_s: float
    point_m: tuple[float, float]
    gap_m: float
    approach_m_s: float
    frame_id: str = ''
    obstacle: str = ''


PARTED, RESTART, VENUE = 'parted', 'restart', 'venue'


@dataclass(frozen=True)
class EpisodeEnd:
    """The end of a contact: benches, deepest signed gap (m) of all ticks, its time (ns), and interpolated end time (s).

    ``cause`` is PARTED if the benches parted, RESTART if time restarted, and VENUE if the venue changed. After
    RESTART and VENUE, ``t_end_s`` is the time of the last observed tick.
    """

    benches: Pair
    after_ns: int
    deepest_gap_m: float
    deepest_ns: int
    t_end_s: float
    cause: str
    frame_id: str = ''
    obstacle: str = ''


@dataclass(frozen=True)
class Report:
    """The result of one observation.

    ``clearance_m`` is the smallest signed gap of all benches that are not neighbours (inf if there are none), and
    ``closest`` is the pair with this gap. ``touching`` holds up to 8 of all ``count`` pairs in contact, deepest
    first. ``more`` is the number of new contacts that are not in ``begins``, because ``MOST_REPORTED`` was reached.
    The obstacles of ``around`` are included.
    """

    observation: Observation
    clearance_m: float
    closest: Pair | None
    touching: tuple[Pair, ...] = ()
    count: int = 0
    begins: tuple[Event, ...] = ()
    ends: tuple[EpisodeEnd, ...] = ()
    more: int = 0
    around: Surroundings | None = None

    def obstacle(self, pair: Pair) -> str:
        """Return the name of the obstacle in a pair; empty for two benches."""
        return _obstacle(self.around, self.observation, pair)

    def two(self, pair: Pair) -> tuple[Benches, int, int]:
        """Return the rectangles of a pair, which may be a bench and the nearest edge of an obstacle."""
        benches = self.observation.benches
        return self.around.two(benches, pair) if self.around else (benches, *pair)


def _obstacle(around: Surroundings | None, observation: Observation, pair: Pair) -> str:
    number = pair[1] - len(observation.benches.centre)
    return around.names[number] if around and number >= 0 else ''


class _Timed(Protocol):
    @property
    def t_ns(self) -> int: ...

    @property
    def p(self) -> Floats: ...


T = TypeVar('T', bound=_Timed)


class ReorderBuffer(Generic[T]):
    """Passes on observations in order, drops late and repeated observations, and restarts if time goes backwards."""

    def __init__(self) -> None:
        """Start without observations."""
        self._times: deque[int] = deque(maxlen=_LAST)
        self._shape: tuple[int, ...] = ()
        self._late: list[T] = []

    def take(self, observation: T) -> tuple[bool, list[T]]:
        """Return whether time restarts, and the observations that must be examined now, in order.

        Time restarts if the number of handles changes, or if an observation is older than the last few observations
        or more than a second late. It also restarts after several late observations in a row; these are then passed
        on, so that no part of a restarted run is lost.
        """
        if not self._times or observation.p.shape != self._shape:
            return self._pass(bool(self._times), [observation])
        if observation.t_ns > self._times[-1]:
            return self._pass(False, [observation])
        if observation.t_ns < max(self._times[0], self._times[-1] - _LATE_NS):
            return self._pass(True, [observation])
        return self._hold(observation)

    def _hold(self, observation: T) -> tuple[bool, list[T]]:
        repeated = observation.t_ns == self._times[-1] or (self._late and observation.t_ns == self._late[-1].t_ns)
        if not repeated:
            grows = self._late and observation.t_ns > self._late[-1].t_ns
            self._late = [*self._late, observation] if grows else [observation]
        return self._pass(True, self._late) if len(self._late) >= _IN_A_ROW else (False, [])

    def _pass(self, afresh: bool, observations: list[T]) -> tuple[bool, list[T]]:
        if afresh:
            self._times.clear()
        self._times.extend(observation.t_ns for observation in observations)
        self._shape, self._late = observations[-1].p.shape, []
        return afresh, observations


@dataclass(frozen=True)
class Episodes:
    """Pairs that touch, in order of ``key`` (M,): deepest gaps (m), their times (ns), and whether each was reported."""

    key: Ints
    deepest_m: Floats
    deepest_ns: Ints
    reported: Bools

    def some(self, which: Bools) -> 'Episodes':
        """Return a subset of the episodes."""
        return Episodes(self.key[which], self.deepest_m[which], self.deepest_ns[which], self.reported[which])

    def advance(self, t_ns: int, key: Ints, gap_m: Floats) -> tuple['Episodes', Bools, Bools]:
        """Return the episodes at ``t_ns``, whether each of them is new, and whether each previous episode has ended.

        ``key`` (K,) holds the distinct pairs that touch now, in ascending order, and ``gap_m`` (K,) holds their gaps.
        """
        if np.array_equal(key, self.key):
            deeper, none = gap_m < self.deepest_m, np.zeros(key.size, bool)
            return Episodes(key, np.where(deeper, gap_m, self.deepest_m), np.where(deeper, t_ns, self.deepest_ns),
                            self.reported), none, none
        _, old, now = np.intersect1d(self.key, key, assume_unique=True, return_indices=True)
        deepest, times = gap_m.copy(), np.full(key.size, t_ns, dtype=np.int64)
        reported, new, ended = np.zeros(key.size, bool), np.ones(key.size, bool), np.ones(self.key.size, bool)
        keep = self.deepest_m[old] <= gap_m[now]
        deepest[now[keep]], times[now[keep]] = self.deepest_m[old[keep]], self.deepest_ns[old[keep]]
        reported[now], new[now], ended[old] = self.reported[old], False, False
        return Episodes(key, deepest, times, reported), new, ended


def no_episodes() -> Episodes:
    """Return the state without contacts."""
    none = np.empty(0, np.int64)
    return Episodes(none, np.empty(0), none, np.empty(0, bool))


class ContactTracker:
    """Examines observations in chronological order, and reports when the contacts of each pair start and end."""

    def __init__(self) -> None:
        """Start without observations."""
        self._near = NearPairs()
        self._seen, self._open = list[Observation](), no_episodes()
        self._buffer: ReorderBuffer[Observation] = ReorderBuffer()
        self._ended: tuple[EpisodeEnd, ...] = ()
        self._obstacles: NearObstacles | None = None

    @property
    def around(self) -> Surroundings | None:
        """The surroundings; None if none are known."""
        return self._obstacles.around if self._obstacles else None

    def surround(self, around: Surroundings | None) -> None:
        """Use these surroundings for later observations. Contacts with obstacles of previous surroundings end.

        New surroundings with the same names are treated as the previous surroundings in a new position.
        """
        same = around and self.around and around.names == self.around.names
        if self._seen and self._open.key.size and not same:
            last = self._seen[-1]
            old = self._open.key % _KEY >= len(last.benches.centre)
            self._ended += self._ends(last, old & self._open.reported, VENUE)
            self._open = self._open.some(~old)
        self._obstacles = NearObstacles(around) if around else None

    def expect(self, observations: Sequence[Observation]) -> None:
        """Prepare for observations that will be added next, in this order; this saves time."""
        self._near.expect([observation.benches for observation in observations])

    def add(self, observation: Observation) -> list[Report]:
        """Return the reports of an observation, or an empty list if the observation is late or repeated.

        The tracker restarts if time goes backwards or the dragon changes. Raises CrowdError if too many benches are
        close together.
        """
        afresh, observations = self._buffer.take(observation)
        if afresh:
            self._ended += self._ends(self._seen[-1], self._open.reported, RESTART) if self._seen else ()
            self._restart()
        return [self._report_on(each) for each in observations]

    def _restart(self) -> None:
        self._seen, self._open = [], no_episodes()

    def _report_on(self, observation: Observation) -> Report:
        found = self._near.look(observation.p, observation.benches)
        if self._obstacles:
            found = self._obstacles.look(found, observation.benches)
        if self._open.key.size or found.i.size:
            report = self._episodes(observation, found)
        else:
            report = Report(observation, found.clearance_m, found.closest, ends=self._ended, around=self.around)
        self._ended, self._seen = (), [*self._seen[-2:], observation]
        return report

    def _episodes(self, observation: Observation, found: Closeness) -> Report:
        """Update the episodes with the pairs that touch now."""
        key = found.i * _KEY + found.j
        order = np.argsort(key)
        now, new, ended = self._open.advance(observation.t_ns, key[order], found.gap_m[order])
        touching = self._pairs(key[:_SHOWN])
        if not (np.any(new) or np.any(ended)):
            self._open = now
            return Report(observation, found.clearance_m, found.closest, touching, key.size, ends=self._ended,
                          around=self.around)
        ends = self._ends(observation, ended & self._open.reported, PARTED)
        deepest = np.argsort(order)
        begun = deepest[new[deepest]]
        room = MOST_REPORTED - int(np.sum(now.reported))
        begins = tuple(self._event(observation, pair, float(found.gap_m[order[n]])) for n, pair in
                       zip(begun[:room], self._pairs(now.key[begun[:room]]), strict=True))
        reported = now.reported.copy()
        reported[begun[:room]] = True
        self._open = Episodes(now.key, now.deepest_m, now.deepest_ns, reported)
        return Report(observation, found.clearance_m, found.closest, touching, key.size, begins,
                      (*self._ended, *ends), max(0, begun.size - room), self.around)

    @staticmethod
    def _pairs(key: Ints) -> tuple[Pair, ...]:
        return tuple(divmod(k, _KEY) for k in key.tolist())

    def _ends(self, observation: Observation, which: Bools, cause: str) -> tuple[EpisodeEnd, ...]:
        """Return the ends of episodes; ``observation`` is the first without contact, or the last before a restart."""
        rows, open_ = np.flatnonzero(which), self._open
        return tuple(EpisodeEnd(
            pair, observation.t_ns, float(open_.deepest_m[n]), int(open_.deepest_ns[n]),
            self._crossing(observation, pair)[0] if cause == PARTED else observation.t_ns / NS, cause,
            observation.frame_id, _obstacle(self.around, observation, pair))
            for n, pair in zip(rows, self._pairs(open_.key[rows]), strict=True))

    def _event(self, observation: Observation, pair: Pair, gap: float) -> Event:
        name = _obstacle(self.around, observation, pair)
        before = self._seen[-1] if self._seen else None
        if before and name and self._gap_m(before, pair) <= TOUCH_M:     # the obstacle was unknown until now
            before = None
        t_s, slope = self._crossing(observation, pair) if before else (observation.t_ns / NS, nan)
        known = [*self._even(observation), observation] if before else [observation]
        benches = _interpolated(known, t_s)
        point = witness(*(self.around.two(benches, pair) if self.around else (benches, *pair))).point_m
        return Event(pair, before.t_ns if before else None, observation.t_ns, t_s, point, gap, -slope,
                     observation.frame_id, name)

    def _gap_m(self, observation: Observation, pair: Pair) -> float:
        """Return the signed gap of a pair."""
        number = pair[1] - len(observation.benches.centre)
        if number < 0:
            return gap_of(observation.benches, *pair)
        assert self.around
        return self.around.gap_to(observation.benches, pair[0], number)

    def _crossing(self, observation: Observation, pair: Pair) -> tuple[float, float]:
        """Return the time after the last tick at which a pair's gap vanished, and the slope in m/s (nan if unknown)."""
        if not self._seen:
            return observation.t_ns / NS, nan
        known = [*self._even(observation), observation]
        gap = [self._gap_m(one, pair) for one in known]
        origin = self._seen[-1].t_ns
        span = [(one.t_ns - origin) / NS for one in known]
        curve = np.poly1d(np.polyfit(span, gap, len(known) - 1))
        crosses = (gap[-2] > 0) != (gap[-1] > 0)
        root = illinois(lambda t: float(curve(t)), 0.0, span[-1], gap[-2], gap[-1]) if crosses and gap[-1] else span[-1]
        return origin / NS + root, float(curve.deriv()(root))

    def _even(self, observation: Observation) -> list[Observation]:
        """Return the previous observations whose time steps are similar to the latest time step."""
        out, step = [self._seen[-1]], observation.t_ns - self._seen[-1].t_ns
        for one in reversed(self._seen[:-1]):
            if not step <= _UNEVEN * (out[0].t_ns - one.t_ns) <= _UNEVEN**2 * step:
                break
            out = [one, *out]
        return out


def _interpolated(known: list[Observation], t_s: float) -> Benches:
    """Return the benches at a time, with centres and axes from Lagrange polynomials through several observations."""
    last = known[-1].benches
    at = [(one.t_ns - known[-1].t_ns) / NS for one in known]
    t = t_s - known[-1].t_ns / NS
    weights = [prod((t - other) / (own - other) for other in at if other != own) for own in at]
    centre: Floats = np.sum([weight * one.benches.centre for weight, one in zip(weights, known, strict=True)], axis=0)
    axis: Floats = np.sum([weight * one.benches.axis for weight, one in zip(weights, known, strict=True)], axis=0)
    return Benches(centre, axis / np.hypot(axis[:, 0], axis[:, 1])[:, None], last.half_length, last.half_width)
