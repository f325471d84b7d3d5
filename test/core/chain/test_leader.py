"""The initial position of a dragon and the end of its track, with the head or the tail leading."""
from dataclasses import replace
from math import pi

import numpy as np
import pytest

from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.chain.chain import marched_many
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn


@pytest.mark.parametrize('length_m', np.arange(0.1, 3.0, 0.1).tolist())
def test_led_by_the_tail_the_head_begins_at_the_very_end_of_its_track(length_m):
    track = Composite((Line(1.0), Line(length_m), Line(1.0)), start_m=2.0 + length_m)
    scene = Scene(dragon=Dragon(12, 2.2, 1.6), track=track, head=Head(1.0, 'tail'), run=Run(0, 9), solver='march')
    assert state(scene, 0.0).p[0] == pytest.approx((2.0 + length_m, 0.0), abs=1e-12)


@pytest.mark.parametrize(('benches', 'turns'), [(223, 16.0), (40, 4.0), (3, 4.0), (600, 5.0)])
def test_on_a_spiral_no_handle_is_further_out_than_the_bound_which_is_within_a_radian(benches, turns):
    simulation = compile_scene(Scene(Dragon(benches), Spiral(0.55, turns), run=Run(0, 1)))
    leader = simulation.model.leader
    for travel_m in (0.0, 5.0):
        far_m = np.max(np.hypot(*simulation.model.march(travel_m).p.T))
        assert far_m <= leader.size_m((travel_m, 5.0)) <= far_m + 0.55 / (2 * pi)
    assert leader.size_m((0.0, 5.0)) == leader.size_m((0.0, 0.0))       # the tail is furthest out at the start
    back_m = np.max(np.hypot(*simulation.model.march(-20.0).p.T))
    assert back_m <= leader.size_m((-20.0, 5.0)) <= back_m + 0.55 / (2 * pi)


@pytest.mark.parametrize('lead', ['head', 'tail'])
@pytest.mark.parametrize('track', [STurn(before_m=10.0),
                                   Composite((Line(60.0), Arc(3.0, 170.0), Line(60.0)), start_m=45.0)])
def test_the_stretch_of_a_way_holds_every_handle_and_ends_at_some(track, lead):
    leader = compile_scene(Scene(Dragon(12), track, Head(1.0, lead), Run(0, 9))).model.leader
    gone = np.linspace(0.0, 9.0, 19)
    chains = marched_many(leader.track, leader.links_m, leader.places(gone), leader.direction)
    along_m = leader.track.distances(chains.segment, chains.u)
    low_m, high_m = leader.span_m((0.0, 9.0))
    assert low_m <= np.min(along_m) + 1e-9
    assert high_m >= np.max(along_m) - 1e-9
    assert high_m == pytest.approx(np.max(along_m), abs=1e-9)
    assert lead == 'tail' or low_m == pytest.approx(np.min(along_m), abs=1e-9)


def test_a_dance_ends_with_its_track_and_says_so():
    scene = Scene(dragon=Dragon(10), track=Composite((Line(10.0), Arc(3.0, 90.0)), start_m=4.0), head=Head(2.0))
    end = compile_scene(scene).end
    assert (end.reason, end.t_s) == ('track', pytest.approx((6 + 1.5 * pi) / 2, rel=1e-15))
    assert tick(scene, compile_scene(scene).last_tick).chain.worst[0] < 1e-12
    np.testing.assert_allclose(state(scene, compile_scene(scene).end.t_s).p[0], (13.0, 3.0), atol=1e-14)
    with pytest.raises(TrackEndError, match='the track ends for a handle'):
        state(scene, compile_scene(scene).end.t_s + 1e-9)


def test_a_dance_that_begins_on_a_spiral_out_ends_where_its_tail_has_no_track():
    track = Composite((SpiralArc(1.0, 2.0, 8.0), Line(5.0)), start_m=40.0)
    scene = Scene(dragon=Dragon(10), track=track, head=Head(-1.0))
    assert compile_scene(scene).end.reason == 'track'
    last = state(scene, compile_scene(scene).end.t_s)
    assert last.p[-1] == pytest.approx((0.0, 0.0), abs=1e-12)       # the first piece begins at the origin
    with pytest.raises(FieldError, match='too short for the dragon, which fits from'):
        compile_scene(replace(scene, track=replace(track, start_m=3.0)))


def test_led_by_the_tail_the_dragon_starts_as_it_lay_and_the_links_keep_their_order():
    lying = Scene(track=Spiral(0.55, 6.0))
    led = replace(lying, head=Head(1.0, 'tail'), run=Run(0, 60))
    np.testing.assert_allclose(state(led, 0.0).p, state(lying, 0.0).p, rtol=0, atol=1e-12)
    later = state(led, 60.0)
    assert np.hypot(*(later.p[0] - later.p[1])) == pytest.approx(2.86, abs=1e-13)
    v = velocity_of(led, later, 60.0)
    assert np.hypot(*v[-1]) == pytest.approx(1.0, abs=1e-14)
    assert np.sum(v[-1] * later.p[-1]) > 0          # outwards


def test_led_by_the_tail_out_and_back_the_dragon_lies_as_before_and_goes_no_further():
    law = Profile(((0.0, 0.0), (10.0, 1.0), (20.0, -1.0), (40.0, -1.0)), lead='tail')
    scene = Scene(track=Spiral(0.55, 6.0), head=law)
    assert compile_scene(scene).end.reason == 'track'
    assert compile_scene(scene).end.t_s == pytest.approx(25.0, abs=1e-12)
    np.testing.assert_allclose(state(scene, compile_scene(scene).end.t_s).p, state(scene, 0.0).p, rtol=0, atol=1e-12)


@pytest.mark.parametrize('turns', [500.0, 870.0])
@pytest.mark.parametrize('start', [0.91, 0.957, 0.99])
def test_led_by_the_tail_from_far_off_there_is_a_state_at_the_very_end(turns, start):
    """The way back is 300 to 1,000 km long, and rounding may move its end beyond the track's start at 0 m."""
    track = Composite((SpiralArc(0.41, 4.07, turns), Line(5.3)))
    led = [Scene(dragon=Dragon(5), track=replace(track, start_m=start * track_of(track).end_m),
                 head=Head(speed, 'tail')) for speed in (1.4, 2.0, 2.4815)]
    for scene in led:
        last = state(scene, compile_scene(scene).end.t_s)
        assert last.p[-1] == pytest.approx((0.0, 0.0), abs=2 * np.spacing(track_of(track).end_m))


def test_a_run_that_ends_at_the_centre_after_a_long_way_back_has_a_state_there():
    """The leader has been hundreds of metres outwards, so rounding may put it a little beyond the centre."""
    law = Profile(((0.0, 60.866187230559206), (0.46675534418525183, -25.04047863223453),
                   (40.81516372931116, 50.42904826676646), (41.295818934210615, 19.747686468304174)))
    scene = Scene(Dragon(20, 0.12404412252022931, 0.11131352915802221, 0.01, 0.0),
                  Spiral(0.9851373367647517, 3.0408447165076287), law, Run(0, 1e3))
    end = compile_scene(scene).end
    assert end.reason == 'track'
    assert np.hypot(*state(scene, end.t_s).p[0]) < 1e-9
    assert np.hypot(*states(scene, [0.0, end.t_s]).p[1, 0]) < 1e-9
