"""``cost tick``: the time of each stage of a tick, by solver, with messages as objects and as bytes.

Each stage is compared with the machine's limit: the shortest time in which the machine could multiply and copy the same
amounts.
"""
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import mean

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.passes import PASSES, fastest
from benchmarks.rates import limit, tick_rates, times
from benchmarks.solvers import CHAIN_SOLVERS
from benchmarks.stages import STAGES, needs_of, stages_of
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.dds_domain import free_domain, local_environment
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT
from dragon_ros.core.scene import Scene
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed, timing_of

_TIMES_S = (0.0, 60.0, 150.0, 240.0, 300.0, 360.0, 400.0, 412.0)
_ALL = (*STAGES, 'publish')
_OBJECTS, _BYTES = 'objects', 'bytes'
_COLOURS = ('#999999', '#0072B2', '#56B4E9', '#009E73', '#E69F00', '#D55E00', '#CC79A7')    # Okabe-Ito
_LONGEST_S = 120.0


@dataclass(frozen=True)
class Row:
    """One way to compute a tick: solver, kind of messages, and the time of each stage."""

    solver: str
    messages: str
    stages: dict[str, Timing]

    @property
    def total_s(self) -> float:
        """The sum of all stages in seconds."""
        return sum(timing.median_s for timing in self.stages.values())

    @property
    def name(self) -> str:
        """The label of the row's bar."""
        return f'{self.solver}, {self.messages}'


@dataclass(frozen=True)
class Measured:
    """All rows of the page, and the machine's limit (s) for each stage."""

    rows: list[Row]
    limits_s: dict[str, float]

    def limit_s(self, row: Row) -> float:
        """Return the limit for all stages of a row together."""
        return sum(self.limits_s[stage] for stage in row.stages)


def measure(budget_s: float = 0.3) -> Measured:
    """Measure everything; progress goes to standard error. In the first row, messages are built as objects."""
    calls = {(solver, stage): call for solver in CHAIN_SOLVERS for stage, call in _calls(solver).items()}
    passes: list[list[Timing]] = []
    published: list[dict[str, Timing]] = []
    with tqdm(total=PASSES * len(calls), desc='cost tick', unit='stage', disable=None) as bar:
        for _ in range(PASSES):
            published.append(_messages(budget_s))
            passes.append([])
            for call in calls.values():
                passes[-1].append(timed(call, budget_s / PASSES, 5).shared_by(len(_TIMES_S)))
                bar.update()
    stages = dict(zip(calls, fastest(passes), strict=True))
    published = [one for one in published if one]
    messages = dict(zip(next(iter(published), {}), fastest([list(one.values()) for one in published]), strict=True))
    publish = {'publish': messages['bytes publish']} if messages else {}
    rows = [Row(solver, _BYTES, {stage: stages[solver, stage] for stage in STAGES} | publish)
            for solver in CHAIN_SOLVERS]
    first = rows[0]
    if not messages:
        return Measured(rows, _limits_s(budget_s))
    before = {**first.stages, 'encode': messages['objects encode'], 'publish': messages['objects publish']}
    return Measured([Row(first.solver, _OBJECTS, before), *rows], _limits_s(budget_s))


def _limits_s(budget_s: float) -> dict[str, float]:
    """Return the machine's limit for each stage; publishing must at least copy the bytes of the messages."""
    rates, needs = tick_rates(budget_s), [needs_of(Scene(), t_s) for t_s in _TIMES_S]
    limits_s = {name: mean(limit(at[name], rates)[0] for at in needs) for name in STAGES}
    return limits_s | {'publish': limits_s['encode']}


def _all_of(calls: list[Callable[[], object]]) -> list[object]:
    return [call() for call in calls]


def _calls(solver: str) -> dict[str, Callable[[], object]]:
    """Return for each stage a call that computes it at all times."""
    at = [stages_of(Scene(), solver, t_s) for t_s in _TIMES_S]
    return {name: partial(_all_of, [calls[name] for calls in at]) for name in STAGES}


def _messages(budget_s: float) -> dict[str, Timing]:
    """Return the cost of building and publishing messages, measured in a process with rclpy, or {} without rclpy."""
    done = subprocess.run([sys.executable, '-m', 'benchmarks.publish_cost', str(budget_s)],
                          capture_output=True, text=True, check=False, timeout=_LONGEST_S,
                          env=local_environment(free_domain()))
    if done.returncode:
        print(f'cost: publishing is omitted: {(done.stderr.strip().splitlines() or ["?"])[-1]}', file=sys.stderr)
        return {}
    spent: dict[str, list[float]] = json.loads(done.stdout)
    return {name: timing_of(each) for name, each in spent.items()}


def table(rows: Measured) -> str:
    """Return the rows as a Markdown table, after a line that states the machine, the versions and the date."""
    head = ('| solver | messages | ' + ' | '.join(f'{name} (µs)' for name in _ALL)
            + ' | all (µs) | times faster | times the limit |\n|---|---|' + '---:|' * (len(_ALL) + 3))
    lines = [_line(row, rows.rows[0].total_s, rows.limit_s(row)) for row in rows.rows]
    limits = ' | '.join(f'{1e6 * rows.limits_s[name]:.3g}' if rows.limits_s[name] else '-' for name in _ALL)
    lines.append(f'| limit of the machine | | {limits} | {1e6 * sum(rows.limits_s.values()):.3g} | | 1.00 |')
    return '\n'.join([f'{circumstances()}. Each time is the median of the fastest of {PASSES} passes.', '', head,
                      *lines])


def _line(row: Row, before_s: float, limit_s: float) -> str:
    cells = [f'{row.stages[name].median_s * 1e6:.1f}' if name in row.stages else '-' for name in _ALL]
    return (f'| {row.solver} | {row.messages} | ' + ' | '.join(cells)
            + f' | {row.total_s * 1e6:.0f} | {before_s / row.total_s:.1f} '
            f'| {times(row.total_s, limit_s)} |')


def csv_text(rows: Measured) -> str:
    """Return the rows as CSV, with one line per stage and times in seconds."""
    return csv_of(['solver', 'messages', 'stage', 'limit_s', *TIMES],
                  [(row.solver, row.messages, stage, rows.limits_s[stage], *timing.cells)
                   for row in rows.rows for stage, timing in row.stages.items()])


def picture(measured: Measured) -> Figure:
    """Return a figure of stacked bars: all rows and, on a larger scale, the rows that build messages as bytes."""
    rows = measured.rows
    figure = Figure(figsize=(PAGE_IN, 0.8 * len(rows) + 3.2), layout='constrained')
    before, after = figure.subplots(2, 1)
    _bars(before, rows)
    _bars(after, [row for row in rows if row.messages == _BYTES])
    before.set_title('One tick of 223 benches, before and after')
    after.set_title('After: messages are bytes')
    handles, labels = before.get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside upper center', ncols=len(_ALL), fontsize=TEXT_PT)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure


def _bars(axes: Axes, rows: list[Row]) -> None:
    names, left = [row.name for row in rows], [0.0] * len(rows)
    for stage, colour in zip(_ALL, _COLOURS, strict=True):
        width = [row.stages[stage].median_s * 1e6 if stage in row.stages else 0.0 for row in rows]
        axes.barh(names, width, left=left, color=colour, label=stage)
        left = [start + more for start, more in zip(left, width, strict=True)]
    for row, end in enumerate(left):
        axes.annotate(f'{end:,.0f}', (end, row), xytext=(4, 0), textcoords='offset points', va='center',
                      fontsize=TEXT_PT)
    axes.invert_yaxis()
    axes.margins(x=0.12)
    axes.set_xlabel('time (µs)')
    axes.grid(True, axis='x', linewidth=0.4)
    axes.set_axisbelow(True)
