"""``cost simulate``: how fast several processes write a scene's bag, compared with independent commands and a copy."""
import os
import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure

from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import LINES, PAGE_IN, TEXT_PT
from dragon_ros.cli.pool import workers_of
from dragon_ros.cli.progress import Progress
from dragon_ros.cost.measure import circumstances

_LENGTHS = 1400         # seconds of the run for each second of the timing budget
_LONGEST_S = 432.0      # maximum duration of a run, shortly before the chain locks
_RATE_HZ = 100.0
_ROUNDS = 3             # number of runs of each kind; the fastest run counts, since other load can only slow runs down
# These stand for numbers of workers:
_PINNED = 0             # one worker that may use only one core
_APART = -1             # one command per core, each with one worker and an equal part of the run


@dataclass(frozen=True)
class Written:
    """A run, written by a number of workers (or by ``_PINNED`` or ``_APART``), or the copy of its bag (None).

    ``memory_mb`` is the peak resident memory of the largest process, and ``cpu_s`` is the CPU time of all processes.
    """

    workers: int | None
    run_s: float
    wall_s: float
    cpu_s: float
    memory_mb: float
    mb: float

    @property
    def name(self) -> str:
        """The name of the writer."""
        if self.workers is None:
            return 'copying its bytes'
        if self.workers == _APART:
            return f'{workers_of(None)} commands, each with a part of the run'
        return 'one worker on one core' if self.workers == _PINNED else f'--workers {self.workers}'


def measure(budget_s: float = 0.3) -> list[Written]:
    """Write the bag of the classic dragon with each number of workers, as separate commands, and copy it.

    The kinds of runs take turns, because the speed of a shared machine changes within minutes.
    """
    cores = sorted(os.sched_getaffinity(0))
    run_s = min(_LONGEST_S, _LENGTHS * budget_s)
    kinds: list[int | None] = [_PINNED, *range(1, 2 * len(cores) + 1), _APART, None]
    with TemporaryDirectory() as name:
        runs = [_timed(kind, run_s, Path(name), cores)
                for kind in Progress('cost simulate', 'runs', _ROUNDS * len(kinds))(_ROUNDS * kinds)]
    return [min(runs[n::len(kinds)], key=lambda one: one.wall_s) for n in range(len(kinds))]


def _timed(workers: int | None, run_s: float, folder: Path, cores: list[int]) -> Written:
    bag = folder / 'run.mcap'
    began = time.perf_counter()
    if workers is None:
        shutil.copyfile(bag, folder / 'copy.mcap')
        return Written(None, run_s, time.perf_counter() - began, 0.0, 0.0, bag.stat().st_size / 1e6)
    if workers == _APART:
        ends_s = [run_s * n / len(cores) for n in range(len(cores) + 1)]
        bags = [folder / f'part_{core}.mcap' for core in cores]
        children = [_started(part, ends_s[n:n + 2], 1, cores[n]) for n, part in enumerate(bags)]
    else:
        bags, children = [bag], [_started(bag, [0.0, run_s], max(1, workers), cores[0] if workers == _PINNED else None)]
    ended = [os.wait4(child, 0) for child in children]
    wall_s = time.perf_counter() - began
    assert not any(status for _, status, _ in ended)
    uses = [use for *_, use in ended]
    return Written(workers, run_s, wall_s, sum(use.ru_utime + use.ru_stime for use in uses),
                   max(use.ru_maxrss for use in uses) * 1024 / 1e6, sum(one.stat().st_size for one in bags) / 1e6)


def _started(bag: Path, ends_s: list[float], workers: int, core: int | None) -> int:
    """Start the command for a part of the run, pinned to ``core`` unless this is None; return its process ID."""
    command = [sys.executable, '-m', 'dragon_ros', 'simulate', '--scene', 'winding', '--rate', f'{_RATE_HZ:g}', '--set',
               f'run.start_s={ends_s[0]}', '--set', f'run.stop_s={ends_s[1]}', '--force', '--workers', str(workers),
               '--output', str(bag)]
    return os.posix_spawn(sys.executable, command if core is None else _on_core(command, core), os.environ,
                          file_actions=[(os.POSIX_SPAWN_OPEN, 2, os.devnull, os.O_WRONLY, 0)])


def _on_core(command: list[str], core: int) -> list[str]:
    program = f'import os, sys; os.sched_setaffinity(0, {{{core}}}); os.execv(sys.executable, sys.argv[1:])'
    return [command[0], '-c', program, *command]


def table(rows: list[Written]) -> str:
    """Return the measured rows as Markdown, after a line that states the machine, the versions and the date.

    The machine's limit is the time that separate commands take, since these share no work.
    """
    alone, apart = rows[0].wall_s, next(row.wall_s for row in rows if row.workers == _APART)
    lines = [f'{circumstances()}. {workers_of(None)} cores; {rows[0].run_s:g} s of the classic dragon at '
             f'{_RATE_HZ:g} Hz, {rows[0].mb:.0f} MB.', '',
             '| written by | seconds | times real time | times one core | time / limit | CPU (s) | peak memory of a '
             'process (MB) |', '|---|---:|---:|---:|---:|---:|---:|']
    for row in rows:
        more = '| | | |' if row.workers is None else (f'| {row.wall_s / apart:.2f} | {row.cpu_s:.2f} | '
                                                      f'{row.memory_mb:.0f} |')
        lines.append(f'| {row.name} | {row.wall_s:.2f} | {row.run_s / row.wall_s:.0f} | {alone / row.wall_s:.2f} '
                     f'{more}')
    return '\n'.join(lines)


def csv_text(rows: list[Written]) -> str:
    """Return the rows as CSV."""
    return csv_of(['written_by', 'run_s', 'wall_s', 'cpu_s', 'memory_mb', 'bag_mb'],
                  [(row.name, row.run_s, row.wall_s, row.cpu_s, row.memory_mb, row.mb) for row in rows])


def picture(rows: list[Written]) -> Figure:
    """Return a figure of the speed relative to real time; the copy is omitted, as it would hide the differences."""
    rows = [row for row in rows if row.workers is not None]
    figure = Figure(figsize=(PAGE_IN, 4.4), layout='constrained')
    axes = figure.subplots()
    axes.barh([row.name for row in rows], [row.run_s / row.wall_s for row in rows], color=LINES[0])
    axes.invert_yaxis()
    axes.set(xlabel='times real time', title='Speed of writing the bag of a run')
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
