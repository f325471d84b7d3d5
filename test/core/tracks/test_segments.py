"""Segments in the plane take the low part of a coordinate into account far from the origin."""
from math import inf

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mpc, mpf

from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.tracks.segments import AHEAD, BEHIND, ArcSegment, LineSegment
from dragon_ros.core.tracks.spiral import SpiralCurve, SpiralSegment

CURVE = SpiralCurve(0.55, DoubleDouble(30.0, 0.0))


@given(st.floats(10, 1e8), st.floats(-0.5, 0.5), st.sampled_from([-1, 1]), st.sampled_from([BEHIND, AHEAD]))
def test_a_spiral_heads_where_the_whole_coordinate_says_one_place_or_many(u, part, side, way):
    segment = SpiralSegment(CURVE, 3 + 4j, 0.6 + 0.8j, side, way, inf, 0.0)
    lo = part * float(np.spacing(u))
    with mpmath.workdps(50):
        whole = mpf(u) + mpf(lo)
        true = complex(way * mpc(0.6, 0.8) * mpmath.expj(side * whole) * mpc(1, side * whole)
                       / mpmath.sqrt(1 + whole**2))
    assert abs(complex(segment.heading(u, lo)) - true) < 5e-16
    assert abs(complex(segment.heading(np.array([u]), np.array([lo]))[0]) - true) < 5e-16


@given(st.floats(10, 1e8), st.floats(-0.5, 0.5), st.sampled_from([-1, 1]))
def test_an_arc_heads_where_the_whole_coordinate_says(u, part, side):
    segment = ArcSegment(1j, 3.0 + 0j, 3.0, side, -inf, inf)
    lo = part * float(np.spacing(u))
    with mpmath.workdps(50):
        true = complex(1j * side * mpmath.expj(side * (mpf(u) + mpf(lo))))
    assert abs(complex(segment.heading(u, lo)) - true) < 5e-16
    assert abs(complex(segment.heading(np.array([u]), np.array([lo]))[0]) - true) < 5e-16


@given(st.floats(1e-3, 1e6), st.floats(1e-30, 1e9) | st.floats(-1e9, -1e-30), st.floats(-0.5, 0.5))
def test_on_an_arc_a_distance_of_many_rounds_loses_no_digit_there_and_back(radius_m, metres, part):
    segment = ArcSegment(0j, radius_m + 0j, radius_m, 1, -inf, inf)
    lo = part * float(np.spacing(metres))
    u = segment.after(metres, lo)
    many = segment.after_many(np.array([metres]), np.array([lo]))
    assert (many[0][0], many[1][0]) == u
    with mpmath.workdps(60):
        exact = (mpf(metres) + mpf(lo)) / mpf(radius_m)
        assert abs(mpf(u.hi) + mpf(u.lo) - exact) <= 1e-31 * abs(exact)
        back = mpf(segment.metres(u.hi)) + mpf(segment.metres_lo(*u))
        assert abs(back - (mpf(metres) + mpf(lo))) <= 1e-31 * abs(mpf(metres))


def test_a_line_heads_one_way():
    assert LineSegment(0j, 0.6 + 0.8j, 0.0, 9.0).heading(5.0, 1e-16) == pytest.approx(0.6 + 0.8j, abs=0)


@pytest.mark.parametrize('u', [8.0, 30.0])
def test_inwards_chords_grow_up_to_an_arc_of_half_a_turn_at_the_largest_bend_and_outwards_up_to_half_a_turn(u):
    segment = SpiralSegment(SpiralCurve(0.55, DoubleDouble(60.0, 0.0)), 0j, 1 + 0j, 1, BEHIND, inf, 2.0)
    half = np.pi / (segment.bend * segment.curve.b_m * np.sqrt(1 + u * u))
    at = np.array([u])
    assert [segment.reaches_once(at, np.array([-part * half])) for part in (0.9, 1.1)] == [True, False]
    assert [segment.reaches_once(at, np.array([part * np.pi])) for part in (0.9, 1.1)] == [True, False]
