"""Pacing follows a steady clock: no drift, no burst, overruns counted."""
import threading
from itertools import pairwise

import pytest

from dragon_ros.core.errors import FieldError
from dragon_ros.nodes import pacer
from dragon_ros.nodes.pacer import Pacer

MS = 1_000_000


class Clock:
    """A clock that only waiting and working move on."""

    def __init__(self, monkeypatch, stop):
        self.now_ns = 5 * MS
        monkeypatch.setattr(pacer.time, 'monotonic_ns', lambda: self.now_ns)
        monkeypatch.setattr(stop, 'wait', self.wait)

    def wait(self, seconds):
        self.now_ns += round(seconds * 1e9)
        return False


@pytest.fixture
def stop():
    return threading.Event()


@pytest.mark.parametrize('scale', [0.5, 1.0, 4.0])
def test_ticks_are_due_at_the_scaled_time_without_drift(monkeypatch, stop, scale):
    clock, paced = Clock(monkeypatch, stop), Pacer(scale)
    started = []
    for k in range(100):
        assert paced.wait(k * 20 * MS, stop)
        started.append(clock.now_ns)
        clock.now_ns += 3 * MS
    assert started[-1] - started[0] == pytest.approx(99 * 20 * MS / scale, abs=100)
    assert paced.overruns == 0


def test_a_late_tick_is_an_overrun_and_no_burst_follows(monkeypatch, stop):
    clock, paced = Clock(monkeypatch, stop), Pacer(1.0)
    started = []
    for k in range(6):
        assert paced.wait(k * 20 * MS, stop)
        started.append(clock.now_ns)
        clock.now_ns += (130 if k == 2 else 3) * MS
    steps = [after - before for before, after in pairwise(started)]
    assert steps == [20 * MS, 20 * MS, 130 * MS, 20 * MS, 20 * MS]
    assert paced.overruns == 1
    assert paced.worst_late_s == pytest.approx(0.11)


def test_a_short_stall_is_made_up_for_at_once(monkeypatch, stop):
    clock, paced = Clock(monkeypatch, stop), Pacer(1.0)
    started = []
    for k in range(100):
        assert paced.wait(k * MS, stop)
        started.append(clock.now_ns)
        clock.now_ns += (30 if k == 10 else 0.1) * MS
    assert paced.overruns == 0
    assert started[11] - started[10] == 30 * MS
    assert started[-1] - started[0] == 99 * MS


def test_scale_zero_never_waits_and_stop_always_stops(monkeypatch, stop):
    clock, paced = Clock(monkeypatch, stop), Pacer(0.0)
    assert paced.wait(0, stop)
    assert paced.wait(10**12, stop)
    assert clock.now_ns == 5 * MS
    stop.set()
    assert not paced.wait(2 * 10**12, stop)


@pytest.mark.parametrize('scale', [-1.0, float('nan'), 1e9])
def test_an_impossible_scale_is_refused(scale):
    with pytest.raises(FieldError, match='time_scale'):
        Pacer(scale)


@pytest.mark.parametrize(('old', 'new'), [(1.0, 4.0), (4.0, 0.5)])
def test_a_change_of_the_scale_neither_jumps_nor_bursts(monkeypatch, stop, old, new):
    clock, paced = Clock(monkeypatch, stop), Pacer(old)
    paced.wait(0, stop)
    started = clock.now_ns
    clock.now_ns += 5 * MS
    paced.scale = new
    assert paced.wait(40 * MS, stop)
    assert clock.now_ns - started == pytest.approx(5 * MS + (40 * MS - 5 * MS * old) / new, abs=100)
    assert paced.wait(60 * MS, stop)
    assert clock.now_ns - started == pytest.approx(5 * MS + (60 * MS - 5 * MS * old) / new, abs=100)
    assert paced.overruns == 0


def test_after_a_rest_the_next_tick_is_due_one_step_later_and_nothing_is_late(monkeypatch, stop):
    clock, paced = Clock(monkeypatch, stop), Pacer(1.0)
    paced.wait(0, stop)
    paced.rest()
    clock.now_ns += 10_000 * MS
    assert paced.delay_ns(20 * MS) == 20 * MS
    assert paced.overruns == 0
