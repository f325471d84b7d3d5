"""``./dragon`` installs packages that are locked to a version and a hash, and rejects a changed file."""
import re
import subprocess
import sys
import zipfile
from hashlib import sha256
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LISTS = ('requirements', 'requirements-study', 'requirements-test', 'requirements-mutants', 'requirements-lowest',
         'requirements-kilted')
LOCKS = sorted((ROOT / 'locks').glob('*.txt'))
_PIN = re.compile(r'([A-Za-z0-9][\w.-]*)(?:\[[\w,]+\])?==([\w.]+)')

_LOCKED = re.compile(r'[\w.-]+(\[[\w,]+\])?==[\w.]+( ;[^#]*?)?( +--hash=sha256:[0-9a-f]{64} *)+')


def pins(path):
    """Return (name, version) of each package that a file pins."""
    found = (_PIN.match(line) for line in path.read_text().splitlines())
    return {(re.sub(r'[-_.]+', '-', one[1]).lower(), one[2]) for one in found if one}


def wheel(folder, text):
    """Write a wheel with one module, and return its hash."""
    path = folder / 'locked_thing-1.0-py3-none-any.whl'
    info = 'locked_thing-1.0.dist-info'
    with zipfile.ZipFile(path, 'w') as file:
        for name, content in (('locked_thing.py', text), (f'{info}/RECORD', ''),
                              (f'{info}/METADATA', 'Metadata-Version: 2.1\nName: locked-thing\nVersion: 1.0\n'),
                              (f'{info}/WHEEL', 'Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n')):
            file.writestr(zipfile.ZipInfo(name), content)
    return sha256(path.read_bytes()).hexdigest()


# Each folder is installed by a process that has imported pip, as it would be by a new one.
EACH = """
import os, sys
from pip._internal.cli.main import main
import pip._internal.commands.install
for folder in sys.argv[1].split(':'):
    if not (child := os.fork()):
        os.chdir(folder)
        said = os.open('said', os.O_WRONLY | os.O_CREAT)
        os.dup2(said, 1), os.dup2(said, 2)
        os._exit(main([*sys.argv[2:], '--find-links', '.', '--target', 'there', '-r', 'lock.txt']))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.fixture(scope='module')
def installed(tmp_path_factory):
    """The exit codes of installing a wheel as ``./dragon`` does, without a network, and what was said, by folder."""
    folders = {name: tmp_path_factory.mktemp(name) for name in ('right', 'changed', 'unlocked')}
    locked = f'locked-thing==1.0 \\\n    --hash=sha256:{wheel(folders["right"], "answer = 42")}\n'
    wheel(folders['changed'], 'answer = 43')
    wheel(folders['unlocked'], 'answer = 42')
    for name, folder in folders.items():
        (folder / 'lock.txt').write_text('locked-thing==1.0\n' if name == 'unlocked' else locked)
    script = (ROOT / 'dragon').read_text()
    options = re.search(r"^install='(install .*)'$", script, re.MULTILINE)[1].split()
    assert '$install --no-deps' in script
    done = subprocess.run([sys.executable, '-c', EACH, ':'.join(map(str, folders.values())), *options, '--no-deps',
                           '--no-index'], capture_output=True, text=True, check=True)
    return {name: (int(code), (folder / 'said').read_text(), folder / 'there')
            for code, (name, folder) in zip(done.stdout.split(), folders.items(), strict=True)}


def test_a_wheel_that_changed_by_one_byte_is_refused(installed):
    code, said, there = installed['right']
    assert code == 0, said
    assert (there / 'locked_thing.py').read_text() == 'answer = 42'
    code, said, there = installed['changed']
    assert code != 0
    assert 'DO NOT MATCH THE HASHES' in said
    assert not there.exists()


def test_a_package_without_a_hash_is_refused(installed):
    code, said, there = installed['unlocked']
    assert code != 0
    assert 'require-hashes' in said.lower() or 'hashes are required' in said.lower()
    assert not there.exists()


@pytest.mark.parametrize('name', LISTS)
def test_a_lock_has_what_its_list_pins(name):
    assert pins(ROOT / f'{name}.txt') <= pins(ROOT / 'locks' / f'{name}.txt')


@pytest.mark.parametrize('path', LOCKS, ids=lambda path: path.stem)
def test_every_package_of_a_lock_has_hashes_and_nothing_else_is_in_it(path):
    text = path.read_text()
    packages = re.split(r'\n(?=\S)', text.replace('\\\n', ' ').strip())
    assert packages
    for package in packages:
        assert _LOCKED.fullmatch(package), package


def test_lists_that_are_installed_together_agree():
    together = [pins(ROOT / 'locks' / f'{name}.txt') for name in LISTS[:4]]
    for first in together:
        for other in together:
            shared = {name for name, _ in first} & {name for name, _ in other}
            assert {pin for pin in first if pin[0] in shared} == {pin for pin in other if pin[0] in shared}


def test_kilted_is_tried_with_its_own_wheels_and_with_the_other_packages_of_jazzy():
    jazzy = {pin for name in ('requirements', 'requirements-test') for pin in pins(ROOT / 'locks' / f'{name}.txt')}
    kilted = pins(ROOT / 'locks' / 'requirements-kilted.txt')
    assert {pin for pin in kilted if not pin[0].startswith('ros-')} == {
        pin for pin in jazzy if not pin[0].startswith('ros-')}
    of_jazzy, of_kilted = ({name for name, _ in pins(ROOT / f'{name}.txt') if name.startswith('ros-')}
                           for name in ('requirements', 'requirements-kilted'))
    assert of_kilted == {name.replace('ros-jazzy-', 'ros-kilted-') for name in of_jazzy}


def test_the_two_profiles_of_this_host_differ_only_in_two_names():
    old, new = ((ROOT / 'msg_configs/fastdds' / name).read_text().split('<dds ')[1]
                for name in ('loopback.xml', 'loopback_fastdds3.xml'))
    assert new == old.replace('heartbeatPeriod>', 'heartbeat_period>').replace('nackSupressionDuration>',
                                                                              'nack_supression_duration>')
    assert new != old
