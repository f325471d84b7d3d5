"""The checker's own track, chain and law equal the solver's to the last digits and are far more precise."""
from contextlib import nullcontext, suppress
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from flint import arb
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.chain import conditioning
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.chain.lock import head_lock_angle
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.scenes.certificate import of_claim
from dragon_ros.verify import reading, run, segments, track
from dragon_ros.verify.balls import exact
from dragon_ros.verify.cover import Budget
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.law import Law
from dragon_ros.verify.posture import Dragon as Benches
from dragon_ros.verify.posture import Posture
from dragon_ros.verify.run import Leader, Limit, _Locks, run_of
from dragon_ros.verify.segments import Link
from dragon_ros.verify.track import track_of

BENT = Composite((Line(50.0), Arc(3.0, -200.0), Line(1.0), SpiralArc(1.2, 2, 4.0)), start_m=70.0)
SCENES = {
    'classic': Scene(run=Run(0, 400)),
    'near the lock': Scene(dragon=Dragon(6), run=Run(400, 432.9)),
    'far out': Scene(dragon=Dragon(200), track=Spiral(0.55, 700.0), run=Run(0, 20)),
    'turn': Scene(dragon=Dragon(60), track=STurn(before_m=100.0), run=Run(95, 140)),
    'loop': Scene(dragon=Dragon(20), track=Composite((Line(5.0, (1.0, 2.0), 30.0), Arc(3.0, 720.0))), run=Run(0, 30)),
    'tail on a bent track': Scene(dragon=Dragon(10), track=BENT, head=Head(1.0, 'tail'), run=Run(0, 30)),
    'tail on a spiral': Scene(dragon=Dragon(20), track=Spiral(0.55, 6.0), head=Head(1.0, 'tail'), run=Run(0, 30)),
    'out from a spiral': Scene(dragon=Dragon(3),
                               track=Composite((SpiralArc(3.0, 0.6, 3.0, 'left'), Line(9.0)), start_m=9.0),
                               run=Run(0, 3)),
    'the smallest links': Scene(dragon=Mixed((Group(1.0), Group(0.65, 2), Group(1.4, 3)), 0.2, 0.3), run=Run(0, 2),
                                track=Composite((Arc(2.0, -180.0), SpiralArc(1.0, 3.0, 2.0)), 6.0))}


def read(scene):
    """Return a scene as the checker reads it."""
    return reading._claims(of_claim(scene, {'t_s': None})).scene


def chain(scene, t_s):
    """Return the checker's handles (as balls), track and posture at a time."""
    plain = read(scene)
    track, dragon = track_of(plain), Benches(plain)
    leader = Leader(track, dragon, plain.tail_leads, Budget(10**6))
    gone = exact(plain.law.travel_m(Fraction(t_s)))
    posture = Posture(track, dragon, 0, track.place_at(leader.head(gone)))
    return [posture.point(n) for n in range(len(dragon.benches) + 1)], track, posture


@pytest.mark.parametrize('name', SCENES)
def test_handles_lie_where_the_solver_puts_them_and_are_known_to_a_billionth_of_its_promise(name):
    scene = SCENES[name]
    for t_s in np.linspace(scene.run.start_s, compile_scene(scene).end.t_s, 4).tolist():
        points, _, _ = chain(scene, t_s)
        found = np.array([complex(point) for point in points])
        solved = state(replace(scene, solver='march'), t_s)
        promise_m = compile_scene(scene).promise_m
        assert np.max(np.abs(found - solved.p @ [1, 1j])) < promise_m * conditioning(solved)
        assert max(float(part.rad()) for point in points for part in (point.real, point.imag)) < 1e-9 * promise_m


@pytest.mark.parametrize('name', SCENES)
def test_distances_along_the_track_lead_to_places_and_back(name):
    _, line, posture = chain(SCENES[name], SCENES[name].run.start_s)
    for n in range(3):
        place = posture.place(n)
        away = line.distance(line.place_at(line.distance(place).mid())) - line.distance(place)
        assert abs(float(away)) < 1e-20
        assert line.apart_m(place, posture.place(n + 1)) >= float(
            abs(posture.point(n) - posture.point(n + 1)).lower()) * (1 - 1e-15)


@pytest.mark.parametrize('name', SCENES)
def test_places_are_first_computed_in_floats_which_are_right_to_a_billionth(name, monkeypatch):
    asked = []

    def watched(value, slope, guess, certified=segments.certified):
        found = certified(value, slope, guess)
        asked.append((guess, float(found)))
        return found
    for module in (segments, track):
        monkeypatch.setattr(module, 'certified', watched)
    scene = SCENES[name]
    for t_s in np.linspace(scene.run.start_s, compile_scene(scene).end.t_s, 4).tolist():
        _, line, posture = chain(scene, t_s)
        place = posture.place(1)
        with suppress(Refused):     # if the track has no centre, search ahead, towards the leading handle
            line.next(place, Benches(read(scene)).benches[0].link, -1 if line.to_centre else 1)
    assert name == 'loop' or asked
    for guess, found in asked:
        assert guess == pytest.approx(found, rel=1e-9, abs=1e-9)


@given(st.floats(0, 1e6))
def test_the_angle_of_an_arc_is_found_from_its_length(theta):
    assert segments._about_after(segments._about_arc(theta)) == pytest.approx(theta, rel=1e-12, abs=1e-300)


@pytest.mark.parametrize(('beyond_m', 'fits'), [(0.9e-12, True), (1.9e-12, False), (1e-6, False), (0.5, False)])
def test_a_handle_is_on_the_track_up_to_a_millionth_of_a_micrometre_beyond_its_end(beyond_m, fits):
    line, link = track_of(read(Scene(Dragon(1), Composite((Line(8.0),)), run=Run(0, 1)))), Link(arb(2), 2.0)
    here = line.place_at(line.end - 2 + exact(Fraction(beyond_m)))
    with nullcontext() if fits else pytest.raises(Refused):
        assert float(abs(line.distance(line.next(here, link, 1)) - line.end)) <= 1e-12


@pytest.mark.parametrize(('way', 'metres'), [(1, 3.75), (-1, 5.25)])
@pytest.mark.parametrize(('link_m', 'on_it'), [(0.75, True), (1.2, True), (1.5, False), (0.2, False)])
def test_a_handle_is_cut_from_a_segment_only_if_it_lies_on_it(way, metres, link_m, on_it):
    scene, link = Scene(Dragon(1), Composite((Line(4.0), Line(1.0), Line(4.0)))), Link(arb(link_m), link_m)
    line = track_of(read(scene))
    here = line.point(line.place_at(arb(metres)))
    with nullcontext() if on_it else pytest.raises(Refused):
        found = line._cut(1, here, link, way, arb(0.25))
        assert abs(float(line.distance(found)) - metres) == pytest.approx(link_m, abs=1e-12)


def test_the_start_is_32_pi_and_not_its_float():
    line = track_of(read(Scene()))
    start = line.place_at(line.start).u
    assert abs(start - 32 * arb.pi()) < 1e-26
    assert abs(start - arb(32 * np.pi)) > 1e-15


def test_joints_meet_as_they_head():
    for scene in SCENES.values():
        line = track_of(read(scene))
        for before, after in zip(line.segments, line.segments[1:], strict=False):
            assert abs(before.point(before.last) - after.point(after.first)) < 1e-30
            assert abs(before.heading(before.last) - after.heading(after.first)) < 1e-30


rows = st.lists(st.tuples(st.floats(0, 5), st.floats(-2, 2)), min_size=1, max_size=5)


@examples(40)
@given(rows, st.sampled_from(['linear', 'smooth']), st.floats(0, 10), st.floats(0, 10))
@example([(1.0, -1.0), (0.0, 1.0)], 'linear', 0.0, 5.0)
def test_the_law_goes_as_far_as_the_solvers_does_and_its_extent_holds_every_place(rows, ramps, start_s, run_s):
    times = np.cumsum([0.0, *(gap for gap, _ in rows)]).tolist()
    knots = tuple(zip(times, [0.5, *(speed for _, speed in rows)], strict=True))
    solver, law = Profile(knots, ramps), Law(tuple((Fraction(t), Fraction(v)) for t, v in knots), ramps == 'smooth')
    low, high = law.extent_m(Fraction(start_s), Fraction(start_s + run_s))
    for t_s in np.linspace(start_s, start_s + run_s, 12).tolist():
        assert abs(law.travel_m(Fraction(t_s)) - Fraction(solver.travelled_m(t_s))) < 1e-13
        assert low <= law.travel_m(Fraction(t_s)) <= high
        assert abs(law.speed_m_s(Fraction(t_s)) - Fraction(solver.speed_at_m_s(t_s))) < 1e-12
    ends = [solver.travelled_m(t) for t in (start_s, start_s + run_s, *solver.breaks_s)
            if start_s <= t <= start_s + run_s]
    assert float(low) == pytest.approx(min(ends), abs=1e-12)
    assert float(high) == pytest.approx(max(ends), abs=1e-12)


def test_a_smooth_ramp_comes_to_rest_between_bounds_that_are_rounded_outwards():
    law = Law(((Fraction(0), Fraction(1)), (Fraction(3), Fraction(-2))), smooth=True)
    low, high = law.extent_m(Fraction(0), Fraction(3))
    rest_s = law.marks[1].t_s
    assert all(law.travel_m(rest_s + Fraction(n, 10**9)) < high for n in (-1, 0, 1))
    assert high - law.travel_m(rest_s) < Fraction(1, 2**90)
    assert low < law.travel_m(Fraction(3))


@examples(60)
@given(st.lists(st.tuples(st.sampled_from([0, 1, 2]), st.sampled_from([-1, 0, 0, 2])), min_size=1, max_size=6),
       st.booleans())
@example([(1, 0), (1, 0), (1, 0), (1, 1)], False)
def test_the_legs_of_a_law_say_which_way_the_leader_goes_at_any_time(rows, smooth):
    times = np.cumsum([0, *(gap for gap, _ in rows)]).tolist()
    law = Law(tuple((Fraction(t), Fraction(v)) for t, v in zip(times, [1, *(v for _, v in rows)], strict=True)), smooth)
    assert law.legs[0].since_s == 0
    assert law.legs[-1].until_s is None
    assert all(a.until_s == b.since_s and a.sense != b.sense for a, b in pairwise(law.legs))
    for leg in law.legs:
        until_s = leg.since_s + 2 if leg.until_s is None else leg.until_s
        gone = [law.travel_m(leg.since_s + (until_s - leg.since_s) * k / 9) for k in range(10)]
        assert all((b > a) - (b < a) == leg.sense for a, b in pairwise(gone))
        assert leg in law.legs_at(leg.since_s, Fraction(0))
        assert law.legs_at((leg.since_s + until_s) / 2, Fraction(0)) == [leg]
        assert leg in law.legs_at(leg.since_s - Fraction(1, 8), Fraction(1, 8))
        assert leg in law.legs_at(until_s + Fraction(1, 8), Fraction(1, 8))


@pytest.mark.parametrize('speed', [1, -1])
@pytest.mark.parametrize('stop_s', [20.0, None])
def test_a_run_that_a_limit_ends_goes_up_to_the_limit_but_for_its_slack(speed, stop_s):
    back, on = Limit(arb(-5), 0.5, 'back'), Limit(arb(7), 0.5, 'on')
    leader, scene = SimpleNamespace(limits=lambda *_: (back, on)), SimpleNamespace(start_s=2.0, stop_s=stop_s)
    found = run_of(Law(((Fraction(0), Fraction(speed)),), False), leader, scene, None, 0.5)
    assert (found.why, found.end_s) == (('on', 7.0) if speed > 0 else ('back', 5.0))
    ends = [[0.0, 6.5], [2.0, 6.5]] if speed > 0 else [[-4.5, 0.0], [-4.5, -2.0]]
    assert [[*map(float, each)] for each in (found.whole, found.part)] == [pytest.approx(each) for each in ends]


@pytest.mark.parametrize('chords', [[4.0, 20.0], [30.0, 12.0], [3.0, 3.0, 25.0]])
def test_a_lock_is_seen_in_floats_where_the_solver_has_it_whether_or_not_links_of_no_length_are_in_between(chords):
    lock, _ = head_lock_angle(chords)
    for every in (chords, [value for chord in chords for value in (chord, 0.0)], [0.0, *chords]):
        longest = [max(every[n:]) for n in range(len(every))]
        assert _Locks(every, longest, Budget(10**6)).first(lock + 1, lock - 1) == pytest.approx(lock, rel=1e-9)


@pytest.mark.parametrize('links', [1, 100, 101, 250])
def test_links_that_are_placed_in_floats_count_as_steps_of_the_budget(links):
    budget = Budget(10**6)
    assert _Locks([0.3] * links, [1e9] * links, budget)._stands(50.0)
    assert budget.spent == -(-links // run._SHARE)
