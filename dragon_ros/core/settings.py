"""How effects are set: what a scene says beside switching them on."""
from dataclasses import dataclass

from dragon_ros.core.checks import number, whole


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a sensor that sees the handles, and the seed that repeats it."""

    position_m: float = 0.005
    yaw_rad: float = 0.002
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse a sensor that is not one."""
        number('noise.position_m', self.position_m, low=0.0, high=1e6)
        number('noise.yaw_rad', self.yaw_rad, low=0.0, high=1e3)
        whole('noise.seed', self.seed, low=0, high=2**63)


@dataclass(frozen=True)
class Trails:
    """How many seconds a trail goes back, and by how many points it is drawn."""

    seconds: float = 10.0
    points: int = 32

    def __post_init__(self) -> None:
        """Refuse a trail that is not one."""
        number('trails.seconds', self.seconds, above=0.0, high=1e9)
        whole('trails.points', self.points, low=2, high=10_000)
