"""Pacing follows a steady clock without drift or bursts; overruns are counted and made up for."""
from itertools import pairwise

import pytest

from dragon_ros.core.errors import FieldError
from dragon_ros.nodes import pacer
from dragon_ros.nodes.pacer import Pacer

MS = 1_000_000


class Clock:
    """A clock that advances only while the test waits or works."""

    def __init__(self, monkeypatch):
        self.now_ns = 5 * MS
        monkeypatch.setattr(pacer.time, 'monotonic_ns', lambda: self.now_ns)

    def play(self, paced, t_ns):
        """Wait until a tick is due and start it, like a timer that is never late."""
        self.now_ns += paced.delay_ns(t_ns)
        paced.start(t_ns)


def played(monkeypatch, work_ms, count=1000, scale=1.0, tick_ms=20):
    """Return the start times (ms) of ticks whose work takes ``work_ms(k)``, and the pacer."""
    clock, paced = Clock(monkeypatch), Pacer(scale)
    started = []
    for k in range(count):
        clock.play(paced, k * tick_ms * MS)
        started.append(clock.now_ns / MS)
        clock.now_ns += work_ms(k) * MS
    return started, paced


def steps_of(started):
    return [after - before for before, after in pairwise(started)]


@pytest.mark.parametrize('scale', [0.5, 1.0, 4.0])
def test_ticks_are_due_at_the_scaled_time_without_drift(monkeypatch, scale):
    started, paced = played(monkeypatch, lambda k: 3, 100, scale)
    assert started[-1] - started[0] == pytest.approx(99 * 20 / scale, abs=1e-4)
    assert paced.overruns == 0


@pytest.mark.parametrize('scale', [0.5, 1.0, 4.0])
def test_a_late_tick_is_an_overrun_that_is_made_up_for_without_a_burst(monkeypatch, scale):
    started, paced = played(monkeypatch, lambda k: 130 if k == 2 else 3, scale=scale)
    steps = steps_of(started)
    step, late = 20 / scale, 130 - 20 / scale
    assert steps[:4] == pytest.approx([step, step, 130, step])
    faster = steps[4:4 + int(late / (0.1 * step))]
    assert faster == pytest.approx([0.9 * step] * len(faster), abs=1e-5)
    assert steps[-100:] == pytest.approx([step] * 100, abs=1e-5)
    assert sum(steps) == pytest.approx(999 * step, abs=1e-5)
    assert paced.overruns == 1
    assert paced.worst_late_s == pytest.approx(late / 1e3)


def test_more_than_a_second_is_not_made_up_for(monkeypatch):
    started, paced = played(monkeypatch, lambda k: 5_020 if k == 2 else 3)
    steps = steps_of(started)
    assert steps[4] == pytest.approx(18)
    assert sum(steps) == pytest.approx(999 * 20 + 4_000)
    assert paced.overruns == 1


def test_a_machine_that_is_too_slow_goes_on_at_its_own_pace_and_then_races_for_ten_seconds(monkeypatch):
    steps = steps_of(played(monkeypatch, lambda k: 25 if k < 1000 else 3, 2000)[0])
    assert steps[10:900] == [25] * 890
    assert min(steps[1010:]) >= 18 - 1e-5
    assert steps[-400:] == pytest.approx([20] * 400)


def test_a_machine_that_can_go_a_little_faster_makes_up_for_a_stall_without_another_overrun(monkeypatch):
    started, paced = played(monkeypatch, lambda k: 320 if k == 2 else 19)
    assert paced.overruns == 1
    assert started[-1] - started[0] == pytest.approx(999 * 20, abs=6)


def test_a_pause_is_not_made_up_for(monkeypatch):
    clock, paced = Clock(monkeypatch), Pacer(1.0)
    clock.play(paced, 0)
    clock.now_ns += 500 * MS
    clock.play(paced, 20 * MS)
    paced.rest()
    clock.play(paced, 40 * MS)
    before = clock.now_ns
    clock.play(paced, 60 * MS)
    assert paced.overruns == 1
    assert clock.now_ns - before == 20 * MS


def test_a_short_stall_is_made_up_for_at_once(monkeypatch):
    started, paced = played(monkeypatch, lambda k: 30 if k == 10 else 0.1, 100, tick_ms=1)
    assert paced.overruns == 0
    assert started[11] - started[10] == 30
    assert started[-1] - started[0] == 99


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


@pytest.mark.parametrize('scale', [2e-12, 1e-13, 1e-300, 5e-324])
def test_at_the_smallest_scales_the_next_tick_is_always_an_hour_away(monkeypatch, scale):
    clock, paced = Clock(monkeypatch), Pacer(scale)
    clock.play(paced, 0)
    for _ in range(3):
        clock.now_ns += paced.delay_ns(20 * MS)
        assert paced.delay_ns(20 * MS) == 3600 * 1000 * MS
    paced.scale = 1.0
    assert paced.delay_ns(20 * MS) == pytest.approx(20 * MS, abs=100)      # at a scale of 2e-12, 22 ns have passed


def test_a_run_that_is_late_goes_on_at_the_smallest_scale(monkeypatch):
    clock, paced = Clock(monkeypatch), Pacer(1e6)
    clock.play(paced, 0)
    clock.now_ns += 100 * MS
    paced.scale = 5e-324
    assert paced.delay_ns(20 * MS) == 0
    paced.start(20 * MS)
    paced.scale = 1e6
    assert paced.delay_ns(40 * MS) <= 20
