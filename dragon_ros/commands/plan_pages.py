"""The pages of a plan: the whole way with its tight places numbered, sheets to scale of these places, and tables."""
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from io import BytesIO
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dragon_ros.cli import command_line, figures
from dragon_ros.cli.figures import BODY, HATCH, HEAD, OBSTACLE, QUIET, add_lines
from dragon_ros.cli.progress import Progress
from dragon_ros.commands.plan_contents import Gap, Plan, minutes
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCALES = (50, 100, 200, 250, 300, 400, 500, 1000)
OVERVIEW = (100, 200, 250, 300, 400, 500, 600, 750, 1000, 1500, 2000, 2500, 3000, 4000, 5000, 7500, 10_000, 20_000,
             50_000, 100_000)
_SHEET = 200            # scale of sheets, and the coarsest of a plan on one page, unless --scale is given
PAPERS_MM = {'A4': (297.0, 210.0), 'A3': (420.0, 297.0)}
_EDGE_MM, _FOOT_MM = 12.0, 34.0     # margins around a page and below the drawing
_AROUND_M = 2.0         # margin around the drawn objects
_BESIDE = 0.12          # margin around the places of a sheet, relative to its size
_TEXT_PT, _SMALL_PT = 9, 7.5
_BROKEN = '#C00000'
_OBSTACLE_HATCH = '\\\\\\'      # distinguishes obstacles from swept areas in black and white
_CENTRE_LINE = (0, (12, 2, 2, 2))
_ROWS = 34              # number of table rows per page
_LISTED = 5             # number of rows of the list of places on a page
_BAND_M = 0.25          # half the width of the band along the track that labels do not cover, on a sheet
_APART_MM = 14.0        # smallest distance between labelled marks
_LONGEST_NAME = 24
_PLAIN: dict[str, Any] = {'boxstyle': 'square,pad=0.1', 'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.75}
_AROUND = [(radius * np.cos(angle), radius * np.sin(angle)) for radius in (16, 30, 45, 65, 90, 120, 160)
           for angle in np.radians([-60, 60, -120, 120, 0, 180, -90, 90])]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A page with a part of the plan: its scale, its window (m, shape (2, 2)) and its place among the pages."""

    paper: str
    scale: int
    window: Floats
    number: int = 1

    def shows(self, at_m: Floats) -> bool:
        """Return whether a point lies in the window."""
        return bool(np.all(at_m >= self.window[0]) and np.all(at_m <= self.window[1]))


def write_pdf(arguments: Namespace, plan: Plan, path: Path) -> None:
    """Write the pages of a plan."""
    write_pages([plan], path, lambda: list(pages(plan, sheets(plan, arguments.paper, arguments.plan_scale))))


def write_pages(plans: Sequence[Plan], path: Path, made: Callable[[], list['Figure']]) -> None:
    """Write pages that are made in the style of plans."""
    from matplotlib.backends.backend_pdf import PdfPages
    lang, has_chinese = plans[0].lang, any(map(_has_chinese, plans))
    with figures.style(chinese=lang == 'zh' or has_chinese, needed=lang == 'zh'), BytesIO() as file:
        found = made()
        with PdfPages(file, metadata={'CreationDate': None}) as pdf:    # on a full disk, zlib would raise its own error
            for one in Progress('plan', 'pages', len(found))(found):
                pdf.savefig(one)
        command_line.write_output(path, file.getvalue())
    if lang != 'zh' and has_chinese and not figures.has_chinese_font():
        command_line.write_output(None, plans[0].say('no_font'))


def _has_chinese(plan: Plan) -> bool:
    names = plan.scene.venue.names if plan.scene.venue else ()
    return any(letter > '\u2e7f' for name in (plan.title, *names) for letter in name)


# The sheets

def sheets(plan: Plan, paper: str | None, scale: str | None) -> list[Sheet]:
    """Return one sheet with the whole way or, if it is too large, an overview and sheets where something happens.

    Raises FieldError for an invalid scale.
    """
    low, high = extent(plan)
    asked = None if scale is None else _scale(scale)
    papers = [paper] if paper else list(PAPERS_MM)
    for one in (asked,) if asked else (some for some in SCALES if some <= _SHEET):
        for each in papers:
            if np.all(high - low <= size_m(each, one)):
                return [centred(each, one, 0.5 * (low + high))]
    sheet = asked or _SHEET
    first = overview(papers[0], low, high, sheet)
    return [first, *(centred(papers[0], sheet, at, n) for n, at in enumerate(_centres(plan, papers[0], sheet), 2))]


def extent(plan: Plan) -> tuple[Floats, Floats]:
    """Return the corners (m) of a rectangle around the way and the swept area."""
    x, y = plan.line.T
    left, bottom, right, top = plan.swept.bounds
    low = np.array((min(left, x.min()), min(bottom, y.min()))) - _AROUND_M
    return low, np.array((max(right, x.max()), max(top, y.max()))) + _AROUND_M


def overview(paper: str, low: Floats, high: Floats, above: int = 0) -> Sheet:
    """Return a sheet that shows everything between two corners, at a scale coarser than 1:``above``."""
    scale = next(one for one in OVERVIEW if one > above and (
        one == OVERVIEW[-1] or np.all(high - low <= size_m(paper, one))))
    return centred(paper, scale, 0.5 * (low + high))


def _scale(text: str) -> int:
    one, _, many = text.partition(':')
    if one.strip() == '1' and many.strip().isdecimal() and SCALES[0] <= int(many) <= SCALES[-1]:
        return int(many)
    raise FieldError('--scale', text, f'scales go from 1:{SCALES[0]} to 1:{SCALES[-1]}', 'write, for example, 1:200')


def size_m(paper: str, scale: int) -> Floats:
    """Return the size of the drawing on a page, in metres of the street."""
    out: Floats = (np.array(PAPERS_MM[paper]) - (2 * _EDGE_MM, 2 * _EDGE_MM + _FOOT_MM)) * scale / 1000
    return out


def centred(paper: str, scale: int, at_m: Floats, number: int = 1) -> Sheet:
    """Return a sheet around a point."""
    half = 0.5 * size_m(paper, scale)
    return Sheet(paper, scale, np.array((at_m - half, at_m + half)), number)


def _centres(plan: Plan, paper: str, scale: int) -> list[Floats]:
    """Return the centres of sheets that show the tight places and those that need the most room, along the way."""
    from shapely import LineString, Point
    room_m, _ = plan.poses(np.array([at for at, *_ in plan.widest]))
    places = np.array([*(gap.ends_m.mean(axis=0) for gap in plan.tight if gap.is_tight), *room_m]).reshape(-1, 2)
    line, most_m = LineString(plan.line), (1 - 2 * _BESIDE) * size_m(paper, scale)
    groups = list[list[Floats]]()
    for at in sorted(places, key=lambda one: line.project(Point(one))):
        if groups and np.all(np.ptp([*groups[-1], at], axis=0) <= most_m):
            groups[-1].append(at)
        else:
            groups.append([at])
    return [0.5 * (np.min(group, axis=0) + np.max(group, axis=0)) for group in groups]


# The pages

def pages(plan: Plan, drawn: Sequence[Sheet]) -> Iterator['Figure']:
    """Yield the pages: the drawings, and the tables."""
    tables = _tables(plan)
    total = len(drawn) + len(tables)
    for n, sheet in enumerate(drawn):
        yield drawing(plan, sheet, total, drawn[1:] if n == 0 else ())
    for n, rows in enumerate(tables, len(drawn) + 1):
        yield _table(plan, drawn[0].paper, rows, (n, total))


def page(plan: Plan, paper: str, number: tuple[int, int], title: str) -> 'Figure':
    """Return a page that contains only its title, its date and its number."""
    from matplotlib.figure import Figure
    width, height = PAPERS_MM[paper]
    figure = Figure(figsize=(width / 25.4, height / 25.4))
    figure.set_layout_engine('none')
    top, (n, total) = (_FOOT_MM + 3) / height, number
    note = plan.say('page', day=date.today().isoformat(), paper=paper, n=n, total=total, version=__version__)
    figure.text(_EDGE_MM / width, top, title, fontsize=13, weight='bold', va='top')
    figure.text(1 - _EDGE_MM / width, top, note, ha='right', va='top', fontsize=_TEXT_PT)
    return figure


def drawing(plan: Plan, sheet: Sheet, total: int = 1, others: Sequence[Sheet] = ()) -> 'Figure':
    """Return a page with a part of the drawing; ``others`` are sheets whose frames it shows."""
    is_detail = sheet.number > 1
    figure = page(plan, sheet.paper, (sheet.number, total), plan.say(
        'detail' if is_detail else 'plan', title=plan.title, scale=sheet.scale, n=sheet.number))
    axes = frame(figure, sheet)
    draw_venue(axes, plan, sheet.window)
    for area, colour, name, hatch in ((plan.swept.body, BODY, 'body', None), (plan.swept.head, HEAD, 'head', HATCH)):
        fill(axes, area, facecolor=colour, edgecolor=colour, alpha=0.45, linewidth=0.4, hatch=hatch,
              label=plan.say(name), zorder=2)
    axes.plot(*plan.line.T, color='black', linewidth=0.7, linestyle=_CENTRE_LINE, zorder=3, label=plan.say('track'))
    labels = Labels(axes)
    _legend(axes, plan, labels)
    _draw_frames(axes, plan, others, labels)
    _draw_numbers(axes, plan, sheet, labels, dimensions=not others)
    if others:
        _draw_marks(axes, plan, sheet, labels)
        _take_track(plan, sheet, labels)
    else:
        _take_track(plan, sheet, labels)
        _draw_room(axes, plan, sheet, labels)
        _draw_marks(axes, plan, sheet, labels)
    _draw_names(axes, plan, sheet, labels)
    draw_bar(figure, sheet)
    below(figure, sheet.paper, '\n'.join(_listed(plan, sheet, others)))
    return figure


def frame(figure: 'Figure', sheet: Sheet) -> 'Axes':
    """Return the axes of a drawing to scale."""
    width, height = PAPERS_MM[sheet.paper]
    axes = figure.add_axes((_EDGE_MM / width, (_EDGE_MM + _FOOT_MM) / height, 1 - 2 * _EDGE_MM / width,
                            1 - (2 * _EDGE_MM + _FOOT_MM) / height))
    axes.set(xlim=sheet.window[:, 0], ylim=sheet.window[:, 1], xticks=[], yticks=[])
    axes.grid(False)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(True)
    return axes


def below(figure: 'Figure', paper: str, text: str) -> None:
    """Write text below a drawing."""
    width, height = PAPERS_MM[paper]
    figure.text(_EDGE_MM / width, (_FOOT_MM - 6) / height, text, fontsize=_TEXT_PT, va='top')


def _listed(plan: Plan, sheet: Sheet, others: Sequence[Sheet]) -> list[str]:
    """Return the tight places on a page, as a list of a few lines, the tightest first."""
    out = []
    for number, gap in enumerate(plan.tight, 1):
        middle = gap.ends_m.mean(axis=0)
        if sheet.shows(middle):
            on = next((plan.say('on_sheet', n=one.number) for one in others if one.shows(middle)), '')
            out.append(plan.say('listed', n=number, gap=_gap(plan, gap), time=minutes(gap.after_s)) + on)
    more = len(out) - _LISTED
    if more > 0:
        out = [*out[:_LISTED], plan.say('more', count=more)]
    return [*out, plan.say('people')]


def _gap(plan: Plan, gap: Gap) -> str:
    return plan.say('drawn_broken_gap' if gap.is_broken else 'gap', name=gap.name, gap=gap.gap_m)


def said(plan: Plan) -> str:
    """Return the text that states what is proved and what is not."""
    venue, first = plan.scene.venue, plan.say('proved', fastest=plan.fastest)
    last = plan.say('people')
    if venue is not None:
        within_mm = max(1, ceil(1000 * max(gap.within_m for gap in plan.gaps)))
        first = plan.say('proved_gaps', fastest=plan.fastest, within=within_mm)
        last += ('' if plan.lang == 'zh' else ' ') + plan.say('margin', margin=venue.margin_m)
    return '\n'.join((first, plan.say('sampled', step=100 * plan.swept.step_m), last))


# Labels

class Labels:
    """Places labels, in points, where they cover neither each other nor what is kept free, inside the drawing."""

    def __init__(self, axes: 'Axes') -> None:
        """Start with a drawing without labels."""
        self.axes, self._taken = axes, list[tuple[float, float, float, float]]()
        corners = np.asarray(axes.transAxes.transform([(0, 0), (1, 1)])) * 72 / axes.figure.dpi
        self._low, self._high = corners

    def points(self, at_m: Floats) -> Floats:
        """Return positions in points."""
        out: Floats = np.asarray(self.axes.transData.transform(at_m)) * 72 / self.axes.figure.dpi
        return out

    def metres_per_point(self) -> float:
        """Return the metres of the street that a point on the page stands for."""
        low, high = self.axes.get_xlim()
        return float((high - low) / (self._high - self._low)[0])

    def take(self, x: float, y: float, half_width: float, half_height: float) -> None:
        """Keep a rectangle free of labels."""
        self._taken.append((x, y, half_width, half_height))

    def take_line(self, ends_m: Floats, half_width: float) -> None:
        """Keep a line free of labels."""
        begin, stop = self.points(ends_m)
        for share in np.linspace(0, 1, 2 + int(np.hypot(*(stop - begin)) / 4)):
            x, y = (begin + share * (stop - begin)).tolist()
            self.take(x, y, half_width, half_width)

    def is_free(self, x: float, y: float, half_width: float, half_height: float) -> bool:
        """Return whether a rectangle is free, and inside the drawing."""
        at, half = np.array((x, y)), np.array((half_width, half_height))
        inside = np.all(self._low <= at - half) and np.all(at + half <= self._high)
        return bool(inside) and all(abs(x - one[0]) > half_width + one[2] or abs(y - one[1]) > half_height + one[3]
                                    for one in self._taken)

    def placed(self, at_m: Floats, label: str, offsets: Iterable[tuple[float, float]],
               size_pt: float = _TEXT_PT) -> tuple[float, float] | None:
        """Return the first offset (in points) from a position at which a label is free, or None; keep it."""
        x, y = self.points(at_m)
        half_width, half_height = 0.5 * size_pt * _ems(label) + 2, 0.5 * size_pt + 3
        for right, up in offsets:
            if self.is_free(x + right, y + up, half_width, half_height):
                self.take(x + right, y + up, half_width, half_height)
                return right, up
        return None


def _ems(label: str) -> float:
    """Return the approximate width of a text, relative to its height."""
    return sum(1.0 if letter > '\u2e7f' else 0.62 for letter in label)


def _around(label: str) -> Iterator[tuple[float, float]]:
    """Yield offsets (in points) around a position, the nearest first."""
    for x, y in _AROUND:
        yield x + np.copysign(0.3 * _TEXT_PT * _ems(label), x) if abs(x) > 1 else 0.0, y


# What is drawn

def _legend(axes: 'Axes', plan: Plan, labels: Labels) -> None:
    """Put the legend into the corner where it covers the least, and keep it free of labels."""
    from shapely import LineString, Polygon, box
    shown = [plan.swept.whole.buffer(0.1), LineString(plan.line).buffer(0.1)]
    if plan.scene.venue is not None:
        shown += [(Polygon if hasattr(one, 'holes_m') else LineString)(one.points_m).buffer(0.01)
                  for one in plan.scene.venue.obstacles]
    names = [str(one.get_label()) for one in (*axes.patches, *axes.lines, *axes.artists)]
    wide = max((_ems(name) for name in names if not name.startswith('_')), default=9) * _TEXT_PT + 42
    high = 4 * 1.45 * _TEXT_PT + 8
    corner_m = np.array((wide, high)) * labels.metres_per_point()
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    corners: dict[Any, Any] = {'upper right': box(right - corner_m[0], top - corner_m[1], right, top),
               'upper left': box(left, top - corner_m[1], left + corner_m[0], top),
               'lower right': box(right - corner_m[0], bottom, right, bottom + corner_m[1]),
               'lower left': box(left, bottom, left + corner_m[0], bottom + corner_m[1])}
    where = min(corners, key=lambda name: (
        sum(one.intersection(corners[name]).area for one in shown[:2]), sum(
            one.intersection(corners[name]).area for one in shown[2:])))
    axes.legend(loc=where, fontsize=_TEXT_PT, frameon=True, framealpha=0.9).set_zorder(9)
    x, y = labels.points(np.array(corners[where].centroid.coords[0]))
    labels.take(float(x), float(y), wide / 2, high / 2)


def fill(axes: 'Axes', area: Any, **style: Any) -> None:
    """Fill polygons except for their holes."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline
    label = style.pop('label', None)
    for part in getattr(area, 'geoms', [area]):
        rings = [Outline(np.array(ring.coords), closed=True) for ring in (part.exterior, *part.interiors)]
        add_lines(axes, PathPatch(Outline.make_compound_path(*rings), label=label, **style))
        label = None


def draw_venue(axes: 'Axes', plan: Plan, window: Floats) -> None:
    """Draw the obstacles and the area outside the boundary."""
    from shapely import Polygon, box
    venue = plan.scene.venue
    if venue is None:
        return
    label: str | None = plan.say('obstacles')
    for one in venue.obstacles:
        if hasattr(one, 'holes_m'):
            fill(axes, Polygon(one.points_m, one.holes_m), facecolor=OBSTACLE, edgecolor=QUIET, linewidth=0.8,
                  hatch=_OBSTACLE_HATCH, zorder=1, label=label)
        else:
            axes.plot(*np.array(one.points_m).T, color=QUIET, linewidth=1.6, zorder=1, label=label)
        label = None
    if venue.inside is not None:
        outside = box(*window[0], *window[1]).difference(Polygon(venue.inside))
        if not outside.is_empty:
            fill(axes, outside, facecolor=OBSTACLE, edgecolor=QUIET, linewidth=0.8, zorder=0.9)


def _draw_frames(axes: 'Axes', plan: Plan, others: Sequence[Sheet], labels: Labels) -> None:
    """Draw the frames of the sheets, with their numbers."""
    for one in others:
        (left, bottom), (right, top) = one.window
        axes.plot([left, right, right, left, left], [bottom, bottom, top, top, bottom], color=QUIET, linewidth=0.8,
                  linestyle='--', zorder=4)
        label, corner = plan.say('sheet', n=one.number), np.array((left, top))
        half = 0.5 * _TEXT_PT * _ems(label)
        found = labels.placed(corner, label, [(half + 2, 8), (half + 2, -8), (half + 40, 8), (half + 40, -8)])
        axes.annotate(label, (left, top), xytext=found or (half + 2, -8), textcoords='offset points', fontsize=_TEXT_PT,
                      ha='center', va='center', color=QUIET, zorder=7)


def _draw_numbers(axes: 'Axes', plan: Plan, sheet: Sheet, labels: Labels, dimensions: bool) -> None:
    """Draw the numbers of the tight places; on a sheet, with the gaps as dimension lines and their sizes."""
    shown = [(n, gap) for n, gap in enumerate(plan.tight, 1) if sheet.shows(gap.ends_m.mean(axis=0))]
    for _, gap in shown:
        labels.take_line(gap.ends_m, 3.0)
    for number, gap in shown:
        middle, colour = gap.ends_m.mean(axis=0), _BROKEN if gap.is_broken else 'black'
        label = f'{number}  {_gap(plan, gap)}' if dimensions else str(number)
        if dimensions:
            axes.annotate('', gap.ends_m[0], gap.ends_m[1], zorder=6, arrowprops={
                'arrowstyle': '<->', 'color': colour, 'linewidth': 0.9, 'shrinkA': 0, 'shrinkB': 0,
                'mutation_scale': 6})
        offset = labels.placed(middle, label, _around(label)) or (0.0, 30.0)
        axes.annotate(label, middle, xytext=offset, textcoords='offset points', fontsize=_TEXT_PT, color=colour,
                      ha='center', va='center', zorder=8,
                      bbox={'boxstyle': 'round,pad=0.2' if dimensions else 'circle,pad=0.2', 'facecolor': 'white',
                            'edgecolor': colour, 'linewidth': 0.7},
                      arrowprops={'arrowstyle': '-', 'color': colour, 'linewidth': 0.5})


def _take_track(plan: Plan, sheet: Sheet, labels: Labels) -> None:
    """Keep the track and the benches on it free of labels."""
    for ends_m in pairwise(plan.line):
        if sheet.shows(ends_m[0]):
            labels.take_line(np.array(ends_m), _BAND_M / labels.metres_per_point())


def _draw_room(axes: 'Axes', plan: Plan, sheet: Sheet, labels: Labels) -> None:
    """Draw the required room at the positions where it is largest."""
    for at_m, left, right in plan.widest:
        points, headings = plan.poses(np.array([at_m]))
        normal = np.array((-headings[0, 1], headings[0, 0]))
        if sheet.shows(points[0]):
            ends = np.stack((points[0] + left * normal, points[0] - right * normal))
            axes.plot(*ends.T, color='black', linewidth=1.4, zorder=5)
            labels.take_line(ends, 2.0)
            label = plan.say('room', room=left + right)
            if (offset := labels.placed(points[0], label, _around(label))) is not None:
                axes.annotate(label, points[0], xytext=offset, textcoords='offset points', fontsize=_TEXT_PT,
                              ha='center', va='center', zorder=7,
                              arrowprops={'arrowstyle': '-', 'color': QUIET, 'linewidth': 0.5})


def _draw_marks(axes: 'Axes', plan: Plan, sheet: Sheet, labels: Labels) -> None:
    """Draw a mark every ten metres, with its distance and the time of the head where there is room for it."""
    apart_m = _APART_MM * sheet.scale / 1000
    step = next((one for one in (1, 2, 5, 10, 20, 50) if 10 * one >= apart_m), 100)
    points, headings = plan.poses(plan.marks_m)
    seen = [n for n, at in enumerate(points) if sheet.shows(at)]
    for n in seen:
        axes.plot(*points[n], marker='o', markersize=2.6, color='black', zorder=4)
        x, y = labels.points(points[n])
        labels.take(float(x), float(y), 2.0, 2.0)
    for n in seen:
        mark, time = plan.marks_m[n], minutes(plan.passes_s[0][n])
        if round(mark / 10) % step:
            continue
        for label in ((f'{mark:g} m, {time}', f'{mark:g} m') if time else (f'{mark:g} m',)):
            offset = labels.placed(points[n], label, mark_offsets(headings[n], label), _SMALL_PT)
            if offset is not None:
                axes.annotate(label, points[n], xytext=offset, textcoords='offset points', fontsize=_SMALL_PT,
                              ha='center', va='center', zorder=5, bbox=_PLAIN)
                break


def mark_offsets(heading: Floats, label: str) -> list[tuple[float, float]]:
    """Return offsets (in points) of a label from a mark: to the left of the track, then to the right, then farther."""
    half, (x, y) = 0.5 * _SMALL_PT * _ems(label), heading.tolist()
    away = [side * (radius + half * abs(y)) for radius in (9.0, 16.0, 24.0) for side in (1, -1)]
    return [(-far * y, far * x) for far in away]


def _draw_names(axes: 'Axes', plan: Plan, sheet: Sheet, labels: Labels) -> None:
    """Write the names of obstacles on them, the largest first, where they cover nothing."""
    from shapely import LineString, Polygon, box
    venue, frame = plan.scene.venue, box(*sheet.window[0], *sheet.window[1])
    if venue is None:
        return
    parts = []
    for one in venue.obstacles:
        whole = Polygon(one.points_m) if hasattr(one, 'holes_m') else LineString(one.points_m)
        part = whole.buffer(0).intersection(frame) if hasattr(one, 'holes_m') else whole.intersection(frame)
        if not part.is_empty:
            parts.append((one.name, part))
    for name, part in sorted(parts, key=lambda pair: -pair[1].length):
        middle = part.representative_point() if part.area else part.interpolate(0.5, normalized=True)
        label = name if len(name) <= _LONGEST_NAME else f'{name[:_LONGEST_NAME - 1]}…'
        at = np.array(middle.coords[0])
        left, bottom, right, top = part.bounds
        room_pt = max(right - left, 0.0 if part.area else top - bottom) / labels.metres_per_point()
        if sheet.number == 1 and room_pt < 0.7 * _SMALL_PT * _ems(label):      # a town of names that hide the houses
            continue
        offset = labels.placed(at, label, [(0.0, 0.0), (0.0, 10.0), (0.0, -10.0)], _SMALL_PT)
        if offset is not None:
            axes.annotate(label, (at[0], at[1]), xytext=offset, textcoords='offset points', fontsize=_SMALL_PT,
                          color=QUIET,
                          ha='center', va='center', zorder=5, style='italic', bbox={**_PLAIN, 'facecolor': OBSTACLE})


def draw_bar(figure: 'Figure', sheet: Sheet) -> None:
    """Draw a scale bar about five centimetres long, below the drawing on the right."""
    width, height = PAPERS_MM[sheet.paper]
    steps = [one * 10 ** power for power in range(5) for one in (1, 2, 5)]
    length_m = max(m for m in steps if m * 1000 / sheet.scale <= 52)
    long = length_m * 1000 / sheet.scale
    axes = figure.add_axes((1 - (_EDGE_MM + long + 12) / width, 12 / height, long / width, 2.5 / height))
    axes.set(xlim=(0, length_m), ylim=(0, 1), yticks=[], xticks=[0, length_m / 2, length_m])
    axes.set_xticklabels(['0', f'{length_m / 2:g}', f'{length_m:g} m'], fontsize=_TEXT_PT)
    axes.grid(False)
    axes.axvspan(0, length_m / 2, color='black')
    for side in ('top', 'right'):
        axes.spines[side].set_visible(True)


# Tables

def _tables(plan: Plan) -> list[list[tuple[str, ...]]]:
    """Return the rows of the tables, page by page."""
    head, tail = plan.passes_s
    rows: list[tuple[str, ...]] = [(f'{mark:g}', minutes(a), minutes(b))
                                   for mark, a, b in zip(plan.marks_m, head, tail, strict=True)]
    return [rows[first:first + 2 * _ROWS] for first in range(0, len(rows), 2 * _ROWS)] or [[]]


def _table(plan: Plan, paper: str, rows: list[tuple[str, ...]], number: tuple[int, int]) -> 'Figure':
    """Return a page with the times at which head and tail pass each mark, the gaps and the room."""
    width, height = PAPERS_MM[paper]
    figure = page(plan, paper, number, plan.say('tables', title=plan.title))
    x, top, line = _EDGE_MM + 2, height - _EDGE_MM - 4, 4.3
    for first in range(0, len(rows), _ROWS):
        block = [(plan.say('mark'), plan.say('head_at'), plan.say('tail_at')), *rows[first:first + _ROWS]]
        for n, row in enumerate(block):
            for k, cell in enumerate(row):
                figure.text((x + 16 + 24 * k) / width, (top - line * n) / height, cell, fontsize=_TEXT_PT, ha='right',
                            weight='bold' if n == 0 else 'normal')
        x += 72
    texts = [(plan.say('gaps'), 'black')] + [
        (plan.say('listed', n=n, gap=plan.exact_gap(gap), time=minutes(gap.after_s)),
         _BROKEN if gap.is_broken else 'black') for n, gap in enumerate(plan.gaps[:_ROWS - 8], 1)]
    texts += [('', 'black'), (plan.say('most_room'), 'black')] + [
        (plan.say('room_at', at=at, left=left, right=right), 'black') for at, left, right in plan.widest]
    for n, (text, colour) in enumerate(texts):
        figure.text((x + 4) / width, (top - line * n) / height, text, fontsize=_TEXT_PT, color=colour)
    below(figure, paper, said(plan))
    return figure
