"""Numbers between two ends, by the array; for the checker of certificates, which shares no code with the solver."""
from dataclasses import dataclass
from typing import Union

import numpy as np

from dragon_ros.core.numerics.types import Floats

Number = Union['Interval', float, Floats]


@dataclass(frozen=True)
class Interval:
    """All numbers from ``low`` to ``high``."""

    low: Floats
    high: Floats
    __array_ufunc__ = None

    def __add__(self, other: Number) -> 'Interval':
        """Return the sum."""
        other = _interval(other)
        return Interval(self.low + other.low, self.high + other.high)

    def __neg__(self) -> 'Interval':
        """Return the negative."""
        return Interval(-self.high, -self.low)

    def __sub__(self, other: Number) -> 'Interval':
        """Return the difference."""
        return self + -_interval(other)

    def __mul__(self, other: Number) -> 'Interval':
        """Return the product."""
        other = _interval(other)
        ends = np.stack(np.broadcast_arrays(self.low * other.low, self.low * other.high, self.high * other.low,
                                            self.high * other.high))
        return Interval(ends.min(axis=0), ends.max(axis=0))

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: 'Interval') -> 'Interval':
        """Return the quotient; unbounded where the divisor may be zero."""
        bad = (other.low <= 0) & (other.high >= 0)
        share = Interval(1 / np.where(bad, 1, other.high), 1 / np.where(bad, 1, other.low))
        out = self * share
        return Interval(np.where(bad, -np.inf, out.low), np.where(bad, np.inf, out.high))

    def __getitem__(self, index: slice) -> 'Interval':
        """Return some of the numbers."""
        return Interval(self.low[index], self.high[index])

    def at(self, number: int) -> 'Interval':
        """Return one of the numbers."""
        return Interval(self.low[number], self.high[number])

    @property
    def size(self) -> Floats:
        """The largest absolute value."""
        out: Floats = np.maximum(np.abs(self.low), np.abs(self.high))
        return out

    def square(self) -> 'Interval':
        """Return the square."""
        least = np.where((self.low < 0) & (self.high > 0), 0.0, np.minimum(np.abs(self.low), np.abs(self.high)))
        return Interval(least * least, self.size * self.size)

    def cosine(self) -> 'Interval':
        """Return the cosine of angles in [0, 2 pi]."""
        ends = np.cos(self.low), np.cos(self.high)
        lowest = np.where((self.low < np.pi) & (self.high > np.pi), -1.0, np.minimum(*ends))
        return Interval(lowest, np.maximum(*ends))

    def sine(self) -> 'Interval':
        """Return the sine of angles in [0, 2 pi]."""
        ends = np.sin(self.low), np.sin(self.high)
        top, bottom = ((self.low < at * np.pi) & (self.high > at * np.pi) for at in (0.5, 1.5))
        return Interval(np.where(bottom, -1.0, np.minimum(*ends)), np.where(top, 1.0, np.maximum(*ends)))


def _interval(value: Number) -> Interval:
    return value if isinstance(value, Interval) else Interval(*np.broadcast_arrays(value, value))


def hull(a: Floats, b: Floats) -> Interval:
    """Return the numbers between two."""
    return Interval(np.minimum(a, b), np.maximum(a, b))
