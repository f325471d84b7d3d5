"""Read the features of a map, in the coordinates of its file: GeoJSON, WKT, GPX, KML, KMZ and OpenStreetMap XML.

GeoJSON is in degrees (RFC 7946) unless it has ``"units": "m"`` at its top level, or a ``crs`` member as in the older
specification. WKT is in metres unless the file begins with ``units: degrees``, or a geometry with ``SRID=4326;``. The
other formats are in degrees.
"""
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dragon_ros.core.errors import InputError, MissingError, shown
from dragon_ros.core.limits import KMZ_FILES, MAP_ELEMENTS, VENUE_BYTES
from dragon_ros.scenes.georeference import DEGREES
from dragon_ros.scenes.xml import local_name, tree

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_NAMES = ('OGC:1.3:CRS84', 'OGC::CRS84', 'EPSG::4326', 'EPSG:4326', 'CRS84')
_TINY = 0.2         # as degrees, 20 km; as metres, less than any street
_SRID = re.compile(r'\s*SRID=(\d{1,9})\s*;', re.IGNORECASE)
_HSTORE = re.compile(r'"([^"]+)"=>"([^"]*)"')
_LINES = {'.dxf': 'open it in QGIS, set its reference system, and export it as GeoJSON', '.dwg': 'save it as DXF, open '
          'it in QGIS, set its reference system, and export it as GeoJSON', '.fit': 'export it as GPX',
          '.tcx': 'export it as GPX', '.pbf': 'export a part of it as .osm (osmium extract), or as GeoJSON',
          '.pdf': 'draw its lines in Inkscape, and save them as SVG', '.gpkg': 'export it from QGIS as GeoJSON',
          '.shp': 'export it from QGIS as GeoJSON'}
CONVERT = {**_LINES, **dict.fromkeys(('.png', '.jpg', '.jpeg'), _LINES['.pdf'])}


@dataclass(frozen=True)
class Feature:
    """A named shapely geometry in the coordinates of its file, and its tags (OpenStreetMap's, or properties)."""

    name: str | None
    geometry: Any
    tags: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Drawing:
    """The features of a file, their reference system (None: metres), and counts of what could not be read."""

    path: Path
    features: tuple[Feature, ...]
    crs: str | None
    left_out: Mapping[str, int] = field(default_factory=dict)


def read_drawing(path: Path) -> Drawing:
    """Return the features of a map. Raises MissingError if it cannot be read, and InputError if it is invalid."""
    suffix = path.suffix.lower()
    if suffix not in READERS:
        cure = CONVERT.get(suffix, f'convert it to one of these: {", ".join(READERS)}')
        raise InputError(f'{path}: the suffix {suffix or "(none)"} is not that of a map; {cure}')
    drawing = READERS[suffix](path, _bytes_of(path))
    kept = tuple(one for one in drawing.features if not one.geometry.is_empty)
    count = len(drawing.features) - len(kept)
    left_out = {**drawing.left_out, **({'without geometry': drawing.left_out.get('without geometry', 0) + count}
                                       if count else {})}
    if not kept:
        gone = f' ({_listed(left_out)})' if left_out else ''
        raise InputError(f'{path}: it is empty{gone}; draw lines and obstacles')
    return Drawing(path, kept, drawing.crs, left_out)


def _listed(counts: Mapping[str, int]) -> str:
    return ', '.join(f'{count} {what}' for what, count in counts.items())


def _bytes_of(path: Path) -> bytes:
    try:
        with path.open('rb') as file:
            data = file.read(VENUE_BYTES + 1)
    except (OSError, ValueError) as error:
        raise MissingError(f'{shown(str(path))[1:-1]}: cannot be read: {getattr(error, "strerror", error)}') from None
    if len(data) > VENUE_BYTES:
        raise InputError(f'{path}: it is too large; the limit for a venue is {VENUE_BYTES} bytes; keep only the '
                         'surroundings of the track')
    return data


def _text(path: Path, data: bytes) -> str:
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        raise MissingError(f'{path}: cannot be read: it is not UTF-8 text; save it as UTF-8') from None


# WKT

def _wkt(path: Path, data: bytes) -> Drawing:
    """Read lines such as ``fountain: POLYGON ((0 0, 1 0, 1 1))``; # starts a comment."""
    text, units = _text(path, data), None
    features, systems = list[Feature](), set[str | None]()
    for number, line in enumerate(text.splitlines(), 1):
        content = line.strip()
        if not content or content.startswith('#'):
            continue
        name, colon, wkt = (part.strip() for part in content.partition(':'))
        if name.lower() == 'units':
            if wkt not in ('m', 'degrees'):
                raise InputError(f'{path}:{number}: units: {shown(wkt)} is neither m nor degrees')
            units = wkt
            continue
        name, wkt = (name, wkt) if colon else ('', content)
        srid = _SRID.match(wkt)
        systems.add(None if srid is None else DEGREES if srid[1] == '4326' else f'EPSG:{srid[1]}')
        features.append(Feature(name or None, _parsed(path, number, wkt[srid.end():] if srid else wkt)))
    if len(systems) > 1 or (units and systems != {None}):
        raise InputError(f'{path}: its units differ from line to line; use one reference system')
    crs = DEGREES if units == 'degrees' else next(iter(systems), None)
    if crs is None and units is None and features:
        check_unit(path, [one.geometry for one in features], 'write units: degrees or units: m on its first line')
    return Drawing(path, tuple(features), crs)


def _parsed(path: Path, number: int, wkt: str) -> Any:
    import numpy as np
    from shapely import from_wkt
    from shapely.errors import ShapelyError
    try:
        with np.errstate(invalid='ignore'):     # shapely warns of nan, which is rejected later
            return from_wkt(wkt)
    except (ShapelyError, ValueError, NotImplementedError) as error:
        raise InputError(f'{path}:{number}: it is not WKT: {str(error).partition(chr(10))[0]}; write for example '
                         'fountain: POLYGON ((0 0, 4 0, 4 3))') from None


def check_unit(path: Path, geometries: Iterable[Any], cure: str) -> None:
    """Raise InputError if coordinates without a unit could be degrees: as metres, they span less than a street."""
    from shapely import total_bounds
    left, bottom, right, top = total_bounds([*geometries])
    if max(right - left, top - bottom) < _TINY and max(abs(left), abs(right)) <= 180 and max(
            abs(bottom), abs(top)) <= 90:
        raise InputError(f'{path}: its coordinates span only {max(right - left, top - bottom):.2g}, and it does not '
                         f'state whether they are metres or degrees; {cure}', field='unit')


# GeoJSON

def _geojson(path: Path, data: bytes) -> Drawing:
    try:
        values = json.loads(_text(path, data), parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise InputError(f'{path}: it is not GeoJSON: {str(error)[:160]}') from None
    if not isinstance(values, dict):
        raise InputError(f'{path}: it is not GeoJSON: its top level is not an object')
    faults, missing = list[str](), 0
    features = list[Feature]()
    for name, tags, geometry in _features(path, values):
        if geometry is None:
            missing += 1
            continue
        try:
            features.append(Feature(name, _shape(geometry), tags))
        except InputError as error:
            faults.append(f'{shown(name)[1:-1] if name else "a feature without a name"} ({error})')
    if faults:
        more = f' and {len(faults) - 3} more' if len(faults) > 3 else ''
        raise InputError(f'{path}: it is not GeoJSON: {"; ".join(faults[:3])}{more}')
    return Drawing(path, tuple(features), _crs(path, values), {'without geometry': missing} if missing else {})


def _no_number(text: str) -> Any:
    raise ValueError(f'{text} is not a finite number; draw that point again')


def _features(path: Path, values: dict[str, Any]) -> Iterator[tuple[str | None, Mapping[str, str], Any]]:
    """Yield the name, the tags and the geometry of each feature."""
    if values.get('type') == 'FeatureCollection':
        listed = values.get('features')
        if not isinstance(listed, list):
            raise InputError(f'{path}: it is not GeoJSON: "features" is not a list')
        for one in listed:
            if not isinstance(one, dict):
                raise InputError(f'{path}: it is not GeoJSON: a feature is not an object')
            yield from _features(path, one)
    elif values.get('type') == 'Feature':
        properties = values.get('properties')
        tags = _tags(properties) if isinstance(properties, dict) else {}
        name = tags.get('name', '').strip() or values.get('id')
        yield None if name is None else str(name), tags, values.get('geometry')
    else:
        yield None, {}, values


def _tags(properties: Mapping[str, Any]) -> dict[str, str]:
    """Return the properties that are text, whole numbers or true, with the tags that exporters nest in a property."""
    nested = properties.get('tags')
    flat = {**properties, **(nested if isinstance(nested, dict) else {})}
    out = {key: str(value) for key, value in flat.items() if isinstance(value, (str, int)) and value is not False}
    return {**dict(_HSTORE.findall(out.get('other_tags', ''))), **out}


def _shape(values: Any) -> Any:
    from shapely.errors import ShapelyError
    from shapely.geometry import shape
    try:
        return shape(values)
    except (ShapelyError, ValueError, TypeError, AttributeError, LookupError) as error:
        raise InputError(str(error).partition('\n')[0][:160] or 'no geometry') from None


def _crs(path: Path, values: dict[str, Any]) -> str | None:
    """Return the coordinate reference system, or None for metres."""
    units = values.get('units')
    if units is not None and units not in ('m', 'degrees'):
        raise InputError(f'{path}: units: {shown(units)} is neither "m" nor "degrees"')
    given = values.get('crs')
    name = given.get('properties', {}).get('name') if isinstance(given, dict) and isinstance(
        given.get('properties'), dict) else None
    if units == 'm' and not isinstance(name, str):
        return None
    if given is not None and not isinstance(name, str):
        raise InputError(f'{path}: crs: it names no reference system; remove it, or write "units": "m" for metres')
    return DEGREES if name is None or name.endswith(_NAMES) else str(name)


# GPX, KML and OpenStreetMap

def _gpx(path: Path, data: bytes) -> Drawing:
    """Read tracks, each with its segments, routes and waypoints."""
    features = []
    for one in tree(path, data, 'GPX', MAP_ELEMENTS):
        kind, name = local_name(one), _said(one, 'name')
        if kind == 'trk':
            features.append(_way(name, [_positions(path, part, 'trkpt') for part in _below(one, 'trkseg')], {}))
        elif kind == 'rte':
            features.append(_way(name, [_positions(path, one, 'rtept')], {}))
        elif kind == 'wpt':
            features.append(_point(name, _position(path, one), {}))
    return Drawing(path, tuple(features), DEGREES)


def _below(element: 'Element', kind: str) -> Iterator['Element']:
    return (one for one in element if local_name(one) == kind)


def _said(element: 'Element', kind: str) -> str | None:
    """Return the text of a child, or None."""
    return next(((one.text or '').strip() or None for one in _below(element, kind)), None)


def _positions(path: Path, element: 'Element', kind: str) -> list[tuple[float, float]]:
    return [_position(path, one) for one in _below(element, kind)]


def _position(path: Path, element: 'Element') -> tuple[float, float]:
    return _pair(path, element.get('lon', ''), element.get('lat', ''))


def _pair(path: Path, lon: str, lat: str) -> tuple[float, float]:
    try:
        return float(lon), float(lat)
    except ValueError:
        raise InputError(f'{path}: a position is {shown(lon)}, {shown(lat)}, not two numbers; draw that point again'
                         ) from None


def _way(name: str | None, parts: Iterable[list[tuple[float, float]]], tags: Mapping[str, str]) -> Feature:
    """Return a line, or several; parts with fewer than two points are dropped."""
    from shapely import LineString, MultiLineString
    lines = [LineString(part) for part in parts if len(part) > 1]
    return Feature(name, lines[0] if len(lines) == 1 else MultiLineString(lines), tags)


def _point(name: str | None, at: tuple[float, float], tags: Mapping[str, str]) -> Feature:
    from shapely import Point
    return Feature(name, Point(at), tags)


def _kml(path: Path, data: bytes) -> Drawing:
    """Read the paths, the polygons and the points of all placemarks."""
    from shapely import GeometryCollection
    features = []
    for one in tree(path, data, 'KML', MAP_ELEMENTS).iter():
        if local_name(one) == 'Placemark':
            shapes = [shape for below in one for shape in _kml_shapes(path, below)]
            geometry = shapes[0] if len(shapes) == 1 else GeometryCollection(shapes)
            features.append(Feature(_said(one, 'name'), geometry))
    return Drawing(path, tuple(features), DEGREES)


def _kml_shapes(path: Path, element: 'Element') -> Iterator[Any]:
    from shapely import LineString, Point, Polygon
    kind = local_name(element)
    if kind in ('MultiGeometry', 'MultiTrack'):
        for below in element:
            yield from _kml_shapes(path, below)
    elif kind == 'Polygon':
        rings = [[_coordinates(path, ring) for side in _below(element, where) for ring in _below(side, 'LinearRing')]
                 for where in ('outerBoundaryIs', 'innerBoundaryIs')]
        outer = [ring for ring in rings[0] if len(ring) > 2]
        yield Polygon(outer[0], [ring for ring in rings[1] if len(ring) > 2]) if outer else Polygon()
    elif kind in ('LineString', 'LinearRing', 'Track'):
        points = _coordinates(path, element)
        yield LineString(points) if len(points) > 1 else LineString()
    elif kind == 'Point':
        points = _coordinates(path, element)
        yield Point(points[0]) if points else Point()


def _coordinates(path: Path, element: 'Element') -> list[tuple[float, float]]:
    """Return positions from ``lon,lat,height`` separated by spaces, or from the ``coord`` elements of a gx:Track."""
    rows = [row.split(',') for row in (_said(element, 'coordinates') or '').split()]
    rows += [(one.text or '').split() for one in _below(element, 'coord')]
    return [_pair(path, row[0], row[1] if len(row) > 1 else '') for row in rows]


def _kmz(path: Path, data: bytes) -> Drawing:
    """Read the first KML file in an archive."""
    import struct
    import zipfile
    import zlib
    from lzma import LZMAError
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            names = archive.namelist()
            if len(names) > KMZ_FILES:
                raise InputError(f'{path}: it holds {len(names)} files; the limit is {KMZ_FILES}')
            name = next((name for name in names if name.lower().endswith('.kml')), None)
            if name is None:
                raise InputError(f'{path}: it holds no .kml file; export it again from Google Earth')
            with archive.open(name) as file:
                text = file.read(VENUE_BYTES + 1)
    except (zipfile.BadZipFile, zlib.error, LZMAError, struct.error, LookupError, NotImplementedError, RuntimeError,
            EOFError, OSError, ValueError) as error:
        raise InputError(f'{path}: it is not KMZ: {error}') from None
    if len(text) > VENUE_BYTES:
        raise InputError(f'{path}: unpacked, it is too large; the limit is {VENUE_BYTES} bytes')
    return _kml(path, text)


def _osm(path: Path, data: bytes) -> Drawing:
    """Read ways, multipolygons, and nodes with tags; nodes outside the exported part are skipped."""
    root = tree(path, data, 'OpenStreetMap XML', MAP_ELEMENTS)
    nodes = {one.get('id'): _position(path, one) for one in _below(root, 'node') if one.get('lon') is not None}
    features, ways = list[Feature](), dict[str | None, list[tuple[float, float]]]()
    for one in _below(root, 'node'):
        tags = _osm_tags(one)
        if tags and one.get('id') in nodes:
            features.append(_point(_osm_name(one, tags), nodes[one.get('id')], tags))
    inner = set[str | None]()
    for one in _below(root, 'way'):
        ways[one.get('id')] = [nodes[ref] for part in _below(one, 'nd') if (ref := part.get('ref')) in nodes]
    for one in _below(root, 'relation'):
        tags = _osm_tags(one)
        if tags.get('type') == 'multipolygon':
            members = [part for part in _below(one, 'member') if part.get('type') == 'way' and part.get('ref') in ways]
            features.append(Feature(_osm_name(one, tags), _multipolygon(members, ways), tags))
            inner.update(part.get('ref') for part in members)
    for one in _below(root, 'way'):
        tags, points = _osm_tags(one), ways[one.get('id')]
        if tags or one.get('id') not in inner:
            features.append(_osm_way(_osm_name(one, tags), points, {**tags, '@id': _identity(one)}))
    return Drawing(path, tuple(features), DEGREES)


def _osm_tags(element: 'Element') -> dict[str, str]:
    return {one.get('k', ''): one.get('v', '') for one in _below(element, 'tag')}


def _identity(element: 'Element') -> str:
    return f'{local_name(element)}/{element.get("id")}'


def _osm_name(element: 'Element', tags: Mapping[str, str]) -> str:
    return tags.get('name', '').strip() or _identity(element)


def _osm_way(name: str, points: list[tuple[float, float]], tags: Mapping[str, str]) -> Feature:
    """Return a way as a line or, if it is closed and not a street or a barrier, as a polygon."""
    from shapely import Polygon
    is_line = ('highway' in tags or 'barrier' in tags) and tags.get('area') != 'yes'
    if len(points) > 3 and points[0] == points[-1] and not is_line:
        return Feature(name, Polygon(points), tags)
    return _way(name, [points], tags)


def _multipolygon(members: Iterable['Element'], ways: Mapping[str | None, list[tuple[float, float]]]) -> Any:
    """Return the area between the outer and the inner rings, whose ways are joined."""
    from shapely import LineString, polygonize, union_all
    areas = {}
    for role in ('outer', 'inner'):
        lines = [LineString(ways[one.get('ref')]) for one in members if (one.get('role') or 'outer') == role
                 and len(ways[one.get('ref')]) > 1]
        areas[role] = union_all(list(polygonize(lines).geoms)) if lines else None
    whole = areas['outer'] if areas['outer'] is not None else polygonize([])
    return whole if areas['inner'] is None else whole.difference(areas['inner'])


READERS: dict[str, Callable[[Path, bytes], Drawing]] = {
    '.geojson': _geojson, '.json': _geojson, '.wkt': _wkt, '.gpx': _gpx, '.kml': _kml, '.kmz': _kmz, '.osm': _osm}
