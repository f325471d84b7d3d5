"""A scene: everything that is simulated, and nothing else."""
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from math import ceil, floor, hypot, inf, sqrt

import numpy as np

from dragon_ros.core.checks import choice, number
from dragon_ros.core.dragon import AnyDragon, Dragon, is_even
from dragon_ros.core.effects import Effect, check_needs
from dragon_ros.core.end import End, beyond
from dragon_ros.core.errors import ChainLockError, FieldError, ModelEnd
from dragon_ros.core.head import Head, Profile
from dragon_ros.core.inwards import inwards
from dragon_ros.core.joined import Joined, wound
from dragon_ros.core.led import Led
from dragon_ros.core.lock import follower_range, head_lock_angle, last_stand
from dragon_ros.core.march import Effort
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.path import Spiral
from dragon_ros.core.placed import AHEAD, BACK
from dragon_ros.core.runs import FEWEST, Runs, runs_of
from dragon_ros.core.settings import Noise, Trails
from dragon_ros.core.table import ShiftTable
from dragon_ros.core.table_rows import table_for
from dragon_ros.core.tiers import PAPER, Tier, tier_for
from dragon_ros.core.turn import Turn

NS = 10**9
LATEST_S = 2**31 - 1       # the seconds of a ROS stamp are an int32
SOLVERS = ('table', 'march')
MARKERS = ('cubes', 'triangles')


@dataclass(frozen=True)
class Run:
    """When a run starts and stops, and its ticks a second; ``stop_s`` None means as far as the model goes."""

    start_s: float = 0.0
    stop_s: float | None = None
    rate_hz: float = 50.0

    def __post_init__(self) -> None:
        """Refuse a run that ends before it starts."""
        number('run.start_s', self.start_s, low=0.0, high=LATEST_S)
        number('run.rate_hz', self.rate_hz, low=1e-6, high=1e6)
        if self.stop_s is not None:
            number('run.stop_s', self.stop_s, high=LATEST_S)
            if self.stop_s < self.start_s:
                raise FieldError('run.stop_s', self.stop_s, f'the run starts at {self.start_s} s', 'stop later')

    @cached_property
    def start_ns(self) -> int:
        """First tick, in nanoseconds."""
        return round(self.start_s * NS)

    @cached_property
    def _period_ns(self) -> Fraction:
        return NS / Fraction(repr(float(self.rate_hz)))

    def time_ns(self, k: int) -> int:
        """Return the time of tick k: start + k / rate, rounded down to a nanosecond, never a sum of steps."""
        return self.start_ns + floor(k * self._period_ns)

    def tick_at(self, t_ns: int) -> int:
        """Return the number of the tick at ``t_ns``, or of the last one before it."""
        return ceil((t_ns - self.start_ns + 1) / self._period_ns) - 1


@dataclass(frozen=True)
class Scene:
    """A dragon on a track, led by its head, at an accuracy, with effects, for a run.

    ``markers`` is how benches are shown: 'cubes', one each, or 'triangles', all in one list.
    """

    dragon: AnyDragon = field(default_factory=Dragon)
    track: Spiral | Turn | Joined = field(default_factory=Spiral)
    head: Head | Profile = field(default_factory=Head)
    run: Run = field(default_factory=Run)
    accuracy: str | float = 'exact'
    effects: Effect = Effect.VELOCITY | Effect.BENCHES
    solver: str = 'table'
    markers: str = 'cubes'
    noise: Noise = field(default_factory=Noise)
    trails: Trails = field(default_factory=Trails)

    def __post_init__(self) -> None:
        """Refuse an accuracy that no tier keeps, choices that there are not, and effects without what they need."""
        check_needs(self.effects)
        if Effect.ACCELERATIONS in self.effects:
            self.check_plain()
        choice('solver', self.solver, SOLVERS)
        choice('markers', self.markers, MARKERS)
        tier_for(self.accuracy, self.size_m)
        if self.tier is PAPER and (self.led or not isinstance(self.head, Head)):
            raise FieldError('accuracy', self.accuracy, "the paper's recipe is for one spiral, led by the head at a "
                             'constant speed', 'ask for another tier')
        if self.tier is PAPER and not is_even(self.dragon.link_lengths_m):
            raise FieldError('accuracy', self.accuracy, "the paper's recipe is for benches equal behind the head",
                             'ask for another tier, or make them equal')

    @cached_property
    def led(self) -> Led | None:
        """How the chain follows on a track of pieces or behind its tail; None for a head on one spiral (see step)."""
        way = AHEAD if self.head.lead == 'tail' else BACK
        links = self.dragon.link_lengths_m
        if not isinstance(self.track, Spiral):
            return Led(self.track.walk, links, self.track.start_m, way)
        return Led(wound(self.track, self.track.start.hi), links, 0.0, way) if way == AHEAD else None

    @cached_property
    def chained(self) -> Led:
        """How the chain follows on any track: a single spiral is a walk of one piece, to its centre."""
        return self.led or Led(inwards(self.spiral), self.dragon.link_lengths_m, 0.0, BACK)

    @property
    def spiral(self) -> Spiral:
        """The track, where it is one spiral. Raises FieldError where it is not."""
        if isinstance(self.track, Spiral):
            return self.track
        raise FieldError('track.kind', type(self.track).__name__.lower(), 'this needs a single spiral',
                         'use track.kind: spiral')

    @property
    def steady_m_s(self) -> float:
        """The leader's speed, where it is constant. Raises FieldError where it is not."""
        if isinstance(self.head, Head):
            return self.head.speed_m_s
        raise FieldError('head.kind', 'profile', 'this needs a constant speed', 'use head.speed_m_s')

    def check_plain(self) -> tuple[Spiral, float]:
        """Return the spiral and the head's speed. Raises FieldError for another track, law, or a tail that leads."""
        if self.head.lead == 'tail':
            raise FieldError('head.lead', 'tail', 'this needs a head that leads', 'use head.lead: head')
        return self.spiral, self.steady_m_s

    @cached_property
    def size_m(self) -> float:
        """How far from the centre a handle can be in this run, in metres (a bound)."""
        extent = self.head.extent_m(self.run.stop_s or 0.0)
        if self.led:
            return self.led.size_m(extent)
        track = self.spiral
        return track.b_m * (1 + hypot(track.start.hi, sqrt(2 * (self.length_m - extent[0]) / track.b_m)))

    @cached_property
    def length_m(self) -> float:
        """Length of the whole chain, handle to handle."""
        return float(np.sum(self.dragon.link_lengths_m))

    @cached_property
    def tier(self) -> Tier:
        """The accuracy as a promise."""
        return tier_for(self.accuracy, self.size_m)

    @property
    def promise_m(self) -> float:
        """The largest position error that this scene may have."""
        return self.tier.promise_for_m(self.size_m)

    @cached_property
    def effort(self) -> Effort:
        """The work on each link that keeps the promise."""
        return self.tier.effort(self.size_m, self.length_m)

    @cached_property
    def table(self) -> ShiftTable | None:
        """The shift table, built when it is first asked for; None where handle after handle is marched.

        It reaches from the model's end to the start where it can, so that runs on one track share their bits, else
        over the places of this run.
        """
        links = self.dragon.link_lengths_m
        if self.led or self.solver == 'march' or self.tier is PAPER or links.size < FEWEST or not links[0] * links[1]:
            return None
        if not is_even(links):      # no one map from a handle to the next
            return None
        whole = (0.0, self.end.t_s if self.limit is None else self.limit.t_s)
        tables = (table_for(self.spiral, links, self._second_handle(*times), self.effort.newton,
                            self.tier.series_m(self.size_m)) for times in (whole, (self.run.start_s, self.end.t_s)))
        return next((table for table in tables if table), None)

    @cached_property
    def runs(self) -> Runs | None:
        """What places runs of equal links where ``table`` cannot; tables are built when first asked for."""
        return runs_of(self)

    def _second_handle(self, first_s: float, last_s: float) -> tuple[float, float]:
        """Return the least and greatest polar angle of the second handle between two times."""
        times = (first_s, last_s, *(t_s for t_s in self.head.breaks_s if first_s < t_s < last_s))
        spiral = self.spiral
        angles = [spiral.inward(min(self.head.travelled_m(t_s)[0], spiral.length_m)).hi for t_s in times]
        return follower_range(min(angles), max(angles), float(self.dragon.link_lengths_m[0] / spiral.b_m))

    @cached_property
    def limit(self) -> End | None:
        """Where the model itself ends: the chain locks or a handle reaches the track's end; None if never."""
        if self.led:
            t_s = self.led.end_s(self.head)
            return None if t_s is None else End(t_s, 'track')
        spiral = self.spiral
        angle, link = head_lock_angle((self.dragon.link_lengths_m / spiral.b_m).tolist())
        if spiral.start.hi < angle:
            raise ChainLockError(
                f'the chain is locked from the start: link {link} finds no place while the head is nearer to the '
                f'centre than {spiral.b_m * angle:.6g} m; give a larger track.start_turns or track.pitch_m, or '
                'shorter benches', link=link, radius_m=spiral.b_m * angle, t_s=0.0)
        t_s = self.head.passage_s(spiral.distance_to(angle))
        if t_s is None:
            return None
        if not angle:
            return End(t_s, 'track')
        links = self.dragon.link_lengths_m[:link + 2]
        last_s = last_stand(t_s, self.head.travelled_m, spiral, links, self.effort)
        return End(last_s, 'lock', link)

    @cached_property
    def end(self) -> End:
        """Where the run ends. Raises FieldError where nothing ends it."""
        stop, limit = self.run.stop_s, self.limit
        if stop is not None and (limit is None or stop <= limit.t_s):
            return End(stop, 'stop')
        if limit is None:
            raise FieldError('run.stop_s', None, 'the leader never reaches an end',
                             'say when to stop')
        if limit.t_s < self.run.start_s:
            raise self._beyond(self.run.start_s)
        return limit

    @cached_property
    def last_tick(self) -> int:
        """Number of the last tick of the run."""
        if self.end.t_s > LATEST_S:
            raise FieldError('run.stop_s', None, f'the run would end at {self.end.t_s:.6g} s and stamps end at '
                             f'{LATEST_S} s', 'say when to stop')
        return self.run.tick_at(max(self.run.start_ns, floor(self.end.t_s * NS)))

    def check_time(self, t_s: float) -> None:
        """Raise FieldError or ModelEnd where the model has no state at ``t_s``."""
        number('t_s', t_s, low=0.0)
        if self.limit is not None and t_s > self.limit.t_s:
            raise self._beyond(t_s)

    def check_times(self, times_s: Floats) -> None:
        """Raise as ``check_time`` does for the first of many times without a state."""
        last = inf if self.limit is None else self.limit.t_s
        for t_s in times_s[~((times_s >= 0) & (times_s <= last) & np.isfinite(times_s))][:1].tolist():
            self.check_time(t_s)

    def _beyond(self, t_s: float) -> ModelEnd:
        limit = self.limit
        assert limit is not None
        if self.led:
            return beyond(t_s, limit, None)
        gone = min(self.spiral.length_m, self.head.travelled_m(limit.t_s)[0])
        return beyond(t_s, limit, self.spiral.b_m * self.spiral.inward(gone).hi)
