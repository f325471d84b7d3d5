"""``cost``: pages that keep their text, the README's rows, and all pages one after the other."""
from dragon_ros.cost import command

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
NAMES = ('quick', 'broken', 'last')


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
    (pages / 'sitecustomize.py').write_text(f'from dragon_ros.cost import command\ncommand.PAGES = {known}\n')
    monkeypatch.setenv('PYTHONPATH', f'{pages}:{command._CHECKOUT}')
    monkeypatch.setattr(command, 'PAGES', known)
    assert command.main(['all', '--output', str(tmp_path / 'out')]) == 1
    shown = capfd.readouterr().err
    assert 'page 2 of 3: broken' in shown
    assert 'no clock' in shown
    assert shown.rstrip().endswith('cost: 1 of 3 pages failed: broken')
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {
        f'{name}.{suffix}' for name in ('quick', 'last') for suffix in ('md', 'csv', 'png', 'svg')}
