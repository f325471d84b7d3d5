"""Mixed benches: a list that spells out the classic dragon is that dragon, and any other keeps the same promises."""
import json
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from apart import smallest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from dragon_ros.core.benches import axes_of, benches_of
from dragon_ros.core.contact.certificate import Contact, NoContact
from dragon_ros.core.contact.first_contact import first_contact
from dragon_ros.core.contact.narrow_phase import BenchSampler, beyond, further
from dragon_ros.core.contact.near_misses import near_misses
from dragon_ros.core.design.bounding_box import bounding_box
from dragon_ros.core.design.max_speed import max_speed
from dragon_ros.core.design.min_pitch import min_pitch
from dragon_ros.core.dragon import Dragon, Group, Mixed, goes_on_alike
from dragon_ros.core.effects import Effect
from dragon_ros.core.errors import ChainLockError, DragonError, FieldError, InputError
from dragon_ros.core.head import Head
from dragon_ros.core.lock import follower, head_lock_angle
from dragon_ros.core.path import Spiral
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state, states, tick
from dragon_ros.core.tiers import EXACT
from dragon_ros.core.turn import Turn
from dragon_ros.tools import certificate
from dragon_ros.wire.encode import encoders
from dragon_ros.wire.scenes import load_scene, scene_values

CLASSIC, SPELT = Scene(), Scene(dragon=Mixed((Group(3.41), Group(2.2, 100), Group(2.2, 122))))
TURNING = replace(CLASSIC, track=Turn(before_m=100.0), run=Run(0, 200))
LONG_FOURTH = Mixed((Group(1.1, 3), Group(3.9), Group(1.6, 6)), 0.02)
MIDDLE = Mixed((Group(1.2, 6), Group(3.6), Group(1.2, 25)))

group = st.builds(Group, st.one_of(st.floats(0.55, 4), st.sampled_from([0.55, 1.0, 2.2])), st.integers(1, 9))
mixed = st.builds(Mixed, st.lists(group, min_size=2, max_size=6).map(tuple), st.floats(0.05, 0.4))


@pytest.mark.parametrize('solver', ['table', 'march'])
def test_a_list_that_spells_out_the_classic_dragon_has_its_states_to_the_bit(solver):
    one, other = replace(CLASSIC, solver=solver), replace(SPELT, solver=solver)
    assert one.end == other.end
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


def test_a_list_that_spells_out_the_classic_dragon_has_its_first_contact_and_certificate():
    assert first_contact(SPELT) == first_contact(CLASSIC)


@pytest.mark.parametrize('scene', [TURNING, replace(TURNING, head=Head(1.0, 'tail'), track=Turn(before_m=-400.0))])
def test_a_list_that_spells_out_the_classic_dragon_turns_as_it_does(scene):
    other = replace(scene, dragon=SPELT.dragon)
    for t_s in (0.0, 110.0):
        assert state(scene, t_s).p.tobytes() == state(other, t_s).p.tobytes()


def test_the_papers_recipe_takes_the_classic_list_and_refuses_a_mixed_one():
    assert state(replace(SPELT, accuracy='paper'), 300.0).p.tobytes() == state(
        replace(CLASSIC, accuracy='paper'), 300.0).p.tobytes()
    with pytest.raises(FieldError, match='accuracy: .paper. .* equal behind the head'):
        Scene(dragon=MIDDLE, accuracy='paper')


@pytest.mark.parametrize(('groups', 'says'), [
    ((), r'dragon\.groups: 0 .* 1 to 10000 groups'),
    ((Group(2.2), Group(0.5)), r'dragon\.groups\.2\.length_m: 0\.5 .* two holes'),
    ((Group(-1.0),), r'dragon\.groups\.1\.length_m: -1'),
    ((Group(2.2, 0),), r'dragon\.groups\.1\.count: 0 .* smallest is 1'),
    ((Group(2.2, 1.5),), r'dragon\.groups\.1\.count: 1\.5 .* whole number'),
    ((Group(2.2, 600_000), Group(2.2, 600_000)), r'dragon\.groups: .1200000 benches. .* most are 1000000')])
def test_benches_that_cannot_be_built_are_refused_by_field(groups, says):
    with pytest.raises(FieldError, match=says):
        Mixed(groups)


@given(mixed, st.floats(0.3, 2), st.floats(4, 30), st.floats(0, 0.999))
def test_links_of_any_mixed_list_hold_and_many_states_agree_with_one(dragon, pitch, turns, part):
    try:
        scene = Scene(dragon=dragon, track=Spiral(pitch, turns), run=Run(0, 60))
        t_s = part * scene.end.t_s
    except ChainLockError:
        assume(False)
    chain = state(scene, t_s)
    assert chain.solver == 'march' or dragon.benches >= 8
    assert chain.worst[0] < 1e-13
    assert chain.links_m.size == dragon.benches
    np.testing.assert_allclose(states(scene, [0.0, t_s]).p[1], chain.p, rtol=0, atol=scene.promise_m)
    size = benches_of(chain, dragon, axes_of(chain))
    np.testing.assert_allclose(2 * size.half_length - np.hypot(*np.diff(chain.p, axis=0).T), 0.55, rtol=0, atol=1e-12)


@given(mixed, st.floats(0, 60), st.sampled_from(['head', 'tail']))
@example(Mixed((Group(1.0, 5), Group(4.0, 8), Group(0.5500000000000002)), 0.25), 0.0, 'tail')      # a link of one ulp
def test_links_of_any_mixed_list_hold_on_a_turn_behind_head_and_tail(dragon, t_s, lead):
    scene = Scene(dragon=dragon, track=Turn(2.5, 20.0, 1.0, 30.0 if lead == 'head' else -30.0), head=Head(1.0, lead),
                  run=Run(0, 60))
    assert state(scene, t_s).worst[0] < 1e-12


def holds(theta, chords):
    for chord in chords:
        theta = follower(theta, chord)
    return theta < inf


@settings(max_examples=60)
@given(st.lists(st.one_of(st.just(0.0), st.floats(0.01, 20), st.floats(5, 60)), min_size=1, max_size=10))
def test_a_chain_holds_above_its_lock_and_not_a_hair_below(chords):
    angle, link = head_lock_angle(chords)
    above = np.linspace(angle * (1 + 1e-9) + 1e-9, max(chords) + 5, 200)
    assert all(holds(theta, chords) for theta in above.tolist())
    if angle:
        assert not holds(angle * (1 - 1e-9), chords)
        assert holds(angle * (1 - 1e-9), chords[:link])


def test_the_link_that_locks_first_is_named_wherever_it_is():
    end = Scene(dragon=LONG_FOURTH).end
    assert (end.reason, end.link) == ('lock', 3)
    assert Scene(dragon=LONG_FOURTH, track=Spiral(0.55, 16.0), run=Run(0, 430)).end.reason == 'stop'
    with pytest.raises(ChainLockError, match='link 3 finds no place'):
        _ = Scene(dragon=LONG_FOURTH, track=Spiral(0.55, 2.0)).end


def test_behind_which_benches_the_dragon_goes_on_alike():
    lengths = np.array([3.0, 2, 1, 2, 1, 2])
    assert goes_on_alike(lengths, 1, 3)
    assert goes_on_alike(lengths, 1, 5)
    assert not goes_on_alike(lengths, 1, 2)
    assert not goes_on_alike(lengths, 0, 1)


@settings(max_examples=30)
@given(mixed, st.floats(2.5, 9), st.floats(0, 2))
def test_benches_beyond_the_bound_of_all_further_ones_are_there(dragon, theta, way):
    pitch = 1.6
    try:
        scene = Scene(dragon=dragon, track=Spiral(pitch, 4.0))
        watch = BenchSampler(scene.chained.walk, dragon, 0, dragon.benches, EXACT.effort(20, 100), lambda states: None)
        views = [watch.sample(np.array([2 * theta + turned])) for turned in (0.0, way)]
    except ChainLockError:
        assume(False)
    bound = further(*views, watch.sizes, beyond(*views, watch.sizes))[0]
    if watch.sizes.longest_m is None:
        return
    for view in views:
        chain = Scene(dragon=dragon, track=Spiral(pitch, view.places[0] / (2 * np.pi)))
        corners = benches_of(state(chain, 0.0), dragon, axes_of(state(chain, 0.0))).corners
        ends = corners[2:], np.roll(corners[2:], 1, axis=1)
        share = np.linspace(0, 1, 200)[:, None, None, None]
        nearest = np.min(np.hypot(*np.moveaxis(ends[0] + share * (ends[1] - ends[0]), -1, 0)), axis=(0, 2))
        furthest = np.max(np.hypot(*np.moveaxis(corners[0], -1, 0)))
        assert np.all(bound <= np.minimum.accumulate(nearest[::-1])[::-1] - furthest + 1e-9)


@settings(max_examples=12, deadline=None)
@given(mixed, st.floats(0.4, 1.6), st.floats(3, 6), st.sampled_from([1.0, 1.0, -1.0]), st.floats(5, 60))
def test_nothing_touches_before_the_first_contact_of_a_mixed_dragon(dragon, pitch, turns, speed, stop_s):
    try:
        scene = Scene(dragon=dragon, track=Spiral(pitch, turns), head=Head(speed), run=Run(0, stop_s))
        found = first_contact(scene)
    except DragonError:
        assume(False)
    before_s = (found.t_s if isinstance(found, Contact) else scene.end.t_s) - 1e-6
    assert all(smallest(scene, t_s) > 0 for t_s in np.linspace(0, before_s, 40) if before_s > 0)
    if isinstance(found, Contact) and not found.grazing_m:
        assert smallest(scene, found.t_s) < 1e-9


def checked(folder, values):
    (folder / 'proof.json').write_text(json.dumps(values))
    return certificate.check(folder / 'proof.json')


@pytest.mark.parametrize(('scene', 'pair'), [
    (load_scene('mixed', ['run.start_s=394.5']), (40, 71)),
    (Scene(dragon=MIDDLE, track=Spiral(0.5, 7.0)), (0, 6)),
    (Scene(dragon=Mixed((Group(3.41), *(Group(length) for _ in range(12) for length in (2.2, 1.7)))), run=Run(405)),
     (0, 9)),
    (Scene(dragon=Mixed((Group(1.2, 4), Group(2.0), Group(1.2, 9))), track=Spiral(0.6, 2.5), head=Head(-1.0),
           run=Run(0, 40)), None)],
    ids=['a long tail', 'a long bench in the middle', 'two lengths by turns', 'winding out'])
def test_mixed_dragons_have_certificates_that_the_checker_accepts(tmp_path, scene, pair):
    found = first_contact(scene)
    assert found.certificate.complete
    assert getattr(found, 'benches', None) == pair
    values = certificate.as_values(scene, found)
    assert checked(tmp_path, values) == len(values['intervals']) > 0


def test_what_one_bench_meets_proves_nothing_of_another_one_before_other_benches(tmp_path):
    scene = Scene(dragon=Mixed((Group(1.2, 4), Group(2.0), Group(1.2, 9))), track=Spiral(0.7, 5.0), run=Run(0, 10))
    values = certificate.as_values(scene, first_contact(scene))
    assert {row['lead'] for row in values['intervals']} >= {'head', 'body', 'bench 3'}
    for row in values['intervals']:
        if row['lead'] == 'bench 3':
            row['lead'] = 'bench 2'
    with pytest.raises(InputError, match='leave out the place|no other one starts|bound'):
        checked(tmp_path, values)


def test_where_a_link_behind_the_second_turns_back_the_run_is_refused_with_the_time_to_stop_at(tmp_path):
    scene = Scene(dragon=LONG_FOURTH, run=Run(420))
    with pytest.raises(FieldError, match=r'run\.stop_s.*stop at 430\.\d+ s or before') as refused:
        first_contact(scene)
    stop_s = float(str(refused.value).split('stop at ')[1].split()[0])
    early = replace(scene, run=Run(420, stop_s))
    found = first_contact(early)
    assert isinstance(found, NoContact)
    assert found.certificate.complete
    forged = {**certificate.as_values(early, found), 'scene': scene_values(scene)}
    with pytest.raises(InputError, match='may turn back'):
        checked(tmp_path, forged)


def test_near_misses_of_a_mixed_dragon_are_the_smallest_gaps_of_its_head():
    scene = load_scene('mixed')
    misses = [miss for miss in near_misses(scene, first_contact(scene), 0.05).nearest if miss.benches[0] == 0]
    assert [miss.bench for miss in misses][:2] == [13, 11]
    assert misses[0].gap_m == pytest.approx(0.03515, abs=1e-5)


def test_the_tail_of_the_example_touches_first():
    found = first_contact(load_scene('mixed'))
    assert (found.benches, found.certificate.complete) == ((40, 71), True)
    assert found.t_s == pytest.approx(395.622364981, abs=1e-9)


def test_the_smallest_pitch_of_a_mixed_dragon_is_refused_and_of_an_even_list_found():
    with pytest.raises(FieldError, match=r'dragon\.groups: .32 mixed benches. .* equal behind the head'):
        min_pitch(MIDDLE)
    even = min_pitch(Mixed((Group(3.41), Group(2.2, 39))), largest_m=0.5, within_m=1e-6)
    assert even == min_pitch(Dragon(40), largest_m=0.5, within_m=1e-6)


def test_the_room_of_a_mixed_dragon_holds_every_corner_of_its_run():
    scene = replace(load_scene('mixed'), run=Run(390, 393))
    times = np.linspace(390, 393, 200).tolist()
    chain = states(scene, times)
    reached = 2 * np.max(np.abs(benches_of(chain, scene.dragon, axes_of(chain)).corners))
    low, high = bounding_box(scene).centred_m
    assert reached <= high < low + 1e-9
    assert low < reached + 1e-3


@pytest.mark.parametrize('lead', ['head', 'tail'])
def test_no_handle_of_a_mixed_dragon_is_faster_than_the_fastest(lead):
    dragon = Mixed((Group(0.9, 5), Group(2.2, 3), Group(1.3, 4), Group(3.0), Group(2.2, 3)))
    scene = Scene(dragon=dragon, track=Turn(before_m=5.0 if lead == 'head' else -15.0), head=Head(1.0, lead),
                  run=Run(0, 30))
    v = states(scene, np.linspace(0, 30, 3000).tolist()).velocities(np.ones(3000))
    seen = np.max(np.hypot(v[..., 0], v[..., 1]))
    assert seen <= max_speed(scene).bound < seen + 1e-4
