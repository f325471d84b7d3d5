"""The page ``cost simulate`` measures each number of workers, separate commands and a copy of the bag."""
import os

import pytest

from benchmarks import simulate
from dragon_ros.cli.pool import workers_of


@pytest.fixture
def one_core():
    """Let this process use one core only, so that few numbers of workers are measured."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    yield
    os.sched_setaffinity(0, cores)


@pytest.mark.long
def test_every_number_of_workers_is_measured(monkeypatch, one_core):
    monkeypatch.setattr(simulate, '_ROUNDS', 1)
    rows = simulate.measure(1e-4)
    assert [row.workers for row in rows] == [0, *range(1, 2 * workers_of(None) + 1), -1, None]
    assert len({row.mb for row in rows if row.workers != -1}) == 1
    assert all(row.wall_s > 0 for row in rows)
    text = simulate.table(rows)
    assert '| one worker on one core |' in text
    assert f'| {workers_of(None)} commands, each with a part of the run |' in text
    assert '| copying its bytes |' in text
    assert len(simulate.csv_text(rows).splitlines()) == len(rows) + 1
    assert simulate.picture(rows).axes[0].get_xlabel() == 'times real time'
