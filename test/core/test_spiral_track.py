from math import asinh, pi, sqrt

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.double_double import DoubleDouble, from_turns, plus
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.core.tracks.spiral import arc_between, points, tangents

turns = st.floats(0.01, 1000)


def closed_form(theta):
    return 0.5 * (theta * sqrt(1 + theta * theta) + asinh(theta))


@given(turns, st.floats(0, 1))
@example(16.0, 1.0)
@example(16.0, 0.0)
def test_arc_length_agrees_with_the_closed_form(start_turns, share):
    theta = 2 * pi * start_turns
    expected = closed_form(theta) - closed_form(theta * (1 - share))
    assert arc_between(theta, theta * share) == pytest.approx(expected, rel=1e-13, abs=1e-13 * closed_form(theta))


@given(turns, st.floats(-0.5, 1))
def test_inward_undoes_distance_to(start_turns, share):
    spiral = Spiral(0.55, start_turns)
    distance = share * spiral.length_m
    place = spiral.inward(distance)
    assert spiral.distance_to(place.hi) == pytest.approx(distance, rel=1e-12, abs=1e-12 * spiral.length_m)


def test_the_head_starts_at_8_8_m():
    start = Spiral().inward(0.0)
    np.testing.assert_allclose(points(Spiral().b_m, *map(np.array, start)), (8.8, 0.0), atol=1e-14)


def test_beyond_the_centre_is_an_error_with_the_limit():
    spiral = Spiral(0.55, 1.0)
    with pytest.raises(TrackEndError, match='beyond its end') as error:
        spiral.inward(spiral.length_m * 1.01)
    assert error.value.fields['limit_m'] == spiral.length_m


@given(st.floats(1e-3, 1e4))
def test_tangents_are_unit_vectors_along_the_growing_angle(theta):
    step = 1e-6 * (1 + theta)
    places = points(1.0, np.array([theta - step, theta + step]), np.zeros(2))
    direction = (places[1] - places[0]) / np.hypot(*(places[1] - places[0]))
    np.testing.assert_allclose(tangents(np.array(theta)), direction, atol=1e-5)


@given(st.floats(0, 1e9), st.floats(-3, 3))
def test_an_angle_pair_keeps_what_one_float_loses(hi, delta):
    total = DoubleDouble(*plus(hi, 0.0, delta))
    from fractions import Fraction
    assert Fraction(total.hi) + Fraction(total.lo) == Fraction(hi) + Fraction(delta)


def test_whole_turns_are_correct_to_32_digits():
    assert from_turns(1.0) == (2 * pi, 2.4492935982947064e-16)


@pytest.mark.parametrize(('field', 'value'), [('pitch_m', -0.55), ('pitch_m', 0.0), ('pitch_m', float('nan')),
                                              ('pitch_m', 'wide'), ('start_turns', -1.0), ('start_turns', True)])
def test_an_impossible_spiral_is_refused_by_field(field, value):
    with pytest.raises(FieldError, match=f'track.{field}'):
        Spiral(**{field: value})


def test_the_end_of_the_track_itself_is_a_place_to_the_last_bit():
    scene = Scene(dragon=Dragon(3, 0.5, 1.5, 0.5, 0.25), track=Spiral(1.14453125, 1), head=Head(3.0))
    assert compile_scene(scene).end.reason == 'track'
    assert np.hypot(*state(scene, compile_scene(scene).end.t_s).p[0]) == pytest.approx(0, abs=1e-6)
