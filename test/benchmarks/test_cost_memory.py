"""The figures on the page ``cost memory`` follow from the samples, and the measured recording is complete."""
import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import command, memory


def recorded(seconds=600.0, growth_mb_s=1e-4):
    samples = tuple((float(t), 80.0 + growth_mb_s * t + (5.0 if t < 50 else 0.0)) for t in range(0, round(seconds), 5))
    return memory.Recorded(seconds, samples, 60_000, 0, 4800, 345_600, 10**9)


def test_growth_is_fitted_from_the_first_minute_on():
    row = recorded()
    assert row.grows_kb_min == pytest.approx(6.0)
    assert row.index_kb_min == pytest.approx(34.56)
    assert row.settled[0] == (60.0, pytest.approx(80.006))


def test_a_step_is_distinguished_from_steady_growth():
    row = recorded()
    stepped = replace(row, samples=tuple((t_s, mb + (2.0 if t_s > 300 else 0.0)) for t_s, mb in row.samples))
    assert stepped.steps_mb == pytest.approx(2.0, abs=1e-3)
    assert stepped.creeps_kb_min == pytest.approx(6.0, rel=0.02)
    assert (row.steps_mb, row.creeps_kb_min) == (0.0, pytest.approx(6.0))


def test_growth_is_compared_with_that_of_the_index():
    row = recorded(growth_mb_s=1e-3)
    jumped = replace(row, samples=tuple((t_s, mb + (2.0 if t_s > 300 else 0.0)) for t_s, mb in row.samples))
    assert '| 60 | 0.00 | 60 | 35 | 1.74 | 1.74 |' in memory.table(row)
    more = jumped.grows_kb_min / jumped.index_kb_min
    assert more > 10
    assert f'| 35 | {more:.3g} | 1.72 |' in memory.table(jumped)


def test_table_csv_and_picture_have_the_run(tmp_path):
    with np.errstate(all='warn'):
        paths = command.write('memory', recorded(), tmp_path)
    assert {path.name for path in paths} == {'memory.md', 'memory.csv', 'memory.png', 'memory.svg'}
    assert ('| 10 | 0 | 60 s: 80.01 | 80.06 | 85.00 | 6 | 0.00 | 6 | 35 | 0.17 | 0.17 | 4,800 | 1000 |'
            in memory.table(recorded()))
    read = list(csv.DictReader(io.StringIO((tmp_path / 'memory.csv').read_text())))
    assert len(read) == 120
    assert read[12] == {'seconds': '60.00', 'resident_mb': '80.006'}


@pytest.mark.long
def test_a_short_run_is_recorded_to_the_last_message():
    pytest.importorskip('rclpy')
    row = memory.measure(5.0)       # the shortest run at a speed of the world
    assert (row.ticks, row.missing) == (500, 0)
    assert row.chunks > 3
    assert 52 * row.chunks < row.index_bytes < 92 * row.chunks      # one to five topics
    assert all(resident > 10 for _, resident in row.samples)
