"""The root finders of the core, and their orders of convergence."""
import mpmath
import numpy as np
import pytest
from convergence import errors_of

from dragon_ros.core.numerics.roots import bracketed_newton, illinois


def test_the_illinois_variant_beats_linear_and_its_bracketed_newton_is_quadratic():
    seen = []

    def f(x):
        seen.append(x)
        return np.exp(x) - 2.0
    root = np.log(2.0)
    assert illinois(f, 0.0, 1.0, -1.0, np.e - 2) == pytest.approx(root, abs=1e-15)
    assert len(seen) <= 10
    x, evaluations = bracketed_newton(lambda x: (np.exp(x) - 2, np.exp(x)), 0.0, 1.0, 1.0)
    assert x == pytest.approx(root, abs=1e-15)
    assert evaluations <= 7


def test_illinois_has_order_1_44():
    with mpmath.workdps(600):
        # A cycle of three steps multiplies the number of digits by 3 (Dowell & Jarratt 1971), which is 3^(1/3) per
        # step.
        seen, a, b = [], mpmath.mpf(0), mpmath.mpf(1)
        fa, fb = mpmath.exp(a) - 2, mpmath.exp(b) - 2
        for _ in range(24):
            x = b - fb * (b - a) / (fb - fa)
            fx = mpmath.exp(x) - 2
            seen.append(x)
            if (fx > 0) == (fb > 0):
                fa, b, fb = fa / 2, x, fx
            else:
                a, fa, b, fb = b, fb, x, fx
        logs = errors_of(seen, mpmath.log(2))
    cycles = [logs[n + 3] / logs[n] for n in range(len(logs) - 4, len(logs) - 10, -1) if logs[n] < -3]
    assert np.exp(np.mean(np.log(cycles)) / 3) == pytest.approx(3 ** (1 / 3), abs=0.06)


@pytest.mark.parametrize(('low', 'high'), [(1.0, 2.0), (2.0, 1.0), (1.4, 1.5), (0.0, 1e6)])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_illinois_ends_at_the_root_where_the_function_has_the_sign_of_the_high_end(low, high, sign):
    def f(x):
        return sign * (x * x - 2.0)     # no float is a root
    x = illinois(f, low, high, f(low), f(high))
    assert abs(x - 2 ** 0.5) <= 2 * 2.0 ** -52
    assert (f(x) > 0) == (f(high) > 0)
