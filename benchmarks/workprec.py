"""``cost accuracy``: error against time on the classic dragon, for the package's solvers and for other methods.

The limit for a tick is the shortest time in which the machine could do the multiplications and copies of the product
with the shift map's table that places all handles.
"""
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from benchmarks.baselines import SOLVERS, compiled_newton, euler_steps, newton_over_times
from benchmarks.passes import PASSES, fastest
from benchmarks.rates import NUMBER, Amounts, limit, tick_rates, times
from benchmarks.stages import needs_of_chain
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT
from dragon_ros.core.batches import states
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed_in_turn
from hard_cases import hard_cases
from hard_cases.truth import truth

CLASSIC = next(problem for problem in hard_cases() if problem.name == 'classic')
_STEPS_S = (1.0, 0.1, 0.01)     # of the integration by Euler's method
_MANY = (301, 1000)             # numbers of ticks, from 0 to 300 s, that are placed in one call
_WRONG_M = 0.01                 # a larger error is called wrong
_OURS, _OTHER, _WRONG, _LINE = '#0072B2', '#E69F00', '#D55E00', '#595959'
# Where labels would overlap: their side, and their offset in points.
_PLACES = {'dragon_ros, 1,000 at once': ('left', -4, 9), 'dragon_ros, 301 at once': ('center', 0, -16),
           'dragon_ros, table': ('left', 8, -3), 'numba, Newton': ('right', -4, 9),
           'numpy, Newton, 1,000 at once': ('left', 0, 24), 'numpy, Newton, 301 at once': ('left', 0, 9),
           'scipy brentq': ('right', 0, 9), 'scipy fsolve': ('right', -8, -3),
           'plain Newton 1e-6 rad': ('right', 0, -16), 'bisection 1e-6 rad': ('left', 0, 9),
           'plain Newton 1e-3 rad': ('center', 0, 9),
           'plain Newton 1e-4 rad': ('center', 0, -16), 'Euler, steps of 0.01 s': ('right', -8, -3),
           "the paper's recipe": ('right', -8, -3)}
Call = Callable[[], object]


@dataclass(frozen=True)
class Method:
    """A method with its largest error and the call that takes its time, which computes a number of ticks."""

    name: str
    error_m: float
    call: Call
    ticks: int
    is_ours: bool = False
    is_batch: bool = False


@dataclass(frozen=True)
class Row:
    """A method with its time per tick and the machine's limit for it."""

    name: str
    error_m: float
    timing: Timing
    limit_s: float
    is_ours: bool = False

    @property
    def verdict(self) -> str:
        """'wrong' if the error exceeds a centimetre, otherwise ''."""
        return 'wrong' if self.error_m > _WRONG_M else ''


def measure(budget_s: float = 0.3) -> list[Row]:
    """Return a row for each method; their calls take turns, and of each, the fastest pass counts."""
    return timed(methods(), budget_s)


def timed(some: Sequence[Method], budget_s: float) -> list[Row]:
    """Return a row for each method."""
    passes, rates = list[list[Timing]](), list[Amounts]()
    for _ in range(PASSES):
        rates.append(tick_rates(budget_s))
        passes.append(timed_in_turn([one.call for one in some], budget_s, 3))
    best = {name: max(rate[name] for rate in rates) for name in rates[0]}
    return [Row(one.name, one.error_m, timing.shared_by(one.ticks),
                batch_limit_s(best) if one.is_batch else tick_limit_s(best), one.is_ours)
            for one, timing in zip(some, fastest(passes), strict=True)]


def methods() -> list[Method]:
    """Return all methods; the compiled one only if numba is installed."""
    scene, found = CLASSIC.scene, list[Method]()
    found += [_single('dragon_ros, table', partial(_placed, scene), True),
              _single('dragon_ros, march', partial(_placed, replace(scene, solver='march')), True),
              _single("the paper's recipe", partial(_placed, replace(scene, accuracy='paper')))]
    found += [_single(name, partial(solve, scene)) for name, solve in SOLVERS.items()]
    if compiled := compiled_newton():
        found.append(_single('numba, Newton', partial(compiled, scene)))
    found += [_euler(scene, step_s) for step_s in _STEPS_S]
    for ticks in _MANY:
        found += [_batch(f'dragon_ros, {ticks:,} at once', lambda t_s: states(scene, t_s).p, ticks, True),
                  _batch(f'numpy, Newton, {ticks:,} at once', partial(newton_over_times, scene), ticks)]
    return found


def _placed(scene: Scene, t_s: float) -> Floats:
    return state(scene, t_s).p


def _error_m(number: int, p: Floats) -> float:
    return float(np.max(truth(CLASSIC).distance(number, p[list(CLASSIC.handles)])))


def _single(name: str, solve: Callable[[float], Floats], is_ours: bool = False) -> Method:
    """Return a method that places one tick per call; only whole seconds have a state by the paper's recipe."""
    instants = [(n, t_s) for n, t_s in enumerate(CLASSIC.times_s) if 'paper' not in name or t_s == round(t_s)]
    error_m = max(_error_m(n, solve(t_s)) for n, t_s in instants)
    return Method(name, error_m, lambda: [solve(t_s) for _, t_s in instants], len(instants), is_ours)


def _batch(name: str, solve: Callable[[list[float]], Floats], ticks: int, is_ours: bool = False) -> Method:
    """Return a method that places many ticks in one call."""
    times_s = np.linspace(0, 300, ticks).tolist()
    error_m = max(map(_error_m, range(len(CLASSIC.times_s)), solve(list(CLASSIC.times_s))))
    return Method(name, error_m, partial(solve, times_s), ticks, is_ours, True)


def _euler(scene: Scene, step_s: float) -> Method:
    """Return the integration of all handles from 0 s; a tick is one second of the run."""
    start, advance = euler_steps(scene, step_s)

    def advanced(steps: int) -> Floats:
        chain = start
        for _ in range(steps):
            chain = advance(chain)
        return chain.p
    whole = [(n, t_s) for n, t_s in enumerate(CLASSIC.times_s) if abs(t_s - round(t_s / step_s) * step_s) < 1e-6]
    error_m = max(_error_m(n, advanced(round(t_s / step_s))) for n, t_s in whole)
    return Method(f'Euler, steps of {step_s:g} s', error_m, partial(advanced, round(1 / step_s)), 1)


def tick_limit_s(rates: Amounts) -> float:
    """Return the machine's limit for placing all handles at one time, averaged over the times of the problem."""
    return float(np.mean([limit(needs_of_chain(state(CLASSIC.scene, t_s)), rates)[0] for t_s in CLASSIC.times_s]))


def batch_limit_s(rates: Amounts) -> float:
    """Return the machine's limit per tick if many ticks are placed in one call and share the table rows they read."""
    needs = needs_of_chain(state(CLASSIC.scene, CLASSIC.times_s[0]))
    return limit({'product': needs['product'], 'cache': NUMBER * 2.0 * (CLASSIC.scene.dragon.benches + 1)}, rates)[0]


def table(rows: list[Row]) -> str:
    """Return the rows as a Markdown table, after a line that states the machine, the versions and the date."""
    head = '| method | largest error (m) | µs per tick | times the C limit | |\n|---|---:|---:|---:|---|'
    lines = [f'| {row.name} | {row.error_m:.1e} | {_us(row.timing.median_s)} | '
             f'{times(row.timing.median_s, row.limit_s)} | {row.verdict} |' for row in rows]
    return '\n'.join([f'{circumstances()}. Each time is the median of the fastest of {PASSES} passes.', '', head,
                      *lines])


def _us(seconds: float) -> str:
    return f'{seconds * 1e6:.1f}' if seconds < 20e-6 else f'{seconds * 1e6:.0f}'


def csv_text(rows: list[Row]) -> str:
    """Return the rows as CSV, with times in seconds."""
    return csv_of(['method', 'error_m', 'limit_s', *TIMES],
                  [(row.name, row.error_m, row.limit_s, *row.timing.cells) for row in rows])


def picture(rows: list[Row]) -> Figure:
    """Return the error against the time per tick, with the machine's limits as lines."""
    figure = Figure(figsize=(PAGE_IN, 7.5), layout='constrained')
    axes = figure.subplots()
    for row in rows:
        at = row.timing.median_s * 1e6, row.error_m
        colour = _OURS if row.is_ours else _WRONG if row.verdict else _OTHER
        axes.loglog(*at, 'o' if row.is_ours else 's', markersize=8, color=colour)
        side, dx, dy = _PLACES.get(row.name, ('left', 8, -3))
        axes.annotate(row.name + (' (wrong)' if row.verdict else ''), at, xytext=(dx, dy), textcoords='offset points',
                      ha=side, fontsize=TEXT_PT)
    for limit_s, words in {max(row.limit_s for row in rows): 'C limit', min(row.limit_s for row in rows):
                           'C limit, many at once'}.items():
        axes.axvline(limit_s * 1e6, color=_LINE, linestyle='--', linewidth=1)
        axes.annotate(words, (limit_s * 1e6, 1e-4), rotation=90, xytext=(-4, 0), textcoords='offset points',
                      ha='right', va='center', fontsize=TEXT_PT, color=_LINE)
    axes.set(xlabel='time per tick (µs): positions of 224 handles', ylabel='largest error (m)',
             title='The classic dragon: this package (circles) and other methods (squares)')
    axes.grid(True, which='major', linewidth=0.4)
    axes.margins(x=0.12, y=0.08)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
