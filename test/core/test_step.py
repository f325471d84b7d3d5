"""A run has the right limits, and a frame depends only on the scene and the tick."""
import numpy as np
import pytest

from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.flags import Effect
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes.load import load_scene


def test_the_last_tick_is_the_last_before_the_end():
    scene = Scene(run=Run(400, 413))
    assert compile_scene(scene).last_tick == 650
    assert scene.run.time_ns(650) == 413 * 10**9
    assert Scene().run.time_ns(compile_scene(Scene()).last_tick) <= 432.917924 * 1e9 + 500


def test_a_tick_alone_equals_the_tick_of_a_run_bit_for_bit():
    scene = Scene(run=Run(400, 402))
    run = [tick(scene, k) for k in range(compile_scene(scene).last_tick + 1)]
    for k in (77, 3, 100):
        alone = tick(Scene(run=Run(400, 402)), k)
        assert alone.t_ns == run[k].t_ns
        assert alone.chain.p.tobytes() == run[k].chain.p.tobytes()
        assert alone.velocity_m_s.tobytes() == run[k].velocity_m_s.tobytes()
        assert alone.benches.centre.tobytes() == run[k].benches.centre.tobytes()


@pytest.mark.parametrize('effects', [Effect.NONE, Effect.VELOCITY, Effect.BENCHES])
def test_an_effect_that_is_off_is_none_and_changes_nothing_else(effects):
    everything, some = tick(Scene(), 1000), tick(Scene(effects=effects), 1000)
    assert (some.velocity_m_s is not None) == (Effect.VELOCITY in effects)
    assert (some.benches is not None) == (Effect.BENCHES in effects)
    assert some.chain.p.tobytes() == everything.chain.p.tobytes()
    if some.velocity_m_s is not None:
        assert some.velocity_m_s.tobytes() == everything.velocity_m_s.tobytes()


def test_what_leaves_the_core_cannot_be_changed():
    frame = tick(Scene(), 5)
    for array in (frame.chain.p, frame.velocity_m_s, frame.benches.centre, frame.axis):
        with pytest.raises(ValueError, match='read-only'):
            array[0] = 0


def test_every_tick_of_the_first_contact_scene_keeps_its_links_to_1e_9_m():
    scene = Scene(run=Run(400, 413))
    for k in range(compile_scene(scene).last_tick + 1):
        assert tick(scene, k).chain.worst[0] < 1e-9


@pytest.mark.parametrize('k', [-1, 651])
def test_a_tick_outside_the_run_is_refused(k):
    with pytest.raises(FieldError, match='0 to 650'):
        tick(Scene(run=Run(400, 413)), k)


def test_a_negative_time_is_refused():
    with pytest.raises(FieldError, match='t_s'):
        state(Scene(), -1.0)


@pytest.mark.parametrize('call', [state, lambda scene, t_s: states(scene, np.array([0.0, t_s]))])
def test_a_time_after_the_longest_run_is_refused_on_an_endless_track(call):
    scene = load_scene('turning')
    call(scene, 1e6)
    with pytest.raises(FieldError, match=r't_s: 1000001.0 .*1e\+06'):
        call(scene, 1e6 + 1)


@pytest.mark.parametrize('call', [first_contact, lambda scene: compile_scene(scene).last_tick])
def test_a_run_that_would_end_after_the_longest_run_is_refused(call):
    scene = Scene(head=Profile(((0.0, 0.0), (1.0, 1e-213)), 'smooth'))
    assert state(scene, 1e6).p.shape == (224, 2)
    with pytest.raises(FieldError, match=r'the longest run lasts 1e\+06 s; give an earlier stop'):
        call(scene)


def test_a_short_link_lets_the_head_reach_the_centre():
    scene = Scene(dragon=Dragon(3, 0.6, 0.6), track=Spiral(1.0, 2.0))
    assert compile_scene(scene).end.reason == 'track'
    assert np.all(np.isfinite(state(scene, compile_scene(scene).end.t_s).p))
    with pytest.raises(TrackEndError, match='centre'):
        state(scene, compile_scene(scene).end.t_s * 1.001)


def test_a_head_at_rest_needs_a_stop():
    with pytest.raises(FieldError, match='run.stop_s'):
        _ = compile_scene(Scene(head=Head(0.0))).end
    scene = Scene(head=Head(0.0), run=Run(0, 10))
    assert state(scene, 3.0).p.tobytes() == state(scene, 9.0).p.tobytes()


def test_a_crawling_head_outlasts_the_stamps_and_is_told():
    with pytest.raises(FieldError, match='run.stop_s'):
        _ = compile_scene(Scene(head=Head(1e-8))).last_tick


def test_the_papers_speeds_at_many_instants_are_those_at_each():
    scene, times = Scene(accuracy='paper'), [0.0, 300.0, 412.0]
    together = velocity_of(scene, states(scene, times), times)
    for t_s, one in zip(times, together, strict=True):
        assert np.array_equal(one, velocity_of(scene, state(scene, t_s), t_s))


def test_the_end_of_the_track_itself_is_a_place_to_the_last_bit():
    scene = Scene(dragon=Dragon(3, 0.55, 1.5, 0.5, 0.25), track=Spiral(1.14453125, 1), head=Head(3.0))
    assert compile_scene(scene).end.reason == 'track'
    assert np.hypot(*state(scene, compile_scene(scene).end.t_s).p[0]) == pytest.approx(0, abs=1e-6)
