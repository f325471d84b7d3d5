"""``cost startup``: the start-up time of each executable, for its help and for a minimal task.

The limit for ``--help`` is a Python process that ends immediately; the limit for a task is one that imports only numpy.
"""
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.request import urlopen

from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.rates import times
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed

_MODULE = '-m', 'dragon_ros'
_BAG = 'simulate', '--force', '--set', 'run.stop_s=2', '--output'
HELP = '--help'
_BARE, _WITH_NUMPY = 'python', 'python with numpy'
FLOORS = {_BARE: ('-c', 'pass'), _WITH_NUMPY: ('-c', 'import numpy')}
# A minimal task for each executable. BAG is a bag of two seconds, and OUT is a file to write.
SMALLEST = {
    'table': 'table --times 60 --handles 0', 'contact': 'contact', 'inspect': 'inspect BAG',
    'export': 'export BAG --force --output OUT.csv',
    'simulate': 'simulate --force --set run.stop_s=2 --output OUT.mcap',
    'plot': 'plot dragon --output OUT.png', 'view': 'view --no-browser', 'design': 'design turn'}


@dataclass(frozen=True)
class Start:
    """An executable, its arguments, and the wall time from its start to its end."""

    name: str
    arguments: str
    timing: Timing


def measure(budget_s: float = 0.3) -> list[Start]:
    """Measure everything, each start in its own process; progress goes to standard error."""
    with TemporaryDirectory() as folder:
        bag, out = Path(folder) / 'run.mcap', Path(folder) / 'out'
        _run(*_MODULE, *_BAG, bag)
        jobs: list[tuple[str, str, Callable[[], None]]] = [
            (name, ' '.join(words), partial(_run, *words)) for name, words in FLOORS.items()]
        jobs += [(name, HELP, partial(_run, *_MODULE, name, HELP)) for name in names()]
        for name, line in SMALLEST.items():
            words = line.replace('BAG', str(bag)).replace('OUT', str(out)).split()
            jobs.append((name, line, partial(_first_frame if name == 'view' else _run, *_MODULE, *words)))
        return [Start(name, line, timed(job, budget_s)) for name, line, job in
                tqdm(jobs, desc='cost startup', unit='start', disable=None)]


def names() -> list[str]:
    """Return the names of all executables that the package's help lists."""
    listed = subprocess.run([sys.executable, *_MODULE, HELP], capture_output=True, text=True, check=True).stdout
    return re.findall(r'^  (\w+) ', listed, re.MULTILINE)


def _run(*words: str | Path) -> None:
    subprocess.run([sys.executable, *words], env=_environment(), capture_output=True, check=True)


def _first_frame(*words: str | Path) -> None:
    """Start ``view`` and receive its first frames."""
    with subprocess.Popen([sys.executable, *words], env=_environment(), stdout=subprocess.PIPE,
                          text=True) as view:
        assert view.stdout is not None
        address = next(word for word in view.stdout.readline().split() if word.startswith('http'))
        for name in ('run.json', 'frames/0'):
            with urlopen(address + name) as answer:
                answer.read()
        view.kill()         # view runs until it is killed


def _environment() -> dict[str, str]:
    """Return the environment without the variable that stops Python from storing compiled modules."""
    return {name: value for name, value in os.environ.items() if name != 'PYTHONDONTWRITEBYTECODE'}


def table(rows: list[Start]) -> str:
    """Return the rows as a Markdown table, with one executable per line."""
    done = {(row.name, row.arguments == HELP): row for row in rows}
    lines = [circumstances(), '', '| executable | `--help` (ms) | times python | smallest use | (ms) '
             '| times python with numpy |', '|---|---:|---:|---|---:|---:|']
    lines += [f'| {name} | | | `{done[name, False].arguments}` | {_ms(done[name, False])} | |' for name in FLOORS]
    for name in dict.fromkeys(row.name for row in rows if row.name not in FLOORS):
        use = done.get((name, False))
        lines.append(f'| `{name}` | {_ms(done[name, True])} | {_times(done[name, True], done[_BARE, False])} '
                     + (f'| `{use.arguments}` | {_ms(use)} | {_times(use, done[_WITH_NUMPY, False])} |' if use
                        else '| | | |'))
    return '\n'.join([*lines, '', 'Times are wall-clock times of a process from its start to its end, with modules '
                      'that are already compiled; for `view`, the time ends when the first frames have been received. '
                      'BAG is a bag of 2 s, and OUT is a file.'])


def _times(row: Start, floor: Start) -> str:
    return times(row.timing.median_s, floor.timing.median_s)


def _ms(row: Start) -> str:
    return f'{row.timing.median_s * 1e3:.0f}'


def csv_text(rows: list[Start]) -> str:
    """Return the rows as CSV."""
    return csv_of(['executable', 'arguments', *TIMES], [(row.name, row.arguments, *row.timing.cells) for row in rows])


def picture(rows: list[Start]) -> Figure:
    """Return a figure with a bar for each start: Python itself in grey, help in blue, minimal tasks in orange."""
    figure = Figure(figsize=(PAGE_IN, 0.28 * len(rows) + 1.2), layout='constrained')
    axes = figure.subplots()
    for n, row in enumerate(rows):
        colour = '#999999' if row.name in FLOORS else '#0072B2' if row.arguments == HELP else '#E69F00'
        axes.barh(n, row.timing.median_s * 1e3, 0.7, color=colour)
        axes.annotate(_ms(row), (row.timing.median_s * 1e3, n), xytext=(4, 0), textcoords='offset points', va='center',
                      fontsize=TEXT_PT)
    axes.set_yticks(range(len(rows)), [row.name if row.name in FLOORS else f'{row.name} {HELP}' if row.arguments == HELP
                                       else row.arguments for row in rows], fontsize=TEXT_PT)
    axes.invert_yaxis()
    axes.set(xlabel='time (ms)', title='From the start of a process to its end')
    axes.margins(x=0.1)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
