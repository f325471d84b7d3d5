"""On a full disk, commands end with one line and exit code 2, and an old file stays as it was."""
import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_disk import small_disk

from dragon_ros.__main__ import main

BAG = Path(__file__).parents[1] / 'data' / 'made_by_0_1_0.mcap'
SHORT = '--scene winding --set dragon.benches=3 --set run.stop_s=1'


@pytest.mark.parametrize(('arguments', 'says'), [
    (f'plan {SHORT} --output OUT.pdf', 'plan: --output OUT.pdf: cannot be written: File too large'),
    (f'plan {SHORT} --output OUT.geojson', 'plan: --output OUT.geojson: cannot be written: File too large'),
    (f'table {SHORT} --times 0:1:0.001 --output OUT.xlsx',
     'table: xlsx: the temporary file of the sheet cannot be written: File too large; free some space, or set TMPDIR'),
    (f'plot clearance {SHORT} --output OUT.svg', 'plot: OUT.svg: cannot be written: File too large'),
    (f'plot animation {SHORT} --workers 1 --pace 1 --dpi 40 --output OUT.gif',
     'plot: --output OUT.gif: cannot be written: File too large'),
    *((f'export {BAG} --force --output OUT.{suffix}', f'export: --output OUT.{suffix}: it cannot be written: '
       'File too large') for suffix in ('csv', 'npz')),
    ('contact --scene square --certificate OUT.json',
     'contact: --certificate OUT.json: cannot be written: File too large')])
def test_a_full_disk_is_said_in_one_line(capsys, tmp_path, arguments, says):
    arguments, says = (text.replace('OUT', str(tmp_path / 'out')) for text in (arguments, says))
    old = next(Path(word) for word in arguments.split() if word.startswith(str(tmp_path)))
    old.write_bytes(b'old')
    with small_disk(1000):
        code = main(arguments.split())
        gc.collect(1)       # nothing that is left behind fails later
    assert (code, capsys.readouterr().err) == (2, f'{says}\n')
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b'old']


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='the system has no /dev/full')
@pytest.mark.parametrize('unbuffered', ['', '1'])
def test_a_full_disk_behind_standard_output_is_said_in_one_line(unbuffered):
    with open('/dev/full', 'w') as full:
        done = subprocess.run([sys.executable, '-m', 'dragon_ros', 'table', '--times', '0', '--handles', '0'],
                              stdout=full, stderr=subprocess.PIPE, text=True, check=False,
                              env={**os.environ, 'PYTHONUNBUFFERED': unbuffered})
    assert (done.returncode, done.stderr) == (2, 'table: standard output cannot be written: No space left on device\n')


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='the system has no /dev/full')
@pytest.mark.parametrize(('arguments', 'says'), [
    ('route OUT.csv', 'route'),
    (f'plan {SHORT} --output OUT.geojson', 'plan'), (f'plot dragon {SHORT} --times 0 --output OUT.png', 'plot')])
def test_no_command_ends_in_a_traceback_if_its_summary_cannot_be_written(capsys, monkeypatch, tmp_path, arguments,
                                                                         says):
    (tmp_path / 'out.csv').write_text('0,0\n9,0\n')
    with open('/dev/full', 'w') as full:
        monkeypatch.setattr('sys.stdout', full)
        code = main(arguments.replace('OUT', str(tmp_path / 'out')).split())
    err = capsys.readouterr().err
    assert (code, err) == (2, f'{says}: standard output cannot be written: No space left on device\n')
