"""The contacts and the clearance at one instant, and the observation of a tick."""
from dataclasses import dataclass

from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.numerics.types import Floats, Ints

Pair = tuple[int, int]


@dataclass(frozen=True)
class Closeness:
    """The smallest signed gap (m) between benches that are not neighbours, its pair, and all pairs that touch.

    In a venue, obstacles are included; in a pair (i, j) they are numbered after the benches, in the order of the
    venue's names.

    With fewer than three benches, ``clearance_m`` is inf and ``closest`` is None; if several pairs have the same gap,
    ``closest`` is the first. ``i`` and ``j`` (K,) hold the pairs that touch, with i < j, and ``gap_m`` (K,) holds their
    gaps, deepest first.
    """

    clearance_m: float
    closest: tuple[int, int] | None
    i: Ints
    j: Ints
    gap_m: Floats


@dataclass(frozen=True)
class Contacts:
    """The pairs (M, 2) that touch, deepest first, with their signed gaps (M,) and contact points (M, 2) in metres.

    Obstacles of a venue are numbered after the benches, in the order of the venue's names.
    """

    benches: Ints
    gap_m: Floats
    point_m: Floats


OBSTACLE = -1       # owner of an obstacle's edge or corner, in place of the index of a bench


@dataclass(frozen=True)
class ObstacleTouch:
    """The contact of a bench with an obstacle: the ends of the obstacle's edge, and the obstacle's corner, if any.

    ``corner_m`` is the corner of the obstacle that meets an edge of the bench; it is None if a corner of the bench
    meets the obstacle's edge.
    """

    name: str
    edge_m: tuple[tuple[float, float], tuple[float, float]]
    corner_m: tuple[float, float] | None


@dataclass(frozen=True)
class Observation:
    """An observation of one tick: its time, the handles (m, shape (N+1, 2)), the benches, and their frame's name."""

    t_ns: int
    p: Floats
    benches: Benches
    frame_id: str = ''


def pair_words(pair: Pair, obstacle: str = '') -> str:
    """Return a description of two benches or, if ``obstacle`` is given, of a bench and that obstacle."""
    return f'bench {pair[0]} and obstacle {obstacle!r}' if obstacle else f'benches {pair[0]} and {pair[1]}'
