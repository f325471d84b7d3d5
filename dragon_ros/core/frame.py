"""What one tick computes: the frame, and the results of its effects; and what is seen of a tick from outside."""
from dataclasses import dataclass

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.chain.rectangles import Benches
from dragon_ros.core.numerics.types import Floats, Ints


@dataclass(frozen=True)
class Closeness:
    """The smallest signed gap in metres of all benches that are not neighbours, ``closest``, and all pairs that touch.

    ``clearance_m`` is inf, and ``closest`` None, where there are fewer than three benches; of several pairs with the
    same gap the closest is the first. Pairs (i, j) (K,) that touch, i < j, with ``gap_m`` (K,), the deepest first.
    """

    clearance_m: float
    closest: tuple[int, int] | None
    i: Ints
    j: Ints
    gap_m: Floats


@dataclass(frozen=True)
class Contacts:
    """Pairs that touch, (M, 2), deepest first, their signed gaps (M,) in m, and points (M, 2) of contact."""

    benches: Ints
    gap_m: Floats
    point_m: Floats


@dataclass(frozen=True)
class Measured:
    """Noisy handles (N+1, 2) in metres and noisy unit directions of the links (N, 2)."""

    p: Floats
    axis: Floats


@dataclass(frozen=True)
class Health:
    """The solver that placed the handles and its evaluations; the worst link, its error, and the allowed error."""

    solver: str
    evaluations: int
    link: int
    off_m: float
    allowed_m: float

    @property
    def good(self) -> bool:
        """Whether the worst link is right to within what both its handles may be off."""
        return self.off_m <= self.allowed_m


@dataclass(frozen=True)
class Leading:
    """The leading handle: its place (2,) in metres, the unit direction (2,) of its way, and its speed along it.

    ``turn_rad_s`` is the rate at which its way turns, positive to the left.
    """

    p: Floats
    way: Floats
    speed_m_s: float
    turn_rad_s: float


@dataclass(frozen=True)
class Frame:
    """All that leaves the core at one instant; arrays are read-only, what the scene does not call for is None."""

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
    measured: Measured | None = None
    trail_m: Floats | None = None
    health: Health | None = None
    leader: Leading | None = None


@dataclass(frozen=True)
class Observation:
    """What was seen at one tick: time, handles (N+1, 2) in m, bench rectangles, and the name of their frame."""

    t_ns: int
    p: Floats
    benches: Benches
    frame_id: str = ''
