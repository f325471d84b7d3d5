"""On composite tracks, links cross joints and end at the first position at their length; invalid input is rejected."""
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.chain.chain import conditioning
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.forward import next_place
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import Place, _guessed, track_of
from dragon_ros.core.tracks.segments import AHEAD, BEHIND
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn
from hard_cases import hard_cases

CASES = {problem.name: problem for problem in hard_cases()}
TURNING = CASES['turning'].scene


@pytest.mark.parametrize('name', thinned(
    CASES, lambda name: [*CASES].index(name) % 4 == 0 and name not in ('turning', 'law')))
def test_every_link_of_a_dance_has_its_length_and_the_next_handle_is_the_first_so_far_behind(name):
    scene = CASES[name].scene
    for t_s in CASES[name].times_s:
        chain, marched = state(scene, t_s), state(replace(scene, solver='march'), t_s)
        promise_m = compile_scene(scene).promise_m * conditioning(chain)
        np.testing.assert_allclose(chain.p, marched.p, rtol=0, atol=promise_m)
        assert max(chain.worst[0], marched.worst[0]) < promise_m
        for link in (0, 5):
            if scene.dragon.link_lengths_m[link]:
                _no_nearer_root(marched, link, scene.dragon.link_lengths_m[link])


def _no_nearer_root(chain, front, link_m):
    """Check that 500 positions between two handles are all closer than the link."""
    track = chain.track
    far = [track.distance_of(_place(chain, n)) for n in (front, front + 1)]
    for metres in np.linspace(far[1], far[0], 502)[1:-1]:
        place = track.place_at(metres)
        x, y = chain.p[front]
        assert abs(complex(track.segments[place.segment].at(place.u)) - complex(x, y)) < link_m


def _place(chain, n):
    return Place(int(chain.segment[n]), float(chain.u[n]))


@pytest.mark.parametrize('name', ['turning', 'wiggle', 'loop', 'law', 'unwinding', 'turn-by-the-tail'])
def test_velocities_of_a_dance_are_the_rate_of_its_positions(name):
    scene, h = CASES[name].scene, 1e-5
    for t_s in (5.123, 7.7, 9.876):
        rate = (state(scene, t_s + h).p - state(scene, t_s - h).p) / (2 * h)
        np.testing.assert_allclose(velocity_of(scene, state(scene, t_s), t_s), rate, atol=2e-6)


def test_many_states_of_a_dance_are_its_single_ones():
    times = (99.0, 103.0, 110.0)
    many = states(TURNING, times)
    assert velocity_of(TURNING, many, times).shape == (3, 224, 2)
    for row, t_s in zip(many.p, times, strict=True):
        np.testing.assert_allclose(row, state(TURNING, t_s).p, rtol=0, atol=1e-13)


def test_a_joint_that_does_not_meet_names_itself_and_the_mismatch():
    with pytest.raises(FieldError, match=r'track.pieces.2.at_m.*joint 1: piece 1 ends 0.001 m from there'):
        track_of(Composite((Line(10.0), Arc(3.0, 90.0, at_m=(10.0, 0.001)))))
    with pytest.raises(FieldError, match=r'track.pieces.3.heading_deg.*joint 2: piece 2 ends 1 degrees'):
        track_of(Composite((Line(10.0), Arc(3.0, 90.0), Line(1.0, heading_deg=89.0))))
    track_of(Composite((Line(10.0, at_m=(3.0, 4.0), heading_deg=180.0),
                        Line(1.0, at_m=(-7.0, 4.0), heading_deg=-180.0))))


def test_a_scene_whose_pieces_do_not_meet_is_refused_when_it_is_compiled():
    scene = Scene(track=Composite((Line(10.0), Arc(3.0, 90.0, at_m=(10.0, 0.001)))))
    with pytest.raises(FieldError, match='track.pieces.2.at_m'):
        compile_scene(scene)


@pytest.mark.parametrize('track', [STurn(ratio=2.3), Composite((Line(9.0), Arc(1.44, 90.0)))])
def test_a_bend_in_which_a_link_could_lock_is_refused(track):
    with pytest.raises(FieldError, match='bends tighter than 1.44444 m, 1.01 times half the longest link'):
        compile_scene(Scene(track=track))


@pytest.mark.parametrize('radius_m', [1.4445, 2.0])
def test_a_bend_that_is_wide_enough_never_locks(radius_m):
    scene = Scene(dragon=Dragon(20), track=Composite((Line(5.0), Arc(radius_m, 400.0), Line(3.0), Arc(radius_m, -400.0),
                                                   Line(50.0))))
    for t_s in np.linspace(0.0, compile_scene(scene).end.t_s, 300):
        assert state(scene, float(t_s)).worst[0] < 1e-12


@pytest.mark.parametrize('past_m', [0.0, 1e-9, 1e-6, 1e-4, 3e-4, 1e-3, 1e-2])
def test_just_past_an_arc_the_next_handle_is_at_the_very_end_of_its_reach_and_as_exact(past_m):
    track = Composite((Line(10.0), Arc(2.0, 180.0), Line(10.0)))
    scene = Scene(dragon=Dragon(12), track=track, run=Run(0, 20), solver='march')
    assert state(scene, 10 + 2 * pi + past_m).worst[0] < 0.1 * compile_scene(scene).promise_m


def test_a_link_across_a_joint_just_passed_keeps_its_length():
    """Newton's steps leave the bracket, which has one end next to the root, and bisection alone is not exact."""
    turn = STurn(1.3739674042962116, 8.25888768959588, 1.5403046253142452)
    dragon = Dragon(7, 2.2060197130833377, 1.0938917775107062, hole_inset_m=0.2)
    scene = Scene(dragon=dragon, track=turn, run=Run(0, 25))
    for past_m in (0.0, *np.geomspace(1e-12, 0.1, 300).tolist()):
        assert state(scene, turn.length_m + past_m).worst[0] < 2e-14


@pytest.mark.parametrize('radius_m', [2.29, 2.92, 3.9, 3.91, 4.99])
@pytest.mark.parametrize('solver', ['table', 'march'])
def test_where_one_link_spans_an_arc_exactly_the_follower_is_on_the_joint(radius_m, solver):
    """A link as long as the radius spans an arc of 60 degrees; rounding could place the follower beyond the joint."""
    dragon = Dragon(8, radius_m + 0.4, radius_m + 0.4, 0.3, 0.2)
    scene = Scene(dragon=dragon, track=Composite((Line(10.0), Arc(radius_m, 60.0))), solver=solver)
    last = state(scene, compile_scene(scene).end.t_s)
    assert last.p[1] == pytest.approx((10.0, 0.0), abs=1e-12)
    assert last.worst[0] < 1e-12


@pytest.mark.parametrize('angle_deg', [0.3, -0.3, 0.9, -1.0, 30.0, -170.0])
def test_an_arc_bends_to_the_left_by_a_positive_angle_and_to_the_right_by_a_negative_one(angle_deg):
    track = track_of(Composite((Line(5.0), Arc(9.0, angle_deg), Line(5.0))))
    at = np.array([0, 2]), np.array([0.0, 0.0])
    before, after = track.headings(*at) @ [1, 1j]
    assert np.angle(after / before, deg=True) == pytest.approx(angle_deg)


@pytest.mark.parametrize('angle_deg', [1e6, -1e6])
def test_an_arc_goes_round_up_to_a_million_degrees_either_way(angle_deg):
    assert Composite((Arc(3.0, angle_deg),)).pieces[0].angle_deg == angle_deg
    with pytest.raises(FieldError, match='angle_deg'):
        Composite((Arc(3.0, 1.001 * angle_deg),))


@pytest.mark.parametrize('turn_deg', [300.0, -300.0])
@pytest.mark.parametrize('direction', [AHEAD, BEHIND])
@pytest.mark.parametrize('chord_m', [0.8, 2.0, 3.0, 3.6])
def test_the_first_guess_of_a_link_from_a_line_onto_an_arc_has_its_length_however_far_round_it_is(turn_deg, direction,
                                                                                                  chord_m):
    arc = track_of(Composite((Line(10.0), Arc(2.0, turn_deg), Line(5.0)))).segments[1]
    near = arc.first if direction == AHEAD else arc.last
    here = complex(arc.at(near)) - direction * complex(arc.heading(near)) * np.array([0.05, 0.5])
    ahead_m = _guessed(arc, near, here, chord_m, direction)
    assert np.abs(arc.at(near + direction * ahead_m / abs(arc.rate(near))) - here) == pytest.approx(chord_m, rel=1e-12)


def test_a_link_that_would_reach_a_tenth_of_its_length_beyond_the_end_of_a_track_does_not_fit():
    track = track_of(Composite((Line(10.0), Arc(5.0, 60.0))))
    for beyond_m in (0.1, 0.5):
        with pytest.raises(TrackEndError, match='too short'):
            next_place(track, track.place_at(track.end_m - 1 + beyond_m), 1.0, AHEAD)
    reached, _ = next_place(track, track.place_at(track.end_m - 1.01), 1.0, AHEAD)
    assert track.distance_of(reached) < track.end_m


@pytest.mark.parametrize('direction', [BEHIND, AHEAD])
@pytest.mark.parametrize('chord_m', [0.5, 1.65, 2.86])
def test_across_a_joint_a_link_takes_one_evaluation_on_an_arc_and_at_most_four_on_a_spiral(direction, chord_m):
    track = track_of(STurn(before_m=100.0))
    for k, segment in enumerate(track.segments):
        if 0 <= k + direction < len(track.segments):
            end, most = (segment.first if direction == BEHIND else segment.last), 4 if k + direction in (0, 3) else 1
            for share in (1e-6, 0.5, 0.95):
                u = np.array([end - direction * share * chord_m / segment.rate(end)])
                places, evaluations = track.across_many(k, u, chord_m, direction)
                assert places[0] == k + direction
                assert evaluations <= most
                if share > 0.1:
                    assert track.across(Place.of(k, u[0]), chord_m, direction)[1] <= 5


@pytest.mark.parametrize(('spec', 'low_m', 'high_m', 'loose'), [
    (STurn(before_m=100.0), -90.0, -10.0, 1e-12), (STurn(before_m=100.0), 30.0, 90.0, 1e-12),
    (Spiral(0.55, 16.0), 10.0, 200.0, 1e-12), (Composite((Line(60.0), Arc(2.0, 170.0))), -50.0, 40.0, 1e-12),
    (Composite((Line(60.0), Arc(2.0, 170.0))), 55.0, 64.0, 0.1)], ids=['in', 'out', 'spiral', 'line', 'arc'])
def test_no_point_of_a_stretch_is_further_from_the_origin_than_its_bound(spec, low_m, high_m, loose):
    track = track_of(spec)
    furthest_m = np.max(np.hypot(*track.points(*track.places_at(np.linspace(low_m, high_m, 500))).T))
    assert furthest_m * (1 - 1e-15) <= track.far_m(low_m, high_m) <= furthest_m * (1 + loose)
