"""The page ``cost accuracy`` has rows for tiers, other solvers and integration, and writes its files."""
import numpy as np
import pytest
from properties import thinned

from benchmarks import command
from benchmarks.stages import multiplications
from dragon_ros.core.model import compile_scene
from dragon_ros.core.step import state
from dragon_ros.cost.measure import Timing
from hard_cases import hard_cases

RATES = {'product': 1e9, 'cache': 1e9}
CASES = {problem.name: problem for problem in hard_cases()}


@pytest.fixture(scope='module')
def workprec():
    """The module under test, imported only by the first test that needs it because scipy is slow to import."""
    from benchmarks import workprec
    return workprec


def timed(workprec, job):
    """Return the rows of one job, each call timed once in every pass."""
    return workprec.timed_jobs([job], 0.0)[1]


@pytest.mark.parametrize('solver', ['table', 'march'])
@pytest.mark.parametrize('name', thinned(['across', 'mixed', 'unwinding', 'wiggle'], lambda name: name != 'across'))
def test_a_tier_keeps_its_promise_on_every_kind_of_track(workprec, name, solver):
    row, = timed(workprec, workprec._tiers(CASES[name], [('exact', solver)]))
    assert row.verdict == 'kept'
    assert row.timing.median_s > 0


def test_other_solvers_have_rows_for_single_spirals_alone(workprec):
    named = [job.args[0].name for job in workprec._jobs() if job.func is workprec._baseline]
    assert {'classic', 'longest-track', 'mixed'} <= set(named)
    assert not {'turning', 'unwinding', 'most-benches'} & set(named)
    row, = timed(workprec, workprec._baseline(CASES['mixed'], 'scipy brentq'))
    assert row.error_m < 1e-9


def test_integration_starts_exactly_and_drifts(workprec):
    from benchmarks.baselines import euler_steps
    chain, advance = euler_steps(CASES['classic'].scene, 0.1)
    assert chain.u[0] == 32 * np.pi
    assert np.all(advance(chain).u < chain.u)
    row, = timed(workprec, workprec._euler(CASES['classic'], 1.0))
    assert 1e-3 < row.error_m < 10


def test_a_tick_is_compared_with_the_product_that_places_its_handles(workprec):
    problem = CASES['classic']
    counts = [multiplications(state(problem.scene, t_s)) for t_s in problem.times_s]
    assert workprec.tick_limit_s(problem, RATES) == pytest.approx(8e-9 * np.mean(counts))
    assert workprec.tick_limit_s(problem, RATES | {'product': 1e8}) == pytest.approx(2e-8 * np.mean(counts))
    assert workprec.batch_limit_s(problem.scene, [0.0, problem.times_s[0], 1.0], RATES) == pytest.approx(
        max(2e-9 * counts[0], 16e-9 * 224))


def test_without_a_table_a_tick_takes_at_least_its_coordinates(workprec):
    problem = next(one for one in CASES.values() if not compile_scene(one.scene).model.placement.leader_map)
    assert workprec.tick_limit_s(problem, RATES) == pytest.approx(16e-9 * (problem.scene.dragon.benches + 1))


def test_a_line_shows_the_time_as_a_multiple_of_its_limit(workprec):
    timing = Timing(3e-5, 2e-5, 4e-5, 9)
    row = workprec.Row('classic', 'exact', 1e-15, 2e-12, timing, 'table', timing, 2e-6)
    assert '| kept | 30 | 20 to 40 | 15 | 30 | table |' in workprec.table([row])
    assert '| 20 to 40 | - | 30 |' in workprec.table([workprec.replace(row, limit_s=0.0)])


@pytest.mark.long
def test_the_page_is_written_as_table_csv_and_pictures(workprec, tmp_path):
    rows = timed(workprec, workprec._tiers(CASES['classic'], [('fine', 'table'), ('exact', 'table')]))
    with np.errstate(all='warn'):
        paths = command.write('accuracy', rows, tmp_path)
    assert [path.name for path in paths] == ['accuracy.md', 'accuracy.csv', 'accuracy.png', 'accuracy.svg']
