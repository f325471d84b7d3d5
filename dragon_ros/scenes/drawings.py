"""Read the line that a dragon follows from a drawing (SVG, a map or CSV), as parts in metres, with y upwards.

svgelements interprets SVG paths, shapes, transforms, units and viewBox. It receives only the chosen element and its
groups. The parser rejects files that are too large, are nested too deeply or declare entities.
"""
import csv
import io
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, cos, isfinite, radians
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from dragon_ros.core.errors import FieldError, InputError, MissingError, did_you_mean, shown
from dragon_ros.core.limits import DRAWING_BYTES, DRAWING_POINTS, XML_ELEMENTS
from dragon_ros.core.numerics.types import Complexes
from dragon_ros.core.tracks.drawn import Cubic, DrawnPart, EllipseArc
from dragon_ros.core.venue import Origin
from dragon_ros.core.words import counted
from dragon_ros.scenes.georeference import DEGREES, own_origin, placed
from dragon_ros.scenes.maps import Drawing, check_unit
from dragon_ros.scenes.xml import tree

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_SVG = '{http://www.w3.org/2000/svg}'
_LABEL = '{http://www.inkscape.org/namespaces/inkscape}label'
_SHAPES = ('path', 'polyline', 'line', 'polygon', 'rect', 'circle', 'ellipse')
_AROUND = ('svg', 'g', 'a', 'switch')     # containers whose contents are drawn in place
_PX_M = 0.0254 / 96     # in CSS, a pixel is a 96th of an inch
_MOST_LISTED = 12
_COLUMNS = ((('x_m', 'y_m'), 1.0), (('x', 'y'), None), (('lon', 'lat'), 'deg'), (('lng', 'lat'), 'deg'),
            (('longitude', 'latitude'), 'deg'))
_SIZE = re.compile(r'\s*(\d{1,20}(?:\.\d{0,20})?|\.\d{1,20})\s*(mm|cm|in|pt|pc)\s*')
_MM = {'mm': 1.0, 'cm': 10.0, 'in': 25.4, 'pt': 25.4 / 72, 'pc': 25.4 / 6}
_JOINED = 1e-9          # relative to the coordinates; ends closer than this are joined
_SCALE = re.compile(r'1\s*:\s*(\d+(?:\.\d*)?)')
_FLOAT = re.compile(r'[-+]?(?:\d{1,30}(?:\.\d{0,30})?|\.\d{1,30})(?:[eE][-+]?\d{1,4})?')
_TRANSFORM = re.compile(r'(matrix|translate|scale|rotate|skewX|skewY)\s*\(([^()]{0,400})\)')
_BETWEEN = re.compile(r'[\s,]*')
_ARGUMENTS = {'matrix': (6,), 'translate': (1, 2), 'scale': (1, 2), 'rotate': (1, 3), 'skewX': (1,), 'skewY': (1,)}
_LENGTHS = ('width', 'height', 'r', 'rx', 'ry')
METRES = 'metres of the SVG: '      # precedes a to f in the description: x = a u + c v + e, y = b u + d v + f
_NUMBER = r'[-+0-9.eE]{1,30}'
_METRES = re.compile(METRES + r'matrix\((' + ', '.join([_NUMBER] * 6) + r')\)')
# Errors that svgelements raises for invalid drawings.
_FAILS = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, RecursionError)


@dataclass(frozen=True)
class DrawnLine:
    """A line in a drawing: its name, and its parts in metres; each part starts where the previous one ends."""

    name: str
    parts: tuple[DrawnPart, ...]

    def turned_round(self) -> 'DrawnLine':
        """Return the line in the opposite direction."""
        return DrawnLine(self.name, tuple(_turned_round(part) for part in reversed(self.parts)))


@dataclass(frozen=True)
class MapLine:
    """A line in the coordinates of its file: a shapely line, its reference system (None: metres), and notes."""

    path: Path
    name: str
    geometry: Any
    crs: str | None
    notes: tuple[str, ...] = ()

    def own_origin(self) -> Origin | None:
        """Return the middle of the line, or None if its coordinates are metres of the scene."""
        return own_origin(str(self.path), [self.geometry], self.crs)

    def placed(self, origin: Origin | None) -> DrawnLine:
        """Return the line in metres of the scene's plane. Raises InputError."""
        from shapely import get_coordinates
        x, y = get_coordinates(placed(str(self.path), [self.geometry], self.crs, origin)[0]).T
        return DrawnLine(self.name, (x + 1j * y,))


def _turned_round(part: DrawnPart) -> DrawnPart:
    if isinstance(part, Cubic):
        a, b, c, d = part.controls
        return Cubic((d, c, b, a))
    if isinstance(part, EllipseArc):
        return part._replace(start_rad=part.start_rad + part.sweep_rad, sweep_rad=-part.sweep_rad)
    return part[::-1]


def metres_a_unit(scale: str | None, unit_m: float | None) -> tuple[float, bool] | None:
    """Return metres per unit, and whether the unit is a metre on paper, or None if neither scale nor unit is given.

    Raises FieldError.
    """
    if scale is not None and unit_m is not None:
        raise FieldError('--unit', unit_m, f'it conflicts with --scale {scale}', 'give only one of them')
    if scale is None:
        return None if unit_m is None else (unit_m, False)
    found = _SCALE.fullmatch(scale.strip())
    if not found or not float(found[1]) > 0:
        raise FieldError('--scale', scale, 'a scale has the form 1:N', 'write for example 1:200')
    return float(found[1]), True


def bytes_of(path: Path) -> bytes:
    """Return the bytes of a drawing; its size is limited. Raises MissingError or InputError."""
    try:
        with path.open('rb') as file:
            data = file.read(DRAWING_BYTES + 1)
    except (OSError, ValueError) as error:
        raise MissingError(f'{shown(str(path))[1:-1]}: cannot be read: {getattr(error, "strerror", error)}') from None
    if len(data) > DRAWING_BYTES:
        raise InputError(f'{path}: the file is too large; the limit is {DRAWING_BYTES} bytes')
    return data


def chosen(path: Path, what: str, names: list[str], asked: str | None, option: str = '--path') -> int:
    """Return the index of the requested line in a drawing. Raises an InputError that lists the lines."""
    if asked is not None and asked in names:
        return names.index(asked)
    if asked is None and len(names) == 1:
        return 0
    if not names:
        raise InputError(f'{path}: it contains no {what}; draw the line that the head follows', field='path')
    listed = ', '.join(shown(name)[1:-1] for name in names[:_MOST_LISTED])
    listed += f' and {len(names) - _MOST_LISTED} more' if len(names) > _MOST_LISTED else ''
    if asked is None:
        raise InputError(f'{path}: it contains {len(names)} {what}s ({listed}); choose one, for example {option} '
                         f'{shown(names[0])[1:-1]}', field='path')
    raise InputError(f'{path}: it contains no {option} {shown(asked)}; '
                     f'{did_you_mean(asked, names, f"its {what}s are {listed}")}', field='path')


# CSV

def csv_line(path: Path, unit: float | str | None) -> MapLine:
    """Return the points of a CSV file from its columns x and y, x_m and y_m, or lon and lat, or the first two columns.

    ``unit`` is in metres, or 'deg' for longitude and latitude. Without a unit, x and y are metres.
    """
    text = _text(path, bytes_of(path))
    try:
        rows = [(number, row) for number, row in enumerate(csv.reader(io.StringIO(text), _dialect(text)), 1)
                if any(cell.strip() for cell in row) and not row[0].lstrip().startswith('#')]
    except csv.Error as error:
        raise InputError(f'{path}: it is not CSV: {error}') from None
    if len(rows) > DRAWING_POINTS + 1:
        raise InputError(f'{path}: it has {len(rows)} rows; the limit is {DRAWING_POINTS} points')
    columns, stated = (0, 1), None
    if rows and not _is_number(rows[0][1][0]):
        columns, stated = _columns(path, rows.pop(0)[1])
    if stated and unit not in (None, stated):
        raise InputError(f'{path}: its columns are {"degrees" if stated == "deg" else "metres"}; omit --unit '
                         f'{unit}', field='unit')
    points = [_point(path, number, row, columns) for number, row in rows]
    if len(points) < 2:
        raise InputError(f'{path}: it has {counted(len(points), "point")}; a line needs at least 2')
    return _csv_line(path, np.array(points), unit or stated)


def _csv_line(path: Path, points: Complexes, unit: float | str | None) -> MapLine:
    from shapely import LineString
    scale = unit if isinstance(unit, float) else 1.0
    line = LineString(np.stack((points.real, points.imag), axis=1) * scale)
    if unit is None:
        check_unit(path, [line], 'give --unit deg or --unit 1, or name the columns lon and lat, or x_m and y_m')
    return MapLine(path, path.name, line, DEGREES if unit == 'deg' else None)


def _text(path: Path, data: bytes) -> str:
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        raise InputError(f'{path}: it is not UTF-8 text; save it as UTF-8') from None


def _dialect(text: str) -> type[csv.Dialect]:
    """Return a dialect with the delimiter of the first data line: semicolon, tab, comma or spaces."""
    head = next((line for line in text.splitlines() if line.strip() and not line.lstrip().startswith('#')), '')

    class Dialect(csv.excel):
        delimiter = next((sign for sign in ';\t,' if sign in head), ' ')
        skipinitialspace = True
    return Dialect


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _columns(path: Path, head: list[str]) -> tuple[tuple[int, int], float | str | None]:
    """Return the columns of the coordinates, and their unit if the names state it."""
    names = [cell.strip().lower() for cell in head]
    for pair, unit in _COLUMNS:
        if all(name in names for name in pair):
            return (names.index(pair[0]), names.index(pair[1])), unit
    raise InputError(f'{path}: its columns are {shown(", ".join(names))[1:-1]}; name the coordinate columns x and y '
                     '(in metres), or lon and lat')


def _point(path: Path, number: int, row: list[str], columns: tuple[int, int]) -> complex:
    try:
        point = complex(*(float(row[column]) for column in columns))
    except (ValueError, IndexError):
        raise InputError(f'{path}:{number}: {shown(",".join(row))[1:-1]} is not two numbers; give x and y') from None
    return _within(path, point)


def _within(path: Path, point: complex) -> complex:
    if not abs(point) < 1e9:
        why = 'too far away; the limit is 1e9 m' if isfinite(abs(point)) else 'not finite; draw that point again'
        raise InputError(f'{path}: a point at ({point.real:g}, {point.imag:g}) is {why}')
    return point


# Maps

def map_line(drawing: Drawing, asked: str | None) -> MapLine:
    """Return a line of a map, chosen by its name, by ``#2`` (the second) or, if a name is repeated, by ``name#2``.

    Lines of one name that meet end to end are joined. Raises InputError if they do not meet, or the choice is open.
    """
    features = [one for one in drawing.features if is_line(one.geometry)]
    names = [one.name or f'#{number}' for number, one in enumerate(features, 1)]
    groups = dict[str, list[Any]]()
    for name, one in zip(names, features, strict=True):
        groups.setdefault(name, []).extend(getattr(one.geometry, 'geoms', [one.geometry]))
    if asked is not None and asked not in groups:
        name, sign, number = asked.rpartition('#')
        parts = [one.geometry for one in features] if not name else _different(groups.get(name, []))
        if sign and number.isdecimal() and 1 <= int(number) <= len(parts):
            one = parts[int(number) - 1]
            return _joined(drawing, asked, [*getattr(one, 'geoms', [one])])
    known = list(groups)
    name = known[chosen(drawing.path, 'line', known, asked)]
    return _joined(drawing, name, groups[name])


def is_line(geometry: Any) -> bool:
    """Return whether a geometry consists of lines only."""
    parts = getattr(geometry, 'geoms', [geometry])
    return len(parts) > 0 and all(part.geom_type in ('LineString', 'LinearRing') for part in parts)


def _different(lines: list[Any]) -> list[Any]:
    """Return lines without repetitions."""
    return [one for n, one in enumerate(lines) if not any(one.equals(other) for other in lines[:n])]


def _joined(drawing: Drawing, name: str, lines: list[Any]) -> MapLine:
    """Return lines that meet as one line, in the direction of the first."""
    kept = _different(lines)
    notes = [f'{counted(len(lines) - len(kept), "repeated line", "was")} left out'] if len(kept) < len(lines) else []
    whole = kept[0] if len(kept) == 1 else _merged(kept)
    if whole is None:
        raise InputError(_parts_message(drawing, name, kept), field='path')
    if len(kept) > 1:
        notes.append(f'joined from {len(kept)} lines that meet')
    points = len(whole.coords)
    if points > DRAWING_POINTS:
        raise InputError(f'{drawing.path}: it has {points} points; the limit is {DRAWING_POINTS}')
    return MapLine(drawing.path, name, whole, drawing.crs, tuple(notes))


def _merged(lines: list[Any]) -> Any:
    """Return the line through lines that meet end to end, each once; None if there is no such line."""
    from shapely import LineString, MultiLineString, line_merge
    whole = line_merge(MultiLineString(lines))
    if whole.geom_type != 'LineString':
        return None
    first = LineString(lines[0].coords)
    begin, end = (whole.project(first.interpolate(share, normalized=True)) for share in (0.25, 0.75))
    whole = whole if begin <= end else whole.reverse()
    points = [*whole.coords]
    if whole.is_closed and first.coords[0] in points:
        at = points.index(first.coords[0])
        whole = LineString([*points[at:-1], *points[:at + 1]])
    return whole


def _parts_message(drawing: Drawing, name: str, lines: list[Any]) -> str:
    where = str(drawing.path)
    metres = placed(where, lines, drawing.crs, own_origin(where, lines, drawing.crs))
    listed = ', '.join(f'{name}#{n} ({one.length:.0f} m)' for n, one in enumerate(metres[:_MOST_LISTED], 1))
    more = f' and {len(lines) - _MOST_LISTED} more' if len(lines) > _MOST_LISTED else ''
    return (f'{where}: {shown(name)} consists of {len(lines)} lines that do not meet end to end: {listed}{more}; '
            f'choose one, for example --path {shown(f"{name}#1")}, or join them in the map')


# SVG

def svg_line(path: Path, asked: str | None, scale: tuple[float, bool] | None) -> DrawnLine:
    """Return a path of an SVG file, chosen by id or Inkscape label; the lower left corner of the page is (0, 0).

    ``scale`` is in metres per unit of the viewBox, or per metre on paper. It must be None for pictures that define
    their own scale, such as those of ``plot``.
    """
    root = tree(path, bytes_of(path), 'SVG', XML_ELEMENTS)
    shapes = list(_shapes(root, [root]))
    names = _unique([_name(number, *shape) for number, shape in enumerate(shapes, 1)])
    wanted = _id_of(shapes, names, asked)
    if wanted is not None and wanted not in names and f'{wanted}#1' in names:
        count = sum(name.rpartition('#')[0] == wanted for name in names)
        raise InputError(f'{path}: {count} paths have the id {shown(wanted)}; choose one, for example --path '
                         f'{shown(f"{wanted}#1")}, or give them different ids', field='path')
    at = chosen(path, 'path', names, wanted)
    matrix = _metres_of(root)
    if matrix is None and scale is None:
        raise InputError(f'{path}: it defines no scale; give --scale 1:200 (of the drawing on paper), or '
                         '--unit with the metres per unit of the drawing', field='scale')
    if matrix is not None and scale is not None:
        raise InputError(f'{path}: it defines its own scale; omit --scale and --unit', field='scale')
    if scale is not None and scale[1] and not all(_SIZE.fullmatch(root.get(key, '')) for key in ('width', 'height')):
        raise InputError(f'{path}: it does not state the size of its page (width and height in mm, cm or in), so '
                         '--scale has no meaning; give --unit with the metres per unit of the drawing', field='scale')
    for element in (*shapes[at][0], shapes[at][1]):
        _check_element(path, element)
    return DrawnLine(names[at], tuple(_parts(path, *_read(path, *shapes[at]), matrix, scale)))


def _unique(names: list[str]) -> list[str]:
    """Return names; repeated ones are numbered: ``way#1``, ``way#2``."""
    many = {name: counts for name, counts in Counter(names).items() if counts > 1}
    seen = Counter[str]()
    out = []
    for name in names:
        seen[name] += 1
        out.append(f'{name}#{seen[name]}' if name in many else name)
    return out


def _check_element(path: Path, element: 'Element') -> None:
    """Raise InputError for transforms and sizes that svgelements would ignore or mirror."""
    label = f'{path}: {shown(element.get("id") or _kind(element))}'
    if 'transform' in element.get('style', '') or 'transform-origin' in element.attrib:
        raise InputError(f'{label}: transforms in styles are not supported; save it as plain SVG')
    text = element.get('transform', '')
    given = _TRANSFORM.findall(text)
    if not all(map(_BETWEEN.fullmatch, (_TRANSFORM.sub('', text), *(_FLOAT.sub('', one) for _, one in given)))):
        raise InputError(f'{label}: its transform {shown(text)} is not valid; reset it, or save it as plain SVG')
    for name, numbers in given:
        _check_transform(label, name, [float(one) for one in _FLOAT.findall(numbers)])
    sizes = [one for key in _LENGTHS for one in [element.get(key)] if one is not None]
    sizes += re.split(r'[\s,]+', element.get('viewBox', '').strip())[2:]
    if any(found and float(found[0]) < 0 for found in map(_FLOAT.match, map(str.strip, sizes))):
        raise InputError(f'{label}: a size is negative; draw it with positive sizes')


def _check_transform(label: str, name: str, numbers: list[float]) -> None:
    """Raise InputError for a wrong number of arguments, or a transform that flattens the drawing."""
    if len(numbers) not in _ARGUMENTS[name] or not all(map(isfinite, numbers)):
        raise InputError(f'{label}: its transform {name} has the arguments {numbers}; reset it')
    if name == 'matrix':
        area = numbers[0] * numbers[3] - numbers[1] * numbers[2]
    elif name == 'scale':
        area = numbers[0] * numbers[-1]
    else:
        area = cos(radians(numbers[0])) if name.startswith('skew') else 1.0
    if not 1e-15 < abs(area) < 1e15:
        raise InputError(f'{label}: its transform {name} flattens the drawing; reset it')


def _id_of(shapes: list[tuple[list['Element'], 'Element']], names: list[str], asked: str | None) -> str | None:
    """Return the id of the only path labelled ``asked`` if no path has that id; otherwise return ``asked``."""
    labelled = [name for name, shape in zip(names, shapes, strict=True) if asked in _said(*shape, _LABEL)]
    return labelled[0] if asked is not None and asked not in names and len(labelled) == 1 else asked


def _name(number: int, above: list['Element'], element: 'Element') -> str:
    """Return the id of a shape, or of a group that contains nothing else; if there is none, the shape's number."""
    return next(iter(_said(above, element, 'id')), f'#{number}')


def _said(above: list['Element'], element: 'Element', key: str) -> list[str]:
    """Return the values of an attribute of a shape, and of its group if the group contains nothing else."""
    return [value for one in (element, *(above[-1:] if len(above[-1]) == 1 else [])) if (value := one.get(key))]


def _kind(element: 'Element') -> str:
    return str(element.tag).removeprefix(_SVG)


def _shapes(element: 'Element', above: list['Element']) -> Iterator[tuple[list['Element'], 'Element']]:
    """Yield each drawn shape with its ancestors, root first."""
    for below in element:
        kind = _kind(below)
        if kind in _SHAPES:
            yield above, below
        elif kind in _AROUND:
            yield from _shapes(below, [*above, below])


def _metres_of(root: 'Element') -> tuple[float, ...] | None:
    """Return the matrix from user units to metres in a picture's description; None if there is no valid matrix."""
    for element in root.iter():
        found = _METRES.search(element.text or '')
        if found:
            try:
                numbers = tuple(map(float, found[1].split(', ')))
            except ValueError:
                return None
            a, b, c, d = numbers[:4]
            return numbers if 0 < abs(a * d - b * c) < 1e12 and all(abs(one) < 1e9 for one in numbers) else None
    return None


def _read(path: Path, above: list['Element'], element: 'Element') -> tuple[Any, Any]:
    """Return the svgelements document of one shape within its groups, and the shape."""
    if len(element.get('d', '') + element.get('points', '')) > DRAWING_BYTES // 4:
        raise InputError(f'{path}: {shown(element.get("id"))}: its path is too long; the limit is '
                         f'{DRAWING_BYTES // 4} characters; split it')
    try:
        from svgelements import SVG, Shape
        from svgelements import Path as SvgPath
    except ImportError:
        raise MissingError(f"{path}: reading SVG requires svgelements; pip install 'dragon_ros[svg]' or pip "
                           'install svgelements') from None
    copies = [_copy(one) for one in (*above, element)]
    _size_in_pixels(copies[0])
    for outer, inner in pairwise(copies):
        outer.append(inner)
    try:
        document = SVG.parse(io.BytesIO(ElementTree.tostring(copies[0])), parse_display_none=True, on_error='raise')
        found = [one for one in document.elements() if isinstance(one, Shape)]
        shape = SvgPath(found[0]) if found else None
    except _FAILS as error:
        raise InputError(f'{path}: {shown(element.get("id") or _kind(element))}: cannot be read'
                         f'{f": {shown(str(error))[1:-1]}" if str(error) else ""}; check its numbers') from None
    if shape is None or len(shape) < 2:
        raise InputError(f'{path}: {shown(element.get("id") or _kind(element))}: it has no length; choose another path')
    return document, shape


def _copy(element: 'Element') -> 'Element':
    """Return an element without its children, its class, or attributes from other namespaces."""
    kept = {key: value for key, value in element.attrib.items() if not key.startswith('{')}
    kept.pop('class', None)
    return ElementTree.Element(element.tag, kept)


def _size_in_pixels(root: 'Element') -> None:
    """Convert the size of the page to pixels, because svgelements rounds paper units to 6 digits."""
    for key in ('width', 'height'):
        found = _SIZE.fullmatch(root.get(key, ''))
        if found:
            root.set(key, f'{float(found[1]) * _MM[found[2]] / 25.4 * 96:.12f}px')


def _parts(path: Path, document: Any, shape: Any, matrix: tuple[float, ...] | None,
           scale: tuple[float, bool] | None) -> Iterator[DrawnPart]:
    """Yield the parts of an svgelements shape in metres; consecutive lines form one part."""
    from svgelements import Arc, Close, CubicBezier, Line, Move, QuadraticBezier
    try:
        bare = _to_metres(document, matrix, scale)
    except _FAILS:
        raise InputError(f'{path}: its width, height or viewBox is zero or stretches '
                         'one axis more than the other; give it a size') from None

    def to_m(point: Any) -> complex:
        return _within(path, bare(point))

    points: list[complex] = []
    segments = list(shape)
    if len(segments) > DRAWING_POINTS:
        raise InputError(f'{path}: it has {len(segments)} points; the limit is {DRAWING_POINTS}')
    if any(isinstance(one, Move) for one in segments[1:]):
        raise InputError(f'{path}: {shown(shape.id)}: it has several parts; split it (Inkscape: Path > Break Apart) '
                         'and choose one', field='path')
    for one in segments[1:]:
        start, end = to_m(one.start), to_m(one.end)
        if isinstance(one, (Line, Close)):
            points = points or [start]
            points += [end] if abs(end - points[-1]) > _JOINED * (abs(start) + abs(end)) else []
            continue
        if len(points) > 1:
            yield np.array(points)
        points = []
        if isinstance(one, QuadraticBezier):
            control = to_m(one.control)
            yield Cubic((start, start + (control - start) * 2 / 3, end + (control - end) * 2 / 3, end))
        elif isinstance(one, CubicBezier):
            yield Cubic((start, to_m(one.control1), to_m(one.control2), end))
        elif isinstance(one, Arc):
            yield _ellipse(path, to_m, one)
    if len(points) > 1:
        yield np.array(points)


def _ellipse(path: Path, to_m: Any, arc: Any) -> EllipseArc:
    """Return an arc, described by conjugate half axes, which remain conjugate under any affine transform."""
    centre = to_m(arc.center)
    a, b = to_m(arc.prx) - centre, to_m(arc.pry) - centre
    start = to_m(arc.start) - centre
    area = (a.conjugate() * b).imag
    if not area or not isfinite(arc.sweep):
        raise InputError(f'{path}: an arc has zero width; draw it as a line')
    begin = atan2((a.conjugate() * start).imag / area, -(b.conjugate() * start).imag / area)
    mirrored = (arc.prx.x - arc.center.x) * (arc.pry.y - arc.center.y) < (arc.prx.y - arc.center.y) * (
        arc.pry.x - arc.center.x)
    return EllipseArc(centre, (a, b), begin, float(-arc.sweep if mirrored else arc.sweep))


def _to_metres(document: Any, matrix: tuple[float, ...] | None, scale: tuple[float, bool] | None) -> Any:
    """Return the map from svgelements points (pixels, y downwards) to metres with y upwards."""
    from svgelements import Matrix
    back = ~Matrix(document.viewbox_transform)      # maps pixels to units of the viewBox
    height = float(document.height)
    if matrix is not None:
        a, b, c, d, e, f = matrix

        def said(point: Any) -> complex:
            u, v = back.point_in_matrix_space(point)
            return complex(a * u + c * v + e, b * u + d * v + f)
        return said
    ratio, of_paper = scale or (1.0, False)
    if not of_paper and abs(abs(back.a) - abs(back.d)) > 1e-9 * abs(back.a):
        raise ValueError('its viewBox stretches one axis more than the other')
    metres = ratio * _PX_M if of_paper else ratio * abs(back.a)

    def scaled(point: Any) -> complex:
        return metres * complex(point.x, height - point.y)
    return scaled
