"""Workers that are forked from one process work as if pytest-xdist had started them."""
import os
import re
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

pytest.importorskip('xdist')
CONFTEST = """
from forked_workers import fork_workers

def pytest_xdist_setupnodes(config, specs):
    fork_workers(config, specs)
"""
TESTS = """
import os
import signal
IMPORTED = os.getpid()

def test_files_are_imported_once():
    assert os.getppid() == IMPORTED

def test_assertions_show_their_values():
    assert f'imported by {IMPORTED}' == 0

def test_workers_may_be_killed():
    os.kill(os.getpid(), signal.SIGKILL)

def test_others_take_their_place():
    pass
"""


def test_workers_are_forked_from_one_process_replaced_after_a_crash_and_leave_nothing(tmp_path):
    (tmp_path / 'conftest.py').write_text(CONFTEST)
    (tmp_path / 'test_some.py').write_text(TESTS)
    (tmp_path / 'pytest.ini').write_text('[pytest]')
    run = subprocess.run([sys.executable, '-m', 'pytest', '-p', 'xdist', '-n2', tmp_path], text=True,
                         capture_output=True, timeout=120, cwd=tmp_path, env={
                             **os.environ, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1', 'TMPDIR': str(tmp_path),
                             'PYTHONPATH': os.pathsep.join([str(Path(__file__).parent), os.environ['PYTHONPATH']])})
    assert '2 failed, 2 passed' in run.stdout, run.stdout + run.stderr
    assert re.search("worker 'gw.' crashed while running 'test_some.py::test_workers_may_be_killed'", run.stdout)
    imported = re.search(r"assert 'imported by (\d+)' == 0", run.stdout)[1]
    assert not psutil.pid_exists(int(imported))
    assert not list(tmp_path.glob('workers*'))
    assert not run.stderr
