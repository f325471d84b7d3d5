"""``cost simulate``: how fast one or several processes write a scene's bag, compared with copying it."""
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
_REPEATS = 3            # number of runs; the fastest run counts, since other load can only slow runs down
_PINNED = 0             # stands for one worker that may use only one core


@dataclass(frozen=True)
class Written:
    """The bag of a run, written by a number of workers (``_PINNED``: one worker on a single core) or copied (None).

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
        return 'one worker on one core' if self.workers == _PINNED else f'--workers {self.workers}'


def measure(budget_s: float = 0.3) -> list[Written]:
    """Write the bag of the classic dragon with each number of workers, and copy it."""
    cores = workers_of(None)
    run_s = min(_LONGEST_S, _LENGTHS * budget_s)
    kinds: list[int | None] = [_PINNED, *range(1, 2 * cores + 1), None]
    with TemporaryDirectory() as folder:
        return [min((_timed(kind, run_s, Path(folder)) for _ in range(_REPEATS)), key=lambda one: one.wall_s)
                for kind in Progress('cost simulate', 'parts', len(kinds))(kinds)]


def _timed(workers: int | None, run_s: float, folder: Path) -> Written:
    bag = folder / 'run.mcap'
    began = time.perf_counter()
    if workers is None:
        shutil.copyfile(bag, folder / 'copy.mcap')
        return Written(None, run_s, time.perf_counter() - began, 0.0, 0.0, bag.stat().st_size / 1e6)
    command = [sys.executable, '-m', 'dragon_ros', 'simulate', '--scene', 'winding', '--set', f'run.stop_s={run_s}',
               '--force', '--workers', str(max(1, workers)), '--output', str(bag)]
    child = os.posix_spawn(sys.executable, _on_one_core(command) if workers == _PINNED else command, os.environ,
                           file_actions=[(os.POSIX_SPAWN_OPEN, 2, os.devnull, os.O_WRONLY, 0)])
    _, status, used = os.wait4(child, 0)
    assert status == 0
    return Written(workers, run_s, time.perf_counter() - began, used.ru_utime + used.ru_stime,
                   used.ru_maxrss * 1024 / 1e6, bag.stat().st_size / 1e6)


def _on_one_core(command: list[str]) -> list[str]:
    program = ('import os, sys; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); '
               'os.execv(sys.executable, sys.argv[1:])')
    return [command[0], '-c', program, *command]


def table(rows: list[Written]) -> str:
    """Return the measured rows as Markdown, after a line that states the machine, the versions and the date."""
    alone = rows[0].wall_s
    lines = [f'{circumstances()}. {workers_of(None)} cores; {rows[0].run_s:g} s of the classic dragon at 50 Hz, '
             f'{rows[0].mb:.0f} MB.', '',
             '| written by | seconds | times real time | times one core | CPU (s) | peak memory of a process (MB) |',
             '|---|---:|---:|---:|---:|---:|']
    for row in rows:
        more = '| | |' if row.workers is None else f'| {row.cpu_s:.2f} | {row.memory_mb:.0f} |'
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
