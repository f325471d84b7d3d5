"""Segments in the plane: headings, distances and points to the last digits, however long or flat they are."""
from math import inf

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mpmath import mpc, mpf

from dragon_ros.core.tracks.segments import AHEAD, BEHIND, ArcSegment, LineSegment
from dragon_ros.core.tracks.spiral import SpiralCurve, SpiralSegment

CURVE = SpiralCurve(0.55, 30.0)


@given(st.floats(1, 4e4), st.sampled_from([-1, 1]), st.sampled_from([BEHIND, AHEAD]))
def test_a_spiral_heads_where_its_coordinate_says_one_place_or_many(u, side, way):
    segment = SpiralSegment(CURVE, 3 + 4j, 0.6 + 0.8j, side, way, inf, 0.0)
    with mpmath.workdps(50):
        true = complex(way * mpc(0.6, 0.8) * mpmath.expj(side * mpf(u)) * mpc(1, side * mpf(u))
                       / mpmath.sqrt(1 + mpf(u)**2))
    assert abs(complex(segment.heading(u)) - true) < 1e-15
    assert abs(complex(segment.heading(np.array([u]))[0]) - true) < 1e-15


@given(st.floats(0.01, 1e9), st.floats(-1e6, 1e6), st.sampled_from([-1, 1]))
@example(1e9, 1e6, 1)
@example(1e9, 20.0, -1)
def test_a_point_on_an_arc_is_exact_however_far_away_its_centre_is(radius_m, metres, side):
    segment = ArcSegment(3 + 4j, 0.6 + 0.8j, radius_m, side, -inf, inf)
    u = segment.after(metres)
    assert u * radius_m == pytest.approx(metres, rel=3e-16)
    with mpmath.workdps(50):
        turn, direction = mpmath.expj(side * mpf(u)), mpc(0.6, 0.8)
        true = mpc(3, 4) - 1j * side * mpf(radius_m) * direction * (turn - 1)
        for found in (segment.at(u), segment.at(np.array([u]))[0], segment.poses(np.array([u]))[0][0]):
            assert abs(mpc(complex(found)) - true) <= 4e-16 * (5 + min(2 * radius_m, abs(metres)))
        for found in (segment.heading(u), segment.poses(np.array([u]))[1][0]):
            assert abs(mpc(complex(found)) - direction * turn) < 1e-15


def test_a_line_heads_one_way():
    assert LineSegment(0j, 0.6 + 0.8j, 0.0, 9.0).heading(5.0) == pytest.approx(0.6 + 0.8j, abs=0)


@pytest.mark.parametrize('u', [8.0, 30.0])
def test_inwards_chords_grow_up_to_an_arc_of_half_a_turn_at_the_largest_bend_and_outwards_up_to_half_a_turn(u):
    segment = SpiralSegment(SpiralCurve(0.55, 60.0), 0j, 1 + 0j, 1, BEHIND, inf, 2.0)
    half = np.pi / (segment.bend * segment.curve.b_m * np.sqrt(1 + u * u))
    at = np.array([u])
    assert [segment.reaches_once(at, np.array([-part * half])) for part in (0.9, 1.1)] == [True, False]
    assert [segment.reaches_once(at, np.array([part * np.pi])) for part in (0.9, 1.1)] == [True, False]
