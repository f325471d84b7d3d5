"""Curves of a run: clearance over time, and speed along the chain."""
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dragon_ros.cli import figures
from dragon_ros.cli.figures import HEAD, LINES, PAGE_IN, POINT, QUIET
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.pictures.sources import Moment, Progress, Source, Touch, check_times, clearances, thinned

MOST_POINTS = 1500          # number of points per curve, more than a screen can show
_CLOSE_S = 15.0             # duration (s) shown before the contact
_MOST_LABELS = 20           # largest number of labels beside lines
_WIDE_IN, _NARROW_IN = 7.4, 3.6     # widths of the two panels, in inches
_DASHES: tuple[Any, ...] = ('solid', (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1, 1, 1, 1, 1)),
                            (0, (8, 3)))


def clearance_picture(source: Source, progress: Progress) -> Figure:
    """Return a figure of the smallest gap over the run, and over the last seconds before the contact."""
    touch = source.first_touch(progress)
    first, last = source.span_s
    start = first if touch is None else max(first, touch.t_s - _CLOSE_S)
    stop = last if touch is None else min(last, touch.t_s + 0.1 * _CLOSE_S)
    figure = Figure(figsize=(PAGE_IN, 4.2))
    spans = [(first, last)] if touch is None or stop - start > 0.8 * (last - first) else [(first, last), (start, stop)]
    panels = figure.subplots(1, len(spans), squeeze=False).flat
    for axes, span in zip(panels, spans, strict=True):
        times_s, gaps_m = clearances(source, source.ticks_s(*span, MOST_POINTS), progress)
        axes.plot(times_s, 1e3 * gaps_m, color=LINES[0], linewidth=1.2)
        _shade_overlap(axes, touch is not None)
        axes.set(xlabel='time (s)', ylabel='clearance (mm)', xlim=span)
        whole = figures.titled(source.name, gap_title(source), _NARROW_IN if len(spans) > 1 else _WIDE_IN)
        axes.set_title(whole if span == spans[0] else f'the last {_CLOSE_S:g} s before the contact')
        if touch is not None:
            _mark(axes, touch, len(spans) == 1 or span != spans[0])
    return figure


def gap_title(source: Source) -> str:
    """Return the name of the curve of ``clearances``."""
    return 'smallest gap between benches' + (' or to obstacles' if source.has_obstacles else '')


def _shade_overlap(axes: Axes, touching: bool) -> None:
    """Shade overlaps; if benches touch, leave space for text."""
    low, high = axes.get_ylim()
    high = max(high, 0.0)       # also if benches overlap all the time
    low = min(low, -0.4 * high if touching else 0.0)
    axes.axhline(0.0, color=QUIET, linewidth=0.8)
    if low < 0:
        axes.axhspan(low, 0.0, color=HEAD, alpha=0.07, linewidth=0)
        axes.text(0.02, 0.03, 'overlap', transform=axes.transAxes, color=HEAD)
    axes.set_ylim(low, high)


def _mark(axes: Axes, touch: Touch, fully: bool) -> None:
    """Mark the contact, with text on the side that has more space."""
    axes.plot(touch.t_s, 0.0, marker='o', markersize=7, color=HEAD, markeredgecolor=POINT, markeredgewidth=0.7,
              zorder=5, clip_on=False)
    text = f'{touch.words}\nat {touch.t_s:.6f} s' if fully else f'contact at {touch.t_s:.2f} s'
    side = 1 if touch.t_s < np.mean(axes.get_xlim()) else -1
    axes.annotate(text, (touch.t_s, 0.0), xytext=(24 * side, -30), textcoords='offset points',
                  ha='left' if side > 0 else 'right', va='center',
                  arrowprops={'arrowstyle': '-', 'color': QUIET, 'linewidth': 0.8, 'shrinkB': 5})


def speeds_picture(source: Source, times_s: list[float]) -> Figure:
    """Return a figure of the speed of each handle, with one line per time. Raises InputError if speeds are unknown."""
    check_times(source, times_s)
    figure = Figure(figsize=(8.4, 5))
    axes = figure.subplots()
    moments = list(source.moments(np.array(sorted(times_s))))
    if not moments:
        raise InputError(f'{source.name}: it has handles but no benches at {times_s[0]:g} s')
    for number, one in enumerate(moments):
        speed = speeds_of(source, one)
        axes.plot(np.arange(speed.size), speed, color=LINES[number % len(LINES)],
                  linestyle=_DASHES[number % len(_DASHES)])
    axes.set(xlabel='handle (0 is the head, the last is the tail)', ylabel='speed (m/s)', xlim=(0, speed.size - 1))
    axes.set_title(figures.titled(source.name, 'speed along the chain', _WIDE_IN))
    _label_ends(axes, source, [moments[n] for n in thinned(0, len(moments) - 1, _MOST_LABELS).tolist()], moments)
    return figure


def _label_ends(axes: Axes, source: Source, labelled: list[Moment], moments: list[Moment]) -> None:
    """Write times beside the ends of their lines, spread apart; guide lines lead to the times that had to move."""
    low, high = axes.get_ylim()
    colours = {one.t_s: LINES[number % len(LINES)] for number, one in enumerate(moments)}
    ends = sorted((float(speeds_of(source, one)[-1] - low) / (high - low), one.t_s) for one in labelled)
    for (end, t_s), y in zip(ends, _spread([end for end, _ in ends], 1 / _MOST_LABELS, 1.0), strict=True):
        axes.annotate(f'{t_s:g} s', (1.0, end), xytext=(1.03, y), xycoords='axes fraction', textcoords='axes fraction',
                      va='center', color=colours[t_s], annotation_clip=False, arrowprops={
                          'arrowstyle': '-', 'color': colours[t_s], 'linewidth': 0.7, 'shrinkA': 0, 'shrinkB': 0})


def speeds_of(source: Source, one: Moment) -> Floats:
    """Return the speeds (m/s) at a moment. Raises InputError if the speeds are unknown."""
    if one.speed_m_s is None:
        raise InputError(f'{source.name}: it has no velocities; record with the effect velocity, or plot the scene')
    return one.speed_m_s


def _spread(values: Sequence[float], least: float, end: float) -> list[float]:
    """Return the increasing ``values``, moved so that they are at least ``least`` apart and none exceeds ``end``."""
    out: list[float] = []
    for value in values:
        out.append(max(value, out[-1] + least) if out else value)
    room = end
    for n in reversed(range(len(out))):
        out[n] = min(out[n], room)
        room = out[n] - least
    return out
