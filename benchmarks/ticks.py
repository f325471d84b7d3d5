"""``cost tick``: the time of each stage of a tick, for solvers and tiers, with messages as objects and as bytes."""
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from statistics import median, quantiles

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.solvers import CHAIN_SOLVERS
from benchmarks.stages import STAGES, stages_of
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.dds_domain import free_domain, local_environment
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT
from dragon_ros.core.scene import Scene
from dragon_ros.core.tiers import EXACT, PAPER, TIERS
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed

_TIMES_S = (0.0, 60.0, 150.0, 240.0, 300.0, 360.0, 400.0, 412.0)
_ALL = (*STAGES, 'publish')
_OBJECTS, _BYTES = 'objects', 'bytes'
_COLOURS = ('#999999', '#0072B2', '#56B4E9', '#009E73', '#E69F00', '#D55E00', '#CC79A7')    # Okabe-Ito
_LONGEST_S = 120.0


@dataclass(frozen=True)
class Row:
    """One way to compute a tick: solver, tier, kind of messages, and the time of each stage."""

    solver: str
    tier: str
    messages: str
    stages: dict[str, Timing]

    @property
    def total_s(self) -> float:
        """The sum of all stages in seconds."""
        return sum(timing.median_s for timing in self.stages.values())

    @property
    def name(self) -> str:
        """The label of the row's bar."""
        return f'{self.solver}, {self.tier}, {self.messages}'


def measure(budget_s: float = 0.3) -> list[Row]:
    """Measure everything; progress goes to standard error. In the first row, messages are built as objects."""
    messages = _messages(budget_s)
    ways = [(solver, name) for solver in CHAIN_SOLVERS for name, tier in TIERS.items()
            if tier is EXACT or (tier is not PAPER and solver != 'plain')]
    rows = [_row(solver, tier, messages, budget_s) for solver, tier in
            tqdm(ways, desc='cost tick', unit='row', disable=None)]
    exact = next(row for row in rows if row.tier == 'exact')
    if 'objects encode' not in messages:
        return rows
    before = {**exact.stages, 'encode': messages['objects encode'], 'publish': messages['objects publish']}
    return [Row(exact.solver, exact.tier, _OBJECTS, before), *rows]


def _all_of(calls: list[Callable[[], object]]) -> list[object]:
    return [call() for call in calls]


def _row(solver: str, tier: str, messages: dict[str, Timing], budget_s: float) -> Row:
    scene = replace(Scene(), accuracy=tier)
    calls = [stages_of(scene, solver, t_s) for t_s in _TIMES_S]
    stages = {name: timed(partial(_all_of, [call[name] for call in calls]), budget_s, 5).shared_by(len(calls))
              for name in STAGES}
    if 'bytes publish' in messages:
        stages['publish'] = messages['bytes publish']
    return Row(solver, tier, _BYTES, stages)


def _messages(budget_s: float) -> dict[str, Timing]:
    """Return the cost of building and publishing messages, measured in a process with rclpy; {} if that is missing."""
    done = subprocess.run([sys.executable, '-m', 'benchmarks.publish_cost', str(budget_s)],
                          capture_output=True, text=True, check=False, timeout=_LONGEST_S,
                          env=local_environment(free_domain()))
    if done.returncode:
        print(f'cost: publishing is omitted: {(done.stderr.strip().splitlines() or ["?"])[-1]}', file=sys.stderr)
        return {}
    spent: dict[str, list[float]] = json.loads(done.stdout)
    return {name: Timing(median(each), quantiles(each, n=4)[0], quantiles(each, n=4)[2], len(each))
            for name, each in spent.items()}


def table(rows: list[Row]) -> str:
    """Return the rows as a Markdown table, below a line with the machine, versions and date."""
    head = ('| solver | tier | messages | ' + ' | '.join(f'{name} (µs)' for name in _ALL)
            + ' | all (µs) | times faster |\n|---|---|---|' + '---:|' * (len(_ALL) + 2))
    lines = [_line(row, rows[0].total_s) for row in rows]
    return '\n'.join([f'{circumstances()}. Times are medians that exclude the first call.', '', head, *lines])


def _line(row: Row, before_s: float) -> str:
    cells = [f'{row.stages[name].median_s * 1e6:.1f}' if name in row.stages else '-' for name in _ALL]
    return (f'| {row.solver} | {row.tier} | {row.messages} | ' + ' | '.join(cells)
            + f' | {row.total_s * 1e6:.0f} | {before_s / row.total_s:.1f} |')



def csv_text(rows: list[Row]) -> str:
    """Return the rows as CSV, one line per stage, times in seconds."""
    return csv_of(['solver', 'tier', 'messages', 'stage', *TIMES],
                  [(row.solver, row.tier, row.messages, stage, *timing.cells)
                   for row in rows for stage, timing in row.stages.items()])


def picture(rows: list[Row]) -> Figure:
    """Return a figure of stacked bars: all rows and, on a larger scale, the rows that build messages as bytes."""
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
