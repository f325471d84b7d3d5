from math import inf, pi

import numpy as np
import pytest
from dragon_ros.core.march_many import place_many
from dragon_ros.core.rates import speeds
from hypothesis import assume, given
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.chain.lock import follower, head_lock_angle, lock_angle
from dragon_ros.core.errors import ChainLockError, FieldError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.paper import place
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state, states
from dragon_ros.core.tracks.chord import chord_of, first_guess, first_peak, step
from dragon_ros.core.tracks.segments import Effort
from dragon_ros.core.tracks.spec import Spiral

TOLERANCE = 1e-8
EFFORT = Effort(TOLERANCE)
CLASSIC = Scene()
CLASSIC_TIMES = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0, 400.0, 412.473837682, 430.0, 432.9179]


def test_handle_1_at_the_start_is_where_the_recipe_says():
    assert state(CLASSIC, 0.0).p[1] == pytest.approx((8.363823851, 2.826543891), abs=1e-9)


def test_the_tail_at_300_s_is_where_the_recipe_says():
    assert state(CLASSIC, 300.0).p[223] == pytest.approx((1.785033, 9.301164), abs=1e-6)


@pytest.mark.parametrize('t_s', CLASSIC_TIMES)
def test_links_keep_their_lengths_to_1e_12_m(t_s):
    assert state(CLASSIC, t_s).worst[0] < 1e-14 * 20


@given(st.floats(0.05, 500), st.floats(0.01, 1000))
def test_a_step_spans_its_chord_and_is_the_smallest_root(theta, chord):
    delta, _ = step(theta, chord, first_guess(theta, chord), TOLERANCE)
    assume(delta < inf)
    assert chord_of(theta, delta) == pytest.approx(chord, rel=1e-14)
    before = np.linspace(0, delta, 2000)[:-1]
    inside = np.sqrt(before**2 + 4 * theta * (theta + before) * np.sin(before / 2) ** 2)
    assert np.all(inside < chord)


def test_a_link_of_zero_length_puts_its_handles_in_one_place():
    scene = Scene(dragon=Dragon(benches=5, head_length_m=2.0, body_length_m=0.55))
    chain = state(scene, 10.0)
    assert np.all(chain.p[1:] == chain.p[1])
    speed = speeds(chain, 1.0)
    assert np.all(speed[1:] == speed[1])


def test_the_classic_chain_locks_at_432_9_s_with_the_head_at_1_29_m():
    end = CLASSIC.end
    assert (end.reason, end.link) == ('lock', 0)
    assert end.t_s == pytest.approx(432.917924, abs=5e-7)
    angle, _ = head_lock_angle([2.86 / CLASSIC.track.b_m, 1.65 / CLASSIC.track.b_m])
    assert angle * CLASSIC.track.b_m == pytest.approx(1.289798, abs=5e-7)


@given(st.floats(6, 1e5))
def test_a_lock_is_where_the_first_peak_meets_the_link(chord):
    angle = lock_angle(chord)
    assert chord_of(angle, first_peak(angle, pi)[0]) == pytest.approx(chord, rel=1e-13)
    assert follower(angle * (1 + 1e-9), chord) < inf
    assert follower(angle * (1 - 1e-9), chord) == inf


@given(st.floats(0.01, 5))
def test_a_short_link_never_locks(chord):
    assert lock_angle(chord) == 0.0
    assert follower(0.0, chord) == pytest.approx(chord)


def test_body_links_longer_than_the_heads_may_lock_first():
    scene = Scene(dragon=Dragon(benches=5, head_length_m=1.0, body_length_m=5.0))
    assert (compile_scene(scene).end.reason, compile_scene(scene).end.link) == ('lock', 1)
    state(scene, compile_scene(scene).end.t_s - 1e-6)
    with pytest.raises(ChainLockError, match='link 1'):
        state(scene, compile_scene(scene).end.t_s + 1e-6)
    spiral = scene.track
    head = spiral.inward(compile_scene(scene).end.t_s + 1e-6)
    with pytest.raises(ChainLockError, match='link 1'):
        place(spiral, scene.dragon.link_lengths_m, head, EFFORT)


@given(st.integers(2, 12), st.floats(0.6, 4), st.floats(0.6, 3.5), st.floats(0.3, 2), st.floats(2, 20),
       st.sampled_from([Head(1.0), Head(0.37), Profile(((0.0, 1.3), (3.0, 0.6)), 'smooth')]),
       st.sampled_from(['exact', 'preview']), st.sampled_from(['table', 'march']))
def test_at_the_very_time_of_a_lock_every_link_has_a_place(benches, head, body, pitch, turns, law, accuracy, solver):
    try:
        scene = Scene(Dragon(benches, head, body, 0.05), Spiral(pitch, turns), law, accuracy=accuracy, solver=solver)
        assume(compile_scene(scene).limit.reason == 'lock')
    except ChainLockError:
        assume(False)
    assert np.all(np.isfinite(state(scene, compile_scene(scene).limit.t_s).p))
    assert np.all(np.isfinite(states(scene, [0.0, compile_scene(scene).limit.t_s]).p))
    with pytest.raises(ChainLockError):
        state(scene, np.nextafter(compile_scene(scene).limit.t_s, np.inf))


def test_a_time_beyond_the_lock_is_an_error_with_time_link_and_radius():
    with pytest.raises(ChainLockError, match='432.917924') as error:
        state(CLASSIC, 433.0)
    assert error.value.fields['link'] == 0
    assert error.value.fields['radius_m'] == pytest.approx(1.289798, abs=1e-6)


def test_a_chain_without_room_at_the_start_says_so():
    with pytest.raises(ChainLockError, match='locked from the start'):
        _ = compile_scene(Scene(track=Spiral(0.01))).end


def test_many_states_at_once_agree_with_single_ones():
    many = states(CLASSIC, CLASSIC_TIMES)
    for row, t_s in zip(many.p, CLASSIC_TIMES, strict=True):
        np.testing.assert_allclose(row, state(CLASSIC, t_s).p, rtol=0, atol=1e-12)


@given(st.floats(0.1, 3), st.floats(2, 40), st.floats(1, 6), st.floats(0.6, 6))
def test_one_chain_and_many_agree_wherever_there_is_one(pitch, start, head, body):
    links = Dragon(30, head, body).link_lengths_m
    spiral = Spiral(pitch, start)
    place_at = spiral.inward(0.0)
    try:
        alone = place(spiral, links, place_at, EFFORT)
    except ChainLockError as error:
        with pytest.raises(ChainLockError, match=f'link {error.fields["link"]}'):
            place_many(spiral, links, np.array([place_at.hi]), np.array([place_at.lo]), EFFORT)
        return
    together = place_many(spiral, links, np.array([place_at.hi]), np.array([place_at.lo]), EFFORT)
    np.testing.assert_allclose(together.p[0], alone.p, rtol=0, atol=1e-12 * float(np.max(np.abs(alone.p))))
    assert np.all(alone.delta > 0)


def test_speed_of_handle_1_at_the_start_is_what_the_recipe_says():
    assert np.hypot(*state(CLASSIC, 0.0).velocities(1.0)[1]) == pytest.approx(0.999971038, abs=1e-9)


@pytest.mark.parametrize('t_s', [0.0, 300.0, 412.0, 432.9])
def test_velocities_keep_every_link_rigid(t_s):
    chain = state(CLASSIC, t_s)
    v, axis = chain.velocities(1.0), np.diff(chain.p, axis=0)
    stretching = np.sum(np.diff(v, axis=0) * axis, axis=1)
    assert np.max(np.abs(stretching)) < 1e-12 * float(np.max(np.abs(v)))


@pytest.mark.parametrize('t_s', [10.0, 300.0, 412.0])
def test_velocities_are_the_rate_of_the_positions(t_s):
    h = 1e-4
    slope = (state(CLASSIC, t_s + h).p - state(CLASSIC, t_s - h).p) / (2 * h)
    np.testing.assert_allclose(state(CLASSIC, t_s).velocities(1.0), slope, atol=1e-7)


def test_a_head_that_moves_out_moves_every_handle_back():
    chain = state(CLASSIC, 100.0)
    np.testing.assert_array_equal(chain.velocities(-1.0), -chain.velocities(1.0))


@pytest.mark.parametrize(('field', 'value'), [
    ('benches', 0), ('benches', 2.0), ('width_m', 0.0), ('head_length_m', 0.5), ('body_length_m', -2.2),
    ('hole_inset_m', -0.1), ('hole_inset_m', float('inf'))])
def test_impossible_benches_are_refused_by_field(field, value):
    with pytest.raises(FieldError, match='dragon.'):
        Dragon(**{field: value})
