"""Measure how the time of one contact check grows with the number of benches, for three methods and the monitor."""
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import count

import numpy as np
from matplotlib.axes import Axes

from benchmarks.rates import NUMBER, stage_copy_rate, times
from benchmarks.stages import ticks_from
from dragon_ros.cli.figures import TEXT_PT, legend_below
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.geometry.broad_phase import box_pairs, candidates, default_reach_m
from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.geometry.tracker import ContactTracker
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.cost.measure import Timing, timed

SIZES = (10, 30, 100, 223, 1000, 3000, 10_000, 20_000)
_MOST_OF_ALL_PAIRS = 3000
_ALL, _BOXES, _LAYER, _WATCH = 'all pairs', 'STRtree', 'adjacent layer', "the monitor's check"
_COLOURS = {_ALL: '#D55E00', _BOXES: '#E69F00', _LAYER: '#0072B2', _WATCH: '#009E73'}
_MARKERS = {_ALL: 's', _BOXES: '^', _LAYER: 'o', _WATCH: 'v'}
_SAME_M = 1e-12
_AT_S = 300.0
METHODS = tuple(_COLOURS)


@dataclass(frozen=True)
class Check:
    """One check of all benches of a dragon: candidates and gaps. ``right`` is true if the smallest gap is correct.

    ``limit_s`` is the time that the machine needs to copy the position and direction of each bench once.
    """

    method: str
    benches: int
    pairs: int
    right: bool
    timing: Timing
    limit_s: float


def checks_of(size: int, budget_s: float) -> list[Check]:
    """Check a dragon with ``size`` benches at one time by each method; compare the results, then measure the times."""
    scene = Scene(dragon=Dragon(size))
    chain = state(scene, _AT_S)
    benches = benches_of(chain, scene.dragon, axes_of(chain))
    reach = default_reach_m(benches)
    ways: dict[str, Callable[[], tuple[Ints, Ints]]] = {
        _ALL: lambda: _every(size), _BOXES: lambda: box_pairs(benches, reach),
        _LAYER: lambda: candidates(chain.p, benches)}
    if size > _MOST_OF_ALL_PAIRS:
        del ways[_ALL]
    found = {way: _smallest_of(benches, *pairs()) for way, pairs in ways.items()}
    least, size_bytes = min(gap for _, gap in found.values()), 4 * NUMBER * size
    limit_s = size_bytes / stage_copy_rate(size_bytes, budget_s)
    out = [Check(way, size, found[way][0], _agree(found[way][1], least, reach),
                 timed(partial(_checked, benches, pairs), budget_s, 3), limit_s)
           for way, pairs in ways.items()]
    return [*out, _watched(scene, candidates(chain.p, benches)[0].size, least, limit_s, budget_s)]


def _checked(benches: Benches, pairs: Callable[[], tuple[Ints, Ints]]) -> tuple[int, float]:
    return _smallest_of(benches, *pairs())


def _agree(gap: float, least: float, reach: float) -> bool:
    return gap <= least + _SAME_M or least > reach


def _watched(scene: Scene, pairs: int, least: float, limit_s: float, budget_s: float) -> Check:
    """Check tick by tick as the monitor does, but without messages: order, near pairs and contact intervals."""
    tracker, ticks, looks = ContactTracker(), count(1), ticks_from(scene, _AT_S)

    def check() -> float:
        return tracker.add(Observation(next(ticks) * 20_000_000, *next(looks)))[0].clearance_m
    return Check(_WATCH, scene.dragon.benches, pairs, abs(check() - least) <= _SAME_M, timed(check, budget_s, 3),
                 limit_s)


def _every(size: int) -> tuple[Ints, Ints]:
    i, j = np.triu_indices(size, 2)
    return i, j


def _smallest_of(benches: Benches, i: Ints, j: Ints) -> tuple[int, float]:
    """Return the number of examined pairs and their smallest gap."""
    return i.size, float(np.min(gaps(benches, i, j), initial=np.inf))


def exponent(checks: list[Check], method: str) -> float:
    """Return the exponent p such that the time grows as N^p, fitted to all sizes of at least 1000 benches."""
    mine = [check for check in checks if check.method == method and check.benches >= 1000]
    size: Floats = np.array([check.benches for check in mine], dtype=np.float64)
    return float(np.polyfit(np.log(size), np.log([check.timing.median_s for check in mine]), 1)[0])


def check_table(checks: list[Check]) -> str:
    """Return the checks as a Markdown table, with one line per size."""
    methods = list(METHODS)
    lines = ['| ms for one check of N benches | ' + ' | '.join(methods)
             + f' | {_WATCH}: times the limit | pairs: ' + ', '.join(methods) + ' |',
             '|---:|' + '---:|' * (len(methods) + 2)]
    for size in dict.fromkeys(check.benches for check in checks):
        mine = {check.method: check for check in checks if check.benches == size}
        cells = [_cell(mine[method]) if method in mine else '-' for method in methods]
        pairs = ', '.join(f'{mine[method].pairs:,}' if method in mine else '-' for method in methods)
        lines.append(f'| {size:,} | ' + ' | '.join(cells)
                     + f' | {times(mine[_WATCH].timing.median_s, mine[_WATCH].limit_s)} | {pairs} |')
    powers = ' | '.join(f'N^{exponent(checks, method):.2f}' for method in methods)
    return '\n'.join([*lines, f'| from 1,000 on it grows as | {powers} | | |'])


def _cell(check: Check) -> str:
    return f'{check.timing.median_s * 1e3:.3g}' + ('' if check.right else ' WRONG')


def panel(axes: Axes, checks: list[Check]) -> None:
    """Plot the time of one check against the number of benches."""
    for method in _COLOURS:
        mine = [check for check in checks if check.method == method]
        axes.loglog([check.benches for check in mine], [check.timing.median_s * 1e3 for check in mine],
                    _MARKERS[method] + '-', color=_COLOURS[method],
                    label=f'{method}: grows as N^{exponent(checks, method):.2f}')
    axes.set(xlabel='benches N', ylabel='time of one check (ms): candidates and gaps',
             title='One contact check of all benches')
    legend_below(axes, 1, fontsize=TEXT_PT)
