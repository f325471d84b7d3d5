"""Sets of whole numbers that come almost in order, kept as intervals."""
from bisect import bisect_right
from collections.abc import Iterable

Interval = tuple[int, int]
_MOST_INTERVALS = 10_000
_MOST_SHOWN = 20


class IntervalSet:
    """Which numbers came; the memory grows with the gaps, and no further than 10,000 of them."""

    def __init__(self) -> None:
        """Start with none."""
        self._lows: list[int] = []
        self._highs: list[int] = []
        self.forgotten = 0      # gaps at the front that were given up to bound the memory

    def add(self, k: int) -> None:
        """Note a number; twice does no harm."""
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
        """Make one of a span and its next neighbour, where they touch."""
        if 0 <= at < len(self._lows) - 1 and self._highs[at] + 1 == self._lows[at + 1]:
            del self._highs[at], self._lows[at + 1]

    @property
    def first(self) -> int | None:
        """The smallest number that came."""
        return self._lows[0] if self._lows else None

    @property
    def last(self) -> int | None:
        """The largest number that came."""
        return self._highs[-1] if self._highs else None

    def gaps(self, last: int | None = None) -> list[Interval]:
        """Return the gaps between the first and the last that came (or a later ``last``), both ends included."""
        found = [(high + 1, low - 1) for high, low in zip(self._highs, self._lows[1:], strict=False)]
        if last is not None and self.last is not None and last > self.last:
            found.append((self.last + 1, last))
        return found


def count(intervals: Iterable[Interval]) -> int:
    """Return how many numbers are in the intervals."""
    return sum(high - low + 1 for low, high in intervals)


def text(intervals: list[Interval]) -> str:
    """Return intervals for people: 7, 12-15; a long list ends in how many more."""
    told = ', '.join(str(low) if low == high else f'{low}-{high}' for low, high in intervals[:_MOST_SHOWN])
    return told + (f' and {len(intervals) - _MOST_SHOWN} more gaps' if len(intervals) > _MOST_SHOWN else '')
