"""The contest's result files have its layout and names, six decimals, and the values of the model."""
import csv
import re
from contextlib import closing
from functools import cache
from zipfile import ZipFile

import pytest
from properties import thinned

from dragon_contest import result_files
from dragon_ros.__main__ import main
from dragon_ros.scenes.load import load_scene


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp('contest')
    result_files.write(path, load_scene('winding'), load_scene('turning'))
    return path


@pytest.fixture(scope='module')
def book(folder):
    """A function that returns the sheets of a workbook as rows of values; an empty cell is an empty string."""
    calamine = pytest.importorskip('python_calamine')

    @cache
    def read(name):
        one = calamine.CalamineWorkbook.from_path(folder / f'{name}.xlsx')
        return {title: one.get_sheet_by_name(title).to_python(skip_empty_area=False) for title in one.sheet_names}
    return read


def rows_of(path):
    with path.open(encoding='utf-8-sig', newline='') as file:
        return list(csv.reader(file))


@pytest.mark.parametrize(('name', 'lines', 'columns', 'first', 'last'), [
    ('result1_positions', 448, ('0 s', '300 s'), '龙头x (m)', '龙尾（后）y (m)'),
    ('result1_speeds', 224, ('0 s', '300 s'), '龙头 (m/s)', '龙尾（后） (m/s)'),
    ('result2', 224, ('横坐标x (m)', '速度 (m/s)'), '龙头', '龙尾（后）'),
    ('result4_positions', 448, ('-100 s', '100 s'), '龙头x (m)', '龙尾（后）y (m)'),
    ('result4_speeds', 224, ('-100 s', '100 s'), '龙头 (m/s)', '龙尾（后） (m/s)')])
def test_files_have_the_rows_and_columns_of_the_contest(folder, name, lines, columns, first, last):
    head, *rows = rows_of(folder / f'{name}.csv')
    assert (head[0], head[1], head[-1]) == ('', *columns)
    assert (len(rows), rows[0][0], rows[-1][0]) == (lines, first, last)
    assert all(len(row) == len(head) for row in rows)
    assert all(len(cell.partition('.')[2]) == 6 and cell != '-0.000000' for row in rows for cell in row[1:])


def test_values_are_the_known_ones(folder):
    head, *rows = rows_of(folder / 'result1_positions.csv')
    by_name = {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows}
    assert (by_name['龙头x (m)']['0 s'], by_name['龙头y (m)']['300 s']) == ('8.800000', '2.320429')
    assert by_name['第1节龙身x (m)']['0 s'] == '8.363824'
    first = rows_of(folder / 'result2.csv')[1]
    assert first == ['龙头', '1.209931', '1.942784', '1.000000']
    head, *rows = rows_of(folder / 'result4_positions.csv')
    by_name = {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows}
    assert (by_name['龙头x (m)']['-100 s'], by_name['龙头y (m)']['-100 s']) == ('7.778034', '3.717164')
    assert (by_name['龙头x (m)']['0 s'], by_name['龙头y (m)']['0 s']) == ('-2.711856', '-3.591078')


def test_books_have_the_same_numbers_under_the_same_names_as_the_text_files(folder, book):
    for name, sheets in {'result1': {'位置': '_positions', '速度': '_speeds'}, 'result2': {'Sheet1': ''}}.items():
        assert list(book(name)) == list(sheets)
        for title, file in sheets.items():
            written = rows_of(folder / f'{name}{file}.csv')
            assert written == [[value if isinstance(value, str) else f'{value:.6f}' for value in cells]
                               for cells in book(name)[title]]


def test_another_reader_of_books_finds_the_same_and_shows_all_numbers_with_six_decimals(folder, book, request):
    openpyxl = pytest.importorskip('openpyxl')
    most = None if request.config.getoption('--long') else 3        # the number of rows that are read
    for name in ('result1', 'result2'):
        with closing(openpyxl.load_workbook(folder / f'{name}.xlsx', read_only=True)) as one:
            for page in one:
                for row, (head, *cells) in zip(book(name)[page.title], page.iter_rows(max_row=most), strict=False):
                    assert [head.value or '', *(cell.value for cell in cells)] == row
                    assert {cell.number_format for cell in cells if isinstance(cell.value, float)} <= {'0.000000'}
                assert isinstance(cells[-1].value, (int, float))


@pytest.mark.parametrize(('name', 'number', 'dimension'), [
    ('result1', 1, 'A1:KP449'), ('result1', 2, 'A1:KP225'), ('result2', 1, 'A1:D225'), ('result4', 1, 'A1:GT449'),
    ('result4', 2, 'A1:GT225')])
def test_every_row_and_cell_states_its_place_and_the_dimension_is_true(folder, name, number, dimension):
    """Other programs, such as SheetJS and ExcelJS, do not count rows and cells themselves."""
    with ZipFile(folder / f'{name}.xlsx') as parts:
        page = parts.read(f'xl/worksheets/sheet{number}.xml').decode()
    assert re.findall(r'<dimension ref="([^"]*)"', page) == [dimension]
    rows = re.findall(r'<row\b([^>]*)>(.*?)</row>', page)
    assert len(rows) == int(re.search(r'\d+$', dimension)[0])
    for line, (attributes, cells) in enumerate(rows, 1):
        assert re.search(r'\br="(\d+)"', attributes)[1] == str(line)
        places = re.findall(r'<c\b[^>]*?\br="([A-Z]+)(\d+)"', cells)
        assert len(places) == cells.count('<c ') > 0
        assert {row for _, row in places} == {str(line)}
        assert places[-1][0] == re.search(r':([A-Z]+)', dimension)[1]


def the_organisers_rows(name, sheet):
    """Return the row names in the organisers' empty result files, taken from copies that teams published.

    The original files are in the repositories julymiaw/CUMCM2024A (all three) and zty2004/CUMCM2024 (result4, the same
    bytes); completed files are in Diraw/Code-for-the-2024-CUMCM-Problems-A and in walker4869/CUMCM-2024-Problem-A.
    """
    names = ['龙头', *(f'第{n}节龙身' for n in range(1, 222)), '龙尾', '龙尾（后）']
    if sheet == '位置':
        return [f'{handle}{axis} (m)' for handle in names for axis in 'xy']
    if sheet == '速度':
        return ['龙头 (m/s)', *(f'{handle}  (m/s)' for handle in names[1:-1]), '龙尾（后） (m/s)']
    return names


@pytest.mark.parametrize(('name', 'heads'), thinned([
    ('result1', [f'{t} s' for t in range(301)]), ('result2', ['横坐标x (m)', '纵坐标y (m)', '速度 (m/s)']),
    ('result4', [f'{t} s' for t in range(-100, 101)])], lambda case: case[0] != 'result4'))
def test_books_have_every_name_of_the_organisers_files_to_the_character(book, name, heads):
    assert list(book(name)) == (['Sheet1'] if name == 'result2' else ['位置', '速度'])
    for title, rows in book(name).items():
        assert rows[0] == ['', *heads]
        assert [row[0] for row in rows] == ['', *the_organisers_rows(name, title)]


@pytest.mark.parametrize(('benches', 'names'), [
    (1, ['龙尾', '龙尾（后）']), (2, ['龙头', '龙尾', '龙尾（后）']),
    (4, ['龙头', '第1节龙身', '第2节龙身', '龙尾', '龙尾（后）'])])
def test_every_handle_has_a_name(benches, names):
    assert result_files.handle_names(benches) == names


def test_without_the_library_text_files_are_written_and_a_line_says_what_is_missing(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(result_files, 'find_spec', lambda _: None)
    code = main(['table', '--contest', str(tmp_path), '--set', 'dragon.benches=20'])
    out, err = capsys.readouterr()
    assert code == 0
    assert len(out.splitlines()) == len(list(tmp_path.iterdir())) == 5
    assert 'pip install openpyxl' in err


@pytest.mark.parametrize('options', [
    ['--contest', 'a', '--times', '0'], ['--contest', 'a', '--output', 'b'], ['--contest', 'a', '--paper'],
    ['--paper', '--scene', 'long'], ['--paper', '--handles', '0'], ['a.mcap', '--scene', 'long'],
    ['a.mcap', '--scene', 'winding'], ['a.mcap', '--contest', 'a'], ['--times', '0', '--namespace', 'b'],
    ['a.mcap', '--accuracy', ''], ['--contest', 'a', '--format', 'csv'], ['--paper', '--times', '']], ids=' '.join)
def test_options_that_a_table_would_ignore_are_rejected(capsys, tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    assert main(['table', *options]) == 2
    out, err = capsys.readouterr()
    assert not out
    assert 'does not accept it' in err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(('change', 'says'), [('dragon.benches=2', 'needs a first '
                                                                   'contact'), ('dragon.benches=0', 'benches')])
def test_what_has_no_result_is_refused(capsys, tmp_path, change, says):
    assert main(['table', '--contest', str(tmp_path / 'a'), '--set', change]) == 2
    assert says in capsys.readouterr().err


def test_text_files_begin_with_the_mark_by_which_excel_knows_utf_8(folder):
    assert all(path.read_bytes().startswith(b'\xef\xbb\xbf') for path in folder.glob('*.csv'))
