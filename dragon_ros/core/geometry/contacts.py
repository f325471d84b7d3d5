"""The contacts and the clearance at one instant, and the observation of a tick."""
from dataclasses import dataclass

from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.numerics.types import Floats, Ints


@dataclass(frozen=True)
class Closeness:
    """The smallest signed gap in metres of all benches that are not neighbours, ``closest``, and all pairs that touch.

    In a venue obstacles count too: in a pair (i, j) they are numbered behind the benches, in the order of its names.

    ``clearance_m`` is inf, and ``closest`` None, if there are fewer than three benches; if several pairs have the same
    gap, the first is the closest. Pairs (i, j) (K,) that touch, i < j, with ``gap_m`` (K,), the deepest first.
    """

    clearance_m: float
    closest: tuple[int, int] | None
    i: Ints
    j: Ints
    gap_m: Floats


@dataclass(frozen=True)
class Contacts:
    """Pairs that touch, (M, 2), deepest first, their signed gaps (M,) in m, and points (M, 2) of contact.

    An obstacle of a venue is numbered behind the benches, in the order of the venue's names.
    """

    benches: Ints
    gap_m: Floats
    point_m: Floats


OBSTACLE = -1       # the owner of an edge or a corner of an obstacle, in place of the number of a bench


@dataclass(frozen=True)
class ObstacleTouch:
    """What a bench touches of an obstacle: the ends of the edge, and the corner that meets an edge of the bench.

    ``corner_m`` is None where a corner of the bench meets the edge.
    """

    name: str
    edge_m: tuple[tuple[float, float], tuple[float, float]]
    corner_m: tuple[float, float] | None


@dataclass(frozen=True)
class Observation:
    """The observation of one tick: time, handles (N+1, 2) in m, bench rectangles, and the name of their frame."""

    t_ns: int
    p: Floats
    benches: Benches
    frame_id: str = ''
