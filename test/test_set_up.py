"""``./dragon`` reports a checkout that it cannot set up in one line, and runs a read-only one that is set up."""
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
AS_OWNER = ('setpriv', '--bounding-set=-dac_override', '--inh-caps=-dac_override')     # makes root obey permissions


@pytest.fixture
def read_only(tmp_path):
    """A function that runs the script of a checkout that cannot be written."""
    if os.geteuid() == 0 and not shutil.which(AS_OWNER[0]):
        pytest.skip('root writes everywhere, and setpriv is not installed')
    shutil.copy(ROOT / 'dragon', tmp_path)
    shutil.copytree(ROOT / 'locks', tmp_path / 'locks')

    def run(*arguments):
        for path in (tmp_path, *filter(Path.is_dir, tmp_path.glob('.venv'))):
            path.chmod(0o555)
        return subprocess.run([*(AS_OWNER if os.geteuid() == 0 else ()), tmp_path / 'dragon', *arguments],
                              env={'PATH': os.environ['PATH']}, capture_output=True, text=True, check=False)
    yield run
    for path in (tmp_path, *filter(Path.is_dir, tmp_path.glob('.venv'))):
        path.chmod(0o755)


def test_a_read_only_checkout_that_is_not_set_up_is_one_line(read_only, tmp_path):
    done = read_only('table')
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(f'dragon: {tmp_path} cannot be written')
    assert 'copy the checkout' in line


def test_the_demo_of_a_read_only_checkout_keeps_its_logs_elsewhere(read_only, tmp_path):
    programs = tmp_path / '.venv' / 'bin'
    programs.mkdir(parents=True)
    shutil.copy(ROOT / 'locks/requirements.txt', tmp_path / '.venv/requirements.installed')
    (programs / 'python').write_text('#!/bin/sh\necho "$TMPDIR" "$ROS_LOG_DIR" "$MPLCONFIGDIR"\n')
    (programs / 'python').chmod(0o755)
    done = read_only('demo')
    folders = done.stdout.split()
    assert (done.returncode, len(folders)) == (0, 3), done.stderr
    assert not [one for one in folders if one.startswith(str(tmp_path / '.venv'))]
    assert Path(folders[0]).is_dir()


@pytest.mark.parametrize('stopped_at', ['os.link', 'Path.replace', ''])
def test_a_set_up_that_is_stopped_while_equal_libraries_become_one_loses_none(tmp_path, stopped_at):
    program = (ROOT / 'dragon').read_text().split("<<'END'\n")[1].split('\nEND\n')[0]
    libraries = [tmp_path / name for name in ('a.so', 'b.so.1')]
    for one in libraries:
        one.write_bytes(bytes(200_000))
    stop = f'import os\nfrom pathlib import Path\n{stopped_at} = lambda *_: os._exit(1)\n' if stopped_at else ''
    for text in (stop + program, program) if stop else (program,):
        done = subprocess.run([sys.executable, '-c', text, tmp_path], check=False)
        assert done.returncode == int(text.startswith('import os\nfrom'))
        assert [one.read_bytes() for one in libraries] == [bytes(200_000)] * 2
    assert libraries[0].samefile(libraries[1])
    assert sorted(tmp_path.iterdir()) == libraries
