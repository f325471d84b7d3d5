"""Pacing follows a steady clock: no drift, no burst, overruns counted."""
from itertools import pairwise

import pytest

from dragon_ros.core.errors import FieldError
from dragon_ros.nodes import pacer
from dragon_ros.nodes.pacer import Pacer

MS = 1_000_000


class Clock:
    """A clock that only waiting and working move on."""

    def __init__(self, monkeypatch):
        self.now_ns = 5 * MS
        monkeypatch.setattr(pacer.time, 'monotonic_ns', lambda: self.now_ns)

    def play(self, paced, t_ns):
        """Wait until a tick is due, and start it, as a timer that is never late does."""
        self.now_ns += paced.delay_ns(t_ns)
        paced.start(t_ns)


@pytest.mark.parametrize('scale', [0.5, 1.0, 4.0])
def test_ticks_are_due_at_the_scaled_time_without_drift(monkeypatch, scale):
    clock, paced = Clock(monkeypatch), Pacer(scale)
    started = []
    for k in range(100):
        clock.play(paced, k * 20 * MS)
        started.append(clock.now_ns)
        clock.now_ns += 3 * MS
    assert started[-1] - started[0] == pytest.approx(99 * 20 * MS / scale, abs=100)
    assert paced.overruns == 0


def test_a_late_tick_is_an_overrun_and_no_burst_follows(monkeypatch):
    clock, paced = Clock(monkeypatch), Pacer(1.0)
    started = []
    for k in range(6):
        clock.play(paced, k * 20 * MS)
        started.append(clock.now_ns)
        clock.now_ns += (130 if k == 2 else 3) * MS
    steps = [after - before for before, after in pairwise(started)]
    assert steps == [20 * MS, 20 * MS, 130 * MS, 20 * MS, 20 * MS]
    assert paced.overruns == 1
    assert paced.worst_late_s == pytest.approx(0.11)


def test_a_short_stall_is_made_up_for_at_once(monkeypatch):
    clock, paced = Clock(monkeypatch), Pacer(1.0)
    started = []
    for k in range(100):
        clock.play(paced, k * MS)
        started.append(clock.now_ns)
        clock.now_ns += (30 if k == 10 else 0.1) * MS
    assert paced.overruns == 0
    assert started[11] - started[10] == 30 * MS
    assert started[-1] - started[0] == 99 * MS


def test_scale_zero_never_waits(monkeypatch):
    clock, paced = Clock(monkeypatch), Pacer(0.0)
    clock.play(paced, 0)
    clock.play(paced, 10**12)
    assert clock.now_ns == 5 * MS


@pytest.mark.parametrize('scale', [-1.0, float('nan'), 1e9])
def test_an_impossible_scale_is_refused(scale):
    with pytest.raises(FieldError, match='time_scale'):
        Pacer(scale)


@pytest.mark.parametrize(('old', 'new'), [(1.0, 4.0), (4.0, 0.5)])
def test_a_change_of_the_scale_neither_jumps_nor_bursts(monkeypatch, old, new):
    clock, paced = Clock(monkeypatch), Pacer(old)
    clock.play(paced, 0)
    started = clock.now_ns
    clock.now_ns += 5 * MS
    paced.scale = new
    clock.play(paced, 40 * MS)
    assert clock.now_ns - started == pytest.approx(5 * MS + (40 * MS - 5 * MS * old) / new, abs=100)
    clock.play(paced, 60 * MS)
    assert clock.now_ns - started == pytest.approx(5 * MS + (60 * MS - 5 * MS * old) / new, abs=100)
    assert paced.overruns == 0


def test_after_a_rest_the_next_tick_is_due_one_step_later_and_nothing_is_late(monkeypatch):
    clock, paced = Clock(monkeypatch), Pacer(1.0)
    clock.play(paced, 0)
    paced.rest()
    clock.now_ns += 10_000 * MS
    assert paced.delay_ns(20 * MS) == 20 * MS
    assert paced.overruns == 0
