"""Sets of integers that arrive almost in order, stored as intervals."""
from bisect import bisect_right
from collections.abc import Iterable

from dragon_ros.core.words import counted

Interval = tuple[int, int]
_MOST_INTERVALS = 10_000
_MOST_SHOWN = 20


class IntervalSet:
    """The numbers seen so far. Memory use grows with the number of gaps; at most 10,000 gaps are kept."""

    def __init__(self) -> None:
        """Start empty."""
        self._lows: list[int] = []
        self._highs: list[int] = []
        self.forgotten = 0      # how many numbers are missing in early gaps that were dropped to bound memory use

    def add(self, k: int) -> None:
        """Add a number; adding it twice is harmless."""
        if self._highs and k == self._highs[-1] + 1:
            self._highs[-1] = k
            return
        at = bisect_right(self._lows, k)
        if at and k <= self._highs[at - 1]:
            return
        self._lows.insert(at, k)
        self._highs.insert(at, k)
        self._join(at)
        self._join(at - 1)
        if len(self._lows) > _MOST_INTERVALS:
            self.forgotten += self._lows[1] - self._highs[0] - 1
            del self._lows[1], self._highs[0]

    def _join(self, at: int) -> None:
        """Merge an interval with the next interval if they touch."""
        if 0 <= at < len(self._lows) - 1 and self._highs[at] + 1 == self._lows[at + 1]:
            del self._highs[at], self._lows[at + 1]

    @property
    def first(self) -> int | None:
        """The smallest number."""
        return self._lows[0] if self._lows else None

    @property
    def last(self) -> int | None:
        """The largest number."""
        return self._highs[-1] if self._highs else None

    def gaps(self, last: int | None = None) -> list[Interval]:
        """Return the gaps between the first and the last number (or a later ``last``) as inclusive intervals."""
        found = [(high + 1, low - 1) for high, low in zip(self._highs, self._lows[1:], strict=False)]
        if last is not None and self.last is not None and last > self.last:
            found.append((self.last + 1, last))
        return found


def count(intervals: Iterable[Interval]) -> int:
    """Return how many numbers the intervals contain."""
    return sum(high - low + 1 for low, high in intervals)


def text(intervals: list[Interval]) -> str:
    """Return intervals as text: 7, 12-15; a long list is abbreviated."""
    shown = ', '.join(str(low) if low == high else f'{low}-{high}' for low, high in intervals[:_MOST_SHOWN])
    return shown + (f' and {counted(len(intervals) - _MOST_SHOWN, "more gap")}' if len(intervals) > _MOST_SHOWN else '')
