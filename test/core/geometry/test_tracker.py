from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.tracker import (
    MOST_REPORTED,
    ContactTracker,
    ReorderBuffer,
    _interpolated,
    no_episodes,
)
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick


def observations(scene, ticks):
    for k in ticks:
        frame = tick(scene, k)
        yield Observation(frame.t_ns, frame.chain.p, frame.benches)


def events(scene, ticks, tracker=None):
    tracker = tracker or ContactTracker()
    return [event for one in observations(scene, ticks) for report in tracker.add(one) for event in report.begins]


def test_the_event_brackets_the_contact_and_interpolates_it():
    (event,) = events(Scene(run=Run(410, 413)), range(151))
    assert event.benches == (0, 8)
    assert (event.before_ns, event.after_ns) == (412_460_000_000, 412_480_000_000)
    assert event.t_contact_s == pytest.approx(412.473837682, abs=1e-6)
    assert event.point_m == pytest.approx((1.474394671648, 2.110664876932), abs=1e-8)
    assert event.gap_m == pytest.approx(-1.618e-4, abs=1e-6)
    assert event.approach_m_s == pytest.approx(0.02632, abs=1e-5)


@pytest.mark.parametrize('rate', [5, 20, 50, 200])
def test_interpolation_gets_better_with_the_rate(rate):
    scene = Scene(run=Run(411.9, 413, rate))
    (event,) = events(scene, range(compile_scene(scene).last_tick + 1))
    assert abs(event.t_contact_s - 412.473837682115) < 0.02 / rate**2


def test_a_watch_that_starts_in_contact_has_an_open_bracket():
    (event,) = events(Scene(run=Run(412.6, 413)), range(5))
    assert event.before_ns is None
    assert event.t_contact_s == 412.6
    assert np.isnan(event.approach_m_s)


def test_the_same_tick_again_tells_nothing_new():
    scene, tracker = Scene(run=Run(412.4, 413)), ContactTracker()
    assert len(events(scene, [3, 4, 4, 4, 5, 5], tracker)) == 1


def test_time_going_back_starts_afresh():
    scene, tracker = Scene(run=Run(412, 413)), ContactTracker()
    assert len(events(scene, range(51), tracker)) == 1
    assert len(events(scene, range(51), tracker)) == 1


def test_a_contact_that_lasts_is_one_event():
    assert len(events(Scene(run=Run(412.4, 414)), range(60))) == 1


@pytest.mark.parametrize(('turn', 'mirror'), [(1.0, 1), (-2.5, 1), (0.0, -1), (2.0, -1)])
def test_a_turned_or_mirrored_dragon_has_the_same_contact(turn, mirror):
    move = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ np.diag([1, mirror])
    scene, tracker = Scene(run=Run(412.3, 412.6)), ContactTracker()
    (plain,) = events(scene, range(16))
    moved = []
    for one in observations(scene, range(16)):
        b = one.benches
        benches = Benches(b.centre @ move.T, b.axis @ move.T, b.half_length, b.half_width)
        moved += [e for r in tracker.add(Observation(one.t_ns, one.p @ move.T, benches)) for e in r.begins]
    (event,) = moved
    assert event.benches == plain.benches
    assert event.t_contact_s == pytest.approx(plain.t_contact_s, abs=1e-9)
    assert event.point_m == pytest.approx(tuple(move @ plain.point_m), abs=1e-9)


def test_another_number_of_benches_starts_afresh():
    from dragon_ros.core.chain.dragon import Dragon
    tracker = ContactTracker()
    assert len(events(Scene(run=Run(412.4, 413)), range(10), tracker)) == 1
    assert len(events(Scene(dragon=Dragon(50), run=Run(412.7, 413)), range(3), tracker)) == 1
    assert np.isfinite(tracker._seen[-1].p).all()


def reports(scene, ticks, tracker=None):
    tracker = tracker or ContactTracker()
    return [report for observation in observations(scene, ticks) for report in tracker.add(observation)]


def told(rows):
    """Return the beginnings as (time, pair) and the ends as (cause, pair), in order."""
    return [line for r in rows for line in [*((e.cause, e.benches) for e in r.ends),
                                            *(('begin', e.benches) for e in r.begins)]]


def crossed(t_ns, gap_m, benches=4):
    """Return bench 0 and the last bench ``gap_m`` apart, with all others far away and handles that do not wind."""
    centre = np.array([(50.0 * n, 0.0) for n in range(benches - 1)] + [(0.0, 1 + gap_m)])
    half = np.full(benches, 0.5)
    axis = np.tile([1.0, 0.0], (benches, 1))
    p = np.array([(n, (-1.0) ** n) for n in range(benches + 1)])
    return Observation(t_ns, p, Benches(centre, axis, half, half))


def reports_of(rows, tracker=None):
    tracker = tracker or ContactTracker()
    return [report for sec, gap_m in rows for report in tracker.add(crossed(round(sec * 1e9), gap_m))]


SCENE = Scene(run=Run(412, 416))


def test_each_pair_has_its_own_episode_with_begin_deepest_and_end():
    rows = reports(SCENE, range(compile_scene(SCENE).last_tick + 1))
    assert told(rows) == [('begin', (0, 8)), ('parted', (0, 8)), ('begin', (0, 10))]
    (end,) = [end for report in rows for end in report.ends]
    assert end.deepest_gap_m == pytest.approx(-0.017409, abs=1e-5)
    assert end.deepest_gap_m == min(report.clearance_m for report in rows if (0, 8) in report.touching)
    assert end.deepest_ns == 413_760_000_000
    assert 415_000_000_000 < end.t_end_s * 1e9 < end.after_ns == 415_020_000_000


def test_begin_and_end_times_and_the_approach_speed_are_those_of_a_known_motion():
    t = np.arange(0, 4.01, 0.25)
    rows = reports_of(zip(t, 0.1 * (t - 1.1) * (t - 3.3), strict=True))
    (begin,) = [event for report in rows for event in report.begins]
    (end,) = [event for report in rows for event in report.ends]
    assert (begin.benches, end.benches) == ((0, 3), (0, 3))
    assert begin.t_contact_s == pytest.approx(1.1, abs=1e-12)
    assert begin.approach_m_s == pytest.approx(0.22, abs=1e-12)
    assert end.t_end_s == pytest.approx(3.3, abs=1e-12)
    assert (end.deepest_ns, end.deepest_gap_m) == (2_250_000_000, pytest.approx(0.1 * 1.15 * -1.05))


def test_a_contact_between_ticks_of_another_is_interpolated_through_all_of_them():
    t = np.array([0.0, 1.0, 2.0, 3.0])
    rows = reports_of(zip(t, -0.1 * (t - 0.7) * (t - 1.4) * (t - 2.6), strict=True))        # a cubic through four ticks
    assert [event.t_contact_s for report in rows for event in report.begins][-1] == pytest.approx(2.6, abs=1e-12)


def test_ticks_are_interpolated_together_if_no_step_is_four_times_its_neighbour():
    t = np.array([0.0, 3.0, 4.0, 5.0])
    rows = reports_of(zip(t, -0.1 * (t - 1) * (t - 2) * (t - 4.6), strict=True))
    (begin,) = rows[-1].begins
    assert begin.t_contact_s == pytest.approx(4.6, abs=1e-12)


@pytest.mark.parametrize(('step_s', 'ticks'), [(3.9, 4), (4.0, 4), (4.1, 3)])
def test_ticks_before_a_step_of_more_than_four_times_the_next_are_left_out_of_the_interpolation(step_s, ticks):
    t = np.cumsum([0.0, step_s, 1.0, 1.0])
    gap_m = -0.1 * (t - 1) * (t - 2) * (t - step_s - 1.6)
    (begin,) = reports_of(zip(t, gap_m, strict=True))[-1].begins
    roots = np.roots(np.polyfit(t[-ticks:], gap_m[-ticks:], ticks - 1))
    assert np.min(np.abs(roots - begin.t_contact_s)) < 1e-9


@pytest.mark.parametrize(('step_s', 'ticks'), [(0.26, 4), (0.25, 4), (0.24, 3)])
def test_ticks_before_a_step_of_less_than_a_quarter_of_the_next_are_left_out_of_the_interpolation(step_s, ticks):
    t = np.cumsum([0.0, step_s, 1.0, 1.0])
    gap_m = 0.1 * (t + 1) * (t - 3) * (t - step_s - 1.6)
    (begin,) = reports_of(zip(t, gap_m, strict=True))[-1].begins
    roots = np.roots(np.polyfit(t[-ticks:], gap_m[-ticks:], ticks - 1))
    assert np.min(np.abs(roots - begin.t_contact_s)) < 1e-9


def two_pairs(t_ns, first_m, second_m):
    """Return benches with the given gaps between benches 0 and 3 and between 1 and 4; all other pairs are far apart."""
    centre = np.array([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0), (0.0, 1 + first_m), (50.0, 1 + second_m)])
    half, axis, p = np.full(5, 0.5), np.tile([1.0, 0.0], (5, 1)), np.array([(n, (-1.0) ** n) for n in range(6)])
    return Observation(t_ns, p, Benches(centre, axis, half, half))


def test_the_deepest_of_a_contact_is_kept_where_other_pairs_begin_and_end_to_touch():
    tracker = ContactTracker()
    gaps = [(1.0, 1.0), (-0.1, 1.0), (-0.3, 1.0), (-0.2, -0.1), (-0.1, -0.1), (-0.25, 0.5), (1.0, 1.0)]
    rows = [report for sec, (first, second) in enumerate(gaps)
            for report in tracker.add(two_pairs(sec * 10**9, first, second))]
    ends = {end.benches: end for report in rows for end in report.ends}
    assert (ends[0, 3].deepest_gap_m, ends[0, 3].deepest_ns) == (pytest.approx(-0.3), 2 * 10**9)
    assert (ends[1, 4].deepest_gap_m, ends[1, 4].deepest_ns) == (pytest.approx(-0.1), 3 * 10**9)


def test_a_contact_that_gets_deeper_as_another_begins_is_deepest_then():
    tracker = ContactTracker()
    gaps = [(-0.1, 1.0), (-0.3, -0.1), (-0.2, -0.1), (1.0, 1.0)]
    rows = [report for sec, (first, second) in enumerate(gaps)
            for report in tracker.add(two_pairs(sec * 10**9, first, second))]
    (end,) = [end for report in rows for end in report.ends if end.benches == (0, 3)]
    assert (end.deepest_gap_m, end.deepest_ns) == (pytest.approx(-0.3), 10**9)


def test_a_contact_that_stays_as_deep_while_another_begins_was_deepest_first():
    tracker = ContactTracker()
    gaps = [(-0.1, 1.0), (-0.3, 1.0), (-0.3, -0.1), (1.0, 1.0)]
    rows = [report for sec, (first, second) in enumerate(gaps)
            for report in tracker.add(two_pairs(sec * 10**9, first, second))]
    (end,) = [end for report in rows for end in report.ends if end.benches == (0, 3)]
    assert end.deepest_ns == 10**9


def test_a_pair_that_touches_again_has_a_second_episode():
    rows = reports_of([(0, 1), (1, -0.1), (2, 1), (3, -0.2), (4, 1)])
    assert told(rows) == [('begin', (0, 3)), ('parted', (0, 3))] * 2
    assert [report.count for report in rows] == [0, 1, 0, 1, 0]


def test_clearance_is_the_smallest_signed_gap_and_names_the_pair():
    rows = reports_of([(0, 0.015), (1, -0.25)])
    assert [report.clearance_m for report in rows] == pytest.approx([0.015, -0.25])
    assert [report.closest for report in rows] == [(0, 3), (0, 3)]


def test_benches_two_and_three_apart_in_the_chain_count_however_far():
    (report,) = reports_of([(0, 30)])
    assert (report.clearance_m, report.closest, report.touching) == (pytest.approx(30), (0, 3), ())


@pytest.mark.parametrize('gap', [0.0999, 3.0, 30.0])
def test_no_gap_is_missed_however_large(gap):
    (report,) = reports_of([(0, gap)])
    assert report.clearance_m == pytest.approx(gap)


def test_a_gap_of_rounding_errors_is_a_contact():
    begin, = (event for report in reports_of([(0, 0.1), (1, 1e-13)]) for event in report.begins)
    assert begin.t_contact_s == 1


def test_late_and_repeated_sights_tell_nothing_and_cost_nothing():
    assert told(reports(SCENE, [20, 22, 21, 22, 23, 20, 24, 22, 25, 24, 24, 26])) == [('begin', (0, 8))]


def test_lost_sights_make_the_bracket_wider_and_no_more():
    (event,) = events(SCENE, [0, 10, 11, 35])
    assert (event.before_ns, event.after_ns) == (412_220_000_000, 412_700_000_000)
    assert 412.22 < event.t_contact_s < 412.7


def test_ticks_of_a_nanosecond_beside_long_ones_do_not_upset_the_interpolation():
    rows = reports_of([(0, 0.3), (1, 0.2), (1 + 1e-9, 0.2 - 1e-10), (3, -0.1), (3 + 1e-9, -0.1), (1e6, 0.4)])
    begin, end = rows[3].begins[0], rows[-1].ends[0]
    assert 1 < begin.t_contact_s < 3
    assert 3 < end.t_end_s < 1e6


def test_a_restart_ends_what_was_open_and_tells_the_contact_again():
    tracker = ContactTracker()
    rows = reports(SCENE, range(30), tracker) + reports(SCENE, range(30), tracker)
    assert told(rows) == [('begin', (0, 8)), ('restart', (0, 8)), ('begin', (0, 8))]
    assert [report.count for report in rows[29:31]] == [1, 0]


def test_a_step_back_of_more_than_a_second_is_a_restart_at_once():
    assert told(reports_of([(0, 1), (5, -0.1), (0, 1)])) == [('begin', (0, 3)), ('restart', (0, 3))]


def test_a_restart_ends_what_was_open_at_the_last_observation():
    (end,) = reports_of([(5, 1), (6, -0.1), (7, -0.1), (8, -0.1), (0, 1)])[-1].ends
    assert end.t_end_s == 8


def test_a_restart_within_the_last_few_sights_loses_none_of_them():
    tracker = ContactTracker()
    first = reports(SCENE, range(20, 25), tracker)
    second = reports(SCENE, range(21, 30), tracker)
    assert [report.observation.t_ns for report in second] == [SCENE.run.time_ns(k) for k in range(21, 30)]
    assert told(first + second) == [('begin', (0, 8)), ('restart', (0, 8)), ('begin', (0, 8))]


def test_another_number_of_benches_ends_what_was_open():
    tracker = ContactTracker()
    tracker.add(crossed(10**9, -0.1))
    (report,) = tracker.add(crossed(2 * 10**9, -0.1, benches=7))
    assert told([report]) == [('restart', (0, 3)), ('begin', (0, 6))]


def test_many_contacts_at_once_are_bounded_deepest_first_and_counted():
    benches, half = 60, np.full(60, 0.5)
    rng = np.random.default_rng(4)
    p = np.array([(n, (-1.0) ** n) for n in range(benches + 1)])
    crowd = Benches(rng.uniform(0, 3, (benches, 2)), np.tile([1.0, 0.0], (benches, 1)), half, half)
    tracker = ContactTracker()
    (report,) = tracker.add(Observation(10**9, p, crowd))
    assert len(report.begins) == MOST_REPORTED
    assert report.more == report.count - MOST_REPORTED > 100
    assert [event.gap_m for event in report.begins] == sorted(event.gap_m for event in report.begins)
    assert report.begins[0].benches == report.closest == report.touching[0]
    spread = Benches(np.stack((10.0 * np.arange(benches), half), axis=1), crowd.axis, half, half)
    (after,) = tracker.add(Observation(2 * 10**9, p, spread))
    assert {end.benches for end in after.ends} == {event.benches for event in report.begins}
    assert (after.count, tracker._open.key.size) == (0, 0)


def test_an_open_episode_goes_on_where_the_pair_is_neither_the_closest_nor_near_any_other():
    crossed_, tracker = crossed(10**9, -0.1), ContactTracker()
    tracker.add(crossed_)
    b = crossed_.benches
    centre = b.centre.copy()
    centre[1] = centre[-1]      # another pair now has the deepest overlap
    (report,) = tracker.add(Observation(2 * 10**9, crossed_.p, Benches(centre, b.axis, b.half_length, b.half_width)))
    assert (0, 3) in report.touching
    assert report.closest != (0, 3)
    assert report.ends == ()


def test_a_watch_of_the_whole_run_never_grows():
    tracker = ContactTracker()
    reports(SCENE, range(compile_scene(SCENE).last_tick + 1), tracker)
    assert len(tracker._seen) == 3
    assert tracker._open.key.size <= 2
    assert len(tracker._buffer._times) <= 8


def test_a_repeated_tick_among_late_ones_makes_no_restart():
    once, again = ([20, 21, 22, 23, 24, 25, *late, 26, 27] for late in ((), (23, 24, 25)))
    assert told(reports(SCENE, again)) == told(reports(SCENE, once)) == [('begin', (0, 8))]


def test_late_ticks_that_go_back_are_each_just_late():
    late = [*range(20, 26), 24, 23, 22, 21, 26, 27]
    assert [report.observation.t_ns for report in reports(SCENE, late)] == [SCENE.run.time_ns(k) for k in range(20, 28)]


@pytest.mark.parametrize(('back_s', 'restarts'), [(0.99, False), (1.01, True)])
def test_an_observation_restarts_time_if_it_is_more_than_a_second_back(back_s, restarts):
    rows = [(10.0 + 0.5 * n, 1.0) for n in range(4)]
    found = reports_of([*rows, (11.5 - back_s, -0.1)])
    assert [report.observation.t_ns for report in found if report.begins] == [
        round((11.5 - back_s) * 1e9)] * restarts


def test_a_stamp_that_was_passed_on_is_not_passed_on_again():
    buffer = ReorderBuffer()
    assert [len(buffer.take(crossed(t_ns, 1.0))[1]) for t_ns in (5, 6, 6, 6, 6, 7)] == [1, 1, 0, 0, 0, 1]


def test_axes_between_two_ticks_are_unit_vectors_however_far_benches_turn():
    half = np.array([0.5])
    known = [Observation(n * 10**9, np.zeros((2, 2)), Benches(np.array([[n, 0.0]]), np.array([axis]), half, half))
             for n, axis in enumerate([(1.0, 0.0), (0.0, 1.0)])]
    found = _interpolated(known, 0.25)
    assert found.centre == pytest.approx(np.array([[0.25, 0.0]]))
    assert found.axis == pytest.approx(np.array([[3.0, 1.0]]) / np.sqrt(10))


@given(st.lists(st.dictionaries(st.integers(0, 5), st.integers(-3, 0)), max_size=8))
def test_episodes_keep_the_deepest_gap_of_each_pair_and_its_first_time(ticks):
    """The reference is a dictionary: pair -> (gap, time, whether it was reported)."""
    episodes, known = no_episodes(), {}
    for t_ns, gaps in enumerate(ticks, 1):
        keys = sorted(gaps)
        before = [*known]
        gap_m = np.array([float(gaps[key]) for key in keys])
        episodes, new, ended = episodes.advance(t_ns, np.array(keys, np.int64), gap_m)
        assert new.tolist() == [key not in known for key in keys]
        assert ended.tolist() == [key not in gaps for key in before]
        known = {key: (*((gaps[key], t_ns) if key not in known or gaps[key] < known[key][0] else known[key][:2]),
                       key in known) for key in keys}
        assert episodes.key.tolist() == [*known]
        assert [*zip(episodes.deepest_m, episodes.deepest_ns, episodes.reported, strict=True)] == [*known.values()]
        episodes = replace(episodes, reported=np.ones(episodes.key.size, bool))


@pytest.mark.parametrize('benches', [66, 200])
def test_pairs_of_a_long_dragon_are_named_and_counted_as_their_benches(benches):
    tracker = ContactTracker()
    (report,) = tracker.add(crossed(10**9, -0.1, benches=benches))
    assert (report.touching, report.begins[0].benches) == (((0, benches - 1),), (0, benches - 1))
    (after,) = tracker.add(crossed(2 * 10**9, 0.1, benches=benches))
    assert after.ends[0].benches == (0, benches - 1)


@given(st.lists(st.sampled_from([0.3, 0.9, 1.0, 1.3, 2.0, 5.0]), min_size=1, max_size=3), st.integers(0, 1),
       st.floats(0.1, 0.9))
def test_a_crossing_is_the_root_of_the_polynomial_through_the_ticks_that_belong_together(steps, sense, at):
    """A gap that is linear in time vanishes exactly when the line does, and shrinks at the line's slope."""
    t = np.cumsum([3.0, *steps])
    slope = [-0.05, 0.05][sense]
    root = t[-2] + at * (t[-1] - t[-2])
    rows = reports_of(zip(t, slope * (t - root), strict=True))
    if sense:
        (end,) = rows[-1].ends
        assert end.t_end_s == pytest.approx(root, abs=1e-9)
    else:
        (begin,) = rows[-1].begins
        assert begin.t_contact_s == pytest.approx(root, abs=1e-9)
        assert begin.approach_m_s == pytest.approx(0.05, abs=1e-9)
        assert begin.before_ns == round(t[-2] * 1e9)
        assert begin.point_m == pytest.approx((0.0, 0.5), abs=0.51)


@pytest.mark.parametrize('ticks', [2, 3, 4])
def test_a_gap_that_vanishes_at_a_tick_is_a_contact_at_this_tick(ticks):
    t = 5.0 + np.arange(ticks)
    (begin,) = reports_of(zip(t, 0.25 * (t[-1] - t), strict=True))[-1].begins
    assert begin.t_contact_s == t[-1]
    assert begin.approach_m_s == pytest.approx(0.25)


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=4, unique=True), st.floats(-0.5, 0.5))
def test_benches_between_ticks_lie_on_the_polynomial_through_their_places(times, back_s):
    """Centres and axes that are polynomials in time are reproduced if there are enough ticks for their degree."""
    times = sorted(round(t, 2) for t in times)
    assume(np.min(np.diff(times)) > 0.1)
    half, origin = np.array([0.5, 0.25]), 7.0

    def at(t):
        c = np.array([[1 + t - 0.5 * t * t, 2 - 3 * t], [t * t, 0.25 * t]])
        axis = np.array([[2.0 + t, 1.0 - t], [1.0 - t * t, 4.0]])
        return c, axis
    known = [Observation(round((origin + t) * 1e9), np.zeros((3, 2)), Benches(*at(t), half, half)) for t in times]
    t = times[-1] - abs(back_s)
    found, (centre, axis) = _interpolated(known, origin + t), at(t)
    assert found.centre == pytest.approx(centre, abs=1e-7)
    assert found.axis == pytest.approx(axis / np.linalg.norm(axis, axis=1)[:, None], abs=1e-7)
    assert found.half_length.tolist() == half.tolist()
