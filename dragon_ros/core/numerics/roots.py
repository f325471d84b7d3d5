"""The root finders for the scalar equations of the core: Newton's method within a bracket, and regula falsi."""
from collections.abc import Callable
from math import inf, nextafter

_ULP = 2.0 ** -52


def bracketed_newton(function: Callable[[float], tuple[float, float]], low: float, high: float, start: float,
                     tolerance: float = 0.0) -> tuple[float, int]:
    """Return the root of an increasing function in [low, high] and the number of evaluations.

    ``function(x)`` returns (value, slope). The function must change sign once in the bracket, from minus to plus. The
    result has converged when a Newton step is at most ``tolerance`` times |x|, or any step is at most one ulp. A step
    that leaves the bracket, or shrinks too slowly, is replaced by bisection; the next step may be as long as this one.
    """
    x = min(max(start, low), high)
    last = high - low
    for evaluations in range(1, 400):
        value, slope = function(x)
        if value > 0:
            high = x
        elif value < 0:
            low = x
        else:
            return x, evaluations
        step = value / slope if slope > 0 else inf
        following, close, longest = x - step, max(tolerance, _ULP), 1.0
        if abs(step) > max(tolerance, _ULP) * abs(following) and (
                not low <= following <= high or abs(step) > 0.5 * last):
            following = low + 0.5 * (high - low)
            step, close, longest = following - x, _ULP, 2.0
        last = longest * abs(step)
        if abs(step) <= close * abs(following) or nextafter(low, high) >= high:
            return min(max(following, low), high), evaluations
        x = following
    return x, evaluations


def illinois(function: Callable[[float], float], low: float, high: float, at_low: float, at_high: float) -> float:
    """Return the root of a function with opposite signs at ``low`` and ``high``: regula falsi, Illinois variant.

    The method needs no slope, and converges with order 3^(1/3) (Dowell & Jarratt 1971). The result is the end of the
    last bracket at which the function has the sign of ``at_high``, or an exact root.
    """
    old, new, at_old, at_new = low, high, at_low, at_high
    for _ in range(200):
        x = new - at_new * (new - old) / (at_new - at_old)
        if not min(old, new) < x < max(old, new):
            x = old + 0.5 * (new - old)
        value = function(x)
        if value == 0.0:
            return x
        if (value > 0) == (at_new > 0):
            at_old *= 0.5
        else:
            old, at_old = new, at_new
        new, at_new = x, value
        if abs(new - old) <= 2 * _ULP * max(abs(new), abs(old)) or abs(at_new) < 1e-300:
            break
    return new if (at_new > 0) == (at_high > 0) else old
