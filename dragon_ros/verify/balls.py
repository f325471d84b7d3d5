"""Balls: real numbers as a middle and a radius that is rounded outwards, by Arb (python-flint).

A comparison of balls holds only where it does for all that is in them; what is not a number compares as nothing. So
every claim is asked for as the comparison that proves it, never as the absence of its contrary.
"""
from fractions import Fraction
from math import hypot, inf, isfinite, nextafter

from flint import acb, arb, ctx, fmpq

from dragon_ros.verify.errors import Refused

BITS = 128          # of a middle; tracks that are many links long or far out ask for more (``precise``)
UNIT = arb(0, 1)    # [-1, 1]


def precise(ratio: float) -> None:
    """Keep as many bits beyond what coordinates lose as there are for coordinates of the size of a link."""
    ctx.prec = BITS + 2 * max(0, int(ratio).bit_length()) if isfinite(ratio) else 4 * BITS


def half_turn() -> arb:
    """Return pi, to as many bits as are kept now."""
    return arb.pi()


def exact(value: float | Fraction) -> arb:
    """Return a float as it is, a rational number within the last bit."""
    if isinstance(value, Fraction):
        return arb(fmpq(value.numerator, value.denominator))
    return arb(value)


def above(value: arb) -> float:
    """Return a float that nothing in a ball exceeds; infinite where that is not known."""
    out = float(value.upper())
    return nextafter(out, inf) if out == out else inf


def below(value: arb) -> float:
    """Return a float that exceeds nothing in a ball; minus infinity where that is not known."""
    out = float(value.lower())
    return nextafter(out, -inf) if out == out else -inf


def size(value: arb) -> float:
    """Return a float that no absolute value in a ball exceeds; infinite where that is not known."""
    out = float(value.abs_upper())
    return nextafter(out, inf) if out == out else inf


def hypot_above(x: float, y: float) -> float:
    """Return a float that is no smaller than the root of the sum of two squares."""
    return up(hypot(x, y))


def up(value: float) -> float:
    """Return what a few float operations on positive numbers came to, raised beyond their rounding."""
    return nextafter(value * (1 + 1e-13), inf)


def direction(angle: arb) -> acb:
    """Return exp(i angle)."""
    sine, cosine = angle.sin_cos()
    return acb(cosine, sine)


def certainly(holds: bool, why: str) -> None:
    """Refuse what is not proved."""
    if not holds:
        raise Refused(why)
