"""Roots: an approximation in floats, then a ball that provably contains exactly one root (interval Newton method)."""
from collections.abc import Callable

from flint import arb

from dragon_ros.verify.balls import UNIT, size
from dragon_ros.verify.errors import Refused

_GOOD = 1e-13           # approximations in floats usually have smaller errors, relative to the root
_CLOSE = 1e-8         # after a Newton step of this size, relative to the root, the error is about its square
_FINE = 2.0**-112       # radius of the narrowest ball that is tested, relative to the root
_TRIES = 12


def bracketed(f: Callable[[float], tuple[float, float]], low: float, high: float, guess: float) -> float:
    """Return an approximate root of a function (value, slope) that is negative below the root and positive above it."""
    x = min(max(guess, low), high)
    for _ in range(200):
        value, slope = f(x)
        if value > 0:
            high = x
        else:
            low = x
        following = x - value / slope if slope > 0 else low
        if slope > 0 and abs(following - x) <= _CLOSE * abs(x):
            return following
        if not low < following < high:
            following = 0.5 * (low + high)
        if not low < following < high:
            return following
        x = following
    return x


def certified(value: Callable[[arb], arb], slope: Callable[[arb], arb], guess: float) -> arb:
    """Return a ball near a guess that contains exactly one root, for all numbers in the function's balls.

    Let X be a ball around m. If m - f(m) / f'(X) lies inside X, f has exactly one root in X, and this expression
    contains the root (interval Newton theorem). If the guess is too far from the root, the next Newton step
    determines how wide X must be. Raises Refused if no such ball is found.
    """
    middle, wide = arb(guess), _GOOD * abs(guess)
    for _ in range(_TRIES):
        missing = value(middle)
        within = middle + UNIT * wide
        found = middle - missing / slope(within)
        if within.contains_interior(found):
            return found
        step = missing / slope(middle)
        if not step.is_finite():
            break
        middle = (middle - step).mid()
        wide = max(2 * size(value(middle) / slope(middle)), _FINE * size(middle), 1e-300)
    raise Refused('a position on the track could not be proved: a link is about to lock, or lengths differ too much')
