"""The ROS linters' checks of the licence and the manifest, without these linters; ruff covers the other rules."""
import hashlib
import re
import shutil
import subprocess
import sys
import tokenize
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[1]
APACHE_2 = 'cfc7749b96f63bd31c3c42b5c471bf756814053e847c10f3eb003417bc523d30'     # digest of the published text
CLAIMS = b'copyright', b'spdx', b'licence'
FOLDERS = ('dragon_ros', 'benchmarks', 'hard_cases', 'launch', 'msg_configs', 'scripts', 'test')
SOURCES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob('*')
                 if path.suffix == '.py' or path.parent.name == 'scripts')


def test_one_licence_covers_every_file_and_is_named_alike_everywhere():
    assert hashlib.sha256((ROOT / 'LICENSE').read_bytes()).hexdigest() == APACHE_2
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot().find('license')
    assert (manifest.text, manifest.get('file')) == ('Apache-2.0', 'LICENSE')
    assert "license='Apache-2.0'" in (ROOT / 'setup.py').read_text()


def test_no_source_file_claims_another_owner_or_licence():
    claims = []
    for path in (path for path in SOURCES if any(word in path.read_bytes().lower() for word in CLAIMS)):
        with tokenize.open(path) as file:
            comments = [token.string.lower() for token in tokenize.generate_tokens(file.readline)
                        if token.type == tokenize.COMMENT]
        claims += [(path, text) for text in comments if any(word.decode() in text for word in CLAIMS)]
    assert SOURCES
    assert claims == []


def test_the_manifest_is_what_the_tools_of_ros_accept_without_a_warning():
    package = pytest.importorskip('catkin_pkg.package')
    warnings = []
    found = package.parse_package_string((ROOT / 'package.xml').read_text(), ROOT / 'package.xml', warnings=warnings)
    found.validate(warnings=warnings)
    assert warnings == []
    assert found.get_build_type() == 'ament_python'


# Keys of rosdep and packages of ROS 2 that resolve on Ubuntu noble and later, according to rosdistro of 2026-08-22.
# By default rosdep also installs test dependencies, and it stops at the first unknown key.
RESOLVED = {
    'rclpy', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs', 'rcl_interfaces', 'rosgraph_msgs', 'sensor_msgs',
    'std_msgs', 'std_srvs', 'visualization_msgs', 'ament_index_python', 'launch', 'launch_ros', 'ros2launch',
    'simulation_interfaces', 'tf2_msgs',
    'python3-argcomplete', 'python3-matplotlib', 'python3-numpy', 'python3-regex', 'python3-shapely', 'python3-tqdm',
    'python3-yaml', 'python3-hypothesis', 'python3-jsonschema', 'python3-openpyxl', 'python3-pytest',
    'python3-pytest-xdist', 'python3-pyproj', 'python3-scipy'}


def test_rosdep_knows_every_key_of_the_manifest():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert {node.text for node in manifest if node.tag.endswith('depend')} <= RESOLVED


@pytest.fixture
def conftest(request):
    """The set-up of all tests as a module."""
    return next(one for one in request.config.pluginmanager.get_plugins() if hasattr(one, 'missing_for'))


@pytest.mark.parametrize(('source', 'library'), [
    ('import mpmath\n', 'mpmath'), ('from scipy.stats import norm\n', 'scipy'),
    ('from convergence import x\n', 'mpmath'),
    ('def f():\n    import mpmath\n', None), ('import numpy\n', None)])
def test_a_file_whose_library_is_missing_is_left_out_by_name(conftest, source, library):
    assert conftest.missing_for(source, lambda name: None) == library
    assert conftest.missing_for(source, lambda name: name) is None


def test_no_two_files_of_tests_have_one_name():
    """Pytest imports test files by name and would reject the second of two files with the same name."""
    names = [path.name for path in (ROOT / 'test').rglob('*.py') if path.name != 'conftest.py']
    assert sorted({name for name in names if names.count(name) > 1}) == []


@pytest.mark.parametrize('workers', [1, 2, 4, 7])
def test_every_worker_begins_with_its_share_of_the_longest_tests(conftest, workers):
    names = [*conftest.LONGEST[:6], *(f'test_{n}' for n in range(50))]
    items = [SimpleNamespace(name=name) for name in names[::-1]]
    order = [item.name for item in conftest.longest_first(items, workers)]
    assert sorted(order) == sorted(names)
    for worker in range(workers):
        begin = round(worker * len(order) / workers)
        nearby = order[max(begin - 1, 0):begin + 2]
        assert worker >= 6 or any(name in conftest.LONGEST for name in nearby)


def test_the_longest_tests_exist(conftest):
    tests = {name for path in SOURCES if path.name.startswith('test_')
             for name in re.findall(r'^def (test_\w+)', path.read_text(), re.MULTILINE)}
    assert [start for start in conftest.LONGEST if not any(name.startswith(start) for name in tests)] == []


OUTCOMES = """
import pytest

@pytest.fixture
def broken():
    raise ValueError

@pytest.fixture
def broken_after():
    yield
    raise ValueError

def test_passes(): pass
def test_fails(): assert False
def test_set_up_fails(broken): pass
def test_tear_down_fails(broken_after): pass
def test_is_skipped(): pytest.skip('for a reason')
@pytest.mark.skip(reason='for a reason')
def test_is_never_set_up(): pass
@pytest.mark.xfail
def test_fails_as_expected(): assert False
"""


@pytest.mark.long
@pytest.mark.parametrize('more', [[], ['--junit-xml=found.xml']], ids=['terminal', 'file'])
def test_workers_report_the_outcomes_of_all_phases(conftest, tmp_path, more):
    for name in ('conftest.py', 'forked_workers.py', 'forked_worker.py'):
        shutil.copy(Path(conftest.__file__).with_name(name), tmp_path)
    (tmp_path / 'test_outcomes.py').write_text(OUTCOMES)
    done = subprocess.run([sys.executable, '-m', 'pytest', '-q', '-n2', '-c', '/dev/null', '--rootdir', tmp_path,
                           *more, tmp_path], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert '1 failed, 2 passed, 2 skipped, 1 xfailed, 2 errors' in done.stdout
    if more:
        cases = ElementTree.parse(tmp_path / 'found.xml').getroot().findall('.//testcase')
        assert sorted(child.tag for case in cases for child in case) == [
            'error', 'error', 'failure', 'skipped', 'skipped', 'skipped']
