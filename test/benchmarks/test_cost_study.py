"""The figures on the page ``cost study`` follow from the measurements."""
import csv
import io

import pytest

from benchmarks.command import write

pytest.importorskip('pyarrow')
pytest.importorskip('dragon_studies')


@pytest.fixture(scope='module')
def study():
    """The module under test, imported only by the first test that needs it."""
    from benchmarks import study
    return study


@pytest.fixture
def rows(study):
    return [study.Row(name, workers, 1000, 100.0 / max(1, workers), 90.0, 93.6, 150.0 + workers)
            for name in study.TASKS for workers in (0, 1, 2)]


def test_rates_and_overhead_follow_from_what_was_measured(rows):
    row = rows[2]
    assert row.rate == pytest.approx(20)
    assert row.row_s == pytest.approx(0.09)
    assert row.overhead_s == pytest.approx(0.0036)


def test_the_page_shows_each_row_and_a_million_on_paper(rows, tmp_path):
    paths = write('study', rows, tmp_path)
    assert sorted(path.name for path in paths) == ['study.csv', 'study.md', 'study.png', 'study.svg']
    text = (tmp_path / 'study.md').read_text()
    assert '| its lock | none | 1,000 | 10 | 90 | 3.6 | 4.0% | 150 |' in text
    assert '| its lock | 13 h | 24.4 min | 1.56 min |' in text
    found = list(csv.DictReader(io.StringIO((tmp_path / 'study.csv').read_text())))
    assert [row['workers'] for row in found] == ['0', '1', '2'] * 2


@pytest.mark.long
def test_a_study_is_measured_with_rows_only_and_on_workers(study):
    alone, one = study._alone('its lock', 3), study._on_workers('its lock', 2, 8)
    assert (alone.rows, one.rows, one.workers) == (3, 8, 2)
    assert one.cpu_s > one.work_s > 0
    assert one.memory_mb > 10
