"""Pictures of a dragon: its benches on their track, and the contact with a close-up."""
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from dragon_ros.cli.figures import BODY, HEAD, POINT, QUIET, TOUCHED, TRACK
from dragon_ros.commands.sources import Moment, Source, Touch, moment
from dragon_ros.core.errors import InputError
from dragon_ros.core.numerics.types import Floats

_MOST_PANELS = 6
_CLOSE_LENGTHS = 0.62       # half the side of the close-up, in bench lengths
_LEGEND_IN = 0.35


def dragon_picture(source: Source, times_s: list[float]) -> Figure:
    """Return a figure with one panel for each time (figure 7 of the paper has 60 s and 240 s).

    Raises InputError for times outside the source, and for more than fit on a page.
    """
    if len(times_s) > _MOST_PANELS:
        raise InputError(f'--time: {len(times_s)} times; a picture has room for {_MOST_PANELS}')
    shown = [moment(source, t_s) for t_s in times_s]
    columns = min(len(shown), 3)
    rows = -(-len(shown) // columns)
    side = 5.6 if columns > 1 else 7.2
    figure = Figure(figsize=(side * columns, side * rows + _LEGEND_IN))
    size = max(extent(one) for one in shown)
    for number, one in enumerate(shown, start=1):
        axes = figure.add_subplot(rows, columns, number)
        draw(axes, source.track, one)
        frame(axes, size)
        axes.set_title(f'{source.name}: {len(one.benches.centre)} benches at {one.t_s:g} s')
    _legend(figure, source.track is not None, False)
    return figure


def contact_picture(source: Source, touch: Touch) -> Figure:
    """Return a figure of the whole dragon at the contact beside a close-up (figure 8 of the paper)."""
    one = moment(source, touch.t_s)
    figure = Figure(figsize=(12.4, 6.4 + _LEGEND_IN))
    whole, close = figure.subplots(1, 2, gridspec_kw={'wspace': 0.06})
    for axes in (whole, close):
        draw(axes, source.track, one, touch.benches[1])
    frame(whole, extent(one))
    _look_closer(close, one, touch)
    whole.indicate_inset_zoom(close, edgecolor=POINT, alpha=0.8, linewidth=0.8)
    inner, outer = touch.benches
    seen = touch.witness
    whole.set_title(f'{source.name}: first contact at {touch.t_s:.6f} s')
    close.set_title(f"bench {seen.owner}'s {seen.corner} corner meets bench {seen.other}'s {seen.edge} edge"
                    if seen.owner in (inner, outer) else f'benches {inner} and {outer} touch')
    _legend(figure, source.track is not None, True)
    return figure


def draw(axes: Axes, track: Floats | None, one: Moment, touched: int | None = None) -> PolyCollection:
    """Draw track, benches and handles to scale, and return the benches."""
    if track is not None:
        axes.plot(*track.T, color=TRACK, linewidth=0.7, zorder=1)
    colours = [HEAD, *[BODY] * (len(one.benches.centre) - 1)]
    if touched is not None:
        colours[touched] = TOUCHED
    benches = PolyCollection(list(one.benches.corners), facecolors=colours, edgecolors='black', linewidths=0.35,
                             zorder=2)
    axes.add_collection(benches)
    axes.plot(*one.p.T, linestyle='none', marker='o', markersize=1.1, color='black', zorder=3)
    return benches


def frame(axes: Axes, size: float) -> None:
    """Set one scale for both axes, ``size`` metres to each side of the centre, and their labels."""
    axes.set(aspect='equal', xlim=(-size, size), ylim=(-size, size), xlabel='x (m)', ylabel='y (m)')


def extent(one: Moment) -> float:
    """Return how far from the centre a picture of a dragon must extend."""
    return 1.04 * float(np.max(np.abs(one.benches.corners)))


def _look_closer(axes: Axes, one: Moment, touch: Touch) -> None:
    (x, y), benches = touch.point_m, one.benches
    reach = _CLOSE_LENGTHS * 2 * float(np.median(benches.half_length))
    axes.set(aspect='equal', xlim=(x - reach, x + reach), ylim=(y - reach, y + reach), xlabel='x (m)', ylabel='y (m)')
    axes.plot(*one.p.T, linestyle='none', marker='o', markersize=4, color='black', zorder=3)
    axes.plot(x, y, marker='o', markersize=13, markerfacecolor='none', markeredgecolor=POINT, markeredgewidth=1.4,
              zorder=5)
    axes.annotate(f'({x:.6f}, {y:.6f}) m', (x, y), xytext=(0.97, 0.03), textcoords='axes fraction', ha='right',
                  va='bottom', arrowprops={'arrowstyle': '-', 'color': QUIET, 'linewidth': 0.9, 'shrinkB': 7},
                  bbox={'boxstyle': 'round,pad=0.3', 'facecolor': 'white', 'edgecolor': QUIET}, zorder=6)
    inside = np.flatnonzero(np.all(np.abs(benches.centre - (x, y)) < 0.8 * reach, axis=1))
    for bench in inside.tolist():
        angle = float(np.degrees(benches.yaw_rad[bench]))
        middle_x, middle_y = benches.centre[bench].tolist()
        axes.text(middle_x, middle_y, f'bench {bench}', ha='center', va='center', fontsize=8.5, zorder=4,
                  rotation=(angle + 90) % 180 - 90, rotation_mode='anchor')


def _legend(figure: Figure, track: bool, contact: bool) -> None:
    parts: list[Patch | Line2D] = [Patch(facecolor=colour, edgecolor='black', linewidth=0.5, label=label) for
                                   colour, label in ((HEAD, 'head'), (TOUCHED, 'bench that it touches'),
                                                     (BODY, 'body')) if contact or colour != TOUCHED]
    parts.append(Line2D([], [], linestyle='none', marker='o', markersize=3, color='black', label='handles'))
    if track:
        parts.append(Line2D([], [], color=TRACK, linewidth=1, label='track'))
    if contact:
        parts.append(Line2D([], [], linestyle='none', marker='o', markersize=10, markerfacecolor='none',
                            markeredgecolor=POINT, label='contact'))
    figure.legend(handles=parts, loc='outside lower center', ncols=len(parts))
