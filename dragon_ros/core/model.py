"""The model that is compiled from a scene, and the simulation that maps times to the distances that the model uses.

A ``Model`` depends only on the scene's dragon, track, leader and solver. It provides the positions of all
handles at each distance travelled by the leader, and the leader's range of travel. A ``Simulation`` adds the head law
and the run, whose only effect is to determine the distance at each tick. Positions are therefore bit-identical across
runs and processes, and scenes that differ only in head law, run or effects share one model.
"""
from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from math import floor, inf
from threading import Lock
from types import SimpleNamespace
from typing import Any

import numpy as np

from dragon_ros.core import paper
from dragon_ros.core.chain.chain import Chain, marched
from dragon_ros.core.chain.commanded import times_between
from dragon_ros.core.chain.dragon import AnyDragon
from dragon_ros.core.chain.leader import Leader
from dragon_ros.core.chain.lock import head_lock_angle
from dragon_ros.core.domain import COORDINATE, TIME, TRACK
from dragon_ros.core.errors import ChainLockError, FieldError, ModelEnd, TrackEndError
from dragon_ros.core.flags import switches
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.promise import check_request, promise_m, speed_promise
from dragon_ros.core.scene import LATEST_S, NS, Scene
from dragon_ros.core.shift_map.blocks import Placement, lengths_with_maps
from dragon_ros.core.shift_map.table import ShiftMap
from dragon_ros.core.tracks.composite import SAG_M, Track, least_radius_m, track_of
from dragon_ros.core.tracks.segments import AHEAD, BEHIND
from dragon_ros.core.tracks.spec import STurn, TrackSpec

BEFORE_LOCK_M = 1e-6    # a run ends this far before a lock, where speeds grow without bound
_MOST_SIMULATIONS = 64              # maximum number of cached simulations
_MOST_BYTES_AHEAD = 256_000_000     # memory limit for the tables of a model that are built in advance
# The memory limit for the tables of all cached models; the least recently used models are dropped first.
_MOST_BYTES = 1_000_000_000


@dataclass(frozen=True)
class TravelEnd:
    """An end of the leader's range: its distance (m), its reason ('lock' or 'track'), and the link that locks."""

    travel_m: float
    reason: str
    link: int | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """A function that maps the distance travelled by the leader to the positions of all handles."""

    dragon: AnyDragon
    spec: TrackSpec
    lead: str
    solver: str

    @cached_property
    def direction(self) -> int:
        """The direction of the followers: BEHIND the head, or AHEAD of the tail."""
        return AHEAD if self.lead == 'tail' else BEHIND

    @cached_property
    def track(self) -> Track:
        """The track in the plane; if the tail leads, a spiral ends where the head starts. Raises FieldError."""
        return track_of(self.spec, self.direction)

    @cached_property
    def links_m(self) -> Floats:
        """The distance between the two handles of each bench (m, shape (N,))."""
        return self.dragon.link_lengths_m

    @cached_property
    def length_m(self) -> float:
        """The length of the whole chain from the first handle to the last, in metres."""
        return float(np.sum(self.links_m))

    @cached_property
    def leader(self) -> Leader:
        """The leader on the track. Raises FieldError if a bend is too tight or the start is off the track."""
        if isinstance(self.spec, STurn):
            self.spec.check_arcs(least_radius_m(self.links_m))
        return Leader(self.track, self.links_m, self.spec.start_m, self.direction)

    @cached_property
    def placement(self) -> Placement:
        """The solver that places the handles: shift maps for blocks of equal links, or the march."""
        lengths = {} if self.solver == 'march' else lengths_with_maps(self.links_m)
        maps = {link_m: ShiftMap(self.track, link_m, links, self.direction)
                for link_m, links in lengths.items()}
        return Placement(self.track, self.links_m, self.direction, maps)

    @property
    def memory_bytes(self) -> int:
        """The memory used by the tables built so far, in bytes."""
        return self.placement.memory_bytes if 'placement' in vars(self) else 0      # not laid out just to be measured

    def place(self, travel_m: float) -> Chain:
        """Return the chain after the leader has travelled a distance (m). Raises ModelEnd if there is no chain."""
        return self.placement.place(self.leader.place(travel_m))

    def place_many(self, travel_m: Floats, out: Floats | None = None) -> Chain:
        """Return the chains at S distances as one Chain.

        The chains agree with chains that are placed one by one to within the promise, but not bit for bit. If given,
        ``out`` (shape (S, N+1, 2)) receives the handle positions.
        """
        return self.placement.place_many(self.leader.places(travel_m), out)

    def march(self, travel_m: float) -> Chain:
        """Return the chain, computed by forward placement without shift maps."""
        return marched(self.track, self.links_m, self.leader.place(travel_m), self.direction)

    @cached_property
    def limits(self) -> tuple[TravelEnd | None, TravelEnd | None]:
        """The ends of the leader's range, backwards and forwards; None if there is no end. Raises ChainLockError."""
        back_m, onwards_m = self.leader.range_m
        if not self.track.may_lock:
            back, onwards = (TravelEnd(travel_m, 'track') if abs(travel_m) < inf else None
                             for travel_m in (back_m, onwards_m))
            return back, onwards
        spiral = self.track.from_afar
        assert spiral
        curve = spiral.curve
        angle, link = head_lock_angle((self.links_m / curve.b_m).tolist())
        lock_m = curve.distance_to(angle) - BEFORE_LOCK_M
        if angle and lock_m < 0:
            raise ChainLockError(
                f'the chain is locked from the start: link {link} cannot be placed while the head is closer to '
                f'the centre than {curve.b_m * angle:.6g} m; give a larger track.start_turns or track.pitch_m, or '
                'shorter benches', link=link, radius_m=curve.b_m * angle, t_s=0.0)
        if not angle:
            return None, TravelEnd(curve.length_m, 'track')
        return None, TravelEnd(lock_m, 'lock', link)


@dataclass(frozen=True)
class End:
    """The end of a run: its time, its reason ('stop', 'lock' or 'track') and the link that locks."""

    t_s: float
    reason: str
    link: int | None = None

    @property
    def words(self) -> str:
        """A clause that states the reason."""
        return {'stop': 'the run stops', 'lock': f'the chain locks at link {self.link}',
                'track': 'the track ends'}[self.reason]


@dataclass(frozen=True, eq=False)
class Simulation:
    """A scene with its model; it determines the end of the run, and the chain at any time."""

    scene: Scene
    model: Model

    @cached_property
    def on(self) -> SimpleNamespace:
        """Whether each effect is on, by name."""
        return switches(self.scene.effects)

    @cached_property
    def size_m(self) -> float:
        """A bound on the size of all coordinates that occur in this run, in metres."""
        return self.model.leader.size_m(self._travel_m)

    @cached_property
    def _longest_m(self) -> float:
        """The largest coordinate along the track that occurs in this run, in metres (see ``Leader.longest_m``)."""
        return self.model.leader.longest_m(self._travel_m)

    @cached_property
    def _travel_m(self) -> tuple[float, float]:
        """The range that the leader may travel in this run; without a stop, the whole track ahead counts."""
        run, law = self.scene.run, self.scene.head
        if self.scene.is_led:
            least, most = 0.0, 0.0      # a led dragon is judged where it starts, and on the track ahead
        else:
            least, most = law.extent_m(run.start_s if run.stop_s is None else run.stop_s)
        ahead_m = self.model.leader.range_m[1]
        return least, ahead_m if run.stop_s is None and ahead_m < inf else most

    def check_world(self) -> None:
        """Raise FieldError if handles may leave the world in this run."""
        if self.size_m > COORDINATE.high:
            raise FieldError('track', f'{self.size_m:.6g} m', 'handles would be so far from the origin; the world ends '
                             f'at {COORDINATE.high:g} m', 'stop the run earlier, or move or shorten the track')
        if self._longest_m > 2 * TRACK.high:      # the longest track and the longest dragon on it
            raise FieldError('track', f'{self._longest_m:.6g} m', 'the run would reach so far along the track; '
                             f'the limit is {2 * TRACK.high:g} m', 'stop the run earlier, or shorten the track')

    @cached_property
    def is_paper(self) -> bool:
        """Whether handles are placed by the paper's recipe, which makes no promise."""
        return self.scene.solver == 'paper'

    @cached_property
    def promise_m(self) -> float:
        """The largest position error allowed in this scene away from a lock, in metres; infinite for the paper."""
        if self.is_paper:
            return inf
        return promise_m(max(self._longest_m, self.size_m), self.size_m)

    def speed_promise(self, ratio: Any, lag: Any) -> Any:
        """Return the promised error of speeds, relative to the leader's (``promise.speed_promise``)."""
        track, mean_m = self.model.track, self.model.length_m / self.scene.dragon.benches
        lock_m = 4 * track.from_afar.curve.b_m if track.may_lock and track.from_afar else inf
        return speed_promise(self.promise_m, mean_m, ratio, lock_m, lag)

    @cached_property
    def limit(self) -> End | None:
        """The end of the model, at which the chain locks or a handle reaches the end of the track; None if endless."""
        law = self.scene.head
        ends = [(t_s, limit) for limit, sense in zip(self.model.limits, (-1, 1), strict=True)
                if limit and (t_s := law.passage_s(limit.travel_m, sense)) is not None]
        if not ends:
            return None
        t_s, limit = min(ends, key=lambda end: end[0])
        return End(t_s, limit.reason, limit.link)

    @cached_property
    def end(self) -> End:
        """The end of the run. Raises FieldError if the run has no end, or is longer than the longest run."""
        run, limit = self.scene.run, self.limit
        if run.stop_s is not None and (limit is None or run.stop_s <= limit.t_s):
            return End(run.stop_s, 'stop')
        if limit is None:
            raise FieldError('run.stop_s', None, 'the run has no end, because the leader never reaches a limit',
                             'give a stop')
        if limit.t_s < run.start_s:
            raise self._beyond(run.start_s, limit)
        if limit.t_s > TIME.high:
            raise FieldError('run.stop_s', None, f'the run would end at {limit.t_s:.6g} s; the longest run lasts '
                             f'{TIME.high:g} s', 'give an earlier stop')
        return limit

    @cached_property
    def last_tick(self) -> int:
        """The number of the last tick of the run."""
        run = self.scene.run
        last_stamp_s = self.end.t_s + run.stamp_offset_s
        if last_stamp_s > LATEST_S:
            raise FieldError('run.stop_s', None, f'the run would end at the stamp {last_stamp_s:.6g} s, after the last '
                             f'possible stamp, {LATEST_S} s', 'give an earlier stop')
        return run.tick_at(max(run.start_ns, floor(self.end.t_s * NS) + run.stamp_ns(0.0)))

    def time_ns(self, k: int) -> int:
        """Return the time of tick k. Raises FieldError if the run has no such tick."""
        if not 0 <= k <= self.last_tick:
            raise FieldError('k', k, f'the run has ticks 0 to {self.last_tick}', 'give one of these')
        return self.scene.run.time_ns(k)

    def check_time(self, t_s: float) -> None:
        """Raise FieldError or ModelEnd if the model has no state at ``t_s``."""
        if not 0.0 <= t_s <= self._last_s:
            if self.limit and self.limit.t_s < t_s < inf:
                raise self._beyond(t_s, self.limit)
            TIME.checked('t_s', t_s)

    @cached_property
    def _last_s(self) -> float:
        return TIME.high if self.limit is None else min(self.limit.t_s, TIME.high)

    def check_times(self, times_s: Floats) -> None:
        """Raise the error of ``check_time`` for the first of the given times that has no state."""
        for t_s in times_s[~((times_s >= 0) & (times_s <= self._last_s))][:1].tolist():
            self.check_time(t_s)

    def _beyond(self, t_s: float, limit: End) -> ModelEnd:
        """Return the error for a time after the model's end."""
        spiral = self.model.track.from_afar
        if not self.model.track.may_lock or not spiral:
            return TrackEndError(f't_s: {t_s:.9g} s is beyond the end of the scene: the track ends for a handle '
                                 f'at {limit.t_s:.6f} s; choose an earlier time', t_s=t_s, limit_s=limit.t_s)
        travel_m = min(spiral.curve.length_m, self.scene.head.travelled_m(limit.t_s))
        radius_m = spiral.curve.b_m * spiral.curve.inward(travel_m)
        why = 'the head reaches the centre' if limit.reason == 'track' else f'the chain locks at link {limit.link}'
        kind = TrackEndError if limit.reason == 'track' else ChainLockError
        return kind(f't_s: {t_s:.9g} s is beyond the end of the scene: {why} at {limit.t_s:.6f} s, with the head at '
                    f'radius {radius_m:.6f} m; choose an earlier time', t_s=t_s, limit_s=limit.t_s, link=limit.link,
                    radius_m=radius_m)

    @cached_property
    def extent_m(self) -> tuple[float, float]:
        """The smallest and largest distance that the leader travels in the run, or can travel if it is commanded."""
        if self.scene.is_led:
            return self._reach_m
        law = self.scene.head
        travels_m = [float(law.travelled_m(t_s)) for t_s in times_between(law, self.scene.run.start_s, self.end.t_s)]
        return min(travels_m), max(travels_m)

    @cached_property
    def _reach_m(self) -> tuple[float, float]:
        least, most = self.scene.head.extent_m(self.end.t_s - self.scene.run.start_s)
        back, onwards = self.model.limits
        return max(least, back.travel_m) if back else least, min(most, onwards.travel_m) if onwards else most

    @cached_property
    def span_m(self) -> tuple[float, float]:
        """The interval of the track that the handles occupy during the run, in metres."""
        if not self.is_paper:
            return self.model.leader.span_m(self.extent_m)
        chains = map(self.chain, (self.scene.run.start_s, self.end.t_s))
        ends = [chain.track.distances(*chain.places[:2]) for chain in chains]
        return float(np.min(ends)), float(np.max(ends))

    def build_tables(self) -> None:
        """Build the tables of the run in order, until they are complete or the memory limit is reached.

        Another thread may place chains at the same time. Tiles that do not exist yet are built when the leader reaches
        them; positions are bit-identical either way.
        """
        if self.model.placement.section_m == inf or self.is_paper:
            return
        (least, most), step = self.extent_m, 0.5 * self.model.placement.section_m
        here = 0.0 if self.scene.is_led else float(self.scene.head.travelled_m(self.scene.run.start_s))
        for sense, end in ((1, most), (-1, least)):
            for travel_m in (here + sense * n * step for n in count()):
                beyond = sense * (travel_m - end) >= 0
                if self.model.memory_bytes > _MOST_BYTES_AHEAD:
                    return
                try:
                    self.model.placement.build_near(self.model.leader.place(end if beyond else travel_m))
                except ModelEnd:
                    break
                if beyond:
                    break

    def track_line(self, sag_m: float = SAG_M) -> Floats:
        """Return points (m, shape (n, 2)) on the track that the handles cover in the run, from the front to the rear.

        The polyline deviates from the track by at most ``sag_m``.
        """
        return read_only(self.model.track.polyline(*self.span_m, sag_m)[::-1].copy())

    def chain(self, t_s: float) -> Chain:
        """Return the chain at any instant. Raises ModelEnd beyond the end of the model."""
        if not 0.0 <= t_s <= self._last_s:
            self.check_time(t_s)
        if self.is_paper:
            return paper.place(self.model.track, self.model.links_m, self.scene.steady_m_s, t_s)
        return self.model.place(self.scene.head.travelled_m(t_s))


class _Compiled:
    """A cache of simulations and models, ordered by their last use and limited in number and bytes."""

    def __init__(self) -> None:
        # The keys are ids of scenes. Each simulation stores its scene, so these ids stay unique.
        self._simulations: OrderedDict[int, Simulation] = OrderedDict()
        self._models: OrderedDict[tuple[AnyDragon, TrackSpec, str, str], Model] = OrderedDict()
        self._latest: Simulation | None = None
        self._lock = Lock()

    def get(self, scene: Scene) -> Simulation:
        """Return the simulation of a scene, compiled on the first request."""
        latest = self._latest
        if latest is not None and latest.scene is scene:
            return latest
        with self._lock:
            known = self._simulations.get(id(scene))
            simulation = known or self._compiled(scene)
            self._use(simulation)
            if not known:
                self._bound()
        return simulation

    def _compiled(self, scene: Scene) -> Simulation:
        """Return a new simulation, with the cached model if there is one."""
        key = _key_of(scene)
        simulation = Simulation(scene, self._models.get(key) or Model(*key))
        simulation.check_world()
        if not simulation.is_paper:
            check_request(scene.accuracy, simulation.promise_m)
        return simulation

    def _use(self, simulation: Simulation) -> None:
        """Store a simulation and its model, and mark them as the most recently used."""
        scene, key = simulation.scene, _key_of(simulation.scene)
        self._simulations[id(scene)] = self._latest = simulation
        self._simulations.move_to_end(id(scene))
        self._models[key] = simulation.model
        self._models.move_to_end(key)

    def _bound(self) -> None:
        """Drop the least recently used entries if the cache exceeds its limits."""
        while len(self._models) > 1 and (len(self._models) > _MOST_SIMULATIONS or sum(
                model.memory_bytes for model in self._models.values()) > _MOST_BYTES):
            _, model = self._models.popitem(last=False)
            for key in [key for key, one in self._simulations.items() if one.model is model]:
                del self._simulations[key]
        while len(self._simulations) > _MOST_SIMULATIONS:
            self._simulations.popitem(last=False)


_COMPILED = _Compiled()


def _key_of(scene: Scene) -> tuple[AnyDragon, TrackSpec, str, str]:
    """Return the settings that determine a model."""
    return scene.dragon, scene.track, scene.head.lead, scene.solver


def compile_scene(scene: Scene) -> Simulation:
    """Return the simulation of a scene from a cache; scenes with the same geometry share one model.

    Raises FieldError for faults that the settings alone do not reveal: pieces that do not join, bends that are too
    tight for the benches, a start off the track, or an accuracy that floats cannot provide at these coordinates.
    """
    return _COMPILED.get(scene)
