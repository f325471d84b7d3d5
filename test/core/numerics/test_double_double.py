from fractions import Fraction
from math import pi

from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.numerics.double_double import DoubleDouble, from_turns, plus


@given(st.floats(0, 1e9), st.floats(-3, 3))
def test_an_angle_pair_keeps_what_one_float_loses(hi, delta):
    total = DoubleDouble(*plus(hi, 0.0, delta))
    assert Fraction(total.hi) + Fraction(total.lo) == Fraction(hi) + Fraction(delta)


def test_whole_turns_are_correct_to_32_digits():
    assert from_turns(1.0) == (2 * pi, 2.4492935982947064e-16)
