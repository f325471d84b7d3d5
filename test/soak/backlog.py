"""Show that a recorder's memory grows only with the longest time for which it is stopped.

Start this program by hand: ``./dragon python test/soak/backlog.py``. While a sim runs at 100 Hz, the recorder is
stopped for increasing durations, several times each, and then runs for three minutes. ``in use`` is the memory that
malloc has allocated to Python and the middleware; ``free`` is the memory that malloc keeps for later use.
"""
import argparse
import ctypes
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.cli.dds_domain import free_domain, local_environment
from dragon_ros.nodes import shell
from dragon_ros.nodes.record import Recorder

_STALLS_S = (0.0, 0.5, 0.5, 0.5, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 1.0, 4.0, 4.0, 1.0)
_REST_S = 3.0
_FIELDS = ('arena', 'ordblks', 'smblks', 'hblks', 'hblkhd', 'usmblks', 'fsmblks', 'uordblks', 'fordblks', 'keepcost')


class _Allocated(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_size_t) for name in _FIELDS)


def told() -> str:
    """Return, as text, this process's anonymous memory, and how much of malloc's memory is in use and free."""
    libc = ctypes.CDLL('libc.so.6')
    libc.mallinfo2.restype = _Allocated
    found = libc.mallinfo2()
    rows = Path('/proc/self/smaps_rollup').read_text().splitlines()
    anonymous_kb = next(int(row.split()[1]) for row in rows if row.startswith('Anonymous:'))
    return (f'{anonymous_kb / 1000:6.1f} MB, in use {(found.uordblks + found.hblkhd) / 1e6:5.1f} MB, '
            f'free {found.fordblks / 1e6:5.1f} MB')


def grow(folder: Path, rest_s: float, stop: threading.Event) -> int:
    """Record, stop repeatedly for a while, and print the memory use after each stop."""
    node = Recorder(BagWriter(folder / 'bag'))
    waiting = [*((stall_s, _REST_S) for stall_s in _STALLS_S), (0.0, rest_s)]
    said, due_s = 'at the beginning', time.monotonic() + 6 * _REST_S

    def stand_still() -> bool:
        nonlocal said, due_s
        node.poll(True)
        if time.monotonic() < due_s:
            return False
        print(f'{said:24} {told()}', flush=True)
        if not waiting:
            return True
        stall_s, then_s = waiting.pop(0)
        time.sleep(stall_s)
        said, due_s = f'{stall_s:g} s, then {then_s:g} s', time.monotonic() + then_s
        return False
    code = shell.spin(node, stop, stand_still)
    node.close()
    node.destroy_node()
    return code


def main(argv: list[str]) -> int:
    """Run a sim and a recorder, stop the recorder repeatedly, and print its memory use."""
    options = argparse.ArgumentParser(description=(__doc__ or '').split('\n')[0])
    options.add_argument('--rest', type=float, default=180.0, metavar='S', help='seconds without a stop at the end')
    arguments = options.parse_args(argv)
    os.environ.update(local_environment(free_domain()))
    sim = subprocess.Popen([sys.executable, '-m', 'dragon_ros', 'sim', '--scene', 'unwinding', '--set',
                            'run.rate_hz=100', '--set', 'run.stop_s=9999'])
    try:
        with tempfile.TemporaryDirectory() as folder:
            return shell.run('backlog', [], lambda stop: grow(Path(folder), arguments.rest, stop))
    finally:
        sim.kill()
        sim.wait()


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
