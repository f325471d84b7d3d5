"""Untrusted input raises only the package's own errors; by default this test is short and its seed is fixed.

``./dragon test test/fuzz -n0 -s --minutes 60`` continues with new seeds, reports its progress, stores each input that
raises another error in ``corpus/TARGET``, from which the next run starts, and prints a summary at the end.
"""
import resource
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from targets import TARGETS, Target, opened

CORPUS = Path(__file__).with_name('corpus')
_SHORT, _LONGER = 10, 40        # number of inputs by default, and with --long
_ROUND = 500                    # number of inputs in one round with --minutes
_STUCK_S = 60               # in s; an input that takes this long is a finding


class StuckError(Exception):
    """Raised if an input takes far longer than any budget allows."""


def mutated(target: Target) -> st.SearchStrategy[bytes]:
    """Return a strategy for inputs that are seeds with a few changes."""
    words = st.one_of(st.binary(min_size=1, max_size=9), st.sampled_from(target.words or (b'\0',)))
    kinds = st.sampled_from(['replace', 'insert', 'delete', 'repeat', 'cut', 'swap'])
    change = st.tuples(kinds, st.floats(0, 1), words)
    return st.builds(changed, st.sampled_from(target.seeds), st.lists(change, max_size=6))


def changed(data: bytes, changes: list[tuple[str, float, bytes]]) -> bytes:
    """Return bytes changed at positions that are given as shares of the length."""
    for what, share, word in changes:
        at, size = int(share * len(data)), len(word)
        before, after = data[:at], data[at:]
        data = {'replace': before + word + after[size:], 'insert': before + word + after,
                'delete': before + after[size:], 'repeat': before + after[:64 * size] + after, 'cut': before,
                'swap': after + before}[what]
    return data


@contextmanager
def not_stuck() -> Iterator[None]:
    """Raise StuckError if the block takes a minute."""
    def stuck(*_: object) -> None:
        raise StuckError(f'not done after {_STUCK_S} s')
    before = signal.signal(signal.SIGALRM, stuck)
    signal.setitimer(signal.ITIMER_REAL, _STUCK_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def fuzz(target: Target, inputs: int, number: int | None = None, running: Path | None = None,
         ) -> tuple[bytes, BaseException] | None:
    """Try inputs; return the simplest one that raises an unexpected error, and this error.

    Each input is first written to the file ``running``, so that one that ends the process can be found there.
    """
    worst: list[bytes] = []

    @settings(max_examples=inputs, derandomize=number is None, database=None, deadline=None,
              phases=(Phase.generate, Phase.shrink), suppress_health_check=list(HealthCheck))
    @given(mutated(target))
    def check(data: bytes) -> None:
        worst[:] = [data]
        if running is not None:
            running.write_bytes(data)
        with not_stuck():
            target.run(data)
    try:
        (check if number is None else seed(number)(check))()
    except Exception as error:  # noqa: BLE001 - any error that escapes is a finding
        return worst[0], error
    return None


def kept(name: str) -> list[Path]:
    """Return the inputs found by earlier runs."""
    return sorted((CORPUS / name).glob('*')) if (CORPUS / name).is_dir() else []


_LIBRARIES = {'certificate': 'flint', 'study': 'dragon_studies',
              **dict.fromkeys(('workbook', 'results', 'answers'), 'dragon_contest')}


@pytest.mark.parametrize('name', TARGETS)
def test_only_the_package_s_own_errors_come_out(name, tmp_path, request):
    if name == 'message':
        pytest.importorskip('rclpy')
        request.getfixturevalue('domain')
    if name in _LIBRARIES:
        pytest.importorskip(_LIBRARIES[name])
    minutes = request.config.getoption('minutes')
    with opened(name, tmp_path) as target:
        for path in kept(name):
            with not_stuck():
                target.run(path.read_bytes())
        target.seeds.extend(path.read_bytes() for path in kept(name))
        inputs = _LONGER if request.config.getoption('--long') else _SHORT
        found = [fuzz(target, inputs)] if minutes is None else long(
            name, target, 60 * minutes / len(TARGETS), request.config.getoption('first_seed'))
    for one in filter(None, found):
        raise one[1]


def long(name: str, target: Target, for_s: float, first: int) -> list[tuple[bytes, BaseException] | None]:
    """Fuzz with one seed after another until the time is up, report progress every minute, and print the results."""
    until, told, rounds, found = time.monotonic() + for_s, time.monotonic(), 0, {}
    running = CORPUS / name / 'running'
    running.parent.mkdir(parents=True, exist_ok=True)
    while time.monotonic() < until:
        one = fuzz(target, _ROUND, first + rounds, running)
        rounds += 1
        if one:
            key = f'{type(one[1]).__name__}: {one[1]}'[:100]
            found.setdefault(key, one)
            (CORPUS / name / sha256(one[0]).hexdigest()[:16]).write_bytes(one[0])
        if time.monotonic() - told > 60:
            told = time.monotonic()
            say(f'{name}: {rounds * _ROUND} inputs, {until - told:.0f} s left, {len(found)} findings')
    running.unlink(missing_ok=True)
    with suppress(OSError):
        running.parent.rmdir()      # nothing was found
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    say(f'{name}: {rounds * _ROUND} inputs, {len(found)} findings, {peak_mb:.0f} MB at most', *found)
    return list(found.values())


def say(*lines: str) -> None:
    print('', *lines, sep='\n  ', file=sys.stderr, flush=True)
