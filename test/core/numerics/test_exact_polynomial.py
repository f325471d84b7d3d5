"""Polynomials in integer arithmetic are bit-identical to rational arithmetic."""
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.numerics.exact_polynomial import ExactPolynomial

numbers = st.floats(-1e12, 1e12)
fractions = st.builds(lambda a, b: Fraction(a) / Fraction(b), numbers, st.floats(1e-9, 1e9))


@given(numbers, st.lists(fractions, min_size=1, max_size=5), numbers)
def test_values_are_those_of_rational_arithmetic_rounded_once(origin, coefficients, t):
    since = Fraction(t) - Fraction(origin)
    exact = sum((one * since**n for n, one in enumerate(coefficients)), Fraction(0))
    high = float(exact)
    polynomial = ExactPolynomial(origin, coefficients)
    assert polynomial.at(t) == high
    assert polynomial.halves_at(t) == (high, float(exact - Fraction(high)))


def test_a_value_beyond_all_floats_is_an_error():
    with pytest.raises(OverflowError):
        ExactPolynomial(0.0, [Fraction(0), Fraction(10)**300]).at(1e10)
