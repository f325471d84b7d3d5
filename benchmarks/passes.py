"""Several passes over a page whose rows are compared with each other: of each call, the fastest pass counts."""
from collections.abc import Sequence

from dragon_ros.cost.measure import Timing

PASSES = 3


def fastest(passes: Sequence[Sequence[Timing]]) -> list[Timing]:
    """Return the fastest timing of each call in any pass over the same calls.

    Other load only makes a pass slower. With one pass, a slow minute of the machine would double the times of whichever
    calls it meets.
    """
    return [min(timings, key=lambda timing: timing.median_s) for timings in zip(*passes, strict=True)]
