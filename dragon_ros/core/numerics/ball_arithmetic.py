"""Numbers that are known to within a radius, by the array: whatever is computed from them holds for all they may be.

Ball arithmetic (van der Hoeven 2010): a product errs by |m| s + |n| r + r s, and so on. Rounding is left out: it is far
below what a caller has to add for the errors of the positions.
"""
from dataclasses import dataclass
from typing import Union

import numpy as np

from dragon_ros.core.numerics.types import Floats

Number = Union['Ball', float, Floats]


@dataclass(frozen=True)
class Ball:
    """All numbers within ``rad`` of ``mid``."""

    mid: Floats
    rad: Floats
    __array_ufunc__ = None      # an array times a ball is the ball's business

    def __add__(self, other: Number) -> 'Ball':
        """Return the sum."""
        return Ball(self.mid + other.mid, self.rad + other.rad) if isinstance(other, Ball) else Ball(
            self.mid + other, self.rad)

    def __neg__(self) -> 'Ball':
        """Return the negative."""
        return Ball(-self.mid, self.rad)

    def __sub__(self, other: Number) -> 'Ball':
        """Return the difference."""
        return self + -other

    def __mul__(self, other: Number) -> 'Ball':
        """Return the product."""
        if isinstance(other, Ball):
            return Ball(self.mid * other.mid, np.abs(self.mid) * other.rad + self.rad * (np.abs(other.mid) + other.rad))
        return Ball(self.mid * other, self.rad * np.abs(other))

    __radd__, __rmul__ = __add__, __mul__

    def __getitem__(self, index: tuple[slice, slice]) -> 'Ball':
        """Return some of the numbers."""
        return Ball(self.mid[index], self.rad[index])

    @property
    def most(self) -> Floats:
        """The largest absolute value."""
        out: Floats = np.abs(self.mid) + self.rad
        return out

    def inverse(self) -> 'Ball':
        """Return the reciprocal; its radius is infinite where zero may be among the numbers."""
        size = np.abs(self.mid)
        rad: Floats = np.where(size > self.rad, self.rad / (size * np.abs(size - self.rad)), np.inf)
        return Ball(1 / self.mid, rad)

    def squared(self) -> 'Ball':
        """Return the square."""
        return Ball(self.mid * self.mid, self.rad * (2 * np.abs(self.mid) + self.rad))

    def trig(self) -> tuple['Ball', 'Ball', 'Ball']:
        """Return sine, cosine, and 1 - cosine without cancellation."""
        sin, cos, half = np.sin(self.mid), np.cos(self.mid), np.sin(0.5 * self.mid)
        bow = 0.5 * self.rad * self.rad
        aside = np.abs(sin) * self.rad + bow
        return Ball(sin, np.abs(cos) * self.rad + bow), Ball(cos, aside), Ball(2 * half * half, aside)

    def running_product(self) -> 'Ball':
        """Return the products of the first 1, 2, ... numbers of the last axis."""
        mid: Floats = np.multiply.accumulate(self.mid, axis=-1)
        rad: Floats = np.abs(mid) * np.expm1(np.cumsum(np.log1p(self.rad / np.abs(self.mid)), axis=-1))
        return Ball(mid, rad)

    def running_sum(self) -> 'Ball':
        """Return the sums of the first 1, 2, ... numbers of the last axis."""
        return Ball(np.cumsum(self.mid, axis=-1), np.cumsum(self.rad, axis=-1))


def between(a: Floats, b: Floats) -> Ball:
    """Return the ball of all numbers between two."""
    return Ball(0.5 * (a + b), 0.5 * np.abs(a - b))


def side_by_side(balls: list[Ball]) -> Ball:
    """Return balls joined along the last axis."""
    return Ball(np.concatenate([ball.mid for ball in balls], axis=-1),
                np.concatenate([ball.rad for ball in balls], axis=-1))
