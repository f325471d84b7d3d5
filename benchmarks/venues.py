"""``cost venue``: the time of answers in a venue, and its growth with obstacle corners, distance and benches.

The venue is a synthetic town along a street with one corner. Its houses are squares with sides of 8 m on a grid of
14 m; the houses nearest to the track are used.
"""
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import shapely
from matplotlib.figure import Figure
from tqdm import tqdm

from dragon_ros.cli.command_line import csv_of
from dragon_ros.cli.figures import PAGE_IN, TEXT_PT
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.venue_fit import venue_fit
from dragon_ros.core.tracks.spec import Arc, Composite, Line
from dragon_ros.core.venue import PolygonObstacle, Venue
from dragon_ros.cost.measure import TIMES, Timing, circumstances, timed

_BENCHES, _WAY_M, _CORNERS = 61, 300.0, 2000
_LADDERS: dict[str, tuple[float, ...]] = {
    'corners': (200, 2000, 20_000), 'distance (m)': (100, 300, 1000), 'benches': (20, 61, 223)}
_STEP_M, _HALF_M, _CLEAR_M = 14.0, 4.0, 3.0     # grid step, half the side of a house, free space beside the track
_FIT, _CONTACT, _ALONE = 'design fit', 'contact', 'contact without the venue'
CALLS: dict[str, Callable[[Scene], object]] = {
    _FIT: venue_fit, _CONTACT: first_contact, _ALONE: lambda scene: first_contact(replace(scene, venue=None))}
_STYLES = {_FIT: ('#0072B2', 'o'), _CONTACT: ('#D55E00', 's'), _ALONE: ('#009E73', '.')}     # Okabe-Ito


@dataclass(frozen=True)
class Row:
    """A town, the quantity that is varied, and the times of the answers."""

    varied: str
    corners: int
    way_m: float
    benches: int
    timings: dict[str, Timing]

    @property
    def size(self) -> float:
        """The value of the quantity that is varied."""
        return {'corners': self.corners, 'distance (m)': self.way_m, 'benches': self.benches}[self.varied]


def town(corners: int, way_m: float, benches: int) -> Scene:
    """Return a dragon that travels a given distance through a town with a given number of corners."""
    dragon = Dragon(benches)
    start_m = float(np.sum(dragon.link_lengths_m)) + 1.0
    half_m = 0.5 * (start_m + way_m)
    scene = Scene(dragon, Composite((Line(half_m), Arc(8.0, 90.0), Line(half_m)), start_m), run=Run(stop_s=way_m))
    line = shapely.LineString(compile_scene(scene).track_line(0.1))
    low, high = np.array(line.bounds).reshape(2, 2)
    around = _STEP_M * (3 + 0.5 * (corners / 4) ** 0.5)
    x, y = (np.arange(a - around, b + around, _STEP_M) for a, b in zip(low, high, strict=True))
    middles = np.stack([one.ravel() for one in np.meshgrid(x, y)], axis=1)
    boxes = shapely.box(*(middles - _HALF_M).T, *(middles + _HALF_M).T)
    away = shapely.distance(boxes, line)
    nearest = np.argsort(np.where(away > _CLEAR_M, away, np.inf), kind='stable')[:corners // 4]
    houses = tuple(PolygonObstacle(f'house {n}', tuple(map(tuple, shapely.get_coordinates(box)[:-1].tolist())))
                   for n, box in enumerate(boxes[nearest].tolist(), 1))
    return replace(scene, venue=Venue(houses, margin_m=0.5))


def measure(budget_s: float = 0.3) -> list[Row]:
    """Measure every step of every series; progress goes to standard error."""
    rungs = [(name, size) for name, sizes in _LADDERS.items() for size in sizes]
    return [_row(name, size, budget_s) for name, size in tqdm(rungs, desc='cost venue', unit='town', disable=None)]


def _row(varied: str, size: float, budget_s: float) -> Row:
    sizes = {'corners': _CORNERS, 'distance (m)': _WAY_M, 'benches': _BENCHES} | {varied: size}
    corners, way_m, benches = int(sizes['corners']), float(sizes['distance (m)']), int(sizes['benches'])
    scene = town(corners, way_m, benches)
    return Row(varied, corners, way_m, benches,
               {name: timed(partial(call, scene), budget_s) for name, call in CALLS.items()})


def table(rows: list[Row]) -> str:
    """Return the rows as a Markdown table, after a line that states the machine, the versions and the date."""
    head = ('| varied | corners | distance (m) | benches | design fit (s) | contact (s) | contact without the venue '
            '(s) | ratio |\n|---|---:|---:|---:|---:|---:|---:|---:|')
    return '\n'.join([f'{circumstances()}. Times are medians that exclude the first call.', '', head,
                      *map(_line, rows)])


def _line(row: Row) -> str:
    fit, contact, alone = (row.timings[name].median_s for name in CALLS)
    return (f'| {row.varied.partition(" ")[0]} | {row.corners:,} | {row.way_m:,.0f} | {row.benches} | {fit:.3g} | '
            f'{contact:.3g} | {alone:.3g} | {contact / alone:.2f} |')


def csv_text(rows: list[Row]) -> str:
    """Return the rows as CSV, with one line per timing and times in seconds."""
    return csv_of(['varied', 'corners', 'way_m', 'benches', 'answer', *TIMES],
                  [(row.varied, row.corners, row.way_m, row.benches, name, *timing.cells)
                   for row in rows for name, timing in row.timings.items()])


def picture(rows: list[Row]) -> Figure:
    """Return a figure with a panel for each series and a line for each answer."""
    figure = Figure(figsize=(PAGE_IN, 4.4), layout='constrained')
    panels = figure.subplots(1, len(_LADDERS), sharey=True)
    for axes, varied in zip(panels, _LADDERS, strict=True):
        some = [row for row in rows if row.varied == varied]
        for name, (colour, marker) in _STYLES.items():
            axes.plot([row.size for row in some], [row.timings[name].median_s for row in some], marker=marker,
                      color=colour, label=name)
        axes.set(xscale='log', yscale='log', xlabel=varied)
        axes.grid(True, linewidth=0.4)
    panels[0].set_ylabel('time (s)')
    # A legend beside the middle panel would make all panels narrower.
    figure.legend(*panels[1].get_legend_handles_labels(), loc='outside upper center', ncols=len(CALLS),
                  title='Answers in a town')
    figure.supxlabel(circumstances(), fontsize=TEXT_PT)
    return figure
