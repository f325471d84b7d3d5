"""Double-double numbers: unevaluated sums of two floats (hi, lo), which lose no digits after many turns.

``hi`` is the float nearest to the number and ``lo`` is the remainder. Near 1e9 rad, the resolution of one float is 1e-7
rad, and the resolution of the pair is 1e-23 rad. Trigonometry uses plain floats: cos(hi + lo) = cos(hi) - lo sin(hi) to
the last digit.
"""
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

_TWO_PI = Fraction('6.28318530717958647692528676655900576839433879875021164194988918461563')


class DoubleDouble(NamedTuple):
    """The number hi + lo, where |lo| is at most half an ulp of hi."""

    hi: float
    lo: float


@lru_cache(maxsize=1024)
def from_turns(turns: float | Fraction) -> DoubleDouble:
    """Return 2 pi times ``turns`` in radians, correct to 32 digits."""
    return _rounded(_TWO_PI * Fraction(turns))


@lru_cache(maxsize=1024)
def per_radian(per_turn: float) -> DoubleDouble:
    """Return ``per_turn`` / (2 pi), correct to 32 digits."""
    return _rounded(Fraction(per_turn) / _TWO_PI)


def _rounded(exact: Fraction) -> DoubleDouble:
    hi = float(exact)
    return DoubleDouble(hi, float(exact - Fraction(hi)))


def plus(hi: Any, lo: Any, delta: Any) -> tuple[Any, Any]:
    """Return (hi, lo) plus delta, for floats or arrays (Knuth's two-sum, then the sum of the low parts)."""
    total = hi + delta
    part = total - hi
    lo = lo + ((hi - (total - part)) + (delta - part))
    high = total + lo
    return high, lo - (high - total)


def product(a: Any, b: Any) -> tuple[Any, Any]:
    """Return a * b exactly as (hi, lo), for floats or arrays (Dekker's product, for operands up to 1e290)."""
    hi = a * b
    big_a, big_b = 134217729.0 * a, 134217729.0 * b     # 2^27 + 1 splits a float into two halves
    a1, b1 = big_a - (big_a - a), big_b - (big_b - b)
    a2, b2 = a - a1, b - b1
    return hi, ((a1 * b1 - hi) + a1 * b2 + a2 * b1) + a2 * b2
