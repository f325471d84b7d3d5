from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.flags import Effect, effects_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, states, tick, velocity_of
from dragon_ros.core.tiers import EXACT, tier_for
from dragon_ros.core.tracks.spec import Spiral


@given(st.sampled_from([1, 24, 29.97, 30, 50, 60, 100, 0.1, 1 / 3, 1000, 123456.789]), st.integers(0, 10**9))
def test_a_ticks_time_is_the_floor_of_the_exact_one_and_leads_back_to_the_tick(rate, k):
    run = Run(start_s=400.0, rate_hz=rate)
    exact = 400 * 10**9 + k * 10**9 / Fraction(repr(float(rate)))
    assert run.time_ns(k) == exact // 1
    assert run.tick_at(run.time_ns(k)) == k
    assert run.tick_at(run.time_ns(k) - 1) == k - 1


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


def test_a_short_link_lets_the_head_reach_the_centre():
    scene = Scene(dragon=Dragon(3, 0.56, 0.56), track=Spiral(1.0, 2.0))
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


def test_a_run_that_stops_before_it_starts_is_refused():
    with pytest.raises(FieldError, match='run.stop_s'):
        Run(10.0, 9.0)


def test_metres_choose_the_tier_that_keeps_them():
    assert tier_for(1e-9).name == 'fine'
    assert tier_for(9e-10) is EXACT
    assert tier_for(100.0).name == 'preview'
    assert tier_for('exact') is EXACT
    for bad in (1e-16, 0.0, -1.0, 'superb', float('nan')):
        with pytest.raises(FieldError, match='accuracy'):
            tier_for(bad)


def test_effects_have_the_names_of_the_scene_file():
    assert effects_of(['velocity', 'benches']).names == ['velocity', 'benches']
    with pytest.raises(FieldError, match='velocity, benches'):
        effects_of(['sparkles'])


def test_the_papers_speeds_at_many_instants_are_those_at_each():
    scene, times = Scene(accuracy='paper'), [0.0, 300.0, 412.0]
    together = velocity_of(scene, states(scene, times), times)
    for t_s, one in zip(times, together, strict=True):
        assert np.array_equal(one, velocity_of(scene, state(scene, t_s), t_s))
