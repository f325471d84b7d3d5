"""A mixed dragon listing the classic benches equals the classic dragon, and the promises hold for all lists."""
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.chain.lock import follower, head_lock_angle
from dragon_ros.core.errors import ChainLockError, FieldError
from dragon_ros.core.flags import Effect
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.core.tracks.spec import Spiral, STurn
from dragon_ros.messages.encode import encoders

CLASSIC, SPELT = Scene(), Scene(dragon=Mixed((Group(3.41), Group(2.2, 100), Group(2.2, 122))))
TURNING = replace(CLASSIC, track=STurn(before_m=100.0), run=Run(0, 200))
LONG_FOURTH = Mixed((Group(1.1, 3), Group(3.9), Group(1.6, 6)), 0.02)
MIDDLE = Mixed((Group(1.2, 6), Group(3.6), Group(1.2, 25)))

group = st.builds(Group, st.one_of(st.floats(0.6, 4), st.sampled_from([0.6, 1.0, 2.2])), st.integers(1, 9))
mixed = st.builds(Mixed, st.lists(group, min_size=2, max_size=6).map(tuple), st.floats(0.05, 0.4))


@pytest.mark.parametrize('solver', ['table', 'march'])
def test_a_list_that_spells_out_the_classic_dragon_has_its_states_to_the_bit(solver):
    one, other = replace(CLASSIC, solver=solver), replace(SPELT, solver=solver)
    assert compile_scene(one).end == compile_scene(other).end
    for t_s in (0.0, 60.3, 300.0, 412.47, 432.9):
        a, b = state(one, t_s), state(other, t_s)
        assert a.solver == b.solver == solver
        assert a.p.tobytes() == b.p.tobytes()
        assert a.velocities(1.0).tobytes() == b.velocities(1.0).tobytes()
    assert states(one, [1.0, 400.0]).p.tobytes() == states(other, [1.0, 400.0]).p.tobytes()


@pytest.mark.parametrize('markers', ['cubes', 'triangles'])
def test_a_list_that_spells_out_the_classic_dragon_has_its_messages_to_the_bit(markers):
    every = ~Effect.NONE
    one, other = (replace(scene, effects=every, markers=markers) for scene in (CLASSIC, SPELT))
    for (name, a), b in zip(encoders(one).items(), encoders(other).values(), strict=True):
        assert a(tick(one, 20610)) == b(tick(other, 20610)), name


@pytest.mark.parametrize('scene', [TURNING, replace(TURNING, head=Head(1.0, 'tail'), track=STurn(before_m=-400.0))])
def test_a_list_that_spells_out_the_classic_dragon_turns_as_it_does(scene):
    other = replace(scene, dragon=SPELT.dragon)
    for t_s in (0.0, 110.0):
        assert state(scene, t_s).p.tobytes() == state(other, t_s).p.tobytes()


def test_the_papers_recipe_takes_the_classic_list_and_refuses_a_mixed_one():
    assert state(replace(SPELT, accuracy='paper'), 300.0).p.tobytes() == state(
        replace(CLASSIC, accuracy='paper'), 300.0).p.tobytes()
    with pytest.raises(FieldError, match='solver: .paper. .* equal benches behind the head'):
        Scene(dragon=MIDDLE, accuracy='paper')


@pytest.mark.parametrize(('groups', 'says'), [
    ((), r'dragon\.groups: 0 .* 1 to 20000 groups'),
    ((Group(2.2), Group(0.5)), r'dragon\.groups\.2\.length_m: 0\.5 .* links are 0.05 to 50 m'),
    ((Group(-1.0),), r'dragon\.groups\.1\.length_m: -1'),
    ((Group(2.2, 0),), r'dragon\.groups\.1\.count: 0 .* smallest is 1'),
    ((Group(2.2, 1.5),), r'dragon\.groups\.1\.count: 1\.5 .* whole number'),
    ((Group(2.2, 12_000), Group(2.2, 12_000)), r'dragon\.groups: .24000 benches. .* limit is 20000')])
def test_benches_that_cannot_be_built_are_refused_by_field(groups, says):
    with pytest.raises(FieldError, match=says):
        Mixed(groups)


@examples(50)
@given(mixed, st.floats(0.3, 2), st.floats(4, 30), st.floats(0, 0.999))
def test_links_of_any_mixed_list_hold_and_many_states_agree_with_one(dragon, pitch, turns, part):
    try:
        scene = Scene(dragon=dragon, track=Spiral(pitch, turns), run=Run(0, 60))
        t_s = part * compile_scene(scene).end.t_s
    except ChainLockError:
        assume(False)
    chain = state(scene, t_s)
    assert chain.solver == 'march' or dragon.benches >= 8
    assert chain.worst[0] < compile_scene(scene).promise_m
    assert chain.links_m.size == dragon.benches
    np.testing.assert_allclose(states(scene, [0.0, t_s]).p[1], chain.p, rtol=0, atol=compile_scene(scene).promise_m)
    size = benches_of(chain, dragon, axes_of(chain))
    np.testing.assert_allclose(2 * size.half_length - np.hypot(*np.diff(chain.p, axis=0).T), 0.55, rtol=0,
                               atol=compile_scene(scene).promise_m)


@examples(25)
@given(mixed, st.floats(0, 60), st.sampled_from(['head', 'tail']))
@example(Mixed((Group(1.0, 5), Group(4.0, 8), Group(0.6)), 0.25), 0.0, 'tail')     # the smallest link
def test_links_of_any_mixed_list_hold_on_a_turn_behind_head_and_tail(dragon, t_s, lead):
    scene = Scene(dragon=dragon, track=STurn(2.5, 20.0, 1.0, 30.0 if lead == 'head' else -30.0), head=Head(1.0, lead),
                  run=Run(0, 60))
    assert state(scene, t_s).worst[0] < 1e-12


def holds(theta, chords):
    for chord in chords:
        theta = follower(theta, chord)
    return theta < inf


@examples(60)
@given(st.lists(st.one_of(st.floats(0.01, 20), st.floats(5, 60)), min_size=1, max_size=10))
def test_a_chain_holds_above_its_lock_and_not_just_below(chords):
    angle, link = head_lock_angle(chords)
    above = np.linspace(angle * (1 + 1e-9) + 1e-9, max(chords) + 5, 200)
    assert all(holds(theta, chords) for theta in above.tolist())
    if angle:
        assert not holds(angle * (1 - 1e-9), chords)
        assert holds(angle * (1 - 1e-9), chords[:link])


def test_the_link_that_locks_first_is_named_wherever_it_is():
    end = compile_scene(Scene(dragon=LONG_FOURTH)).end
    assert (end.reason, end.link) == ('lock', 3)
    assert compile_scene(Scene(dragon=LONG_FOURTH, track=Spiral(0.55, 16.0), run=Run(0, 430))).end.reason == 'stop'
    with pytest.raises(ChainLockError, match='link 3 cannot be placed'):
        _ = compile_scene(Scene(dragon=LONG_FOURTH, track=Spiral(0.55, 2.0))).end


@pytest.mark.parametrize(('field', 'value'), [
    ('benches', 0), ('benches', 2.0), ('width_m', 0.0), ('head_length_m', 0.5), ('body_length_m', -2.2),
    ('hole_inset_m', -0.1), ('hole_inset_m', float('inf'))])
def test_impossible_benches_are_refused_by_field(field, value):
    with pytest.raises(FieldError, match='dragon.'):
        Dragon(**{field: value})
