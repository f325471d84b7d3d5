"""The results of one tick: the frame, and the results of its effects."""
from dataclasses import dataclass
from typing import NamedTuple

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.geometry.contacts import Closeness, Contacts
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.numerics.types import Floats


@dataclass(frozen=True)
class NoisyHandles:
    """Noisy handle positions (m, shape (N+1, 2)) and noisy unit directions of the links (shape (N, 2))."""

    p: Floats
    axis: Floats


@dataclass(frozen=True)
class Health:
    """The solver that placed the handles, its evaluation count, and the link with the largest error.

    ``off_m`` is the error of this link, and ``allowed_m`` is the error that is allowed.
    """

    solver: str
    evaluations: int
    link: int
    off_m: float
    allowed_m: float

    @property
    def good(self) -> bool:
        """Whether the error of the worst link is within the allowed errors of both its handles."""
        return self.off_m <= self.allowed_m


@dataclass(frozen=True)
class LeaderMotion:
    """The leading handle: its position (m) and the unit direction of its motion, each of shape (2,), and its speed.

    ``turn_rad_s`` is the rate at which this direction turns, positive to the left.
    """

    p: Floats
    direction: Floats
    speed_m_s: float
    turn_rad_s: float


class Frame(NamedTuple):
    """All results of the core at one instant; arrays are read-only, and the field of an effect that is off is None.

    A frame is a tuple, because every tick creates one: a frozen dataclass of so many fields takes 2 µs longer.
    """

    k: int | None
    t_ns: int
    chain: Chain
    axis: Floats
    velocity_m_s: Floats | None = None
    benches: Benches | None = None
    closeness: Closeness | None = None
    contacts: Contacts | None = None
    acceleration_m_s2: Floats | None = None
    tension_n_kg: Floats | None = None
    measured: NoisyHandles | None = None
    trail_m: Floats | None = None
    health: Health | None = None
    leader: LeaderMotion | None = None
    joint_rad: Floats | None = None

    def __repr__(self) -> str:
        """Name the tick and the fields that are set, but omit their long arrays."""
        there = [one for one in self._fields[2:] if getattr(self, one) is not None]
        return f'Frame(k={self.k}, t_ns={self.t_ns}, with {", ".join(there)})'
