"""Tracks of pieces: promises against the 50-digit reference, joints, ends, and what is refused."""
from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString

from dragon_ros.core.angle import Angle
from dragon_ros.core.benches import axes_of, benches_of
from dragon_ros.core.contact.broad_phase import box_pairs, candidates, default_reach_m
from dragon_ros.core.contact.certificate import Contact, NoContact
from dragon_ros.core.contact.first_contact import first_contact
from dragon_ros.core.contact.signed_distance import gaps
from dragon_ros.core.dragon import Dragon
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.head import Head, Profile
from dragon_ros.core.joined import Arc, Joined, Line, Wind
from dragon_ros.core.outline import outline
from dragon_ros.core.path import Spiral
from dragon_ros.core.rates import conditioning
from dragon_ros.core.scene import SOLVERS, Run, Scene
from dragon_ros.core.step import state, states, tick, velocity_of
from dragon_ros.core.tiers import position_promise_m, speed_promise_m_s
from dragon_ros.core.turn import Turn
from dragon_ros.core.walk import Place
from dragon_ros.cost.dances import dances
from dragon_ros.cost.reference import truth

CASES = {problem.name: problem for problem in dances()}
TURNING = CASES['turning'].scene


@pytest.mark.parametrize('solver', SOLVERS)
@pytest.mark.parametrize('tier', ['preview', 'standard', 'fine', 'exact'])
@pytest.mark.parametrize('name', CASES)
def test_every_tier_keeps_its_promise_on_every_dance(name, tier, solver):
    problem, known = CASES[name], truth(CASES[name])
    scene, handles = replace(problem.scene, accuracy=tier, solver=solver), list(problem.handles)
    for number, t_s in enumerate(problem.times_s):
        chain = state(scene, t_s)
        condition = conditioning(chain)
        assert np.max(known.distance(number, chain.p[handles])) <= position_promise_m(
            scene.tier, scene.size_m, condition)
        allowed = speed_promise_m_s(scene.tier, scene.size_m, scene.length_m / scene.dragon.benches, condition,
                                    scene.head.speed_at_m_s(t_s))
        off_m_s = velocity_of(scene, chain, t_s)[handles] - known.high[number, :, 2:] - known.low[number, :, 2:]
        assert np.max(np.hypot(*off_m_s.T)) <= allowed


@pytest.mark.parametrize('name', CASES)
def test_every_link_of_a_dance_has_its_length_and_the_next_handle_is_the_first_so_far_behind(name):
    scene = CASES[name].scene
    for t_s in CASES[name].times_s:
        chain, marched = state(scene, t_s), state(replace(scene, solver='march'), t_s)
        np.testing.assert_allclose(chain.p, marched.p, rtol=0, atol=1e-13 * max(1, scene.size_m))
        assert max(chain.worst[0], marched.worst[0]) < 1e-13 * max(1, scene.size_m)
        for link in (0, 5):
            if scene.dragon.link_lengths_m[link]:
                _no_nearer_root(scene.led.walk, marched, link, scene.dragon.link_lengths_m[link])


def _no_nearer_root(walk, chain, front, link_m):
    """Look at 500 places between two handles: all nearer than the link."""
    far = [walk.distance_of(_place(chain, n))[0] for n in (front, front + 1)]
    for metres in np.linspace(far[1], far[0], 502)[1:-1]:
        place = walk.place_at(metres)
        x, y = chain.p[front]
        assert abs(complex(walk.pieces[place.piece].at(*place.u)) - complex(x, y)) < link_m


def _place(chain, n):
    return Place(int(chain.piece[n]), Angle(float(chain.u[n]), float(chain.u_lo[n])))


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


def test_the_turn_is_centrally_symmetric_and_joins_without_a_kink():
    walk = Turn().walk
    for k, (one, two) in enumerate(pairwise(walk.pieces)):
        assert abs(one.at(one.last) - two.at(two.first)) < 1e-14, k
        assert abs(one.heading(one.last) - two.heading(two.first)) < 1e-14, k
    for metres in (0.0, 1.0, 50.0):
        (k, u), (n, v) = walk.place_at(-metres), walk.place_at(Turn().length_m + metres)
        assert complex(walk.pieces[k].at(*u)) == pytest.approx(-complex(walk.pieces[n].at(*v)), abs=1e-13)


@given(st.floats(0.3, 2.1))
def test_the_turn_stays_within_its_circle(ratio):
    walk = Turn(ratio=ratio).walk
    for metres in np.linspace(0.0, Turn().length_m, 200):
        k, u = walk.place_at(float(metres))
        assert abs(complex(walk.pieces[k].at(*u))) <= 4.5 * (1 + 1e-15)


def test_the_contests_turn_has_the_contests_places():
    chain = state(TURNING, 0.0)
    np.testing.assert_allclose(chain.p[0], (7.778034, 3.717164), atol=5e-7)
    np.testing.assert_allclose(state(TURNING, 100.0).p[0], (-2.711856, -3.591078), atol=5e-7)


def test_a_joint_that_does_not_meet_names_itself_and_the_mismatch():
    with pytest.raises(FieldError, match=r'track.pieces.2.at_m.*joint 1: piece 1 ends 0.001 m from there'):
        Joined((Line(10.0), Arc(3.0, 90.0, at_m=(10.0, 0.001))))
    with pytest.raises(FieldError, match=r'track.pieces.3.heading_deg.*joint 2: piece 2 ends 1 degrees'):
        Joined((Line(10.0), Arc(3.0, 90.0), Line(1.0, heading_deg=89.0)))
    Joined((Line(10.0, at_m=(3.0, 4.0), heading_deg=180.0), Line(1.0, at_m=(-7.0, 4.0), heading_deg=-180.0)))


@pytest.mark.parametrize('track', [Turn(ratio=2.3), Joined((Line(9.0), Arc(1.44, 90.0)))])
def test_a_bend_in_which_a_link_could_lock_is_refused(track):
    with pytest.raises(FieldError, match='bends tighter than 1.44444 m, a hair over half the longest link'):
        Scene(track=track)


@pytest.mark.parametrize('radius_m', [1.4445, 2.0])
def test_a_bend_that_is_wide_enough_never_locks(radius_m):
    scene = Scene(dragon=Dragon(20), track=Joined((Line(5.0), Arc(radius_m, 400.0), Line(3.0), Arc(radius_m, -400.0),
                                                   Line(50.0))))
    for t_s in np.linspace(0.0, scene.end.t_s, 300):
        assert state(scene, float(t_s)).worst[0] < 1e-12


@pytest.mark.parametrize('past_m', [0.0, 1e-9, 1e-6, 1e-4, 3e-4, 1e-3, 1e-2])
@pytest.mark.parametrize('tier', ['fine', 'exact'])
def test_just_past_an_arc_the_next_handle_is_at_the_very_end_of_its_reach_and_as_exact(tier, past_m):
    track = Joined((Line(10.0), Arc(2.0, 180.0), Line(10.0)))
    scene = Scene(dragon=Dragon(12), track=track, run=Run(0, 20), solver='march', accuracy=tier)
    assert state(scene, 10 + 2 * pi + past_m).worst[0] < 0.1 * scene.promise_m


@pytest.mark.parametrize('length_m', np.arange(0.1, 3.0, 0.1).tolist())
def test_led_by_the_tail_the_head_begins_at_the_very_end_of_its_track(length_m):
    track = Joined((Line(1.0), Line(length_m), Line(1.0)), start_m=2.0 + length_m)
    scene = Scene(dragon=Dragon(12, 2.2, 1.6), track=track, head=Head(1.0, 'tail'), run=Run(0, 9), solver='march')
    assert state(scene, 0.0).p[0] == pytest.approx((2.0 + length_m, 0.0), abs=1e-12)


def test_a_dance_ends_with_its_track_and_says_so():
    scene = Scene(dragon=Dragon(10), track=Joined((Line(10.0), Arc(3.0, 90.0)), start_m=4.0), head=Head(2.0))
    assert (scene.end.reason, scene.end.t_s) == ('track', pytest.approx((6 + 1.5 * pi) / 2, rel=1e-15))
    assert tick(scene, scene.last_tick).chain.worst[0] < 1e-12
    np.testing.assert_allclose(state(scene, scene.end.t_s).p[0], (13.0, 3.0), atol=1e-14)
    with pytest.raises(TrackEndError, match='the track ends for a handle'):
        state(scene, scene.end.t_s + 1e-9)


def test_a_dance_that_begins_on_a_spiral_out_ends_where_its_tail_has_no_track():
    track = Joined((Wind(1.0, 2.0, 8.0), Line(5.0)), start_m=40.0)
    scene = Scene(dragon=Dragon(10), track=track, head=Head(-1.0))
    assert scene.end.reason == 'track'
    last = state(scene, scene.end.t_s)
    assert last.p[-1] == pytest.approx((0.0, 0.0), abs=1e-12)       # the first piece begins at the origin
    with pytest.raises(FieldError, match='too short for the dragon, which fits from'):
        replace(scene, track=replace(track, start_m=3.0))


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
    assert scene.end.reason == 'track'
    assert scene.end.t_s == pytest.approx(25.0, abs=1e-12)
    np.testing.assert_allclose(state(scene, scene.end.t_s).p, state(scene, 0.0).p, rtol=0, atol=1e-12)


@pytest.mark.parametrize('t_s', [0.0, 95.0, 101.0, 107.0, 113.0, 116.0, 130.0, 200.0])
def test_the_candidates_on_a_turn_have_every_pair_within_reach(t_s):
    chain = state(TURNING, t_s)
    benches = benches_of(chain, TURNING.dragon, axes_of(chain))
    i, j = box_pairs(benches, default_reach_m(benches))
    near = gaps(benches, i, j) <= default_reach_m(benches)
    found = set(zip(*(pairs.tolist() for pairs in candidates(chain.p, benches)), strict=True))
    assert set(zip(i[near].tolist(), j[near].tolist(), strict=True)) <= found


@pytest.mark.parametrize('name', ['turning', 'wiggle', 'law', 'unwinding', 'spirals'])
def test_the_line_that_is_drawn_passes_under_every_handle(name):
    scene = CASES[name].scene
    line = LineString(outline(scene, sag_m=0.002))
    for t_s in CASES[name].times_s:
        assert shapely.distance(line, shapely.points(state(scene, t_s).p)).max() < 0.00201


def test_followed_in_time_the_classic_contact_is_the_one_that_is_proved():
    proved = first_contact(Scene(run=Run(405, 413)))
    followed = first_contact(Scene(run=Run(405, 413), head=Profile(((0.0, 1.0),))))
    assert isinstance(followed, Contact)
    assert followed.t_s == pytest.approx(proved.t_s, abs=1e-10)
    assert (followed.benches, followed.witness.corner) == (proved.benches, proved.witness.corner)
    assert followed.certificate.complete
    slower = first_contact(Scene(run=Run(810, 826), head=Profile(((0.0, 0.5),))))
    assert slower.t_s == pytest.approx(2 * proved.t_s, abs=1e-9)


def test_a_turn_has_no_contact_and_a_loop_in_its_own_body_has():
    assert isinstance(first_contact(replace(TURNING, run=Run(112, 118))), NoContact)
    loop = Scene(dragon=Dragon(20), track=Joined((Line(5.0), Arc(3.0, 720.0))), run=Run(0, 30))
    hit = first_contact(loop)
    assert isinstance(hit, Contact)
    chain = state(loop, hit.t_s)
    gap = gaps(benches_of(chain, loop.dragon, axes_of(chain)), *(np.array([n]) for n in hit.benches))
    assert abs(gap[0]) < 1e-9


def test_a_link_across_a_joint_just_passed_keeps_its_length():
    """Newton's steps leave the bracket there, whose end is next to the root, and bisection alone is not exact."""
    turn = Turn(1.3739674042962116, 8.25888768959588, 1.5403046253142452)
    dragon = Dragon(7, 2.2060197130833377, 1.0938917775107062, hole_inset_m=0.2)
    scene = Scene(dragon=dragon, track=turn, run=Run(0, 25))
    for past_m in (0.0, *np.geomspace(1e-12, 0.1, 300).tolist()):
        assert state(scene, turn.length_m + past_m).worst[0] < 2e-14
