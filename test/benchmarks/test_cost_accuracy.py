"""The page ``cost accuracy`` compares the package with strong methods on the classic dragon, and writes its files."""
import numpy as np
import pytest

from benchmarks import command
from benchmarks.stages import multiplications
from dragon_ros.core.step import state

RATES = {'product': 1e9, 'cache': 1e9}


@pytest.fixture(scope='module')
def workprec():
    """The module under test, imported only by the first test that needs it because scipy is slow to import."""
    from benchmarks import workprec
    return workprec


@pytest.fixture(scope='module')
def rows(workprec):
    """A row of each method except the slowest, each call timed once in every pass."""
    slow = ("the paper's recipe", 'Euler, steps of 0.01 s')
    return workprec.timed([one for one in workprec.methods() if one.name not in slow], 0.0)


def error_m(rows, name):
    return next(row.error_m for row in rows if row.name == name)


def test_the_package_is_the_most_accurate_and_strong_methods_come_close(rows):
    ours = max(row.error_m for row in rows if row.is_ours)
    assert ours < 2e-12
    for name in ('numpy, Newton, 301 at once', 'numpy, Newton, 1,000 at once'):
        assert ours < error_m(rows, name) < 1e-11
    assert all(row.error_m < 1e-11 for row in rows if row.name.startswith('numba'))


def test_a_solver_is_as_accurate_as_its_tolerance_lets_it_be(rows):
    assert 1e-5 < error_m(rows, 'plain Newton 1e-3 rad') < 1e-2
    assert error_m(rows, 'plain Newton 1e-6 rad') < 1e-8
    assert error_m(rows, 'scipy brentq') < 1e-8 < 1e-6 < error_m(rows, 'bisection 1e-6 rad')
    assert error_m(rows, 'Euler, steps of 1 s') == pytest.approx(10 * error_m(rows, 'Euler, steps of 0.1 s'), rel=0.1)
    assert [row.name for row in rows if row.verdict] == ['Euler, steps of 1 s', 'Euler, steps of 0.1 s']


def test_a_tick_is_compared_with_the_product_that_places_its_handles(workprec):
    counts = [multiplications(state(workprec.CLASSIC.scene, t_s)) for t_s in workprec.CLASSIC.times_s]
    assert workprec.tick_limit_s(RATES) == pytest.approx(8e-9 * np.mean(counts))
    assert workprec.tick_limit_s(RATES | {'product': 1e8}) == pytest.approx(2e-8 * np.mean(counts))
    assert workprec.batch_limit_s(RATES) == pytest.approx(max(2e-9 * counts[0], 16e-9 * 224))


def test_the_page_is_written_as_table_csv_and_pictures(workprec, rows, tmp_path):
    with np.errstate(all='warn'):
        paths = command.write('accuracy', rows, tmp_path)
    assert [path.name for path in paths] == ['accuracy.md', 'accuracy.csv', 'accuracy.png', 'accuracy.svg']
    assert paths[0].read_text().count('\n| ') == len(rows) + 1
