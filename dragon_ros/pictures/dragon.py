"""Pictures of a dragon: its benches on the track, or its contact with a close-up."""
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from typing import Any

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import ConnectionPatch, Patch, PathPatch
from matplotlib.path import Path

from dragon_ros.cli import figures
from dragon_ros.cli.figures import BODY, HATCH, HEAD, OBSTACLE, PAGE_IN, POINT, QUIET, TEXT_PT, TOUCHED, TRACK, style
from dragon_ros.core.checks import number
from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry.contacts import OBSTACLE as NO_BENCH
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.venue import PolygonObstacle, Venue
from dragon_ros.core.words import counted
from dragon_ros.pictures.sources import Moment, Source, Touch, moment, window
from dragon_ros.pictures.zoom import INSET_WIDTH, Inset, Zoom, contact_of

_MOST_PANELS = 6
_SVG_DPI = 72       # width of a picture in Jupyter
_ROUNDING_M = 1e-9          # a shallower overlap counts as a touch
_CLOSE_LENGTHS = 0.62       # half the side of the close-up, in bench lengths
RING: dict[str, Any] = {'linestyle': 'none', 'marker': 'o', 'markersize': 12, 'markerfacecolor': 'none',
                        'markeredgecolor': POINT, 'markeredgewidth': 1.4}
_LARGEST_IN = 6.4           # longest side of the axes, in inches
_LEAST_IN = np.array((2.7, 1.6))            # smallest axes that have space for a title and ticks
_DECORATION_IN = np.array((0.85, 0.85))     # space around the axes for title, labels and ticks
_TICKS_PER_INCH = 1.3       # few, because tick labels far from the origin are long
_LEGEND_IN = 5.0, 0.7       # width and height of the legend, including the figure's title


def dragon_picture(source: Source, times_s: list[float], zoom: Zoom | None = None) -> Figure:
    """Return a figure with one panel per time, all with the same window (like figure 7 of the paper: 60 s and 240 s).

    With a ``zoom``, each panel has its own window, and an inset that shows the position of the window. Raises
    InputError for times outside the source or for more panels than fit on a page.
    """
    if len(times_s) > _MOST_PANELS:
        raise InputError(f'--times: {len(times_s)} times are given; the limit for a picture is {_MOST_PANELS}')
    shown, point_m = [moment(source, t_s) for t_s in times_s], contact_of(zoom, source)
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    whole = window(source.track, shown, source.venue)
    widths = (1.0,) if zoom is None else (1.0, INSET_WIDTH)
    longest_in = min(_LARGEST_IN, (PAGE_IN / columns - _DECORATION_IN[0]) / sum(widths))
    inches, seen = panel(whole if zoom is None else zoom.window(shown[0], point_m), longest_in)
    figure = Figure(figsize=sheet(inches * (sum(widths) * columns, rows), (columns, rows)))
    panels = figure.subplots(rows, columns * len(widths), squeeze=False, width_ratios=widths * columns).ravel().tolist()
    overlapping = False
    for one in shown:
        axes = panels.pop(0)
        seen = seen if zoom is None else zoom.window(one, point_m)
        areas = overlaps(one)
        draw(axes, seen, source.track, one, areas.benches, source.venue).show(one, areas)
        axes.locator_params(axis='x', nbins=max(2, int(_TICKS_PER_INCH * inches[0])))
        if zoom is not None:
            Inset(panels.pop(0), whole, source.track).show(one, seen)
        overlapping |= bool(areas.benches)
        what = f'{counted(len(one.benches.centre), "bench")} at {one.t_s:g} s{areas.words}'
        axes.set_title(what if columns > 1 else figures.titled(source.name, what, inches[0]))
    for axes in panels:
        axes.remove()
    if columns > 1:
        figure.suptitle(figures.short(source.name))
    _legend(figure, source.track is not None, False, overlapping)
    return figure


@dataclass(frozen=True)
class Overlaps:
    """Pairs of benches that overlap: the number of pairs, the benches, and the overlaps' outlines (m, shape (K, 2))."""

    pairs: int = 0
    benches: tuple[int, ...] = ()
    outlines_m: tuple[Floats, ...] = ()

    @property
    def words(self) -> str:
        """The suffix of a title: the number of overlapping pairs, or nothing."""
        return f', {counted(self.pairs, "pair", "overlaps")}' if self.pairs else ''


def overlaps(one: Moment) -> Overlaps:
    """Return the overlaps of benches that are not neighbours; overlaps no larger than rounding errors are omitted."""
    from dragon_ros.core.geometry.near_pairs import closeness
    found = closeness(one.p, one.benches)
    deep = found.gap_m < -_ROUNDING_M
    i, j = found.i[deep], found.j[deep]
    if not i.size:
        return Overlaps()
    corners = one.benches.corners
    shared = shapely.intersection(shapely.polygons(corners[i]), shapely.polygons(corners[j]))
    outlines = tuple(shapely.get_coordinates(area) for area in shared if area.area > 0)
    return Overlaps(int(i.size), tuple(sorted({*i.tolist(), *j.tolist()})), outlines)


def contact_picture(source: Source, touch: Touch) -> Figure:
    """Return a figure of the whole dragon at the contact, with a close-up (like figure 8 of the paper)."""
    one = moment(source, touch.t_s)
    side_in = 0.5 * PAGE_IN - _DECORATION_IN[0]
    inches, seen = panel(window(source.track, [one], source.venue), side_in)
    figure = Figure(figsize=sheet(np.array((inches[0] + side_in, max(inches[1], side_in))), (2, 1)))
    whole, close = figure.subplots(1, 2, gridspec_kw={'width_ratios': (inches[0], side_in)})
    draw(whole, seen, source.track, one, touch.benches, source.venue)
    _look_closer(close, source, one, touch)
    whole.indicate_inset_zoom(close, edgecolor=POINT, alpha=0.8, linewidth=0.8)
    for part in whole.get_children():
        if isinstance(part, ConnectionPatch):       # before Matplotlib 3.10, layouts reserved space for these lines
            part.set_in_layout(False)
    whole.set_title(figures.titled(source.name, f'first contact at {touch.t_s:.6f} s', inches[0]))
    close.set_title('\nmeets '.join(_meeting(touch).split(' meets ')))
    _legend(figure, source.track is not None, True)
    return figure


def _meeting(touch: Touch) -> str:
    """Return a phrase that names the corner and the edge that meet."""
    seen = touch.witness
    if touch.obstacle is not None:
        if seen.owner == NO_BENCH:
            return f"a corner of {touch.obstacle} meets bench {seen.other}'s {seen.edge} edge"
        return f"bench {seen.owner}'s {seen.corner} corner meets {touch.obstacle}"
    if seen.owner in touch.benches:
        return f"bench {seen.owner}'s {seen.corner} corner meets bench {seen.other}'s {seen.edge} edge"
    return touch.words


def panel(seen: Floats, longest_in: float) -> tuple[Floats, Floats]:
    """Return the size (in inches) of the axes for a window, and the window, which is widened if it is too narrow."""
    size, middle = seen[1] - seen[0], seen.mean(axis=0)
    inches = np.maximum(size / size.max() * longest_in, _LEAST_IN)
    half = 0.5 * inches * float(np.max(size / inches))
    return inches, np.array((middle - half, middle + half))


def sheet(inches: Floats, panels: tuple[int, int], legend: bool = True) -> tuple[float, float]:
    """Return the size (in inches) of a figure for panels (columns, rows) whose axes have a given total size."""
    width, height = (inches + np.array(panels) * _DECORATION_IN).tolist()
    return (max(width, _LEGEND_IN[0]), height + _LEGEND_IN[1]) if legend else (width, height)


class Drawn:
    """A dragon in axes: its benches, its touching benches, their overlaps (marked by rings), and its handles.

    Outlines and handles scale with the benches' width on paper. Benches that touch are hatched, so that they can be
    told apart without colours.
    """

    def __init__(self, axes: Axes, one: Moment, touching: Sequence[int]) -> None:
        """Draw a moment."""
        width_pt = 2 * float(np.median(one.benches.half_width)) * _points_per_m(axes)
        line_pt = min(0.06 * width_pt, 0.6)
        colours = [HEAD, *[BODY] * (len(one.benches.centre) - 1)]
        self._benches = PolyCollection(list(one.benches.corners), facecolors=colours, edgecolors='black',
                                       linewidths=line_pt, zorder=2)
        self._touching = PolyCollection([], facecolors=TOUCHED, edgecolors='black', linewidths=line_pt, zorder=2.1,
                                        hatch=HATCH)
        self._shared = PolyCollection([], facecolors=POINT, edgecolors=POINT, linewidths=0.8, zorder=2.2)
        for part in (self._benches, self._touching, self._shared):
            axes.add_collection(part)
        self._rings, = axes.plot([], [], zorder=5, **RING)
        self._handles, = axes.plot([], [], linestyle='none', marker='o', markersize=min(0.2 * width_pt, 4.0),
                                   markeredgewidth=0, color='black', zorder=3)
        self.show(one, Overlaps(benches=tuple(touching)))

    @property
    def moving(self) -> list[Artist]:
        """The parts that change from moment to moment, from bottom to top."""
        return [self._benches, self._touching, self._shared, self._handles, self._rings]

    def show(self, one: Moment, areas: Overlaps) -> None:
        """Show a moment; the head keeps its colour."""
        corners = one.benches.corners
        self._benches.set_verts(list(corners))
        self._touching.set_verts([corners[bench] for bench in areas.benches if bench > 0])
        self._shared.set_verts(list(areas.outlines_m))
        self._rings.set_data(*np.array([area.mean(axis=0) for area in areas.outlines_m]).reshape(-1, 2).T)
        self._handles.set_data(*one.p.T)


def draw(axes: Axes, seen: Floats, track: Floats | None, one: Moment, touching: Sequence[int] = (),
         venue: Venue | None = None) -> Drawn:
    """Draw venue, track, benches and handles to scale in a window (m, shape (2, 2)), and return the dragon."""
    _frame(axes, seen)
    if venue is not None:
        draw_venue(axes, venue)
    if track is not None:
        _draw_track(axes, track)
    return Drawn(axes, one, touching)


def draw_venue(axes: Axes, venue: Venue, label: str | None = None, hatch: str | None = None) -> None:
    """Draw the obstacles and the area outside the boundary; ``label`` names the obstacles in a legend."""
    for one in venue.obstacles:
        if isinstance(one, PolygonObstacle):
            fill(axes, shapely.Polygon(one.points_m, one.holes_m), facecolor=OBSTACLE, edgecolor=QUIET, linewidth=0.6,
                 zorder=0.8, label=label, hatch=hatch)
        else:
            axes.plot(*np.array(one.points_m).T, color=QUIET, linewidth=1.4, zorder=0.8, label=label)
        label = None
    if venue.inside is not None:
        inside, (left, right), (bottom, top) = shapely.Polygon(venue.inside), axes.get_xlim(), axes.get_ylim()
        around = shapely.box(*shapely.union(inside, shapely.box(left, bottom, right, top)).buffer(1.0).bounds)
        fill(axes, around.difference(inside), facecolor=OBSTACLE, edgecolor=QUIET, linewidth=0.6, zorder=0.7)


def fill(axes: Axes, area: Any, label: str | None = None, **options: Any) -> None:
    """Fill polygons except for their holes."""
    for part in getattr(area, 'geoms', [area]):
        rings = [Path(np.array(ring.coords), closed=True) for ring in (part.exterior, *part.interiors)]
        figures.add_lines(axes, PathPatch(Path.make_compound_path(*rings), label=label, **options))
        label = None


def _draw_track(axes: Axes, track: Floats) -> None:
    """Draw the points (P, 2) of a track, rear to front; the figure's first track has an id, which ``route`` reads."""
    line = Path(track[::-1])
    line.should_simplify = False
    known = any(one.get_gid() == figures.TRACK_ID for other in axes.figure.axes for one in other.patches)
    figures.add_lines(axes, PathPatch(line, fill=False, edgecolor=TRACK, linewidth=0.7, joinstyle='round', zorder=1,
                                      gid=None if known else figures.TRACK_ID))


def _frame(axes: Axes, seen: Floats) -> None:
    """Show a window with the same scale on both axes, and label the axes."""
    (left, bottom), (right, top) = seen.tolist()
    axes.set(aspect='equal', xlim=(left, right), ylim=(bottom, top), xlabel='x (m)', ylabel='y (m)')


def _points_per_m(axes: Any) -> float:
    """Return the scale of axes (points per m) before their layout; it is slightly smaller than the final scale."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    pixels_per_m = min(axes.bbox.width / (right - left), axes.bbox.height / (top - bottom))
    return 72 * float(pixels_per_m) / float(axes.figure.dpi)


def _look_closer(axes: Axes, source: Source, one: Moment, touch: Touch) -> None:
    (x, y), benches = touch.point_m, one.benches
    reach = _CLOSE_LENGTHS * 2 * float(np.median(benches.half_length))
    seen = np.array(((x - reach, y - reach), (x + reach, y + reach)))
    draw(axes, seen, source.track, one, touch.benches, source.venue)
    axes.plot(x, y, zorder=5, **RING)
    inside = np.flatnonzero(np.all(np.abs(benches.centre - (x, y)) < 0.8 * reach, axis=1))
    for bench in inside.tolist():
        angle = float(np.degrees(benches.yaw_rad[bench]))
        middle_x, middle_y = benches.centre[bench].tolist()
        axes.text(middle_x, middle_y, f'bench {bench}', ha='center', va='center', fontsize=TEXT_PT, zorder=4,
                  rotation=(angle + 90) % 180 - 90, rotation_mode='anchor')
    at_x, at_y = _emptiest_corner((benches.centre[inside] - (x, y)) / (2 * reach) + 0.5)
    point = ', '.join(f'{value:.{touch.decimals}f}' for value in touch.point_m)
    axes.annotate(f'({point}) m', (x, y), xytext=(at_x, at_y), textcoords='axes fraction',
                  ha='right' if at_x > 0.5 else 'left', va='top' if at_y > 0.5 else 'bottom',
                  arrowprops={'arrowstyle': '-', 'color': QUIET, 'linewidth': 0.9, 'shrinkB': 7},
                  bbox={'boxstyle': 'round,pad=0.3', 'facecolor': 'white', 'edgecolor': QUIET}, zorder=6)


def _emptiest_corner(labels: Floats) -> tuple[float, float]:
    """Return the corner of axes, in axes fractions, that is farthest from labels (K, 2)."""
    corners = [(0.97, 0.03), (0.03, 0.03), (0.97, 0.97), (0.03, 0.97)]
    off = labels[:, None] - np.array(corners)
    return corners[int(np.argmax(np.min(np.hypot(off[..., 0], off[..., 1]), axis=0, initial=9.0)))]


def _legend(figure: Figure, track: bool, contact: bool, overlapping: bool = False) -> None:
    parts: list[Patch | Line2D] = [Patch(facecolor=colour, edgecolor='black', linewidth=0.5, label=label, hatch=hatch)
                                   for colour, label, hatch in ((HEAD, 'head', None), (TOUCHED, 'in contact', HATCH),
                                                                (BODY, 'body', None))
                                   if contact or overlapping or colour != TOUCHED]
    if overlapping:
        parts.append(Line2D([], [], label='overlap', **RING))
    parts.append(Line2D([], [], linestyle='none', marker='o', markersize=3, color='black', label='handles'))
    if track:
        parts.append(Line2D([], [], color=TRACK, linewidth=1, label='track'))
    if contact:
        parts.append(Line2D([], [], label='contact', **RING))
    figure.legend(handles=parts, loc='outside lower center', ncols=len(parts))


def draw_on(source: Source, t_s: float | None = None, ax: Axes | None = None) -> Axes:
    """Draw a dragon at a time (by default, the last) on Matplotlib axes, by default new ones, and return the axes."""
    from matplotlib import pyplot as plt
    one = moment(source, source.span_s[1] if t_s is None else number('t_s', t_s))
    inches, seen = panel(window(source.track, [one], source.venue), 6.4)
    axes = plt.subplots(figsize=tuple(inches + 0.8))[1] if ax is None else ax
    draw(axes, seen, source.track, one, venue=source.venue)
    axes.set_title(f'{counted(len(one.benches.centre), "bench")} at {one.t_s:g} s')
    return axes


def svg_of(source: Source) -> str:
    """Return an SVG picture of a dragon at the last time, for Jupyter."""
    out = StringIO()
    with style():
        figure = Figure(figsize=(5.6, 5.6))
        draw_on(source, ax=figure.add_subplot())
        figure.savefig(out, format='svg', dpi=_SVG_DPI)
    return out.getvalue()
