"""What the linters of ROS look for in licence and manifest, where they are not installed; ruff has the other rules."""
import hashlib
import tokenize
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[1]
APACHE_2 = 'cfc7749b96f63bd31c3c42b5c471bf756814053e847c10f3eb003417bc523d30'     # the text as the foundation gives it
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
    for path in SOURCES:
        with tokenize.open(path) as file:
            comments = [token.string.lower() for token in tokenize.generate_tokens(file.readline)
                        if token.type == tokenize.COMMENT]
        claims += [(path, text) for text in comments if 'copyright' in text or 'spdx' in text or 'licence' in text]
    assert SOURCES
    assert claims == []


def test_the_manifest_is_what_the_tools_of_ros_accept_without_a_warning():
    package = pytest.importorskip('catkin_pkg.package')
    warnings = []
    found = package.parse_package_string((ROOT / 'package.xml').read_text(), ROOT / 'package.xml', warnings=warnings)
    found.validate(warnings=warnings)
    assert warnings == []
    assert found.get_build_type() == 'ament_python'
