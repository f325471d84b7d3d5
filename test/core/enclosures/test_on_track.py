"""Enclosures from two states of a chain hold for all states in between on any track, with either end leading."""
import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.chain.chain import marched_many
from dragon_ros.core.chain.leader import Leader
from dragon_ros.core.chain.lock import head_lock_angle
from dragon_ros.core.enclosures.ball_arithmetic import Ball
from dragon_ros.core.enclosures.on_track import (
    LinkStates,
    Views,
    _middle,
    _off_m,
    curvature_range,
    direction_errors,
    enclosed,
    kinematics,
    link_states,
    speeds_along,
    speeds_enclosed,
    swing_rad,
)
from dragon_ros.core.geometry.rectangles import axes_of
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.segments import AHEAD, BEHIND
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.core.tracks.spiral import SpiralCurve

LINKS = np.array([2.86, *(1.65,) * 8, 0.05, *(0.7,) * 6])
BENDY = track_of(Composite((Line(40.0), Arc(2.0, 170.0), Line(1.0), Arc(1.5, -100.0), Line(60.0)), start_m=40.0))
WOUND = track_of(Composite((Line(30.0), SpiralArc(1.2, 3.5, 2.0, 'left'), Line(30.0)), start_m=30.0))
TRACKS = {'turn': (track_of(STurn()), -3.0, BEHIND), 'turn back': (track_of(STurn()), 40.0, AHEAD),
          'bendy': (BENDY, 40.0, BEHIND), 'bendy back': (BENDY, 90.0, AHEAD), 'spiral arc': (WOUND, 30.0, BEHIND)}
COUNT = 9       # number of positions in each interval, including its ends


def sampled(leader, travel_m, links_m=LINKS):
    """Return chains at leader positions, the states of their links, and the handles' distances along the track."""
    places = leader.places(travel_m)
    chain = marched_many(leader.track, links_m, places, leader.direction)
    along_m, bend = leader.track.distances(chain.segment, chain.u), leader.track.curvatures(chain.segment, chain.u)
    return chain, link_states(along_m, chain.segment, bend, chain.headings, axes_of(chain), chain.leader), along_m


def holds(ball, values, off):
    """Return whether the values at all positions are in the balls (shape (M, K)) or within ``off`` of them."""
    with np.errstate(invalid='ignore'):
        return bool(np.all(~(np.abs(values - ball.mid) > ball.rad + off)))


@pytest.mark.parametrize('name', TRACKS)
@pytest.mark.parametrize('apart_m', [0.4, 0.05])
def test_every_mean_rate_in_between_is_in_the_enclosure_of_the_rate(name, apart_m):
    track, start_m, direction = TRACKS[name]
    leader = Leader(track, LINKS, start_m, direction)
    low = np.random.default_rng(8).uniform(0, 30, 30)
    places = np.linspace(low, low + apart_m, COUNT)
    chain, states, along_m = sampled(leader, places.ravel())
    first, last = np.arange(30), np.arange(30) + 30 * (COUNT - 1)
    moving = kinematics(states.rows(first), states.rows(last), LINKS, track.bends, chain.leader, 2e-12)
    step, sign = apart_m / (COUNT - 1), 1.0 if direction == BEHIND else -1.0    # derivatives change sign behind a tail
    axis = axes_of(chain)
    yaw = np.unwrap(np.arctan2(axis[..., 1], axis[..., 0]).reshape(COUNT, 30, -1), axis=0)
    speed = np.abs(np.diff(along_m.reshape(COUNT, 30, -1), axis=0)) / step
    assert holds(moving.v, speed, 1e-11 / step)
    assert holds(moving.a, sign * np.diff(speed, axis=0) / step, 1e-11 / step**2)
    long = LINKS > 0
    assert holds(moving.w[:, long], sign * np.diff(yaw, axis=0)[..., long] / step, 1e-11 / step)
    assert holds(moving.w_rate[:, long], np.diff(yaw, 2, axis=0)[..., long] / step**2, 1e-11 / step**2)
    assert np.mean(np.isfinite(moving.w_rate.rad)) > 0.9


@pytest.mark.parametrize(('name', 'v', 'w', 'a', 'w_rate'), [('turn', 1.1, 1.1, 1.6, 1.9),
                                                             ('turn back', 1.1, 1.1, 1.2, 1.25)])
def test_on_a_short_way_a_tenth_of_the_enclosures_are_within_a_stated_factor_of_what_occurs(name, v, w, a, w_rate):
    track, start_m, direction = TRACKS[name]
    leader, apart_m = Leader(track, LINKS, start_m, direction), 0.005
    low = np.random.default_rng(8).uniform(0, 30, 60)
    chain, states, along_m = sampled(leader, np.linspace(low, low + apart_m, COUNT).ravel())
    first, last = np.arange(60), np.arange(60) + 60 * (COUNT - 1)
    moving = kinematics(states.rows(first), states.rows(last), LINKS, track.bends, chain.leader, 2e-12)
    step, axis = apart_m / (COUNT - 1), axes_of(chain)
    yaw = np.unwrap(np.arctan2(axis[..., 1], axis[..., 0]).reshape(COUNT, 60, -1), axis=0)
    speed = np.abs(np.diff(along_m.reshape(COUNT, 60, -1), axis=0)) / step
    for factor, ball, seen, least in ((v, moving.v, speed, 1e-6), (w, moving.w, np.diff(yaw, axis=0) / step, 1e-6),
                                      (a, moving.a, np.diff(speed, axis=0) / step, 1e-4),
                                      (w_rate, moving.w_rate, np.diff(yaw, 2, axis=0) / step**2, 1e-4)):
        occurs = np.ptp(seen, axis=0) * (COUNT - 1) / (seen.shape[0] - 1)       # mean rates cover only part
        told = (occurs > least) & np.isfinite(ball.rad)
        assert np.count_nonzero(told) > 300
        assert np.percentile(2 * ball.rad[told] / occurs[told], 10) <= factor


@pytest.mark.parametrize('passes', [0, 8])
@pytest.mark.parametrize('links', [np.array([2.86, *(1.65,) * 8]), np.array([1.2, *(3.4,) * 5]),
                                   np.array([0.6, 0.05, 3.0, 0.2, 4.2, 1.0])], ids=range(3))
def test_next_to_a_lock_ratios_and_slopes_are_enclosed_where_no_handle_turns_back_in_between(links, passes):
    spiral, apart_m = Spiral(0.55, 5.0), 0.02
    leader = Leader(track_of(spiral), links, 0.0, BEHIND)
    lock_m = SpiralCurve.of(spiral).distance_to(head_lock_angle((links / spiral.b_m).tolist())[0])
    turning = leader.turning_m(0.0, lock_m)
    low = lock_m - apart_m - np.geomspace(1e-3, 5, 60)
    low = np.array([one for one in low.tolist() if not any(one < turn < one + apart_m for turn in turning)])
    _, states, _ = sampled(leader, np.linspace(low, low + apart_m, COUNT).ravel(), links)
    ends = states.rows(np.arange(low.size)), states.rows(np.arange(low.size) + low.size * (COUNT - 1))
    with np.errstate(all='ignore'):
        moving = enclosed(*ends, links, leader.track.bends, passes=passes)
        r, rate = moving.r, speeds_along(moving.r, moving.g)[1]
    ratio = np.where(links > 0, np.cos(states.near) / np.cos(states.far), 1.0).reshape(COUNT, low.size, -1)
    assert holds(r, ratio, 1e-9 * np.max(np.abs(ratio)) ** 3)
    log = np.log(np.abs(np.cumprod(ratio, axis=-1)))
    slope = np.diff(log, axis=0) / (apart_m / (COUNT - 1))
    assert holds(rate[:, 1:], slope, 1e-7 * np.exp(2 * np.max(log)))
    assert np.mean(np.isfinite(rate.rad)) > 0.5


JOINTS = {'to the other side': (track_of(Composite((Line(40.0), Arc(3.0, 90.0), Arc(3.0, -90.0), Line(60.0)),
                                                   start_m=40.0)), 40.0),
          'from and to lines': (BENDY, 40.0), 'to a spiral': (WOUND, 30.0),
          'of a turn': (track_of(STurn(ratio=1.0)), 5.0)}


def passing(leader):
    """Return the distances of the leader at which any handle passes a joint of the track."""
    gone = np.linspace(0, 30, 301)
    _, _, along_m = sampled(leader, gone)
    out = []
    for joint in leader.track.joints_m:
        row, handle = np.nonzero((along_m[:-1] < joint) != (along_m[1:] < joint))
        share = (joint - along_m[row, handle]) / (along_m[row + 1, handle] - along_m[row, handle])
        out.append(gone[row] + share * (gone[1] - gone[0]))
    return np.concatenate(out)


@pytest.mark.parametrize('passes', [0, 8])
@pytest.mark.parametrize('apart_m', thinned([0.5, 0.1], lambda apart_m: apart_m == 0.5))
@pytest.mark.parametrize('name', JOINTS)
def test_angles_stay_in_their_enclosures_where_a_handle_passes_a_joint_half_way(name, apart_m, passes):
    track, start_m = JOINTS[name]
    leader = Leader(track, LINKS, start_m, BEHIND)
    low = passing(leader) - 0.5 * apart_m
    low, count = low[low > 0], np.count_nonzero(low > 0)
    _, states, _ = sampled(leader, np.linspace(low, low + apart_m, 41).ravel())
    moving = enclosed(states.rows(np.arange(count)), states.rows(np.arange(count) + 40 * count), LINKS, track.bends,
                      passes=passes)
    for (sin, cos), angle in ((moving.near, states.near), (moving.far, states.far)):
        seen = angle.reshape(41, count, -1)
        assert holds(sin, np.sin(seen), 1e-11)
        assert holds(cos, np.cos(seen), 1e-11)


@pytest.mark.parametrize(('further_m', 'most_rad'), [(0.1, 0.1 / 4), (0.3, 0.3 / 4), (3.0, 2 * np.arcsin(1.65 / 8))])
def test_before_any_pass_an_angle_is_known_to_what_link_and_track_turn_and_to_schurs_bound(further_m, most_rad):
    leader = Leader(track_of(Composite((Arc(4.0, 700.0),))), np.array([1.65, 1.65]), 20.0, BEHIND)
    _, states, _ = sampled(leader, np.array([0.0, further_m]), leader.links_m)
    moving = enclosed(states.rows([0]), states.rows([1]), leader.links_m, leader.track.bends, passes=0)
    for sin, cos in (moving.near, moving.far):      # a ball of angles around asin(l / 2 R) with this radius
        assert sin.rad == pytest.approx(np.cos(np.arcsin(1.65 / 8)) * most_rad + most_rad**2 / 2, rel=1e-3)
        assert cos.rad == pytest.approx(1.65 / 8 * most_rad + most_rad**2 / 2, rel=1e-3)


def test_a_link_on_a_circle_turns_exactly_as_far_as_the_bound_says():
    radius_m, link_m, travel_m = 4.0, 1.65, np.array([0.3])
    assert swing_rad(np.array([1 / radius_m]), link_m, 2 * travel_m) == pytest.approx(travel_m / radius_m)


def test_a_link_turned_about_its_rear_handle_turns_exactly_as_far_as_the_bound_says():
    assert swing_rad(np.array([9.0]), 1.65, np.array([0.3])) == pytest.approx(0.3 / 1.65)


def test_curvatures_between_places_are_those_at_them_on_one_segment_and_of_all_segments_else():
    bends = np.array([[-0.1, -0.5], [-0.5, -0.5]]), np.array([[0.2, 0.7], [0.7, 0.3]])
    on_one = curvature_range(bends, (np.array([0]), np.array([0])), (np.array([0.15]), np.array([0.05])))
    over = curvature_range(bends, (np.array([1]), np.array([0])), (np.array([0.1]), np.array([0.05])))
    assert [float(value[0]) for value in (*on_one, *over)] == [0.05, 0.15, -0.5, 0.7]


def test_schurs_bound_says_nothing_of_a_link_that_is_longer_than_the_tightest_circle_is_wide():
    along_m, bend = np.array([[8.0, 6.0]]), np.array([[2.0, 2.0]])
    ends = [LinkStates(along_m + moved_m, np.zeros((1, 2), dtype=np.int64), bend, np.array([[0.1]]), np.array([[-0.1]]))
            for moved_m in (0.0, 5.0)]
    moving = enclosed(*ends, np.array([1.65]), (np.array([[2.0]]), np.array([[2.0]])), passes=0)
    for ball in (*moving.near, *moving.far):    # the track turns by 10 rad, and the link by at most 6 rad
        assert ball.rad[0, 0] > 0.5 * 8.0**2


@pytest.mark.parametrize('name', TRACKS)
def test_ratios_of_speeds_that_are_enclosed_only_where_they_change_are_within_those_of_all_links(name):
    track, start_m, direction = TRACKS[name]
    low = np.random.default_rng(8).uniform(0, 30, 30)
    _, states, _ = sampled(Leader(track, LINKS, start_m, direction), np.concatenate((low, low + 0.2)))
    links = LINKS[::-direction]
    one, two = states.rows(np.arange(30)), states.rows(np.arange(30, 60))
    r, v_rate = speeds_enclosed(one, two, links, track.bends, float(-direction))
    every = enclosed(one, two, links, track.bends, float(-direction))
    for some, whole in ((r, every.r), (v_rate, speeds_along(every.r, every.g)[1])):
        known = np.isfinite(whole.rad)
        assert np.all((np.abs(some.mid - whole.mid) <= whole.rad)[known])
        assert np.all(some.rad[known] <= whole.rad[known] * (1 + 1e-9))
    steady = (r.mid == 1) & (r.rad == 0)
    assert 0 < np.mean(steady) < 1
    assert np.all(np.abs(every.r.mid - 1)[steady] < 1e-9)


@pytest.mark.parametrize('link_m', [0.05, 0.4, 1.0, 3.0])
def test_a_link_turns_by_no_more_than_its_error_if_both_ends_are_off_and_by_nearly_as_much(link_m):
    off_m = 1e-5
    (found,), track = direction_errors(np.array([link_m]), (-0.5, 0.2), off_m)
    turned = np.arctan(2 * off_m / link_m)
    assert turned <= found <= 1.001 * turned
    assert 0.5 * off_m <= track <= 0.501 * off_m


def seen_at(middle):
    """Return the view of one pair whose second bench is centred at a point, given as a complex number."""
    return Views((np.array([middle.real]), np.array([middle.imag])), np.zeros((1, 4, 2)))


@pytest.mark.parametrize('far_m', [0.5, 10.0])
def test_a_middle_that_goes_half_round_a_bench_stays_in_its_enclosure_which_is_no_wider_than_it_is_far(far_m):
    still, turn = Ball(np.zeros(1), np.zeros(1)), Ball(np.array([-np.pi]), np.zeros(1))
    x, y, _, _ = _middle(seen_at(far_m + 0j), seen_at(-far_m + 0j), (still, still), turn, np.ones(1), np.zeros(1))
    assert x.mid == y.mid == 0
    assert far_m <= y.rad[0] <= far_m * (1 + 1e-9)
    assert far_m <= x.rad[0] <= 2 * far_m * (1 + 1e-9)


@pytest.mark.parametrize('far_m', [(1.0, 30.0), (30.0, 1.0)])
def test_a_middle_is_no_further_off_than_told_at_either_state_and_nearly_so_far(far_m):
    turned, error_m = 1e-6, 1e-7
    off_m = _off_m(*(seen_at(one_m * np.exp(0.3j)) for one_m in far_m), np.array([turned]), error_m)[0]
    most = max(abs(one_m * np.expm1(1j * turned)) + 2 * error_m for one_m in far_m)     # the errors of both
    assert most <= off_m <= 1.01 * most
