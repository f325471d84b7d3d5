"""``cost first``: the time of a run's first tick with the shift map and with the march, and when the map pays off.

The limit for a first tick is the longer of two times that the machine needs: to compute the series of its tables from
values at as many nodes, using a matrix product, and to copy the tables. Placing links at the nodes is not included.
"""
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, inf

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from benchmarks.rates import Amounts, limit, tick_rates, times
from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT, legend_below
from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS, Run, Scene
from dragon_ros.core.shift_map.build import Table
from dragon_ros.core.step import state
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.spec import Arc, Composite, Line
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed, timed_in_turn
from dragon_ros.scenes.load import load_scene
from hard_cases import hard_cases

_NAMED = ('winding', 'long')
_CASES = ('unwinding', 'turning', 'tight', 'wiggle', 'hairpin', 'mixed-by-the-tail', 'longest-joined-track',
          'tightest-bend')      # hard cases with joined tracks or a leading tail
TICKS = 50             # number of ticks over which the time of a later tick is averaged
_FIRST, _LATER, _FIRST_MARCHED, _MARCHED = 'first', 'later', 'first, marched', 'later, marched'
CALLS = (_FIRST, _LATER, _FIRST_MARCHED, _MARCHED)
_STYLES = {_FIRST: ('#0072B2', 'o'), _LATER: ('#0072B2', '.'), _FIRST_MARCHED: ('#D55E00', 's'),
           _MARCHED: ('#D55E00', '|')}     # Okabe-Ito


@dataclass(frozen=True)
class Row:
    """A scene, the number of its track segments, and the times of first and later ticks with the map and the march.

    ``limit_s`` is the shortest possible time for the tables of the first tick.
    """

    scene: str
    handles: int
    segments: int
    timings: dict[str, Timing]
    limit_s: float

    @property
    def pays_from(self) -> float:
        """The first tick at which the march has taken longer in total than the map, or inf if there is none."""
        first, later, first_marched, marched = (self.timings[name].median_s for name in CALLS)
        if first <= first_marched:
            return 1
        return 1 + ceil((first - first_marched) / (marched - later)) if marched > later else inf


def measure(budget_s: float = 0.3) -> list[Row]:
    """Measure every scene that can use a shift map; progress goes to standard error."""
    rates = tick_rates(budget_s)
    return [_row(name, scene, rates, budget_s)
            for name, scene in tqdm(scenes().items(), desc='cost first', unit='scene', disable=None)]


def scenes() -> dict[str, Scene]:
    """Return the scenes of the page: all of them use a shift map, and have the ticks that are timed."""
    cases = {case.name: case.scene for case in hard_cases()}
    return {**{name: load_scene(name) for name in _NAMED}, **{name: cases[name] for name in _CASES},
            'street-300': street(300)}


def street(arcs: int) -> Scene:
    """Return a street of arcs almost too tight for the head's link, with radii of 1.46 to 1.6 m and turns of 30 to 60°.

    The dragon is near its far end.
    """
    shares = [(0.618 * k % 1, 0.414 * k % 1) for k in range(arcs)]
    track = Composite((Line(500.0), *(Arc(1.46 + 0.14 * radius, (-1) ** k * (30 + 30 * turn))
                                      for k, (radius, turn) in enumerate(shares)), Line(30.0)))
    return Scene(track=replace(track, start_m=track_of(track).end_m - 40), run=Run(0, 20))


def _row(name: str, scene: Scene, rates: Amounts, budget_s: float) -> Row:
    marched = replace(scene, solver='march')
    first, first_marched = (timed(partial(first_tick, one), budget_s) for one in (scene, marched))
    later, later_marched = (timing.shared_by(TICKS) for timing in timed_in_turn(
        [partial(_later, one) for one in (scene, marched)], budget_s))
    return Row(name, scene.dragon.benches + 1, len(compile_scene(scene).model.track.segments),
               dict(zip(CALLS, (first, later, first_marched, later_marched), strict=True)),
               sum(limit(needs, rates)[0] for needs in needs_of_first(scene)))


def first_tick(scene: Scene) -> Chain:
    """Place all handles at the start of a run, using a new model, which rebuilds track, leader and table."""
    return replace(compile_scene(scene).model).place(scene.head.travelled_m(scene.run.start_s))


def needs_of_first(scene: Scene) -> list[Amounts]:
    """Return the amounts for building each table that the first tick builds."""
    fresh = replace(compile_scene(scene).model)
    fresh.place(scene.head.travelled_m(scene.run.start_s))
    return [needs_of_table(tile.table) for shift in fresh.placement.maps.values() for tile in shift.tiles]


def needs_of_table(table: Table) -> Amounts:
    """Return the amounts for building a table: its bytes, and the products that turn values at nodes into series.

    Each row of a part has five series: the coordinate, two of the position and two of the velocity.
    """
    return {'product': 2.0 * 5 * table.rows * table.parts * table.nodes**2, 'cache': float(table.memory_bytes)}


def _later(scene: Scene) -> None:
    for k in range(TICKS):
        state(scene, scene.run.time_ns(k) / NS)


def table(rows: list[Row]) -> str:
    """Return the rows as a Markdown table, after a line that states the machine, the versions and the date."""
    head = ('| scene | handles | segments | first tick (ms) | quartiles | later (µs) | first, marched (ms) | '
            'later, marched (µs) | the map pays off from tick | limit of the first tick (ms) | times the limit |\n'
            '|---|---:|---:|---:|---|' + '---:|' * 6)
    return '\n'.join([f'{circumstances()}. Times are medians that exclude the first call.', '', head,
                      *map(_line, rows)])


def _line(row: Row) -> str:
    first, later, first_marched, marched = (row.timings[name] for name in CALLS)
    pays = f'{row.pays_from:,.0f}' if row.pays_from < inf else '-'
    return (f'| {row.scene} | {row.handles:,} | {row.segments} | {first.median_s * 1e3:.3g} | '
            f'{first.low_s * 1e3:.3g} to {first.high_s * 1e3:.3g} | {later.median_s * 1e6:.3g} | '
            f'{first_marched.median_s * 1e3:.3g} | {marched.median_s * 1e6:.4g} | {pays} | '
            f'{row.limit_s * 1e3:.3g} | {times(first.median_s, row.limit_s)} |')


def csv_text(rows: list[Row]) -> str:
    """Return the rows as CSV, with one line per timing and times in seconds."""
    return csv_of(['scene', 'handles', 'segments', 'tick', 'limit_s', *TIMES],
                  [(row.scene, row.handles, row.segments, name, row.limit_s if name == _FIRST else '', *timing.cells)
                   for row in rows for name, timing in row.timings.items()])


def picture(rows: list[Row]) -> Figure:
    """Return a figure with one line per scene: its first tick and a later tick, with the map and with the march."""
    figure = Figure(figsize=(PAGE_IN, 0.34 * len(rows) + 2.4), layout='constrained')
    axes, at = figure.subplots(), np.arange(len(rows))
    for name, (colour, marker) in _STYLES.items():
        axes.plot([row.timings[name].median_s * 1e3 for row in rows], at, marker, color=colour, markersize=9,
                  label=name, linestyle='none')
    for n, row in enumerate(rows):
        axes.plot([row.timings[name].median_s * 1e3 for name in (_LATER, _FIRST)], [n, n], color='#0072B2',
                  linewidth=0.8, zorder=0)
    axes.set_xscale('log')
    axes.set_yticks(at, [f'{row.scene}, {row.handles:,} handles' for row in rows])
    axes.invert_yaxis()
    axes.set_xlabel('time of a tick (ms)')
    axes.set_title('The first tick builds the table of a section of track')
    axes.grid(True, axis='x', linewidth=0.4)
    axes.set_axisbelow(True)
    legend_below(axes, len(CALLS))
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
