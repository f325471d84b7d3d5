"""Velocities of all handles keep links rigid and equal the rates of change of positions."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon, is_even
from dragon_ros.core.scene import Scene
from dragon_ros.core.shift_map.blocks import Placement
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Spiral

CLASSIC = Scene()


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


@pytest.mark.parametrize('link', [0, 3, 8])
def test_the_worst_link_is_the_one_that_misses_its_length_by_most(link):
    chain = state(Scene(dragon=Dragon(9)), 10.0)
    p = chain.p.copy()
    p[link + 1:] += 0.25 * (p[link + 1] - p[link]) / np.hypot(*(p[link + 1] - p[link]))
    off_m, worst = replace(chain, p=p).worst
    assert worst == link
    assert off_m == pytest.approx(0.25)


@pytest.mark.parametrize(('axis', 'low_m', 'high_m'), [(0, 1.2, 1.5), (1, 14.9, 15.2)])
def test_a_single_link_keeps_its_length_where_it_is_parallel_to_an_axis(axis, low_m, high_m):
    track = track_of(Spiral(0.55))
    placement = Placement(track, np.array([2.86]), BEHIND, {})

    def across(along_m):
        p = placement.place(track.place_at(along_m)).p
        return float(p[0, axis] - p[1, axis])
    sense = np.sign(across(high_m))
    while low_m < (middle_m := 0.5 * (low_m + high_m)) < high_m and across(middle_m):
        low_m, high_m = (low_m, middle_m) if sense * across(middle_m) > 0 else (middle_m, high_m)
    chain = placement.place(track.place_at(middle_m))
    velocity = chain.velocities(1.0)
    assert abs(np.dot(chain.p[0] - chain.p[1], velocity[0] - velocity[1])) < 1e-14
    assert 1e-6 < abs(np.linalg.norm(velocity[1]) - 1.0) < 1e-3


@pytest.mark.parametrize(('links_m', 'even'), [
    ([2.86], True), ([2.86, 1.65], True), ([2.86, 1.65, 1.65], True), ([2.86, 1.65, 1.7], False),
    ([2.86, 1.7, 1.65, 1.65], False), ([1.65, 1.65, 2.86], False)])
def test_benches_are_even_if_those_behind_the_head_are_equal(links_m, even):
    assert is_even(np.array(links_m)) is even
