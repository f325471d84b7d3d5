"""Forward placement places a chain handle by handle, at one instant or at many."""
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain.chain import marched, marched_many
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.forward import (
    blocks_of,
    by_segment,
    forward,
    forward_many,
    next_places,
    row_by_row,
    together,
)
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.chain.lock import follower, lock_angle, turning_places
from dragon_ros.core.errors import ChainLockError, TrackEndError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import Place, track_of
from dragon_ros.core.tracks.segments import AHEAD, BEHIND, NEW
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.core.tracks.spiral import chord_of, first_guess, step

CLASSIC = Scene()
CLASSIC_TIMES = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0, 400.0, 412.473837682, 430.0, 432.9179]


def test_handle_1_at_the_start_is_where_the_recipe_says():
    assert state(CLASSIC, 0.0).p[1] == pytest.approx((8.363823851, 2.826543891), abs=1e-9)


def test_the_tail_at_300_s_is_where_the_recipe_says():
    assert state(CLASSIC, 300.0).p[223] == pytest.approx((1.785033, 9.301164), abs=1e-6)


@pytest.mark.parametrize('t_s', CLASSIC_TIMES)
def test_links_keep_their_lengths_to_1e_12_m(t_s):
    assert state(CLASSIC, t_s).worst[0] < 1e-14 * 20


def test_many_states_at_once_agree_with_single_ones():
    many = states(CLASSIC, CLASSIC_TIMES)
    for row, t_s in zip(many.p, CLASSIC_TIMES, strict=True):
        np.testing.assert_allclose(row, state(CLASSIC, t_s).p, rtol=0, atol=1e-12)


@given(st.floats(0.1, 3), st.floats(2, 40), st.floats(1, 6), st.floats(0.6, 6), st.floats(0, 1))
def test_chains_that_are_placed_at_once_are_those_placed_link_by_link(pitch, start, head, body, further):
    links = Dragon(30, head, body).link_lengths_m
    track = track_of(Spiral(pitch, start))
    leaders = track.places_at(np.array([0.0, -further]))
    leader = Place.of(*(values[0] for values in leaders))
    try:
        one_by_one = forward(track, links.tolist(), leader, BEHIND)
    except ChainLockError as error:
        with pytest.raises(ChainLockError, match=f'link {error.fields["link"]}'):
            marched_many(track, links, leaders, BEHIND)
        return
    size = float(np.max(np.abs(one_by_one.u)))
    alone, together = marched(track, links, leader, BEHIND), marched_many(track, links, leaders, BEHIND)
    np.testing.assert_allclose(alone.u, one_by_one.u, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(together.u[0], one_by_one.u, rtol=0, atol=1e-12 * size)
    assert np.all(np.diff(together.u) > 0)


@given(st.lists(st.floats(0.2, 3), min_size=12, max_size=40), st.floats(8, 750))
def test_chains_of_any_links_that_are_placed_at_once_are_those_placed_link_by_link(links, start):
    track = track_of(Spiral(0.55, start))
    leaders = track.places_at(np.array([0.0, -1.5]))
    mixed = np.array(links)
    (_, u), spent = forward_many(track, blocks_of(mixed, BEHIND), leaders, BEHIND)
    assert spent == together(track, mixed, leaders, BEHIND)[1]          # not link by link
    for n in range(2):
        leader = Place.of(*(values[n] for values in leaders))
        one_by_one = forward(track, links, leader, BEHIND)
        assert np.max(np.abs(u[:, n] - one_by_one.u)) < 1e-14 * start * 2 * np.pi


CURLY = track_of(Composite((Line(60.0), Arc(2.0, 170.0), Line(0.4), Arc(1.5, -100.0), SpiralArc(1.2, 2.0, 3.5, 'left'),
                            Line(1.0), SpiralArc(1.0, 3.0, 1.5, 'right'), Line(40.0)), start_m=60.0))
WINDING_IN = track_of(STurn())


@pytest.mark.parametrize('links', [pytest.param(np.array([2.86, *(1.65,) * 30]), marks=pytest.mark.long),
                                   np.array([1.1, *(0.05,) * 9, 2.2, *(0.5,) * 20])])
@pytest.mark.parametrize(('track', 'low_m', 'high_m', 'direction'), [
    (CURLY, 10.0, 165.0, BEHIND), (CURLY, -20.0, 95.0, AHEAD), (WINDING_IN, -30.0, 60.0, BEHIND),
    (WINDING_IN, -40.0, 10.0, AHEAD)], ids=['curly', 'curly ahead', 'turn', 'turn ahead'])
def test_handles_that_are_placed_segment_by_segment_are_those_placed_row_by_row(track, low_m, high_m, direction, links):
    metres = np.random.default_rng(7).uniform(low_m, high_m, 80)
    leaders, blocks = track.places_at(metres), blocks_of(links, direction)
    found, _ = by_segment(track, blocks, leaders, direction)
    expected, _ = row_by_row(track, blocks, leaders, direction)
    np.testing.assert_allclose(track.points(*found), track.points(*expected), rtol=0, atol=5e-13)
    # Exactly at a joint, rounding decides on which side a handle lies.
    apart = np.abs(track.distances(*found) - track.distances(*expected))
    assert np.max(apart) < 1e-12


@pytest.mark.parametrize('track', [CURLY, WINDING_IN, track_of(Spiral(0.55, 16.0))], ids=['curly', 'turn', 'spiral'])
@pytest.mark.parametrize('count', [0, 3])
def test_without_links_or_without_leaders_the_handles_are_the_leaders(track, count):
    leaders = track.places_at(np.linspace(1.0, 4.0, count))
    for found, spent in (forward_many(track, (), leaders, BEHIND), by_segment(track, (), leaders, BEHIND)):
        assert spent == 0
        for one, row in zip(leaders, found, strict=True):
            assert np.array_equal(np.asarray(row).reshape(1, count), one[None])
    none = tuple(one[:0] for one in leaders)
    found, state_, spent = next_places(track, none, 1.65, BEHIND)
    assert (state_, spent, [one.size for one in found]) == (NEW, 0, [0, 0])


def test_where_the_track_ends_handles_that_are_placed_segment_by_segment_say_so():
    leaders = CURLY.places_at(np.array([100.0, 140.0]))
    with pytest.raises(TrackEndError, match='1.65 m does not fit'):
        by_segment(CURLY, blocks_of(np.full(90, 1.65), AHEAD), leaders, AHEAD)


def test_only_where_handles_almost_turn_back_are_they_placed_link_by_link():
    model = compile_scene(CLASSIC).model
    links = model.links_m

    def served(t_s):
        return together(model.track, links, model.leader.places(np.array([t_s])), BEHIND) is not None
    assert [served(t_s) for t_s in (*CLASSIC_TIMES[:-2], 425.0)] == [True] * 9
    assert not served(CLASSIC_TIMES[-1])


@pytest.mark.parametrize('head', thinned([20.0, 26.0, 32.7], lambda head: head == 26))
def test_handles_are_placed_at_once_unless_the_second_moves_on_by_less_than_a_twentieth_of_the_first(head):
    track, links = track_of(Spiral(2 * np.pi)), np.array([head] + 20 * [18.85])
    turn, step = turning_places(links[:2].tolist(), lock_angle(head), head + 5)[-1], 1e-4
    for theta in turn + np.linspace(0, 2, 200):
        leader = np.zeros(1, dtype=np.int64), np.array([theta])
        pace = (follower(theta + step, head) - follower(theta - step, head)) / (2 * step)
        if abs(pace - 0.05) > 1e-3:
            assert (together(track, links, leader, BEHIND) is None) == (pace < 0.05)


@pytest.mark.parametrize(('scene', 'most'), [
    (Scene(), 1.05), (Scene(track=STurn(before_m=100.0)), 1.25),
    (Scene(head=Head(1.0, 'tail'), track=Spiral(0.55, 5.0)), 1.5)],
    ids=['spiral', 'turn', 'tail'])
def test_a_link_takes_hardly_more_than_one_evaluation_from_where_it_is_expected(scene, most):
    chain = state(replace(scene, solver='march'), 20.0)
    assert 1.0 <= chain.evaluations / chain.links_m.size <= most


@pytest.mark.parametrize(('place', 'track', 'direction', 'first_m', 'most'), [
    (row_by_row, track_of(Spiral(0.55)), BEHIND, 0.0, 1.2), (forward_many, track_of(Spiral(0.55)), BEHIND, 0.0, 3.0),
    (row_by_row, track_of(STurn(before_m=100.0)), BEHIND, -50.0, 1.6),
    (by_segment, track_of(STurn(before_m=100.0)), BEHIND, -50.0, 1.35),
    (row_by_row, track_of(STurn(before_m=100.0), AHEAD), AHEAD, -500.0, 1.2)],
    ids=['spiral', 'together', 'turn', 'by segment', 'tail'])
def test_many_chains_take_few_evaluations_per_handle(place, track, direction, first_m, most):
    leaders = track.places_at(np.linspace(first_m, first_m + 60.0, 5))
    places, evaluations = place(track, blocks_of(np.array([2.86] + 222 * [1.65]), direction), leaders, direction)
    assert 1.0 <= evaluations / places[0].size <= most


@pytest.mark.parametrize('place', [row_by_row, by_segment, forward_many])
def test_on_a_circle_no_link_takes_an_evaluation(place):
    track = track_of(Composite((Arc(5.0, 300.0), Line(1.0))))
    leaders = track.places_at(np.linspace(1.0, 20.0, 5))
    assert place(track, blocks_of(np.full(30, 1.65), BEHIND), leaders, BEHIND)[1] == 0


@pytest.mark.parametrize('chord', [5.0, 7.0, 40.0])
def test_a_step_beyond_half_a_turn_counts_all_its_evaluations(chord):
    theta = lock_angle(chord) + 0.02
    delta, evaluations = step(theta, chord, first_guess(theta, chord))
    assert delta > np.pi
    assert chord_of(theta, delta) == pytest.approx(chord, rel=1e-12)
    assert evaluations >= 5
