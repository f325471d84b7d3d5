"""Head laws have exact distances, speeds and first passages."""
from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.domain import TIME
from dragon_ros.core.errors import FieldError

speeds = st.floats(-3, 3)
knots = st.lists(st.tuples(st.floats(0.1, 50), speeds), min_size=1, max_size=6)
ramps = st.sampled_from(['linear', 'smooth'])


def law_of(rows, first, ramp):
    at, out = 0.0, [(0.0, first)]
    for gap, speed in rows:
        at += gap
        out.append((at, speed))
    return Profile(tuple(out), ramp)


def simpson(law, a, b):
    """Integrate a speed that is at most cubic in time; only rounding makes the result inexact."""
    return (b - a) / 6 * (law.speed_at_m_s(a) + 4 * law.speed_at_m_s(0.5 * (a + b)) + law.speed_at_m_s(b))


@given(knots, speeds, ramps, st.floats(0, 200))
def test_the_distance_is_the_integral_of_the_speed(rows, first, ramp, t_s):
    law = law_of(rows, first, ramp)
    times = sorted({*(t for t, _ in law.knots if t < t_s), t_s})
    far = sum(simpson(law, a, b) for a, b in pairwise(times))
    assert law.travelled_m(t_s) == pytest.approx(far, abs=1e-11)


@given(knots, speeds, ramps, st.floats(0, 200))
def test_the_distance_is_exact_to_the_last_digits(rows, first, ramp, t_s):
    law = law_of(rows, first, ramp)
    n = max(n for n, (t, _) in enumerate(law.knots) if t <= t_s)
    exact = sum(((Fraction(b) - Fraction(a)) * (Fraction(v) + Fraction(w)) / 2
                 for (a, v), (b, w) in pairwise(law.knots[:n + 1])), Fraction(0))
    since, (t0, v0) = Fraction(t_s) - Fraction(law.knots[n][0]), law.knots[n]
    exact += since * Fraction(v0)
    if n + 1 < len(law.knots):
        t1, v1 = law.knots[n + 1]
        length, rise = Fraction(t1) - Fraction(t0), Fraction(v1) - Fraction(v0)
        x = since / length
        exact += rise * length * (x * x / 2 if ramp == 'linear' else x**3 - x**4 / 2)
    assert abs(exact - Fraction(law.travelled_m(t_s))) <= 1e-15 * (1 + 3 * t_s)


@examples(25)
@given(knots, speeds, ramps, st.floats(-100, 100), st.sampled_from([-1, 1]))
def test_a_first_passage_is_a_passage_and_the_first(rows, first, ramp, far, sense):
    law = law_of(rows, first, ramp)
    assume(sense * far > 1e-3)
    t_s = law.passage_s(far, sense)
    looks = [t for n in range(2000) for t in [n * 0.2]]
    if t_s is None or t_s > TIME.high:
        assert all(sense * (law.travelled_m(t) - far) <= 0 for t in looks)
        return
    assert law.travelled_m(t_s) == pytest.approx(far, abs=1e-9)
    assert all(sense * (law.travelled_m(t) - far) <= 1e-12 for t in looks if t < t_s)


@examples(50)
@given(knots, speeds, ramps, st.floats(0, 200))
def test_the_extent_holds_every_distance_on_the_way(rows, first, ramp, t_s):
    law = law_of(rows, first, ramp)
    low, high = law.extent_m(t_s)
    for n in range(200):
        assert low - 1e-12 <= law.travelled_m(t_s * n / 199) <= high + 1e-12


@given(st.floats(-3, 3), st.floats(0, 200))
def test_the_extent_of_a_constant_law_is_from_its_start_to_where_it_is(speed, t_s):
    assert Head(speed).extent_m(t_s) == (min(0.0, speed * t_s), max(0.0, speed * t_s))


@given(st.floats(0.1, 3), st.floats(0.1, 3), st.floats(0.5, 9), ramps)
def test_where_a_ramp_changes_its_sign_the_leader_rests(first, second, gap_s, ramp):
    law = Profile(((0.0, first), (1.0, first), (1.0 + gap_s, -second)), ramp)
    (rest_s,) = {*law.breaks_s} - {0.0, 1.0, 1.0 + gap_s}
    assert law.speed_at_m_s(rest_s) == pytest.approx(0, abs=1e-12)
    assert 1.0 < rest_s < 1.0 + gap_s


@examples(50)
@given(knots, speeds, ramps, st.floats(0.1, 200))
def test_the_extent_is_met_where_speeds_change_their_sign_at_knots(rows, first, ramp, t_s):
    law = law_of([(gap, abs(speed) * (-1) ** n) for n, (gap, speed) in enumerate(rows)], abs(first), ramp)
    gone = [law.travelled_m(t) for t in (0.0, *law.breaks_s, t_s) if t <= t_s]
    assert law.extent_m(t_s) == (min(gone), max(gone))


def test_just_before_a_jump_the_speed_is_the_one_before_it():
    law = Profile(((0.0, 1.0), (2.0, 3.0), (2.0, -1.0), (4.0, 0.5)))
    assert [law.speed_before_m_s(t) for t in (1.0, 2.0, 3.0, 4.0, 5.0)] == [2.0, 3.0, -0.25, 0.5, 0.5]
    assert [law.speed_at_m_s(t) for t in (1.0, 2.0, 3.0, 4.0, 5.0)] == [2.0, -1.0, -0.25, 0.5, 0.5]


def test_a_jump_happens_at_its_time_and_not_at_a_tick():
    law = Profile(((0.0, 1.0), (1.0000001, 1.0), (1.0000001, -1.0)))
    assert law.travelled_m(1.0000002) == pytest.approx(1.0, abs=1e-15)
    assert (law.speed_at_m_s(1.0), law.speed_at_m_s(1.0000001)) == (1.0, -1.0)


def test_a_constant_profile_is_the_constant_law():
    for t_s in (0.0, 1.25, 412.47):
        assert Profile(((0.0, 1.1),)).travelled_m(t_s) == Head(1.1).travelled_m(t_s)


def test_a_hold_leaves_at_its_end():
    law = Profile(((0.0, 0.0), (5.0, 0.0), (5.0, -1.0)))
    assert law.passage_s(0.0, -1) == pytest.approx(5.0, abs=1e-12)
    assert law.passage_s(0.0, 1) is None


@pytest.mark.parametrize(('law', 'says'), [
    ({'knots': ()}, 'head.knots'), ({'knots': ((1.0, 1.0),)}, 'first knot must be at 0 s'),
    ({'knots': ((0.0, 1.0), (2.0, 1.0), (1.0, 1.0))}, 'head.knots.3'),
    ({'knots': ((0.0, float('inf')),)}, 'head.knots.1'),
    ({'knots': ((0.0, 1.0),), 'ramps': 'steep'}, 'linear or smooth'),
    ({'knots': ((0.0, 1.0),), 'lead': 'both'}, 'head or tail')])
def test_an_impossible_law_is_refused_by_field(law, says):
    with pytest.raises(FieldError, match=says):
        Profile(**law)
