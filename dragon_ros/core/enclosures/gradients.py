"""Numbers and their first derivatives as balls, for all values that variables can have in a box.

A number is an array (n,) of balls, one per box; its slopes (V, n) are its derivatives with respect to the V variables.
By the mean value theorem, a function that is smooth on a box is never less than its value in the middle minus the sum
of the half widths times the largest absolute slopes; this bound is exact to first order.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.enclosures.ball_arithmetic import Ball, between
from dragon_ros.core.numerics.types import Floats


@dataclass(frozen=True)
class Graded:
    """Numbers (n,) and their slopes (V, n) with respect to the variables."""

    value: Ball
    slope: Ball

    def __add__(self, other: 'Graded') -> 'Graded':
        """Return the sum."""
        return Graded(self.value + other.value, self.slope + other.slope)

    def __sub__(self, other: 'Graded') -> 'Graded':
        """Return the difference."""
        return Graded(self.value - other.value, self.slope - other.slope)

    def __neg__(self) -> 'Graded':
        """Return the negative."""
        return Graded(-self.value, -self.slope)

    def __mul__(self, other: 'Graded') -> 'Graded':
        """Return the product."""
        return Graded(self.value * other.value, self.slope * other.value + other.slope * self.value)

    def times(self, factor: float) -> 'Graded':
        """Return the product with an exact number."""
        return Graded(self.value * factor, self.slope * factor)

    def inverse(self) -> 'Graded':
        """Return the reciprocal; its radius is infinite if the ball may contain zero."""
        inverse = self.value.inverse()
        return Graded(inverse, -(self.slope * inverse.squared()))


@dataclass(frozen=True)
class Vector:
    """A vector in the plane, or a complex number x + i y."""

    x: Graded
    y: Graded

    def __add__(self, other: 'Vector') -> 'Vector':
        """Return the sum."""
        return Vector(self.x + other.x, self.y + other.y)

    def __sub__(self, other: 'Vector') -> 'Vector':
        """Return the difference."""
        return Vector(self.x - other.x, self.y - other.y)

    def __mul__(self, factor: Graded) -> 'Vector':
        """Return the vector multiplied by a number."""
        return Vector(self.x * factor, self.y * factor)

    def left(self) -> 'Vector':
        """Return the vector rotated by a quarter turn to the left."""
        return Vector(-self.y, self.x)

    def seen_along(self, axis: 'Vector') -> 'Vector':
        """Return the components along a unit vector and to its left."""
        return Vector(axis.x * self.x + axis.y * self.y, axis.x * self.y - axis.y * self.x)


def variables(low: Floats, high: Floats) -> list[Graded]:
    """Return the V variables of boxes from ``low`` to ``high`` (V, n)."""
    unit = np.eye(low.shape[0])[:, :, None] * np.ones(low.shape[1])
    return [Graded(between(one, other), between(each, each)) for one, other, each in zip(low, high, unit, strict=True)]


def polar(radius: Graded, angle: Graded) -> Vector:
    """Return the point at a polar radius and angle."""
    sin, cos = angle.value.sin_cos()
    return Vector(radius * Graded(cos, -(angle.slope * sin)), radius * Graded(sin, angle.slope * cos))
