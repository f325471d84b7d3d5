"""The chord equation of a spiral is solved stably, for the smallest root, and as fast as by Newton's method."""
from math import inf

import mpmath
import numpy as np
import pytest
from convergence import errors_of, newton_iterates, order_of
from hypothesis import assume, given
from hypothesis import strategies as st

from dragon_ros.core.tracks.spiral import chord_excess, chord_of, first_guess, phi_of, step


@given(st.floats(0.05, 500), st.floats(0.01, 1000))
def test_a_step_spans_its_chord_and_is_the_smallest_root(theta, chord):
    delta, _ = step(theta, chord, first_guess(theta, chord))
    assume(delta < inf)
    assert chord_of(theta, delta) == pytest.approx(chord, rel=1e-14)
    before = np.linspace(0, delta, 2000)[:-1]
    inside = np.sqrt(before**2 + 4 * theta * (theta + before) * np.sin(before / 2) ** 2)
    assert np.all(inside < chord)


def test_the_plain_cosine_rule_loses_the_digits_that_the_stable_form_keeps():
    # Far out a link spans a small angle: r1^2 + r2^2 - 2 r1 r2 cos(delta) cancels, but the stable form does not.
    theta, delta = 1.23456789e8, 1.37e-7
    with mpmath.workdps(50):
        a, b = mpmath.mpf(theta), mpmath.mpf(theta) + mpmath.mpf(delta)
        true = mpmath.sqrt(a * a + b * b - 2 * a * b * mpmath.cos(mpmath.mpf(delta)))
    outer = theta + delta
    plain = np.sqrt(theta * theta + outer * outer - 2 * theta * outer * np.cos(delta))
    assert abs(chord_of(theta, delta) / true - 1) < 1e-15
    assert abs(plain / true - 1) > 1e-5


def test_newton_on_the_chord_equation_converges_quadratically():
    with mpmath.workdps(400):
        theta, chord = mpmath.mpf(50), mpmath.mpf(18)

        def excess(delta):
            s = mpmath.sin(delta / 2)
            phi = delta + 2 * theta * s * (s + (theta + delta) * mpmath.cos(delta / 2))
            return (delta**2 - chord**2) / 2 + 2 * theta * (theta + delta) * s**2, phi
        value, slope = chord_excess(50.0, 18.0, 0.4)
        exact = excess(mpmath.mpf(0.4))
        assert (value, slope) == pytest.approx((float(exact[0]), float(exact[1])), rel=1e-13)
        assert phi_of(50.0, 0.4) == slope
        iterates = newton_iterates(excess, mpmath.mpf('0.3'), 7)
        assert order_of(errors_of(iterates[:-1], iterates[-1])) == pytest.approx(2.0, abs=0.05)
