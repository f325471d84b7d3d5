"""Bounds derived from two states of a chain hold in every state in between."""
from itertools import pairwise

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.chain.chain import marched, marched_many
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Profile
from dragon_ros.core.chain.leader import Leader
from dragon_ros.core.chain.lock import head_lock_angle
from dragon_ros.core.enclosures.ball_arithmetic import Ball
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.max_speed import LawBetween, _law_of, bounds, states_of
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.segments import AHEAD, BEHIND
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn
from dragon_ros.core.tracks.spiral import SpiralCurve

LINKS = np.array([2.86, *(1.65,) * 12, 0.05, *(1.65,) * 8])
BENDY = track_of(Composite((Line(50.0), Arc(2.0, 170.0), Line(1.0), Arc(1.5, -100.0), Line(60.0)), start_m=50.0))
TRACKS = [(track_of(STurn()), -3.0, BEHIND), (track_of(STurn(ratio=0.6)), 0.0, BEHIND), (BENDY, 50.0, BEHIND),
          (track_of(STurn()), 40.0, AHEAD), (BENDY, 100.0, AHEAD)]


def states(leader, travel_m):
    places = leader.places(travel_m)
    return states_of(marched_many(leader.track, leader.links_m, places, leader.direction), travel_m, leader.direction)


def chain_at(leader, travel_m):
    return marched(leader.track, leader.links_m, leader.place(travel_m), leader.direction)


def tops(leader, low_m, high_m):
    """Return bounds on the logarithms of all handles' speeds between the two positions of each of N pairs."""
    count, none = low_m.size, np.zeros(low_m.size)
    seen, row = states(leader, np.concatenate((low_m, high_m))), np.arange(low_m.size)
    return bounds(seen.rows(row), seen.rows(count + row), LawBetween(none, none, Ball(none, none)))


def logs_between(leader, low_m, high_m):
    """Return the logarithms of the speeds at 15 positions from the first to the last of each of N pairs."""
    places = np.linspace(low_m, high_m, 15)
    return states(leader, places.ravel()).log.reshape(*places.shape, -1)


@pytest.mark.parametrize(('track', 'start_m', 'direction'), TRACKS)
@pytest.mark.parametrize('apart_m', thinned([0.3, 0.01], lambda apart_m: apart_m == 0.3))
def test_no_handle_is_faster_between_two_states_than_its_bound(track, start_m, direction, apart_m):
    leader = Leader(track, LINKS, start_m, direction)
    low = np.random.default_rng(3).uniform(0, 45, 25)
    assert np.all(logs_between(leader, low, low + apart_m) <= tops(leader, low, low + apart_m) + 1e-14)


NEAR_A_LOCK = [np.array([2.86, *(1.65,) * 8]), np.array([1.2, *(3.4,) * 5]), np.array([0.55, 0.55, 3.35, *(1.05,) * 6]),
               np.array([0.6, 0.05, 3.0, 0.2, 4.2, 1.0])]


@pytest.mark.parametrize('links', NEAR_A_LOCK, ids=range(len(NEAR_A_LOCK)))
@pytest.mark.parametrize('pitch_m', thinned([0.55, 1.2, 2.0], lambda pitch_m: pitch_m == 0.55))
@pytest.mark.parametrize('apart_m', thinned([0.1, 0.01], lambda apart_m: apart_m == 0.1))
def test_near_the_centre_no_handle_is_faster_than_its_bound_where_none_turns_back_in_between(links, pitch_m, apart_m):
    spiral = Spiral(pitch_m, 4.0)
    leader = Leader(track_of(spiral), links, 0.0, BEHIND)
    lock_m = SpiralCurve.of(spiral).distance_to(head_lock_angle((links / spiral.b_m).tolist())[0])
    turning = leader.turning_m(0.0, lock_m)
    low = lock_m - apart_m - np.geomspace(1e-6, 6, 60)
    low = np.array([one for one in low.tolist() if not any(one < turn < one + apart_m for turn in turning)])
    above, seen = tops(leader, low, low + apart_m), logs_between(leader, low, low + apart_m)
    # Near the lock, if speeds reach C, the relative rounding error of the head's position grows by a factor of C in a
    # link and of C^2 in a speed.
    off = 1e-14 * np.exp(2 * np.max(seen, axis=(0, 2)))
    assert np.all(seen <= above + off[:, None])
    assert np.count_nonzero(np.all(np.isfinite(above), axis=1)) > 10


@pytest.mark.parametrize('links', NEAR_A_LOCK, ids=range(len(NEAR_A_LOCK)))
@pytest.mark.parametrize('pitch_m', thinned([0.3, 0.55, 1.2, 2.0], (0.3, 2.0).__contains__))
def test_between_the_places_where_a_handle_turns_back_every_handle_goes_one_way(links, pitch_m):
    spiral = Spiral(pitch_m, 16.0)
    leader = Leader(track_of(spiral), links, 0.0, BEHIND)
    lock_m = SpiralCurve.of(spiral).distance_to(head_lock_angle((links / spiral.b_m).tolist())[0])
    turning = leader.turning_m(0.0, lock_m)
    assert turning == sorted(turning)
    ends = [0.0, *turning, lock_m - 1e-9]
    for low, high in pairwise(ends):
        along = np.diff(states(leader, np.linspace(low, high, 400)).links.along_m, axis=0)
        assert np.all((np.min(along, axis=0) >= -1e-12) | (np.max(along, axis=0) <= 1e-12))
    for turn in turning:    # a handle turns back at each of these positions
        before, here, after = states(leader, turn + np.array([-1e-4, 0.0, 1e-4])).links.along_m
        assert np.any((here - before) * (after - here) < 0)


def test_no_handle_turns_back_behind_a_tail_or_on_a_composite_track():
    assert not Leader(BENDY, LINKS, 50.0, BEHIND).turning_m(0.0, 40.0)
    assert not Leader(track_of(STurn()), LINKS, 40.0, AHEAD).turning_m(0.0, 40.0)


@pytest.mark.parametrize(('track', 'start_m', 'direction'), TRACKS)
def test_the_logs_are_those_of_the_speeds(track, start_m, direction):
    leader = Leader(track, LINKS, start_m, direction)
    v = chain_at(leader, 20.0).velocities(1.0)
    speed = np.hypot(v[:, 0], v[:, 1])[::-direction]
    assert states(leader, np.array([20.0])).log[0] == pytest.approx(np.log(speed), abs=1e-13)


def test_closer_states_bring_the_bound_down_with_the_square_of_their_distance():
    leader = Leader(track_of(STurn()), LINKS, 14.4799694, BEHIND)
    over = []
    for apart_m in (1e-2, 1e-3):
        ends = -0.5 * apart_m, 0.5 * apart_m
        over.append(np.max(tops(leader, *np.array(ends)[:, None])) - np.max(states(leader, np.array(ends)).log))
    assert over[1] < over[0] / 50


@pytest.mark.parametrize('apart_m', [1e-2, 1e-3])
def test_about_the_place_where_a_handle_is_fastest_the_bound_is_within_five_times_what_its_speed_falls(apart_m):
    leader, low = Leader(track_of(STurn()), LINKS, 14.4799694, BEHIND), np.array([-0.5 * apart_m])
    top, logs = tops(leader, low, low + apart_m)[0], logs_between(leader, low, low + apart_m)[:, 0]
    handle = int(np.argmax(logs[7]))
    falls = np.max(logs[:, handle]) - 0.5 * (logs[0, handle] + logs[-1, handle])
    assert falls > 3e-7
    assert top[handle] - np.max(logs[:, handle]) < 5 * falls


def test_where_speeds_rise_or_fall_all_the_way_the_bound_is_the_larger_of_both_ends():
    leader = Leader(track_of(STurn()), LINKS, -3.0, BEHIND)
    low = np.random.default_rng(3).uniform(0, 45, 100)
    top, ends = tops(leader, low, low + 0.01), logs_between(leader, low, low + 0.01)[[0, -1]]
    assert np.mean(top <= np.max(ends, axis=0) + 1e-14) > 0.95


RAMP = Profile(((0.0, 0.5), (4.0, 2.5), (8.0, 1.0)))


@pytest.mark.parametrize(('start_s', 'stop_s', 'rate'), [(1.0, 1.5, 0.5), (5.0, 5.25, -0.375)])
def test_on_a_ramp_the_slope_of_the_leaders_speed_is_its_acceleration_over_its_square(start_s, stop_s, rate):
    law = _law_of(Scene(Dragon(3), STurn(before_m=10.0), RAMP, Run(0, 8)))
    found = law.between(np.array([start_s]), np.array([stop_s]))
    v = np.array([RAMP.speed_at_m_s(t) for t in np.linspace(start_s, stop_s, 9)])
    slope = rate / v**2
    assert (found.start[0], found.stop[0]) == pytest.approx(np.log(v[[0, -1]] / 2.5))
    assert np.all(np.abs(slope - found.slope.mid[0]) <= found.slope.rad[0])
    assert found.slope.rad[0] <= 0.5 * np.ptp(slope) * 1.001


def test_with_its_law_a_handle_is_bounded_where_the_leader_speeds_up():
    leader = Leader(track_of(STurn()), LINKS, -3.0, BEHIND)
    law, times = _law_of(Scene(Dragon(3), STurn(before_m=10.0), RAMP, Run(0, 8))), np.linspace(0.2, 7.8, 60)
    times = np.unique(np.append(times, 4.0))
    gone = np.array([RAMP.travelled_m(t) for t in times])
    seen = states(leader, gone)
    row = np.arange(times.size - 1)
    top = bounds(seen.rows(row), seen.rows(row + 1), law.between(times[:-1], times[1:]))
    within = np.linspace(times[:-1], times[1:], 15)
    places = np.array([[RAMP.travelled_m(t) for t in part] for part in within.tolist()])
    own = np.log(np.array([[RAMP.speed_at_m_s(t) for t in part] for part in within.tolist()]) / 2.5)
    logs = states(leader, places.ravel()).log.reshape(*places.shape, -1) + own[..., None]
    assert np.all(logs <= top + 1e-12)
    assert np.median(top - np.max(logs, axis=0)) < 1e-12
