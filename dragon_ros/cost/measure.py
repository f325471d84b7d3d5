"""Measure the times of calls as medians and quartiles, excluding the first call, and describe the machine."""
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median, quantiles

from dragon_ros.version import __version__

TIMES = ('median_s', 'low_s', 'high_s', 'calls')


@dataclass(frozen=True)
class Timing:
    """The time per call (s), as the median and the quartiles, and the number of timed calls."""

    median_s: float
    low_s: float
    high_s: float
    calls: int

    @property
    def cells(self) -> tuple[float, float, float, int]:
        """The table cells for the column headings TIMES."""
        return self.median_s, self.low_s, self.high_s, self.calls

    def shared_by(self, count: int) -> 'Timing':
        """Return the timing of one part of a call that consists of ``count`` equal parts."""
        return Timing(self.median_s / count, self.low_s / count, self.high_s / count, self.calls * count)


def timed(call: Callable[[], object], budget_s: float = 0.3, least: int = 5, most: int = 200) -> Timing:
    """Call a function once without timing it, then time as many calls as the budget allows, and return the timing."""
    call()
    spent: list[float] = []
    while len(spent) < least or (sum(spent) < budget_s and len(spent) < most):
        start = time.perf_counter()
        call()
        spent.append(time.perf_counter() - start)
    return timing_of(spent)


def timed_in_turn(calls: Sequence[Callable[[], object]], budget_s: float = 0.3, least: int = 5, most: int = 200
                  ) -> list[Timing]:
    """Time several functions alternately, so that other load on the machine affects all of them equally.

    Each function is called twice in a row. Only the second call is timed, because the first call refills the caches.
    """
    spent: list[list[float]] = [[] for _ in calls]
    end_s, rounds = time.perf_counter() + budget_s * len(calls), 0
    while calls and (rounds < least or (time.perf_counter() < end_s and rounds < most)):
        rounds += 1
        for mine, call in zip(spent, calls, strict=True):
            call()
            start = time.perf_counter()
            call()
            mine.append(time.perf_counter() - start)
    return [timing_of(mine) for mine in spent]


def timing_of(spent: Sequence[float]) -> Timing:
    """Return the median and the quartiles of call times (s)."""
    low, _, high = quantiles(spent, n=4)
    return Timing(median(spent), low, high, len(spent))


def circumstances() -> str:
    """Return one line with the processor, the versions and the date."""
    return (f'{_processor()}, {platform.system()}, Python {platform.python_version()}, '
            + ', '.join(f'{name} {found}' for name in ('numpy', 'scipy') if (found := _version(name)))
            + f', dragon_ros {__version__}, {datetime.now().astimezone():%Y-%m-%d}')


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ''


def _processor() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='ascii', errors='replace').splitlines()
    except OSError:
        lines = []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine() or sys.platform
