"""Velocities of all handles: rigid links, and the rate of the positions."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state

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


@pytest.mark.parametrize('solver', ['march', 'table'])
def test_handles_that_a_link_of_no_length_joins_are_at_one_place_to_the_last_bit(solver):
    scene = Scene(dragon=Mixed((Group(3.41), Group(0.55, 2), Group(2.2, 30))), solver=solver)
    chain = state(scene, 123.4)
    joined = np.flatnonzero(scene.dragon.link_lengths_m == 0)
    assert joined.tolist() == [1, 2]
    assert np.array_equal(chain.p[joined], chain.p[joined + 1])
