"""The candidates include all close pairs in any layout, and are few for a winding dragon."""
from dataclasses import replace

import numpy as np
import pytest
from apart import adjacent_layer_windows
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.errors import DragonError
from dragon_ros.core.geometry import broad_phase
from dragon_ros.core.geometry.broad_phase import box_pairs, candidates, default_reach_m
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral


def placed(scene, share=None, t_s=0.0):
    """Return a scene's handles and benches at a time or a share of its run; reject the example if there is no chain."""
    try:
        chain = state(scene, t_s if share is None else share * compile_scene(scene).end.t_s * (1 - 1e-9))
    except DragonError:
        assume(False)
    return chain.p, benches_of(chain, scene.dragon, axes_of(chain))


def chained(p, width, overhang):
    """Return the N benches between N+1 handles."""
    link = p[:-1] - p[1:]
    length = np.hypot(*link.T)
    return Benches(0.5 * (p[1:] + p[:-1]), link / length[:, None], 0.5 * length + overhang,
                   np.full(length.size, 0.5 * width))


def missed(p, benches, reach_m=None):
    """Test all pairs, and return those within reach that are not among the candidates."""
    reach = default_reach_m(benches) if reach_m is None else reach_m
    count = benches.half_length.size
    i, j = np.triu_indices(count, 2)
    near = (gaps(benches, i, j) <= reach) | (j - i <= 3)
    found = candidates(p, benches, reach_m)
    keys = found[0] * count + found[1]
    assert np.all(np.diff(keys) > 0), 'in order, each once'
    assert np.all(found[1] - found[0] >= 2)
    wanted = set(zip(i[near].tolist(), j[near].tolist(), strict=True))
    return wanted - set(zip(*(n.tolist() for n in found), strict=True))


def falls_back(p, benches):
    """Return whether only bounding boxes can guarantee the result."""
    sectors = broad_phase._sectors(p, benches, default_reach_m(benches))
    return sectors is None or broad_phase._polar_pairs(sectors) is None


@given(st.floats(0.05, 3), st.floats(1.2, 20), st.floats(0.01, 1), st.floats(0.6, 5), st.floats(0.6, 5),
       st.floats(0, 1), st.sampled_from([None, 0.0, 0.1, 1.0]))
@example(0.55, 16, 0.3, 3.41, 2.2, 0.95, None)      # the classic dragon near its contact
@example(0.1, 60, 0.3, 3.41, 2.2, 0.0, None)        # a bench crosses many layers
@example(0.55, 1.2, 0.3, 0.7, 0.65, 1.0, None)      # the innermost turn
@example(1.0, 2.0, 0.05, 5.0, 5.0, 0.0, None)       # links of nearly half a turn
@examples(100)
def test_candidates_miss_no_pair_of_any_dragon(pitch, turns, width, head, body, when, reach):
    scene = Scene(dragon=Dragon(60, head, body, width), track=Spiral(pitch, turns), run=Run(0, 1e4), solver='march')
    p, benches = placed(scene, when)
    assert not missed(p, benches, reach)


coordinate = st.floats(-6, 6)


@given(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=30, unique=True),
       st.floats(0, 1), st.floats(0, 1), st.sampled_from([0.0, 0.3]))
@example([(3, 0), (3, 2), (1, 0.5), (3, 0.2), (5, -1)], 0.1, 0.1, 0.0)
@example([(-1, 0), (1, 0), (1, 1), (-1, 0.5), (-1, -1), (2, 0)], 0.0, 0.0, 0.0)     # through the origin
@examples(100)
def test_candidates_miss_no_pair_of_handles_anywhere(handles, width, overhang, reach):
    p = np.array(handles, dtype=float)
    assume(np.all(np.hypot(*np.diff(p, axis=0).T) > 1e-6))
    assert not missed(p, chained(p, width, overhang), reach)


@given(st.lists(st.tuples(coordinate, coordinate, st.floats(-4, 4)), min_size=3, max_size=30))
def test_candidates_miss_no_pair_of_poses_that_do_not_belong_together(rows):
    x, y, yaw = np.array(rows).T
    benches = Benches(np.stack((x, y), 1), np.stack((np.cos(yaw), np.sin(yaw)), 1), np.full(x.size, 1.0),
                      np.full(x.size, 0.1))
    p = np.concatenate((np.stack((y, x), 1), [[0.0, 0.0]]))
    assert not missed(p, benches)


@pytest.mark.parametrize('mirror', [1, -1])
@pytest.mark.parametrize('turn_rad', [0.0, 2.0])
def test_a_turned_or_mirrored_dragon_has_the_same_candidates(turn_rad, mirror):
    p, benches = placed(Scene(), t_s=300.0)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    move = np.array([[c, s], [-s, c]]) * [1, mirror]
    moved = Benches(benches.centre @ move, benches.axis @ move, benches.half_length, benches.half_width)
    np.testing.assert_array_equal(candidates(p @ move, moved), candidates(p, benches))
    assert not falls_back(p @ move, moved)


@pytest.mark.parametrize(('benches', 't_s', 'most'), [
    (223, 0.0, 6), (223, 300.0, 6), (223, 425.0, 6), (5_000, 300.0, 6)])
def test_a_winding_dragon_has_few_candidates_a_bench(benches, t_s, most):
    p, rectangles = placed(Scene(dragon=Dragon(benches)), t_s=t_s)
    assert not falls_back(p, rectangles)
    assert candidates(p, rectangles)[0].size < most * benches


def test_handles_that_wind_back_are_left_to_boxes():
    angle = np.concatenate((np.arange(0, 9.5, 0.5), np.arange(9.5, 0.4, -0.5)))
    p = (1 + 0.1 * np.arange(angle.size))[:, None] * np.stack((np.cos(angle), np.sin(angle)), 1)
    benches = chained(p, 0.3, 0.1)
    assert falls_back(p, benches)
    np.testing.assert_array_equal(candidates(p, benches), box_pairs(benches, default_reach_m(benches)))
    assert not missed(p, benches)


def test_a_bench_over_more_layers_than_turns_are_tried_is_left_to_boxes():
    p, benches = placed(Scene(dragon=Dragon(800, 0.7, 0.65, 0.3), track=Spiral(0.02, 60)))
    assert falls_back(p, benches)
    np.testing.assert_array_equal(candidates(p, benches), box_pairs(benches, default_reach_m(benches)))
    assert not missed(p, benches)


def outside_windows(scene, t_s, reach_m):
    """Return the pairs within reach that are more than three benches apart, and those outside the paper's windows."""
    p, benches = placed(scene, t_s=t_s)
    first, last = adjacent_layer_windows(state(replace(scene, solver='march'), t_s).u)
    i, j = candidates(p, benches, reach_m)
    near = (gaps(benches, i, j) <= reach_m) & (j - i > 3)
    out = near & ((j < first[i]) | (j > last[i]))
    return int(np.sum(near)), set(zip(i[out].tolist(), j[out].tolist(), strict=True))


@pytest.mark.parametrize('t_s', [0.0, 100.0, 300.0, 406.8, 409.832, 412.473837682, 412.5])
def test_the_papers_windows_hold_every_near_pair_of_the_classic_dragon(t_s):
    count, missing = outside_windows(Scene(), t_s, 0.2)
    assert count > 0
    assert not missing


@pytest.mark.parametrize('scene', [Scene(track=Spiral(0.2)),
                                   Scene(dragon=Dragon(60, 2.2, 2.2), track=Spiral(0.3, 2.5))],
                         ids=['a dense spiral', 'near the centre'])
def test_the_papers_windows_leave_out_contacts_that_all_candidates_have(scene):
    count, missing = outside_windows(scene, 0.0, 0.0)
    assert 0 < len(missing) <= count


@given(st.integers(3, 12), st.integers(1, 11), st.floats(0, 3), st.integers(0, 2**32 - 1))
def test_steps_that_are_looked_up_together_have_the_pairs_that_each_has_alone(benches, steps, reach, seed):
    corners = np.random.default_rng(seed).uniform(-5, 5, (steps, 2, benches, 4, 2))
    low, high, within = corners.min(axis=(1, 3)), corners.max(axis=(1, 3)), np.linspace(0, reach, steps)
    for n, found in enumerate(broad_phase.pairs_on_steps(low, high, within)):
        (alone,) = broad_phase.pairs_on_steps(low[n:n + 1], high[n:n + 1], within[n:n + 1])
        np.testing.assert_array_equal(found, alone)


@pytest.mark.parametrize('reach', [0.0, 0.3])
def test_a_bench_enlarged_by_half_the_reach_is_in_its_sector_with_room_for_rounding_and_hardly_more(reach):
    p, benches = placed(Scene(), t_s=300.0)
    sectors = broad_phase._sectors(p, benches, reach)
    wider = replace(benches, half_length=benches.half_length + 0.5 * reach, half_width=benches.half_width + 0.5 * reach)
    corners = wider.corners @ np.array([1, 1j])
    middle = 0.5 * (sectors.low + sectors.high)[:, None]
    angle = middle + np.angle(corners * np.exp(-1j * middle))
    room = np.concatenate((np.min(angle, axis=1) - sectors.low, sectors.high - np.max(angle, axis=1)))
    far = sectors.outer - np.max(np.abs(corners), axis=1)
    assert np.all((room > 5e-10) & (room < 2e-8))
    assert np.all((far > 5e-10) & (far < 5e-8))
    sides = np.concatenate([corners + share * (np.roll(corners, 1, axis=1) - corners)
                            for share in np.linspace(0, 1, 2001)], axis=1)
    near = np.min(np.abs(sides), axis=1) - sectors.inner
    assert np.all((near > 5e-10) & (near < 1e-6))
