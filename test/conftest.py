"""Set-up of all tests: floating-point errors raise, properties are repeatable, and what is left out is named."""
import os
import re
import signal
from collections import Counter
from importlib.util import find_spec

# OpenBLAS reads this when numpy is imported. Commands set the same value: by default, each idle thread of OpenBLAS
# would occupy a processor for some hundredths of a second after every large product.
os.environ.setdefault('OPENBLAS_THREAD_TIMEOUT', '16')

import numpy as np
import pytest
from hypothesis import HealthCheck, settings


def pytest_addoption(parser):
    parser.addoption('--minutes', type=float, help='minutes of fuzzing (test/fuzz) instead of a few seconds')
    parser.addoption('--first-seed', type=int, default=1, help='first seed for fuzzing with --minutes')
    parser.addoption('--long', action='store_true', help='also run the tests marked as long: more cases, clusters')


# Libraries that an ordinary ROS 2 install may lack (rosdep has no key for three of them), and the helper modules that
# import them: if a library is missing, each test file that imports it is skipped and named.
OPTIONAL = {'flint': 'python-flint', 'arb_balls': 'python-flint', 'motions': 'python-flint', 'mpmath': 'mpmath',
            'convergence': 'mpmath', 'high_precision': 'mpmath', 'pyarrow': 'pyarrow', 'scipy': 'scipy',
            'dragon_studies': 'pyarrow'}
GUESTS = 'dragon_contest', 'dragon_studies'      # packages beside dragon_ros, which it does not need
_IMPORTS = re.compile(r'^(?:from|import) (\w+)', re.MULTILINE)


class LeftOut(pytest.File):
    """A test file whose library is missing, or the package beside dragon_ros that it tests."""

    def collect(self):
        pytest.skip(next(lacks(self.path)), allow_module_level=True)


def lacks(path):
    """Yield why the modules that a test file imports cannot be imported."""
    for name in _IMPORTS.findall(path.read_text(encoding='utf-8')):
        library = OPTIONAL.get(name, '').removeprefix('python-')
        if name in GUESTS and find_spec(name) is None:
            yield f'the package {name} is not there'
        elif library and find_spec(library) is None:
            yield f'could not import {name!r}: pip install {OPTIONAL[name]}'


def pytest_pycollect_makemodule(module_path, parent):
    return LeftOut.from_parent(parent, path=module_path) if any(lacks(module_path)) else None


def pytest_terminal_summary(terminalreporter):
    """Name each reason for which tests were skipped, which says what to install, and their number."""
    skipped = {(one.nodeid, one.longrepr[2].removeprefix('Skipped: '))
               for one in terminalreporter.stats.get('skipped', ())}
    for reason, count in sorted(Counter(reason for _, reason in skipped).items()):
        terminalreporter.write_line(f'LEFT OUT {reason} ({count})')


def pytest_configure(config):
    if config.getoption('--long'):
        settings.load_profile('repeatable')
    os.environ['LC_ALL'] = 'C.UTF-8'        # commands use the language of the locale
    # Background jobs ignore SIGINT, and jobs under nohup ignore SIGHUP; processes started here would inherit this.
    for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, usual)


def pytest_make_parametrize_id(val):
    """Shorten test ids that are long strings, because ``colcon test`` stops at lines longer than 64 kB."""
    return f'{val[:40]!a} of {len(val)}' if isinstance(val, str | bytes) and len(val) > 1000 else None


def pytest_collection_modifyitems(config, items):
    if not config.getoption('--long'):
        long = {item for item in items if item.get_closest_marker('long')}
        config.hook.pytest_deselected(items=[item for item in items if item in long])
        items[:] = [item for item in items if item not in long]


settings.register_profile('repeatable', derandomize=True, deadline=None, database=None, max_examples=40,
                          suppress_health_check=[HealthCheck.too_slow])
# The profile by default; with --long it is the one above.
settings.register_profile('usual', settings.get_profile('repeatable'), max_examples=20)
# For runs with other library versions: the properties do not depend on them, so a few examples show that the code runs.
settings.register_profile('brief', settings.get_profile('repeatable'), max_examples=10)
# For use by hand, after changes to the code that a property covers: 50 times as many examples as usual.
settings.register_profile('thorough', settings.get_profile('repeatable'), max_examples=1000)
settings.load_profile('usual')


@pytest.fixture(autouse=True)
def _floating_point_errors_raise():
    # An underflow to zero is always exact enough here, so it raises no error.
    with np.errstate(all='raise', under='ignore'):
        yield
