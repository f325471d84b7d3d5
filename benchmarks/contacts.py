"""``cost contact``: the search for the first contact compared with sampling, and how the time of a check grows.

The limit for a search is the time needed to evaluate its states without any proof: to place their handles and to find
the smallest gap between benches of adjacent layers.
"""
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.growth import SIZES, Check, check_table, checks_of, panel
from benchmarks.rates import times
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.geometry.broad_phase import candidates
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import state
from dragon_ros.cost.measure import TIMES, circumstances, timed

T_STAR_S = 412.473837682115         # first contact of the classic run; every digit is correct
WIDER_S = 409.775927737801          # first contact with benches 1 mm wider; it lasts 0.11 s
_KNOWN_S = 1e-12                    # times that differ by less count as equal
_WRONG_S = 5e-7                     # if no bound is requested, times with a larger error are marked WRONG
_STEPS_S = (1.0, 0.1, 0.01)
_WANTED_S = (1e-3, 1e-6, 1e-9, 1e-12)
_WIDER = ', benches 1 mm wider'
_OWN = 'first_contact'
_SPREAD = 100           # number of times at which the evaluation of a state is timed


@dataclass(frozen=True)
class Search:
    """One method of finding a contact: its answer, the requested error, the overlap at that time, and the truth."""

    solver: str
    wanted_s: float | None
    t_s: float
    depth_m: float
    states: int
    spent_s: float
    true_s: float = T_STAR_S

    @property
    def late_s(self) -> float:
        """The delay (s) of the reported time relative to the contact."""
        return self.t_s - self.true_s

    @property
    def verdict(self) -> str:
        """'WRONG' if the error exceeds the requested bound or, if no bound was requested, 5e-7 s."""
        return 'WRONG' if abs(self.late_s) > max(self.wanted_s or _WRONG_S, _KNOWN_S) else 'right'


@dataclass(frozen=True)
class Measured:
    """All rows of the page, and the time (s) to evaluate one state."""

    searches: list[Search]
    checks: list[Check]
    state_s: float


def measure(budget_s: float = 0.3) -> Measured:
    """Measure everything; progress goes to standard error."""
    classic, wider = Scene(), Scene(dragon=Dragon(width_m=0.301))
    state_s = _state_s(classic, budget_s)
    jobs: list[Callable[[], list[Search] | list[Check]]] = [lambda: _found(budget_s, classic)]
    jobs += [partial(_scanned, step_s, classic) for step_s in _STEPS_S]
    jobs += [lambda: _polished(_WANTED_S, classic), lambda: _found(budget_s, wider, _WIDER, WIDER_S),
             lambda: _polished(_WANTED_S[-1:], wider, _WIDER, WIDER_S)]
    jobs += [partial(checks_of, size, budget_s) for size in SIZES]
    rows = [row for job in tqdm(jobs, desc='cost contact', unit='part', disable=None) for row in job()]
    return Measured([row for row in rows if isinstance(row, Search)], [row for row in rows if isinstance(row, Check)],
                    state_s)


def _state_s(scene: Scene, budget_s: float) -> float:
    """Return the average time (s) to evaluate a state of the classic run in the way that the sampling methods do."""
    times_s = np.linspace(0.0, T_STAR_S, _SPREAD).tolist()
    return timed(lambda: [_smallest(scene, t_s) for t_s in times_s], budget_s).shared_by(_SPREAD).median_s


def _found(budget_s: float, scene: Scene, what: str = '', true_s: float = T_STAR_S) -> list[Search]:
    found = first_contact(scene)
    assert isinstance(found, Contact)
    spent_s = timed(lambda: first_contact(scene), budget_s).median_s
    depth_m = max(0.0, -_smallest(scene, found.t_s))
    return [Search(_OWN + what, None, found.t_s, depth_m, found.states, spent_s, true_s)]


def _smallest(scene: Scene, t_s: float) -> float:
    """Return the smallest gap between benches of adjacent layers at the given time."""
    chain = state(scene, t_s)
    benches = benches_of(chain, scene.dragon, axes_of(chain))
    return float(np.min(gaps(benches, *candidates(chain.p, benches))))


def _scanned(step_s: float, scene: Scene) -> list[Search]:
    """Sample every ``step_s`` seconds from 0 s on, and report the first sample time with a contact."""
    start, tick = time.perf_counter(), 0
    while (gap := _smallest(scene, tick * step_s)) > 0:
        tick += 1
    spent_s = time.perf_counter() - start
    return [Search(f'sample every {step_s:g} s', None, tick * step_s, -gap, tick + 1, spent_s)]


def _polished(wanted: tuple[float, ...], scene: Scene, what: str = '', true_s: float = T_STAR_S) -> list[Search]:
    """Sample every second, then bisect the interval that contains the contact down to each length in ``wanted``."""
    scan = _scanned(1.0, scene)[0]
    low, high = scan.t_s - 1, scan.t_s
    samples, start, out = scan.states, time.perf_counter(), []
    for wanted_s in wanted:
        while high - low > wanted_s and low < (middle := 0.5 * (low + high)) < high:
            low, high = (low, middle) if _smallest(scene, middle) <= 0 else (middle, high)
            samples += 1
        spent_s, name = scan.spent_s + time.perf_counter() - start, f'every 1 s, then halve to {wanted_s:g} s{what}'
        out.append(Search(name, wanted_s, high, max(0.0, -_smallest(scene, high)), samples, spent_s, true_s))
    return out


def table(rows: Measured) -> str:
    """Return both tables as Markdown, after a line that states the machine, the versions and the date."""
    return '\n'.join([f'{circumstances()}.', '', _search_table(rows), '', check_table(rows.checks)])


def _search_table(rows: Measured) -> str:
    lines = ['| classic run from 0 s | reported (s) | late by (s) | overlap then (m) | verdict | states | time (s) '
             '| times the limit |', '|---|---:|---:|---:|---|---:|---:|---:|']
    for row in rows.searches:
        late = f'{row.late_s:.1e}' if abs(row.late_s) > _KNOWN_S else f'< {_KNOWN_S:.0e}'
        depth = f'{row.depth_m:.1e}' if row.depth_m > _KNOWN_S else '0'
        lines.append(f'| {row.solver} | {row.t_s:.12f} | {late} | {depth} | {row.verdict} | {row.states:,} '
                     f'| {row.spent_s:.3g} | {times(row.spent_s, row.states * rows.state_s)} |')
    return '\n'.join(lines)


def csv_text(rows: Measured) -> str:
    """Return the rows as CSV, with times in seconds; a row describes either a search or a check."""
    searches = [(row.solver, Scene().dragon.benches, row.t_s, row.late_s, row.depth_m, row.verdict, row.states, '',
                 row.spent_s, '', '', '') for row in rows.searches]
    states = [('one state', Scene().dragon.benches, '', '', '', '', 1, '', rows.state_s, '', '', '')]
    checks = [(check.method, check.benches, '', '', '', 'right' if check.right else 'WRONG', 1, check.pairs,
               *check.timing.cells) for check in rows.checks]
    return csv_of(['what', 'benches', 'reported_s', 'late_s', 'depth_m', 'verdict', 'states', 'pairs', *TIMES],
                  [*searches, *states, *checks])


def picture(rows: Measured) -> Figure:
    """Return two panels: the error of the contact time against computing time, and the growth with more benches."""
    figure = Figure(figsize=(PAGE_IN, 11), layout='constrained')
    above, below = figure.subplots(2, 1)
    _search_panel(above, rows)
    panel(below, rows.checks)
    for axes in (above, below):
        axes.grid(True, which='major', linewidth=0.4)
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure


def _search_panel(axes: Axes, rows: Measured) -> None:
    shift = {_OWN: -16, _OWN + _WIDER: -30, 'every 1 s, then halve to 1e-12 s': 10, 'sample every 0.01 s': -3}
    longest_s = max(row.spent_s for row in rows.searches)
    for row in rows.searches:
        own, wrong = row.solver.startswith(_OWN), row.verdict == 'WRONG'
        colour = '#0072B2' if own else '#D55E00' if wrong else '#E69F00'
        error = max(abs(row.late_s), _KNOWN_S)
        axes.loglog(row.spent_s, error, 'o' if own else 's', markersize=9 if own else 7, color=colour)
        axes.annotate(f'{row.solver}{" (wrong)" if wrong else ""}: {row.states:,} states', (row.spent_s, error),
                      xytext=(-8 if row.spent_s == longest_s else 8, shift.get(row.solver, 4)),
                      ha='right' if row.spent_s == longest_s else 'left', textcoords='offset points', fontsize=TEXT_PT)
    axes.set(xlabel='time of the search (s)', ylabel='error of the reported contact time (s)', ylim=(3e-15, 30),
             title='First contact of the classic run, searched from 0 s')
    axes.set_xlim(0.5 * min(row.spent_s for row in rows.searches), 15 * longest_s)
    axes.axhline(_KNOWN_S, color='black', linewidth=0.6, linestyle=':')
    axes.annotate('accuracy of the reference t*', (12 * longest_s, _KNOWN_S), xytext=(0, 3), textcoords='offset points',
                  fontsize=TEXT_PT, ha='right')
