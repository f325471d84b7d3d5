"""A command that is stopped while it writes leaves a whole output or none, and nothing else."""
import os
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from dragon_ros.__main__ import main
from dragon_ros.bags.write.whole_file import whole_or_none

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp('recorded') / 'run.mcap'
    assert main(['simulate', '--scene', 'winding', '--set', 'run.stop_s=40', '--set', 'dragon.benches=80', '--output',
                 str(path)]) == 0
    return path


def stopped_while_writing(arguments, folder, number):
    """Run a command, signal it as soon as anything is in its output folder, and return its exit code."""
    with subprocess.Popen([sys.executable, '-m', 'dragon_ros', *map(str, arguments)], cwd=folder,
                          env={**os.environ, 'PYTHONPATH': str(ROOT)}, stdout=subprocess.DEVNULL,
                          stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and not any(folder.iterdir()):
            pass
        process.send_signal(number)
        return process.wait()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda one: one.name)
@pytest.mark.parametrize(('words', 'whole'), [
    (['export', 'BAG', '--output', 'out.npz'], zipfile.is_zipfile),
    (['export', 'BAG', '--output', 'out.csv'], lambda path: path.read_bytes().endswith(b'\n')),
    (['inspect', 'BAG', '--repair', 'out.mcap'], lambda path: path.read_bytes().endswith(b'\x89MCAP0\r\n')),
    (['plot', 'animation', '--scene', 'minimal', '--stop', '20', '--output', 'out.gif'],
     lambda path: path.read_bytes().endswith(b';'))], ids=lambda one: one[-1] if isinstance(one, list) else '')
def test_a_signal_leaves_a_whole_output_or_none(bag, tmp_path, words, whole, number):
    code = stopped_while_writing([bag if word == 'BAG' else word for word in words], tmp_path, number)
    left = list(tmp_path.iterdir())
    assert [one.name for one in left] == ([words[-1]] if code == 0 else [])
    assert all(whole(one) for one in left)
    assert code in (0, 1, -number, 128 + number)


def write_while_another_appears(path):
    with whole_or_none(path, overwrite=False) as file:
        file.write(b'mine')
        path.write_bytes(b'theirs')


def test_a_new_output_replaces_nothing_that_appeared_while_it_was_written(tmp_path):
    with pytest.raises(FileExistsError):
        write_while_another_appears(tmp_path / 'out')
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b'theirs']
