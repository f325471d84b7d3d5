"""The commands of the contest: typical mistakes, any names, full disks, and both languages."""
import os
import re
import subprocess
import sys
from pathlib import Path
from string import Formatter

import pytest
from properties import thinned
from small_disk import small_disk

from dragon_contest.paper_tables import WORDS
from dragon_ros.__main__ import main

NAME = os.fsdecode('舞龙'.encode('gbk'))         # as unpacked from a ZIP file that was made in Chinese Windows
ESCAPED = r'\udcce\udce8\udcc1\udcfa'


def run(capsys, *arguments):
    try:
        code = main([*map(str, arguments)])
    except SystemExit as stop:
        code = stop.code
    return code, *capsys.readouterr()


@pytest.mark.parametrize(('line', 'says'), [
    ('grade', 'no input'), ('grade text.txt', 'not an XLSX'), ('grade --pitch 45cm', 'write a number such as 0.5'),
    ('table --paper --times 3', 'does not accept it')])
def test_a_mistake_on_the_command_line_is_one_line_with_its_cure(capsys, tmp_path, monkeypatch, line, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'text.txt').write_text('hello')
    code, _, err = run(capsys, *line.split())
    assert (code, err.count('\n')) == (2, 1)
    assert says in err


@pytest.mark.parametrize('suffix', thinned(['html', 'json', 'csv'], lambda suffix: suffix == 'html'))
def test_a_team_may_have_any_name(capsys, tmp_path, suffix):
    (tmp_path / 'class' / NAME).mkdir(parents=True)
    (tmp_path / 'class' / NAME / 'result1.xlsx').write_bytes(b'')
    report = tmp_path / f'report.{suffix}'
    for stream in (sys.stdout, sys.stderr):     # as in the executable before it calls main
        stream.reconfigure(errors='backslashreplace')
    assert main(['grade', str(tmp_path / 'class'), '--output', str(report)]) == 2
    assert capsys.readouterr().out == f'{report}\n'
    assert ESCAPED in report.read_text()


def test_characters_that_the_locale_lacks_are_escaped_in_a_grade():
    done = subprocess.run([sys.executable, '-m', 'dragon_ros', 'grade', '--turn', '13.6', '--lang', 'zh'],
                          capture_output=True, text=True, check=False,
                          env={**os.environ, 'PYTHONUTF8': '0', 'PYTHONIOENCODING': 'ascii', 'LC_ALL': 'C'})
    assert (done.returncode, r'\u95ee\u9898 4' in done.stdout) == (0, True), done.stdout + done.stderr


def test_old_result_files_stay_if_the_disk_is_full(capsys, tmp_path):
    old = tmp_path / 'result1_positions.csv'
    old.write_bytes(b'old')
    with small_disk(500_000):
        code = main(['table', '--contest', str(tmp_path)])
    assert (code, capsys.readouterr().err) == (2, f'table: --contest {old}: cannot be written: File too large\n')
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b'old']


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='the system has no /dev/full')
@pytest.mark.parametrize('line', [
    'grade --t 412 --output OUT.html', pytest.param('table --contest OUT', marks=pytest.mark.long)])
def test_no_command_ends_in_a_traceback_if_its_summary_cannot_be_written(capsys, monkeypatch, tmp_path, line):
    with open('/dev/full', 'w') as full:
        monkeypatch.setattr('sys.stdout', full)
        code = main(line.replace('OUT', str(tmp_path / 'out')).split())
    err = capsys.readouterr().err
    assert (code, err.count('\n')) == (2, 1)


def test_both_languages_have_the_same_parameters_in_every_text_of_the_paper_s_tables():
    for key, (english, chinese) in WORDS.items():
        assert {name for _, name, _, _ in Formatter().parse(english) if name} == {
            name for _, name, _, _ in Formatter().parse(chinese) if name}, key


def test_the_paper_s_tables_are_in_chinese_with_the_same_numbers(capsys):
    chinese, english = (run(capsys, 'table', '--paper', '--lang', lang)[1] for lang in ('zh', 'en'))
    assert chinese.startswith('表 1  位置 (m)\n')
    assert '第51节龙身x' in chinese
    assert re.findall(r'-?\d+\.\d+', chinese.replace('412.20', '')) == re.findall(
        r'-?\d+\.\d+', english.replace('412.20', ''))
    code, _, err = run(capsys, 'table', '--lang', 'zh')
    assert code == 2
    assert '--lang' in err
