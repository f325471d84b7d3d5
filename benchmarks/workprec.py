"""``cost accuracy``: error against time for every tier and for alternative solvers, in one run.

The limit for a tick is the shortest time in which the machine could do the multiplications and copies for a product
with the shift map's table or, if no table covers the handles, copy their coordinates.
"""
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.baselines import SOLVERS, euler_steps
from benchmarks.rates import NUMBER, Amounts, limit, tick_rates, times
from benchmarks.stages import needs_of_chain
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT, legend_below
from dragon_ros.core.batches import states, velocity_of
from dragon_ros.core.chain.chain import conditioning
from dragon_ros.core.errors import FieldError, ModelEnd
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.tiers import PAPER, TIERS, position_promise_m
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.cost.measure import PASSES, TIMES, Timing, circumstances, fastest, timed_in_turn
from hard_cases import Problem, hard_cases
from hard_cases.truth import truth

_TICK_S = 1.0           # interval between ticks for integrating solvers
_EULER_S = (1.0, 0.1, 0.01)
_MARCHED = ', marched'
_LABELS = {'plain Newton 1e-3 rad': ('right', -7, -3), 'preview, marched': ('center', 0, -13),
           'Euler 0.01 s': ('right', -7, -3),
           'plain Newton 1e-6 rad': ('right', -7, -3), 'plain Newton 1e-4 rad': ('left', 7, -3),
           'preview': ('center', 0, -13), 'paper': ('right', -9, -3),
           'exact, 301 at once': ('center', 0, 9), 'exact, 1,000 at once': ('center', 0, -13)}
Way = tuple[str, str]   # tier and solver
_WRONG_M = 0.01         # without a promise, solvers with a larger error are marked WRONG


@dataclass(frozen=True)
class Row:
    """One solver on one problem: its largest error, and its times per tick without and, if possible, with velocities.

    ``promise_m`` is None if the solver makes no promise. ``limit_s`` is the limit for the positions of a tick.
    """

    problem: str
    solver: str
    error_m: float
    promise_m: float | None
    timing: Timing | None
    note: str = ''
    with_velocities: Timing | None = None
    limit_s: float = 0.0

    @property
    def verdict(self) -> str:
        """'kept' or 'BROKEN' if there is a promise, otherwise '' or 'WRONG'; 'FAILS' if there is no answer."""
        if not np.isfinite(self.error_m):
            return 'FAILS'
        if self.promise_m is None:
            return 'WRONG' if self.error_m > _WRONG_M else ''
        return 'kept' if self.error_m <= self.promise_m else 'BROKEN'


@dataclass(frozen=True)
class Untimed:
    """A row without times, and the calls that take them: ``ticks`` ticks without and, if possible, with velocities."""

    row: Row
    calls: tuple[Callable[[], object], ...] = ()
    ticks: int = 1
    finish: Callable[[Row, Amounts], Row] | None = None     # adds what follows from the times and the machine's rates

    def timed(self, timings: Iterator[Timing], rates: Amounts) -> Row:
        """Return the row with the times of its calls, which are the next ones of ``timings``."""
        alone, both = [*(next(timings).shared_by(self.ticks) for _ in self.calls), None, None][:2]
        row = replace(self.row, timing=alone, with_velocities=both)
        return self.finish(row, rates) if self.finish else row


Job = list[Untimed]     # rows whose calls take turns, because their times are compared


def measure(budget_s: float = 0.3) -> list[Row]:
    """Measure everything; progress goes to standard error."""
    jobs = [job() for job in tqdm(list(_jobs()), desc='cost accuracy: errors', unit='job', disable=None)]
    rates, rows = timed_jobs(jobs, budget_s)
    limits_s = {problem.name: tick_limit_s(problem, rates) for problem in hard_cases()}
    return [row if row.limit_s else replace(row, limit_s=limits_s[row.problem]) for row in rows]


def timed_jobs(jobs: Sequence[Job], budget_s: float) -> tuple[Amounts, list[Row]]:
    """Return the machine's rates, and all rows with their times; of each call and rate, the fastest pass counts."""
    passes: list[list[Timing]] = []
    rates: list[Amounts] = []
    with tqdm(total=PASSES * len(jobs), desc='cost accuracy: times', unit='job', disable=None) as bar:
        for _ in range(PASSES):
            rates.append(tick_rates(budget_s))
            passes.append([])
            for job in jobs:
                passes[-1] += timed_in_turn([call for one in job for call in one.calls], budget_s / PASSES, 3)
                bar.update()
    best = {name: max(rate[name] for rate in rates) for name in rates[0]}
    timings = iter(fastest(passes))
    return best, [one.timed(timings, best) for job in jobs for one in job]


def tick_limit_s(problem: Problem, rates: Amounts) -> float:
    """Return the machine's limit for placing all handles at one time, averaged over the times of a problem.

    The chains are those of the finest tier that double precision can keep.
    """
    for tier in [name for name in reversed(TIERS) if name != 'paper']:
        try:
            scene = replace(problem.scene, accuracy=tier)
            compile_scene(scene)
        except FieldError:
            continue
        return float(np.mean([limit(needs_of_chain(state(scene, t_s)), rates)[0] for t_s in problem.times_s]))
    return 0.0


def batch_limit_s(scene: Scene, times_s: Sequence[float], rates: Amounts) -> float:
    """Return the machine's limit per tick if many ticks are placed in one call and share the table rows they read."""
    needs = needs_of_chain(state(scene, times_s[len(times_s) // 2]))
    return limit({'product': needs['product'], 'cache': NUMBER * 2.0 * (scene.dragon.benches + 1)}, rates)[0]


def _jobs() -> Iterator[Callable[[], Job]]:
    for problem in hard_cases():
        yield partial(_tiers, problem, tuple(_ways(problem)))
        # Other solvers support only one spiral, and take too long for thousands of benches.
        if problem.scene.dragon.benches < 20_000 and _is_one_spiral(problem.scene):
            for name in SOLVERS:
                yield partial(_baseline, problem, name)
        if problem.name == 'classic':
            yield partial(_batch, problem, 301)
            yield partial(_batch, problem, 1000)
            for step_s in _EULER_S:
                yield partial(_euler, problem, step_s)


def _ways(problem: Problem) -> Iterator[Way]:
    """Yield each tier with the default solver and, if this may be a table, also with the march."""
    for tier in TIERS:
        if tier != 'paper' or problem.name == 'classic':
            yield tier, 'table'
        if tier != 'paper' and compile_scene(problem.scene).model.placement.leader_map:
            yield tier, 'march'


def _is_one_spiral(scene: Scene) -> bool:
    return isinstance(scene.track, Spiral) and scene.head.lead == 'head'


def _tiers(problem: Problem, ways: Sequence[Way]) -> Job:
    """Return a row for each tier and solver."""
    return [_tier(problem, *way) for way in ways]


def _times_s(problem: Problem, tier: str) -> list[float]:
    return [t_s for t_s in problem.times_s if tier != 'paper' or t_s == round(t_s)]


def _place(scene: Scene, times_s: Sequence[float], velocities: bool) -> None:
    """Place the handles at all times given by a problem."""
    for t_s in times_s:
        chain = state(scene, t_s)
        if velocities:
            velocity_of(scene, chain, t_s)


def _tier(problem: Problem, tier: str, solver: str) -> Untimed:
    """Return the errors of a tier, solved with the default solver or with the march."""
    name = tier if solver == 'table' else f'{tier}{_MARCHED}'
    try:
        scene = replace(problem.scene, accuracy=tier, solver=solver)
        compiled = compile_scene(scene)
    except FieldError:
        return Untimed(Row(problem.name, name, np.inf, None, None,
                           'rejected: double precision cannot keep this promise'))
    times, error, worst = _times_s(problem, tier), 0.0, 1.0
    for number, t_s in enumerate(problem.times_s):
        if t_s in times:
            chain = state(scene, t_s)
            error = max(error, float(np.max(truth(problem).distance(number, chain.p[list(problem.handles)]))))
            worst = max(worst, conditioning(chain))
    note = ', '.join([chain.solver] + [f'conditioning {worst:.1e}'] * (worst > 2))
    promise = None if compiled.tier is PAPER else position_promise_m(compiled.tier, compiled.size_m, worst)
    row = Row(problem.name, name, error, promise, None, note)
    if not np.isfinite(error):
        return Untimed(row)
    return Untimed(row, tuple(partial(_place, scene, times, velocities) for velocities in (False, True)), len(times))


def _batch(problem: Problem, ticks: int) -> Job:
    """Return the row of the exact tier for many ticks, from 0 to 300 s, in one call."""
    scene, times_s = problem.scene, np.linspace(0, 300, ticks).tolist()
    chains = states(scene, problem.times_s)
    error = max(float(np.max(truth(problem).distance(number, p))) for number, p in enumerate(chains.p))

    def finish(row: Row, rates: Amounts) -> Row:
        assert row.with_velocities is not None
        handle_ns = row.with_velocities.median_s * 1e9 / (scene.dragon.benches + 1)
        return replace(row, limit_s=batch_limit_s(scene, times_s, rates),
                       note=f'{ticks:,} ticks in one call; {handle_ns:.1f} ns per handle with velocities')

    row = Row(problem.name, f'exact, {ticks:,} at once', error, compile_scene(scene).promise_m, None)
    return [Untimed(row, (lambda: states(scene, times_s),
                          lambda: velocity_of(scene, states(scene, times_s), times_s)), ticks, finish)]


def _baseline(problem: Problem, name: str) -> Job:
    solve, error = SOLVERS[name], 0.0

    def run() -> list[Floats]:
        with np.errstate(all='ignore'):
            return [solve(problem.scene, t_s) for t_s in problem.times_s]

    try:
        for number, p in enumerate(run()):
            error = max(error, float(np.max(truth(problem).distance(number, p[list(problem.handles)]))))
    except (ValueError, ArithmeticError, ModelEnd, RuntimeWarning) as trouble:
        return [Untimed(Row(problem.name, name, np.inf, None, None, type(trouble).__name__))]
    row = Row(problem.name, name, error if np.isfinite(error) else np.inf, None, None)
    return [Untimed(row, (run,), len(problem.times_s))]


def _euler(problem: Problem, step_s: float) -> Job:
    """Return the row of an integration of all handles from 0 s; a tick is one second of the run."""
    scene = problem.scene
    start, advance = euler_steps(scene, step_s)

    def tick() -> None:
        chain = start
        for _ in range(round(_TICK_S / step_s)):
            chain = advance(chain)

    chain, error, steps = start, 0.0, 0
    for number, t_s in enumerate(problem.times_s):
        wanted = round(t_s / step_s)
        if abs(wanted * step_s - t_s) > 1e-6:
            continue
        for _ in range(wanted - steps):
            chain = advance(chain)
        steps = wanted
        p = chain.p[list(problem.handles)]
        error = max(error, float(np.max(truth(problem).distance(number, p))))
    return [Untimed(Row(problem.name, f'Euler {step_s:g} s', error, None, None, 'a tick is 1 s'), (tick, tick))]


def _us(seconds: float) -> str:
    return f'{seconds * 1e6:.1f}' if seconds < 20e-6 else f'{seconds * 1e6:.0f}'


def table(rows: list[Row]) -> str:
    """Return the rows as a Markdown table, after a line that states the machine, the versions and the date."""
    head = ('| problem | solver | largest error (m) | promise (m) | verdict | µs per tick | quartiles | '
            'times the limit | with velocities | note |\n|---|---|---:|---:|---|---:|---|---:|---:|---|')
    return '\n'.join([f'{circumstances()}. Each time is the median of the fastest of {PASSES} passes.', '', head,
                      *map(_line, rows)])


def _line(row: Row) -> str:
    t = row.timing
    cells = (row.problem, row.solver, f'{row.error_m:.1e}' if np.isfinite(row.error_m) else '-',
             f'{row.promise_m:.1e}' if row.promise_m else '-',
             'rejected' if row.note.startswith('rejected') else row.verdict, _us(t.median_s) if t else '-',
             f'{_us(t.low_s)} to {_us(t.high_s)}' if t else '-',
             times(t.median_s, row.limit_s) if t else '-',
             _us(row.with_velocities.median_s) if row.with_velocities else '-',
             row.note.removeprefix('rejected: '))
    return '| ' + ' | '.join(cells) + ' |'


def csv_text(rows: list[Row]) -> str:
    """Return the rows as CSV, with times in seconds."""
    none = Timing(np.nan, np.nan, np.nan, 0)
    return csv_of(['problem', 'solver', 'error_m', 'promise_m', 'verdict', 'limit_s', *TIMES, 'note'],
                  [(row.problem, row.solver, row.error_m, row.promise_m, row.verdict, row.limit_s,
                    *(row.timing or none).cells, row.note) for row in rows])


def picture(rows: list[Row]) -> Figure:
    """Return the work-precision diagram: the classic scene, and the tiers on all hard cases."""
    figure = Figure(figsize=(PAGE_IN, 16), layout='constrained')
    classic, hard = figure.subplots(2, 1, height_ratios=(4, 5))
    mine = [row for row in rows if row.problem == 'classic' and row.timing and np.isfinite(row.error_m)]
    labels = _labels(mine)
    for row in mine:
        assert row.timing is not None
        own = row.solver.partition(',')[0] in TIERS
        side, x, y = _LABELS.get(row.solver, ('left', 7, 4))
        colour = '#0072B2' if own else '#D55E00' if row.verdict == 'WRONG' else '#E69F00'
        classic.loglog(row.timing.median_s * 1e6, row.error_m, 'o' if own else 's', markersize=8, color=colour)
        classic.annotate(labels[row.solver], (row.timing.median_s * 1e6, row.error_m), xytext=(x, y),
                         textcoords='offset points', ha=side, fontsize=TEXT_PT)
    classic.set(xlabel='time per tick (µs): positions of 224 handles', ylabel='largest error (m)',
                title='Classic scene: dragon_ros tiers (circles) and others (squares)')
    _hard_panel(hard, rows)
    for axes in (classic, hard):
        axes.grid(True, which='major', linewidth=0.4)
    classic.margins(x=0.18, y=0.08)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure


def _labels(rows: list[Row]) -> dict[str, str]:
    """Return the labels for solvers; tiers with equal errors share a label if all use tables or all are marched."""
    labels = {row.solver: f'{row.solver} (wrong)' if row.verdict == 'WRONG' else row.solver for row in rows}
    for error_m in {row.error_m for row in rows}:
        for way in ('', _MARCHED):
            alike = [tier for tier in TIERS if any((row.solver, row.error_m) == (tier + way, error_m) for row in rows)]
            if len(alike) > 1:
                labels |= {**dict.fromkeys((tier + way for tier in alike), ''),
                           alike[0] + way: f'{alike[0]} to {alike[-1]}{way}'}
    return labels


def _hard_panel(axes: Axes, rows: list[Row]) -> None:
    """For each tier, draw the error of every hard case as a share of its promise."""
    names = [problem.name for problem in hard_cases()]
    styles = {'preview': ('v', '#56B4E9'), 'standard': ('^', '#009E73'), 'fine': ('D', '#E69F00'),
              'exact': ('o', '#0072B2')}
    for tier, (marker, colour) in styles.items():
        mine = {row.problem: row for row in rows if row.solver == tier and np.isfinite(row.error_m) and row.promise_m}
        shares: Floats = np.array([max(mine[name].error_m / (mine[name].promise_m or 1), 1e-9) for name in mine])
        axes.semilogx(shares, [names.index(name) for name in mine], marker, color=colour,
                      label=tier, markersize=5, alpha=0.9)
    axes.axvline(1.0, color='black', linewidth=1)
    axes.set_yticks(range(len(names)), names, fontsize=TEXT_PT)
    axes.invert_yaxis()
    axes.set(xlabel='largest error / promise (1 is the limit)', title='Hard cases')
    legend_below(axes, 4, fontsize=TEXT_PT)
