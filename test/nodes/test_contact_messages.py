"""In the monitor's messages about contacts and about its own state, each number has a name and a unit."""
from math import nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.tracker import EpisodeEnd, Event, Report

messages = pytest.importorskip('dragon_ros.nodes.contact_messages')
OK, WARN, ERROR = b'\x00', b'\x01', b'\x02'
NONE = np.zeros((4, 2))
SEEN = Observation(412_480_000_001, NONE, Benches(NONE, NONE, NONE[:, 0], NONE[:, 0]), 'dragon')
EVENT = Event((3, 11), 412_460_000_000, 412_480_000_001, 412.473837682, (1.25, -2.5), -1.5e-4, 0.026, 'dragon')
END = EpisodeEnd((3, 11), 415_000_000_000, -0.017, 413_760_000_000, 414.99, 'parted', 'dragon')


def values(status):
    return {pair.key: pair.value for pair in status.values}


def test_the_start_of_a_contact_has_its_benches_bracket_time_point_gap_and_approach():
    (status,) = messages.collision_of(Report(SEEN, -1.5e-4, (3, 11), begins=(EVENT,))).status
    found = values(status)
    assert (status.level, found['phase'], found['bracket']) == (ERROR, 'begin', 'closed')
    assert 'more' not in found
    assert status.message == 'contact of benches 3 and 11 at 412.473838 s, at (1.2500, -2.5000) m'
    assert (found['inner'], found['outer']) == ('3', '11')
    assert {name: float(found[name]) for name in found if name.endswith(('_s', '_m'))} == {
        't_before_s': 412.46, 't_after_s': 412.480000001, 't_contact_s': 412.473837682, 'x_m': 1.25, 'y_m': -2.5,
        'gap_m': -1.5e-4, 'approach_m_s': 0.026}


def test_the_start_of_a_contact_has_typed_numbers_with_names():
    report = Report(SEEN, -1.5e-4, (3, 11), begins=(EVENT, Event((0, 4), 1, 2, 3.0, (0.5, 1.0), -0.25, nan, 'dragon')))
    cloud = messages.cloud_of(report)
    assert (cloud.header.frame_id, cloud.header.stamp.sec, cloud.header.stamp.nanosec) == ('dragon', 412, 480_000_001)
    assert (cloud.height, cloud.width, cloud.row_step) == (1, 2, 2 * cloud.point_step)
    kinds = {field.name: (field.offset, field.datatype) for field in cloud.fields}
    assert kinds == {'x': (0, 7), 'y': (4, 7), 'z': (8, 7), 'inner': (12, 6), 'outer': (16, 6), 'depth': (20, 8),
                     't_contact': (28, 8)}
    rows = np.frombuffer(cloud.data, messages.CONTACT)
    assert rows.tolist() == [(1.25, -2.5, 0.0, 3, 11, 1.5e-4, 412.473837682), (0.5, 1.0, 0.0, 0, 4, 0.25, 3.0)]
    assert messages.cloud_of(Report(SEEN, 0.1, (3, 11), ends=(END,))) is None


def test_a_bracket_without_an_earlier_tick_is_open_and_its_approach_unknown():
    event = Event((0, 8), None, 10**9, 1.0, (0.0, 0.0), -0.1, nan, 'dragon')
    found = values(messages.status_of(event, 7))
    assert (found['bracket'], found['approach_m_s'], found['more']) == ('open', 'unknown', '7')
    assert found['t_before_s'] == found['t_after_s'] == '1.000000000'


@pytest.mark.parametrize('cause', ['parted', 'restart', 'venue'])
def test_the_end_of_a_contact_says_when_how_deep_it_was_and_why_it_ended(cause):
    end = EpisodeEnd(END.benches, END.after_ns, END.deepest_gap_m, END.deepest_ns, END.t_end_s, cause, 'dragon')
    (status,) = messages.collision_of(Report(SEEN, 0.1, (3, 11), ends=(end,))).status
    assert status.level == OK
    assert values(status) == {'phase': 'end', 'inner': '3', 'outer': '11', 't_end_s': '414.990000000', 'cause': cause,
                              'deepest_gap_m': '-0.017000000000', 't_deepest_s': '413.760000000'}


def test_a_tick_with_neither_a_start_nor_an_end_has_no_message():
    assert messages.collision_of(Report(SEEN, -0.1, (3, 11), ((3, 11),), 1)) is None


def test_ends_stand_before_starts_and_all_have_the_stamp_of_their_tick():
    message = messages.collision_of(Report(SEEN, 0.1, (3, 11), begins=(EVENT,), ends=(END,)))
    assert [values(status)['phase'] for status in message.status] == ['end', 'begin']
    stamp, point = message.header.stamp, messages.point_of(EVENT)
    assert (stamp.sec, stamp.nanosec) == (412, 480_000_001)
    assert (point.header.stamp, point.header.frame_id) == (stamp, 'dragon')
    assert (point.point.x, point.point.y, point.point.z) == (1.25, -2.5, 0.0)


@pytest.mark.parametrize(('count', 'clearance_m', 'level'), [
    (0, 0.3, OK), (0, 0.05, OK), (0, 0.0499, WARN), (1, -0.01, ERROR), (2, 0.0, ERROR)])
def test_contact_is_an_error_and_a_clearance_below_the_limit_a_warning(count, clearance_m, level):
    report = Report(SEEN, clearance_m, (3, 11), count=count)
    status = messages.health_of('dragon', report, 0.05, 4)
    assert messages.level_of(report, 0.05) == status.level == level
    assert [words in status.message for words in ('1 pair is in', '2 pairs are in')] == [count == 1, count == 2]
    found = values(status)
    assert (float(found['t_s']), float(found['clearance_m'])) == (412.480000001, clearance_m)
    assert (found['closest'], found['warn_below_m']) == ('3 and 11', '0.05')
    assert (found['in_contact'], found['dropped'], status.hardware_id) == (str(count), '4', 'dragon')


def test_health_without_a_tick_is_ok_and_says_what_it_waits_for():
    status = messages.health_of('hall', None, 0.05, 2)
    assert (status.level, status.name, status.hardware_id) == (OK, 'hall: clearance', 'hall')
    assert values(status) == {'reports': '0', 'dropped': '2', 'waiting': '0'}
    assert 'waiting' in status.message


@pytest.mark.parametrize('report', [None, Report(SEEN, 0.1, (3, 11))])
def test_health_counts_reports_and_messages_that_are_yet_to_be_read_and_marks_the_last_message_of_a_monitor(report):
    during, last = (values(messages.health_of('hall', report, 0.05, 0, waiting, waiting == 0, 9 - waiting))
                    for waiting in (7, 0))
    assert (during['waiting'], last['waiting']) == ('7', '0')
    assert (during['reports'], last['reports']) == ('2', '9')
    assert ('leaves' in during, last['leaves']) == (False, 'true')


def test_contact_changes_with_the_first_and_after_the_last_pair_that_touches():
    changes = messages.Changes()
    assert changes.last is None
    rows = [Report(SEEN, 0.1, (3, 11), count=count) for count in (0, 0, 2, 1, 1, 0, 0, 1)]
    assert [changes.contact(row) for row in rows] == [False, False, True, False, False, True, False, True]
    assert changes.last is rows[-1]
    assert messages.Changes().contact(rows[-1])


def test_a_level_is_new_if_it_differs_from_the_last_one_in_either_direction():
    changes = messages.Changes()
    found = [changes.level(level) for level in (OK, OK, WARN, ERROR, ERROR, WARN, OK, ERROR)]
    assert found == [True, False, True, True, False, True, True, True]


def test_the_clearance_is_labelled_ten_times_a_second_and_at_once_with_a_contact():
    changes = messages.Changes()
    asked = [(-7.0, False), (-6.8, False), (-6.75, False), (-6.74, True), (-6.65, False), (-6.6, False), (3.0, False)]
    assert [changes.label(now_s, at_once) for now_s, at_once in asked] == [True, True, False, True, False, True, True]
    first = messages.Changes()
    assert [first.label(now_s, False) for now_s in (0.0, 0.0999, 0.1, 0.15, 0.2)] == [True, False, True, False, True]


@pytest.mark.parametrize(('skipped', 'said'), [(0, 5), (3, 5), (5, 5), (9, 9)])
def test_the_pace_counts_ticks_that_were_skipped_or_never_arrived_once(skipped, said):
    pace = messages.Pace()
    pace.see(10**9, 3, 0.0)
    pace.see(3 * 10**9, 9, 0.0)
    pace.skip(skipped, 0.0)
    assert pace.text() == (f'{said} unseen ticks, {skipped} skipped because ticks arrive faster than they can be read; '
                           'contacts shorter than 2.000000000 s may be missed')
    (status,) = pace.warnings('red', 0.0)
    assert values(status) == {'unseen': '5', 'skipped': str(skipped), 'longest_step_s': '2.000000000'}
    assert (status.level, status.name, status.hardware_id) == (WARN, 'red: monitor: pace', 'red')


@given(st.lists(st.tuples(st.integers(1, 5), st.integers(1, 4)), min_size=1, max_size=10), st.integers(1, 5))
def test_the_pace_adds_up_the_numbers_that_are_missing(rows, first):
    """The reference counts the missing numbers and measures the longest time across a gap in the numbers."""
    pace, seen, t_ns, number, steps = messages.Pace(), [first], 0, first, [0]
    pace.see(t_ns, number, 0.0)
    for step_ns, more in rows:
        t_ns, number = t_ns + step_ns, number + more
        steps += [step_ns] if more > 1 else []
        seen.append(number)
        pace.see(t_ns, number, 0.0)
    missing = len({*range(first, number + 1)} - {*seen})
    (status,) = pace.warnings('dragon', 0.0) if missing else [None]
    if missing:
        assert values(status) == {'unseen': str(missing), 'skipped': '0', 'longest_step_s': f'{max(steps) / 1e9:.9f}'}
    assert bool(pace.text()) == bool(missing)
    assert pace.before == first - 1


def test_unseen_ticks_are_reported_at_once_and_then_once_a_second_and_warned_about_for_three():
    pace = messages.Pace()
    times_s = 5.0, 5.5, 6.0, 6.01, 6.5, 7.02
    assert [pace.skip(1, now_s) for now_s in times_s] == [True, False, False, True, False, True]
    assert [bool(pace.warnings('red', now_s)) for now_s in (7.02, 9.0, 10.02, 10.03)] == [True, True, True, False]
