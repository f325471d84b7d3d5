"""Polynomials with rational coefficients, evaluated exactly at floats or at midpoints of two floats, and rounded once.

All arithmetic uses integers over one common denominator, because ``Fraction`` would cancel common factors after each
operation, which takes ten times as long as the rest.
"""
from collections.abc import Sequence
from fractions import Fraction
from math import lcm


class ExactPolynomial:
    """A polynomial in t - origin, given by its coefficients, the lowest power first."""

    def __init__(self, origin: float, coefficients: Sequence[Fraction]) -> None:
        """Convert the coefficients to a common denominator."""
        self._origin = origin.as_integer_ratio()
        self._denominator = lcm(*(one.denominator for one in coefficients))
        highest, *others = [one.numerator * (self._denominator // one.denominator) for one in reversed(coefficients)]
        self._highest, self._others = highest, others

    @property
    def constant(self) -> float:
        """The rounded value of a polynomial that does not depend on t."""
        return self._highest / self._denominator

    def at(self, t: float | Fraction) -> float:
        """Return the rounded value at t. Raises OverflowError if the value exceeds the largest float."""
        value, under = self._exactly(t)
        return value / under        # Python rounds a quotient of integers correctly

    def halves_at(self, t: float) -> tuple[float, float]:
        """Return the value at t as (hi, lo): the rounded value, and the rounded remainder."""
        value, under = self._exactly(t)
        high = value / under
        number, below = high.as_integer_ratio()
        return high, (value * below - number * under) / (under * below)

    def _exactly(self, t: float | Fraction) -> tuple[int, int]:
        """Return the numerator and the denominator of the value, using Horner's rule on numerators only."""
        (number, below), (start, under) = t.as_integer_ratio(), self._origin
        unit = max(below, under)        # both are powers of two
        since = number * (unit // below) - start * (unit // under)
        value, power = self._highest, 1
        for one in self._others:
            power *= unit
            value = value * since + one * power
        return value, power * self._denominator
