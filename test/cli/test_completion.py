"""Shell completion: the shell sends its request in the environment and reads the answer from file descriptor 8."""
import os
import subprocess
import sys

import pytest

from dragon_ros.__main__ import EXECUTABLES
from dragon_ros.configuration import scene_names

LINES = {
    'dragon ta': {'table'},
    'dragon table --sc': {'--scene'},
    'dragon table --scene ': {*scene_names(), 'my.yaml'},
    'dragon table --scene=w': {'--scene=winding'},
    'dragon contact --set track.pi': {'track.pitch_m=', 'track.pieces='},
    'dragon table --accuracy f': {'fine'},
    'dragon plot c': {'clearance', 'contact'},
    'dragon plot dragon --bag r': {'run.mcap'},
    './dragon view --no': {'--no-browser'},
}
EVERY = 'dragon '
SHELL = {'_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': '\n', '_ARGCOMPLETE_SHELL': 'bash', 'COMP_TYPE': '9'}
# For each line, a process that has imported the package's entry point does what the shell's new process does.
EACH = """
import os, sys
from dragon_ros.__main__ import main
lines, sys.argv = sys.argv[1:], ['dragon']
for number, line in enumerate(lines):
    if not (child := os.fork()):
        os.environ.update(COMP_LINE=line, COMP_POINT=str(len(line)))
        os.dup2(os.open(f'answer_{number}', os.O_WRONLY | os.O_CREAT), 8)
        main([])
        os._exit(1)     # main does not return
    if os.waitpid(child, 0)[1]:
        sys.exit(f'{line}: it failed')
"""


@pytest.fixture(scope='module')
def completed(tmp_path_factory):
    """The completions that the tab key offers at the end of each line, and the finished process."""
    folder = tmp_path_factory.mktemp('completion')
    for name in ('my.yaml', 'run.mcap'):
        (folder / name).touch()
    lines = [*LINES, EVERY]
    done = subprocess.run([sys.executable, '-c', EACH, *lines], env={**os.environ, **SHELL}, cwd=folder, check=False,
                          capture_output=True, text=True)
    return {line: {word.strip() for word in (folder / f'answer_{number}').read_text().split('\n')}
            for number, line in enumerate(lines)}, done


@pytest.mark.parametrize('line', LINES)
def test_the_tab_key_offers_what_fits(completed, line):
    assert completed[0][line] == LINES[line]


def test_every_executable_is_offered_and_nothing_else_is_written(completed):
    offered, done = completed
    assert set(EXECUTABLES) <= offered[EVERY]
    assert (done.stdout, done.stderr, done.returncode) == ('', '', 0)


def test_completion_of_names_and_options_imports_nothing_that_computes(tmp_path):
    code = ('import os, sys\nfor name in ("numpy", "yaml", "rclpy", "matplotlib", "mcap"): sys.modules[name] = None\n'
            'from dragon_ros.__main__ import main\nmain([])')
    line = 'dragon table --scene w'
    asked = {**os.environ, 'COMP_LINE': line, 'COMP_POINT': str(len(line)), '_ARGCOMPLETE': '1',
             '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'offered')}
    subprocess.run([sys.executable, '-c', code], env=asked, check=True)
    assert (tmp_path / 'offered').read_text().strip() == 'winding'
