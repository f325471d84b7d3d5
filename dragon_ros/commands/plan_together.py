"""``plan A.yaml B.yaml``: several dragons on one plan, a chart of who is where when, and their smallest gap."""
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import dragon_ros as dr
from dragon_ros.cli import command_line, figures
from dragon_ros.cli.inputs import Floats, Ints
from dragon_ros.cli.language import language_of
from dragon_ros.cli.progress import Progress
from dragon_ros.commands.plan_contents import Plan
from dragon_ros.commands.plan_pages import Labels, around, extent, frame, overview, page, write_pages

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EVERY_S = 0.1
_AT_ONCE = 64           # number of states that are computed together
_CHARTED = 200          # number of times in the chart of a dragon
_MOST = 12              # number of dragons
_PAIRS_BELOW = 4        # number of pairs listed below the drawing


@dataclass(frozen=True)
class Between:
    """The smallest sampled gap between two dragons, with its end points; None if they are never there at one time."""

    one: int
    other: int
    gap_m: float
    t_s: float
    ends_m: Floats | None


def run(arguments: Namespace) -> int:
    """Write the plan of several scenes; return the exit code."""
    path: Path = arguments.output
    files: Sequence[Path] = arguments.drawings
    if path.suffix.lower() != '.pdf':
        raise dr.InputError(f'--output {path}: the plan of several dragons is a .pdf; rename it')
    if len(files) > _MOST:
        raise dr.InputError(f'plan: {len(files)} scenes are too many; the limit is {_MOST}')
    for file in files:
        command_line.check_keeps('--output', path, file)
    lang = language_of(arguments.lang)
    plans = [Plan(command_line.scene_from(Namespace(**{**vars(arguments), 'scene': str(file)})),
                  figures.drawable(file.stem), lang) for file in files]
    _check_origins(files, plans)
    found = gaps_between([plan.run for plan in plans])
    title = figures.drawable(arguments.title or path.stem)
    write_pages(plans, path, lambda: [_drawing(plans, found, title, arguments.paper or 'A4'),
                                      _chart(plans, title, arguments.paper or 'A4')])
    command_line.write_output(None, '\n'.join([str(path), *(_said(plans, one) for one in found), _smallest(
        plans, found)]))
    return command_line.OK


def _check_origins(files: Sequence[Path], plans: Sequence[Plan]) -> None:
    for (file, plan), (other, after) in pairwise(zip(files, plans, strict=True)):
        if plan.scene.origin != after.scene.origin:
            raise dr.InputError(f'{other}: its origin is {after.scene.origin or "not stated"}, and that of {file} is '
                             f'{plan.scene.origin or "not stated"}; give all scenes one origin', field='origin')


# Gaps

def gaps_between(runs: Sequence[dr.Simulated]) -> list[Between]:
    """Return the smallest gap of each pair of dragons, sampled every 0.1 s on one clock, the smallest gap first.

    A dragon is there from the start to the end of its run.
    """
    ticks = [_ticks(run) for run in runs]
    boxes = [_boxes(run, some) for run, some in zip(runs, ticks, strict=True)]
    pairs = [*combinations(range(len(runs)), 2)]
    out = [_between(runs, (one, other), ticks, boxes) for one, other in Progress('plan', 'pairs', len(pairs))(pairs)]
    return sorted(out, key=lambda one: (one.gap_m, one.t_s))


def _ticks(run: dr.Simulated) -> Ints:
    """Return the tenths of a second at which a dragon is there."""
    first_s, last_s = run.span_s
    return np.arange(np.ceil(first_s / _EVERY_S - 1e-9), np.floor(last_s / _EVERY_S + 1e-9) + 1).astype(int)


def _corners(run: dr.Simulated, ticks: Ints) -> Floats:
    """Return the corners (ticks, benches, 4, 2) of benches."""
    return run.benches_m(np.clip(ticks * _EVERY_S, *run.span_s))


def _boxes(run: dr.Simulated, ticks: Ints) -> Floats:
    """Return the bounding boxes (ticks, 4) of a dragon."""
    out = [np.zeros((0, 4))]
    for first in range(0, len(ticks), _AT_ONCE):
        corners = _corners(run, ticks[first:first + _AT_ONCE])
        out.append(np.concatenate((corners.min(axis=(1, 2)), corners.max(axis=(1, 2))), axis=1))
    return np.concatenate(out)


def _between(runs: Sequence[dr.Simulated], pair: tuple[int, int], ticks: Sequence[Ints],
             boxes: Sequence[Floats]) -> Between:
    """Return the smallest gap of a pair; only times at which the bounding boxes are close enough are looked at."""
    one, other = pair
    common, mine, yours = np.intersect1d(ticks[one], ticks[other], return_indices=True)
    if not len(common):
        return Between(one, other, float('inf'), float('nan'), None)
    a, b = boxes[one][mine], boxes[other][yours]
    apart = np.maximum(0.0, np.maximum(a[:, :2] - b[:, 2:], b[:, :2] - a[:, 2:]))
    least_m = np.hypot(*apart.T)
    best = Between(one, other, float('inf'), float('nan'), None)
    order = np.argsort(least_m, kind='stable')
    for first in range(0, len(order), _AT_ONCE):
        some = order[first:first + _AT_ONCE]
        some = some[least_m[some] < best.gap_m]
        if not len(some):
            break
        for tick, here, there in zip(common[some], *(_corners(runs[k], common[some]) for k in pair), strict=True):
            gap_m, ends_m = _nearest(here, there)
            if gap_m < best.gap_m:
                best = Between(one, other, gap_m, float(tick) * _EVERY_S, ends_m)
    return best


def _nearest(here: Floats, there: Floats) -> tuple[float, Floats]:
    """Return the smallest distance between benches (n, 4, 2) of two dragons, and its end points."""
    from shapely import STRtree, get_coordinates, polygons, shortest_line
    mine, yours = polygons(here), polygons(there)
    (left, right), gaps = STRtree(yours).query_nearest(mine, return_distance=True, all_matches=False)
    k = int(np.argmin(gaps))
    return float(gaps[k]), get_coordinates(shortest_line(mine[left[k]], yours[right[k]]))


def _said(plans: Sequence[Plan], found: Between) -> str:
    names = {'one': plans[found.one].title, 'other': plans[found.other].title}
    if found.ends_m is None:
        return plans[0].say('never', **names)
    if found.gap_m <= 0:
        return plans[0].say('collide', **names, t=found.t_s)
    return plans[0].say('between', **names, gap=found.gap_m, t=found.t_s)


def _smallest(plans: Sequence[Plan], found: Sequence[Between]) -> str:
    return plans[0].say('smallest', what=_said(plans, found[0]))


# Pages

def _drawing(plans: Sequence[Plan], found: Sequence[Between], title: str, paper: str) -> 'Figure':
    """Return the page with the swept areas."""
    from dragon_ros.pictures.dragon import draw_venue, fill
    lows, highs = zip(*map(extent, plans), strict=True)
    sheet = overview(paper, np.min(lows, axis=0), np.max(highs, axis=0))
    figure = page(plans[0], paper, (1, 2), plans[0].say('together', title=title, scale=sheet.scale), '\n'.join(
        [_smallest(plans, found), *(_said(plans, one) for one in found[1:_PAIRS_BELOW]), plans[0].say('alone')]))
    axes = frame(figure, sheet)
    for n, venue in enumerate(venues := [plan.scene.venue for plan in plans]):
        if venue is not None and venue not in venues[:n]:
            draw_venue(axes, venue)
    for plan, colour in zip(plans, _colours(), strict=False):
        fill(axes, plan.room.area.whole, plan.title, facecolor=colour, edgecolor=colour, alpha=0.5, linewidth=0.5,
             zorder=2)
    axes.legend(loc='best', fontsize=9, frameon=True)
    labels = Labels(axes, plans[0], sheet)
    for plan, colour in zip(plans, _colours(), strict=False):
        (end,), _ = plan.run.track_poses(plan.room.area.at_m[-1:])
        axes.plot(*end, marker='o', color=colour, markersize=5, zorder=4)
        offset = labels.placed(end, plan.title, around(plan.title))
        labels.write(end, plan.title, offset or (12, 12), zorder=6)
    if (ends := found[0].ends_m) is not None:
        middle, text = ends.mean(axis=0), _said(plans, found[0])
        axes.plot(*ends.T, color='black', linewidth=1.2, marker='|', zorder=6)
        labels.write(middle, text, labels.placed(middle, text, around(text)) or (0, 30), zorder=8,
                     arrowprops={'arrowstyle': '-', 'linewidth': 0.5},
                     bbox={'boxstyle': 'round,pad=0.2', 'facecolor': 'white', 'linewidth': 0.5})
    return figure


def _colours() -> Iterator[str]:
    while True:
        yield from figures.LINES


def _chart(plans: Sequence[Plan], title: str, paper: str) -> 'Figure':
    """Return the page with the part of its way that each dragon takes at each time."""
    figure = page(plans[0], paper, (2, 2), plans[0].say('when', title=title), '')
    boxes = figure.subplots(len(plans), 1, sharex=True, squeeze=False, gridspec_kw={
        'left': 0.14, 'right': 0.96, 'top': 0.96, 'bottom': 0.28, 'hspace': 0.15})[:, 0]
    for axes, plan, colour in zip(boxes, plans, _colours(), strict=False):
        times_s = np.linspace(*plan.run.span_s, _CHARTED)
        at_m = plan.run.along_m(times_s)
        axes.fill_between(times_s, at_m[:, -1], at_m[:, 0], color=colour, alpha=0.5)
        axes.plot(times_s, at_m[:, 0], color=colour)
        axes.set_ylabel(plan.say('way_m', name=figures.short(plan.title)), rotation=0, ha='right', fontsize=8)
    boxes[-1].set_xlabel(plans[0].say('time_s'))
    return figure
