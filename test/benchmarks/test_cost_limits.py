"""The page ``cost limits``: the stages of a tick are compared with the machine's own rates."""
import pytest

from benchmarks import command, limits
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.cost.measure import Timing

RATES = dict.fromkeys(limits._RATES, 1e9)


def test_a_limit_is_the_longest_of_what_its_amounts_take():
    stage = limits.Stage('a stage', Timing(1e-5, 1e-5, 1e-5, 20), {'product': 3000.0, 'cache': 2000.0})
    assert stage.limit(RATES) == (pytest.approx(3e-6), 'product')
    assert stage.limit(RATES | {'cache': 1e8}) == (pytest.approx(2e-5), 'cache')


def test_a_state_takes_a_product_of_its_terms_with_all_coordinates():
    part, = state(Scene(), 300.0).parts
    terms = max(product.terms for product in part.products)
    assert limits._products(300.0) == terms * 2 * 224


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
