"""Models are compiled from scenes, shared by equal scenes, and cached up to a limit."""
import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core import model as model_module
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import ChainLockError, FieldError, TrackEndError
from dragon_ros.core.flags import Effect
from dragon_ros.core.model import Model, compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn

CLASSIC = Scene()


@pytest.mark.parametrize('other', [
    Scene(), replace(CLASSIC, run=Run(400, 413)), replace(CLASSIC, head=Head(2.5)),
    replace(CLASSIC, head=Profile(((0.0, 1.0), (5.0, 2.0)))), replace(CLASSIC, effects=Effect.NONE),
    replace(CLASSIC, markers='triangles'), Scene(dragon=Dragon(223, 3.41, 2.2)), replace(CLASSIC, accuracy=2e-12),
    replace(CLASSIC, accuracy='preview')],
    ids=['equal', 'run', 'speed', 'law', 'effects', 'markers', 'spelt out', 'metres', 'old name'])
def test_scenes_that_share_dragon_track_leader_and_solver_share_one_model(other):
    assert compile_scene(other).model is compile_scene(CLASSIC).model


@pytest.mark.parametrize('other', [
    Scene(dragon=Dragon(222)), Scene(track=Spiral(0.56)), Scene(solver='march'), Scene(head=Head(lead='tail'))],
    ids=['dragon', 'track', 'solver', 'leader'])
def test_scenes_that_differ_in_one_of_these_do_not(other):
    assert compile_scene(other).model is not compile_scene(CLASSIC).model


def test_the_same_scene_has_the_same_simulation():
    scene = Scene()
    assert compile_scene(scene) is compile_scene(scene)
    assert compile_scene(scene).scene is scene


def test_models_are_kept_in_number_and_the_least_recently_used_go_first():
    first = compile_scene(CLASSIC).model
    for benches in range(300, 300 + 2 * model_module._MOST_SIMULATIONS):
        compile_scene(Scene(dragon=Dragon(benches)))
        assert compile_scene(replace(CLASSIC)).model is first
    kept = model_module._COMPILED
    assert len(kept._models) <= model_module._MOST_SIMULATIONS
    assert len(kept._simulations) <= model_module._MOST_SIMULATIONS
    assert compile_scene(Scene(dragon=Dragon(300))).model is compile_scene(Scene(dragon=Dragon(300))).model


def test_a_scene_that_is_used_before_every_other_keeps_its_tables():
    scene = Scene(dragon=Dragon(60))
    state(scene, 1.0)
    model = compile_scene(scene).model
    for benches in range(500, 500 + 2 * model_module._MOST_SIMULATIONS):
        assert compile_scene(scene).model is model
        compile_scene(Scene(dragon=Dragon(benches)))
    assert compile_scene(Scene(dragon=Dragon(60))).model is model
    assert model.memory_bytes


def test_a_model_whose_scene_is_only_compiled_lays_out_no_tables():
    model = compile_scene(Scene(dragon=Dragon(61))).model
    compile_scene(Scene(dragon=Dragon(62)))
    assert model.memory_bytes == 0
    assert 'placement' not in vars(model)


def test_models_are_kept_in_bytes(monkeypatch):
    scenes = [Scene(dragon=Dragon(benches)) for benches in range(100, 110)]
    state(scenes[0], 1.0)
    one = compile_scene(scenes[0]).model.memory_bytes
    assert one > 50_000
    monkeypatch.setattr(model_module, '_MOST_BYTES', 4.5 * one)
    for scene in scenes:
        state(scene, 1.0)
    compile_scene(Scene(dragon=Dragon(3)))
    assert sum(model.memory_bytes for model in model_module._COMPILED._models.values()) <= 4.5 * one


@pytest.mark.parametrize(('scene', 'error', 'says'), [
    (Scene(track=Composite((Line(10.0), Arc(3.0, 90.0, at_m=(10.0, 0.001))))), FieldError, r'track\.pieces\.2\.at_m'),
    (Scene(track=Composite((Line(9.0), Arc(1.44, 90.0)))), FieldError, 'bends tighter than 1.44444 m'),
    (Scene(track=STurn(ratio=2.3)), FieldError, 'bends tighter than 1.44444 m'),
    (Scene(track=Composite((Line(9.0),), start_m=9.5)), FieldError, r'track\.start_m'),
    (Scene(accuracy=1e-12), FieldError, 'give 2e-12 or more, or exact'),
    (Scene(track=Composite((Line(9.0, (9995.0, 0.0)),))), FieldError, 'the world ends at 10000 m')],
    ids=['joint', 'bend', 'turn', 'start', 'accuracy', 'world'])
def test_what_only_a_track_in_the_plane_can_tell_is_refused_when_the_scene_is_compiled(scene, error, says):
    with pytest.raises(error, match=says):
        compile_scene(scene)
    with pytest.raises(error, match=says):      # raised again, since no incomplete model is cached
        compile_scene(scene)


def test_a_chain_that_is_locked_from_the_start_says_so_at_its_first_use():
    with pytest.raises(ChainLockError, match='locked from the start'):
        _ = compile_scene(Scene(track=Spiral(0.01))).limit


def test_limits_are_metres_of_the_leader_and_no_law_moves_them():
    assert compile_scene(CLASSIC).model.limits == compile_scene(replace(CLASSIC, head=Head(3.0))).model.limits
    back, on = compile_scene(CLASSIC).model.limits
    assert back is None
    assert (on.reason, on.link, on.travel_m) == ('lock', 0, pytest.approx(432.917923, abs=5e-7))
    track = Composite((Line(10.0), Arc(3.0, 90.0)), start_m=4.0)
    back, on = compile_scene(Scene(dragon=Dragon(10), track=track)).model.limits
    assert back is None
    assert (on.reason, on.travel_m) == ('track', pytest.approx(6 + 1.5 * np.pi, rel=1e-15))


def test_a_model_places_what_the_scene_places():
    scene, gone = Scene(head=Head(2.0)), 200.0
    model = compile_scene(scene).model
    assert model.place(gone).p.tobytes() == state(scene, 100.0).p.tobytes()
    np.testing.assert_allclose(model.place_many(np.array([200.0])).p[0], state(scene, 100.0).p, rtol=0,
                               atol=1e-13)
    np.testing.assert_allclose(model.march(gone).p, state(scene, 100.0).p, rtol=0, atol=1e-12)
    with pytest.raises(TrackEndError):
        model.place(1000.0)


def test_mixed_benches_that_spell_out_a_dragon_place_it_alike():
    spelt = Scene(dragon=Mixed((Group(3.41), Group(2.2, 222))))
    assert state(spelt, 300.0).p.tobytes() == state(CLASSIC, 300.0).p.tobytes()


@pytest.mark.parametrize('pitch_m', [0.4, 0.55, 1.7, 6.0, 30.0])
def test_times_are_checked_against_the_end_of_the_model(pitch_m):
    dragon = Dragon()
    simulation = compile_scene(Scene(dragon=dragon, track=Spiral(pitch_m, 12.0), head=Head(-1.0)))
    simulation.check_times(np.array([0.0, 1e6]))
    with pytest.raises(FieldError, match='t_s'):
        simulation.check_times(np.array([5.0, -1.0]))


def test_a_model_goes_with_its_tables_when_nobody_holds_it():
    known = compile_scene(Scene()).model
    model = Model(known.dragon, known.spec, known.lead, known.solver)
    model.place(5.0)
    shift, = model.placement.maps.values()
    held = weakref.ref(model), weakref.ref(shift)
    gc.disable()
    try:
        del model, shift
        assert [one() for one in held] == [None, None]
    finally:
        gc.enable()
