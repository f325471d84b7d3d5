"""Shift maps place blocks of equal links as accurately as the march does, on any track and for either leader.

The promises are tested against the 50-digit reference in test_accuracy, with and without shift maps.
"""
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.chain.chain import marched
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.forward import forward, next_place, next_places
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.errors import ChainLockError, FieldError, TrackEndError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.shift_map.blocks import Placement, lengths_with_maps
from dragon_ros.core.shift_map.build import Stretch, build, span_of
from dragon_ros.core.shift_map.table import ShiftMap
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import Place, track_of
from dragon_ros.core.tracks.segments import AHEAD, BEHIND
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from hard_cases import hard_cases

CASES = {problem.name: problem for problem in hard_cases()}
MARCHED = {'centre', 'mixed-lock'}      # six links, and a leader next to its lock
FAR = {'far-corner'}        # tables serve only some leaders
LONG = {'most-benches', 'longest-chain'}
TURNING, UNWINDING = CASES['turning'].scene, CASES['unwinding'].scene
SHORT = Dragon(12, 2.2, 1.6)

lines = st.builds(Line, st.floats(0.05, 6))
arcs = st.builds(Arc, st.floats(1.6, 5), st.floats(5, 400) | st.floats(-400, -5))
winds = st.builds(SpiralArc, st.floats(1.5, 3), st.floats(1, 3), st.floats(1, 3), st.sampled_from(['left', 'right']))
tracks = st.lists(lines | arcs | winds, min_size=1, max_size=7)


def placement(track, links, direction):
    """Return a placement that has its own shift maps, which have no tiles yet."""
    maps = {link_m: ShiftMap(track, link_m, count, direction)
            for link_m, count in lengths_with_maps(links).items()}
    return Placement(track, links, direction, maps)


def march(scene):
    return replace(scene, solver='march')


def dance(pieces, lead):
    """Return a scene that covers a whole track, extended by a line at both ends."""
    try:
        track = Composite((Line(1.0), *pieces, Line(1.0)))
        end_m = track_of(track).end_m
        if lead == 'tail':
            track = replace(track, start_m=end_m)
        scene = Scene(dragon=SHORT, track=track, head=Head(1.0, lead), run=Run(0, end_m + 4))
        compile_scene(scene)
        return scene
    except FieldError:
        assume(False)


def agree(scene, t_s):
    """Check that the chain and its velocities, alone and in a batch, agree with the march within the promise."""
    one, other, many = state(scene, t_s), state(march(scene), t_s), states(scene, [t_s, t_s])
    atol = 0.5 * compile_scene(scene).promise_m        # the error of either may be a quarter of the promise
    v = velocity_of(march(scene), other, t_s)
    fast = max(1.0, float(np.max(np.hypot(*v.T)))) ** 2
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=atol)
    np.testing.assert_allclose(velocity_of(scene, one, t_s), v, rtol=0, atol=atol * fast)
    np.testing.assert_allclose(one.headings, other.headings, rtol=0, atol=atol)
    np.testing.assert_allclose(many.p, [other.p] * 2, rtol=0, atol=atol)
    np.testing.assert_allclose(velocity_of(scene, many, [t_s, t_s]), [v] * 2, rtol=0, atol=atol * fast)
    np.testing.assert_allclose(many.headings, [other.headings] * 2, rtol=0, atol=atol)
    return one.solver


@pytest.mark.parametrize('name', thinned([name for name in CASES if name not in FAR | LONG],
                                         lambda name: [*CASES].index(name) % 3 == 0 or name in MARCHED))
def test_stats_say_that_the_table_serves_every_hard_case_but_these(name):
    scene, t_s = CASES[name].scene, CASES[name].times_s[-1]
    assert state(scene, t_s).solver == ('march' if name in MARCHED else 'table')
    assert states(scene, [t_s]).solver == ('march' if name in MARCHED else 'table')
    assert state(march(scene), t_s).solver == states(march(scene), [t_s]).solver == 'march'


@pytest.mark.parametrize('name', thinned(
    [name for name in CASES if 'lock' not in name and 'across' not in name and name not in LONG],
    lambda name: [*CASES].index(name) % 4 == 1 and name != 'unwinding'))
def test_states_of_a_hard_case_are_its_single_ones_to_half_the_promise(name):
    scene = CASES[name].scene
    times = sorted({*np.linspace(0.0, compile_scene(scene).end.t_s, 40).tolist(), *CASES[name].times_s})
    promise_m = compile_scene(scene).promise_m
    many = states(scene, times)
    speed = velocity_of(scene, many, times)
    for n, t_s in enumerate(times):
        one = state(scene, t_s)
        np.testing.assert_allclose(many.p[n], one.p, rtol=0, atol=0.5 * promise_m)
        v = velocity_of(scene, one, t_s)
        fast = max(1.0, float(np.max(np.hypot(*v.T)))) ** 2      # near a lock, small shifts change velocities much
        np.testing.assert_allclose(speed[n], v, rtol=0, atol=0.5 * promise_m * fast)


@pytest.mark.parametrize('scene', [TURNING, UNWINDING])
def test_a_state_has_the_same_bits_whatever_was_asked_before(scene):
    times = (0.0, 17.3, 60.0, 111.1, 150.0)
    there, back = replace(scene), replace(scene)
    ahead = {t_s: state(there, t_s).p.tobytes() for t_s in times}
    states(back, times[::2])
    for t_s in reversed(times):
        assert state(back, t_s).p.tobytes() == ahead[t_s]


@examples(30)
@given(tracks, st.sampled_from(['head', 'tail']), st.floats(0, 1))
@example([Arc(2.0, 90.0), Arc(2.0, -90.0), Arc(2.0, 90.0)], 'head', 0.5)
@example([Line(1.05), Line(1.05), Line(1.05), Line(1.05)], 'head', 0.3)
def test_on_any_track_the_table_is_where_the_march_is(pieces, lead, part):
    scene = dance(pieces, lead)
    agree(scene, part * compile_scene(scene).end.t_s)


@examples(50)
@given(tracks, st.sampled_from([BEHIND, AHEAD]), st.floats(0.2, 1.6))
@example([Arc(1.6, 350.0), Line(0.05), Arc(1.6, -350.0)], BEHIND, 1.6)
def test_links_across_joints_of_many_places_are_those_of_each(pieces, direction, link_m):
    try:
        track = track_of(Composite((Line(4.0), *pieces, Line(4.0))))
    except FieldError:
        assume(False)
    along_m = np.concatenate([[joint_m + past_m for past_m in (-1.7, -0.9, -0.3, -1e-9, 0.0, 1e-9, 0.3, 0.9, 1.7)]
                              for joint_m in track.joints_m])
    places = track.places_at(along_m)
    found = next_places(track, places, link_m, direction)[0]
    for place, there in zip(zip(*places, strict=True), zip(*found, strict=True), strict=True):
        one, _ = next_place(track, Place.of(*place), link_m, direction)
        off_m = np.subtract(track.distance_of(one), track.distance_of(Place.of(*there)))
        assert abs(off_m.sum()) < 1e-12


@examples(25)
@given(tracks, st.integers(0, 8), st.integers(0, 12),
       st.sampled_from([0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-9, -1e-9, 1e-4]))
def test_a_handle_at_a_joint_or_next_to_it_is_where_the_march_puts_it(pieces, joint, handle, past_m):
    scene = dance(pieces, 'head')
    track = compile_scene(scene).model.track
    joint = 1 + joint % (len(track.segments) - 1)
    links_m = scene.dragon.link_lengths_m[:handle][::-1].tolist()
    try:
        head = forward(track, links_m, Place(joint, track.segments[joint].first), AHEAD).place(-1)
    except TrackEndError:
        assume(False)
    t_s = track.distance_of(head) + past_m
    assume(0 <= t_s <= compile_scene(scene).end.t_s)
    agree(scene, t_s)


@examples(20)
@given(st.lists(st.tuples(st.sampled_from([0.05, 0.9, 1.65, 2.0]), st.integers(1, 30)), min_size=1, max_size=5),
       st.sampled_from([BEHIND, AHEAD]), st.floats(0, 1))
def test_benches_of_any_mix_are_where_the_march_puts_them(mix, direction, part):
    links = np.repeat(*map(np.array, zip(*mix, strict=True)))
    assume(links.sum() > 0)
    track, low, high = track_of(STurn()), -links.sum() * 1.3 - 5, 60.0
    metres = high * part if direction == BEHIND else low + part * (high - links.sum() - low)
    place = placement(track, links, direction)
    leader = track.place_at(metres)
    one, other = place.place(leader), marched(track, links, leader, direction)
    many = place.place_many(track.places_at(np.array([metres])))
    for p, v in ((one.p, one.velocities(1.5)), (many.p[0], many.velocities(1.5)[0])):
        np.testing.assert_allclose(p, other.p, rtol=0, atol=3e-13)
        np.testing.assert_allclose(v, other.velocities(1.5), rtol=0, atol=1e-12)
    if metres not in track.joints_m:        # at a joint the first link is marched, and in a batch all links are
        assert one.solver == many.solver == ('table' if place.maps else 'march')


@examples(50)
@given(st.floats(0, 380))
def test_behind_a_head_on_one_spiral_blocks_are_where_the_march_is(travel_m):
    track, links = track_of(Spiral()), np.array([2.86, 2.0] + [1.65] * 40 + [1.2] + [0.8] * 40)
    place, head = placement(track, links, BEHIND), track.place_at(travel_m)
    one, other = place.place(head), marched(track, links, head, BEHIND)
    assert [len(shift.tiles) for shift in place.maps.values()] == [1, 1]
    np.testing.assert_allclose(one.p, other.p, rtol=0, atol=1e-12)
    np.testing.assert_allclose(one.velocities(1.0), other.velocities(1.0), rtol=0, atol=1e-12)


@pytest.mark.parametrize('speed', [1.0, -1.0])
def test_a_scene_of_mixed_benches_has_a_shift_map_for_each_long_block(speed):
    mix = Mixed((Group(3.41), Group(2.55), Group(2.2, 30), Group(1.75, 28)))
    scene = Scene(dragon=mix, head=Head(speed), run=Run(0, 400))
    assert [(run.start, run.stop, bool(run.shift)) for run in compile_scene(scene).model.placement.runs] == [
        (0, 2, False), (2, 32, True), (32, 60, True)]
    for t_s in (0.0, 200.0, 400.0):
        assert agree(scene, t_s) == 'table'


def test_close_to_the_centre_a_mix_without_a_table_is_marched():
    track, links = track_of(Spiral()), np.array([0.5] + [1.65] * 40)
    place, head = placement(track, links, BEHIND), Place(0, 13.0)
    chain, other = place.place(head), marched(track, links, head, BEHIND)
    assert chain.solver == 'march'
    np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=3e-13)
    np.testing.assert_allclose(chain.velocities(1.0), other.velocities(1.0), rtol=0, atol=1e-12)
    assert place.place(Place(0, 2000.0)).solver == 'table'


def test_a_mix_that_locks_names_its_link():
    track, links = track_of(Spiral()), np.array([1.0] + [5.0] * 20)
    place = placement(track, links, BEHIND)
    with pytest.raises(ChainLockError, match='link 1 of 5 m'):
        place.place(Place(0, 8.0))
    with pytest.raises(ChainLockError, match='link 1 of 5 m'):
        place.place_many((np.zeros(1, dtype=int), np.array([8.0])))


def test_beyond_its_run_a_dance_is_served_by_tiles_as_within_it():
    short = replace(TURNING, run=Run(0, 50))
    for t_s in (50.0, 90.0):
        assert state(short, t_s).solver == 'table'
        assert state(short, t_s).p.tobytes() == state(TURNING, t_s).p.tobytes()
    assert states(short, [50.0, 90.0]).solver == 'table'
    np.testing.assert_allclose(states(short, [50.0, 90.0]).p[1], state(short, 90.0).p, rtol=0, atol=1e-13)


def test_where_a_track_begins_the_last_links_are_marched_and_said_to_be():
    scene = Scene(dragon=SHORT, track=Composite((SpiralArc(1.0, 2.0, 8.0), Line(5.0)), start_m=60.0), head=Head(-1.0))
    seen = {agree(scene, t_s) for t_s in np.linspace(0.0, compile_scene(scene).end.t_s, 30).tolist()}
    assert seen == {'table', 'table+march'}


def test_links_that_have_no_length_or_are_too_many_have_no_table():
    track, stretch = track_of(STurn()), Stretch(-50.0, 50.0, 20, BEHIND)
    span = span_of(track, 1.65, stretch)
    assert span
    assert build(span, 0)
    assert span_of(track, 1e-4, stretch) is None


@pytest.mark.parametrize('run', [Run(0, 1e6), Run()], ids=['long', 'without end'])
def test_a_run_however_long_has_the_tiles_where_its_leader_is(run):
    scene = Scene(track=STurn(), run=run)
    for t_s in (3.0, 9e5):
        assert state(scene, t_s).solver == 'table'
    shift, = compile_scene(scene).model.placement.maps.values()
    assert len(shift.tiles) == 2


def test_a_dragon_of_few_benches_has_no_shift_map_on_a_turn_either():
    assert compile_scene(Scene(dragon=Dragon(7), track=STurn(), run=Run(0, 9))).model.placement.maps == {}


def test_if_links_have_five_lengths_those_of_the_four_longest_blocks_get_a_shift_map():
    blocks = [(1.5, 12), (1.1, 11), (1.9, 10), (1.5, 9), (1.0, 9), (1.3, 8)]
    assert lengths_with_maps(np.repeat(*zip(*blocks, strict=True))) == {1.5: 12, 1.1: 11, 1.9: 10, 1.0: 9}


def test_a_tile_of_a_track_is_bounded_and_shows_what_it_takes():
    model = compile_scene(TURNING).model
    link_m, = lengths_with_maps(model.links_m)
    shift = ShiftMap(model.track, link_m, 222, BEHIND)
    shift.spot(model.track.place_at(-10.0))
    table, = (one.table for one in shift.tiles)
    assert table.memory_bytes < 1_300_000
    assert table.nodes <= 20
    assert table.parts == 4
    assert 128 + 222 < table.rows < 128 + 222 + 20


def test_far_more_handles_than_one_product_takes_join_without_a_seam():
    long = Scene(dragon=Dragon(2000), track=STurn(), run=Run(0, 60))
    np.testing.assert_allclose(state(long, 40.0).p, state(march(long), 40.0).p, rtol=0,
                               atol=compile_scene(long).promise_m)


def test_behind_a_tail_more_handles_than_one_product_takes_join_without_a_seam_too():
    mix = Mixed((Group(2.2, 1000), Group(3.41)))
    long = Scene(mix, STurn(before_m=50.0), Head(1.0, 'tail'), Run(0, 20))
    chain, other = state(long, 10.0), state(march(long), 10.0)
    assert [(part.start, part.links) for part in chain.parts] == [(0, 1), (1, 1000)]
    np.testing.assert_allclose(chain.p, other.p, rtol=0, atol=1e-11)


def test_instants_of_two_tiles_in_any_order_are_where_each_alone_is():
    times = [60.0, 320.0, 61.0, 321.0, 62.0]
    scene = replace(TURNING, run=Run(0, 330))
    many = states(scene, times)
    assert many.solver == 'table'
    assert len(many.parts[-1].spots) == 2
    np.testing.assert_allclose(many.p, [state(scene, t_s).p for t_s in times], rtol=0, atol=1e-13)


def test_what_runs_return_is_closed_for_writing():
    for chain in (state(TURNING, 1.0), states(TURNING, [1.0])):
        for array in (chain.p, chain.velocities(1.0), chain.headings):
            with pytest.raises(ValueError, match='read-only'):
                array[0] = 0


def test_no_states_of_a_dance_are_a_chain_of_no_states():
    assert states(TURNING, []).p.shape == (0, 224, 2)
    assert states(TURNING, []).velocities(1.0).shape == (0, 224, 2)


def test_a_dance_at_rest_has_directions():
    chain = state(replace(TURNING, head=Head(0.0)), 1.0)
    assert np.all(chain.velocities(0.0) == 0)
    np.testing.assert_allclose(np.hypot(*chain.headings.T), 1.0, rtol=1e-14)
    assert np.max(np.abs(chain.headings)) < inf


@pytest.mark.parametrize('track', [Spiral(), STurn(before_m=100.0)])
def test_what_tables_serve_whole_takes_no_evaluation(track):
    scene, times = Scene(Dragon(60, 2.2, 2.2), track), [50.0, 60.0, 70.0]
    states(scene, times)        # this call builds the tables
    assert states(scene, times).evaluations == 0
    assert state(scene, 60.0).evaluations == 0
    assert states(replace(scene, solver='march'), times).evaluations >= 3 * 60
