"""Names that no file can have, and names that would drive a terminal, give one line."""
import os

import pytest

from dragon_ros.__main__ import main
from dragon_ros.cli.command_line import printable

SHORT = '--set run.stop_s=1 --set dragon.benches=3'
READING = ['table --scene NAME', 'table --scene NAME.yaml', 'table NAME.mcap', 'contact --scene NAME', 'contact NAME',
           'inspect NAME', 'export NAME --output a.csv', 'plot dragon --bag NAME', 'route NAME', 'route NAME.svg',
           'plan --scene NAME --output a.pdf', 'view NAME --no-browser', 'view --try --scene NAME.yaml --no-browser',
           'grade NAME', 'grade NAME.xlsx', 'study NAME --output a', 'study NAME.yaml --output a',
           'design fit --scene NAME']
WRITING = ['table --output NAME.csv', 'table --contest NAME', 'contact --certificate NAME.json',
           'inspect run.mcap --repair NAME.mcap', 'export run.mcap --output NAME.npz',
           'export run.mcap --force --output NAME.csv', f'simulate {SHORT} --output NAME.mcap',
           f'simulate {SHORT} --force --output NAME', f'plot dragon {SHORT} --output NAME.png',
           f'plot animation {SHORT} --pace 1 --fps 2 --dpi 30 --output NAME.gif', f'urdf {SHORT} --output NAME.urdf',
           'plan --scene street --output NAME.pdf', 'study tolerances --samples 2 --output NAME']


@pytest.fixture
def folder(tmp_path, monkeypatch, capsys):
    """A working folder with a bag, and with links named ``loop`` that point to themselves."""
    monkeypatch.chdir(tmp_path)
    for suffix in ('', '.csv', '.gif', '.json', '.mcap', '.npz', '.pdf', '.png', '.svg', '.urdf', '.xlsx', '.yaml'):
        os.symlink(f'loop{suffix}', f'loop{suffix}')
    assert main(['simulate', *SHORT.split(), '--output', 'run.mcap']) == 0
    capsys.readouterr()
    return tmp_path


def ended(words):
    try:
        return main(words)
    except SystemExit as end:
        return end.code


@pytest.mark.parametrize('name', ['x' * 300, 'loop'], ids=['long', 'loop'])
@pytest.mark.parametrize('words', [*READING, *WRITING])
def test_a_name_that_no_file_can_have_gives_one_line(capsys, folder, words, name):
    code = ended([one.replace('NAME', name) for one in words.split()])
    out, err = capsys.readouterr()
    assert (code, out, len(err.splitlines())) == (2, '', 1)


@pytest.mark.parametrize('content', ['', '[1]', '{"address": 3}'])
def test_a_scheduler_file_without_an_address_gives_one_line(capsys, folder, content):
    pytest.importorskip('dragon_studies')
    pytest.importorskip('distributed')
    (folder / 'scheduler.json').write_text(content)
    assert main(['study', 'tolerances', '--samples', '2', '--output', 'a', '--scheduler', 'scheduler.json']) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith(
        'study: --scheduler scheduler.json: it contains no address of a scheduler; give the file that')


ESC = '\x1b[31m\u202e'


@pytest.mark.parametrize('words', [
    'table --scene NAME.yaml', 'table --set NAME=3', 'table --set track.NAME=3', 'contact --times NAME', 'inspect NAME',
    'NAME', 'plot NAME', 'plot dragon --bag NAME', 'route NAME.svg', 'grade NAME', 'study NAME --output a',
    'design NAME', 'export run.mcap --namespace NAME --output a.csv', 'table --accuracy NAME'])
def test_a_name_does_not_drive_the_terminal(capsys, folder, words):
    assert ended([one.replace('NAME', ESC) for one in words.split()]) == 2
    assert '\x1b' not in capsys.readouterr().err


def test_the_name_of_a_file_that_is_written_does_not_drive_the_terminal(capsys, folder):
    assert main(['simulate', *SHORT.split(), '--output', f'{ESC}.mcap']) == 0
    assert main(['plot', 'dragon', *SHORT.split(), '--output', f'{ESC}.png']) == 0
    assert main(['inspect', f'{ESC}.mcap']) == 0
    out, err = capsys.readouterr()
    assert '\x1b' not in out + err
    assert '\\x1b[31m\\u202e.png' in out


def test_letters_of_all_languages_are_printed_as_they_are():
    assert printable('板凳龙 é\tα\nlast') == '板凳龙 é\tα\nlast'
    assert printable('a\r\0\x7f\x9b') == 'a\\r\\x00\\x7f\\x9b'
