"""The first frame of a run is computed in advance, which changes no frame."""
import sys
from dataclasses import replace
from threading import Event

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core import model
from dragon_ros.core.chain.commanded import Commanded
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.shift_map.table import ShiftMap
from dragon_ros.core.step import contact_frame, tick
from dragon_ros.core.tracks.spec import Arc, Composite, Line
from dragon_ros.nodes.frames import Frames
from dragon_ros.nodes.led import LedFrames
from dragon_ros.scenes.load import load_scene
from hard_cases import hard_cases

SCENE = Scene(dragon=Dragon(40), run=Run(100, 101))


def tiles(scene):
    return [tile for shift in compile_scene(scene).model.placement.maps.values() for tile in shift.tiles]


def built(scene):
    """Return the tables that have been built."""
    return {id(tile) for tile in tiles(scene)}


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
    """Begin without the models that other tests have cached."""
    monkeypatch.setattr(model, '_COMPILED', model._Compiled())


# A street with more joints within reach of the dragon than one table covers.
STREET = Scene(Dragon(40), Composite((Line(90.0), *(Arc(2.0, (-1) ** k * 40.0) for k in range(100)), Line(30.0)),
                                     start_m=230.0), run=Run(0, 5))

# A mixed dragon whose rear block is still on such a street when the head is far beyond it.
MIXED = Scene(Mixed((Group(2.2, 9), Group(1.9, 20))),
              Composite((Line(68.0), *(Arc(2.0, (-1) ** k * 20.0) for k in range(100)), Line(50.0)), start_m=158.0),
              run=Run(0, 20))


@pytest.mark.parametrize('name', thinned(['winding', 'turning', 'wiggle', 'mixed-by-the-tail', 'spirals', 'unwinding',
                                          'tight', 'street', 'mixed'], lambda name: name not in ('winding', 'wiggle')))
def test_no_frame_of_a_run_waits_for_a_table_once_all_are_built(name, nothing_built):
    named = {case.name: case.scene for case in hard_cases()} | {'street': STREET, 'mixed': MIXED}
    scene = named.get(name) or load_scene(name)
    frames = Frames(scene)
    frames.prepare()
    frames.tables.join()
    before = built(scene)
    assert any(before)
    assert len({tile.group for tile in tiles(scene)}) > 1 or name not in ('street', 'mixed')
    for k in np.linspace(0, frames.count - 1, 500).astype(int).tolist():
        frames.k = k
        frames.take()
    assert built(scene) == before


def test_no_frame_of_a_led_run_waits_for_a_table_ahead_or_behind_once_all_are_built(nothing_built):
    scene = replace(load_scene('turning'), head=Commanded(), run=Run(0, 60))
    frames = LedFrames(scene, lambda: 1.0, 'stop', print, 1.0)
    frames.prepare()
    frames.tables.join()
    before = built(scene)
    for travel_m in np.linspace(*compile_scene(scene).extent_m, 50).tolist():
        compile_scene(scene).model.place(travel_m)
    assert built(scene) == before


def test_nobody_waits_for_the_tables_of_a_run_and_one_is_built_once(nothing_built, monkeypatch):
    scene, go, begun = replace(load_scene('turning'), dragon=Dragon(20)), Event(), list[tuple[int, int]]()
    whole = ShiftMap._built

    def slowly(self, *section):
        """Build a tile; all tiles except the first wait for a signal."""
        begun.append(section[:2])
        assert len(begun) == 1 or go.wait(60)
        return whole(self, *section)

    monkeypatch.setattr(ShiftMap, '_built', slowly)
    frames = Frames(scene)
    frames.prepare()
    assert frames.take().k == 0
    assert frames.tables.is_alive()
    go.set()
    frames.k = frames.count - 1
    frames.take()
    frames.tables.join()
    assert len(begun) == len(set(begun)) > 1


def test_frames_have_the_same_bits_while_tables_are_built(nothing_built, monkeypatch):
    scene = replace(load_scene('turning'), dragon=Dragon(20))
    ticks = range(0, 10_000, 201)
    expected = [tick(scene, k).chain.p.tobytes() for k in ticks]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(3):
            monkeypatch.setattr(model, '_COMPILED', model._Compiled())
            frames = Frames(scene)
            frames.prepare()
            found = [tick(scene, k).chain.p.tobytes() for k in reversed(ticks)]
            frames.tables.join()
            assert found[::-1] == expected
    finally:
        sys.setswitchinterval(interval)


def test_frames_that_were_prepared_are_those_of_the_run_wherever_it_goes_on():
    frames = Frames(SCENE)
    for start, wanted in ((0, [0, 1]), (30, [30, 31])):
        frames.rewind()
        frames.prepare()
        frames.k = start
        for k in wanted:
            assert np.array_equal(frames.take().chain.p, tick(SCENE, k).chain.p)


def same(one, other):
    assert (one.k, one.t_ns) == (other.k, other.t_ns)
    for mine, its in ((one.chain.p, other.chain.p), (one.axis, other.axis), (one.velocity_m_s, other.velocity_m_s),
                      (one.benches.centre, other.benches.centre)):
        assert mine.tobytes() == its.tobytes()


@pytest.mark.parametrize('start', [0, 3, 30, 48, 50])
def test_frames_that_are_computed_together_are_those_of_the_run_wherever_it_goes_on(start):
    """A run of 51 ticks whose groups have 49 frames; the second seek ends within a group."""
    frames = Frames(SCENE, together=True)
    frames.prepare()
    for k in (0, 1, 2):
        same(frames.take(), tick(SCENE, k))
    frames.seek(SCENE.run.time_ns(start))
    for k in range(start, min(start + 3, frames.count)):
        same(frames.take(), tick(SCENE, k))
    frames.seek(SCENE.run.time_ns(1))
    for k in range(1, frames.count):
        same(frames.take(), tick(SCENE, k))
    assert (frames.next_ns(), len(frames.ahead)) == (None, 0)


def test_a_group_of_frames_ends_before_the_contact_that_ends_the_run():
    scene = load_scene('first_contact', ['run.start_s=412.3'])
    contact = first_contact(scene)
    frames = Frames(scene, contact, together=True)
    for k in range(frames.count - 1):
        same(frames.take(), tick(scene, k))
    same(frames.take(), contact_frame(scene, contact.t_s))
    frames.rewind()
    same(frames.take(), tick(scene, 0))


@pytest.mark.parametrize(('benches', 'most'), [(40, 49), (223, 9), (2000, 1)])
def test_the_number_of_frames_ahead_is_bounded_by_their_handles(benches, most):
    frames = Frames(replace(SCENE, dragon=Dragon(benches)), together=True)
    frames.take()
    assert len(frames.ahead) == most - 1
