"""``cost scale``: time and memory of each stage for 10 to 20,000 benches, and sustained rates of processes."""
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.live import RATES_HZ, ROLES, Live, highest, run
from benchmarks.rates import limit, product_rate, stage_copy_rate, times
from benchmarks.solvers import CHAIN_SOLVERS
from benchmarks.stages import STAGES, needs_of, stages_of
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT, legend_below
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.shift_map.table import Tile
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed

SIZES = (10, 30, 100, 223, 1000, 3000, 10_000, 20_000)
LIVE = (223, 2000, 20_000)
USUAL = (223, 50)        # number of benches and ticks per second in most runs
_AT_S = 300.0
_FITTED = 1000          # exponents are fitted to sizes from here on
_LIVE_TIMES = 10        # duration of a live run, in timing budgets
_COLOURS = dict(zip(STAGES, ('#999999', '#0072B2', '#56B4E9', '#009E73', '#E69F00', '#D55E00'), strict=True))

_OF_SOLVERS = ('chain', 'velocities')    # the stages in which solvers differ


@dataclass(frozen=True)
class Stage:
    """One stage at one number of benches: its time, and its peak memory in bytes."""

    solver: str
    stage: str
    benches: int
    timing: Timing
    peak_bytes: int


@dataclass(frozen=True)
class Build:
    """The shift table of a dragon: its number of rows and series terms, its build time in seconds, and its bytes."""

    benches: int
    rows: int
    terms: int
    seconds: float
    memory_bytes: int


@dataclass(frozen=True)
class Measured:
    """All rows of the page; ``free`` holds runs that proceed as fast as the readers can follow.

    ``limits_s`` holds, by the number of benches, the machine's limit (s) for all stages together.
    """

    stages: list[Stage]
    free: list[Live]
    rates: list[Live]
    builds: list[Build]
    limits_s: dict[int, float]


def measure(budget_s: float = 0.3) -> Measured:
    """Measure everything; progress goes to standard error."""
    ways = [(solver, size) for solver in CHAIN_SOLVERS for size in SIZES]
    stages = [row for solver, size in tqdm(ways, desc='cost scale: stages', unit='size', disable=None)
              for row in _stages(solver, size, budget_s)]
    product = product_rate(budget_s)
    limits_s = {size: limit_of(Scene(dragon=Dragon(size)), product, budget_s) for size in SIZES}
    built = [build(Scene(dragon=Dragon(size))) for size in SIZES]
    free, rates = [], [run(*USUAL, round(USUAL[1] * _LIVE_TIMES * budget_s))]
    for benches in tqdm(LIVE, desc='cost scale: processes', unit='size', disable=None):
        free.append(run(benches, 0, max(20, round(_LIVE_TIMES * budget_s * 1e5 / (benches + 200)))))
        rates += highest(benches, _LIVE_TIMES * budget_s, free[-1].reached_hz)
    return Measured(stages, free, rates, [row for row in built if row], limits_s)


def limit_of(scene: Scene, product: float, budget_s: float) -> float:
    """Return the shortest possible time for all stages, if each copies at the machine's rate for that many bytes."""
    return sum(limit(amounts, {'product': product, 'cache': stage_copy_rate(amounts['cache'], budget_s)})[0]
               for amounts in needs_of(scene, _AT_S).values() if amounts)


def _stages(solver: str, benches: int, budget_s: float) -> list[Stage]:
    calls = stages_of(Scene(dragon=Dragon(benches)), solver, _AT_S)
    return [Stage(solver, name, benches, timed(call, budget_s, 3), _peak(call)) for name, call in calls.items()]


def _peak(call: Callable[[], object]) -> int:
    """Return the peak memory of a call in bytes, measured in a separate call, because tracing slows it down."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def build(scene: Scene) -> Build | None:
    """Return the cost of a shift map's first tile (the faster of two builds), or None if the scene has no map."""
    spent, tiles, travel_m = [], list[Tile](), scene.head.travelled_m(scene.run.start_s)
    for _ in range(2):
        model = replace(compile_scene(scene).model)     # a new model, without tiles
        leader = model.leader.place(travel_m)
        start = perf_counter()
        model.placement.place(leader)
        spent.append(perf_counter() - start)
        tiles = [tile for shift in model.placement.maps.values() for tile in shift.tiles]
    if not tiles:
        return None
    table = tiles[0].table
    return Build(scene.dragon.benches, table.rows, table.nodes, min(spent), table.memory_bytes)


def exponent(rows: list[Stage], value: Callable[[Stage], float]) -> float:
    """Return the exponent p such that a value grows as N^p, fitted to all sizes of at least 1000 benches."""
    mine = [row for row in rows if row.benches >= _FITTED]
    return float(np.polyfit(np.log([row.benches for row in mine]), np.log([value(row) for row in mine]), 1)[0])


def table(rows: Measured) -> str:
    """Return the tables of the default solver as Markdown, after a line with the machine, the versions and the date."""
    parts = [f'{circumstances()}. Times are medians that exclude the first call.']
    default = [row for row in rows.stages if row.solver == rows.stages[-1].solver]
    parts += [_stage_table('ms of N benches', default, _milliseconds, '.3g', rows.limits_s),
              _stage_table('MB at once', default, _megabytes, '.3g')]
    return '\n\n'.join([*parts, _build_table(rows.builds), _live_table(rows)])


def _stage_table(title: str, rows: list[Stage], value: Callable[[Stage], float], form: str,
                 limits_s: dict[int, float] | None = None) -> str:
    columns = [*STAGES, 'times the limit'] if limits_s else STAGES
    lines = [f'| {title} | ' + ' | '.join(columns) + ' |', '|---:|' + '---:|' * len(columns)]
    for size in dict.fromkeys(row.benches for row in rows):
        mine = [row for row in rows if row.benches == size]
        cells = [f'{value(row):{form}}' for row in mine]
        if limits_s:
            cells.append(times(sum(row.timing.median_s for row in mine), limits_s[size]))
        lines.append(f'| {size:,} | ' + ' | '.join(cells) + ' |')
    powers = [f'N^{exponent([row for row in rows if row.stage == stage], value):.2f}' for stage in STAGES]
    powers += [''] if limits_s else []
    return '\n'.join([*lines, '| from 1,000 on | ' + ' | '.join(powers) + ' |'])


def _milliseconds(row: Stage) -> float:
    return row.timing.median_s * 1e3


def _megabytes(row: Stage) -> float:
    return row.peak_bytes / 1e6


def _build_table(rows: list[Build]) -> str:
    """Return the rows as a Markdown table."""
    lines = ['| shift table of N benches | rows | terms | built in (ms) | memory (MB) |', '|---:|---:|---:|---:|---:|']
    lines += [f'| {row.benches:,} | {row.rows:,} | {row.terms} | {row.seconds * 1e3:.3g} '
              f'| {row.memory_bytes / 1e6:.3g} |'
              for row in rows]
    return '\n'.join(lines)


def _live_table(rows: Measured) -> str:
    """Return a table of live runs: free runs, then runs at increasing rates up to the first that is not sustained."""
    lines = ['| benches | rate (Hz) | reached (Hz) | times real time | overruns | lost | held | '
             + ' | '.join(f'{role} (cores)' for role in ROLES) + ' | growth of record (MB) |',
             '|---:|---:|---:|---:|---:|---:|---|' + '---:|' * (len(ROLES) + 1)]
    for row in sorted([*rows.free, *rows.rates], key=lambda row: (row.benches, row.rate_hz)):
        factor = f'{row.reached_hz / 50:.1f}' if not row.rate_hz else f'{row.reached_hz / row.rate_hz:.2f}'
        cores = ' | '.join(f'{row.usage[role].cores:.2f}' for role in ROLES)
        held = ('yes' if row.held else 'no') if row.rate_hz else '-'
        lines.append(f'| {row.benches:,} | {f"{row.rate_hz:g}" if row.rate_hz else "free"} | {row.reached_hz:.0f} '
                     f'| {factor} | {row.overruns} of {row.ticks:,} | {row.lost} | {held} | {cores} '
                     f'| {row.usage["record"].grown_mb:.1f} |')
    return '\n'.join(lines) + ('\n\nFree runs proceed as fast as the readers can follow, with ticks of 0.02 s. "Held" '
                               'means no overrun and no lost message, with `sim`, `monitor` and `record` connected '
                               'over DDS on this host.')


def csv_text(rows: Measured) -> str:
    """Return the rows as CSV: stages with time and memory, then live runs."""
    stages = [(row.stage, row.solver, row.benches, *row.timing.cells, row.peak_bytes, *[''] * 9)
              for row in rows.stages]
    builds = [('build', 'table', one.benches, one.seconds, '', '', 2, one.memory_bytes, *[''] * 9)
              for one in rows.builds]
    limits = [('limit', '', size, limit_s, *[''] * 13) for size, limit_s in rows.limits_s.items()]
    lives = [('live', '', live.benches, *[''] * 5, live.rate_hz, live.ticks, live.wall_s, live.overruns, live.lost,
              *(live.usage[role].cores for role in ROLES), live.usage['record'].grown_mb)
             for live in [*rows.free, *rows.rates]]
    return csv_of(['what', 'solver', 'benches', *TIMES, 'peak_bytes', 'rate_hz', 'ticks', 'wall_s', 'overruns', 'lost',
                   *(f'{role}_cores' for role in ROLES), 'record_grown_mb'], [*stages, *limits, *builds, *lives])


def picture(rows: Measured) -> Figure:
    """Return a figure of three panels: time and memory of the stages against N, and the sustained rates."""
    figure = Figure(figsize=(PAGE_IN, 17), layout='constrained')
    time_axes, memory, rates = figure.subplots(3, 1)
    _growth(time_axes, rows.stages, _milliseconds, 'time (ms)', 'Time of each stage')
    _growth(memory, rows.stages, _megabytes, 'memory at once (MB)', 'Memory of each stage')
    _rates(rates, rows)
    for axes in (time_axes, memory, rates):
        axes.grid(True, which='major', linewidth=0.4)
        axes.set_xlabel('benches N')
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure


def _growth(axes: Axes, rows: list[Stage], value: Callable[[Stage], float], unit: str, title: str) -> None:
    solvers = [*dict.fromkeys(row.solver for row in rows)][::-1]     # the default first
    for style, solver in zip(('-', '--', ':'), solvers, strict=False):
        for stage in STAGES if style == '-' else _OF_SOLVERS:
            mine = [row for row in rows if (row.solver, row.stage) == (solver, stage)]
            name = f'{stage} ({solver})' if stage in _OF_SOLVERS else stage
            axes.loglog([row.benches for row in mine], [value(row) for row in mine], f'o{style}', markersize=4,
                        color=_COLOURS[stage], label=f'{name}: N^{exponent(mine, value):.2f}')
    axes.set(ylabel=unit, title=title)
    legend_below(axes, fontsize=TEXT_PT)


def _rates(axes: Axes, rows: Measured) -> None:
    for row in rows.rates:
        axes.plot(row.benches, row.rate_hz, 'o' if row.held else 'x', color='#0072B2' if row.held else '#D55E00',
                  markersize=8)
    axes.plot([row.benches for row in rows.free], [row.reached_hz for row in rows.free], 's-', color='#999999',
              label='free: as fast as the readers can follow')
    axes.plot([], [], 'o', color='#0072B2', label='held: no overrun, nothing lost')
    axes.plot([], [], 'x', color='#D55E00', label='not held')
    axes.set(xscale='log', yscale='log', ylabel='ticks per second', ylim=(0.5 * RATES_HZ[0], 2 * RATES_HZ[-1]),
             title='Sim, monitor and recorder over DDS')
    legend_below(axes, 1, fontsize=TEXT_PT)
