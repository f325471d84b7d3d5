"""Balls: real numbers as a midpoint and a radius that is rounded outwards (Arb, from python-flint).

A comparison of balls is true only if it holds for all numbers in the balls; comparisons with NaN are false. Each
claim is therefore tested by the comparison that proves it, never by the failure of the opposite comparison.
"""
from fractions import Fraction
from math import hypot, inf, nextafter

from flint import acb, arb, ctx, fmpq

from dragon_ros.verify.errors import Refused

ctx.prec = 192      # bits of a midpoint: 128, and twice the 25 that count the smallest links on the longest track
UNIT = arb(0, 1)    # [-1, 1]
PI = arb.pi()
ROUNDED = 1e-12     # more than the error of a distance after a dozen float operations, relative to coordinates


def exact(value: float | Fraction) -> arb:
    """Return the exact ball of a float, or a ball of a rational number that is accurate to the last bit."""
    if isinstance(value, Fraction):
        return arb(fmpq(value.numerator, value.denominator))
    return arb(value)


def above(value: arb) -> float:
    """Return a float that is an upper bound on the numbers in a ball; infinite if there is none."""
    out = float(value.upper())
    return nextafter(out, inf) if out == out else inf


def below(value: arb) -> float:
    """Return a float that is a lower bound on the numbers in a ball; minus infinity if there is none."""
    out = float(value.lower())
    return nextafter(out, -inf) if out == out else -inf


def size(value: arb) -> float:
    """Return a float that is an upper bound on the absolute values in a ball; infinite if there is none."""
    out = float(value.abs_upper())
    return nextafter(out, inf) if out == out else inf


def hypot_above(x: float, y: float) -> float:
    """Return an upper bound on the square root of a sum of two squares."""
    return up(hypot(x, y))


def up(value: float) -> float:
    """Increase the result of a few float operations on positive numbers by more than their rounding errors."""
    return nextafter(value * (1 + 1e-13), inf)


def direction(angle: arb) -> acb:
    """Return exp(i angle)."""
    sine, cosine = angle.sin_cos()
    return acb(cosine, sine)


def certainly(holds: bool, why: str) -> None:
    """Raise Refused, with the reason, unless a claim is proved."""
    if not holds:
        raise Refused(why)
