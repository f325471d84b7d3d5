"""Scenes contain settings but no solver, and are frozen, normalised, equal if equivalent, and small when pickled."""
import json
import pickle
import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import FieldError
from dragon_ros.core.flags import Effect, Noise, Trails, effects_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn

COMPOSITE = Composite((Line(60.0), Arc(3.0, 90.0, (60.0, 0.0), 0.0), SpiralArc(2.0, 2.0, 1.0, 'left')), 55.0)
SCENES = [
    Scene(), Scene(accuracy=1e-7, solver='march', markers='triangles', run=Run(1.0, 9.0, 29.97)),
    Scene(Mixed((Group(3.41), Group(2.2, 3))), COMPOSITE, Profile(((0.0, 0.0), (3.0, 1.0)), 'smooth')),
    Scene(track=STurn(before_m=3.0), head=Head(1.0, 'tail'), run=Run(0, 5), effects=~Effect.NONE,
          noise=Noise(0.1, 0.2, 3), trails=Trails(2.0, 5))]

# The same scene written with -0.0, integers and lists of integers.
TWINS = [
    (Scene(run=Run(0.0, 5.0, 50.0)), Scene(run=Run(-0.0, 5, 50))),
    (Scene(head=Head(0.0), run=Run(0.0, 9.0)), Scene(head=Head(-0.0), run=Run(0, 9))),
    (Scene(track=Spiral(1.0, 0.0)), Scene(track=Spiral(1, -0.0))),
    (Scene(dragon=Dragon(5, 3.0, 2.0, 1.0, 0.0)), Scene(dragon=Dragon(5, 3, 2, 1, -0.0))),
    (Scene(dragon=Mixed((Group(3.0), Group(2.0, 4)), 1.0, 0.0)), Scene(dragon=Mixed((Group(3), Group(2, 4)), 1, -0.0))),
    (Scene(track=STurn(2.0, 9.0, 2.0, 0.0)), Scene(track=STurn(2, 9, 2, -0.0))),
    (Scene(track=Composite((Line(5.0), Arc(3.0, 90.0), SpiralArc(1.0, 2.0, 1.0)), 0.0)),
     Scene(track=Composite((Line(5), Arc(3, 90), SpiralArc(1, 2, 1)), -0.0))),
    (Scene(track=Composite((Line(5.0, (0.0, 1.0), 0.0),))), Scene(track=Composite((Line(5, (-0.0, 1), -0.0),)))),
    (Scene(head=Profile(((0.0, 0.0), (3.0, 1.0)))), Scene(head=Profile(((-0.0, -0.0), (3, 1))))),
    (Scene(accuracy=1.0), Scene(accuracy=1)),
    (Scene(noise=Noise(0.0, 1.0), trails=Trails(2.0)), Scene(noise=Noise(-0.0, 1), trails=Trails(2)))]


@pytest.mark.parametrize(('one', 'other'), TWINS)
def test_scenes_that_mean_the_same_are_equal_hash_alike_and_are_written_alike(one, other):
    assert one == other
    assert hash(one) == hash(other)
    assert repr(one) == repr(other)
    assert pickle.dumps(one) == pickle.dumps(other)
    assert len({one, other}) == 1


@pytest.mark.parametrize('scene', SCENES)
def test_a_scene_is_pickled_small_and_equal_whether_used_or_not(scene):
    fresh = replace(scene)
    before = pickle.dumps(fresh)
    state(fresh, 0.5)
    states(fresh, [0.0, 1.0])
    tick(fresh, 1)
    _ = compile_scene(fresh).end, fresh.dragon.link_lengths_m, fresh.dragon.bench_lengths_m, fresh.head.breaks_s
    after = pickle.dumps(fresh)
    assert pickle.loads(after) == pickle.loads(before) == scene
    assert len(after) == len(before) < 2000
    assert state(pickle.loads(after), 0.5).p.tobytes() == state(scene, 0.5).p.tobytes()


def test_the_scene_imports_no_solver():
    code = 'import sys, json\nimport dragon_ros.core.scene\nprint(json.dumps(list(sys.modules)))'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    loaded = [name for name in json.loads(done.stdout) if name.startswith('dragon_ros.core.')]
    solvers = {'chain.forward', 'chain.chain', 'chain.leader', 'chain.lock', 'chain.kinematics', 'shift_map', 'model',
               'step', 'paper', 'contact', 'effects', 'design', 'tracks.composite', 'tracks.segments',
               'tracks.spiral'}
    assert not [name for name in loaded if name.removeprefix('dragon_ros.core.') in solvers]


@pytest.mark.parametrize('name', ['dragon', 'track', 'accuracy', 'run'])
def test_a_scene_is_frozen(name):
    with pytest.raises(FrozenInstanceError):
        setattr(Scene(), name, None)


def test_using_a_scene_leaves_nothing_in_it():
    scene = Scene()
    before = dict(vars(scene))
    state(scene, 3.0)
    tick(scene, 3)
    assert dict(vars(scene)) == before


@pytest.mark.parametrize(('values', 'says'), [
    ({'solver': 'magic'}, 'solver: .*table, march'), ({'solver': 'walk'}, 'solver: .*table, march'),
    ({'markers': 'spheres'}, 'markers: .*cubes, triangles'), ({'accuracy': 'superb'}, 'accuracy: .*exact'),
    ({'accuracy': 0.0}, 'accuracy: '), ({'accuracy': float('nan')}, 'accuracy: '), ({'accuracy': True}, 'accuracy: '),
    ({'accuracy': 'paper', 'track': STurn()}, "solver: 'paper'.*one spiral"),
    ({'accuracy': 'paper', 'head': Head(lead='tail')}, "solver: 'paper'.*led by the head"),
    ({'effects': Effect.CONTACT}, 'effects: ')])
def test_settings_that_are_none_are_refused_by_name(values, says):
    with pytest.raises(FieldError, match=says):
        Scene(**values)


@given(st.sampled_from([1, 24, 29.97, 30, 50, 60, 100, 0.1, 1 / 3, 1000, 9876.54321]), st.integers(0, 10**9))
def test_a_ticks_time_is_the_floor_of_the_exact_one_and_leads_back_to_the_tick(rate, k):
    run = Run(start_s=400.0, rate_hz=rate)
    exact = 400 * 10**9 + k * 10**9 / Fraction(repr(float(rate)))
    assert run.time_ns(k) == exact // 1
    assert run.tick_at(run.time_ns(k)) == k
    assert run.tick_at(run.time_ns(k) - 1) == k - 1


def test_a_run_that_stops_before_it_starts_is_refused():
    with pytest.raises(FieldError, match='run.stop_s'):
        Run(10.0, 9.0)


def test_effects_have_the_names_of_the_scene_file():
    assert effects_of(['velocity', 'benches']).names == ['velocity', 'benches']
    with pytest.raises(FieldError, match='velocity, benches'):
        effects_of(['sparkles'])
