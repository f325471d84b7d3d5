"""Arrays of numbers that are known to within a radius; results hold for all values that the numbers may have.

In ball arithmetic (van der Hoeven 2010), the product of the balls m +- r and n +- s has the radius |m| s + |n| r + r s,
and so on. Results are rounded outwards by one factor per operation. No ball that is created here has a radius below
LEAST = 2^-36 times its number: ``between`` starts with at least this radius, sums and products preserve this property,
and functions and operations with exact numbers add a radius of this size. With u = 2^-53, rounding moves the middle of
a sum by at most u (|m| + |n|), the middle of a product by at most u |m n|, and so on. This is at most 4 u / LEAST =
2^-15 of the radius, because the radius is at least LEAST times the same quantity. Radii are sums and products of
positive numbers (and of one difference of two floats, in ``inverse``), so at most eight roundings reduce a radius by at
most 2^-50. Each radius is therefore multiplied by 1 + 2^-14. For a sum of K numbers, whose middle is off by u K sum
|m|, the factor is larger by K u / LEAST. Numbers below 1e-150, where floats lose digits, do not occur; 0 is exact.
"""
from dataclasses import dataclass
from typing import Any, Union

import numpy as np

from dragon_ros.core.numerics.types import Floats

Number = Union['Ball', float, Floats]
LEAST = 2.0**-36        # smallest radius, relative to the number
ABOVE = 1 + 2.0**-40    # factor for bounds that covers more than eight thousand roundings of positive numbers
OUTWARDS = 1 + 2.0**-14     # factor that covers the rounding of the middle and of the radius
_EACH = 2.0**-17        # u / LEAST, added to the factor for each number in a sum


@dataclass(frozen=True)
class Ball:
    """All numbers within ``rad`` of ``mid``."""

    mid: Floats
    rad: Floats
    __array_ufunc__ = None      # so that an array times a ball uses the ball's operator

    def __add__(self, other: Number) -> 'Ball':
        """Return the sum."""
        if isinstance(other, Ball):
            return Ball(self.mid + other.mid, OUTWARDS * (self.rad + other.rad))
        return Ball(self.mid + other, OUTWARDS * (self.rad + LEAST * np.abs(other)))

    def __neg__(self) -> 'Ball':
        """Return the negative."""
        return Ball(-self.mid, self.rad)

    def __sub__(self, other: Number) -> 'Ball':
        """Return the difference."""
        if isinstance(other, Ball):
            return Ball(self.mid - other.mid, OUTWARDS * (self.rad + other.rad))
        return self + -other

    def __mul__(self, other: Number) -> 'Ball':
        """Return the product."""
        if isinstance(other, Ball):
            rad = np.abs(self.mid) * other.rad + self.rad * (np.abs(other.mid) + other.rad)
            return Ball(self.mid * other.mid, OUTWARDS * rad)
        return Ball(self.mid * other, self.rad * (OUTWARDS * np.abs(other)))

    __radd__, __rmul__ = __add__, __mul__

    def __getitem__(self, index: Any) -> 'Ball':
        """Return a subset of the numbers."""
        return Ball(self.mid[index], self.rad[index])

    @property
    def most(self) -> Floats:
        """The largest absolute value, up to rounding, which the factor of the last operation covers."""
        out: Floats = np.abs(self.mid) + self.rad
        return out

    def inverse(self) -> 'Ball':
        """Return the reciprocal; its radius is infinite if the ball may contain zero."""
        size = np.abs(self.mid)
        rad: Floats = np.where(size > self.rad, OUTWARDS * self.rad / (size * np.abs(size - self.rad)), np.inf)
        return Ball(1 / self.mid, rad)

    def squared(self) -> 'Ball':
        """Return the square."""
        return Ball(self.mid * self.mid, OUTWARDS * self.rad * (2 * np.abs(self.mid) + self.rad))

    def sin_cos(self) -> tuple['Ball', 'Ball']:
        """Return the sine and the cosine; numpy's functions are accurate to a few units in the last place."""
        sin, cos = np.sin(self.mid), np.cos(self.mid)
        steep, flat, bow = np.abs(sin), np.abs(cos), 0.5 * self.rad * self.rad
        return (Ball(sin, OUTWARDS * (flat * self.rad + bow + LEAST * steep)),
                Ball(cos, OUTWARDS * (steep * self.rad + bow + LEAST * flat)))

    def running_product(self) -> 'Ball':
        """Return the products of the first 1, 2, ... numbers along the last axis."""
        mid: Floats = np.multiply.accumulate(self.mid, axis=-1)
        parts = np.log1p(self.rad / np.abs(self.mid))
        rad: Floats = np.abs(mid) * np.expm1(OUTWARDS * np.cumsum(parts, axis=-1))
        return Ball(mid, rad)

    def running_sum(self) -> 'Ball':
        """Return the sums of the first 1, 2, ... numbers along the last axis."""
        return Ball(np.cumsum(self.mid, axis=-1),
                    (OUTWARDS + _EACH * self.mid.shape[-1]) * np.cumsum(self.rad, axis=-1))


def between(a: Floats, b: Floats, error: float | Floats = 0.0) -> Ball:
    """Return the ball of all numbers between two numbers, each with an error of at most ``error``."""
    mid = 0.5 * (a + b)
    return Ball(mid, OUTWARDS * (0.5 * np.abs(a - b) + error + LEAST * np.abs(mid)))


def side_by_side(balls: list[Ball]) -> Ball:
    """Return balls concatenated along the last axis."""
    return Ball(np.concatenate([ball.mid for ball in balls], axis=-1),
                np.concatenate([ball.rad for ball in balls], axis=-1))
