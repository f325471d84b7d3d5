"""The polyline that represents the track in drawings passes close to every handle."""
import numpy as np
import pytest
import shapely
from shapely import LineString

from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.spec import Spiral, STurn
from hard_cases import hard_cases

CASES = {problem.name: problem for problem in hard_cases()}


@pytest.mark.parametrize('scene', [Scene(), Scene(run=Run(400, 413)), Scene(head=Head(-1.0), run=Run(0, 50)),
                                   Scene(accuracy='paper', run=Run(0, 2))], ids=str)
def test_the_line_covers_every_handle_of_the_run_and_strays_from_the_track_no_more_than_promised(scene):
    line = compile_scene(scene).track_line(0.002)
    radius = np.hypot(*line.T)
    for k in (0, compile_scene(scene).last_tick // 2, compile_scene(scene).last_tick):
        p = tick(scene, k).chain.p
        assert radius[0] - 1e-9 <= np.hypot(*p.T).min()
        assert np.hypot(*p.T).max() <= radius[-1] + 1e-9
    middle = 0.5 * (line[1:] + line[:-1])
    turned = 0.5 * (radius[1:] + radius[:-1]) / scene.track.b_m
    on_track = scene.track.b_m * turned[:, None] * np.stack((np.cos(turned), np.sin(turned)), axis=1)
    assert np.hypot(*(middle - on_track).T).max() < 0.0021


def test_the_line_of_a_huge_dragon_stays_drawable():
    scene = Scene(run=Run(0, 1))
    assert len(compile_scene(scene).track_line(1e-12)) == 100_000


@pytest.mark.parametrize('scene', [
    Scene(track=STurn(before_m=20.0), run=Run(0, 60)),
    Scene(track=Spiral(start_turns=6), head=Head(1.0, lead='tail'), run=Run(0, 60))], ids=str)
def test_the_line_of_pieces_passes_every_handle(scene):
    line = compile_scene(scene).track_line(0.002)
    step = np.diff(line, axis=0)
    for k in (0, compile_scene(scene).last_tick // 2, compile_scene(scene).last_tick):
        for place in tick(scene, k).chain.p[::7]:
            along = np.sum((place - line[:-1]) * step, axis=1) / np.maximum(np.sum(step * step, axis=1), 1e-30)
            nearest = line[:-1] + np.clip(along, 0, 1)[:, None] * step
            assert np.min(np.hypot(*(place - nearest).T)) < 0.0021


@pytest.mark.parametrize('name', ['turning', 'wiggle', 'law', 'unwinding', 'spirals'])
def test_the_line_that_is_drawn_passes_under_every_handle(name):
    scene = CASES[name].scene
    line = LineString(compile_scene(scene).track_line(0.002))
    for t_s in CASES[name].times_s:
        assert shapely.distance(line, shapely.points(state(scene, t_s).p)).max() < 0.00201
