"""``plan``: draw a scene to scale for printing, with the swept area, the gaps to obstacles and the times."""
import json
from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dragon_ros.cli import command_line, figures
from dragon_ros.cli.figures import BODY, HATCH, HEAD, OBSTACLE, QUIET, add_lines
from dragon_ros.cli.language import language_of, say
from dragon_ros.cli.progress import Progress
from dragon_ros.commands.plan_words import WORDS
from dragon_ros.core.errors import FieldError, InputError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dragon_ros.core.scene import Scene
    from dragon_ros.core.search.swept_area import SweptArea
    from dragon_ros.core.venue import Origin

SCALES = (50, 100, 200, 250, 300, 400, 500, 1000)
PAPERS_MM = {'A4': (297.0, 210.0), 'A3': (420.0, 297.0)}
_LARGEST = 'A3'
_EDGE_MM, _FOOT_MM = 12.0, 34.0     # margins around a page and below the drawing
_MARK_M = 10.0
_MOST_PAGES = 24
_COARSEST, _FEW_PAGES = 500, 4      # up to four pages at 1:500 or larger are preferred to a smaller scale
_AROUND_M = 2.0         # margin around the drawn objects
_TEXT_PT = 9
_BROKEN = '#C00000'
_OBSTACLE_HATCH = '\\\\\\'      # distinguishes obstacles from swept areas in black and white
_CENTRE_LINE = (0, (12, 2, 2, 2))
_ROWS = 34              # number of table rows per page
_NARROWEST = 3          # number of positions for which the required room is shown
_NEARLY_M = 0.01
_KINDS = {'pdf': {'--scale', '--paper', '--title'}, 'geojson': set[str]()}     # options that only one format accepts
_WIDE = 0.62            # width of a letter relative to the text height


def write_pdf(arguments: Namespace, plan: 'Plan', path: Path) -> None:
    """Write the pages of a plan."""
    with figures.style(chinese=plan.lang == 'zh'):
        _write_pages(path, *_pages(plan, *_sheet(arguments, plan)))


def run(arguments: Namespace) -> int:
    """Write the plan of a scene; return the exit code."""
    path: Path = arguments.output
    suffix = path.suffix.lower().lstrip('.')
    kind = arguments.format or suffix
    if kind not in _KINDS:
        raise InputError(f'--output {path}: the suffix must be .pdf or .geojson; rename it, or give --format')
    if suffix in _KINDS and suffix != kind:
        raise InputError(f'--format: {kind} conflicts with --output {path}; give only one of them')
    command_line.check_taken(f'a plan in {kind}', {
        '--scale': arguments.plan_scale is not None, '--paper': arguments.paper is not None,
        '--title': arguments.title is not None}, _KINDS[kind])
    scene = command_line.scene_from(arguments)
    lang = language_of(arguments.lang)
    plan = Plan(scene, figures.drawable(arguments.title or Path(arguments.scene).stem), lang)
    if kind == 'geojson':
        command_line.write_output(path, geojson(plan))
        lines = [f'{path}: {plan.say("metres" if plan.origin is None else "degrees")}']
    else:
        write_pdf(arguments, plan, path)
        lines = [str(path)]
    command_line.write_output(None, '\n'.join([*lines, *map(plan.exact_gap, plan.gaps)]))
    return command_line.OK


@dataclass(frozen=True)
class Gap:
    """The smallest gap to a named part of the venue; ``ends_m`` holds the two end points of the gap.

    The exact gap is smaller than ``gap_m`` by at most ``within_m``.
    """

    name: str
    gap_m: float
    ends_m: Floats
    is_broken: bool
    within_m: float


@dataclass(frozen=True)
class Plan:
    """The contents of a scene's plan."""

    scene: 'Scene'
    title: str
    lang: str = 'en'

    def say(self, key: str, **parameters: object) -> str:
        """Return a message in the language of the plan."""
        return say(WORDS, key, self.lang, **parameters)

    def exact_gap(self, gap: Gap) -> str:
        """Return a gap as text, rounded to millimetres."""
        return self.say('broken_gap' if gap.is_broken else 'exact_gap', name=gap.name, gap=gap.gap_m)

    @property
    def origin(self) -> 'Origin | None':
        """The place of the plane's origin, or None if the scene does not state it."""
        return self.scene.origin

    @cached_property
    def swept(self) -> 'SweptArea':
        """The area that the dragon sweeps during the run."""
        from dragon_ros.core.search.swept_area import swept_area
        return swept_area(self.scene)

    @cached_property
    def line(self) -> Floats:
        """The points of the track, from the rear to the front."""
        return compile_scene(self.scene).track_line(1e-3)[::-1]

    @cached_property
    def marks_m(self) -> Floats:
        """Distances (m) along the track of the ten-metre marks that front handles pass."""
        at = self.swept.at_m
        return np.arange(ceil(at[0] / _MARK_M), at[-1] // _MARK_M + 1) * _MARK_M

    @cached_property
    def room_m(self) -> tuple[Floats, Floats]:
        """Positions at every metre of the track, and the room (m) required there to the left and right."""
        from dragon_ros.core.search.swept_area import room_every_metre
        return room_every_metre(self.scene, self.swept)

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """The gaps to obstacles and to the boundary, smallest first."""
        venue = self.scene.venue
        if venue is None:
            return ()
        from shapely import get_coordinates, multilinestrings, polygons, shortest_line

        from dragon_ros.core.batches import states
        from dragon_ros.core.geometry.rectangles import axes_of, benches_of
        from dragon_ros.core.geometry.venue import surroundings_of
        from dragon_ros.core.search.venue_fit import venue_fit
        around, out = surroundings_of(venue), []
        for one in venue_fit(self.scene).gaps:
            chain = states(self.scene, [one.t_s])
            bench = polygons(benches_of(chain, self.scene.dragon, axes_of(chain)).corners.reshape(-1, 4, 2)[one.bench])
            mine = around.owner == around.names.index(one.name)
            ends = np.stack((around.start[mine], around.stop[mine]), axis=1)
            edges = multilinestrings(np.stack((ends.real, ends.imag), axis=-1))
            least_m = max(one.high_m, 0.0)
            out.append(Gap(one.name, least_m, get_coordinates(shortest_line(bench, edges)),
                           one.high_m < venue.margin_m or one.high_m <= 0, least_m - max(one.low_m, 0.0)))
        return tuple(out)

    @cached_property
    def passes_s(self) -> tuple[Floats, Floats]:
        """Times (s) at which head and tail pass the marks, accurate to 1/400 of the run; nan if not passed."""
        from dragon_ros.core.batches import states
        simulation = compile_scene(self.scene)
        run = self.scene.run
        times = np.linspace(run.start_s, simulation.end.t_s, 401)
        chain = states(self.scene, times.tolist())
        at = simulation.model.track.distances(chain.segment, chain.u)
        return _passed(at[:, 0], times, self.marks_m), _passed(at[:, -1], times, self.marks_m)

    @cached_property
    def fastest(self) -> str:
        """A sentence that states the largest speed of any handle."""
        from dragon_ros.core.errors import DragonError
        from dragon_ros.core.search.max_speed import max_speed
        try:
            found = max_speed(self.scene)
        except DragonError:
            return self.say('unbounded')
        peak = getattr(self.scene.head, 'speed_m_s', None)
        if peak is None:
            return self.say('slower', ratio=found.bound)
        return self.say('slower_than', ratio=found.bound, speed=found.bound * abs(peak))


def _passed(at_m: Floats, times_s: Floats, marks_m: Floats) -> Floats:
    """Return, for each mark, the first time (s) at which a handle reaches the mark."""
    out = np.full(marks_m.shape, np.nan)
    for n, mark in enumerate(marks_m.tolist()):
        side = at_m >= mark
        k = int(np.argmax(side != side[0])) if np.any(side != side[0]) else 0
        if k:
            part = (mark - at_m[k - 1]) / (at_m[k] - at_m[k - 1])
            out[n] = times_s[k - 1] + part * (times_s[k] - times_s[k - 1])
        elif at_m[0] == mark:
            out[n] = times_s[0]
    return out


def geojson(plan: Plan) -> str:
    """Return swept area, track and gaps as GeoJSON, in degrees (RFC 7946) or, if the venue has no origin, in metres."""
    from shapely import LineString, normalize, reverse
    from shapely.geometry import mapping
    swept, origin = plan.swept, plan.origin
    drawn: list[tuple[dict[str, Any], Any]] = [
        ({'name': 'swept by the head'}, reverse(normalize(swept.head))),        # outer rings run anticlockwise
        ({'name': 'swept by the body'}, reverse(normalize(swept.body))),
        ({'name': 'track'}, LineString(plan.line))]
    drawn += [({'name': f'gap to {gap.name}', 'gap_m': gap.gap_m}, LineString(gap.ends_m)) for gap in plan.gaps]
    if origin is not None:
        from dragon_ros.scenes.georeference import degrees_of
        drawn = [(properties, degrees_of(shape, origin)) for properties, shape in drawn]
    features = [{'type': 'Feature', 'properties': properties, 'geometry': mapping(shape)}
                for properties, shape in drawn]
    return json.dumps({'type': 'FeatureCollection', **({'units': 'm'} if origin is None else {}),
                       'features': features})


def _sheet(arguments: Namespace, plan: Plan) -> tuple[str, int, Floats]:
    """Return the paper size, the scale and the window to draw (m, shape (2, 2)).

    Raises FieldError for an invalid scale.
    """
    x, y = plan.line.T
    left, bottom, right, top = plan.swept.bounds
    low = np.array((min(left, x.min()), min(bottom, y.min()))) - _AROUND_M
    high = np.array((max(right, x.max()), max(top, y.max()))) + _AROUND_M
    papers = [arguments.paper] if arguments.paper else list(PAPERS_MM)
    if arguments.plan_scale is not None:
        scale = _scale(arguments.plan_scale)
        fitting = (paper for paper in papers if _fits(high - low, paper, scale))
        return next(fitting, papers[-1]), scale, np.array((low, high))
    pairs = [(paper, scale) for scale in SCALES for paper in papers if _fits(high - low, paper, scale)]
    paper, scale = pairs[0] if pairs else (papers[-1], SCALES[-1])
    if scale > _COARSEST:
        counts = {one: int(_grid(high - low, papers[-1], one).prod()) for one in SCALES}
        if counts[_COARSEST] <= _FEW_PAGES:
            paper, scale = papers[-1], next(one for one in SCALES if counts[one] <= counts[_COARSEST])
    return paper, scale, np.array((low, high))


def _scale(text: str) -> int:
    one, _, many = text.partition(':')
    if one.strip() == '1' and many.strip().isdecimal() and SCALES[0] <= int(many) <= SCALES[-1]:
        return int(many)
    raise FieldError('--scale', text, f'scales go from 1:{SCALES[0]} to 1:{SCALES[-1]}', 'write, for example, 1:200')


def _drawn_mm(paper: str) -> Floats:
    """Return the size of the drawing on a page, in mm."""
    return np.array(PAPERS_MM[paper]) - (2 * _EDGE_MM, 2 * _EDGE_MM + _FOOT_MM)


def _fits(size_m: Floats, paper: str, scale: int) -> bool:
    return bool(np.all(_grid(size_m, paper, scale) == 1))


def _grid(size_m: Floats, paper: str, scale: int) -> Ints:
    """Return the numbers of columns and rows of pages for a drawing of a size."""
    out: Ints = np.maximum(1, np.ceil(size_m * 1000 / scale / _drawn_mm(paper) - 1e-9)).astype(int)
    return out


def _windows(plan: Plan, paper: str, scale: int, around: Floats) -> list[tuple[tuple[int, int], Floats]]:
    """Return the row, the column and the window of each page that shows any part of the dragon or its track.

    Raises InputError if there are too many pages.
    """
    from shapely import LineString, box, prepare
    page_m = _drawn_mm(paper) * scale / 1000
    columns, rows = _grid(around[1] - around[0], paper, scale).tolist()
    _check_count(max(columns, rows), paper, scale)      # the drawing is connected, so it takes at least this many pages
    begin = around.mean(axis=0) - 0.5 * page_m * (columns, rows)
    shown = plan.swept.whole.union(LineString(plan.line))
    prepare(shown)
    out = []
    for row, column in np.ndindex(rows, columns):
        low = begin + page_m * (column, rows - 1 - row)
        if shown.intersects(box(*low, *(low + page_m))):
            out.append(((row + 1, column + 1), np.array((low, low + page_m))))
    _check_count(len(out), paper, scale)
    return out


def _check_count(pages: int, paper: str, scale: int) -> None:
    if pages > _MOST_PAGES:
        larger = '' if paper == _LARGEST else f', or --paper {_LARGEST}'
        raise InputError(f'--scale 1:{scale}: the drawing takes at least {pages} pages of {paper}, and the limit is '
                         f'{_MOST_PAGES}; give a smaller scale{larger}', field='scale')


def _pages(plan: Plan, paper: str, scale: int, around: Floats) -> tuple[int, Iterator['Figure']]:
    """Return the number of pages, and the pages: first the drawing, then the tables."""
    windows = _windows(plan, paper, scale, around)
    tables = _tables(plan)
    total = len(windows) + len(tables)

    def drawn() -> Iterator['Figure']:
        for n, ((row, column), window) in enumerate(windows, 1):
            place = plan.say('page_at', row=row, column=column) if len(windows) > 1 else ''
            yield _drawing(plan, paper, scale, window, (n, total), place)
        for n, rows in enumerate(tables, len(windows) + 1):
            yield _table(plan, paper, rows, (n, total))
    return total, drawn()


def _page(plan: Plan, paper: str, number: tuple[int, int], title: str, place: str = '') -> 'Figure':
    """Return a page that contains only its title, its date and its number; ``place`` names its row and column."""
    from matplotlib.figure import Figure
    width, height = PAPERS_MM[paper]
    figure = Figure(figsize=(width / 25.4, height / 25.4))
    figure.set_layout_engine('none')
    top, (n, total) = (_FOOT_MM + 3) / height, number
    note = plan.say('page', day=date.today().isoformat(), paper=paper, n=n, total=total, version=__version__) + place
    figure.text(_EDGE_MM / width, top, title, fontsize=13, weight='bold', va='top')
    figure.text(1 - _EDGE_MM / width, top, note, ha='right', va='top', fontsize=_TEXT_PT)
    return figure


def _drawing(plan: Plan, paper: str, scale: int, window: Floats, number: tuple[int, int],
             place: str = '') -> 'Figure':
    """Return a page with the part of the drawing that is inside a window (m, shape (2, 2))."""
    width, height = PAPERS_MM[paper]
    figure = _page(plan, paper, number, plan.say('plan', title=plan.title, scale=scale), place)
    size = _drawn_mm(paper)
    axes = figure.add_axes((_EDGE_MM / width, (_EDGE_MM + _FOOT_MM) / height, size[0] / width, size[1] / height))
    axes.set(xlim=window[:, 0], ylim=window[:, 1], xticks=[], yticks=[])
    axes.grid(False)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(True)
    _draw_venue(axes, plan, window)
    for area, colour, name, hatch in ((plan.swept.body, BODY, 'body', None), (plan.swept.head, HEAD, 'head', HATCH)):
        _fill(axes, area, facecolor=colour, edgecolor=colour, alpha=0.45, linewidth=0.4, hatch=hatch,
              label=plan.say(name), zorder=2)
    axes.plot(*plan.line.T, color='black', linewidth=0.7, linestyle=_CENTRE_LINE, zorder=3, label=plan.say('track'))
    labels = _draw_marks(axes, plan, window)
    marks, _ = _poses(plan, plan.marks_m)
    points = axes.transData.transform(np.concatenate((marks, _followed(plan, window)))) * 72 / figure.dpi
    taken = [*labels, *((at, float(_TEXT_PT)) for at in points)]
    _draw_gaps(axes, plan, window, taken)
    _draw_room(axes, plan, window, taken)
    _bar(figure, paper, scale)
    axes.legend(loc='upper right', fontsize=_TEXT_PT, frameon=True, framealpha=0.9)
    figure.text(_EDGE_MM / width, (_FOOT_MM - 6) / height, _said(plan), fontsize=_TEXT_PT, va='top', wrap=False)
    return figure


def _said(plan: Plan) -> str:
    """Return the text that states what is proved and what is not."""
    venue, first = plan.scene.venue, plan.say('proved', fastest=plan.fastest)
    last = plan.say('people')
    if venue is not None:
        within_mm = 1000 * max(gap.within_m for gap in plan.gaps)
        first = plan.say('proved_gaps', fastest=plan.fastest, within=within_mm)
        last += ('' if plan.lang == 'zh' else ' ') + plan.say('margin', margin=venue.margin_m)
    return '\n'.join((first, plan.say('sampled', step=100 * plan.swept.step_m), last))


def _fill(axes: 'Axes', area: Any, **style: Any) -> None:
    """Fill polygons except for their holes."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline
    label = style.pop('label', None)
    for part in getattr(area, 'geoms', [area]):
        rings = [Outline(np.array(ring.coords), closed=True) for ring in (part.exterior, *part.interiors)]
        add_lines(axes, PathPatch(Outline.make_compound_path(*rings), label=label, **style))
        label = None


def _draw_venue(axes: 'Axes', plan: Plan, window: Floats) -> None:
    from shapely import Polygon, box
    venue = plan.scene.venue
    if venue is None:
        return
    label: str | None = plan.say('obstacles')
    for one in venue.obstacles:
        if hasattr(one, 'holes_m'):
            _fill(axes, Polygon(one.points_m, one.holes_m), facecolor=OBSTACLE, edgecolor=QUIET, linewidth=0.8,
                  hatch=_OBSTACLE_HATCH, zorder=1, label=label)
        else:
            axes.plot(*np.array(one.points_m).T, color=QUIET, linewidth=1.6, zorder=1, label=label)
        label = None
    if venue.inside is not None:
        outside = box(*window[0], *window[1]).difference(Polygon(venue.inside))
        if not outside.is_empty:
            _fill(axes, outside, facecolor=OBSTACLE, edgecolor=QUIET, linewidth=0.8, zorder=0.9)


def _seen(at: Floats, window: Floats) -> bool:
    return bool(np.all(at >= window[0]) and np.all(at <= window[1]))


def _poses(plan: Plan, along_m: Floats) -> tuple[Floats, Floats]:
    """Return the points and the headings, each an array (n, 2), at n distances along the track."""
    track = compile_scene(plan.scene).model.track
    return track.poses(*track.places_at(along_m, np.zeros_like(along_m)))


def _draw_marks(axes: 'Axes', plan: Plan, window: Floats) -> list[tuple[Floats, float]]:
    """Draw a mark every ten metres, and label it with its distance, on a side of the track that has no other label.

    Return the positions of the labels and half their widths, in points.
    """
    points, headings = _poses(plan, plan.marks_m)
    seen = [n for n, at in enumerate(points) if _seen(at, window)]
    places = np.asarray(axes.transData.transform(points[seen])).reshape(-1, 2) * 72 / axes.figure.dpi
    labels = [f'{mark:g}' for mark in plan.marks_m[seen].tolist()]
    offsets = mark_offsets(places, headings[seen], labels)
    for at, label, offset in zip(points[seen], labels, offsets, strict=True):
        axes.plot(*at, marker='o', markersize=2.6, color='black', zorder=4)
        axes.annotate(label, at, xytext=offset, textcoords='offset points', fontsize=_TEXT_PT, ha='center', va='center',
                      zorder=5)
    return [(place + offset, 0.5 * _WIDE * _TEXT_PT * len(label))
            for place, offset, label in zip(places, offsets, labels, strict=True)]


def mark_offsets(places: Floats, headings: Floats, labels: list[str]) -> list[tuple[float, float]]:
    """Return label offsets (in points) from marks at n places: to the left or, if that side is occupied, to the right.

    If both sides are occupied, a label is placed further out.
    """
    out, marks = list[tuple[float, float]](), len(labels)
    taken = np.zeros((2 * marks, 3))        # the centres of marks and labels, and half their widths
    taken[:marks, :2], taken[:marks, 2] = places, 2.0
    for n, (here, (x, y), label) in enumerate(zip(places.tolist(), headings.tolist(), labels, strict=True)):
        half = 0.5 * _WIDE * _TEXT_PT * len(label)
        away = [side * (radius + (half - 4.0) * abs(y)) for radius in (9.0, 20.0, 32.0) for side in (1, -1)]
        for far in away:
            offset = -far * y, far * x
            spot = here[0] + offset[0], here[1] + offset[1]
            across, level, wide = taken[:marks + n].T
            hidden = (np.abs(across - spot[0]) <= half + wide) & (np.abs(level - spot[1]) <= 1.2 * _TEXT_PT)
            hidden[n] = False       # its own mark
            if not hidden.any():
                break
        else:
            offset = -away[0] * y, away[0] * x
        taken[marks + n] = here[0] + offset[0], here[1] + offset[1], half
        out.append(offset)
    return out


def _draw_gaps(axes: 'Axes', plan: Plan, window: Floats, taken: list[tuple[Floats, float]]) -> None:
    """Draw the smallest gaps as dimension lines; gaps below the margin are red and marked as too small."""
    for gap in plan.gaps:
        middle = gap.ends_m.mean(axis=0)
        if not _seen(middle, window):
            continue
        colour = _BROKEN if gap.is_broken else 'black'
        axes.annotate('', gap.ends_m[0], gap.ends_m[1], zorder=6, arrowprops={
            'arrowstyle': '<->', 'color': colour, 'linewidth': 0.9, 'shrinkA': 0, 'shrinkB': 0, 'mutation_scale': 6})
        label = plan.say('drawn_broken_gap' if gap.is_broken else 'gap', name=gap.name, gap=gap.gap_m)
        offset = _free_offset(axes, middle, label, taken)
        axes.annotate(label, middle, xytext=offset, textcoords='offset points', fontsize=_TEXT_PT, color=colour,
                      ha='center', va='center', zorder=8,
                      bbox={'boxstyle': 'round,pad=0.2', 'facecolor': 'white', 'edgecolor': colour, 'linewidth': 0.5},
                      arrowprops={'arrowstyle': '-', 'color': colour, 'linewidth': 0.5})


def _followed(plan: Plan, window: Floats) -> Floats:
    """Return points (m, shape (M, 2)) every metre along the track inside a window."""
    points, _ = _poses(plan, plan.room_m[0])
    return points[np.all((points > window[0]) & (points < window[1]), axis=1)]


def _free_offset(axes: 'Axes', at: Floats, label: str, taken: list[tuple[Floats, float]]) -> tuple[float, float]:
    """Return the offset (in points) at which a label overlaps fewest labels and points of the track."""
    scale = axes.figure.dpi / 72
    here = np.asarray(axes.transData.transform(at)) / scale
    half = 0.5 * _WIDE * _TEXT_PT * len(label)
    ring = [(radius * np.cos(angle), radius * np.sin(angle)) for radius in (30, 55, 80, 110, 150)
            for angle in np.radians([-60, 60, -120, 120, 0, 180, -90, 90])]
    offsets = [(x + (np.copysign(0.6 * half, x) if abs(x) > 1 else 0.0), y) for x, y in ring]
    middles, wide = np.array([middle for middle, _ in taken]) - here, half + np.array([one for _, one in taken])
    overlaps = [np.sum((np.abs(middles[:, 0] - x) <= wide) & (np.abs(middles[:, 1] - y) <= 2 * _TEXT_PT))
                for x, y in offsets]
    x, y = offsets[int(np.argmin(overlaps))]        # the nearest of the best
    taken.append((here + np.array((x, y)), half))
    return float(x), float(y)


def _widest(plan: Plan) -> list[tuple[float, float, float]]:
    """Return the distances along the track at which the most room is required, with the room to the left and right."""
    stations, room = plan.room_m
    out: list[tuple[float, float, float]] = []
    for n in np.argsort(-room.sum(axis=1), kind='stable').tolist():
        if room[n].sum() < room.min(axis=0).sum() + _NEARLY_M:      # hardly more room than on a straight line
            break
        if all(abs(stations[n] - at) > _MARK_M for at, *_ in out):
            out.append((float(stations[n]), float(room[n, 0]), float(room[n, 1])))
        if len(out) == _NARROWEST:
            break
    return out


def _draw_room(axes: 'Axes', plan: Plan, window: Floats, taken: list[tuple[Floats, float]]) -> None:
    """Draw the required room at the positions where it is largest."""
    for at_m, left, right in _widest(plan):
        points, headings = _poses(plan, np.array([at_m]))
        normal = np.array((-headings[0, 1], headings[0, 0]))
        if _seen(points[0], window):
            ends = np.stack((points[0] + left * normal, points[0] - right * normal))
            axes.plot(*ends.T, color='black', linewidth=1.4, zorder=5)
            label = plan.say('room', room=left + right)
            axes.annotate(label, points[0], xytext=_free_offset(axes, points[0], label, taken),
                          textcoords='offset points', fontsize=_TEXT_PT, ha='center', va='center', zorder=7,
                          bbox={'boxstyle': 'round,pad=0.1', 'facecolor': 'white', 'edgecolor': 'none'},
                          arrowprops={'arrowstyle': '-', 'color': QUIET, 'linewidth': 0.5})


def _bar(figure: 'Figure', paper: str, scale: int) -> None:
    """Draw a scale bar about five centimetres long, below the drawing on the right."""
    width, height = PAPERS_MM[paper]
    length_m = max((m for m in (1, 2, 5, 10, 20, 50) if m * 1000 / scale <= 52), default=1)
    long = length_m * 1000 / scale
    axes = figure.add_axes((1 - (_EDGE_MM + long + 12) / width, 12 / height, long / width, 2.5 / height))
    axes.set(xlim=(0, length_m), ylim=(0, 1), yticks=[], xticks=[0, length_m / 2, length_m])
    axes.set_xticklabels(['0', f'{length_m / 2:g}', f'{length_m:g} m'], fontsize=_TEXT_PT)
    axes.grid(False)
    axes.axvspan(0, length_m / 2, color='black')
    for side in ('top', 'right'):
        axes.spines[side].set_visible(True)


def _tables(plan: Plan) -> list[list[tuple[str, ...]]]:
    """Return the rows of the tables, page by page."""
    head, tail = plan.passes_s
    passes = zip(plan.marks_m, head, tail, strict=True)
    rows: list[tuple[str, ...]] = [(f'{mark:g}', _time(a), _time(b)) for mark, a, b in passes]
    return [rows[first:first + 4 * _ROWS] for first in range(0, len(rows), 4 * _ROWS)] or [[]]


def _time(t_s: float) -> str:
    return '' if np.isnan(t_s) else f'{int(round(t_s, 1) // 60)}:{round(t_s, 1) % 60:04.1f}'


def _table(plan: Plan, paper: str, rows: list[tuple[str, ...]], number: tuple[int, int]) -> 'Figure':
    """Return a page with the times at which head and tail pass each mark, the gaps and the room."""
    width, height = PAPERS_MM[paper]
    figure = _page(plan, paper, number, plan.say('tables', title=plan.title))
    x, top, line = _EDGE_MM + 2, height - _EDGE_MM - 4, 4.3
    for first in range(0, len(rows), _ROWS):
        block = [(plan.say('mark'), plan.say('head_at'), plan.say('tail_at')), *rows[first:first + _ROWS]]
        for n, row in enumerate(block):
            for k, cell in enumerate(row):
                figure.text((x + 16 + 24 * k) / width, (top - line * n) / height, cell, fontsize=_TEXT_PT, ha='right',
                            weight='bold' if n == 0 else 'normal')
        x += 72
    texts = [(plan.say('gaps'), 'black')] + [(plan.exact_gap(gap), _BROKEN if gap.is_broken else 'black')
                                             for gap in plan.gaps[:_ROWS - 8]]
    texts += [('', 'black'), (plan.say('most_room'), 'black')] + [
        (plan.say('room_at', at=at, left=left, right=right), 'black') for at, left, right in _widest(plan)]
    for n, (text, colour) in enumerate(texts):
        figure.text((x + 4) / width, (top - line * n) / height, text, fontsize=_TEXT_PT, color=colour)
    figure.text(_EDGE_MM / width, (_FOOT_MM - 6) / height, _said(plan), fontsize=_TEXT_PT, va='top')
    return figure


def _write_pages(path: Path, total: int, pages: Iterable['Figure']) -> None:
    from io import BytesIO

    from matplotlib.backends.backend_pdf import PdfPages
    with BytesIO() as file:     # on a full disk, zlib would raise its own error
        with PdfPages(file, metadata={'CreationDate': None}) as pdf:
            for page in Progress('plan', 'pages', total)(pages):
                pdf.savefig(page)
        command_line.write_output(path, file.getvalue())
