"""The page ``cost contact`` derives its verdicts, growth figures and files correctly from hand-written rows."""
import numpy as np
import pytest

from benchmarks import command, contacts, growth
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.cost.measure import Timing


def search(late_s, wanted_s=None):
    return contacts.Search('look', wanted_s, contacts.T_STAR_S + late_s, 0.0, 10, 0.1)


@pytest.mark.parametrize(('late_s', 'wanted_s', 'verdict'), [
    (0.0, None, 'right'), (1e-7, None, 'right'), (6e-3, None, 'WRONG'), (-6e-3, None, 'WRONG'),
    (9e-4, 1e-3, 'right'), (2e-3, 1e-3, 'WRONG'), (2.7, 1e-12, 'WRONG')])
def test_a_time_is_wrong_where_it_misses_what_was_wanted(late_s, wanted_s, verdict):
    assert search(late_s, wanted_s).verdict == verdict


def checks(power):
    return [growth.Check(method, size, size, True, Timing(*(3 * [1e-6 * size ** power]), 9), 1e-9 * size)
            for method in growth.METHODS for size in (10, 1000, 3000, 10_000)]


def test_growth_is_the_slope_in_logarithms():
    assert growth.exponent(checks(1.5), 'STRtree') == pytest.approx(1.5, rel=1e-12)


@pytest.mark.long
def test_the_page_is_written_as_table_csv_and_pictures(tmp_path):
    rows = contacts.Measured([search(0.0), search(0.5)], checks(1.0), 4e-3)
    with np.errstate(all='warn'):
        paths = command.write('contact', rows, tmp_path)
    assert [path.name for path in paths] == ['contact.md', 'contact.csv', 'contact.png', 'contact.svg']
    assert all(path.stat().st_size for path in paths)
    assert 'WRONG' in contacts.table(rows)
    assert 'N^1.00' in contacts.table(rows)
    assert '| right | 10 | 0.1 | 2.50 |' in contacts.table(rows)       # 10 states of 4 ms each would take 0.04 s
    assert '| 1 | 1,000 | 1,000, 1,000, 1,000, 1,000 |' in contacts.table(rows)


def test_every_method_of_checking_finds_the_same_smallest_gap():
    for size in (10, 223):
        checks = growth.checks_of(size, 0.0)
        assert [check.right for check in checks] == [True] * 4
        assert checks[0].limit_s > 0
        assert {check.limit_s for check in checks} == {checks[0].limit_s}


def test_the_limit_of_a_check_is_to_copy_four_numbers_of_each_bench(monkeypatch):
    monkeypatch.setattr(growth, 'stage_copy_rate', lambda size, budget_s: 1e3 * size)
    assert growth.checks_of(10, 0.0)[0].limit_s == pytest.approx(1e-3)
    monkeypatch.setattr(growth, 'stage_copy_rate', lambda size, budget_s: 1e6)
    assert growth.checks_of(10, 0.0)[0].limit_s == pytest.approx(320e-6)


def test_a_state_is_evaluated_as_sampling_does(monkeypatch):
    seen = []
    monkeypatch.setattr(contacts, '_smallest', lambda scene, t_s: seen.append(t_s))
    monkeypatch.setattr(contacts, 'timed', lambda call, budget_s: Timing(len(call()), 0.0, 0.0, 9))
    assert contacts._state_s(Scene(), 0.0) == 1.0
    assert np.diff(seen) == pytest.approx(contacts.T_STAR_S / (len(seen) - 1))


def test_the_short_contact_of_a_wider_dragon_is_where_the_page_says():
    found = first_contact(Scene(dragon=Dragon(width_m=0.301), run=Run(405.0, 411.0)))
    assert found.benches == (0, 11)
    assert found.t_s == pytest.approx(contacts.WIDER_S, abs=1e-11)
