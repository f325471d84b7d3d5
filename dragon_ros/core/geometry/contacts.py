"""Which benches touch at one instant and how near the others are, and what an observer sees of a tick."""
from dataclasses import dataclass

from dragon_ros.core.geometry.rectangles import Benches
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
class Observation:
    """What was seen at one tick: time, handles (N+1, 2) in m, bench rectangles, and the name of their frame."""

    t_ns: int
    p: Floats
    benches: Benches
    frame_id: str = ''
