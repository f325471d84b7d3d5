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


def install(folder, target):
    """Install a locked wheel from a folder as ``./dragon`` does, without a network."""
    script = (ROOT / 'dragon').read_text()
    options = re.search(r"^install='install (.*)'$", script, re.MULTILINE)[1].split()
    assert '$install --no-deps' in script
    return subprocess.run([sys.executable, '-m', 'pip', 'install', *options, '--no-deps', '--no-index', '--find-links',
                           folder, '--target', target, '-r', folder / 'lock.txt'], capture_output=True, text=True,
                          check=False)


def test_a_wheel_that_changed_by_one_byte_is_refused(tmp_path):
    right = wheel(tmp_path, 'answer = 42\n')
    (tmp_path / 'lock.txt').write_text(f'locked-thing==1.0 \\\n    --hash=sha256:{right}\n')
    done = install(tmp_path, tmp_path / 'right')
    assert done.returncode == 0, done.stderr
    assert (tmp_path / 'right' / 'locked_thing.py').exists()
    assert wheel(tmp_path, 'answer = 43\n') != right
    done = install(tmp_path, tmp_path / 'changed')
    assert done.returncode != 0
    assert 'DO NOT MATCH THE HASHES' in done.stderr
    assert not (tmp_path / 'changed').exists()


def test_a_package_without_a_hash_is_refused(tmp_path):
    wheel(tmp_path, 'answer = 42\n')
    (tmp_path / 'lock.txt').write_text('locked-thing==1.0\n')
    done = install(tmp_path, tmp_path / 'there')
    assert done.returncode != 0
    assert 'require-hashes' in done.stderr.lower() or 'hashes are required' in done.stderr.lower()


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
