"""Fixtures of tests in a browser, which the set-up of a folder imports."""
from pathlib import Path

import pytest
from browser import ABSENT, CHROMIUM, browser


@pytest.fixture(scope='session')
def chromium(tmp_path_factory):
    """The one browser that all tests in this process share, since starting a browser takes seconds."""
    if not CHROMIUM:
        pytest.skip(ABSENT)
    with browser(tmp_path_factory.mktemp('chromium')) as one:
        yield one


@pytest.fixture
def page(chromium):
    """An empty page."""
    yield chromium
    chromium.begin_anew()


@pytest.fixture(scope='session')
def axe():
    """The axe script, which checks the accessibility of a page."""
    library = pytest.importorskip('axe_core_python', reason='axe-core-python is not installed')
    return (Path(library.__file__).parent / 'axe.min.js').read_text(encoding='utf-8')
