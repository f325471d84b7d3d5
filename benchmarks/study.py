"""``cost study``: rows per second of studies on one and two workers, and the overhead per row."""
import resource
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event

from matplotlib.figure import Figure

from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import LINES, PAGE_IN, TEXT_PT
from dragon_ros.cli.progress import Progress
from dragon_ros.core.scene import Scene
from dragon_ros.core.words import counted
from dragon_ros.cost.measure import circumstances
from dragon_studies.dataset import writing
from dragon_studies.definition import Study, Uniform
from dragon_studies.questions import FirstContactQuestion, LockQuestion, Question
from dragon_studies.rows import rows_of
from dragon_studies.run import complete

WORKERS = (1, 2)
CORES = (2, 64, 1000)       # extrapolated
_PAPER_ROWS = 10**6
_BUDGETS = 100              # duration of a study, in timing budgets
_WARM = 4                   # number of rows that each worker computes before anything is timed
_PROBED_S = 0.5
_VARY = (('dragon.width_m', Uniform(0.25, 0.35)),)
TASKS: dict[str, Question] = {'first contact of the classic dragon': FirstContactQuestion(), 'its lock': LockQuestion()}


@dataclass(frozen=True)
class Row:
    """A study on a number of workers; 0 is this process without a data set.

    ``work_s`` is the CPU time (s) of the rows themselves, and ``cpu_s`` is that of all processes together: workers, and
    this process, which writes the rows. ``memory_mb`` is the largest resident memory of any worker.
    """

    task: str
    workers: int
    rows: int
    wall_s: float
    work_s: float
    cpu_s: float
    memory_mb: float

    @property
    def rate(self) -> float:
        """Rows per second."""
        return self.rows / self.wall_s

    @property
    def row_s(self) -> float:
        """The CPU time per row in seconds."""
        return self.work_s / self.rows

    @property
    def overhead_s(self) -> float:
        """The CPU time per row, in seconds, for processes, for Parquet and for drawing the inputs."""
        return (self.cpu_s - self.work_s) / self.rows


def measure(budget_s: float = 0.3) -> list[Row]:
    """Measure each study with each number of workers for about a hundred timing budgets."""
    jobs = [(name, workers) for name in TASKS for workers in (0, *WORKERS)]
    return [_timed(name, workers, _BUDGETS * budget_s) for name, workers in
            Progress('cost study', 'parts', len(jobs))(jobs)]


def _study(name: str, rows: int) -> Study:
    return Study(Scene(), _VARY, 'random', rows, ask=(TASKS[name],))


def _timed(name: str, workers: int, budget_s: float) -> Row:
    rows_of(_study(name, _WARM), range(_WARM))
    probed, start = 0, time.perf_counter()
    while (spent_s := time.perf_counter() - start) < min(_PROBED_S, budget_s) or not probed:
        rows_of(_study(name, _PAPER_ROWS), [_WARM + probed])
        probed += 1
    rows = max(_WARM, int(budget_s * max(1, workers) * probed / spent_s))
    return _on_workers(name, workers, rows) if workers else _alone(name, rows)


def _alone(name: str, rows: int) -> Row:
    start, cpu = time.perf_counter(), time.process_time()
    found = rows_of(_study(name, rows), range(rows))
    wall_s, cpu_s = time.perf_counter() - start, time.process_time() - cpu
    return Row(name, 0, rows, wall_s, sum(row['cpu_s'] for row in found), cpu_s, _most_mb())


def _on_workers(name: str, workers: int, rows: int) -> Row:
    with TemporaryDirectory() as folder, writing(Path(folder), _study(name, rows)) as data:
        start, cpu = time.perf_counter(), _cpu_s()
        complete(data, Event(), lambda progress: None, workers)
        wall_s, cpu_s = time.perf_counter() - start, _cpu_s() - cpu
        work_s = float(sum(data.table(['cpu_s']).column('cpu_s').to_pylist()))
        who = resource.RUSAGE_SELF if workers == 1 else resource.RUSAGE_CHILDREN
        return Row(name, workers, rows, wall_s, work_s, cpu_s, _most_mb(who))


def _cpu_s() -> float:
    """Return the CPU time of this process and its ended workers so far, in seconds."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in spent)


def _most_mb(who: int = resource.RUSAGE_SELF) -> float:
    return resource.getrusage(who).ru_maxrss * 1024 / 1e6


def table(rows: list[Row]) -> str:
    """Return measured and extrapolated rows as Markdown, after a line that states machine, versions and date."""
    lines = [f'{circumstances()}.', '',
             '| study | workers | rows | rows per second | CPU per row (ms) | overhead (ms) | overhead (%) | peak '
             'memory of a worker (MB) |', '|---|---:|---:|---:|---:|---:|---:|---:|']
    lines += [f'| {row.task} | {row.workers or "none"} | {row.rows:,} | {row.rate:.3g} | {1e3 * row.row_s:.3g} '
              f'| {1e3 * row.overhead_s:.3g} | {row.overhead_s / row.row_s:.1%} | {row.memory_mb:.0f} |'
              for row in rows]
    lines += ['', f'Extrapolated time of {_PAPER_ROWS:,} rows (from the CPU seconds with the most workers; not '
              'measured):', '', f'| study | {" | ".join(f"{cores:,} cores" for cores in CORES)} |',
              '|---|' + '---:|' * len(CORES)]
    for row in _most_workers(rows):
        spent = [_PAPER_ROWS * (row.row_s + row.overhead_s) / cores for cores in CORES]
        lines.append(f'| {row.task} | {" | ".join(map(_duration, spent))} |')
    return '\n'.join(lines)


def _most_workers(rows: list[Row]) -> list[Row]:
    return [max((row for row in rows if row.task == name), key=lambda row: row.workers) for name in TASKS]


def _duration(seconds: float) -> str:
    for unit, size in (('days', 86_400), ('h', 3600), ('min', 60)):
        if seconds >= 1.5 * size:
            return f'{seconds / size:.3g} {unit}'
    return f'{seconds:.3g} s'


def csv_text(rows: list[Row]) -> str:
    """Return the rows as CSV."""
    return csv_of(['study', 'workers', 'rows', 'wall_s', 'work_s', 'cpu_s', 'memory_mb'],
                  [(row.task, row.workers, row.rows, row.wall_s, row.work_s, row.cpu_s, row.memory_mb) for row in rows])


def picture(rows: list[Row]) -> Figure:
    """Return a figure of rows per second against the number of workers, with a panel for each study."""
    figure = Figure(figsize=(PAGE_IN, 4.4), layout='constrained')
    for axes, name in zip(figure.subplots(1, len(TASKS)), TASKS, strict=True):
        own = [row for row in rows if row.task == name]
        labels = [counted(row.workers, 'worker') if row.workers else 'rows only' for row in own]
        axes.bar(labels, [row.rate for row in own], color=[LINES[0] if row.workers else '#999999' for row in own])
        axes.set(ylabel='rows per second', title=name)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
