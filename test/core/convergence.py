"""Observed orders of convergence, computed from iterates with hundreds of digits."""
import mpmath


def errors_of(iterates, root):
    """Return the log10 errors of the iterates, except errors below 1e-300, where digits run out."""
    logs = [float(mpmath.log10(abs(x - root))) for x in iterates if x != root]
    return [e for e in logs if e > -300]


def order_of(logs):
    """Return the observed order of convergence from the last errors."""
    tail = logs[-3:]
    return tail[2] / tail[1] if abs(tail[1]) > 1 else float('nan')


def newton_iterates(value_and_slope, x, count):
    out = [x]
    for _ in range(count):
        value, slope = value_and_slope(out[-1])
        out.append(out[-1] - value / slope)
    return out
