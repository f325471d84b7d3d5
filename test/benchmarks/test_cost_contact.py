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
    return [growth.Check(method, size, size, True, Timing(*(3 * [1e-6 * size ** power]), 9))
            for method in growth.METHODS for size in (10, 1000, 3000, 10_000)]


def test_growth_is_the_slope_in_logarithms():
    assert growth.exponent(checks(1.5), 'STRtree') == pytest.approx(1.5, rel=1e-12)


def test_the_page_is_written_as_table_csv_and_pictures(tmp_path):
    rows = contacts.Measured([search(0.0), search(0.5)], checks(1.0))
    with np.errstate(all='warn'):
        paths = command.write('contact', rows, tmp_path)
    assert [path.name for path in paths] == ['contact.md', 'contact.csv', 'contact.png', 'contact.svg']
    assert all(path.stat().st_size for path in paths)
    assert 'WRONG' in contacts.table(rows)
    assert 'N^1.00' in contacts.table(rows)


def test_every_method_of_checking_finds_the_same_smallest_gap():
    for size in (10, 223):
        assert [check.right for check in growth.checks_of(size, 0.0)] == [True] * 4


def test_the_short_contact_of_a_wider_dragon_is_where_the_page_says():
    found = first_contact(Scene(dragon=Dragon(width_m=0.301), run=Run(405.0, 411.0)))
    assert found.benches == (0, 11)
    assert found.t_s == pytest.approx(contacts.WIDER_S, abs=1e-11)
