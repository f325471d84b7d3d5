"""The ROS linters' checks of the licence and the manifest, without these linters; ruff covers the other rules."""
import hashlib
import subprocess
import tokenize
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[1]
APACHE_2 = 'cfc7749b96f63bd31c3c42b5c471bf756814053e847c10f3eb003417bc523d30'     # digest of the published text
CLAIMS = b'copyright', b'spdx', b'licence'
FOLDERS = ('dragon_ros', 'dragon_contest', 'dragon_studies', 'benchmarks', 'hard_cases', 'launch', 'msg_configs',
           'scripts', 'test')
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


def test_a_release_is_refused_while_the_only_addresses_are_placeholders():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    addresses = {manifest.find('maintainer').get('email'), manifest.findtext('url')}
    assert all('dragon-ros.example.org' in address for address in addresses)       # until the project has an address
    copies = [path for path in (ROOT / 'setup.py', ROOT / 'CITATION.cff', ROOT / 'SECURITY.md', ROOT / 'README.md')
              if 'dragon-ros.example.org' in path.read_text()]
    assert copies == []
    done = subprocess.run([ROOT / '.ci' / 'release'], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert all(address in done.stderr for address in addresses)
    assert 'placeholders; replace them before a release' in done.stderr


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


def test_no_two_files_of_tests_have_one_name():
    """Pytest imports test files by name and would reject the second of two files with the same name."""
    names = [path.name for path in (ROOT / 'test').rglob('*.py') if path.name != 'conftest.py']
    assert sorted({name for name in names if names.count(name) > 1}) == []
