"""Angles as an unevaluated sum of two floats, so that many turns cost no digits.

``hi`` is the float nearest to the angle and ``lo`` what it misses. One float near 1e9 rad is 1e-7 rad coarse,
the pair 1e-23 rad. The trigonometry stays ordinary: cos(hi + lo) = cos(hi) - lo sin(hi) to the last digit.
"""
from fractions import Fraction
from typing import NamedTuple

_TWO_PI = Fraction('6.28318530717958647692528676655900576839433879875021164194988918461563')


class Angle(NamedTuple):
    """hi + lo in radians, |lo| at most half an ulp of hi."""

    hi: float
    lo: float


def from_turns(turns: float) -> Angle:
    """Return 2 pi turns, correct to 32 digits."""
    exact = _TWO_PI * Fraction(turns)
    hi = float(exact)
    return Angle(hi, float(exact - Fraction(hi)))


def plus(angle: Angle, delta: float) -> Angle:
    """Return angle + delta (Knuth's two-sum, then the low parts)."""
    hi, lo = angle
    total = hi + delta
    part = total - hi
    lo = lo + ((hi - (total - part)) + (delta - part))
    high = total + lo
    return Angle(high, lo - (high - total))
