"""Positions and times of a leader, for laws whose distances are known in closed form."""
from itertools import pairwise
from math import inf, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.commanded import onwards_m
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.near_misses import passages_s, reversals
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.spec import Spiral

# The leader moves on to 4 m at 4 s, back to 2 m at 6 s, rests until 7 s, and moves on to 5 m at 10 s and beyond.
JUMPS = Profile(((0.0, 1.0), (4.0, 1.0), (4.0, -1.0), (6.0, -1.0), (6.0, 0.0), (7.0, 0.0), (7.0, 1.0), (10.0, 1.0)))
THERE = RangeOfTravel(JUMPS, 0.0, 10.0)


def test_every_passage_of_a_place_is_named_once_and_none_of_a_place_beyond():
    found = passages_s(THERE, [1.0, 3.0, 4.5, 5.5, -0.5, 9.0])
    assert found == [pytest.approx(times, abs=1e-12) for times in ([1.0], [3.0, 5.0, 8.0], [9.5], [], [], [])]


@examples(50)
@given(st.lists(st.floats(-2, 2), min_size=2, max_size=6), st.floats(-8, 8))
def test_passages_are_where_the_leader_is_at_the_place_as_often_as_it_changes_sides(speeds, place_m):
    law = Profile(tuple((3.0 * n, speed) for n, speed in enumerate(speeds)))
    # On a ramp, the leader's speed, and therefore its direction, may change sign between two breaks.
    end_s = 3.0 * (len(speeds) - 1) + 2.0
    travel = RangeOfTravel(law, 0.0, end_s)
    (found,) = passages_s(travel, [place_m])
    gone = [law.travelled_m(t) - place_m for t in (0.0, *law.breaks_s, end_s) if t <= end_s]
    assert all(law.travelled_m(t) == pytest.approx(place_m, abs=1e-9) for t in found)
    assert len(found) >= sum(a * b < 0 for a, b in pairwise(gone))


def test_the_leader_is_farthest_for_the_first_time():
    assert (THERE.farthest_s(1), THERE.farthest_s(-1)) == (10.0, 0.0)
    assert RangeOfTravel(JUMPS, 4.0, 9.0).farthest_s(-1) == 6.0      # the leader rests here until 7 s
    assert THERE.senses == [1]
    assert RangeOfTravel(JUMPS, 4.0, 9.5).senses == [1, -1]
    assert RangeOfTravel(JUMPS, 4.0, 7.5).senses == [-1]
    assert RangeOfTravel(JUMPS, 6.2, 6.8).senses == []


def test_reversals_are_where_the_sense_changes_and_a_rest_is_none():
    assert reversals(THERE) == [(4.0, 1), (6.0, -1)]
    assert reversals(RangeOfTravel(JUMPS, 4.5, 10.0)) == [(6.0, -1)]
    resting = Profile(((0.0, 1.0), (2.0, 1.0), (2.0, 0.0), (3.0, 0.0), (3.0, 1.0), (5.0, 1.0)))
    assert reversals(RangeOfTravel(resting, 0.0, 5.0)) == []


@pytest.mark.parametrize(('t_s', 'sense', 'on_m'), [(1.0, 1, 3.0), (1.0, -1, 0.0), (4.0, -1, 2.0), (5.0, -1, 1.0),
                                                    (8.0, 1, inf), (8.0, -1, 0.0), (6.5, 1, 0.0)])
def test_onwards_the_leader_goes_until_it_turns_or_rests(t_s, sense, on_m):
    assert onwards_m(JUMPS, t_s, sense) == pytest.approx(on_m, abs=1e-12)


def test_it_arrives_at_a_place_for_the_first_time_or_where_it_is_nearest():
    assert THERE.arrival_s(3.0, 1) == pytest.approx(3.0, abs=1e-12)
    assert THERE.arrival_s(4.5, 1) == pytest.approx(9.5, abs=1e-12)
    assert THERE.arrival_s(7.0, 1) == 10.0
    assert RangeOfTravel(JUMPS, 4.0, 10.0).arrival_s(3.0, -1) == pytest.approx(5.0, abs=1e-12)
    ramp = RangeOfTravel(Profile(((0.0, 0.0), (8.0, 4.0))), 0.0, 8.0)
    assert ramp.arrival_s(4.0, 1) == pytest.approx(4.0, abs=1e-12)         # t^2 / 4
    assert ramp.arrival_s(3.0, 1) == pytest.approx(sqrt(12.0), abs=1e-12)


@pytest.mark.parametrize(('speed', 'place_m', 't_s'), [
    (2.0, 5.0, 2.5), (-2.0, -5.0, 2.5), (2.0, 1.0, 1.0), (2.0, 99.0, 8.0), (0.0, 3.0, 1.0)])
def test_at_a_constant_speed_it_arrives_within_its_run(speed, place_m, t_s):
    assert RangeOfTravel(Head(speed), 1.0, 8.0).arrival_s(place_m, 1 if speed >= 0 else -1) == t_s


def test_the_range_of_a_run_holds_every_place_of_it():
    for start_s, end_s in ((0.0, 10.0), (3.0, 5.0), (4.5, 6.5)):
        travel = RangeOfTravel(JUMPS, start_s, end_s)
        gone = [travel.travel_m(t) for t in np.linspace(start_s, end_s, 101)]
        ends = [travel.travel_m(travel.farthest_s(sense)) for sense in (-1, 1)]
        assert [min(gone), max(gone)] == pytest.approx(ends, abs=0.1)
        assert ends[0] <= min(gone)
        assert max(gone) <= ends[1]


def domain_of(stop_s):
    scene = Scene(dragon=Dragon(20), run=Run(0, stop_s))
    end_s = compile_scene(scene).end.t_s
    return SearchDomain(compile_scene(scene), RangeOfTravel(scene.head, 0.0, end_s), 1, lambda states: None), end_s


@pytest.mark.parametrize('stop_s', [100.0, None])
def test_a_domain_goes_on_to_the_end_of_its_run(stop_s):
    domain, end_s = domain_of(stop_s)
    assert (domain.start_m, domain.stop_m) == (0.0, end_s)


def test_a_position_that_a_bench_does_not_reach_is_taken_at_the_nearer_end():
    domain, _ = domain_of(100.0)
    for travel_m, nearer_m in ((9.99, 10.0), (20.01, 20.0), (15.0, 15.0)):
        along_m = float(domain.along_m(travel_m)[7])
        assert domain.travel_at(7, along_m, (10.0, 20.0)) == pytest.approx(nearer_m, abs=1e-9)
        assert domain.travel_at(7, along_m, (20.0, 10.0)) == pytest.approx(nearer_m, abs=1e-9)


@pytest.mark.parametrize('sense', [1, -1])
def test_phases_follow_the_travel_in_both_directions_and_no_handle_turns_back_within_one(sense):
    """Near the centre, the rear handles of the first two links turn back; the leader moves in to 110.8 m and back."""
    law = Profile(((0.0, 1.0), (110.8, 1.0), (110.8, -1.0), (120.0, -1.0)))
    scene, travel = Scene(Dragon(12, 1.0, 1.0, 0.01), Spiral(0.55, 8.0)), RangeOfTravel(law, *{
        1: (110.0, 110.8), -1: (110.8, 111.6)}[sense])
    domain = SearchDomain(compile_scene(scene), travel, sense, lambda states: None)
    parts = domain.phases(domain.start_m, domain.stop_m)
    assert (parts[0][0], len(parts), parts[-1][1]) == (domain.start_m, 3, domain.stop_m)
    assert all(one[1] == two[0] for one, two in pairwise(parts))
    for before, after in parts:
        assert sense * (after - before) > 0
        steps = np.diff([domain.chain(place).u[:3] for place in np.linspace(before, after, 30)], axis=0)
        assert np.all(np.all(steps <= 1e-9, axis=0) | np.all(steps >= -1e-9, axis=0))
