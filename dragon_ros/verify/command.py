"""``python -m dragon_ros.verify CERTIFICATE``: check a certificate of first contact."""
import argparse
import sys
import time
from pathlib import Path

from dragon_ros.verify.errors import Refused

OK, REFUSED = 0, 2
_EVERY_S = 0.2


def main(argv: list[str] | None = None) -> int:
    """Check a certificate: print what it proves and return 0, or say in a line why it is refused and return 2."""
    parser = argparse.ArgumentParser(prog='python -m dragon_ros.verify', description=__doc__)
    parser.add_argument('certificate', type=Path, help='file that `contact --certificate` wrote')
    parser.add_argument('--effort', type=float, default=1.0, metavar='TIMES',
                        help='how many times the usual budget may be spent before the proof is given up (%(default)s)')
    arguments = parser.parse_args(argv)
    try:
        print(f'{arguments.certificate}: {_sentence(arguments.certificate, arguments.effort)}')
    except Refused as error:
        print(f'{arguments.certificate}: refused: {error}', file=sys.stderr)
        return REFUSED
    return OK


def _sentence(path: Path, effort: float) -> str:
    try:
        import flint  # noqa: F401
    except ImportError:
        raise Refused("this needs balls rounded outwards: pip install 'dragon_ros[verify]', or pip install "
                      'python-flint') from None
    from dragon_ros.verify.proof import prove
    from dragon_ros.verify.reading import read
    proved = prove(read(path), effort, _Progress())
    return f'{proved.sentence} (proved in {proved.intervals} intervals)'


class _Progress:
    """Tells on stderr how much of the track is cleared, on one line where that is a terminal."""

    def __init__(self) -> None:
        self._next_s = time.monotonic() + 1

    def __call__(self, done_m: float, whole_m: float) -> None:
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + (_EVERY_S if sys.stderr.isatty() else 10 * _EVERY_S)
            end = '\r' if sys.stderr.isatty() else '\n'
            print(f'verify: {done_m:.6g} of {whole_m:.6g} m of track cleared', end=end, file=sys.stderr, flush=True)
