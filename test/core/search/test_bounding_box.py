"""For any track and law, the upper and lower bounds of a run's bounding box agree, and no corner leaves the box."""
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import FACTORS, TRACKS, examples, magnified, thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import DragonError
from dragon_ros.core.geometry.rectangles import axes_of, benches_of, corner_levers
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.bounding_box import SIDES, BoundingBox, HandleRanges, Reach, SweptBench, bounding_box, fits
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn

SCENES = [Scene(), Scene(dragon=Dragon(benches=1)), Scene(dragon=Dragon(benches=3), run=Run(start_s=400.0)),
          Scene(track=Spiral(0.45, 20.0), run=Run(stop_s=60.0)),
          Scene(head=Head(-2.0), run=Run(stop_s=70.0)), Scene(head=Head(0.0), run=Run(stop_s=1.0)),
          Scene(run=Run(start_s=5.0, stop_s=5.0)),
          Scene(track=STurn(before_m=60.0), run=Run(stop_s=150.0)),
          Scene(head=Head(1.5, 'tail'), track=Spiral(0.55, 5.0), run=Run(stop_s=90.0)),
          Scene(Mixed((Group(1.1, 3), Group(3.9), Group(1.6, 6)), 0.02), run=Run(420.0, 430.605)),
          Scene(Mixed((Group(0.8), Group(3.9), Group(0.7, 2), Group(4.5), Group(1.6, 6)), 0.02), Spiral(1.2, 4.0),
                run=Run(stop_s=55.81)),
          Scene(Mixed((Group(0.8, 2), Group(3.0), Group(1.2, 4))), STurn(before_m=-15.0),
                Profile(((0.0, 0.0), (9.0, 2.0), (20.0, -0.5)), 'smooth', 'tail'), Run(stop_s=25.0))]


def corners(scene, times):
    chain = states(scene, times)
    return benches_of(chain, scene.dragon, axes_of(chain)).corners


def values(points):
    """Return the coordinates of points in the direction of each of the four sides."""
    return dict(zip(SIDES, (points[..., 0], -points[..., 0], points[..., 1], -points[..., 1]), strict=True))


def check_that_none_is_outside(scene, found, count):
    last_s = compile_scene(scene).end.t_s - (1e-9 if compile_scene(scene).end.reason == 'lock' else 0.0)
    times = np.random.default_rng(2).uniform(scene.run.start_s, last_s, count).tolist()
    seen = values(corners(scene, [scene.run.start_s, *times, last_s]))
    for reach in found.reaches:
        assert np.max(seen[reach.side]) <= reach.high_m


def check_that_it_is_met(scene, found):
    for reach in found.reaches:
        assert scene.run.start_s <= reach.t_s <= compile_scene(scene).end.t_s
        chain = state(replace(scene, solver='march'), reach.t_s)
        there = benches_of(chain, scene.dragon, axes_of(chain)).corners[reach.bench]
        assert np.min(np.hypot(*(there - reach.point_m).T)) < 1e-11
        assert values(np.array(reach.point_m))[reach.side] == reach.low_m


@pytest.mark.parametrize('n', thinned(range(len(SCENES)), lambda n: n % 3 == 0))
def test_no_corner_is_outside_at_any_of_many_times_and_the_bounds_meet(n):
    scene = SCENES[n]
    found = bounding_box(scene)
    check_that_none_is_outside(scene, found, 300)
    check_that_it_is_met(scene, found)
    assert all(0 <= reach.high_m - reach.low_m <= 1.1e-10 for reach in found.reaches)


DRAGONS = st.builds(
    lambda benches, head, body, inset, width: Dragon(benches, 2 * inset + head, 2 * inset + body, width, inset),
    st.integers(1, 30), st.sampled_from([0.05, 0.3, 1.65, 2.86]), st.sampled_from([0.05, 0.4, 1.65, 3.0]),
    st.sampled_from([0.01, 0.275]), st.sampled_from([0.01, 0.3, 1.0]))
LAWS = st.builds(lambda lead, speeds: Profile(tuple((7.0 * n, v) for n, v in enumerate(speeds)), 'smooth', lead),
                 st.sampled_from(['head', 'tail']), st.lists(st.floats(-1, 3), min_size=1, max_size=4))


@examples(20)
@given(DRAGONS, TRACKS, LAWS, st.floats(0, 12), st.floats(0, 12), FACTORS)
@example(Dragon(3), Spiral(0.55, 16.0), Profile(((0.0, 1.0),)), 425.0, 7.9, 1.0)
@example(Dragon(2, 0.07, 3.02, 0.01, 0.01), Spiral(2.5, 1.0), Profile(((0.0, 2.0),)), 0.0, 4.0, 1.0)
@example(Dragon(1, 0.07, 0.07, 0.01, 0.01), STurn(1.0, 11.0, 1.0, 5e-36), Profile(((0.0, 0.0),)), 0.0, 1.0, 1.0)
@example(Dragon(2, 5.0, 0.6), Spiral(3.0, 1.0), Profile(((0.0, -1.0),)), 0.0, 5.0, 1.0)
def test_no_corner_is_outside_on_any_track_under_any_law(dragon, track, law, start_s, lasts_s, factor):
    try:
        scene = magnified(Scene(dragon, track, law, Run(start_s, start_s + lasts_s)), factor)
        assume(compile_scene(scene).end.t_s > start_s)
    except DragonError:
        assume(False)
    found = bounding_box(scene)
    check_that_none_is_outside(scene, found, 40)
    check_that_it_is_met(scene, found)
    rounding_m = float(np.max(corner_levers(scene.dragon))) * compile_scene(scene).promise_m
    reason = compile_scene(scene).end.reason
    assert reason == 'lock' or all(reach.high_m - reach.low_m <= 1.001e-10 + rounding_m for reach in found.reaches)


MIXED = st.builds(lambda lengths, width: Mixed(tuple(Group(0.55 + length) for length in lengths), width), st.lists(
    st.one_of(st.sampled_from([0.05, 1.65]), st.floats(0.1, 4.0)), min_size=2, max_size=9),
                  st.sampled_from([0.01, 0.3]))


@examples(12)
@given(MIXED, st.floats(0.3, 2.5), st.floats(1.0, 4.0), st.floats(0.2, 1.0))
@example(Mixed((Group(1.1), Group(1.1), Group(1.1), Group(3.9), Group(1.6), Group(1.6))), 0.55, 5.0, 0.9999)
def test_no_corner_of_mixed_benches_is_outside_wherever_handles_turn_back_near_the_centre(dragon, pitch, turns, part):
    track = Spiral(pitch, turns)
    try:
        last_s = compile_scene(Scene(dragon, track)).end.t_s
    except DragonError:
        assume(False)
    scene = Scene(dragon, track, run=Run(max(0.0, last_s * part - 6.0), last_s * part), solver='march')
    found = bounding_box(scene)
    check_that_none_is_outside(scene, found, 200)
    check_that_it_is_met(scene, found)


def test_the_smallest_square_of_the_classic_run():
    found = bounding_box(Scene())
    assert found.centred_m == pytest.approx((23.9941113215, 23.9941113215), abs=1e-9)
    assert found.free_m == pytest.approx((23.7196204917, 23.7196204917), abs=1e-9)
    assert (found.touching.bench, found.touching.corner, found.touching.side) == (222, 'rear left', '-x')


def test_looking_often_comes_close_to_the_answer_from_below():
    scene = SCENES[3]
    seen = max(float(np.max(np.abs(corners(scene, np.arange(k, k + 10, 0.02).tolist())))) for k in range(0, 50, 10))
    assert 0 <= 0.5 * bounding_box(scene).centred_m[0] - seen < 1e-4


BENDY = Composite((Line(50.0), Arc(2.0, 170.0), Line(1.0), Arc(1.5, -100.0), Line(60.0)))


TIGHT = Composite((Line(5.0), Arc(1.45, 170.0), Arc(1.45, -170.0), Line(5.0)))


@pytest.mark.parametrize(('track', 'low_m', 'high_m'), [(track_of(TIGHT), 4.0, 13.0),
                                                        (track_of(Spiral()), 425.0, 431.5)])
@pytest.mark.parametrize('apart_m', thinned([1.0, 0.1, 0.01], (1.0, 0.01).__contains__))
def test_no_corner_is_above_the_bound_where_a_link_is_almost_as_long_as_the_bend_allows(track, low_m, high_m, apart_m):
    for arm_m in (0.15, 3.0):
        bench = SweptBench(track, 2.86, 1.43 + arm_m, arm_m)
        places = np.linspace(low_m, high_m, 100)
        top = bench.bounds(bench.states(places), bench.states(places + apart_m))
        for part in np.linspace(0, 1, 9):
            assert np.all(bench.states(places + part * apart_m).value <= top + 1e-13)


@pytest.mark.parametrize('link_m', thinned([2.86, 1.65], lambda link_m: link_m != 1.65))
@pytest.mark.parametrize('track', [track_of(STurn()), track_of(BENDY), HandleRanges(Scene(run=Run(stop_s=1.0))).track])
def test_no_corner_is_above_the_bound_between_two_states_which_falls_with_the_square_of_their_distance(track, link_m):
    bench = SweptBench(track, link_m, 0.5 * link_m + 0.275, 0.15)
    over = []
    for apart_m in (0.5, 0.05, 0.005):
        places = np.random.default_rng(5).uniform(0, 70, 60)
        low, high = bench.states(places), bench.states(places + apart_m)
        top = bench.bounds(low, high)
        seen = [bench.states(places + part * apart_m).value for part in np.linspace(0, 1, 9)]
        assert np.all(np.max(seen, axis=0) <= top + 1e-13)
        over.append(np.mean(top - np.maximum(low.value, high.value)))
    assert over[2] < over[1] / 50 < over[0] / 500


@pytest.mark.parametrize('link_m', thinned([2.86, 1.65], lambda link_m: link_m != 1.65))
@pytest.mark.parametrize('track', [track_of(Composite((Arc(4.0, 360.0),))), track_of(STurn())])
def test_where_a_corner_goes_neither_straight_out_nor_along_half_of_the_bounds_are_within_a_tenth(track, link_m):
    bench, places = SweptBench(track, link_m, 0.5 * link_m + 0.275, 0.15), np.linspace(3, 20, 200)
    low, high = bench.states(places), bench.states(places + 0.01)
    goes = 2 * (bench.bounds(low, high) - 0.5 * (low.value + high.value))
    straight = np.abs(high.value - low.value)
    slanting = (straight > 0.2 * 0.01) & (straight < 0.6 * 0.01)
    assert np.all(goes[slanting] >= straight[slanting])
    assert np.median(goes[slanting] / straight[slanting]) < 1.1


@pytest.mark.parametrize('apart_m', [0.2, 0.01])
@pytest.mark.parametrize('link_m', thinned([2.86, 1.65], lambda link_m: link_m != 1.65))
@pytest.mark.parametrize('track', [track_of(Composite((Arc(4.0, 360.0),))), track_of(STurn()), track_of(Spiral())])
def test_what_coordinates_gain_a_metre_is_enclosed_in_little_more_than_occurs(track, link_m, apart_m):
    bench, places, step = SweptBench(track, link_m, 0.5 * link_m + 0.275, 0.15), np.linspace(3, 20, 150), 1e-5
    slope, most = bench.slopes(bench.states(places), bench.states(places + apart_m))
    at = [places + part * apart_m for part in np.linspace(0, 1, 9)]
    seen = np.array([(bench.states(here + step).value - bench.states(here - step).value) / (2 * step) for here in at])
    smooth = np.all(np.abs(np.diff(seen, axis=0)) < apart_m, axis=0)        # no joint in between
    assert np.mean(smooth) > 0.9
    assert np.all(np.abs(seen - slope.mid) <= slope.rad + 1e-8, where=smooth)
    assert np.all(np.mean(np.abs(seen), axis=0) * apart_m <= most + 1e-9, where=smooth)
    bent = smooth & (np.ptp(seen, axis=0) > 0.1 * apart_m)
    assert np.percentile(2 * (slope.rad / np.ptp(seen, axis=0))[bent], 10) < 1.5


def test_of_a_bench_on_a_line_the_bound_ahead_is_where_its_front_comes_to():
    bench = SweptBench(track_of(Composite((Line(30.0),))), 2.0, 1.0, 1e-9)
    low, high = bench.states(np.array([5.0])), bench.states(np.array([7.5]))
    assert bench.bounds(low, high)[0, :, 0] == pytest.approx(high.value[0, :, 0], abs=1e-8)
    assert bench.slopes(low, high)[1] == pytest.approx(2.5, abs=1e-8)       # no corner moves further than the handles


def test_a_long_way_is_searched_all_the_same():
    found = bounding_box(Scene(head=Head(-100.0), run=Run(stop_s=1000.0)))
    check_that_it_is_met(Scene(head=Head(-100.0), run=Run(stop_s=1000.0)), found)
    assert found.centred_m[1] - found.centred_m[0] < 1e-9


def test_a_dragon_that_goes_round_a_circle_many_times_is_searched_once():
    scene = Scene(Dragon(2000), Composite((Arc(3.0, 180.0),)), run=Run(stop_s=9.0))
    found = bounding_box(scene)
    check_that_none_is_outside(scene, found, 40)
    check_that_it_is_met(scene, found)
    assert found.centred_m[1] - found.centred_m[0] < 1e-9
    assert found.looks < 1000


def test_whether_a_square_is_large_enough_is_told_only_where_the_bounds_tell():
    found = BoundingBox(tuple(Reach(side, low, high, 0, '', 0.0, (0.0, 0.0)) for side, low, high in
                         zip(SIDES, (3.0, 1.0, 2.0, 2.0), (3.1, 1.1, 2.1, 2.0), strict=True)), 1)
    assert found.centred_m == (6.0, 6.2)
    assert found.free_m == (4.0, 4.2)
    assert (fits((4.0, 4.2), 4.2), fits((4.0, 4.2), 4.1), fits((4.0, 4.2), 4.0), fits((4.0, 4.2), 3.9)) == (
        True, None, None, False)
