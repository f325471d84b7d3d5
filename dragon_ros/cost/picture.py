"""Draw the costs of a scene: error against time, the cost of each effect, the time for the whole run, and bags."""
from typing import TYPE_CHECKING, Any

import numpy as np

from dragon_ros.cli.figures import LINES, PAGE_IN, QUIET, TEXT_PT, short
from dragon_ros.core.words import counted
from dragon_ros.cost.costs import Costs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SMALLEST_M = 1e-18         # an error of zero is drawn at this value
_IN_SCENE, _OTHER = LINES[0], '#BBBBBB'


def picture(costs: Costs) -> 'Figure':
    """Return a figure with four panels."""
    from matplotlib.figure import Figure
    figure = Figure(figsize=(PAGE_IN, 15))
    errors, effects, whole, bags = figure.subplots(4, 1)
    _errors(errors, costs)
    _effects(effects, costs)
    _whole(whole, costs)
    _bags(bags, costs)
    name = short(costs.scene).replace('$', r'\$')      # not a formula
    figure.suptitle(f'{name}: {counted(costs.benches, "bench", form=",")}, {counted(costs.ticks, "tick", form=",")}')
    figure.supxlabel(costs.machine, fontsize=TEXT_PT, color=QUIET)
    return figure


def _errors(axes: Any, costs: Costs) -> None:
    """Draw the work-precision diagram: table and march, and other solvers."""
    styles = {'dragon_ros': ('o', LINES[0]), 'others': ('^', LINES[1])}
    drawn = [row for row in costs.accuracy.solvers if row.positions and np.isfinite(row.error_m)]
    for kind, (marker, colour) in styles.items():
        mine = [row for row in drawn if _kind(row.name) == kind]
        if mine:
            axes.loglog([row.positions.median_s * 1e6 for row in mine if row.positions],
                        [max(row.error_m, _SMALLEST_M) for row in mine], marker, color=colour, label=kind,
                        linestyle='none')
    for place, names in _labels(costs).items():
        together = len(names) > 1       # place a shared label below the point, away from other labels
        axes.annotate(', '.join(names), place, xytext=(0, -14) if together else (7, -3), textcoords='offset points',
                      fontsize=TEXT_PT, ha='center' if together else 'left')
    axes.margins(x=0.3, y=0.12)
    axes.set(xlabel='time per tick for the positions of all handles (µs)', ylabel='largest error (m)',
             title='Cost of accuracy')
    if drawn:
        axes.legend()


def _kind(name: str) -> str:
    return 'dragon_ros' if name in ('table', 'march') else 'others'


def _labels(costs: Costs) -> dict[tuple[float, float], list[str]]:
    """Return the names to show at each point; points that nearly coincide share a label."""
    out: dict[tuple[float, float], list[str]] = {}
    for row in costs.accuracy.solvers:
        if not row.positions or not np.isfinite(row.error_m):
            continue
        x, y, name = row.positions.median_s * 1e6, max(row.error_m, _SMALLEST_M), row.name
        near = next((at for at in out if abs(np.log10(at[0] / x)) < 0.15 and abs(np.log10(at[1] / y)) < 0.6), (x, y))
        out.setdefault(near, []).append(name)
    return {place: list(dict.fromkeys(names)) for place, names in out.items()}


def _effects(axes: Any, costs: Costs) -> None:
    rows = [row for row in costs.prices if row.timing]
    for n, row in enumerate(rows):
        assert row.timing
        us, on = row.timing.median_s * 1e6, row.effect in costs.effects
        axes.barh(n, us, 0.7, color=_IN_SCENE if on else _OTHER)
        axes.annotate(f'{us:,.3g} µs, {row.size:,} bytes', (us, n), xytext=(4, 0), textcoords='offset points',
                      va='center', fontsize=TEXT_PT)
    axes.set_yticks(range(len(rows)), [row.effect for row in rows])
    axes.invert_yaxis()
    axes.grid(visible=False, axis='y')
    axes.set(xlabel='time per tick to compute and encode (µs)',
             title="Cost of each effect (the scene's effects are coloured)")
    axes.set_xlim(0, 1.45 * axes.get_xlim()[1])


def _whole(axes: Any, costs: Costs) -> None:
    """Draw the time that each task takes for the whole run."""
    own = {row.name: row for row in costs.accuracy.solvers if row.with_velocities}
    served = own.get('table', own.get('march'))
    bars = {}
    if served and served.positions and served.with_velocities:
        bars['positions'] = served.positions.median_s * costs.ticks
        bars['and velocities'] = served.with_velocities.median_s * costs.ticks
    for row in costs.bags:
        bars[f'as a bag, {row.compression.replace("none", "not compressed")}'] = costs.ticks / row.ticks_per_s
    name = 'first contact, proved' if costs.contact.complete else 'first contact, stopped'
    bars[name] = costs.contact.elapsed_s
    for n, (label, seconds) in enumerate(bars.items()):
        axes.barh(n, seconds, 0.7, color=LINES[2] if label.startswith('first') else LINES[0])
        axes.annotate(f'{seconds:,.3g} s', (seconds, n), xytext=(4, 0), textcoords='offset points', va='center',
                      fontsize=TEXT_PT)
    axes.set_yticks(range(len(bars)), list(bars))
    axes.invert_yaxis()
    axes.grid(visible=False, axis='y')
    axes.set_xscale('log')
    low, high = min(bars.values()), max(bars.values())
    axes.set_xlim(0.3 * low, 8 * high)
    axes.set(xlabel='time (s)', title=f'Time for the whole run of {costs.stop_s - costs.start_s:g} s')


def _bags(axes: Any, costs: Costs) -> None:
    for n, row in enumerate(costs.bags):
        size_kb = row.bytes_per_tick / 1000
        axes.bar(n, size_kb, 0.6, color=LINES[4])
        axes.annotate(f'{size_kb:,.3g} kB\n{row.ticks_per_s:,.0f} ticks/s', (n, size_kb), xytext=(0, 3),
                      textcoords='offset points', ha='center', fontsize=TEXT_PT)
    axes.set_xticks(range(len(costs.bags)), [row.compression for row in costs.bags])
    axes.grid(visible=False, axis='x')
    axes.set(ylabel='size (kB per tick)', title='Size of a bag')
    axes.set_ylim(0, 1.2 * max(row.bytes_per_tick for row in costs.bags) / 1000)
