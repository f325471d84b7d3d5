"""Ticks that are missing or doubled among the times of a topic."""
from array import array
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.numerics.types import Ints
from dragon_ros.core.scene import NS, Run

_MOST_RANGES = 20
_REGULAR = 0.8      # a topic has ticks if so many of its steps are the usual one, to a tenth
_LEAST = 3


@dataclass(frozen=True)
class Gaps:
    """Messages a second, and for a topic with ticks: how many are missing, which, and how many are there twice.

    Ticks are numbered as the run of the scene numbers them, else from the first message; ``ranges`` has the first
    missing ones as (first, last). All but ``rate_hz`` are None where the messages come at no regular times.
    """

    rate_hz: float | None
    first: int | None = None
    last: int | None = None
    missing: int | None = None
    doubled: int | None = None
    ranges: tuple[tuple[int, int], ...] = ()


def gaps_of(times_ns: 'array[int]', run: Run | None) -> Gaps:
    """Return what is missing among the log times of a topic, given in any order."""
    times = np.sort(np.frombuffer(times_ns, np.uint64)).astype(np.float64) if times_ns else np.empty(0)
    span_s = (times[-1] - times[0]) / NS if times.size else 0.0
    rate_hz = float((times.size - 1) / span_s) if span_s > 0 else None
    steps = np.diff(np.unique(times))
    if steps.size + 1 < _LEAST:
        return Gaps(rate_hz)
    usual = float(np.median(steps))
    if np.mean(np.abs(steps - usual) <= 0.1 * usual) < _REGULAR:
        return Gaps(rate_hz)
    start_ns, period_ns = (run.start_ns, NS / run.rate_hz) if run else (times[0], usual)
    ticks: Ints = np.rint((times - start_ns) / period_ns).astype(np.int64)
    return _missing(rate_hz, ticks)


def _missing(rate_hz: float | None, ticks: Ints) -> Gaps:
    there = np.unique(ticks)
    after = np.flatnonzero(np.diff(there) > 1)
    ranges = tuple((int(there[n]) + 1, int(there[n + 1]) - 1) for n in after[:_MOST_RANGES])
    first, last = int(there[0]), int(there[-1])
    return Gaps(rate_hz, first, last, last - first + 1 - there.size, ticks.size - there.size, ranges)
