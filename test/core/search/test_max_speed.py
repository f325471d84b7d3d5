"""The largest speed of any handle, and the resulting limit on the leader's speed, for every track, law and leader."""
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import inf, nextafter

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import FACTORS, TRACKS, examples, magnified, thinned

from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import DragonError, FieldError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.max_speed import max_speed
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn
from hard_cases.truth import design_figures

FIGURES = design_figures()
TURNING = Scene(track=STurn(before_m=100.0), run=Run(0, 200))


def test_the_head_may_go_1_2462663582_m_s_under_a_cap_of_2():
    assert FIGURES['max_speed_m_s'].startswith('1.246266358')
    found = max_speed(TURNING)
    assert 2 / found.ratio == pytest.approx(float(FIGURES['max_speed_m_s']), abs=1e-12)
    assert 2 / found.bound == pytest.approx(2 / found.ratio, abs=1e-11)
    assert found.bound >= float(FIGURES['max_speed_ratio'])
    assert (found.handle, round(found.along_m, 5)) == (3, 14.47997)
    assert found.along_m - STurn().length_m == pytest.approx(0.859, abs=5e-4)


@pytest.mark.parametrize('track', thinned(
    [STurn(ratio=1.0), STurn(ratio=0.6), STurn(pitch_m=1.2, ratio=2.1), Composite((
        Line(5.0), Arc(2.0, 170.0), Line(1.0), Arc(1.5, -100.0), Line(60.0)))],
    lambda track: track in (STurn(ratio=0.6), STurn(pitch_m=1.2, ratio=2.1))))
def test_no_look_at_any_time_finds_a_faster_handle_than_the_bound(track):
    scene = Scene(track=track, run=Run(0, 55))
    found = max_speed(scene)
    times = np.random.default_rng(1).uniform(0, 55, 400).tolist()
    v = velocity_of(scene, states(scene, times), times)
    assert np.max(np.hypot(v[..., 0], v[..., 1])) <= found.bound * (1 + 1e-12)
    assert found.bound / found.ratio - 1 < 4 * compile_scene(scene).promise_m


def test_on_a_spiral_no_handle_is_faster_than_the_one_before_it():
    v = velocity_of(TURNING, states(TURNING, [20.0, 99.0]), [20.0, 99.0])
    assert np.all(np.diff(np.hypot(v[..., 0], v[..., 1]), axis=-1) < 0)


def test_led_by_the_tail_the_fastest_handle_is_numbered_from_the_head():
    scene = Scene(dragon=Dragon(60), track=replace(TURNING.track, before_m=-30.0), head=Head(1.0, 'tail'),
                  run=Run(0, 10))
    found = max_speed(scene)
    v = velocity_of(scene, states(scene, [found.travel_m]), [found.travel_m])[0]
    assert np.argmax(np.hypot(v[:, 0], v[:, 1])) == pytest.approx(found.handle, abs=1)


def test_a_single_spiral_has_no_largest_speed():
    with pytest.raises(FieldError, match='speeds near a lock are unbounded'):
        max_speed(Scene())


def fastest_seen(scene, count):
    """Return the largest speed of any handle, and that of the leader, at many times during a run."""
    start_s, end_s = scene.run.start_s, compile_scene(scene).end.t_s
    times = np.unique([start_s, end_s, *np.random.default_rng(4).uniform(start_s, end_s, count),
                       *(t for t in scene.head.breaks_s if start_s <= t <= end_s)]).tolist()
    v = velocity_of(scene, states(scene, times), times)
    return np.max(np.hypot(v[..., 0], v[..., 1])), max(abs(scene.head.speed_at_m_s(t)) for t in times)


def check(scene, found, count=200):
    """Compare an answer with many states: no handle is faster, and the named handle has that speed then."""
    seen, leader = fastest_seen(scene, count)
    top = _top(scene) or 1.0
    assert seen <= found.bound * top * (1 + 1e-9)       # batched states are accurate but not bit-identical
    assert leader <= top * (1 + 1e-15)
    assert found.ratio <= found.bound
    t_s = _when(scene, found.travel_m)
    chain = compile_scene(scene).model.march(scene.head.travelled_m(t_s))
    speed = np.hypot(*chain.velocities(1.0)[found.handle])
    assert found.ratio <= speed * (1 + 1e-6 * speed**2)     # the leader's position error is 1e-14 of the run's length


def _top(scene):
    """Return the leader's largest speed in a run, including its end and both sides of each break of the law."""
    if isinstance(scene.head, Head):
        return abs(scene.head.speed_m_s)
    end_s = compile_scene(scene).end.t_s
    ends = [scene.run.start_s, *(t for t in scene.head.breaks_s if scene.run.start_s < t < end_s), end_s]
    return max(abs(scene.head.speed_at_m_s(t)) for low, high in pairwise(ends)
               for t in (low, nextafter(high, low), high))


def _when(scene, travel_m):
    """Return a time of the run at which the leader has travelled the given distance."""
    times = np.linspace(scene.run.start_s, compile_scene(scene).end.t_s, 401)
    gone = np.array([scene.head.travelled_m(t) for t in times.tolist()])
    n = int(np.argmin(np.abs(gone - travel_m)))
    low, high = times[max(n - 1, 0)], times[min(n + 1, 400)]
    for _ in range(30):
        middle = np.linspace(low, high, 9)
        off = np.abs([scene.head.travelled_m(t) - travel_m for t in middle.tolist()])
        n = int(np.argmin(off))
        low, high = middle[max(n - 1, 0)], middle[min(n + 1, 8)]
    return float(middle[n])


MIXED = Mixed((Group(0.9, 5), Group(2.2, 3), Group(1.3, 4), Group(3.0), Group(0.6), Group(2.2, 3)))
LAW = Profile(((0.0, 0.2), (6.0, 1.5), (20.0, 1.5), (24.0, -0.7), (30.0, -0.7), (30.0, 1.1), (40.0, 0.9)), 'smooth')
SCENES = {
    'inwards, far from the lock': Scene(run=Run(0, 300)),
    'inwards, next to the lock': Scene(Dragon(20), run=Run(400, 432.917)),
    'inwards, mixed, next to the lock of a long link': Scene(Mixed((Group(1.1, 3), Group(3.9), Group(1.6, 6)), 0.02),
                                                             run=Run(400, 430.609)),
    'inwards to the centre': Scene(Dragon(4, 0.8, 0.8), Spiral(1.0, 3.0)),
    'out': Scene(Dragon(40), head=Head(-1.5), run=Run(0, 60)),
    'in and out with a profile': Scene(Dragon(40), Spiral(0.55, 5.3), LAW, Run(0, 45)),
    'unwinding behind the tail': Scene(Dragon(40), Spiral(0.55, 4.0), Head(1.0, 'tail'), Run(0, 30)),
    'unwinding with a profile': Scene(MIXED, Spiral(0.55, 4.0), replace(LAW, lead='tail', ramps='linear'), Run(0, 45)),
    'turning with a profile': Scene(Dragon(40), STurn(before_m=10.0), LAW, Run(0, 45)),
    'turning with a linear profile': Scene(MIXED, STurn(before_m=10.0), replace(LAW, ramps='linear'), Run(3, 45)),
    'back through the turn': Scene(MIXED, STurn(before_m=-25.0), replace(LAW, lead='tail'), Run(0, 45)),
    'a profile on lines and arcs': Scene(Dragon(40), Composite((Line(5.0), Arc(2.0, 170.0), Line(1.0), Arc(1.5, -100.0),
                                                                Line(60.0))), LAW, Run(0, 45)),
}


@cache
def answer(name):
    return max_speed(SCENES[name])


@pytest.mark.parametrize('name', thinned(SCENES, lambda name: [*SCENES].index(name) % 2 == 0))
def test_no_handle_is_faster_on_any_track_under_any_law_behind_head_or_tail(name):
    found = answer(name)
    check(SCENES[name], found, 400)
    rounding = compile_scene(SCENES[name]).speed_promise(found.ratio, 1 + found.ratio)
    assert found.bound - found.ratio < rounding + 1e-11     # cuts end at relative excesses of picometres


def test_far_from_the_lock_and_on_the_way_out_the_head_is_the_fastest():
    for name in ('inwards, far from the lock', 'out'):
        found = answer(name)
        assert (found.ratio, found.handle) == (1.0, 0)
    assert answer('inwards, next to the lock').ratio > 10
    assert answer('inwards, mixed, next to the lock of a long link').handle == 4


def test_a_tail_that_leads_out_of_a_spiral_is_slower_than_its_head_and_most_at_the_start():
    found = answer('unwinding behind the tail')
    assert (found.handle, found.travel_m) == (0, 0.0)
    assert found.ratio > 1


@pytest.mark.parametrize('name', thinned(
    ['turning with a profile', 'turning with a linear profile', 'back through the turn'],
    lambda name: name == 'back through the turn'))
def test_a_profile_is_scaled_as_a_whole_until_a_handle_reaches_the_limit(name):
    scene, limit, found = SCENES[name], 2.0, answer(name)
    factor = limit / found.ratio / _top(scene)
    law = replace(scene.head, knots=tuple((t / factor, v * factor) for t, v in scene.head.knots))
    scaled = replace(scene, head=law, run=Run(scene.run.start_s / factor, scene.run.stop_s / factor))
    again = max_speed(scaled)
    assert again.ratio == pytest.approx(found.ratio, rel=1e-11)
    assert again.ratio * _top(scaled) == pytest.approx(limit, rel=1e-11)
    assert fastest_seen(scaled, 300)[0] <= limit * (1 + 1e-9)


def test_a_law_that_slows_down_where_handles_are_fast_may_be_scaled_further():
    slow = Profile(((0.0, 1.0), (9.0, 1.0), (10.0, 0.25), (80.0, 0.25)))
    scene = Scene(Dragon(30), STurn(before_m=10.0), slow, Run(0, 80))
    found, steady = max_speed(scene), max_speed(replace(scene, head=Head(), run=Run(0, 30)))
    assert found.ratio == 1.0       # the head is the fastest, before the turn
    assert steady.ratio > 1.6


def test_at_a_jump_the_speeds_on_both_sides_count():
    up, down = (Profile(((0.0, a), (12.0, a), (12.0, b), (14.0, b), (14.0, 0.5))) for a, b in ((1.0, 2.0), (2.0, 1.0)))
    for law in (up, down):
        scene = Scene(Dragon(10), STurn(before_m=5.0), law, Run(0, 16))
        check(scene, max_speed(scene))


@pytest.mark.parametrize('law', [Head(0.0), Profile(((0.0, 0.0),))])
def test_of_a_leader_that_rests_the_ratio_is_that_of_its_place(law):
    scene = Scene(Dragon(10), STurn(before_m=-3.0), law, Run(0, 5))
    v = compile_scene(scene).model.place(0.0).velocities(1.0)
    assert max_speed(scene).ratio == pytest.approx(np.max(np.hypot(*v.T)), rel=1e-12)


def test_a_run_that_starts_late_is_asked_from_there():
    late = max_speed(Scene(Dragon(30), STurn(before_m=10.0), run=Run(35.0, 60.0)))
    assert late.travel_m >= 35.0
    assert late.ratio < max_speed(Scene(Dragon(30), STurn(before_m=10.0), run=Run(0.0, 60.0))).ratio


def test_a_run_that_reaches_a_lock_is_refused_and_one_that_stops_there_has_a_finite_bound():
    for dragon in (Dragon(5), Mixed((Group(1.1, 3), Group(3.9), Group(1.6, 6)), 0.02)):
        scene = Scene(dragon, Spiral(0.55, 5.0))
        with pytest.raises(FieldError, match=r'run\.stop_s.* reaches a lock at .* unbounded.*stop earlier'):
            max_speed(scene)
        found = max_speed(replace(scene, run=Run(0, compile_scene(scene).end.t_s)))
        assert 100 < found.ratio <= found.bound < 1.1 * found.ratio


def test_a_long_way_on_which_nothing_is_fast_leaves_the_largest_speed_exact():
    pieces = Arc(3.0, 90.0), Arc(3.0, -90.0), Line(40.0)
    short, long = (max_speed(Scene(Dragon(5), Composite((Line(before_m), *pieces)), Head(1.0),
                                   Run(0.0, before_m + 10.0))) for before_m in (20.0, 2000.0))
    assert long.ratio > 1.01
    assert long.ratio == pytest.approx(short.ratio, rel=3e-12)
    assert long.bound < long.ratio * (1 + 1e-9)


@pytest.mark.parametrize(('knots', 'stop_s'), [
    (((0.0, 0.0), (4.0, 0.0), (8.0, 1.0)), 4.5),                        # ends on a ramp
    (((0.0, 0.0), (50.0, 0.0), (50.001, 1.0), (50.0011, 0.0)), 60.0),   # a steep ramp has its largest speed at a knot
    (((0.0, 0.5), (4.0, 0.5), (4.0, 2.0)), 4.0),                        # jumps at the end
    (((0.0, 0.5), (0.0, 2.0), (4.0, 0.5)), 4.0),                        # jumps at the start
    (((0.0, 0.5), (2.0, 2.0), (2.0, 0.5)), 4.0),                        # jumps down
    (((0.0, 0.5), (2.0, 0.5), (2.0, -3.0), (2.5, -3.0), (2.5, 0.0)), 4.0)])
def test_the_leaders_largest_speed_is_that_of_its_law_with_both_sides_of_each_jump(knots, stop_s):
    scene = Scene(Dragon(20), STurn(before_m=-10.0), Profile(knots), Run(0.0, stop_s), solver='march')
    found = max_speed(scene)
    before = [nextafter(t_s, 0.0) for t_s, _ in knots if 0 < t_s <= stop_s]
    times = np.unique([*np.linspace(0.0, stop_s, 2001), *before, *(t_s for t_s, _ in knots if t_s <= stop_s)]).tolist()
    v = velocity_of(scene, states(scene, times), times)
    seen, top = np.max(np.hypot(v[..., 0], v[..., 1])), 0.125 if stop_s == 4.5 else max(abs(v) for _, v in knots)
    assert found.ratio * top == pytest.approx(seen, rel=1e-5)
    assert seen <= found.bound * top
    assert found.bound < found.ratio * (1 + 1e-9)


def test_a_leader_that_all_but_rests_is_asked_once():
    # Cutting an interval in which the leader hardly moves would yield no further information.
    dragon = Mixed((Group(1.3, 2), Group(3.41, 2), Group(1.9, 2)))
    for speed_m_s in (-1e-308, 1e-170, 1e-18):
        found = max_speed(Scene(dragon, STurn(1.98, 10.0, 0.95, -17.0), Profile(((0.0, speed_m_s),)), Run(0.0, 3.0)))
        assert found.looks < 100
        assert found.ratio <= found.bound < found.ratio * (1 + 1e-9)


@pytest.mark.parametrize('lead', ['head', 'tail'])
def test_a_circle_on_which_all_handles_are_as_fast_is_not_cut_without_end(lead):
    found = max_speed(Scene(Dragon(100), Composite((Arc(9.0, 3000.0),)), Head(1.0, lead), Run(0.0, 20.0)))
    assert found.looks < 5000
    assert found.ratio == pytest.approx(1.0, abs=1e-12)
    assert found.ratio <= found.bound < 1 + 1e-9


DRAGONS = st.builds(lambda lengths: Mixed(tuple(Group(0.55 + length, 2) for length in lengths)), st.lists(
    st.one_of(st.sampled_from([0.05, 1.65, 2.86]), st.floats(0.05, 3.0)), min_size=1, max_size=8))
LAWS = st.builds(lambda lead, ramps, speeds: Profile(tuple((4.0 * n, v) for n, v in enumerate(speeds)), ramps, lead),
                 st.sampled_from(['head', 'tail']), st.sampled_from(['linear', 'smooth']),
                 st.lists(st.floats(-1, 3), min_size=1, max_size=4))


@examples(25)
@given(DRAGONS, TRACKS, LAWS, st.floats(0, 6), st.floats(0.1, 8), FACTORS)
@example(Mixed((Group(0.6, 3),)), STurn(), Profile(((0.0, 1.0),)), 0.0, 3.0, 1.0)
def test_no_handle_is_faster_than_the_bound_anywhere(dragon, track, law, start_s, lasts_s, factor):
    try:
        scene = magnified(Scene(dragon, track, law, Run(start_s, start_s + lasts_s), solver='march'), factor)
        assume(compile_scene(scene).end.t_s > start_s and compile_scene(scene).end.reason != 'lock')
    except DragonError:
        assume(False)
    found = max_speed(scene)
    assert found.bound < inf
    check(scene, found, 60)
