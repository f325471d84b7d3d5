"""Grading of files: students' layouts, folders of teams, reports, and hostile or broken workbooks."""
import io
import json
import os
import re
import signal
import subprocess
import sys
import zipfile
from functools import cache
from pathlib import Path
from shutil import copy
from threading import Event

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import children
from properties import thinned

from dragon_contest import limits
from dragon_contest.grade import folders, reading, report
from dragon_contest.grade.diagnosis import RIGHT
from dragon_contest.grade.folders import grade_all, teams_of
from dragon_contest.grade.reading import read_book
from dragon_contest.grade.tables import json_text
from dragon_contest.grade.team import Team, grade_team
from dragon_contest.grade.truth import truth_at
from dragon_contest.result_files import handle_names
from dragon_ros.__main__ import main
from dragon_ros.cli.progress import Progress
from dragon_ros.core.errors import InputError

ROOT = Path(__file__).parents[2]
NAMES = handle_names(223)
TIMES = np.array([0.0, 60.0, 240.0, 300.0])
STATE = truth_at('result1', TIMES)
P, V = np.round(STATE.handles_m, 6), np.round(STATE.speed_m_s, 6)
PLACES = [[f'{name}{axis} (m)', *P[:, k, n].tolist()] for k, name in enumerate(NAMES) for n, axis in enumerate('xy')]
SPEEDS = [[f'{name} (m/s)', *V[:, k].tolist()] for k, name in enumerate(NAMES)]
SPEED_ROWS = [[name, *V[:, k].tolist()] for k, name in enumerate(NAMES)]
HEAD = ['', *(f'{t:g} s' for t in TIMES)]


def new_book():
    return pytest.importorskip('openpyxl').Workbook()


def book(path, **sheets):
    made = new_book()
    made.remove(made.active)
    for name, rows in sheets.items():
        page = made.create_sheet(name)
        for row in rows:
            page.append([None if cell == '' else cell for cell in row])
    made.save(path)
    return path


def transposed(rows):
    return [list(row) for row in zip(*rows, strict=True)]


def contest():
    return {'位置': [HEAD, *PLACES], '速度': [HEAD, *SPEEDS]}


def as_text(point):
    return {name: [rows[0], *([row[0], *(f'{cell:.6f}'.replace('.', point) for cell in row[1:])] for row in rows[1:])]
            for name, rows in contest().items()}


LAYOUTS = {
    'contest': contest,
    'other names of sheets': lambda: {'Sheet1': [HEAD, *PLACES], 'Sheet2': [HEAD, *SPEEDS]},
    'transposed': lambda: {name: transposed(rows) for name, rows in contest().items()},
    'title rows': lambda: {'位置': [['板凳龙位置结果'], [], HEAD, *PLACES], '速度': [['各把手速度'], HEAD, *SPEEDS]},
    'one sheet': lambda: {'result': [HEAD, *PLACES, *SPEEDS]},
    'english': lambda: {
        'positions': [['', *(f't={t:g}' for t in TIMES)],
                      *([f'{name} {axis}', *P[:, k, n].tolist()] for k, name in enumerate(english())
                        for n, axis in enumerate('xy'))],
        'speed': [['', *(f't={t:g}' for t in TIMES)],
                  *([name, *V[:, k].tolist()] for k, name in enumerate(english()))]},
    'bare numbers': lambda: {'位置': [['', *TIMES.tolist()], *PLACES], '速度': [['', *TIMES.tolist()], *SPEEDS]},
    'grouped headings': lambda: {'all': [
        ['', *(cell for t in TIMES for cell in (f'{t:g} s', '', ''))], ['', *['x', 'y', '速度'] * len(TIMES)], *(
            [name, *(cell for n in range(len(TIMES)) for cell in (*P[n, k].tolist(), float(V[n, k])))]
            for k, name in enumerate(NAMES))]},
    'long': lambda: {'data': [['time', 'handle', 'x', 'y', 'v'], *(
        [t, k, *P[n, k].tolist(), float(V[n, k])] for n, t in enumerate(TIMES.tolist()) for k in range(224))]},
    'numbers as text': lambda: as_text('.'),
    'decimal commas': lambda: as_text(','),
    'x first, then y': lambda: {'位置': [HEAD, *PLACES[::2], *PLACES[1::2]], '速度': [HEAD, *SPEEDS]},
    'sorted by name': lambda: {'位置': [HEAD, *sorted(PLACES)], '速度': [HEAD, *sorted(SPEEDS)]},
    'sections from 1': lambda: {'data': [['time', 'section', 'x', 'y', 'v'], *(
        [t, k + 1, *P[n, k].tolist(), float(V[n, k])] for n, t in enumerate(TIMES.tolist()) for k in range(224))]},
    'time and axis in one label': lambda: {
        '位置': [['把手', *(f'{t:g}_{axis}' for axis in 'xy' for t in TIMES)], *(
            [name, *P[:, k, 0].tolist(), *P[:, k, 1].tolist()] for k, name in enumerate(NAMES))],
        '速度': [['把手', *(f'v_{t:g}' for t in TIMES)], *SPEED_ROWS]},
    'times of day': lambda: {name: [['', *(t / 86400 for t in TIMES.tolist())], *rows[1:]]
                             for name, rows in contest().items()},
    'dates': lambda: {name: [['', *(45000 + t for t in TIMES.tolist())], *rows[1:]]
                      for name, rows in contest().items()},
    'clocks': lambda: {name: [['', *(f'2024-09-06 00:{t // 60:02d}:{t % 60:02d}' for t in TIMES.astype(int).tolist())],
                              *rows[1:]] for name, rows in contest().items()},
    'two columns of labels': lambda: {
        '位置': [['把手', '坐标', *HEAD[1:]], *([name if axis == 'x' else '', axis, *P[:, k, n].tolist()]
                                            for k, name in enumerate(NAMES) for n, axis in enumerate('xy'))],
        '速度': [HEAD, *SPEEDS]}}


def english():
    return ['head', *(f'section {n}' for n in range(1, 222)), 'tail', 'tail (rear)']


READERS = 'python_calamine', 'openpyxl'


@pytest.fixture(params=READERS)
def reader(request, monkeypatch):
    pytest.importorskip(request.param)
    monkeypatch.setattr(reading, 'find_spec', lambda name: name if name == request.param else None)
    return request.param


@pytest.mark.parametrize(('layout', 'reader'), thinned(
    [(layout, reader) for layout in LAYOUTS for reader in READERS],
    lambda case: case[0] in ('grouped headings', 'numbers as text') or case in (
        (layout, READERS[0]) for layout in ('decimal commas', 'title rows', 'english', 'long', 'sorted by name',
                                            'transposed'))),
    indirect=['reader'])
def test_layouts_of_students_are_read_to_the_last_cell(layout, tmp_path, reader):
    grade = grade_team(Team('a', [book(tmp_path / 'result1.xlsx', **LAYOUTS[layout]())]))
    assert grade.problems == ()
    assert [(one.sheet, one.verdict, one.cells) for one in grade.sheets] == [
        ('positions', 'incomplete', 224 * 2 * len(TIMES)), ('speeds', 'incomplete', 224 * len(TIMES))]
    assert max(one.worst for one in grade.sheets) <= RIGHT
    if layout == 'transposed':
        assert [key for key, _ in grade.notes] == ['transposed', 'transposed']


def test_missing_and_empty_sheets_and_other_names_are_told(tmp_path):
    path = book(tmp_path / 'result4.xlsx', 位置=[HEAD, *PLACES], 速度=[])
    grade = grade_team(Team('a', [path, path]))
    assert [one.verdict for one in grade.sheets] == ['incomplete', 'missing']
    assert [key for key, _ in grade.notes] == ['sheet_empty', 'sheet_empty', 'other_result', 'given_twice']


def result_4_rows(unit=1.0):
    times = np.arange(-100.0, 101.0)
    p, v = truth_at('result4', times)
    head = ['', *(f'{t:g} s' for t in times)]
    return {'位置': [head, *([f'{name}{axis}', *np.round(p[:, k, n], 6).tolist()] for k, name in enumerate(NAMES)
                           for n, axis in enumerate('xy'))],
            '速度': [head, *([name, *np.round(unit * v[:, k], 6).tolist()] for k, name in enumerate(NAMES))]}


def verdicts(grade):
    return {(one.result, one.sheet): one.verdict for one in grade.sheets}


@pytest.mark.parametrize('order', [1, -1])
def test_a_misnamed_file_does_not_displace_the_right_one(tmp_path, order):
    files = [book(tmp_path / 'result1.xlsx', **result_4_rows(2.0)), book(tmp_path / 'result4.xlsx', **result_4_rows())]
    grade = grade_team(Team('a', files[::order]))
    assert verdicts(grade) == {('result4', 'positions'): 'right', ('result4', 'speeds'): 'right'}
    assert grade.notes == (('misnamed', {'name': 'result1.xlsx', 'held': 'result4'}),)


def test_a_table_of_one_state_in_a_file_that_is_named_after_another_result_is_not_understood(tmp_path):
    state = truth_at('result2', np.array([np.nan]))
    rows = [['', 'x', 'y', '速度'], *([name, *np.round(p, 6).tolist(), round(v, 6)] for name, p, v in zip(
        NAMES, state.handles_m[0], state.speed_m_s[0].tolist(), strict=True))]
    grade = grade_team(Team('a', [book(tmp_path / 'result1.xlsx', a=rows)]))
    assert verdicts(grade) == dict.fromkeys([('result1', 'positions'), ('result1', 'speeds')], 'not_understood')
    assert grade.sheets[0].reason.key == 'untimed'
    grade = grade_team(Team('a', [book(tmp_path / 'touching.xlsx', a=rows)]))
    assert verdicts(grade) == dict.fromkeys([('result2', 'positions'), ('result2', 'speeds')], 'right')


def test_columns_whose_times_are_not_understood_are_never_wrong(tmp_path):
    odd = {name: [['', 'first', 'second', 'third', 'last'], *rows[1:]] for name, rows in contest().items()}
    grade = grade_team(Team('a', [book(tmp_path / 'result1.xlsx', **odd)]))
    assert set(verdicts(grade).values()) == {'not_understood'}
    assert {one.reason.key for one in grade.sheets} == {'contradictory'}
    assert 'not understood' in grade.problems[0].line()


@pytest.mark.parametrize(('columns', 'result'), [(slice(0, 2), 'result2'), (slice(0, 3), 'result2')])
def test_plain_numbers_of_the_right_shape_are_read_in_order(tmp_path, columns, result):
    state = truth_at('result2', np.array([np.nan]))
    cells = np.column_stack((state.handles_m[0], state.speed_m_s[0]))[:, columns]
    grade = grade_team(Team('a', [book(tmp_path / 'a.xlsx', a=np.round(cells, 6).tolist())]))
    assert verdicts(grade) == {(result, 'positions'): 'right', (result, 'speeds'): (
        'right' if cells.shape[1] == 3 else 'missing')}
    assert [key for key, _ in grade.notes] == ['without_labels']


def test_plain_numbers_of_all_times_are_read_in_order(tmp_path):
    times = np.arange(-100.0, 101.0)
    p, v = (np.round(one, 6) for one in truth_at('result4', times))
    grade = grade_team(Team('a', [book(tmp_path / 'result4.xlsx', a=p.reshape(201, 448).T.tolist(), b=v.T.tolist())]))
    assert set(verdicts(grade).values()) == {'right'}
    assert [key for key, _ in grade.notes] == ['without_labels', 'without_times'] * 2


def test_a_row_too_many_is_named_and_the_others_are_right(tmp_path):
    state = truth_at('result2', np.array([np.nan]))
    p = np.concatenate((state.handles_m[0], [[9.0, 9.0]]))
    names = ['龙头', *(f'第{n}节龙身' for n in range(1, 223)), '龙尾', '龙尾（后）']
    again = np.insert(state.handles_m[0], 222, state.handles_m[0, 222], axis=0)
    for extra, rows in (('in order', p), ('twice', again)):
        path = book(tmp_path / f'{extra}.xlsx', a=[['', 'x', 'y'], *([name, *np.round(one, 6).tolist()] for name, one
                                                                      in zip(names, rows, strict=True))])
        grade = grade_team(Team('a', [path]))
        assert verdicts(grade)['result2', 'positions'] == 'right'
        assert [key for key, _ in grade.notes] == ['row_too_many']


def test_the_blank_template_is_named(tmp_path):
    path = book(tmp_path / 'result1.xlsx', **{name: [rows[0], *([row[0]] for row in rows[1:])]
                                              for name, rows in contest().items()})
    grade = grade_team(Team('a', [path]))
    assert [(one.verdict, one.reason.key) for one in grade.sheets] == [('missing', 'template')] * 2


def test_one_workbook_may_contain_all_results(tmp_path):
    sheets = {f'result1 {name}': rows for name, rows in contest().items()}
    sheets |= {f'result4 {name}': rows for name, rows in result_4_rows().items()}
    grade = grade_team(Team('a', [book(tmp_path / 'all.xlsx', **sheets)]))
    assert verdicts(grade) == {('result1', 'positions'): 'incomplete', ('result1', 'speeds'): 'incomplete',
                               ('result4', 'positions'): 'right', ('result4', 'speeds'): 'right'}


@pytest.mark.parametrize('encoding', ['utf-8-sig', 'gb18030', 'utf-16'])
@pytest.mark.parametrize('separator', [',', ';', '\t'])
def test_the_contests_csv_files_are_one_team(tmp_path, separator, encoding):
    for name, rows in (('positions', contest()['位置']), ('speeds', contest()['速度'])):
        text = '\n'.join(separator.join(str(cell).replace('.', ',' if separator == ';' else '.') for cell in row)
                         for row in rows)
        (tmp_path / f'result1_{name}.csv').write_text(text, encoding=encoding)
    (team,) = teams_of([tmp_path])
    grade = grade_team(team)
    assert (set(verdicts(grade).values()), grade.problems) == ({'incomplete'}, ())
    assert max(one.worst for one in grade.sheets) <= RIGHT


@pytest.mark.parametrize('value', ['#DIV/0!', True, 1e308, -1e308])
def test_a_cell_that_is_no_sensible_number_is_one_wrong_or_missing_cell(tmp_path, reader, value):
    rows = [HEAD, *map(list, PLACES[:40])]
    rows[5][2] = value
    grade = grade_team(Team('a', [book(tmp_path / 'result1.xlsx', 位置=rows)]))
    assert (grade.problems, grade.notes) == ((), ())
    positions = grade.sheets[0]
    if isinstance(value, float):
        assert ([one.key for one in positions.findings], positions.verdict) == (['few_cells'], 'wrong')
        assert positions.cells == 40 * len(TIMES)
    else:
        assert (positions.cells, positions.verdict) == (40 * len(TIMES) - 1, 'incomplete')
        assert positions.worst <= RIGHT


def changed(data, **parts):
    """Return a workbook in which the given parts are replaced; None omits a part."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, 'w', zipfile.ZIP_DEFLATED) as new:
        for entry in old.infolist():
            if entry.filename not in parts:
                new.writestr(entry.filename, old.read(entry))
        for name, part in parts.items():
            if part is not None:
                new.writestr(name, part)
    return out.getvalue()


SHEET = 'xl/worksheets/sheet1.xml'
PAGE = ('<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>')


@cache
def plain_book():
    out = io.BytesIO()
    made = new_book()
    made.active['A1'], made.active['B2'] = 'x', 1.5
    made.save(out)
    return out.getvalue()


def broken_lzma():
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(plain_book())) as old, zipfile.ZipFile(out, 'w', zipfile.ZIP_LZMA) as new:
        for entry in old.infolist():
            new.writestr(entry.filename, old.read(entry))
        starts = [entry.header_offset + 30 + len(entry.filename) for entry in new.infolist()]
    data = bytearray(out.getvalue())
    for start in starts:
        data[start + 8:start + 40] = b'\xff' * 32
    return bytes(data)


def merged_book():
    out = io.BytesIO()
    made = new_book()
    for row in [HEAD, *PLACES[:9]]:
        made.active.append(row)
    made.active.merge_cells('B5:C6')
    made.save(out)
    return out.getvalue()


def shared(texts, cells):
    """Return a workbook with shared texts; in cells, {0} counts rows."""
    rows = ''.join(f'<row r="{n}">{cell}</c></row>' for n, cell in enumerate(cells.split('</c>')[:-1], 1))
    return changed(plain_book(), **{'xl/sharedStrings.xml': f'<sst>{texts}</sst>', SHEET: PAGE.format(
        re.sub(r'r="A\{0\}"', '', rows))})


WORKBOOK = ('<workbook xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main" xmlns:r="http://schemas.'
            'openxmlformats.org/officeDocument/2006/relationships"><sheets>{}</sheets></workbook>')
UNPACKED_BYTES = 3 * 10**6      # less than the package's limit, because larger workbooks take longer to make
HOSTILE = {
    'empty file': (lambda: b'', 'is empty'), 'no zip': (lambda: b'x,y\n1,2\n', 'is not an XLSX'),
    'truncated': (lambda: plain_book()[:-400], 'damaged or truncated'),
    'xls': (lambda: b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1' + bytes(512), 'Excel 97'),
    'password': (lambda: b'\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1' + 'EncryptedPackage'.encode('utf-16-le'), 'password'),
    'macros': (lambda: changed(plain_book(), **{'xl/vbaProject.bin': b'x'}), 'contains macros'),
    'links': (lambda: changed(plain_book(), **{'xl/externalLinks/externalLink1.xml': '<a/>'}), 'links to other'),
    'formula': (lambda: changed(plain_book(), **{SHEET: PAGE.format('<row r="1"><c r="A1"><f>1+1</f></c></row>')}),
                'formula without a value in A1'),
    'formula, empty value': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        '<row r="1"><c r="B1" t="n"><f>A1</f><v></v></c></row>')}), 'formula without a value in B1'),
    'merged': (merged_book, 'cells B5:C6 are merged'),
    'million rows': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        '<row r="1048576"><c r="A1048576"><v>1</v></c></row>')}), '1048576 rows'),
    'far column': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        '<row r="1"><c r="XFD1"><v>1</v></c></row>')}), '16384 columns'),
    'no space before a position': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        '<row r="1"><c t="str"r="XFD1"><v>1</v></c></row>')}), '16384 columns'),
    'two positions': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        '<row r="1"><c r="A1"r="XFD1"><v>1</v></c></row>')}), '16384 columns'),
    'leading zeros': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        '<row r="1"><c r="A0000001048576"><v>1</v></c></row>')}), '1048576 rows'),
    'far below its row': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        '<row r="1"><c r="A1"><v>1</v></c><c r="ZZ99999"><v>1</v></c></row>')}), '70199298 cells'),
    'cells with a prefix': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        f'<row>{"<x:c><v>1</v></x:c>" * 2001}</row>').replace('<worksheet ', '<worksheet xmlns:x="x" ')}), 'columns'),
    'many unnamed rows': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        '<row><c><v>1</v></c></row>' * 100_001)}), 'rows'),
    'wide and long': (lambda: changed(plain_book(), **{SHEET: PAGE.format(
        f'<row>{"<c><v>1</v></c>" * 1500}</row>' + '<row><c><v>1</v></c></row>' * 3000)}), 'cells'),
    'bomb': (lambda: changed(plain_book(), **{SHEET: PAGE.format(' ' * (UNPACKED_BYTES + 1))}),
             'unpacks to'),
    'entities': (lambda: changed(plain_book(), **{SHEET: '<!DOCTYPE a [<!ENTITY b "c">]>' + PAGE.format('')}),
                 'plain XML'),
    'many parts': (lambda: changed(plain_book(), **{f'a{n}': b'' for n in range(limits.BOOK_PARTS)}), 'files; the'),
    'no sheets': (lambda: changed(plain_book(), **{SHEET: None}), 'contains no sheets'),
    'no xml': (lambda: changed(plain_book(), **{SHEET: 'x'}), ''),
    'broken LZMA': (lambda: broken_lzma(), 'damaged'),
    'no workbook': (lambda: changed(plain_book(), **{'xl/workbook.xml': '<'}), 'damaged'),
    'text in many cells': (lambda: shared(f'<si><t>{"x" * 30_000}</t></si>', '<c r="A{0}" t="s"><v>0</v></c>' * 600),
                           'the texts of its cells'),
    'text behind an entity': (lambda: shared(f'<si><t>{"x" * 30_000}</t></si>',
                                             '<c r="A{0}" t="s"><v>&#48;</v></c>' * 600), 'the texts of its cells'),
    'text in a comment': (lambda: shared('<si/>', '<c r="A{0}" t="s"><v><!-- -->0</v></c>'), 'plain XML'),
    'empty texts': (lambda: shared('<si/>' * (limits.BOOK_TEXTS + 1), ''), 'texts; the limit'),
    'relationships': (lambda: changed(plain_book(), **{'xl/_rels/workbook.xml.rels': '<Relationships>' + (
        '<Relationship Id="a"/>' * 60_000) + '</Relationships>'}), 'limit for a list of parts'),
    'a sheet many times': (lambda: changed(plain_book(), **{'xl/workbook.xml': WORKBOOK.format(
        '<sheet name="{0}" sheetId="{0}" r:id="rId1"/>' * 51)}), '51 sheets; the limit'),
    'a large sheet ten times': (lambda: changed(plain_book(), **{'xl/workbook.xml': WORKBOOK.format(
        '<sheet name="{0}" sheetId="{0}" r:id="rId1"/>' * 10), SHEET: PAGE.format(
        '<row r="1000"><c r="ABA1000"><v>1</v></c></row>')}), 'cells; the limit for a workbook'),
    'tags without ends': (lambda: changed(plain_book(), **{SHEET: PAGE.format('<c ' * 10**5 + 'f>')}), ''),
}


# Most of these files are rejected before a reader opens them.
@pytest.mark.parametrize(('name', 'reader'), thinned(
    [(name, reader) for name in HOSTILE for reader in READERS],
    lambda case: case[1] == READERS[0] or case[0] in ('no sheets', 'no xml', 'no workbook')), indirect=['reader'])
def test_a_hostile_or_broken_workbook_is_refused_in_one_line(name, tmp_path, capsys, monkeypatch, reader):
    make, says = HOSTILE[name]
    monkeypatch.setattr(reading, 'BOOK_UNPACKED_BYTES', UNPACKED_BYTES)
    (tmp_path / 'result1.xlsx').write_bytes(make())
    assert main(['grade', str(tmp_path / 'result1.xlsx')]) == 2
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert said.startswith('grade: ')
    assert says in said


_LETTERS = st.sampled_from(['A', 'B', 'c', 'Z', 'AA', 'aB', 'ZZ', 'AAA', 'AB'])
_PREFIXES = st.sampled_from(['', '', '', 'x:'])
_POSITIONS = st.builds('{}{}{}{}"{}{}{}"'.format, st.sampled_from([' ', '\n', ' s="1" ', ' s="1"']), st.just('r'),
                       st.sampled_from(['=', ' =']), st.sampled_from(['', ' ']), _LETTERS,
                       st.sampled_from(['', '0', '0000000000']), st.integers(1, 300))


@given(rows=st.lists(st.tuples(_PREFIXES, st.one_of(st.just(''), st.integers(1, 300).map(' r="{}"'.format)), st.lists(
    st.tuples(_PREFIXES, st.one_of(st.just(''), _POSITIONS)), max_size=4)), max_size=4))
def test_the_size_of_a_sheet_is_never_underrated_whatever_way_positions_are_written(rows):
    calamine = pytest.importorskip('python_calamine')
    text = ''.join(f'<{before}row{place}>' + ''.join(f'<{own}c{where}><v>1</v></{own}c>' for own, where in cells)
                   + f'</{before}row>' for before, place, cells in rows)
    data = changed(plain_book(), **{SHEET: PAGE.format(text).replace('<worksheet ', '<worksheet xmlns:x="x" ')})
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        page = archive.read(SHEET)
    found = calamine.CalamineWorkbook.from_filelike(io.BytesIO(data)).get_sheet_by_index(0).to_python(
        skip_empty_area=False)
    most_rows, most_columns = reading._extent(page)
    assert (len(found) <= most_rows, max(map(len, found), default=0) <= most_columns) == (True, True)


def test_merged_headings_are_read(tmp_path):
    path = tmp_path / 'result1.xlsx'
    made = new_book()
    for row in [['板凳龙'], HEAD, *PLACES]:
        made.active.append([None if cell == '' else cell for cell in row])
    made.active.merge_cells('A1:E1')
    made.save(path)
    positions = grade_team(Team('a', [path])).sheets[0]
    assert (positions.verdict, positions.cells) == ('incomplete', 224 * 2 * len(TIMES))


def test_values_of_formulas_are_read_and_never_computed(tmp_path, reader):
    path = tmp_path / 'a.xlsx'
    path.write_bytes(changed(plain_book(), **{SHEET: PAGE.format(
        '<row r="1"><c r="A1"><f>1+1</f><v>7</v></c></row>')}))
    assert read_book(path)[0].rows == [[7.0]]


def test_macros_in_a_file_that_is_called_xlsm_are_refused_in_a_folder_too(tmp_path):
    (tmp_path / 'a').mkdir()
    (tmp_path / 'a' / 'result1.xlsm').write_bytes(changed(plain_book(), **{'xl/vbaProject.bin': b'x'}))
    (grade,) = map(grade_team, teams_of([tmp_path]))
    assert 'contains macros' in grade.problems[0].line()


@pytest.fixture(scope='module')
def room(tmp_path_factory):
    """A class of four teams: two with their own folders, and two that share a folder."""
    folder = tmp_path_factory.mktemp('room')
    right = book(tmp_path_factory.mktemp('right') / 'result1.xlsx', **contest())
    for name in ('一队', '<script>alert(1)</script>'.replace('/', '_')):
        (folder / name).mkdir()
        copy(right, folder / name)
    (folder / '一队' / 'answers.yaml').write_text('turn_m: 13.7146\n')
    (folder / 'both').mkdir()
    for colour in ('red', 'blue'):
        copy(right, folder / 'both' / f'{colour}_result1.xlsx')
        book(folder / 'both' / f'{colour}_result2.xlsx', a=[['', 'x', 'y', '速度'], ['龙头', 1.209931, 1.942784, 1.0]])
    return folder


def test_a_folder_has_a_team_for_each_folder_and_for_each_name(room):
    assert sorted(team.name for team in teams_of([room])) == ['<script>alert(1)<_script>', 'blue', 'red', '一队']


def test_a_folder_without_any_readable_workbook_is_bad_input(tmp_path, capsys):
    for team in ('a', 'b'):
        (tmp_path / team).mkdir()
        (tmp_path / team / 'result1.xlsx').write_bytes(b'')
    assert main(['grade', str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out.count('is empty') == 2
    assert out.count('not readable') == 4
    assert err == f'grade: {tmp_path}/a/result1.xlsx: is empty; save it as an Excel workbook (.xlsx)\n'


@pytest.fixture
def crowd(tmp_path):
    """A class in which most folders have no readable workbook."""
    folder = tmp_path / 'class'
    for name in ('book', 'csv', 'pdf', 'empty', 'merged'):
        (folder / name).mkdir(parents=True)
    book(folder / 'book' / 'result1.xlsx', **contest())
    (folder / 'book' / 'pictures').mkdir()
    (folder / 'csv' / 'result1.csv').write_text('a,b\n', encoding='utf-8')
    for name in ('paper.pdf', 'code.py'):
        (folder / 'pdf' / name).write_text('x')
    (folder / 'merged' / 'result1.xlsx').write_bytes(merged_book())
    (folder / 'merged' / 'again').symlink_to(folder)
    elsewhere = tmp_path / 'elsewhere'
    elsewhere.mkdir()
    book(elsewhere / 'result1.xlsx', **contest())
    (folder / 'linked').symlink_to(elsewhere)
    return folder


def test_every_folder_of_a_class_is_a_team(crowd):
    grades = {team.name: grade_team(team) for team in teams_of([crowd])}
    assert sorted(grades) == ['book', 'csv', 'empty', 'linked', 'merged', 'pdf']
    assert [key for one in grades.values() for _, key, _ in one.problems] == [
        'no_result', 'found_nothing', 'merged', 'found_instead']
    assert grades['pdf'].problems[0].parameters == {'files': 'code.py, paper.pdf'}
    assert set(verdicts(grades['linked']).values()) == {'incomplete'}
    assert set(verdicts(grades['merged']).values()) == {'not_readable'}
    assert set(verdicts(grades['csv']).values()) == {'not_understood'}


def test_groups_of_teams_keep_the_teams_without_results(crowd):
    assert sorted(team.name for team in teams_of([crowd.parent])) == [
        'class/book', 'class/csv', 'class/empty', 'class/linked', 'class/merged', 'class/pdf', 'elsewhere']


def test_a_report_says_in_the_table_why_a_team_is_not_graded(crowd):
    grades = [grade_team(team) for team in teams_of([crowd])]
    for lang, says in (('en', ['not readable: result1.xlsx: Sheet: cells B5:C6 are merged', 'found code.py, paper.pdf',
                               'the folder is empty']),
                       ('zh', ['无法读取：result1.xlsx：Sheet：数据区 B5:C6 有合并单元格', 'code.py, paper.pdf',
                               '文件夹为空'])):
        table = re.search(r'<table>.*?</table>', report.page(grades, len(grades), lang), re.DOTALL)[0]
        text = re.sub(r'<[^>]*>', '', table)
        assert [one for one in says if one not in text] == []
        assert 'title=' not in table


@pytest.mark.parametrize('text', [
    ',' * (limits.BOOK_BYTES + 1), ',' * (limits.BOOK_COLUMNS + 1), '\n' * (limits.BOOK_ROWS + 1),
    '1,' * 1999 + '\n' + ('1,' * 1999 + '\n') * 1001, '"' + 'x' * 200_000 + '"', 'a\0b'],
    ids=['bytes', 'columns', 'rows', 'cells', 'field', 'nul'])
def test_a_huge_or_broken_csv_file_is_refused_in_one_line(tmp_path, capsys, text):
    path = tmp_path / 'result1.csv'
    path.write_text(text)
    assert main(['grade', str(path)]) == 2
    assert capsys.readouterr().err.count('\n') == 1


def test_a_bomb_is_refused_with_little_memory(tmp_path):
    """The limit is below what a reader would allocate for 300 MB of text."""
    (tmp_path / 'result1.xlsx').write_bytes(shared(f'<si><t>{"x" * 300_000}</t></si>',
                                                   '<c r="A{0}" t="s"><v>0</v></c>' * 1000))
    code = ('import resource; resource.setrlimit(resource.RLIMIT_DATA, (200 * 2**20,) * 2)\n'
            'from dragon_contest.grade.reading import read_book\n'
            'from pathlib import Path\nread_book(Path("result1.xlsx"))')
    done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, capture_output=True, text=True, check=False,
                          env={**os.environ, 'PYTHONPATH': str(ROOT), 'OPENBLAS_NUM_THREADS': '1'})
    assert 'the texts of its cells' in done.stderr


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / 'result1.xlsx')
    with pytest.raises(InputError, match='not a regular file'):
        read_book(tmp_path / 'result1.xlsx')


def test_a_report_is_one_file_that_loads_nothing_and_escapes_names(room, tmp_path, capsys):
    out = tmp_path / 'report.html'
    teams = [str(path) for path in room.iterdir() if path.name != 'both']       # two teams are graded in this process
    assert main(['grade', *teams, '--lang', 'zh', '--output', str(out)]) == 0
    page = out.read_text(encoding='utf-8')
    assert '<script' not in page
    assert '&lt;script&gt;alert(1)&lt;_script&gt;' in page
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    assert "default-src 'none'" in page
    assert page.count('<section class="team"') == 2
    assert '螺距' not in page or '评分报告' in page
    assert capsys.readouterr().out.strip() == str(out)


@pytest.mark.long       # the next test, which also starts a pool, compares the grades of the teams that are done
def test_a_pool_of_processes_gives_what_one_does_and_an_interruption_keeps_what_is_done(room):
    teams = teams_of([room])
    together, complete = grade_all(teams, Event(), lambda: None)
    assert complete
    assert together == [grade_team(team) for team in teams]
    stop = Event()
    some, complete = grade_all(teams[:2], stop, stop.set)
    assert (len(some), complete) == (1, False)


def dying(team):
    """Grade a team, or end the process as a crashed reader does."""
    return os._exit(1) if team.name == 'red' else grade_team(team)


def test_a_workbook_that_crashes_its_process_costs_no_other_team_its_grade(room, monkeypatch):
    monkeypatch.setattr(folders, 'grade_team', dying)
    grades, complete = grade_all(teams_of([room]), Event(), lambda: None)
    assert complete
    assert [[problem.key for problem in one.problems] for one in grades if one.name == 'red'] == [['crashed']]
    assert [one for one in grades if one.name != 'red'] == [
        grade_team(team) for team in teams_of([room]) if team.name != 'red']


def test_ctrl_c_writes_the_report_of_the_teams_that_are_done(room, tmp_path, capsys, monkeypatch):
    sent = []

    def interrupt(*_):
        if not sent:
            sent.append(os.kill(os.getpid(), signal.SIGINT))
    monkeypatch.setattr(Progress, 'update', interrupt)
    out = tmp_path / 'report.json'
    assert main(['grade', str(room), '--output', str(out)]) == 1
    done = json.loads(out.read_text())['teams']
    assert 1 <= len(done) < 4
    assert f'interrupted: {len(done)} of 4 teams were graded' in capsys.readouterr().err
    names = {team['team'] for team in done}
    alone = [grade_team(team) for team in teams_of([room]) if team.name in names]
    assert done == json.loads(json_text(alone))['teams']


def test_ctrl_c_while_processes_start_prints_no_traceback(room):
    process = subprocess.Popen([sys.executable, '-m', 'dragon_ros', 'grade', str(room)], text=True, cwd=ROOT,
                               start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    while process.poll() is None and not children(process.pid):
        Event().wait(0.002)
    os.killpg(process.pid, signal.SIGINT)       # sent to all processes, as by a terminal
    _, err = process.communicate(timeout=60)
    assert (process.returncode, 'Traceback' in err) == (1, False), err


def test_formats_by_suffix(room, tmp_path, capsys):
    for name in ('a.json', 'a.csv'):
        assert main(['grade', str(room / '一队'), '--output', str(tmp_path / name)]) == 0
    answer = json.loads((tmp_path / 'a.json').read_text())['teams'][0]['answers'][0]
    assert answer['findings'][0]['key'] == 'angle_and_radii'
    assert (tmp_path / 'a.csv').read_text().count('\n') == 2
    assert (tmp_path / 'a.csv').read_bytes().startswith(b'\xef\xbb\xbf')
    capsys.readouterr()
    assert main(['grade', str(room / '一队'), '--format', 'html']) == 2
    assert capsys.readouterr().err.count('\n') == 1
    for wrong in (['--output', 'a.pdf'], ['--format', 'csv', '--output', 'a.json']):
        with pytest.raises(SystemExit, match='2'):
            main(['grade', str(room / '一队'), *wrong])
        assert capsys.readouterr().err.count('\n') == 1


@pytest.mark.parametrize('text', [
    '甲: {t_s: 412.473838}\n乙: {t_s: 412.473838, turn_m: 13}\n', '甲: {t_s: 412.473838}\n'])
def test_the_answers_of_teams_are_graded_without_their_folders(tmp_path, capsys, text):
    (tmp_path / 'answers.yaml').write_text(text)
    assert main(['grade', '--answers', str(tmp_path / 'answers.yaml'), '--format', 'json']) == 0
    found = {team['team']: [one['verdict'] for one in team['answers']]
             for team in json.loads(capsys.readouterr().out)['teams']}
    assert found == {'甲': ['right'], **({'乙': ['right', 'wrong']} if '乙' in text else {})}


@pytest.mark.parametrize(('arguments', 'says'), [
    ([], 'no input'), (['nowhere'], 'does not exist'), (['--t', '-3'], 'not positive'),
    (['--answers', 'a.yaml'], 'did you mean t_s?'), (['--answers', 'b.yaml'], "b.yaml:1: t_s: 'soon'"),
    (['--answers', 'c.yaml'], 'c.yaml: it contains no answers; give at least one of t_s, pitch_m, turn_m, speed_m_s'),
    (['--answers', 'd.yaml', '--t', '412'], '--t: it is the answer of one team, but 2 teams are given'),
    (['.'], 'no workbook')])
def test_what_cannot_be_graded_is_said_in_one_line(arguments, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'a.yaml').write_text('t_: 412\n')
    (tmp_path / 'b.yaml').write_text('t_s: soon\n')
    (tmp_path / 'c.yaml').write_text('')
    (tmp_path / 'd.yaml').write_text('a: {t_s: 1}\nb: {t_s: 2}\n')
    (tmp_path / 'c').mkdir()
    assert main(['grade', *(['c'] if arguments == ['.'] else arguments)]) == 2
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert says in said


def test_budgets_are_held_by_the_bytes_that_come_out_whatever_a_workbook_claims(tmp_path):
    data = bytearray(changed(plain_book(), **{SHEET: PAGE.format(' ' * 10**6)}))
    for at in [found.start() for found in re.finditer(b'PK\x01\x02', bytes(data))]:
        data[at + 24:at + 28] = (10).to_bytes(4, 'little')
    path = tmp_path / 'a.xlsx'
    path.write_bytes(data)
    with pytest.raises(InputError):
        read_book(path)


def test_a_report_on_a_phone_scrolls_down_alone_and_is_accessible(tmp_path, axe, page):
    mirrored = [[name, *(-value for value in row)] for name, *row in PLACES]
    for team in ('red', 'blue'):
        (tmp_path / 'class' / team).mkdir(parents=True)
        book(tmp_path / 'class' / team / 'result1.xlsx', positions=[HEAD, *mirrored], speeds=[HEAD, *SPEEDS])
    report = tmp_path / 'report.html'
    assert main(['grade', str(tmp_path / 'class'), '--output', str(report)]) == 0
    wide = ('return [...document.querySelectorAll("*")].filter((one) => one.scrollWidth > one.clientWidth + 1 && '
            'one.getClientRects().length && getComputedStyle(one).overflowX !== "visible").length + '
            'Math.max(0, document.scrollingElement.scrollWidth - innerWidth)')
    page.look(390, 844)
    for part in ('', '#team-2'):
        page.open(report.as_uri() + part)
        assert page.run(wide) == 0, part
        heads = page.run('return [...document.querySelectorAll("td[data-head]")].map((one) => '
                         'getComputedStyle(one, "::before").content)')
        assert '"result1 positions"' in heads
        assert page.run('return getComputedStyle(document.querySelector("thead")).display') == 'none'
    assert page.violations(axe) == []
