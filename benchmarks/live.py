"""Sim, monitor and recorder as processes over DDS: sustained rate, CPU time, and losses."""
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil

from dragon_ros.bags.read.reader import BagReader
from dragon_ros.cli.dds_domain import free_domain, local_environment
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.errors import DragonError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene

ROLES = ('sim', 'monitor', 'record')
RATES_HZ = (5, 10, 20, 30, 50, 70, 100, 150, 200, 300, 500, 700, 1000, 1500, 2000, 3000)
_READERS = 'wait_subscribers:=[handles=2,benches=2,velocities=1]'
_COUNTED = ('handles', 'benches', 'velocities')
_START_S, _WALK_S = 100.0, 330.0     # the dragon locks 333 s after the start
_LONGEST_S = 300.0
_POLL_S = 0.05
_OVERRUNS, _SEEN = re.compile(r'; (\d+) overruns?\b'), re.compile(r'saw (\d+) ticks?\b')


@dataclass(frozen=True)
class Usage:
    """The CPU use of a process in cores, and the growth of its memory from the first to the last sample."""

    cores: float
    rss_mb: float
    grown_mb: float


@dataclass(frozen=True)
class Live:
    """A run: benches, rate (0: as fast as the readers can follow), ticks, wall time, overruns and losses."""

    benches: int
    rate_hz: float
    ticks: int
    wall_s: float
    overruns: int
    missing: dict[str, int]
    usage: dict[str, Usage] = field(default_factory=dict)

    @property
    def lost(self) -> int:
        """The number of messages that the recorder missed and of ticks that the monitor did not see."""
        return sum(self.missing.values())

    @property
    def held(self) -> bool:
        """Whether every tick was on time and every message arrived."""
        return not self.overruns and not self.lost

    @property
    def reached_hz(self) -> float:
        """The number of ticks per second of wall time."""
        return self.ticks / self.wall_s


def run(benches: int, rate_hz: float, ticks: int, markers: str = 'cubes') -> Live:
    """Run ``ticks`` ticks at ``rate_hz`` (0: as fast as the readers can follow) with a monitor and a recorder.

    Raises DragonError if the dragon locks earlier.
    """
    plan = planned(benches, rate_hz, ticks)
    with TemporaryDirectory() as name, processes(Path(name)) as start:
        bag = Path(name) / 'run.mcap'
        start('monitor')
        start('record', '--output', str(bag))
        start('sim', '--set', f'dragon.benches={benches}', '--set', f'markers={markers}', '--set',
              f'run.stop_s={plan.stop_s!r}', '--ros-args', '-p', f'start_s:={plan.start_s}', '-p',
              f'rate_hz:={plan.rate_hz}', '-p', f'time_scale:={1.0 if rate_hz else 0.0}', '-p', _READERS)
        wall_s, usage = _watched(start)
        ended(start.running['record'])
        start.running['monitor'].send_signal(signal.SIGINT)
        ended(start.running['monitor'])
        overruns, seen = (_number(*which) for which in ((_OVERRUNS, start.text()), (_SEEN, start.text('monitor'))))
        with BagReader(bag) as reader:
            counts = {topic.name.removeprefix('/dragon/'): topic.messages for topic in reader.topics}
    missing = {'seen': ticks - seen, **{topic: ticks - counts.get(topic, 0) for topic in _COUNTED}}
    return Live(benches, rate_hz, ticks, wall_s, overruns, missing, usage)


def planned(benches: int, rate_hz: float, ticks: int) -> Run:
    """Return a run of ``ticks`` ticks; one without a rate has 50 ticks per second, or more if it would be too long.

    Raises DragonError if the dragon locks before the last tick of a run with a rate.
    """
    rate = rate_hz or max(50.0, float(ceil(ticks / _WALK_S)))
    found = Run(_START_S, _START_S + (ticks - 1) / rate, rate)
    count = compile_scene(Scene(Dragon(benches), run=found)).last_tick + 1
    if count < ticks:
        raise DragonError(f'{ticks} ticks at {rate:g} Hz: the dragon locks after {count} ticks; measure fewer ticks')
    return found


def highest(benches: int, seconds: float, guess_hz: float) -> list[Live]:
    """Return runs at increasing rates, from about ``guess_hz`` up to the first rate that is not sustained."""
    below = [n for n, rate in enumerate(RATES_HZ) if rate <= guess_hz]
    at = below[-1] if below else 0
    tried: dict[int, Live] = {}
    while 0 <= at < len(RATES_HZ) and at not in tried:
        tried[at] = run(benches, RATES_HZ[at], max(20, round(RATES_HZ[at] * seconds)))
        at += 1 if tried[at].held else -1
    return [tried[n] for n in sorted(tried)]


class Start:
    """Starts ``python -m dragon_ros NAME ...`` for several nodes in one domain, with output to files."""

    def __init__(self, folder: Path) -> None:
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self._folder, self._environment = folder, {**local_environment(free_domain()), 'PYTHONUNBUFFERED': '1'}

    def __call__(self, name: str, *arguments: str) -> 'subprocess.Popen[bytes]':
        """Start and return one process."""
        with (self._folder / f'{name}.log').open('wb') as log:
            self.running[name] = subprocess.Popen([sys.executable, '-m', 'dragon_ros', name, *arguments], stdout=log,
                                                  stderr=log, stdin=subprocess.DEVNULL, env=self._environment)
        return self.running[name]

    def text(self, name: str = 'sim') -> str:
        """Return the output of a process."""
        return (self._folder / f'{name}.log').read_text(encoding='utf-8', errors='replace')


@contextmanager
def processes(folder: Path) -> Iterator[Start]:
    """Yield a function that starts processes; end them all when the block ends."""
    start = Start(folder)
    try:
        yield start
    finally:
        for process in start.running.values():
            process.send_signal(signal.SIGINT)
        for process in start.running.values():
            with suppress(subprocess.TimeoutExpired):
                process.wait(timeout=20)
            process.kill()


def _watched(start: Start) -> tuple[float, dict[str, Usage]]:
    """Wait for sim to end; return its wall time from the first tick, and the usage of each process."""
    deadline = time.monotonic() + _LONGEST_S
    while 'starting ' not in start.text():
        alive(start, deadline)
        time.sleep(_POLL_S)
    began, first = time.monotonic(), {name: _look(child.pid) for name, child in start.running.items()}
    while 'published: ' not in start.text():
        alive(start, deadline)
        time.sleep(_POLL_S)
    span, last = time.monotonic() - began, {name: _look(child.pid) for name, child in start.running.items()}
    return span, {name: Usage((last[name][0] - first[name][0]) / span, last[name][1], last[name][1] - first[name][1])
                  for name in ROLES}


def _look(pid: int) -> tuple[float, float]:
    """Return (CPU seconds so far, resident memory in MB) of a process."""
    process = psutil.Process(pid)
    times = process.cpu_times()
    return times.user + times.system, process.memory_info().rss / 1e6


def alive(start: Start, deadline: float) -> None:
    """Raise DragonError if a process has failed, or if the deadline (on the clock ``time.monotonic``) has passed."""
    for name, child in start.running.items():
        if child.poll():
            raise DragonError(f'{name} ended with exit code {child.returncode}: {start.text(name)[-500:]}')
    if time.monotonic() > deadline:
        raise DragonError('sim did not end in time')


def ended(process: 'subprocess.Popen[bytes]') -> None:
    """Wait for a process to end. Raises DragonError if the process hangs."""
    try:
        process.wait(timeout=_LONGEST_S)
    except subprocess.TimeoutExpired:
        raise DragonError(f'a process did not end within {_LONGEST_S:g} s of the run') from None


def _number(pattern: 're.Pattern[str]', text: str) -> int:
    """Return the number that a pattern finds in a log, or 0 if it finds none."""
    found = pattern.search(text)
    return int(found[1]) if found else 0
