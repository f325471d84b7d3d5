"""The page ``cost limits`` compares the stages of a tick with the rates that the machine can reach."""
import pytest

from benchmarks import command, limits, rates
from benchmarks.rates import times
from benchmarks.stages import STAGES, multiplications, needs_of
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state, tick
from dragon_ros.cost.measure import Timing
from dragon_ros.messages.encode import encoders

RATES = dict.fromkeys(limits._RATES, 1e9)


def test_a_limit_is_the_longest_of_what_its_amounts_take():
    stage = limits.Stage('a stage', Timing(1e-5, 1e-5, 1e-5, 20), {'product': 3000.0, 'cache': 2000.0})
    assert stage.limit(RATES) == (pytest.approx(3e-6), 'product')
    assert stage.limit(RATES | {'cache': 1e8}) == (pytest.approx(2e-5), 'cache')


def test_a_state_takes_a_product_of_its_terms_with_all_coordinates():
    chain = state(Scene(), 300.0)
    terms = max(product.terms for part in chain.parts for product in getattr(part, 'products', ()))
    assert multiplications(chain) == terms * 2 * 223        # the head's own link is marched
    needs = needs_of(Scene(), 300.0)
    assert tuple(needs) == STAGES
    assert needs['chain'] == needs['velocities'] == {'product': 2 * terms * 446, 'cache': 8 * terms * 446}
    assert needs['benches'] == {'cache': 8 * (2 * 224 + 4 * 223)}
    assert needs['look'] == {'cache': 8 * 4 * 223}
    assert needs['encode'] == {'cache': sum(len(one(tick(Scene(), 0))) for one in encoders(Scene()).values())}


def test_without_a_table_a_state_takes_at_least_its_coordinates():
    assert needs_of(Scene(dragon=Dragon(3)), 0.0)['chain'] == {'product': 0.0, 'cache': 8 * 2 * 4}


@pytest.mark.parametrize(('value', 'least', 'shown'), [
    (3.0, 2.0, '1.50'), (9.996, 1.0, '10'), (22.25, 1.0, '22.2'), (99.96, 1.0, '100'), (12_345.0, 10.0, '1,234'),
    (1.0, 0.0, '-')])
def test_a_ratio_has_three_digits_and_needs_a_limit(value, least, shown):
    assert times(value, least) == shown


def test_rates_are_amounts_over_the_time_that_is_measured(monkeypatch, tmp_path):
    monkeypatch.setattr(rates, 'timed', lambda call, budget_s: Timing(*(3 * [0.5]), bool(call())))
    assert rates.copy_rate(1e6, 0.0) == 2e6
    assert rates.copy_rate(10, 0.0) == 2 * 2**15
    assert rates.stage_copy_rate(1e6, 0.0) == rates.copy_rate(5e5, 0.0)
    assert rates.compression_rate('lz4', bytes(1000), 0.0) == 2000
    assert rates.file_rate(tmp_path, 0.0) == 2 * (tmp_path / 'block').stat().st_size
    assert rates.limit({}, {}) == (0.0, '')


def test_the_page_is_written_as_table_csv_and_pictures(tmp_path):
    stages = [limits.Stage(name, Timing(1e-5, 0.9e-5, 1.1e-5, 20), {rate: 5000.0})
              for name, rate in (('one', 'product'), ('other', 'zstd'))]
    paths = command.write('limits', limits.Measured(RATES, stages), tmp_path)
    assert [path.name for path in paths] == ['limits.md', 'limits.csv', 'limits.png', 'limits.svg']
    assert '| other | 10 | 5 | 2.0 | zstd |' in paths[0].read_text()


@pytest.mark.parametrize('stage', [limits._place, limits._velocities, limits._benches, limits._look, limits._messages])
def test_every_stage_is_timed_and_has_a_limit(stage):
    found = stage(0.0)
    assert found.timing.median_s > 0
    assert found.limit(RATES)[0] > 0
