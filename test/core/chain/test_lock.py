"""The position at which a chain locks, the link that locks, and the error message."""
from math import inf, pi

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain import lock
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.chain.lock import follower, head_lock_angle, lock_angle, turning_places, turns
from dragon_ros.core.errors import ChainLockError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.core.tracks.spiral import chord_of, first_peak

CLASSIC = Scene()


def test_the_classic_chain_locks_at_432_9_s_with_the_head_at_1_29_m():
    end = compile_scene(CLASSIC).end
    assert (end.reason, end.link) == ('lock', 0)
    assert end.t_s == pytest.approx(432.917923, abs=5e-7)
    angle, _ = head_lock_angle([2.86 / CLASSIC.spiral.b_m, 1.65 / CLASSIC.spiral.b_m])
    assert angle * CLASSIC.spiral.b_m == pytest.approx(1.289798, abs=5e-7)


@given(st.floats(6, 1e5))
def test_a_lock_is_where_the_first_peak_meets_the_link(chord):
    angle = lock_angle(chord)
    assert chord_of(angle, first_peak(angle, pi)[0]) == pytest.approx(chord, rel=1e-13)
    assert follower(angle * (1 + 1e-9), chord) < inf
    assert follower(angle * (1 - 1e-9), chord) == inf


def test_the_chord_has_a_first_peak_exactly_beyond_the_angle_from_which_links_can_lock():
    angle = lock._first_with_peak()
    assert first_peak(angle * (1 - 1e-9), pi)[0] == inf
    assert first_peak(angle * (1 + 1e-9), pi)[0] < inf


@given(st.floats(0.01, 5))
def test_a_short_link_never_locks(chord):
    assert lock_angle(chord) == 0.0
    assert follower(0.0, chord) == pytest.approx(chord)


@given(st.floats(0.01, 1e4), st.floats(0, 1e4))
def test_no_handle_turns_back_further_out_than_its_chord(chord, further):
    theta = chord + 4 + further
    assert follower(theta * (1 + 1e-6), chord) > follower(theta, chord)
    assert not turning_places([chord, 0.5 * chord], theta, theta + 1)
    assert all(place < chord + 4 for place in turns(chord))


def test_body_links_longer_than_the_heads_may_lock_first():
    scene = Scene(dragon=Dragon(benches=5, head_length_m=1.0, body_length_m=5.0))
    assert (compile_scene(scene).end.reason, compile_scene(scene).end.link) == ('lock', 1)
    state(scene, compile_scene(scene).end.t_s - 1e-6)
    with pytest.raises(ChainLockError, match='link 1'):
        state(scene, compile_scene(scene).end.t_s + 1e-6)
    model = compile_scene(scene).model
    with pytest.raises(ChainLockError, match='link 1'):
        model.march(compile_scene(scene).end.t_s + 2e-6)


@examples(50, long=100)
@example(2, 2.0, 2.719840097428284, 0.6743265261586981, 2.0, Head(0.37), 'exact', 'table')
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
    with pytest.raises(ChainLockError, match='432.917923') as error:
        state(CLASSIC, 433.0)
    assert error.value.fields['link'] == 0
    assert error.value.fields['radius_m'] == pytest.approx(1.289798, abs=1e-6)


def test_a_chain_without_room_at_the_start_says_so():
    with pytest.raises(ChainLockError, match='locked from the start'):
        _ = compile_scene(Scene(track=Spiral(0.01))).end


@pytest.mark.parametrize('chords', thinned(
    [[8.0], [33.0], [33.0, 20.0], [5.0, 19.0], [7.0, 7.0, 7.0]], lambda chords: len(chords) == 3))
def test_the_place_where_a_handle_turns_back_is_found_in_any_short_range_around_it(chords):
    def rear(theta):
        for chord in chords:
            theta = follower(theta, chord)
        return theta

    first = head_lock_angle(chords)[0] + 1e-3
    heads = np.linspace(first, first + 12, 6001)
    place = heads[np.argmin([rear(head) for head in heads])]
    for before, after in ((0.1, 0.05), (0.01, 0.3)):
        found = turning_places(chords, place - before, place + after)
        assert found == [pytest.approx(place, abs=heads[1] - heads[0])]


def test_a_handle_turns_back_three_times_if_the_handle_before_it_reverses_just_behind_where_its_link_does():
    low, high = head_lock_angle([8.0, 13.75])[0] + 1e-3, 6.0
    heads = np.linspace(low, high, 4001)
    rear = np.array([follower(follower(head, 8.0), 13.75) for head in heads])
    back = np.flatnonzero(np.diff(np.sign(np.diff(rear)))) + 1
    assert turning_places([8.0, 13.75], low, high) == pytest.approx(heads[back], abs=heads[1] - heads[0])
    assert back.size == 3


def broken_link(head, chords):
    """Return the first link that cannot be placed with the head at the given angle, or None if all can be placed."""
    for k, chord in enumerate(chords):
        head = follower(head, chord)
        if head == inf:
            return k
    return None


# If a link is about one pitch (2 pi) longer than the previous link, it locks where the previous link's rear handle
# turns back.
LINKS = st.one_of(st.lists(st.floats(0.5, 25), min_size=1, max_size=5),
                  st.tuples(st.floats(5, 20), st.floats(5.5, 7.5), st.floats(-3, 7)).map(
                      lambda row: [row[0], row[0] + row[1], row[0] + row[1] + row[2]]))


@examples(50, long=100)
@given(LINKS)
@example([8.0, 13.75])
@example([10.2, 16.87])
@example([6.51, 13.86, 18.24])
@example([33.0, 20.0, 25.0])
def test_outside_the_lock_of_a_mixed_chain_all_links_have_places_and_just_inside_the_named_one_has_none(chords):
    angle, link = head_lock_angle(chords)
    lowest = angle * (1 + 1e-9) + 1e-9
    for head in [lowest, *np.linspace(lowest, lowest + 8, 60), *np.linspace(lowest, lowest + 0.1, 20)]:
        assert broken_link(head, chords) is None
    assert (broken_link(angle * (1 - 1e-9), chords) if angle else 0) == link


@pytest.mark.parametrize('chord', thinned([0.3, 2.0, 4.0, 5.5, 6.0, 7.0, 8.0, 12.0, 20.0, 33.0, 60.0],
                                          (0.3, 5.5).__contains__))
def test_a_link_turns_back_exactly_where_its_rear_handle_is_nearest_or_furthest_in(chord):
    heads = np.linspace(lock_angle(chord) + 1e-6, chord + 5, 8001)
    rear = np.array([follower(head, chord) for head in heads])
    back = np.flatnonzero(np.diff(np.sign(np.diff(rear)))) + 1
    assert turns(chord) == pytest.approx(heads[back], abs=2 * (heads[1] - heads[0]))


@given(st.floats(5.6, 1e4))
def test_a_float_below_the_lock_the_rear_handle_continues_from_where_it_was_above(chord):
    angle = lock_angle(chord)
    assert lock._rear(angle * (1 - 1e-12), chord) == pytest.approx(follower(angle * (1 + 1e-12), chord), abs=1e-3)
    assert lock._rear(angle + 1, chord) == follower(angle + 1, chord)


@given(st.floats(1, 9), st.floats(0.01, 4), st.floats(0.01, 4), st.sampled_from([0.2, 1.0, 3.0]))
def test_where_a_function_reaches_0_is_found_to_four_ulps_in_few_evaluations(root, below, above, power):
    asked = []      # lock angles exceed 1 rad; near 0, where floats are dense, bisection needs more steps

    def value(x):
        asked.append(x)
        return np.sign(x - root) * abs(x - root)**power + 0.5 * (x - root)
    low, high = root - below, root + above
    found = lock._zero_of(value, low, high)
    assert low < found <= high
    assert value(found) >= 0 > value(found - 4 * np.spacing(found))
    assert power != 1.0 or len(asked) < 24
    exact = root + 0.5 * above
    assert lock._zero_of(lambda x: x - exact, low, exact) == exact     # the upper end itself
    assert lock._zero_of(lambda x: 1.0, low, high) == pytest.approx(low, abs=4e-15)
