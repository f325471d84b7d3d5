"""The page ``cost accuracy`` has rows for tiers, other solvers and integration, and writes its files."""
import numpy as np
import pytest

from benchmarks import command
from hard_cases import hard_cases

CASES = {problem.name: problem for problem in hard_cases()}


@pytest.fixture(scope='module')
def workprec():
    """The module under test, imported only by the first test that needs it because scipy is slow to import."""
    from benchmarks import workprec
    return workprec


@pytest.mark.parametrize('solver', ['table', 'march'])
@pytest.mark.parametrize('name', ['across', 'mixed', 'unwinding', 'wiggle'])
def test_a_tier_keeps_its_promise_on_every_kind_of_track(workprec, name, solver):
    row, = workprec._tiers(CASES[name], [('exact', solver)], 0.0)
    assert row.verdict == 'kept'
    assert row.timing.median_s > 0


def test_a_tier_that_double_precision_cannot_keep_is_refused_in_its_row(workprec):
    kept, row = workprec._tiers(CASES['far-1e6'], [('standard', 'table'), ('fine', 'table')], 0.0)
    assert kept.timing.calls >= 3
    assert (row.verdict, row.note) == ('FAILS', 'rejected: double precision cannot keep this promise')


def test_other_solvers_have_rows_for_single_spirals_alone(workprec):
    named = [job.args[0].name for job in workprec._jobs(0.0) if job.func is workprec._baseline]
    assert {'classic', 'far-1e9', 'mixed'} <= set(named)
    assert not {'turning', 'unwinding', 'long'} & set(named)
    row, = workprec._baseline(CASES['classic'], 'scipy brentq', 0.0)
    assert row.error_m < 1e-9


def test_integration_starts_exactly_and_drifts(workprec):
    from benchmarks.baselines import euler_steps
    chain, advance = euler_steps(CASES['classic'].scene, 0.1)
    assert chain.u[0] == 32 * np.pi
    assert np.all(advance(chain).u < chain.u)
    row, = workprec._euler(CASES['classic'], 1.0)
    assert 1e-3 < row.error_m < 10


def test_the_page_is_written_as_table_csv_and_pictures(workprec, tmp_path):
    rows = workprec._tiers(CASES['classic'], [('fine', 'table'), ('exact', 'table')], 0.0)
    with np.errstate(all='warn'):
        paths = command.write('accuracy', rows, tmp_path)
    assert [path.name for path in paths] == ['accuracy.md', 'accuracy.csv', 'accuracy.png', 'accuracy.svg']
    assert 'all 2 promises hold' in workprec.summary(rows)
