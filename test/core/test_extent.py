"""The room that a run takes: its bounds meet, and no corner at any time is outside."""
import numpy as np
import pytest

from dragon_ros.core.benches import axes_of, benches_of
from dragon_ros.core.dragon import Dragon
from dragon_ros.core.errors import FieldError
from dragon_ros.core.extent import extent
from dragon_ros.core.head import Head
from dragon_ros.core.path import Spiral
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, states

SCENES = [Scene(), Scene(dragon=Dragon(benches=1)), Scene(dragon=Dragon(benches=3), run=Run(start_s=400.0)),
          Scene(track=Spiral(0.45, 20.0), run=Run(stop_s=60.0)),
          Scene(head=Head(-2.0), run=Run(stop_s=70.0)), Scene(head=Head(0.0), run=Run(stop_s=1.0)),
          Scene(run=Run(start_s=5.0, stop_s=5.0))]


def corners(scene, times):
    chain = states(scene, times)
    return benches_of(chain, scene.dragon, axes_of(chain)).corners


@pytest.mark.parametrize('scene', SCENES, ids=range(len(SCENES)))
def test_no_corner_is_outside_at_any_of_many_times_and_the_bounds_meet(scene):
    found = extent(scene)
    times = np.random.default_rng(2).uniform(scene.run.start_s, scene.end.t_s, 300).tolist()
    seen = corners(scene, times)
    for reach, values in zip(found.reaches, (seen[..., 0], -seen[..., 0], seen[..., 1], -seen[..., 1]), strict=True):
        assert np.max(values) <= reach.high_m
        assert 0 <= reach.high_m - reach.low_m <= 1.1e-10
        chain = state(scene, reach.t_s)
        there = benches_of(chain, scene.dragon, axes_of(chain)).corners[reach.bench]
        assert np.min(np.hypot(*(there - reach.point_m).T)) < 1e-11
        assert abs(reach.point_m['xy'.index(reach.side[-1])]) == reach.low_m


def test_the_smallest_square_of_the_classic_run():
    found = extent(Scene())
    assert found.centred_m == pytest.approx(23.9941113215, abs=1e-9)
    assert found.free_m == pytest.approx(23.7196204917, abs=1e-9)
    assert (found.touching.bench, found.touching.corner, found.touching.side) == (222, 'rear left', '-x')


def test_looking_often_comes_close_to_the_answer_from_below():
    scene = SCENES[3]
    seen = max(float(np.max(np.abs(corners(scene, np.arange(k, k + 10, 0.02).tolist())))) for k in range(0, 50, 10))
    assert 0 <= 0.5 * extent(scene).centred_m - seen < 1e-4


def test_a_way_that_is_too_long_is_refused():
    with pytest.raises(FieldError, match=r'run\.stop_s'):
        extent(Scene(head=Head(-1000.0), run=Run(stop_s=1000.0)))
