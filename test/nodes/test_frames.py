"""The frames of a run: the first one is there before its time, and none depends on it."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core import model
from dragon_ros.core.chain.commanded import Commanded
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.nodes.frames import Frames
from dragon_ros.nodes.led import LedFrames
from dragon_ros.scenes.load import load_scene
from hard_cases.dances import dances

SCENE = Scene(dragon=Dragon(40), run=Run(100, 101))


def tiles(scene):
    return [tile for shift in compile_scene(scene).model.placement.maps.values() for tile in shift.tiles]


def built(scene):
    """Return what is built: tables, and the series of leaders on their stretches."""
    return {id(tile): {key for key, one in tile.entrances.items() if one} for tile in tiles(scene)}


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


@pytest.fixture
def nothing_built(monkeypatch):
    """No model is kept from other tests."""
    monkeypatch.setattr(model, '_COMPILED', model._Compiled())


@pytest.mark.parametrize('name', ['winding', 'turning', 'wiggle', 'mixed-by-the-tail', 'spirals', 'unwinding'])
def test_no_frame_of_a_run_waits_for_a_table(name, nothing_built, monkeypatch):
    monkeypatch.setattr('dragon_ros.nodes.frames._AHEAD_S', 60.0)      # whatever else this machine does
    scene = {case.name: case.scene for case in dances()}.get(name) or load_scene(name)
    frames = Frames(scene)
    frames.prepare()
    before = built(scene)
    assert before
    for k in np.linspace(0, frames.count - 1, 500).astype(int).tolist():
        frames.k = k
        frames.take()
    assert built(scene) == before


def test_no_frame_of_a_led_run_waits_for_a_table_ahead_or_behind(nothing_built, monkeypatch):
    monkeypatch.setattr('dragon_ros.nodes.frames._AHEAD_S', 60.0)
    scene = replace(load_scene('turning'), head=Commanded(), run=Run(0, 60))
    LedFrames(scene, lambda: 1.0, 'stop', print, 1.0).prepare()
    before = built(scene)
    for gone_m in np.linspace(*compile_scene(scene).extent_m, 50).tolist():
        compile_scene(scene).model.place((gone_m, 0.0))
    assert built(scene) == before


def test_tables_that_take_too_long_wait_until_a_frame_needs_them(nothing_built, monkeypatch):
    scene = load_scene('turning')
    monkeypatch.setattr('dragon_ros.nodes.frames._AHEAD_S', 0.0)
    frames = Frames(scene)
    frames.prepare()
    before = built(scene)
    assert before
    frames.k = frames.count - 1
    frames.take()
    assert built(scene) != before


def test_frames_that_were_prepared_are_those_of_the_run_wherever_it_goes_on():
    frames = Frames(SCENE)
    for start, wanted in ((0, [0, 1]), (30, [30, 31])):
        frames.rewind()
        frames.prepare()
        frames.k = start
        for k in wanted:
            assert np.array_equal(frames.take().chain.p, tick(SCENE, k).chain.p)
