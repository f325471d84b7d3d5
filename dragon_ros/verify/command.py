"""``python -m dragon_ros.verify``: check a certificate of first contact, and print what it proves."""
import argparse
import sys
import time
from math import inf, nan
from pathlib import Path

from dragon_ros.verify.errors import Refused

OK, INTERRUPTED, REFUSED = 0, 1, 2
_FIRST_S, _EVERY_S = 1.0, 1.0       # time until the first progress report, and time between reports


def main(argv: list[str] | None = None) -> int:
    """Check a certificate. Print what it proves and return 0, or print why it is rejected and return 2."""
    parser = argparse.ArgumentParser(prog='python -m dragon_ros.verify', description=__doc__)
    parser.add_argument('certificate', type=Path, help='a file written by `contact --certificate`; - is standard input')
    parser.add_argument('--effort', type=_effort, default=1.0, metavar='TIMES',
                        help='multiply the usual budget by this factor (%(default)s)')
    arguments = parser.parse_args(argv)
    try:
        said = _proved(arguments.certificate, arguments.effort)
    except Refused as error:
        print(f'{arguments.certificate}: refused: {error}', file=sys.stderr)
        return REFUSED
    except KeyboardInterrupt:
        return INTERRUPTED
    print(f'{arguments.certificate}: {said}')
    return OK


def _effort(text: str) -> float:
    """Convert text to an effort. Raises ArgumentTypeError unless the effort is positive and finite."""
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not 0 < value < inf:
        raise argparse.ArgumentTypeError(f'{text}: give a positive number')
    return value


def _proved(path: Path, effort: float) -> str:
    """Return the sentence that a certificate file proves. Raises Refused."""
    try:
        import flint  # noqa: F401
    except ImportError:
        raise Refused("the checker needs python-flint: pip install 'dragon_ros[verify]' or pip install "
                      'python-flint') from None
    from dragon_ros.verify.proof import prove
    from dragon_ros.verify.reading import read
    try:
        proved = prove(read(path), effort, _Progress())
    except (ArithmeticError, ValueError, RecursionError, MemoryError) as error:
        raise Refused(f'its numbers cannot be evaluated: {error!r:.160}') from None
    return f'{proved.sentence} (in {proved.intervals} {"interval" if proved.intervals == 1 else "intervals"})'


class _Progress:
    """Prints progress to stderr: the cleared track, the remaining time, and a hint if the budget is too small."""

    def __init__(self) -> None:
        self._begun_s = time.monotonic()
        self._next_s = self._begun_s + _FIRST_S
        self._end = '\r' if sys.stderr.isatty() else '\n'
        self._is_told = False

    def __call__(self, done_m: float, whole_m: float, advice: str) -> None:
        now_s = time.monotonic()
        if now_s >= self._next_s or (advice and not self._is_told):
            self._is_told = self._is_told or bool(advice)
            self._next_s = now_s + _EVERY_S
            left = f', about {(now_s - self._begun_s) * (whole_m / done_m - 1):.2g} s left' if done_m > 0 else ''
            left += f', {advice}' if advice else ''
            print(f'verify: {done_m:.6g} of {whole_m:.6g} m of track cleared{left}', end=self._end, file=sys.stderr,
                  flush=True)
