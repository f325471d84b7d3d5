"""The pages of a plan: the whole way with its tight places numbered, sheets to scale of these places, and tables."""
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from io import BytesIO
from math import ceil, inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import dragon_ros as dr
from dragon_ros.cli import command_line, figures
from dragon_ros.cli.figures import BODY, HATCH, HEAD, OBSTACLE, QUIET
from dragon_ros.cli.inputs import Floats, __version__
from dragon_ros.cli.progress import Progress
from dragon_ros.commands.plan_contents import Gap, Plan, minutes, outlines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCALES = (50, 100, 200, 250, 300, 400, 500, 1000)
_OVERVIEWS = (100, 200, 250, 300, 400, 500, 600, 750, 1000, 1500, 2000, 2500, 3000, 4000, 5000, 7500, 10_000, 20_000,
              50_000, 100_000)
_SHEET = 200            # scale of sheets, and the coarsest of a plan on one page, unless --scale is given
PAPERS_MM = {'A4': (297.0, 210.0), 'A3': (420.0, 297.0)}
_EDGE_MM, _FOOT_MM = 12.0, 34.0     # margins around a page and below the drawing
_AROUND_M = 2.0         # margin around the drawn objects
_NEAR_WAY = 0.2         # an overview shows obstacles nearer to the way than this share of its size
_OF_OBSTACLE_M = 5.0    # how much of them it shows at least
_BESIDE = 0.12          # margin around the places of a sheet, relative to its size
_TEXT_PT, _SMALL_PT = 9, 7.5
_BROKEN = '#C00000'
_OBSTACLE_HATCH = '\\\\\\'      # distinguishes obstacles from swept areas in black and white
_CENTRE_LINE = (0, (12, 2, 2, 2))
_ROWS = 34              # number of table rows per page
_LISTED = 5             # number of rows of the list of places on a page
_BAND_M = 0.25          # half the width of the band along the track that labels avoid
_APART_MM, _DOTS_MM = 14.0, 5.0     # smallest distances between labelled marks, and between dots
_LONGEST_NAME = 24
_NEAR = 24              # number of places for a number that are searched for one that covers nothing at all
_PLAIN: dict[str, Any] = {'boxstyle': 'square,pad=0.1', 'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.75}


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
    """Return one sheet with the whole way or, if it is too large, an overview and sheets of the tight places.

    Raises FieldError for an invalid scale.
    """
    low, high = extent(plan)
    asked = None if scale is None else _scale(scale)
    papers = [paper] if paper else list(PAPERS_MM)
    for one in (asked,) if asked else (some for some in SCALES if some <= _SHEET):
        for each in papers:
            if np.all(high - low <= _size_m(each, one)):
                return [_centred(each, one, 0.5 * (low + high))]
    sheet = asked or _SHEET
    near = [gap.ends_m for gap in plan.gaps if gap.gap_m <= _NEAR_WAY * np.max(high - low)]
    low = np.min([low, *(ends.min(axis=0) - _OF_OBSTACLE_M for ends in near)], axis=0)
    high = np.max([high, *(ends.max(axis=0) + _OF_OBSTACLE_M for ends in near)], axis=0)
    first = overview(papers[0], low, high, sheet)
    return [first, *(_centred(papers[0], sheet, at, n) for n, at in enumerate(_centres(plan, papers[0], sheet), 2))]


def extent(plan: Plan) -> tuple[Floats, Floats]:
    """Return the corners (m) of a rectangle around the way and the swept area."""
    both = np.concatenate((plan.line, plan.room.area.bounds.reshape(2, 2)))
    return both.min(axis=0) - _AROUND_M, both.max(axis=0) + _AROUND_M


def overview(paper: str, low: Floats, high: Floats, above: int = 0) -> Sheet:
    """Return a sheet that shows everything between two corners, at a scale coarser than 1:``above``."""
    scale = next((one for one in _OVERVIEWS if one > above and np.all(high - low <= _size_m(paper, one))),
                 _OVERVIEWS[-1])
    return _centred(paper, scale, 0.5 * (low + high))


def _scale(text: str) -> int:
    one, _, many = text.partition(':')
    if one.strip() == '1' and many.strip().isdecimal() and SCALES[0] <= int(many) <= SCALES[-1]:
        return int(many)
    raise dr.FieldError('--scale', text, f'scales go from 1:{SCALES[0]} to 1:{SCALES[-1]}', 'write, for example, 1:200')


def _size_m(paper: str, scale: int) -> Floats:
    """Return the size of the drawing on a page, in metres of the street."""
    out: Floats = (np.array(PAPERS_MM[paper]) - (2 * _EDGE_MM, 2 * _EDGE_MM + _FOOT_MM)) * scale / 1000
    return out


def _centred(paper: str, scale: int, at_m: Floats, number: int = 1) -> Sheet:
    half = 0.5 * _size_m(paper, scale)
    return Sheet(paper, scale, np.array((at_m - half, at_m + half)), number)


def _centres(plan: Plan, paper: str, scale: int) -> list[Floats]:
    """Return the centres of sheets, along the way: of the tight places or, without obstacles, of those with most room.

    If no place is tight, the tightest has a sheet.
    """
    from shapely import LineString, Point
    if plan.gaps:
        places = [gap.middle_m for gap in plan.gaps if gap.is_tight] or [plan.gaps[0].middle_m]
    else:
        places = list(plan.run.track_poses([at_m for at_m, *_ in plan.widest])[0])
    line, most_m = LineString(plan.line), (1 - 2 * _BESIDE) * _size_m(paper, scale)
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


def page(plan: Plan, paper: str, number: tuple[int, int], title: str, text: str) -> 'Figure':
    """Return a page with its title, its date, its number, and text below the title."""
    from matplotlib.figure import Figure
    width, height = PAPERS_MM[paper]
    figure = Figure(figsize=(width / 25.4, height / 25.4))
    figure.set_layout_engine('none')
    top, (n, total) = (_FOOT_MM + 3) / height, number
    note = plan.say('page', day=date.today().isoformat(), paper=paper, n=n, total=total, version=__version__)
    figure.text(_EDGE_MM / width, top, title, fontsize=13, weight='bold', va='top')
    figure.text(1 - _EDGE_MM / width, top, note, ha='right', va='top', fontsize=_TEXT_PT)
    figure.text(_EDGE_MM / width, (_FOOT_MM - 6) / height, text, fontsize=_TEXT_PT, va='top')
    return figure


def frame(figure: 'Figure', sheet: Sheet) -> 'Axes':
    """Return the axes of a drawing to scale, with a scale bar about five centimetres long below it."""
    width, height = PAPERS_MM[sheet.paper]
    axes = figure.add_axes((_EDGE_MM / width, (_EDGE_MM + _FOOT_MM) / height, 1 - 2 * _EDGE_MM / width,
                            1 - (2 * _EDGE_MM + _FOOT_MM) / height))
    axes.set(xlim=sheet.window[:, 0], ylim=sheet.window[:, 1], xticks=[], yticks=[])
    length_m = max(m for m in (n * 10 ** power for power in range(5) for n in (1, 2, 5)) if m * 1000 / sheet.scale < 52)
    long = length_m * 1000 / sheet.scale
    bar = figure.add_axes((1 - (_EDGE_MM + long + 12) / width, 9 / height, long / width, 2.5 / height))
    bar.set(xlim=(0, length_m), ylim=(0, 1), yticks=[], xticks=[0, length_m / 2, length_m])
    bar.set_xticklabels(['0', f'{length_m / 2:g}', f'{length_m:g} m'], fontsize=_TEXT_PT)
    bar.axvspan(0, length_m / 2, color='black')
    for one in (axes, bar):
        one.grid(False)
        one.spines[['top', 'right']].set_visible(True)
    return axes


def drawing(plan: Plan, sheet: Sheet, total: int = 1, others: Sequence[Sheet] = ()) -> 'Figure':
    """Return a page with a part of the drawing; ``others`` are sheets whose frames it shows."""
    from dragon_ros.pictures.dragon import draw_venue, fill
    title = plan.say('detail' if sheet.number > 1 else 'plan', title=plan.title, scale=sheet.scale, n=sheet.number)
    figure = page(plan, sheet.paper, (sheet.number, total), title, '\n'.join(_listed(plan, sheet, others)))
    axes = frame(figure, sheet)
    if plan.scene.venue is not None:
        draw_venue(axes, plan.scene.venue, plan.say('obstacles'), _OBSTACLE_HATCH)
    for area, colour, name, hatch in ((plan.room.area.body, BODY, 'body', None),
                                      (plan.room.area.head, HEAD, 'head', HATCH)):
        fill(axes, area, plan.say(name), facecolor=colour, edgecolor=colour, alpha=0.45, linewidth=0.4, hatch=hatch,
             zorder=2)
    axes.plot(*plan.line.T, color='black', linewidth=0.7, linestyle=_CENTRE_LINE, zorder=3, label=plan.say('track'))
    _legend_below(figure, axes, sheet.paper)
    labels = Labels(axes, plan, sheet)
    shown = [(n, gap) for n, gap in enumerate(plan.tight, 1) if sheet.shows(gap.middle_m)]
    for _, gap in shown:
        labels.take(gap.ends_m, 3.0)
    _draw_frames(axes, plan, others, labels)
    if not others:
        _draw_room(axes, plan, sheet, labels)
    _draw_numbers(plan, shown, labels, dimensions=not others)
    _draw_marks(axes, plan, sheet, labels)
    _draw_names(axes, plan, sheet, labels)
    return figure


def _legend_below(figure: 'Figure', axes: 'Axes', paper: str) -> None:
    """Put the legend of a drawing below it, above the scale bar."""
    width, height = PAPERS_MM[paper]
    figure.legend(*axes.get_legend_handles_labels(), loc='lower right', ncols=2, fontsize=_TEXT_PT,
                  bbox_to_anchor=(1 - _EDGE_MM / width, 14 / height), borderpad=0, borderaxespad=0)


def _listed(plan: Plan, sheet: Sheet, others: Sequence[Sheet]) -> list[str]:
    """Return the tight places on a page, as a list of a few lines, the tightest first."""
    out = []
    for number, gap in enumerate(plan.tight, 1):
        if sheet.shows(gap.middle_m):
            on = next((plan.say('on_sheet', n=one.number) for one in others if one.shows(gap.middle_m)), '')
            out.append(plan.say('listed', n=number, gap=_gap(plan, gap), time=minutes(gap.after_s)) + on)
    more = len(out) - _LISTED
    if more > 0:
        out = [*out[:_LISTED], plan.say('more', count=more)]
    return [*out, plan.say('people')]


def _gap(plan: Plan, gap: Gap) -> str:
    return plan.say('drawn_broken_gap' if gap.is_broken else 'gap', name=gap.name, gap=gap.gap_m)


def exact_gap(plan: Plan, gap: Gap) -> str:
    """Return a gap as text, rounded to millimetres."""
    return plan.say('broken_gap' if gap.is_broken else 'exact_gap', name=gap.name, gap=gap.gap_m)


# Labels

class Labels:
    """Places labels where they cover no other label or arrow and, if possible, neither obstacles' edges nor the track.

    Positions and sizes on the page are in points.
    """

    def __init__(self, axes: 'Axes', plan: Plan, sheet: Sheet) -> None:
        """Start with a drawing without labels."""
        from shapely import LineString, box, prepare, union_all
        from shapely.affinity import affine_transform
        self.axes, self._taken = axes, list[Any]()
        low, high = np.asarray(axes.transAxes.transform([(0, 0), (1, 1)])) * 72 / axes.figure.dpi
        self._frame = box(*low, *high)
        self.points_per_m = 72 / 25.4 * 1000 / sheet.scale
        self._low_pt, self._low_m = low, sheet.window[0]
        shown = box(*sheet.window.ravel())
        lines = [] if plan.scene.venue is None else [*outlines(plan.scene.venue).values()]
        seen = union_all([one.intersection(shown) for one in (*lines, LineString(plan.line).buffer(_BAND_M))])
        scale, (x, y) = self.points_per_m, low - self.points_per_m * self._low_m
        self._avoided = affine_transform(seen, [scale, 0, 0, scale, x, y])
        prepare(self._avoided)

    def points(self, at_m: Floats) -> Floats:
        """Return positions on the page."""
        out: Floats = self._low_pt + (at_m - self._low_m) * self.points_per_m
        return out

    def take(self, points_m: Floats, half_width: float) -> None:
        """Keep the surroundings of a point or a line free of labels."""
        from shapely import LineString, Point
        at = self.points(points_m)
        self._taken.append((Point(at) if at.ndim == 1 else LineString(at)).buffer(half_width, quad_segs=1))

    def placed(self, at_m: Floats, label: str, offsets: Iterable[tuple[float, float]], size_pt: float = _TEXT_PT,
               near: float = inf) -> tuple[float, float] | None:
        """Return the first offset from a position at which a label is free, or None; keep the label free of others.

        After ``near`` offsets, the label may cover edges of obstacles and the track.
        """
        from shapely import box
        x, y = self.points(at_m)
        half_width, half_height = 0.5 * size_pt * _ems(label) + 2, 0.5 * size_pt + 3
        free = dict[tuple[float, float], Any]()
        for n, (right, up) in enumerate(offsets):
            one = box(x + right - half_width, y + up - half_height, x + right + half_width, y + up + half_height)
            if self._frame.contains(one) and not any(one.intersects(other) for other in self._taken):
                free[right, up] = one
                if not self._avoided.intersects(one):
                    self._taken.append(one)
                    return right, up
            if free and n >= near:
                break
        if not free:
            return None
        offset, one = next(iter(free.items()))
        self._taken.append(one)
        return offset

    def write(self, at_m: Floats, label: str, offset: tuple[float, float], **options: Any) -> None:
        """Write a label at an offset from a position, and keep the line to it, if any, free of later labels."""
        if 'arrowprops' in options:
            self.take(np.stack((at_m, at_m + np.array(offset) / self.points_per_m)), 1.0)
        self.axes.annotate(label, (float(at_m[0]), float(at_m[1])), xytext=offset, textcoords='offset points',
                           ha='center', va='center', **{'fontsize': _TEXT_PT, **options})


def _ems(label: str) -> float:
    """Return the approximate width of a text, relative to its height."""
    return sum(1.0 if letter > '\u2e7f' else 0.62 for letter in label)


def around(label: str) -> Iterator[tuple[float, float]]:
    """Yield offsets of a label around a position, the nearest first."""
    half = 0.3 * _TEXT_PT * _ems(label)
    for radius in (16, 30, 45, 65, 90, 120, 160):
        for x, y in ((0.5, -0.87), (0.5, 0.87), (-0.5, -0.87), (-0.5, 0.87), (1, 0), (-1, 0), (0, -1), (0, 1)):
            yield radius * x + np.copysign(half, x) * bool(x), radius * y


# What is drawn

def _draw_frames(axes: 'Axes', plan: Plan, others: Sequence[Sheet], labels: Labels) -> None:
    """Draw the frames of the sheets, with their numbers."""
    for one in others:
        (left, bottom), (right, top) = one.window
        axes.plot([left, right, right, left, left], [bottom, bottom, top, top, bottom], color=QUIET, linewidth=0.8,
                  linestyle='--', zorder=4)
        label, corner = plan.say('sheet', n=one.number), np.array((left, top))
        half = 0.5 * _TEXT_PT * _ems(label)
        offset = labels.placed(corner, label, [(half + 2, 8), (half + 2, -8), (half + 40, 8), (half + 40, -8)])
        labels.write(corner, label, offset or (half + 2, -8), color=QUIET, zorder=7)


def _draw_numbers(plan: Plan, shown: Sequence[tuple[int, Gap]], labels: Labels, dimensions: bool) -> None:
    """Draw the numbers of tight places; on a sheet, with the gaps as dimension lines and their sizes."""
    for number, gap in shown:
        colour = _BROKEN if gap.is_broken else 'black'
        label = f'{number}  {_gap(plan, gap)}' if dimensions else str(number)
        if not dimensions:
            labels.axes.plot(*gap.ends_m.T, color=colour, linewidth=0.5, zorder=6)
        else:
            labels.axes.annotate('', gap.ends_m[0], gap.ends_m[1], zorder=6, arrowprops={
                'arrowstyle': '<->', 'color': colour, 'linewidth': 0.9, 'shrinkA': 0, 'shrinkB': 0,
                'mutation_scale': 6})
        offset = labels.placed(gap.middle_m, label, around(label), near=inf if dimensions else _NEAR) or (0.0, 30.0)
        labels.write(gap.middle_m, label, offset, color=colour, zorder=8,
                     bbox={'boxstyle': 'round,pad=0.2' if dimensions else 'circle,pad=0.2', 'facecolor': 'white',
                           'edgecolor': colour, 'linewidth': 0.7},
                     arrowprops={'arrowstyle': '-', 'color': colour, 'linewidth': 0.5, 'shrinkB': 0})


def _draw_room(axes: 'Axes', plan: Plan, sheet: Sheet, labels: Labels) -> None:
    """Draw the required room at the positions where it is largest."""
    for at_m, left_m, right_m in plan.widest:
        (point,), ((x, y),) = plan.run.track_poses([at_m])
        if not sheet.shows(point):
            continue
        normal = np.array((-y, x))
        ends = np.stack((point + left_m * normal, point - right_m * normal))
        axes.plot(*ends.T, color='black', linewidth=1.4, zorder=5)
        labels.take(ends, 2.0)
        label = plan.say('room', room=left_m + right_m)
        if (offset := labels.placed(point, label, around(label))) is not None:
            labels.write(point, label, offset, zorder=7, bbox=_PLAIN,
                         arrowprops={'arrowstyle': '-', 'color': QUIET, 'linewidth': 0.5})


def _draw_marks(axes: 'Axes', plan: Plan, sheet: Sheet, labels: Labels) -> None:
    """Draw a mark every ten metres, or fewer on an overview; with its distance and time where there is room for it."""
    metres = sheet.scale / 1000      # of a millimetre on the page
    step = next((one for one in (1, 2, 5, 10, 20, 50) if 10 * one >= _APART_MM * metres), 100)
    marks_m = plan.marks_m()
    if _DOTS_MM * metres > 10:
        marks_m = marks_m[np.round(marks_m / 10) % step == 0]
    points, headings = plan.run.track_poses(marks_m)
    seen = [n for n, at in enumerate(points) if sheet.shows(at)]
    times_s, _ = plan.passes_s(marks_m)
    for n in seen:
        axes.plot(*points[n], marker='o', markersize=2.6, color='black', zorder=4)
        labels.take(points[n], 2.0)
    for n in (n for n in seen if round(marks_m[n] / 10) % step == 0):
        mark, time = f'{marks_m[n]:g} m', minutes(times_s[n])
        for label in (f'{mark}, {time}', mark) if time else (mark,):
            if (offset := labels.placed(points[n], label, _beside(headings[n], label), _SMALL_PT)) is not None:
                labels.write(points[n], label, offset, fontsize=_SMALL_PT, zorder=5, bbox=_PLAIN)
                break


def _beside(heading: Floats, label: str) -> list[tuple[float, float]]:
    """Return offsets of a label from a mark: to the left of the track, then to the right, then farther."""
    half, (x, y) = 0.5 * _SMALL_PT * _ems(label), heading.tolist()
    away = [side * (radius + half * abs(y)) for radius in (9.0, 16.0, 24.0) for side in (1, -1)]
    return [(-far * y, far * x) for far in away]


def _draw_names(axes: 'Axes', plan: Plan, sheet: Sheet, labels: Labels) -> None:
    """Write the names of obstacles on them, the largest first, where they cover nothing."""
    from shapely import LineString, Polygon, box
    if plan.scene.venue is None:
        return
    window, parts = box(*sheet.window.ravel()), []
    for one in plan.scene.venue.obstacles:
        whole = Polygon(one.points_m) if hasattr(one, 'holes_m') else LineString(one.points_m)
        if not (part := whole.intersection(window)).is_empty:
            parts.append((one.name, part))
    for name, part in sorted(parts, key=lambda pair: -pair[1].length):
        middle = part.representative_point() if part.area else part.interpolate(0.5, normalized=True)
        label, at = name if len(name) <= _LONGEST_NAME else f'{name[:_LONGEST_NAME - 1]}…', np.array(middle.coords[0])
        left, bottom, right, top = part.bounds
        room_pt = max(right - left, 0.0 if part.area else top - bottom) * labels.points_per_m
        if sheet.number == 1 and room_pt < 0.7 * _SMALL_PT * _ems(label):      # a town of names that hide the houses
            continue
        if (offset := labels.placed(at, label, [(0.0, 0.0), (0.0, 10.0), (0.0, -10.0)], _SMALL_PT)) is not None:
            labels.write(at, label, offset, fontsize=_SMALL_PT, color=QUIET, zorder=5, style='italic',
                         bbox={**_PLAIN, 'facecolor': OBSTACLE})


# Tables

def _tables(plan: Plan) -> list[list[tuple[str, str, str]]]:
    """Return the rows of the tables, page by page."""
    marks_m = plan.marks_m()
    rows = [(f'{mark:g}', minutes(head_s), minutes(tail_s))
            for mark, head_s, tail_s in zip(marks_m, *plan.passes_s(marks_m), strict=True)]
    return [rows[first:first + 2 * _ROWS] for first in range(0, len(rows), 2 * _ROWS)] or [[]]


def _table(plan: Plan, paper: str, rows: list[tuple[str, str, str]], number: tuple[int, int]) -> 'Figure':
    """Return a page with the times at which head and tail pass each mark, the gaps and the room."""
    width, height = PAPERS_MM[paper]
    figure = page(plan, paper, number, plan.say('tables', title=plan.title), said(plan))
    x, top, line = _EDGE_MM + 2, height - _EDGE_MM - 4, 4.3
    for first in range(0, len(rows), _ROWS):
        block = [(plan.say('mark'), plan.say('head_at'), plan.say('tail_at')), *rows[first:first + _ROWS]]
        for n, row in enumerate(block):
            for k, cell in enumerate(row):
                figure.text((x + 16 + 24 * k) / width, (top - line * n) / height, cell, fontsize=_TEXT_PT, ha='right',
                            weight='bold' if n == 0 else 'normal')
        x += 72
    texts = [(plan.say('gaps'), 'black')] if plan.gaps else []
    texts += [(plan.say('listed', n=n, gap=exact_gap(plan, gap), time=minutes(gap.after_s)),
               _BROKEN if gap.is_broken else 'black') for n, gap in enumerate(plan.gaps[:_ROWS - 8], 1)]
    texts += [('', 'black'), (plan.say('most_room'), 'black')] if plan.widest else []
    texts += [(plan.say('room_at', at=at, left=left, right=right), 'black') for at, left, right in plan.widest]
    for n, (text, colour) in enumerate(texts):
        figure.text((x + 4) / width, (top - line * n) / height, text, fontsize=_TEXT_PT, color=colour)
    return figure


def said(plan: Plan) -> str:
    """Return the text that states what is proved and what is not."""
    venue, proved, people = plan.scene.venue, plan.say('proved', fastest=plan.fastest), plan.say('people')
    if plan.gaps:
        within_mm = max(1, ceil(1000 * max(gap.within_m for gap in plan.gaps)))
        proved = plan.say('proved_gaps', fastest=plan.fastest, within=within_mm)
    if venue is not None and venue.margin_m:
        people += ('' if plan.lang == 'zh' else ' ') + plan.say('margin', margin=venue.margin_m)
    return '\n'.join((proved, plan.say('sampled', step=100 * plan.room.sampled_m), people))
