"""Sources for pictures and the web view: a scene, which is computed, or a bag, which is read."""
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain as joined
from itertools import count, islice
from math import floor, log10
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from dragon_ros.cli.pool import ALONE, Pool
from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.limits import PICTURE_TICKS
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.venue import Venue

if TYPE_CHECKING:       # imported lazily, because a picture of a scene needs at most a few of these modules
    from dragon_ros.bags.read.frames import BagFrame
    from dragon_ros.bags.read.reader import BagReader
    from dragon_ros.core.geometry.near_obstacles import SmallestGap
    from dragon_ros.core.geometry.signed_distance import Witness
    from dragon_ros.core.geometry.tracker import Event
    from dragon_ros.core.search.certificate import Contact, NoContact

_AT_ONCE = 64               # number of states per batch
_SAG_M = 1e-4               # largest deviation (m) of the drawn track, small enough even for a picture of one bench
Progress = Callable[[Iterable[Any]], Iterable[Any]]
Check = Callable[[], None]      # a function that raises an exception if its caller's work is no longer needed
_SAME_S = 1e-9
_AROUND = 2.0               # largest extent of the shown track beyond the dragon, relative to the dragon's size
_VENUE = 0.25           # likewise, of the shown venue beyond the dragon and its track
_MARGIN = 0.03              # margin around the content, relative to the window


@dataclass(frozen=True)
class Moment:
    """A dragon at one time: handles (m, shape (N+1, 2)), benches, and speeds (m/s, shape (N+1,)) or None if unknown."""

    t_s: float
    p: Floats
    benches: Benches
    speed_m_s: Floats | None


@dataclass(frozen=True)
class Touch:
    """A first contact: its time, its benches (inner first), its point, and the corner and the edge that meet.

    If a bench touches an obstacle, ``benches`` contains only this bench, and ``obstacle`` is the obstacle's name.
    ``decimals`` is the number of correct decimals of the point, which is smaller for points interpolated between ticks.
    """

    t_s: float
    benches: tuple[int, ...]
    point_m: tuple[float, float]
    witness: 'Witness'
    decimals: int = 6
    obstacle: str | None = None

    @property
    def words(self) -> str:
        """A phrase that names the parts that touch."""
        if self.obstacle is not None:
            return f'bench {self.benches[0]} touches {self.obstacle}'
        return f'benches {self.benches[0]} and {self.benches[1]} touch'


class Source(Protocol):
    """A dragon over time."""

    @property
    def name(self) -> str:
        """The name of the dragon in pictures."""

    @property
    def span_s(self) -> tuple[float, float]:
        """The times (s) of the first and the last tick."""

    @property
    def track(self) -> Floats | None:
        """Points of the track (m, shape (P, 2)), or None if the track is unknown."""

    @property
    def venue(self) -> Venue | None:
        """The venue, or None if it is unknown or absent."""

    def ticks_s(self, start_s: float, stop_s: float, most: int) -> Floats:
        """Return the times (s) of at most ``most`` evenly spaced ticks between two times, both included."""

    def moments(self, times_s: Floats) -> Iterator[Moment]:
        """Yield the dragon at increasing times; a source with only recorded ticks yields the nearest ticks."""

    @property
    def has_obstacles(self) -> bool:
        """Whether gaps to obstacles count, too."""

    def gaps(self, times_s: Floats) -> Iterator[tuple[float, float]]:
        """Yield the time (s) and the smallest signed gap (m) between benches, or between a bench and an obstacle.

        The times are those of ``moments``.
        """

    def first_touch(self, progress: Progress) -> Touch | None:
        """Return the first contact, or None."""


@dataclass(frozen=True)
class SceneSource:
    """A dragon computed from a scene on demand, by the processes of a pool if this takes long."""

    name: str
    scene: Scene
    pool: Pool = ALONE

    @property
    def span_s(self) -> tuple[float, float]:
        """The times (s) of the run's first and last tick."""
        run = self.scene.run
        return run.seconds(run.start_ns), run.seconds(run.time_ns(compile_scene(self.scene).last_tick))

    @cached_property
    def track(self) -> Floats:
        """The part of the track that handles cover during the run."""
        return compile_scene(self.scene).track_line(_SAG_M)

    @property
    def venue(self) -> Venue | None:
        """The scene's venue."""
        return self.scene.venue

    @property
    def has_obstacles(self) -> bool:
        """Whether the scene has a venue."""
        return self.scene.venue is not None

    def ticks_s(self, start_s: float, stop_s: float, most: int) -> Floats:
        """Return the times (s) of at most ``most`` evenly spaced ticks of the run between two times."""
        run = self.scene.run
        first, last = (run.tick_at(run.stamp_ns(t_s)) for t_s in (start_s, stop_s))
        numbers = thinned(max(0, first + (run.time_ns(first) < run.stamp_ns(start_s))), last, most)
        return np.array([run.seconds(run.time_ns(k)) for k in numbers.tolist()])

    def moments(self, times_s: Floats) -> Iterator[Moment]:
        """Yield the dragon at these times."""
        for group in _groups(times_s):
            yield from moments_of(self.scene, group)

    def gaps(self, times_s: Floats) -> Iterator[tuple[float, float]]:
        """Yield each of these times (s), and the smallest signed gap (m) at that time."""
        yield from joined.from_iterable(self.pool.in_order(partial(_gaps_of, self.scene), _groups(times_s)))

    def searched(self, progress: Progress) -> 'Contact | NoContact':
        """Return the result of the search for the run's first contact."""
        from dragon_ros.core.search.first_contact import first_contact
        steps = iter(progress(count()))
        return first_contact(self.scene, lambda _: next(steps))

    def first_touch(self, progress: Progress = iter) -> Touch | None:
        """Return the exact first contact of the run."""
        found = self.searched(progress)
        if not found:
            return None
        name = found.obstacle.name if found.obstacle else None
        return Touch(found.t_s, found.benches, found.point_m, found.witness, obstacle=name)


def _groups(times_s: Floats) -> list[list[float]]:
    """Return the times in groups; the states of a group are computed together."""
    return [times_s[first:first + _AT_ONCE].tolist() for first in range(0, len(times_s), _AT_ONCE)]


def moments_of(scene: Scene, group: list[float]) -> Iterator[Moment]:
    """Yield the dragon of a scene at the times of one group."""
    chain = states(scene, group)
    benches = benches_of(chain, scene.dragon, axes_of(chain))
    velocity = velocity_of(scene, chain, group)
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    for n, t_s in enumerate(group):
        one = Benches(benches.centre[n], benches.axis[n], benches.half_length, benches.half_width)
        yield Moment(t_s, chain.p[n], one, speed[n])


def smallest_gap(venue: Venue | None = None) -> 'SmallestGap':
    """Return an object that finds smallest gaps in a venue."""
    from dragon_ros.core.geometry.near_obstacles import SmallestGap  # imported lazily, because few pictures need gaps
    if venue is None:
        return SmallestGap()
    from dragon_ros.core.geometry.venue import surroundings_of
    return SmallestGap(surroundings_of(venue))


def _gaps_of(scene: Scene, group: list[float]) -> list[tuple[float, float]]:
    gap = smallest_gap(scene.venue)
    return [(one.t_s, gap.at_m(one.p, one.benches)) for one in moments_of(scene, group)]


def moment(source: Source, t_s: float) -> Moment:
    """Return the dragon at one time. Raises InputError for a time outside the source's ticks."""
    check_times(source, [t_s])
    for one in source.moments(np.array([t_s])):
        return one
    raise InputError(f'{source.name}: it has handles but no benches at {t_s:g} s')


def window(track: Floats | None, moments: Iterable[Moment], venue: Venue | None = None) -> Floats:
    """Return the window of a picture of these moments: its lower left and upper right corners (m, shape (2, 2)).

    The window contains the dragon and its track or, if the track is much longer, the dragon and the track around it,
    and the venue around both.
    """
    corners = np.concatenate([one.benches.corners.reshape(-1, 2) for one in moments])
    low, high = corners.min(axis=0), corners.max(axis=0)
    reach = _AROUND * float(np.max(high - low))
    if track is not None:
        low = np.minimum(low, np.maximum(track.min(axis=0), low - reach))
        high = np.maximum(high, np.minimum(track.max(axis=0), high + reach))
    if venue is not None:
        points = np.array([*(at for one in venue.obstacles for at in one.points_m), *(venue.inside or ())])
        reach = _VENUE * float(np.max(high - low))
        low = np.minimum(low, np.maximum(points.min(axis=0), low - reach))
        high = np.maximum(high, np.minimum(points.max(axis=0), high + reach))
    margin = _MARGIN * float(np.max(high - low))
    return np.array((low - margin, high + margin))


def decimals_of(step_s: float) -> int:
    """Return the number of correct decimals of a point (m) that is interpolated between ticks ``step_s`` apart.

    The error of cubic interpolation is about the fourth power of the step, in units of the bend radius. The third power
    is used, because only a few ticks are available near the start of a run.
    """
    return 6 if step_s <= 0 else min(6, max(0, floor(-3 * log10(step_s))))


def check_times(source: Source, times_s: Iterable[float]) -> None:
    """Raise InputError if any time is outside the source's ticks."""
    first, last = source.span_s
    for t_s in times_s:
        if not first - 1e-9 <= t_s <= last + 1e-9:
            raise InputError(f'--times {t_s:g}: {source.name} has times from {first:g} to {last:g} s; choose a '
                             'time in this range')


def clearances(source: Source, times_s: Floats, progress: Progress) -> tuple[Floats, Floats]:
    """Return times (s) and smallest signed gaps (m), both of shape (T,); a gap is nan if nothing is close."""
    rows = np.array(list(progress(source.gaps(times_s)))).reshape(-1, 2)
    return rows[:, 0], np.where(np.isfinite(rows[:, 1]), rows[:, 1], np.nan)


def thinned(first: int, last: int, most: int) -> Ints:
    """Return the integers from ``first`` to ``last``; if there are more than ``most``, return ``most`` of them.

    The returned integers are evenly spaced and include both ends.
    """
    count = last - first + 1
    return np.linspace(first, last, min(count, most)).round().astype(int) if count > most else np.arange(
        first, last + 1)


def _touch_of(event: 'Event', frame: 'BagFrame', benches: Benches) -> Touch:
    """Return the contact that began with a tick."""
    before_ns = frame.t_ns if event.before_ns is None else event.before_ns
    decimals, around = decimals_of((frame.t_ns - before_ns) / NS), frame.around
    if around is None or not event.obstacle:
        at = Moment(frame.t_ns / NS, frame.handles_m, benches, None)
        return Touch(event.t_contact_s, event.benches, event.point_m, witness_at(at, event.benches), decimals)
    bench, number = event.benches[0], event.benches[1] - len(benches.centre)
    edge = around.nearest_edge(benches, bench, number)
    return Touch(event.t_contact_s, (bench,), event.point_m, around.touch(benches, bench, edge)[1], decimals,
                 event.obstacle)


def witness_at(moment: Moment, pair: tuple[int, int]) -> 'Witness':
    """Return the point, the corner and the edge where two benches meet at a moment."""
    from dragon_ros.core.geometry.signed_distance import witness
    return witness(moment.benches, *pair)


@dataclass(frozen=True)
class BagSource:
    """A dragon at the recorded ticks of one namespace of an open bag; the processes of a pool read long bags."""

    bag: 'BagReader'
    namespace: str
    pool: Pool = ALONE

    @property
    def name(self) -> str:
        """The bag's file name."""
        return self.bag.path.name

    @cached_property
    def _scene(self) -> Scene | None:
        """The scene in the bag, including the walk of a led dragon; None if the bag has no scene."""
        from dragon_ros.bags.read.frames import scene_of_bag, walk_in
        try:
            scene = scene_of_bag(self.bag, self.namespace)
            return scene and walk_in(self.bag, scene, self.namespace).scene
        except InputError:      # the scene exceeds the budgets, but the recording is shown
            return None

    @cached_property
    def track(self) -> Floats | None:
        """The part of the track that handles cover during the run; None if the bag has no scene."""
        return compile_scene(self._scene).track_line(_SAG_M) if self._scene else None

    @property
    def venue(self) -> Venue | None:
        """The venue of the scene in the bag."""
        return self._scene.venue if self._scene else None

    @cached_property
    def _ticks(self) -> list[tuple[int, int]]:
        """The stamp and the log time (ns) of each tick, sorted by stamp."""
        from dragon_ros.bags.read.frames import check_single_run
        from dragon_ros.bags.read.parts import stamps_of
        handles = f'{self.namespace}/handles'
        count = next(topic.messages for topic in self.bag.topics if topic.name == handles)
        if count > PICTURE_TICKS:
            raise InputError(f'{self.bag.path}: it has {count} ticks; pictures can show at most {PICTURE_TICKS}')
        rows = list(islice(stamps_of(self.bag, handles, self.pool.in_order), PICTURE_TICKS))
        ticks = dict(rows)
        if len(ticks) < len(rows):
            check_single_run(self.bag, self.namespace)
        return sorted(ticks.items())

    @cached_property
    def _times_s(self) -> Floats:
        return np.array([stamp for stamp, _ in self._ticks]) / NS

    @property
    def span_s(self) -> tuple[float, float]:
        """The times (s) of the bag's first and last tick."""
        return float(self._times_s[0]), float(self._times_s[-1])

    def ticks_s(self, start_s: float, stop_s: float, most: int) -> Floats:
        """Return the times (s) of at most ``most`` evenly spaced ticks between two times."""
        first = int(np.searchsorted(self._times_s, start_s - _SAME_S))
        last = int(np.searchsorted(self._times_s, stop_s + _SAME_S, 'right')) - 1
        out: Floats = self._times_s[thinned(first, last, most)]
        return out

    def _frames(self, times_s: Floats | None = None) -> Iterator[tuple['BagFrame', Benches]]:
        """Yield the ticks nearest to increasing times (by default, all ticks) that have benches, with the benches."""
        from dragon_ros.bags.read.frames import surrounded_frames
        rows = np.arange(len(self._ticks)) if times_s is None else self._nearest(times_s)
        wanted = {self._ticks[row][0] for row in rows.tolist()}
        first_ns, last_ns = (self._ticks[int(row)][1] for row in (rows[0], rows[-1]))
        for frame in surrounded_frames(self.bag, self.namespace, first_ns, last_ns + 1):
            if frame.benches is not None and frame.t_ns in wanted:
                yield frame, frame.benches

    def _nearest(self, times_s: Floats) -> Ints:
        """Return the numbers of the ticks nearest to the given times, without duplicates."""
        ticks = self._times_s
        after = np.clip(np.searchsorted(ticks, times_s), 0, len(ticks) - 1)
        before = np.maximum(after - 1, 0)
        return np.unique(np.where(times_s - ticks[before] < ticks[after] - times_s, before, after))

    def moments(self, times_s: Floats) -> Iterator[Moment]:
        """Yield the tick nearest to each of the increasing times; skip ticks without benches."""
        for frame, benches in self._frames(times_s):
            speeds = None if frame.velocity_m_s is None else np.hypot(*frame.velocity_m_s.T)
            yield Moment(frame.t_ns / NS, frame.handles_m, benches, speeds)

    def first_touch(self, progress: Progress) -> Touch | None:
        """Return the first contact that a monitor would find in the bag, with a time interpolated between two ticks."""
        from dragon_ros.core.geometry.contacts import Observation
        from dragon_ros.core.geometry.tracker import ContactTracker
        tracker = ContactTracker()
        for frame, benches in progress(self._frames()):
            if frame.around is not tracker.around:
                tracker.surround(frame.around)
            for report in tracker.add(Observation(frame.t_ns, frame.handles_m, benches, frame.frame_id)):
                for event in report.begins:
                    return _touch_of(event, frame, benches)
        return None

    @cached_property
    def has_obstacles(self) -> bool:
        """Whether the bag contains obstacles, including those that the monitor read from a file or a map."""
        from dragon_ros.bags.read.frames import RecordedObstacles
        first = next(self._frames(), None)
        return first is not None and RecordedObstacles(self.bag, self.namespace, first[0].frame_id).some

    def gaps(self, times_s: Floats) -> Iterator[tuple[float, float]]:
        """Yield the time (s) and the smallest signed gap (m) of the ticks that ``moments`` yields."""
        gap = smallest_gap()
        for frame, benches in self._frames(times_s):
            gap.surround(frame.around)
            yield frame.t_ns / NS, gap.at_m(frame.handles_m, benches)


def dragon_in(bag: 'BagReader', namespace: str | None = None, pool: Pool = ALONE) -> BagSource:
    """Return the dragon in a bag. Raises InputError if the namespace is ambiguous or required topics are missing."""
    from dragon_ros.bags.read.frames import namespace_of
    chosen = namespace_of(bag, namespace)
    having = {topic.name for topic in bag.topics if topic.messages}
    for topic in ('handles', 'benches'):
        if f'{chosen}/{topic}' not in having:
            raise InputError(f'{bag.path}: it has no messages on {chosen}/{topic}; pictures need '
                             'handles and benches (scene key effects)')
    return BagSource(bag, chosen, pool)
