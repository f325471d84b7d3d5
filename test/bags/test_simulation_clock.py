from itertools import pairwise

import pytest

from dragon_ros.bags.record.simulation_clock import MOST_HELD, SimulationClock
from dragon_ros.core.limits import HELD_BYTES


def test_messages_without_a_stamp_get_the_tick_that_was_published_before_them():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[0:3:2]))
    clock.unstamped('v', b'early', 5, 0)        # belongs to a tick before the first received one
    clock.mark(10, 100)
    clock.mark(20, 200)
    clock.unstamped('v', b'1', 12, 1)           # the next handles arrive before this message
    clock.unstamped('v', b'2', 22, 2)           # this message waits for the next handles
    assert out == [('v', 100)]
    clock.unstamped('v', b'3', 32, 3)           # this message arrives before the handles of its tick
    clock.mark(30, 300)
    clock.flush()
    assert out == [('v', 100), ('v', 200), ('v', 300)]


def test_what_comes_long_before_a_run_is_held_in_bounds():
    clock = SimulationClock(lambda *_: None)
    for n in range(2 * MOST_HELD):
        clock.unstamped('/diagnostics', b'', n, n)
    assert len(clock._held) <= MOST_HELD


def test_a_latched_message_of_before_the_first_tick_is_logged_at_that_tick():
    out = []
    clock = SimulationClock(lambda *row: out.append(row))
    clock.unstamped('scene', b's', 5, 1, latched=True)
    clock.unstamped('v', b'v', 6, 1)
    clock.mark(10, 100)
    assert out == [('scene', b's', 100, 1, 5)]
    clock.unstamped('scene', b'again', 7, 1, latched=True)
    assert out[1:] == [('scene', b'again', 100, 1, 7)]
    assert clock.left_out == 1


def test_what_waits_longer_than_allowed_belongs_to_the_last_tick():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[0:3:2]))
    clock.unstamped('d', b'', 1, 1)
    clock.flush(age_s=1e-9)
    assert out == []
    clock.mark(10, 100)
    clock.unstamped('v', b'', 11, 1)
    clock.flush(age_s=1e-9)
    assert out == [('v', 100)]


def test_what_waits_for_the_first_tick_is_bounded_in_bytes_too():
    clock, large = SimulationClock(lambda *_: None), bytes(2**24)
    for n in range(12):
        clock.unstamped('v', large, n, n, latched=n % 2 == 0)
    assert sum(len(held.data) for held in clock._held) <= HELD_BYTES
    assert clock.left_out == 12 - HELD_BYTES // 2**24


def test_after_a_lost_tick_nobody_can_tell_whose_a_message_is_and_it_is_counted():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    clock.mark(10, 100, 1)
    clock.unstamped('v', b'1', 11, 1)
    clock.unstamped('d', b'of none', 12, 1, exact=False)
    clock.unstamped('v', b'2 or 3', 31, 3)      # message 2, of the tick at 21 ns, was lost
    clock.mark(30, 300, 3)
    clock.mark(40, 400, 4)
    assert out == [(b'of none', 100), (b'2 or 3', 300)]
    assert clock.unpaired == {'v': 1}


def test_a_latched_message_after_a_lost_tick_is_logged_when_it_surely_holds():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    clock.mark(10, 100, 500)
    clock.unstamped('active', b'of another monitor', 31, 1, latched=True)
    clock.mark(40, 400, 4)      # the publisher's first three ticks preceded its discovery of the recorder
    assert (out, clock.unpaired) == ([(b'of another monitor', 400)], {})


def test_another_publisher_that_numbers_anew_is_no_loss():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    clock.mark(10, 100, 5)
    clock.unstamped('v', b'5', 11, 5)
    clock.mark(20, 0, 1)
    assert (out, clock.unpaired) == ([(b'5', 100)], {})


def test_a_topic_has_one_message_a_tick_and_the_next_waits_for_its_own():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    clock.mark(10, 100, 1)
    for n in (1, 2):
        clock.unstamped('v', b'%d' % n, 10 * n + 1, n)
    clock.flush(age_s=1e-9)
    assert out == [(b'1', 100)]
    clock.mark(20, 200, 2)
    clock.unstamped('v', b'3', 31, 3)
    clock.flush()
    assert (out, clock.unpaired) == ([(b'1', 100), (b'2', 200)], {'v': 1})


def test_without_any_tick_what_is_latched_is_of_the_first_of_the_run_and_the_rest_of_none():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    clock.unstamped('active', b'no', 5, 1, latched=True)
    clock.unstamped('clearance', b'', 6, 1)
    clock.flush(first_ns=100)
    assert (out, clock.unpaired) == ([(b'no', 100)], {'clearance': 1})


BACK_NS = 7200 * 10**9
PERIOD_NS = 20_000_000


def published(ticks, set_back):
    """Return a sim's messages as (topic, tick, source time); ``set_back`` maps (topic, tick) to jumps of the clock."""
    now, out = 10**18, []
    for k in range(ticks):
        for topic in ('handles', 'v'):
            now += set_back.get((topic, k), 0)
            out.append((topic, k, now))
            now += 50_000
        now += PERIOD_NS
    return out


def ticks_of(clock, out, rows):
    for topic, k, source_ns in rows:
        if topic == 'handles':
            clock.mark(source_ns, 1000 + k, k + 1)
        else:
            clock.unstamped(topic, b'%d' % k, source_ns, k + 1)
    clock.flush()
    return {int(data): t_ns - 1000 for data, t_ns in out}


@pytest.mark.parametrize('by_ns', [-BACK_NS, BACK_NS, -2 * 10**9, -5 * PERIOD_NS // 2], ids=[
    'back', 'on', '2 s', '50 ms'])
@pytest.mark.parametrize('late', ['in order', 'handles late', 'v late'])
@pytest.mark.parametrize('where', ['handles', 'v'])
def test_a_system_clock_that_is_set_moves_no_message_to_another_tick(by_ns, late, where):
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    rows = published(2100, {(where, 7): by_ns, ('handles', 40): -by_ns, ('v', 1900): by_ns})
    if late != 'in order':      # topics overtake each other by several ticks
        slow = 'handles' if late == 'handles late' else 'v'
        rows = [rows[n] for n in sorted(range(len(rows)), key=lambda n: n + 5.5 * (rows[n][0] == slow))]
    found = ticks_of(clock, out, rows)
    assert (found, clock.unpaired, clock.left_out) == ({k: k for k in range(2100)}, {}, 0)


@pytest.mark.parametrize('late', ['handles', 'v'])
def test_a_topic_that_is_thousands_of_ticks_late_loses_nothing(late):
    """A reader that was stopped receives a topic up to 10,000 messages late: Fast DDS keeps 5,000 on either side."""
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    rows = sorted(published(12_000, {}), key=lambda row: row[1] + 9900 * (row[0] == late))
    found = ticks_of(clock, out, rows)
    assert (found, clock.unpaired, clock.left_out) == ({k: k for k in range(12_000)}, {}, 0)


def test_a_message_whose_tick_is_long_forgotten_is_counted_as_unpaired_and_told_with_its_number():
    out, told = [], []
    clock = SimulationClock(lambda *row: out.append(row[1:3]), lambda *row: told.append(row))
    for k in range(50_000):
        clock.mark(10**18 + PERIOD_NS * k, 1000 + k, k + 1)
    clock.unstamped('v', b'', 10**18 + PERIOD_NS * 3 + 50, 4)
    clock.unstamped('w', b'', 10**18 - 50, 1)       # published before the first tick that was received
    assert (out, clock.unpaired, clock.left_out, told) == ([], {'v': 1}, 1, [('v', 4)])


def test_a_rare_message_after_the_clock_was_set_back_has_the_tick_before_it():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    clock.unstamped('rare', b'first', 10**18 - 5, 1)
    for k, source_ns in enumerate((10**18, 10**18 + 20, 10**18 - BACK_NS, 10**18 - BACK_NS + 20)):
        clock.mark(source_ns, 1000 + k, k + 1)
    clock.unstamped('rare', b'in transit', 10**18 + 25, 2)
    clock.unstamped('rare', b'after', 10**18 - BACK_NS + 10, 1)
    assert out == [(b'in transit', 1001), (b'after', 1002)]


def test_a_rare_message_long_after_the_clock_was_set_back_by_little_has_the_tick_before_it():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    clock.unstamped('rare', b'first', 10**18 - 5, 1)
    for k in range(300):
        clock.mark(10**18 + PERIOD_NS * k - (PERIOD_NS + 9 if k >= 100 else 0), 1000 + k, k + 1)
    clock.unstamped('rare', b'after', 10**18 + PERIOD_NS * 249, 1)
    assert out == [(b'after', 1250)]


def test_source_times_that_jump_for_one_topic_alone_hold_a_bounded_number():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[1:3]))
    for k in range(5 * MOST_HELD):
        clock.mark(10**18 + PERIOD_NS * k, 1000 + k, k + 1)
        clock.unstamped('v', b'', 10**18 + PERIOD_NS * k - (BACK_NS if k == 9 else 0) + 50, k + 1)
        assert len(clock._held) <= MOST_HELD
    assert len(out) + clock.unpaired['v'] >= 4 * MOST_HELD


def test_the_ticks_that_are_kept_for_late_messages_are_bounded():
    clock, kept = SimulationClock(lambda *_: None), []
    for k in range(25_000):
        clock.mark(10**18 + PERIOD_NS * k, 1000 + k, k + 1)
        kept.append(len(clock._marks))
    assert min(kept[10_000:]) == 10_000         # an even later message may miss its tick
    assert max(kept) < 11_000                   # a longer list would take more memory
    assert sum(after <= before for before, after in pairwise(kept)) < 20    # each drop moves the whole list
    assert len(clock._moments) == len(clock._marks)
