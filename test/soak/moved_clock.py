"""Record, monitor and replay a run while the system clock of its processes is set forwards and back by hours.

Start this program by hand: ``./dragon python test/soak/moved_clock.py --times 8``. The real clock is not changed: a
preloaded library, which a C compiler builds from ``moved_clock.c``, moves the clock of these processes and any waits
that depend on it. In each run both bags must equal the model, and all processes must end; otherwise the exit code is 1.
"""
import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from dragon_ros.cli.dds_domain import free_domain, local_environment

_PATIENCE_S = 180
_MOVES_S = (3600, -3600, 0, -7200)      # the offsets to which the clock is set, one after another
_MILLION = 1_000_000


def library(folder: Path) -> Path:
    """Compile the library."""
    out = folder / 'moved_clock.so'
    subprocess.run(['cc', '-shared', '-fPIC', '-O1', '-o', out, Path(__file__).with_suffix('.c'), '-ldl'], check=True)
    return out


class Moved:
    """Processes in one domain, whose common clock is set forwards and backwards."""

    def __init__(self, folder: Path, preloaded: Path, rng: random.Random) -> None:
        """Start moving the clock after a few seconds, possibly while nodes discover each other."""
        self._file, self._over = folder / 'moved', threading.Event()
        self._file.unlink(missing_ok=True)
        self._environment = {**local_environment(free_domain()), 'LD_PRELOAD': str(preloaded),
                             'MOVED_CLOCK': str(self._file)}
        waits_s = [rng.uniform(1, 5), *(rng.uniform(0.5, 3) for _ in _MOVES_S[1:])]
        self._thread = threading.Thread(target=self._move, args=(waits_s,))
        self._thread.start()

    def _move(self, waits_s: list[float]) -> None:
        for wait_s, moved_s in zip(waits_s, _MOVES_S, strict=True):
            if self._over.wait(wait_s):
                return
            self._file.touch()
            os.truncate(self._file, _MILLION + moved_s)

    def start(self, name: str, *arguments: object) -> subprocess.Popen[str]:
        """Start an executable."""
        return subprocess.Popen([sys.executable, '-m', 'dragon_ros', name, *map(str, arguments)], text=True,
                                env=self._environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def close(self) -> None:
        """Stop moving the clock."""
        self._over.set()
        self._thread.join()


def ended(name: str, process: subprocess.Popen[str], faults: list[str], codes: tuple[int, ...] = (0,)) -> None:
    """Wait for the end of a process, and record a fault if it fails or does not end."""
    try:
        errors = process.communicate(timeout=_PATIENCE_S)[1]
    except subprocess.TimeoutExpired:
        process.kill()
        errors = process.communicate()[1]
        faults.append(f'{name} stands still: {errors[-300:]}')
        return
    if process.returncode not in codes:
        faults.append(f'{name} ended with {process.returncode}: {errors[-300:]}')


def once(folder: Path, preloaded: Path, rng: random.Random) -> list[str]:
    """Run, record, monitor and replay; return the faults."""
    faults: list[str] = []
    for name in ('run', 'again'):
        moved = Moved(folder, preloaded, rng)
        record = moved.start('record', '--output', folder / f'{name}.mcap', '--force')
        monitor = moved.start('monitor')
        wait = 'wait_subscribers:=[handles=2,benches=2,velocities=1,scene=1]'
        player = moved.start('sim', '--scene', 'first_contact', '--ros-args', '-p', wait) if name == 'run' else (
            moved.start('replay', folder / 'run.mcap', '--wait-subscribers', '/dragon/handles=2,/dragon/benches=2'))
        ended(f'the player of {name}', player, faults)
        ended(f'the recorder of {name}', record, faults, (0, 3))    # 3: the beginning of a monitor's topic is missing
        monitor.send_signal(signal.SIGINT)
        ended(f'the monitor of {name}', monitor, faults)
        moved.close()
        check = subprocess.run([sys.executable, '-m', 'dragon_ros', 'inspect', folder / f'{name}.mcap', '--check'],
                               capture_output=True, text=True, check=False)
        if check.returncode:
            faults.append(f'{name}: {check.stdout[:300]}{check.stderr[:300]}')
    return faults


def main(argv: list[str]) -> int:
    """Run several times and print the faults."""
    options = argparse.ArgumentParser(description=(__doc__ or '').split('\n')[0])
    options.add_argument('--times', type=int, default=8, help='runs (8)')
    options.add_argument('--seed', type=int, default=1, help='seed for the times at which the clock is set (1)')
    arguments = options.parse_args(argv)
    rng, failed = random.Random(arguments.seed), 0
    with tempfile.TemporaryDirectory() as folder:
        preloaded = library(Path(folder))
        for number in range(arguments.times):
            faults = once(Path(folder), preloaded, rng)
            failed += bool(faults)
            print(f'{number + 1} of {arguments.times}: {"; ".join(faults) or "all ended, both bags equal the model"}',
                  flush=True)
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
