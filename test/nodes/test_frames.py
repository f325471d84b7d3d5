"""The frames of a run: the first one is there before its time, and none depends on it."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core.chain.commanded import Commanded
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.nodes.frames import Frames
from dragon_ros.nodes.led import LedFrames

SCENE = Scene(dragon=Dragon(40), run=Run(100, 101))


def tiles(scene):
    return [tile for shift in compile_scene(scene).model.placement.maps.values() for tile in shift.tiles]


@pytest.mark.parametrize('led', [False, True])
def test_the_tables_of_the_first_frame_are_built_before_it_is_due(led):
    scene = replace(SCENE, dragon=Dragon(41 + led), head=Commanded() if led else SCENE.head)
    frames = LedFrames(scene, lambda: 1.0, 'stop', print, 1.0) if led else Frames(scene)
    frames.prepare()
    built = tiles(scene)
    assert built
    frame = frames.take()
    assert frame.k == 0
    assert tiles(scene) == built


def test_frames_that_were_prepared_are_those_of_the_run_wherever_it_goes_on():
    frames = Frames(SCENE)
    for start, wanted in ((0, [0, 1]), (30, [30, 31])):
        frames.rewind()
        frames.prepare()
        frames.k = start
        for k in wanted:
            assert np.array_equal(frames.take().chain.p, tick(SCENE, k).chain.p)
