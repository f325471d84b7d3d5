"""Effects as flags, and their settings. An effect that is off is neither computed, published nor recorded."""
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Flag, auto
from functools import lru_cache
from types import SimpleNamespace

from dragon_ros.core.checks import number, settle, whole
from dragon_ros.core.domain import TIME
from dragon_ros.core.errors import FieldError, did_you_mean


class Effect(Flag):
    """Switches for the effects; the handles are always computed."""

    NONE = 0
    VELOCITY = auto()
    BENCHES = auto()
    CLEARANCE = auto()
    CONTACT = auto()
    MARKERS = auto()
    ACCELERATIONS = auto()
    FORCES = auto()
    NOISE = auto()
    TRAILS = auto()
    CLOCK = auto()
    DIAGNOSTICS = auto()
    LEADER = auto()
    CLOUD = auto()
    JOINTS = auto()
    PATH = auto()

    @property
    def names(self) -> list[str]:
        """The names of these effects as written in a scene file."""
        return [name for name, effect in known().items() if effect in self]


NEEDS = {Effect.CLEARANCE: Effect.BENCHES, Effect.CONTACT: Effect.CLEARANCE, Effect.MARKERS: Effect.CONTACT,
         Effect.FORCES: Effect.ACCELERATIONS, Effect.CLOUD: Effect.VELOCITY}

MEANINGS = {
    Effect.VELOCITY: 'velocities of all handles',
    Effect.BENCHES: 'the benches as rectangles',
    Effect.CLEARANCE: 'the smallest gap between benches that are not neighbours, or to an obstacle of the venue; '
                      'the gaps of pairs that touch',
    Effect.CONTACT: 'which benches touch each other or an obstacle, and where',
    Effect.MARKERS: 'markers of the benches that touch',
    Effect.ACCELERATIONS: 'accelerations of all handles',
    Effect.FORCES: 'tensions of all links, for equal masses at the handles and a track without friction',
    Effect.NOISE: 'handles as measured by a noisy sensor; the noise section of the scene configures it',
    Effect.TRAILS: 'the recent path of the head; the trails section of the scene sets its duration',
    Effect.CLOCK: '/clock, the simulation time for other nodes',
    Effect.DIAGNOSTICS: 'how accurately each tick was solved',
    Effect.LEADER: 'position, heading and speed of the leading handle; always on if the head law is commanded',
    Effect.CLOUD: 'the handles with their velocities as one stamped point cloud, which viewers can colour by speed',
    Effect.JOINTS: 'the angles between benches and the pose of the head bench: the dragon as a robot',
    Effect.PATH: 'the track as a nav_msgs/Path, published once',
}


def effects_of(names: Iterable[object]) -> Effect:
    """Return the flags for names such as 'velocity'."""
    effects = Effect.NONE
    for name in names:
        if not isinstance(name, str) or name not in known():
            raise FieldError('effects', name, f'the effects are {", ".join(known())}',
                             did_you_mean(name, known(), 'give only these'))
        effects |= known()[name]
    return effects


def check_needs(effects: Effect) -> None:
    """Raise FieldError if an effect is on but another effect that it needs is off."""
    complete = effects
    for effect, need in reversed(NEEDS.items()):        # each effect comes after the effects that it needs
        complete |= need if effect in complete else Effect.NONE
    if complete != effects:
        effect, need = next((e, n) for e, n in NEEDS.items() if e in effects and n not in effects)
        raise FieldError('effects', effects.names, f'{effect.names[0]} needs {need.names[0]}',
                         f'write effects: [{", ".join(complete.names)}]')


def known() -> dict[str, Effect]:
    """Return every effect except NONE by name."""
    return {str(effect.name).lower(): effect for effect in Effect}


@lru_cache(maxsize=256)
def switches(effects: Effect) -> SimpleNamespace:
    """Return whether each effect is on, by name; every tick queries all effects, and a Flag is too slow for that."""
    return SimpleNamespace(**{name: effect in effects for name, effect in known().items()})


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a sensor that observes the handles, and the seed that makes the noise repeatable."""

    position_m: float = 0.005
    yaw_rad: float = 0.002
    seed: int = 0

    def __post_init__(self) -> None:
        """Reject invalid sensor settings."""
        settle(self, position_m=number('noise.position_m', self.position_m, low=0.0, high=1e6),
               yaw_rad=number('noise.yaw_rad', self.yaw_rad, low=0.0, high=1e3),
               seed=whole('noise.seed', self.seed, low=0, high=2**63))


@dataclass(frozen=True)
class Trails:
    """The duration of a trail, in seconds, and its number of points."""

    seconds: float = 10.0
    points: int = 32

    def __post_init__(self) -> None:
        """Reject invalid trail settings."""
        settle(self, seconds=number('trails.seconds', self.seconds, above=0.0, high=TIME.high),
               points=whole('trails.points', self.points, low=2, high=10_000))
