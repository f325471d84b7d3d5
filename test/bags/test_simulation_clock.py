from dragon_ros.bags.record.simulation_clock import SimulationClock
from dragon_ros.core.limits import HELD_BYTES


def test_messages_without_a_stamp_get_the_tick_that_was_published_before_them():
    out = []
    clock = SimulationClock(lambda *row: out.append(row[0:3:2]))
    clock.unstamped('v', b'early', 5, 0)        # of a tick before the first that was seen
    clock.mark(10, 100)
    clock.mark(20, 200)
    clock.unstamped('v', b'1', 12, 1)           # overtaken by the next handles
    clock.unstamped('v', b'2', 22, 2)           # must wait for the next handles
    assert out == [('v', 100)]
    clock.unstamped('v', b'3', 32, 3)           # came before its own handles
    clock.mark(30, 300)
    clock.flush()
    assert out == [('v', 100), ('v', 200), ('v', 300)]


def test_what_comes_long_before_a_run_is_held_in_bounds():
    clock = SimulationClock(lambda *_: None)
    for n in range(5000):
        clock.unstamped('/diagnostics', b'', n, n)
    assert len(clock._held) <= 1000


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
