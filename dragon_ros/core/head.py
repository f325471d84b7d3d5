"""The head law: how far the leading handle has gone along the track at a time."""
from dataclasses import dataclass
from typing import Any

from dragon_ros.core.angle import product
from dragon_ros.core.checks import number


@dataclass(frozen=True)
class Head:
    """Constant speed, positive inwards; the head has gone ``speed_m_s * t`` of arc length at time t (paper, eq. 4)."""

    speed_m_s: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a speed that is not a number."""
        number('head.speed_m_s', self.speed_m_s, low=-1e9, high=1e9)

    def travelled_m(self, t_s: Any) -> tuple[Any, Any]:
        """Return the arc length from the start to the head at ``t_s`` (or at many), positive inwards, as (hi, lo)."""
        return product(self.speed_m_s, t_s)
