"""The page ``cost startup`` has a line for every executable and valid arguments for every use, and writes its files."""
import numpy as np
import pytest

from benchmarks import startup
from dragon_ros.__main__ import EXECUTABLES
from dragon_ros.cli import figures
from dragon_ros.cost.measure import Timing


def rows():
    every = [*((name, ' '.join(words)) for name, words in startup.FLOORS.items()),
             *((name, startup.HELP) for name in EXECUTABLES), *startup.SMALLEST.items()]
    return [startup.Start(name, line, Timing(0.01 * n, 0.01, 0.5, 5)) for n, (name, line) in enumerate(every, 1)]


@pytest.mark.long
def test_the_page_has_every_executable(tmp_path):
    text = startup.table(rows())
    assert all(f'| `{name}` | ' in text for name in EXECUTABLES)
    assert '| `sim` | 30 | 3.00 | | | |' in text
    assert '| python with numpy | | | `-c import numpy` | 20 | |' in text
    number = 3 + len(EXECUTABLES)       # the first smallest use, which is compared with numpy's 20 ms
    assert f'| `{startup.SMALLEST["table"]}` | {10 * number} | {number / 2:.3g} |' in text
    with np.errstate(all='warn'):
        startup.picture(rows())
        paths = figures.save(startup.picture(rows()), tmp_path / 'startup')
    assert [path.name for path in paths] == ['startup.png', 'startup.svg']
    assert len(startup.csv_text(rows()).splitlines()) == 1 + len(rows())


@pytest.mark.long
def test_a_start_is_measured_in_a_process_of_its_own(monkeypatch):
    assert startup.names() == list(EXECUTABLES)
    monkeypatch.setattr(startup, 'names', lambda: ['table'])
    monkeypatch.setattr(startup, 'SMALLEST', {'export': startup.SMALLEST['export']})
    monkeypatch.setattr(startup, 'timed', lambda job, budget_s: job() or Timing(1.0, 1.0, 1.0, 1))
    assert [row.name for row in startup.measure()] == ['python', 'python with numpy', 'table', 'export']


@pytest.mark.parametrize('name', startup.SMALLEST)
def test_a_use_is_that_of_its_executable(name):
    assert startup.SMALLEST[name].split()[0] == name
