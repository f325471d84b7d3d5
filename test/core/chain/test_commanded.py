"""A commanded leader respects its limits and stops before every end, and its past motion stays exact."""
import itertools
from dataclasses import replace
from fractions import Fraction
from math import inf

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.chain.commanded import (
    SHORT_M,
    Commanded,
    Walked,
    next_law,
    next_speed_m_s,
    profile_of,
    walked_from,
)
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.errors import FieldError
from dragon_ros.core.flags import Effect
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS, Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import led_tick, tick

LED = Commanded(max_speed_m_s=1.5, max_acceleration_m_s2=2.0)
SCENE = Scene(Dragon(benches=20), head=LED, run=Run(3, 100, 30), effects=Effect.VELOCITY | Effect.TRAILS)


def walk(scene, wanted, keep_s=10.0):
    """Return the ticks (t_s, speed) and the laws of a run in which the leader follows these commands."""
    law, rows, laws = None, [], []
    back, onwards = compile_scene(scene).model.limits
    ends_m = back.travel_m if back else -inf, onwards.travel_m if onwards else inf
    for k, wish in enumerate(wanted):
        t_s = scene.run.time_ns(k) / NS
        if law is None:
            law = walked_from(scene.head, t_s)
        else:
            law, _ = next_law(law, t_s, wish, ends_m, keep_s)
        rows.append(law.knots[-1])
        laws.append(law)
    return rows, laws


@examples(20)
@given(st.lists(st.floats(-10, 10), min_size=2, max_size=300))
@example([3.0] * 200)
@example([-3.0] * 100 + [3.0] * 100)
def test_speeds_keep_the_limits_of_speed_and_acceleration(wishes):
    rows, _ = walk(SCENE, wishes)
    assert rows[0][1] == 0
    for (before_s, one), (t_s, two) in itertools.pairwise(rows):
        assert abs(two) <= LED.max_speed_m_s
        assert abs(two - one) <= LED.max_acceleration_m_s2 * (t_s - before_s) * (1 + 1e-12)


@given(st.floats(0.1, 50), st.floats(0.001, 1), st.floats(0.01, 20), st.integers(0, 2**32))
@example(0.005, 0.02, 1.0, 0)
def test_whatever_is_commanded_the_leader_stops_short_of_both_ends(room_m, step_s, acceleration, seed):
    led, random = Commanded(max_speed_m_s=5, max_acceleration_m_s2=acceleration), np.random.default_rng(seed)
    gone, speed, most = 0.0, 0.0, led.max_acceleration_m_s2 * step_s
    for wish in np.repeat(random.uniform(-9, 9, 12), 25).tolist():
        then = next_speed_m_s(led, speed, wish, step_s, (room_m + gone, room_m - gone))
        assert abs(then - speed) <= most * (1 + 1e-9) + 1e-12
        gone, speed = gone + 0.5 * (speed + then) * step_s, then
        assert abs(gone) <= max(room_m - SHORT_M, 0) + 1e-9


@pytest.mark.parametrize(('wanted', 'end'), [(1.5, 1), (-1.5, -1)])
def test_a_leader_says_which_end_it_brakes_before_while_it_does(wanted, end):
    law, seen = walked_from(LED, 0.0), []
    for k in range(1, 301):
        law, braked = next_law(law, k / 50, wanted, (-2.0, 2.0))
        seen.append(braked)
    first = seen.index(end)
    assert seen == [0] * first + [end] * (300 - first)
    assert law.travel_m == pytest.approx(end * 2.0, abs=2 * SHORT_M)
    assert next_law(law, 301 / 50, -wanted, (-2.0, 2.0))[1] == 0        # the leader may still move back


def test_a_leader_that_is_called_back_brakes_before_the_end_that_it_still_moves_to():
    law = Walked(LED, ((0.0, 1.5),))
    assert next_law(law, 0.02, -0.1, (-inf, 0.3))[1] == 1
    assert next_law(law, 0.02, -0.1, (-inf, 30.0))[1] == 0


def test_a_law_without_ends_goes_as_it_is_wanted_and_keeps_the_last_seconds():
    law = walked_from(LED, 0.0)
    for k in range(1, 501):
        law, braked = next_law(law, k / 50, 1.0, (-inf, inf), keep_s=1.0)
        assert braked == 0
    assert law.knots[-1] == (10.0, 1.0)
    assert law.knots[0][0] <= 9.0 < law.knots[1][0]


def test_it_comes_near_an_end_that_it_is_sent_to():
    led, gone, speed = Commanded(max_acceleration_m_s2=1.0), 0.0, 0.0
    for _ in range(5000):
        then = next_speed_m_s(led, speed, 2.0, 0.02, (0.0, 10.0 - gone))
        gone, speed = gone + 0.5 * (speed + then) * 0.02, then
    assert speed == 0
    assert 10 - 2 * SHORT_M < gone < 10 - SHORT_M


@pytest.mark.parametrize('sense', [1, -1])
@pytest.mark.parametrize(('speed', 'left_m'), [(1.0, 0.27), (0.6, 0.1), (0.0, SHORT_M + 0.0012)])
def test_while_it_brakes_its_speed_leaves_exactly_the_distance_that_it_needs_to_stop(sense, speed, left_m):
    step_s, rate = 0.02, LED.max_acceleration_m_s2
    room = (inf, left_m) if sense > 0 else (left_m, inf)
    then = sense * next_speed_m_s(LED, sense * speed, 1.5 * sense, step_s, room)
    assert 0 < then < speed + rate * step_s
    needed = 0.5 * (speed + then) * step_s + then**2 / (2 * rate)
    assert needed == pytest.approx(left_m - SHORT_M - rate * step_s**2, abs=1e-12)


@given(st.lists(st.sampled_from([0.0, 1.2, 0.4, -0.9, 2.0]) | st.floats(-2, 2), min_size=2, max_size=20),
       st.integers(1, 40))
@example([0.0, 1.2, 0.4], 40)
def test_a_distance_walked_has_the_bits_of_that_of_the_profile(wishes, repeats):
    rows, laws = walk(SCENE, np.repeat(wishes, repeats).tolist())
    profile = profile_of(SCENE.head, rows)
    for (t_s, _), law in zip(rows, laws, strict=True):
        assert law.travelled_m(t_s).hex() == profile.travelled_m(t_s).hex()


@pytest.mark.parametrize('lead', thinned(['head', 'tail'], lambda lead: lead == 'tail'))
def test_a_led_tick_has_the_bits_of_a_profile_of_what_was_walked(lead):
    scene = replace(SCENE, head=replace(LED, lead=lead))
    wishes = np.repeat([0.0, 1.2, 0.4, -0.9, 2.0, 0.0], 40).tolist()
    rows, laws = walk(scene, wishes)
    offline = replace(scene, head=profile_of(scene.head, rows), run=replace(scene.run, stop_s=rows[-1][0]))
    assert len(offline.head.knots) < len(rows)      # a period of constant speed needs only two knots
    for k, law in [*enumerate(laws)][::7]:
        led, other = led_tick(compile_scene(scene), law, k), tick(offline, k)
        assert led.chain.p.tobytes() == other.chain.p.tobytes()
        assert led.velocity_m_s.tobytes() == other.velocity_m_s.tobytes()
        assert led.trail_m.tobytes() == other.trail_m.tobytes()
        assert (led.leader.speed_m_s, led.leader.turn_rad_s) == (other.leader.speed_m_s, other.leader.turn_rad_s)
        assert led.leader.speed_m_s == rows[k][1]


@given(st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=50), st.floats(0, 3))
def test_what_is_walked_is_the_exact_integral_whatever_is_forgotten(speeds, keep_s):
    law = walked_from(LED, 0.3)
    whole = Walked(LED, law.knots)
    for n, speed in enumerate(speeds, 1):
        law, whole = (one.walked_on(0.3 + n / 7, speed, keep) for one, keep in ((law, keep_s), (whole, 1e9)))
    exact = sum(((Fraction(t2) - Fraction(t1)) * (Fraction(v1) + Fraction(v2)) / 2
                 for (t1, v1), (t2, v2) in zip(whole.knots, whole.knots[1:], strict=False)), Fraction(0))
    assert law.travel_m == whole.travel_m
    for found in (law.travel_m, law.travelled_m(law.knots[-1][0])):     # a ramp's end is rounded in its own way
        assert found == pytest.approx(float(exact), rel=1e-15, abs=1e-16)
    assert len(law.knots) <= keep_s * 7 + 3         # memory does not grow with the run
    assert law.acceleration_at_m_s2(law.knots[-1][0]) == pytest.approx((speeds[-1] - ([0.0, *speeds])[-2]) * 7)


@given(st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=12), st.floats(0, 1), st.sampled_from([0.0, 0.5, 9.0]))
def test_between_ticks_a_walked_law_is_the_integral_of_its_ramps_and_its_last_speed_continues(speeds, share, keep_s):
    times = [0.3 + n / 7 for n in range(len(speeds) + 1)]
    law = walked_from(LED, times[0])
    for t_s, speed in zip(times[1:], speeds, strict=True):
        law = law.walked_on(t_s, speed, keep_s)
    known, all_speeds = law.knots[0][0], [0.0, *speeds]
    for t_s in [*np.linspace(known, times[-1], 9), known + share * (times[-1] - known), times[-1] + share]:
        fine = np.unique([*np.linspace(times[0], t_s, 7), *(one for one in times if one < t_s), t_s])
        speed = np.interp(fine, times, all_speeds)
        assert law.speed_at_m_s(float(t_s)) == pytest.approx(speed[-1], abs=1e-12)
        gone = float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine)))
        assert law.travelled_m(float(t_s)) == pytest.approx(gone, abs=1e-12)
    assert law.travelled_m(np.array(times[-1:])) == law.travelled_m(times[-1])


def test_the_leading_handle_moves_as_it_says():
    for lead in ('head', 'tail'):
        scene = replace(SCENE, head=replace(LED, lead=lead))
        _, laws = walk(scene, [1.0] * 60)
        one, two = (led_tick(compile_scene(scene), laws[k], k) for k in (57, 58))
        moved = (two.leader.p - one.leader.p) * 30
        np.testing.assert_allclose(moved, one.leader.speed_m_s * one.leader.direction, atol=0.01)
        (ax, ay), (bx, by) = one.leader.direction, two.leader.direction
        turn = (ax * by - ay * bx) * 30
        assert turn == pytest.approx(one.leader.turn_rad_s, rel=0.01)


def test_a_led_scene_alone_says_that_its_way_is_in_a_bag():
    for ask in (lambda: tick(SCENE, 5), lambda: first_contact(SCENE)):
        with pytest.raises(FieldError, match=r'give its bag'):
            ask()


@pytest.mark.parametrize('settings', [{'timeout_s': 0}, {'max_speed_m_s': 0}, {'max_acceleration_m_s2': -1},
                                      {'max_speed_m_s': float('nan')}, {'lead': 'nose'}])
def test_limits_that_are_none_are_refused(settings):
    with pytest.raises(FieldError, match=next(iter(settings))):
        Commanded(**settings)


def test_a_led_scene_always_has_its_leader():
    assert Effect.LEADER in Scene(head=LED, run=Run(0, 5), effects=Effect.NONE).effects


def test_at_the_start_a_walked_law_has_the_rate_of_its_first_ramp():
    law = Walked(LED, ((0.0, 0.0), (0.5, 1.0), (1.0, 1.0), (1.5, 0.5)))
    assert [law.acceleration_at_m_s2(t_s) for t_s in (0.0, 0.2, 0.5, 0.7, 1.5, 2.0)] == [2, 2, 2, 0, -1, 0]
