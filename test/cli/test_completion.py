"""Shell completion: the shell sends its request in the environment and reads the answer from file descriptor 8."""
import os
import subprocess
import sys

import pytest

from dragon_ros.configuration import scene_names
from dragon_ros.executables import EXECUTABLES


def completions(line, cwd):
    """Return the completions that the tab key offers at the end of a line, and the finished process."""
    read, write = os.pipe()
    asked = {**os.environ, 'COMP_LINE': line, 'COMP_POINT': str(len(line)), '_ARGCOMPLETE': '1',
             '_ARGCOMPLETE_IFS': '\n', '_ARGCOMPLETE_SHELL': 'bash', 'COMP_TYPE': '9'}
    code = f'import os, sys; os.dup2({write}, 8); sys.argv = ["dragon"]\n' \
           'from dragon_ros.__main__ import main\nmain([])'
    done = subprocess.run([sys.executable, '-c', code], env=asked, cwd=cwd, pass_fds=[write], check=False,
                          capture_output=True, text=True)
    os.close(write)
    with os.fdopen(read) as answer:
        return {word.strip() for word in answer.read().split('\n')}, done


@pytest.mark.parametrize(('line', 'offered'), [
    ('dragon ta', {'table'}),
    ('dragon table --sc', {'--scene'}),
    ('dragon table --scene ', {*scene_names(), 'my.yaml'}),
    ('dragon table --scene=w', {'--scene=winding'}),
    ('dragon contact --set track.pi', {'track.pitch_m=', 'track.pieces='}),
    ('dragon table --accuracy f', {'fine'}),
    ('dragon plot c', {'clearance', 'contact'}),
    ('dragon plot dragon --bag r', {'run.mcap'}),
    ('dragon cost a', {'accuracy', 'all'}),
    ('./dragon view --no', {'--no-browser'}),
])
def test_the_tab_key_offers_what_fits(tmp_path, line, offered):
    for name in ('my.yaml', 'run.mcap'):
        (tmp_path / name).touch()
    assert completions(line, tmp_path)[0] == offered


def test_every_executable_is_offered_and_nothing_else_is_written(tmp_path):
    offered, done = completions('dragon ', tmp_path)
    assert set(EXECUTABLES) <= offered
    assert (done.stdout, done.stderr, done.returncode) == ('', '', 0)


def test_completion_of_names_and_options_imports_nothing_that_computes(tmp_path):
    code = ('import os, sys\nfor name in ("numpy", "yaml", "rclpy", "matplotlib", "mcap"): sys.modules[name] = None\n'
            'from dragon_ros.__main__ import main\nmain([])')
    line = 'dragon table --scene w'
    asked = {**os.environ, 'COMP_LINE': line, 'COMP_POINT': str(len(line)), '_ARGCOMPLETE': '1',
             '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'offered')}
    subprocess.run([sys.executable, '-c', code], env=asked, check=True)
    assert (tmp_path / 'offered').read_text().strip() == 'winding'
