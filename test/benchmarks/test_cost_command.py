"""``./dragon cost`` preserves the pages' text, and measures the pages one by one."""
import pytest

from benchmarks import command
from dragon_ros.cost.measure import circumstances

PAGE = """
def measure(budget_s):
    {body}
def table(rows):
    return 'a table'
def csv_text(rows):
    return ''
def picture(rows):
    from matplotlib.figure import Figure
    return Figure()
"""
NAMES = ('broken', 'last')


def test_a_page_that_is_there_keeps_its_text(tmp_path):
    page = tmp_path / 'effects.md'
    page.write_text('# Effects\n\nFor all.\n\n<!-- cost effects -->\nold\n<!-- end -->\n\nSo much for that.\n')
    command.renew(page, 'effects', 'new')
    assert page.read_text() == ('# Effects\n\nFor all.\n\n<!-- cost effects -->\nnew\n<!-- end -->\n\n'
                                'So much for that.\n')


def test_all_measures_every_page_and_names_the_one_that_fails(tmp_path, monkeypatch, capfd):
    pages = tmp_path / 'pages'
    pages.mkdir()
    for name in NAMES:
        body = "raise ZeroDivisionError('no clock')" if name == 'broken' else 'return []'
        (pages / f'{name}_page.py').write_text(PAGE.format(body=body))
    known = {name: f'{name}_page' for name in NAMES}
    (pages / 'sitecustomize.py').write_text(f'from benchmarks import command\ncommand.PAGES = {known}\n')
    monkeypatch.setenv('PYTHONPATH', f'{pages}:{command._CHECKOUT}')
    monkeypatch.setattr(command, 'PAGES', known)
    assert command.main(['all', '--output', str(tmp_path / 'out')]) == 1
    shown = capfd.readouterr().err
    assert 'page 1 of 2: broken' in shown
    assert 'no clock' in shown
    assert shown.rstrip().endswith('cost: 1 of 2 pages failed: broken')
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {
        f'last.{suffix}' for suffix in ('md', 'csv', 'png', 'svg')}
    (tmp_path / 'out' / 'last.md').write_text(f'<!-- cost last -->\n{circumstances()}. 2 cores.\n<!-- end -->\n')
    assert command.main(['all', '--resume', '--output', str(tmp_path / 'out')]) == 1
    assert 'cost: 1 of 1 pages failed: broken' in capfd.readouterr().err


@pytest.mark.parametrize(('page', 'option', 'value', 'says'), [
    ('tick', '--minutes', '1', '--minutes: page tick does not accept it'),
    ('memory', '--minutes', '0', '--minutes: 0.0 is not valid')])
def test_an_option_that_a_page_does_not_take_is_refused_in_one_line(capsys, page, option, value, says):
    assert command.main([page, option, value]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert len(error.splitlines()) == 1
