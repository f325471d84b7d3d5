"""What students use works without the modules and functions that only Linux and macOS have, or says so in one line.

This was not tried on Windows: the modules are blocked, and the functions deleted.
"""
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
_BLOCKED = """
import os, signal, sys
for name in ('fcntl', 'resource', 'termios', 'tty'):
    sys.modules[name] = None
for module, names in ((os, ('geteuid', 'setpgrp', 'sched_getaffinity', 'posix_fadvise')),
                      (signal, ('SIGHUP', 'pthread_sigmask'))):
    for name in names:
        delattr(module, name)
from dragon_ros.__main__ import main
if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope='module')
def blocked(tmp_path_factory):
    """A function that runs a command without these modules, and returns its exit code, output and errors."""
    folder = tmp_path_factory.mktemp('blocked')
    (folder / 'program.py').write_text(_BLOCKED)

    def run(*words):
        done = subprocess.run([sys.executable, 'program.py', *words], cwd=folder, capture_output=True, text=True,
                              check=False, env={**os.environ, 'PYTHONPATH': str(ROOT)}, timeout=120)
        return done.returncode, done.stdout, done.stderr
    assert run('simulate', '--scene', 'winding', '--set', 'run.stop_s=2', '--set', 'dragon.benches=9', '--workers',
               '2', '--output', 'run.mcap')[0] == 0
    return run


@pytest.mark.parametrize('words', [
    'table --times 0,60 --handles 0-3', 'table --times 0 --output t.csv', 'contact --scene first_contact',
    'inspect run.mcap --check', 'export run.mcap --output run.npz --workers 2', 'plot dragon --output a.png',
    'design turn', 'urdf --set dragon.benches=9', 'plan --scene street --output plan.pdf',
    'simulate --set run.stop_s=1 --set dragon.benches=9 --output folder',
    'study tolerances --samples 2 --workers 1 --output study'])
def test_a_command_works_without_what_only_linux_has(blocked, words):
    if words.startswith('study'):
        pytest.importorskip('dragon_studies')
    for _ in range(1 + ('--output t.csv' in words)):        # a file is also replaced
        code, _, errors = blocked(*words.split())
        assert 'Traceback' not in errors
        assert code == 0, errors


@pytest.mark.parametrize(('words', 'says'), [
    ('demo', 'demo: the nodes of the demo need Linux and ROS 2, but resource is missing; `view --scene first_contact` '
             'shows the same run without them\n'),
    ('record --output a.mcap', 'record: nodes need Linux, because they use the module resource; `simulate` writes the '
                               'same bag\n')])
def test_what_needs_linux_says_so_in_one_line(blocked, words, says):
    assert blocked(*words.split()) == (2, '', says)
