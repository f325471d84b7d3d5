"""Set-up of all tests: floating-point errors raise, properties are repeatable, and the longest tests run first."""
import gc
import os
import re
import signal
from importlib.util import find_spec

# OpenBLAS reads this when numpy is imported. Commands set the same value: by default, each idle thread of OpenBLAS
# would occupy a processor for some hundredths of a second after every large product.
os.environ.setdefault('OPENBLAS_THREAD_TIMEOUT', '16')

import forked_workers
import numpy as np
import pytest
from _pytest.runner import runtestprotocol
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.strategies import none


def pytest_addoption(parser):
    parser.addoption('--minutes', type=float, help='minutes of fuzzing (test/fuzz) instead of a few seconds')
    parser.addoption('--first-seed', type=int, default=1, help='first seed for fuzzing with --minutes')
    parser.addoption('--long', action='store_true', help='also run the tests marked as long: more cases, clusters')


# Libraries that an ordinary ROS 2 install may lack (rosdep has no key for three of them), and the helper modules that
# import them: if a library is missing, each test file that imports it is skipped and named.
OPTIONAL = {'flint': 'flint', 'arb_balls': 'flint', 'motions': 'flint', 'mpmath': 'mpmath', 'convergence': 'mpmath',
            'high_precision': 'mpmath', 'pyarrow': 'pyarrow', 'scipy': 'scipy'}
_IMPORTS = re.compile(r'^(?:from|import) (\w+)', re.MULTILINE)
_left_out = []


def missing_for(source, found=find_spec):
    """Return the first library that is imported at the top of a test file but not installed, or None."""
    wanted = (OPTIONAL[name] for name in _IMPORTS.findall(source) if name in OPTIONAL)
    return next((library for library in wanted if not found(library)), None)


def pytest_ignore_collect(collection_path):
    if collection_path.suffix == '.py' and (library := missing_for(collection_path.read_text(encoding='utf-8'))):
        _left_out.append(f'{collection_path.name}: {library} is not installed')
        return True
    return None


def pytest_terminal_summary(terminalreporter):
    for line in _left_out:
        terminalreporter.write_line(f'LEFT OUT {line}')


def pytest_configure(config):
    if config.getoption('--long'):
        settings.load_profile('repeatable')
    gc.disable()        # until all tests are collected: almost nothing that is imported and collected is garbage
    os.environ['LC_ALL'] = 'C.UTF-8'        # commands use the language of the locale
    # Background jobs ignore SIGINT, and jobs under nohup ignore SIGHUP; processes started here would inherit this.
    for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, usual)


def pytest_collection():
    """Run an empty property, because Hypothesis registers its random generator in the first property.

    It searches for the referrers of the generator, and would not find them among the objects that are frozen later.
    """
    given(none())(lambda _: None)()


def pytest_make_parametrize_id(val):
    """Shorten test ids that are long strings, because ``colcon test`` stops at lines longer than 64 kB."""
    return f'{val[:40]!a} of {len(val)}' if isinstance(val, str | bytes) and len(val) > 1000 else None


# These tests take eight seconds or more; if one ran last, the other processors would be idle.
LONGEST = ('test_types_hold_strictly', 'test_no_scene_on_the_topic_ends_or_blinds_a_recorder',
           'test_the_demo_can_be_run_again_in_one_place',
           'test_recorders_killed_at_random_moments_lose_at_most_the_flush_interval_and_are_repaired',
           'test_handles_without_benches_are_counted_and_logged',
           'test_a_live_run_a_replay_and_the_offline_answers_agree_on_the_contact_with_an_obstacle',
           'test_a_recorder_that_never_gets_the_last_word_of_a_monitor_says_so_and_exits_3')


def pytest_collection_modifyitems(config, items):
    if not config.getoption('--long'):
        long = {item for item in items if item.get_closest_marker('long')}
        config.hook.pytest_deselected(items=[item for item in items if item in long])
        items[:] = [item for item in items if item not in long]
    items[:] = longest_first(spread(items), getattr(config, 'workerinput', {}).get('workercount', 1))


def spread(items):
    """Return the tests in an order that places the files of nodes, whose tests mostly wait, evenly between the others.

    A worker begins with consecutive tests. If all tests of nodes were consecutive, few workers would use a processor.
    """
    begins = {}
    for waits in (True, False):
        group = [item for item in items if ('nodes' in item.path.parts) == waits]
        for number, item in enumerate(group):
            begins.setdefault(item.path, number / len(group))
    return sorted(items, key=lambda item: begins[item.path])


def longest_first(items, workers):
    """Return the tests in an order in which each worker begins with its share of the longest tests.

    Each worker begins with as many consecutive tests, and takes tests of others when it has run these.
    """
    longest = [item for item in items if item.name.startswith(LONGEST)]
    others = [item for item in items if not item.name.startswith(LONGEST)]
    ends = [n * len(others) // workers for n in range(workers + 1)]
    return [item for n in range(workers) for item in (*longest[n::workers], *others[ends[n]:ends[n + 1]])]


def pytest_collection_finish():
    """Collect garbage less often, and never visit what was imported and collected, which stays until the end."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    gc.enable()


OF_EACH_PHASE = ('xmlpath', 'durations', 'reruns')      # options that need the reports on set-up and tear-down, too


def pytest_runtest_protocol(item, nextitem):
    """In a worker, report the set-up and tear-down of a test only if they do not pass, since each report takes time."""
    if not hasattr(item.config, 'workerinput') or any(item.config.getoption(one, None) for one in OF_EACH_PHASE):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in runtestprotocol(item, log=False, nextitem=nextitem):
        if report.when == 'call' or not report.passed:
            item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish():
    """Collect all garbage once; pytest does it five times at the end, for interpreters that need it."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config, specs):
    """Fork the workers from one process, unless the lines that run during imports are to be counted in each of them."""
    if not getattr(config.option, 'cov_source', None):
        forked_workers.fork_workers(config, specs)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers():
    """Return three workers per processor, since tests of nodes, browsers and clusters mostly wait."""
    return 3 * len(os.sched_getaffinity(0))


settings.register_profile('repeatable', derandomize=True, deadline=None, database=None, max_examples=40,
                          suppress_health_check=[HealthCheck.too_slow])
# The profile by default; with --long it is the one above.
settings.register_profile('usual', settings.get_profile('repeatable'), max_examples=20)
# For runs with other library versions: the properties do not depend on them, so a few examples show that the code runs.
settings.register_profile('brief', settings.get_profile('repeatable'), max_examples=10)
# For use by hand, after changes to the code that a property covers: 50 times as many examples as usual.
settings.register_profile('thorough', settings.get_profile('repeatable'), max_examples=1000)
# For mutants (test/mutants): the first failing example is enough.
settings.register_profile('first', settings.get_profile('repeatable'), report_multiple_bugs=False,
                          phases=(Phase.explicit, Phase.generate))
settings.load_profile('usual')


@pytest.fixture(autouse=True)
def _floating_point_errors_raise():
    # An underflow to zero is always exact enough here, so it raises no error.
    with np.errstate(all='raise', under='ignore'):
        yield
