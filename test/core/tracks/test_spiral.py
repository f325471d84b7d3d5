from math import asinh, pi, sqrt

import mpmath
import numpy as np
import pytest
from convergence import errors_of, newton_iterates, order_of
from hypothesis import example, given
from hypothesis import strategies as st

from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.segments import AHEAD, BEHIND
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.core.tracks.spiral import (
    SpiralCurve,
    arc_between,
    first_guess,
    furthest_in,
    step,
    steps,
)

turns = st.floats(0.01, 760)


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
    spiral = SpiralCurve.of(Spiral(0.55, start_turns))
    distance = share * spiral.length_m
    place = spiral.inward(distance)
    assert spiral.distance_to(place) == pytest.approx(distance, rel=1e-12, abs=1e-12 * spiral.length_m)


def test_the_head_starts_at_8_8_m():
    assert track_of(Spiral()).segments[0].at(SpiralCurve.of(Spiral()).inward(0.0)) == pytest.approx(8.8, abs=1e-13)


def test_beyond_the_centre_is_an_error_with_the_limit():
    spiral = SpiralCurve.of(Spiral(0.55, 1.0))
    with pytest.raises(TrackEndError, match='beyond the centre') as error:
        spiral.inward(spiral.length_m * 1.01)
    assert error.value.fields['limit_m'] == spiral.length_m


@given(st.floats(1e-3, 760), st.lists(st.floats(-2.0, 1.0) | st.sampled_from([0.0, 1.0, 1e-9, 1 - 1e-9]), min_size=1,
                                       max_size=20))
def test_places_inward_all_at_once_are_those_one_by_one(start_turns, shares):
    spiral = SpiralCurve.of(Spiral(0.55, start_turns))
    metres = spiral.length_m * np.array(shares)
    found = spiral.inward(metres)
    each = np.array([spiral.inward(one) for one in metres.tolist()])
    off_m = (found - each) * spiral.b_m * np.hypot(1, each)
    assert np.all(np.abs(off_m) <= 1e-15 * (spiral.b_m + spiral.length_m + np.abs(metres)))
    with pytest.raises(TrackEndError, match='beyond the centre'):
        spiral.inward(np.array([*metres, spiral.length_m + 1e-5]))


@pytest.mark.parametrize(('field', 'value'), [('pitch_m', -0.55), ('pitch_m', 0.0), ('pitch_m', float('nan')),
                                              ('pitch_m', 'wide'), ('start_turns', -1.0), ('start_turns', True)])
def test_an_impossible_spiral_is_refused_by_field(field, value):
    with pytest.raises(FieldError, match=f'track.{field}'):
        Spiral(**{field: value})


def test_newton_on_the_arc_length_converges_quadratically():
    with mpmath.workdps(400):
        theta = mpmath.mpf(100)

        def arc(th):
            return (th * mpmath.sqrt(1 + th**2) + mpmath.asinh(th)) / 2

        def excess(turned):
            return arc(theta) - arc(theta - turned) - 3000, mpmath.sqrt(1 + (theta - turned) ** 2)
        assert arc_between(100.0, 30.0) == pytest.approx(float(excess(mpmath.mpf(30))[0]) + 3000, rel=1e-14)
        iterates = newton_iterates(excess, mpmath.mpf(36), 7)
        assert order_of(errors_of(iterates[:-1], iterates[-1])) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize('theta', [5.0, 20.0, 1e4])
@pytest.mark.parametrize('share', [0.01, 0.5, 1.0])
def test_first_guesses_of_links_are_within_a_thirtieth_both_outwards_and_inwards(theta, share):
    chord = share * theta
    outwards, _ = step(theta, chord, first_guess(theta, chord))
    inwards, _ = step(theta, chord, -0.5 * share, furthest_in(theta, 3 * chord))
    assert first_guess(np.array([theta]), chord) == pytest.approx([outwards], rel=1 / 30)
    assert first_guess(np.array([theta]), chord, -1.0) == pytest.approx([inwards], rel=1 / 30)


@pytest.mark.parametrize(('theta', 'share', 'most'), [
    (3.0, 0.01, 4), (3.0, 0.5, 4), (20.0, 0.01, 3), (20.0, 1.0, 3), (100.0, 0.1, 2), (1e4, 0.1, 1), (1e4, 1.0, 2)])
def test_links_take_few_evaluations_from_their_first_guesses(theta, share, most):
    chord, many = share * theta, np.full(3, theta)
    furthest = furthest_in(theta, 3 * chord)
    assert step(theta, chord, first_guess(theta, chord))[1] <= most
    assert steps(many, chord, first_guess(many, chord))[1] <= 3 * most
    assert step(theta, chord, first_guess(theta, chord, -1.0), furthest)[1] <= most
    assert steps(many, chord, first_guess(many, chord, -1.0), furthest)[1] <= 3 * most


def test_one_wide_link_among_many_is_the_only_one_that_takes_more_evaluations():
    theta, chords = np.full(50, 20.0), np.array([41.0] + 49 * [10.0])
    delta, evaluations = steps(theta, chords, first_guess(theta, chords))
    assert delta == pytest.approx([step(20.0, one, first_guess(20.0, one))[0] for one in chords.tolist()], rel=1e-15)
    assert delta[0] > 2.0
    assert evaluations <= 3 * 50 + 20


@pytest.mark.parametrize('inner', [4.9, 5.1, 7.0, 9.9, 10.1, 13.0])
@pytest.mark.parametrize('start_turns', [3.0, 16.0])
def test_places_some_radians_from_the_centre_are_exact_to_the_last_digit(inner, start_turns):
    spiral = SpiralCurve.of(Spiral(0.55, start_turns))
    distance_m = spiral.distance_to(inner)
    found = spiral.inward(distance_m)
    with mpmath.workdps(40):
        def half_arc(theta):
            return theta * mpmath.sqrt(1 + theta * theta) + mpmath.asinh(theta)
        b, start = mpmath.mpf(0.55) / (2 * mpmath.pi), 2 * mpmath.pi * mpmath.mpf(start_turns)
        wanted = half_arc(start) - 2 * mpmath.mpf(distance_m) / b
        true = mpmath.findroot(lambda theta: half_arc(theta) - wanted, inner)
        assert abs(mpmath.mpf(found) - true) < 1e-15 * (1 + spiral.start)


@pytest.mark.parametrize('theta', [1.0, 5.0, 20.0])
@pytest.mark.parametrize('share', [0.1, 0.5, 1.0])
def test_inwards_a_bad_first_guess_leads_to_the_same_place_in_few_more_steps(theta, share):
    chord = share * theta
    furthest = furthest_in(theta, 3 * chord)
    found, _ = step(theta, chord, -1.2 * share, furthest)
    for guess in (1.0, -3.0, -8.0):
        other, evaluations = step(theta, chord, guess, furthest)
        assert other == pytest.approx(found, rel=1e-15)
        assert evaluations <= 9


def test_inwards_links_behind_the_third_are_predicted_so_well_that_they_take_one_step():
    segment, count = track_of(Spiral(0.55, 16.0), AHEAD).segments[0], 100
    found, evaluations = segment.march(200.0, [1.65] * count, AHEAD, segment.last)
    assert len(found) == count
    assert evaluations <= count + 10


def test_a_march_ends_with_the_first_handle_beyond_its_edge():
    out, winds_in = (track_of(Spiral(0.55, 16.0), direction).segments[0] for direction in (BEHIND, AHEAD))
    begin, links_m = 130.0, [1.65] * 100
    found, evaluations = out.march(begin, links_m, BEHIND, 130.5)
    assert len(found) == 3
    assert evaluations <= 8
    found, evaluations = winds_in.march(begin, links_m, AHEAD, 129.5)
    assert len(found) == 3
    assert evaluations <= 8
