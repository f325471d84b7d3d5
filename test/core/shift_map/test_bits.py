"""Positions are bit-identical across runs and processes, whatever was computed before."""
import pickle
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.model import Model, Simulation
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import frame_of, state, tick
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn
from hard_cases import hard_cases

TURNING = Scene(track=STurn(before_m=100.0), run=Run(0, 200))
# The joints of this track lie within a link of the end of the first tile, 448 links from the track's beginning.
BESIDE = Scene(dragon=Dragon(20), track=Composite((Line(730.0), Arc(10.0, 49.848), Arc(9.0, 300.0)), start_m=600.0))


def fresh(scene):
    """Return a simulation whose model has computed nothing yet."""
    return Simulation(scene, Model(scene.dragon, scene.track, scene.head.lead, scene.solver))


def bits(frame):
    """Return a tick's positions and velocities as bytes."""
    return frame.chain.p.tobytes() + frame.velocity_m_s.tobytes()


@pytest.mark.parametrize('stop_s', thinned([0.8, 40.0, 199.0, 1e6, None], (0.8, None).__contains__))
@pytest.mark.parametrize('k', thinned([0, 40, 5000], lambda k: k != 40))
def test_a_tick_of_turning_does_not_depend_on_when_its_run_stops(stop_s, k):
    other, t_ns = replace(TURNING, run=Run(0, stop_s)), TURNING.run.time_ns(k)
    simulation = fresh(other)
    assert bits(frame_of(simulation, k, t_ns, simulation.chain(t_ns / 1e9))) == bits(tick(TURNING, k))


@pytest.mark.parametrize(('rate_hz', 'start_s'), [(100.0, 0.0), (25.0, 0.0), (12.5, 40.0), (200.0, 79.0)])
def test_nor_on_the_rate_and_the_beginning_of_its_run(rate_hz, start_s):
    other = replace(TURNING, run=Run(start_s, 200.0, rate_hz))
    for t_s in (80.0, 104.0, 113.6):
        k = round((t_s - start_s) * rate_hz)
        assert other.run.time_ns(k) == TURNING.run.time_ns(round(t_s * 50))
        assert bits(tick(other, k)) == bits(tick(TURNING, round(t_s * 50)))


def test_nor_on_the_law_that_brought_the_leader_there():
    steady, slow = replace(TURNING, head=Head(2.0)), replace(TURNING, head=Profile(((0.0, 0.5),)))
    for travel_m in (8.0, 104.0, 131.0):
        p = state(TURNING, travel_m).p.tobytes()
        assert state(steady, travel_m / 2).p.tobytes() == state(slow, travel_m * 2).p.tobytes() == p


@examples(3)
@given(st.lists(st.floats(0, 180), min_size=1, max_size=4), st.randoms(use_true_random=False))
@example([141.0, 146.0], None)
def test_nor_on_what_was_asked_before(times, order):
    for scene in (replace(TURNING, dragon=Dragon(20)), BESIDE):
        expected = {t_s: fresh(scene).chain(t_s).p.tobytes() for t_s in times}
        there = fresh(scene)
        shuffled = times[::-1]
        if order:
            order.shuffle(shuffled)
        there.model.place_many(scene.head.travelled_m(np.array(shuffled[:2])))
        for t_s in shuffled:
            assert there.chain(t_s).p.tobytes() == expected[t_s]


SCENES = [problem.scene for problem in hard_cases() if problem.name in ('turning', 'wiggle', 'unwinding')] + [
    Scene(), BESIDE, Scene(dragon=Mixed((Group(3.41), Group(2.2, 20), Group(1.1, 20))), track=Spiral(0.55, 30.0))]


def test_nor_on_the_process():
    code = ('import sys, pickle\nfrom hashlib import sha256\nfrom dragon_ros.core.step import state\n'
            'scenes, times = pickle.load(sys.stdin.buffer)\n'
            'for scene in scenes[::-1]:\n    for t_s in times[::-1]:\n'
            '        chain = state(scene, t_s)\n'
            '        print(sha256(chain.p.tobytes() + chain.velocities(1.0).tobytes()).hexdigest())\n')
    times = [1.0, 9.5]
    done = subprocess.run([sys.executable, '-c', code], input=pickle.dumps((SCENES, times)), capture_output=True,
                          check=True)
    here = []
    for scene in SCENES:
        for t_s in times:
            chain = state(scene, t_s)
            here.append(sha256(chain.p.tobytes() + chain.velocities(1.0).tobytes()).hexdigest())
    assert done.stdout.decode().split() == here[::-1]


@pytest.mark.parametrize('scene', [TURNING, Scene()], ids=['turning', 'winding'])
def test_many_instants_at_once_agree_closely_with_each(scene):
    times = np.linspace(0, 190, 400).tolist()
    many = states(scene, times)
    for row, t_s in zip(many.p[::37], times[::37], strict=True):
        np.testing.assert_allclose(row, state(scene, t_s).p, rtol=0, atol=1e-13)
