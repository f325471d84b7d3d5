"""The shift table: all handles at once, as exact as handle after handle (its promises are kept in test_accuracy)."""
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import ChainLockError, FieldError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, states, tick
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.cost.problems import problems

CLASSIC, MARCHED = Scene(), Scene(solver='march')
MARCHED_CASES = {'centre', 'tiny-pitch', 'far-1e4', 'far-1e9', 'joined-handles', 'almost-joined', 'outwards',
                 'mixed-lock'}


def test_stats_say_which_solver_ran():
    assert state(CLASSIC, 300.0).solver == states(CLASSIC, [300.0]).solver == 'table'
    assert state(MARCHED, 300.0).solver == states(MARCHED, [300.0]).solver == 'march'
    assert state(replace(CLASSIC, accuracy='paper'), 300.0).solver == 'paper'


def test_the_table_serves_every_hard_case_but_these():
    assert {p.name for p in problems() if state(p.scene, p.times_s[0]).solver == 'march'} == MARCHED_CASES


@pytest.mark.parametrize('t_s', [0.0, 60.3, 300.0, 412.47, 432.0, 432.6, 432.9])
def test_table_and_march_agree_to_the_last_digits(t_s):
    one, other = state(CLASSIC, t_s), state(MARCHED, t_s)
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=1e-13)
    np.testing.assert_allclose(one.velocities(1.5), other.velocities(1.5), rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.tangents, other.tangents, rtol=0, atol=1e-13)


def test_many_states_agree_with_single_ones_in_any_order():
    times = [300.0, 0.0, 412.0, 300.05, 432.5, 1.0, 1.0]
    many = states(CLASSIC, times)
    speed = many.velocities(np.arange(1.0, 8.0))
    for k, t_s in enumerate(times):
        np.testing.assert_allclose(many.p[k], state(CLASSIC, t_s).p, rtol=0, atol=1e-13)
        np.testing.assert_allclose(speed[k], state(CLASSIC, t_s).velocities(k + 1.0), rtol=0, atol=1e-12)
        np.testing.assert_allclose(many.tangents[k], state(MARCHED, t_s).tangents, rtol=0, atol=1e-13)


def test_no_states_are_a_chain_of_no_states():
    assert states(CLASSIC, []).p.shape == (0, 224, 2)


@given(st.floats(0.3, 2), st.floats(4, 40), st.integers(8, 80), st.floats(0.8, 4), st.floats(0.8, 3), st.floats(-1, 1),
       st.floats(0, 0.999))
def test_any_dragon_on_the_table_is_where_the_march_puts_it(pitch, turns, benches, head, body, speed, part):
    try:
        scene = Scene(dragon=Dragon(benches, head, body), track=Spiral(pitch, turns), head=Head(speed), run=Run(0, 100))
        t_s = part * compile_scene(scene).end.t_s
    except (ChainLockError, FieldError):
        assume(False)
    one, other = state(scene, t_s), state(replace(scene, solver='march'), t_s)
    faster = max(1.0, float(np.max(np.hypot(*other.velocities(1.0).T))))
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=0.5 * compile_scene(scene).promise_m * faster)


def test_more_digits_take_more_nodes():
    nodes = [replace(CLASSIC, accuracy=tier).table.nodes for tier in ('preview', 'standard', 'fine', 'exact')]
    assert nodes == sorted(nodes)
    assert nodes[0] < nodes[-1] <= 16


def test_runs_on_one_track_share_their_bits():
    late = replace(CLASSIC, run=Run(400, 413, 10))
    assert tick(late, 7).chain.p.tobytes() == state(CLASSIC, 400.7).p.tobytes()


def test_a_track_too_long_for_one_table_has_one_for_each_run():
    far = Scene(dragon=Dragon(20), track=Spiral(0.55, 1e5), run=Run(1000, 1010))
    assert state(far, 1005.0).solver == 'table'
    assert state(far, 2.0).solver == 'march'
    assert far.table.rows < 60


def test_a_table_is_bounded_in_size():
    assert CLASSIC.table.memory_bytes < 300_000
    assert Scene(track=Spiral(0.55, 1e5), run=Run(0, 1e6)).table is None
    assert Scene(dragon=Dragon(7)).table is None


def test_products_in_parts_join_without_a_seam():
    long = Scene(dragon=Dragon(3000), run=Run(0, 400))
    np.testing.assert_allclose(state(long, 200.0).p, state(replace(long, solver='march'), 200.0).p, rtol=0, atol=1e-12)


def test_what_the_table_returns_is_closed_for_writing():
    for chain in (state(CLASSIC, 1.0), states(CLASSIC, [1.0])):
        for array in (chain.p, chain.velocities(1.0), chain.tangents):
            with pytest.raises(ValueError, match='read-only'):
                array[0] = 0


def test_a_head_without_a_place_for_its_link_is_a_lock():
    with pytest.raises(ChainLockError, match='link 0'):
        CLASSIC.table.place(CLASSIC.track.inward(432.93))
    with pytest.raises(ChainLockError, match='link 0'):
        CLASSIC.table.place_many(np.array([100.0, 14.7]), np.zeros(2))


def test_an_unknown_solver_is_refused():
    with pytest.raises(FieldError, match='table, march'):
        Scene(solver='magic')


def test_far_out_fewer_terms_are_summed_and_no_digit_is_lost():
    long = Scene(dragon=Dragon(3000), run=Run(0, 400))
    assert long.table.terms[-1] < long.table.terms[0]
    assert np.all(np.diff(long.table.terms) <= 0)
    np.testing.assert_allclose(state(long, 1.0).p[-9:], state(replace(long, solver='march'), 1.0).p[-9:], rtol=0,
                               atol=1e-12)
