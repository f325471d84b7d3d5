"""A scene: the settings of everything that is simulated. ``model`` compiles it."""
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property, lru_cache

from dragon_ros.core.chain.commanded import Commanded, HeadLaw, Walked
from dragon_ros.core.chain.dragon import AnyDragon, Dragon, is_even
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.checks import Settings, choice, number, settle
from dragon_ros.core.domain import RATE, TIME
from dragon_ros.core.errors import FieldError
from dragon_ros.core.flags import Effect, Noise, Trails, check_needs
from dragon_ros.core.promise import checked_name
from dragon_ros.core.tracks.spec import Spiral, TrackSpec
from dragon_ros.core.venue import Origin, Venue

NS = 10**9
LATEST_S = 2**31 - 1       # a ROS stamp stores seconds as int32
SOLVERS = ('table', 'march', 'paper')
MARKERS = ('cubes', 'triangles')


@dataclass(frozen=True)
class Run(Settings):
    """The start, stop and tick rate of a run; if ``stop_s`` is None, the run lasts until the model ends.

    Stamps are times of the simulation plus ``stamp_offset_s``: names in ``_s`` are times of the simulation, names in
    ``_ns`` are stamps.
    """

    start_s: float = 0.0
    stop_s: float | None = None
    rate_hz: float = 50.0
    stamp_offset_s: float = 0.0

    def __post_init__(self) -> None:
        """Reject a run that ends before it starts."""
        settle(self, start_s=TIME.checked('run.start_s', self.start_s),
               rate_hz=RATE.checked('run.rate_hz', self.rate_hz))
        settle(self, stamp_offset_s=number('run.stamp_offset_s', self.stamp_offset_s, low=-self.start_s,
                                           high=LATEST_S - self.start_s))
        if self.stop_s is not None:
            settle(self, stop_s=number('run.stop_s', self.stop_s, high=TIME.high))
            if self.stop_s < self.start_s:
                raise FieldError('run.stop_s', self.stop_s, f'the run starts at {self.start_s} s', 'give a later stop')

    @cached_property
    def _offset_ns(self) -> int:
        return round(self.stamp_offset_s * NS)

    @property
    def start_ns(self) -> int:
        """The stamp of the first tick in nanoseconds."""
        return self.stamp_ns(self.start_s)

    def stamp_ns(self, t_s: float) -> int:
        """Return the stamp of a time of the simulation, in nanoseconds."""
        return round(t_s * NS) + self._offset_ns

    def seconds(self, t_ns: int) -> float:
        """Return the time of the simulation at a stamp, in seconds."""
        return (t_ns - self._offset_ns) / NS

    def time_ns(self, k: int) -> int:
        """Return the stamp of tick k: start + k / rate, rounded down to a nanosecond, not accumulated from steps."""
        period, ticks = _period(self.rate_hz)
        return self.start_ns + k * period // ticks

    def tick_at(self, t_ns: int) -> int:
        """Return the number of the tick at ``t_ns``, or of the last tick before it."""
        period, ticks = _period(self.rate_hz)
        return ((t_ns - self.start_ns + 1) * ticks - 1) // period


@lru_cache(maxsize=1024)
def _period(rate_hz: float) -> tuple[int, int]:
    """Return the time between two ticks in nanoseconds, as a numerator and a denominator."""
    period = NS / Fraction(repr(rate_hz))
    return period.numerator, period.denominator


@dataclass(frozen=True)
class Scene:
    """A dragon on a track, led by its head or its tail, with an accuracy, effects, a run and optionally a venue.

    ``origin`` is the place of (0, 0), if known.

    All fields are settings, and equivalent scenes compare equal. ``markers`` selects how benches are shown: as 'cubes'
    (one marker per bench) or as 'triangles' (one list for all benches). Faults that appear only when the track is laid
    out in the plane (at joints, in bends, at a lock) are reported when the scene is compiled.
    """

    dragon: AnyDragon = field(default_factory=Dragon)
    track: TrackSpec = field(default_factory=Spiral)
    head: HeadLaw = field(default_factory=Head)
    run: Run = field(default_factory=Run)
    accuracy: str | float = 'exact'
    effects: Effect = Effect.VELOCITY | Effect.BENCHES
    solver: str = 'table'
    markers: str = 'cubes'
    noise: Noise = field(default_factory=Noise)
    trails: Trails = field(default_factory=Trails)
    venue: Venue | None = None
    origin: Origin | None = None

    def __post_init__(self) -> None:
        """Reject invalid settings, effects without the effects they need, and scenes that ``paper`` does not support.

        Every run of a commanded dragon includes the effect ``leader``.
        """
        if self.is_led:
            settle(self, effects=self.effects | Effect.LEADER)
        check_needs(self.effects)
        if self.accuracy == 'paper':        # as scenes of earlier versions request the paper's solver
            settle(self, accuracy='exact', solver='paper')
        choice('solver', self.solver, SOLVERS)
        choice('markers', self.markers, MARKERS)
        settle(self, accuracy=checked_name(self.accuracy) if isinstance(self.accuracy, str) else
               number('accuracy', self.accuracy, above=0.0))
        if self.solver == 'paper':
            self._check_paper()

    def _check_paper(self) -> None:
        """Reject scenes that the paper's method does not support."""
        if not isinstance(self.track, Spiral) or not isinstance(self.head, Head) or self.head.lead != 'head':
            raise FieldError('solver', self.solver, "the paper's recipe requires one spiral, led by the head at a "
                             'constant speed', 'choose table or march')
        if not is_even(self.dragon.link_lengths_m):
            raise FieldError('solver', self.solver, "the paper's recipe requires equal benches behind the head",
                             'choose table or march, or make the benches equal')

    @property
    def exactly(self) -> 'Scene':
        """The scene with accurate positions: unchanged unless the paper's solver is set."""
        return replace(self, solver='table') if self.solver == 'paper' else self

    @property
    def is_led(self) -> bool:
        """Whether the leader is commanded externally."""
        return isinstance(self.head, (Commanded, Walked))

    @property
    def spiral(self) -> Spiral:
        """The track if it is a single spiral. Raises FieldError otherwise."""
        if isinstance(self.track, Spiral):
            return self.track
        raise FieldError('track.kind', type(self.track).__name__.lower(), 'a single spiral is required',
                         'use track.kind: spiral')

    @property
    def steady_m_s(self) -> float:
        """The leader's speed if it is constant. Raises FieldError otherwise."""
        if isinstance(self.head, Head):
            return self.head.speed_m_s
        raise FieldError('head.kind', type(self.head).__name__.lower(), 'a constant speed is required',
                         'use head.speed_m_s')
