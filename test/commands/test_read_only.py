"""Every command that writes files reports an unwritable folder in one line."""
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from properties import thinned

ROOT = Path(__file__).parents[2]
BAG = ROOT / 'test' / 'data' / 'made_by_0_1_0.mcap'
AS_OWNER = ('setpriv', '--bounding-set=-dac_override', '--inh-caps=-dac_override')     # makes root obey permissions


@pytest.mark.parametrize('command', thinned([
    ['simulate', '--scene', 'first_contact', '--output', 'there/a.mcap'], ['export', BAG, '--output', 'there/a.npz'],
    ['simulate', '--scene', 'first_contact', '--output', 'there/folder'], ['study', 'pitch_map', '--output', 'there/a'],
    ['inspect', BAG, '--repair', 'there/a.mcap']], lambda command: command[-1] not in ('there/folder', 'there/a.npz')),
    ids=lambda words: f'{words[0]} {words[-1]}')
def test_a_read_only_folder_is_named_in_one_line_and_nothing_is_written(tmp_path, command):
    if os.geteuid() == 0 and not shutil.which(AS_OWNER[0]):
        pytest.skip('root writes everywhere, and setpriv is not installed')
    if command[0] == 'study':
        pytest.importorskip('pyarrow')
        pytest.importorskip('dragon_studies')
    folder = tmp_path / 'there'
    folder.mkdir(mode=0o555)
    done = subprocess.run([*(AS_OWNER if os.geteuid() == 0 else ()), sys.executable, '-m', 'dragon_ros',
                           *map(str, command)], cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)},
                          capture_output=True, text=True, check=False)
    if done.returncode == 127:
        pytest.skip(f'permissions cannot be enforced for root here: {done.stderr}')
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (2, '')
    assert 'there' in line
    assert 'Permission denied' in line
    assert not list(folder.iterdir())
