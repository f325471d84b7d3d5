"""Read venues and drawings from GeoJSON, where degrees are projected to metres, or from WKT in metres.

The property ``name`` of a feature is its name. Benches must stay in the polygon named ``inside``. Coordinates in
GeoJSON are degrees (RFC 7946) unless the file has ``"units": "m"`` at its top level, or a ``crs`` member as in the
older specification.
"""
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dragon_ros.core.errors import FieldError, InputError, MissingError, shown
from dragon_ros.core.limits import VENUE_BYTES
from dragon_ros.core.venue import INSIDE

_DEGREES = ('OGC:1.3:CRS84', 'OGC::CRS84', 'EPSG::4326', 'EPSG:4326', 'CRS84')
_FAR_M = 100_000.0      # at this distance from the origin, the projection stretches lengths by 0.012 %
_SHOWN = {'Point': 'draw it as a small polygon', 'MultiPoint': 'draw each as a small polygon'}


@dataclass(frozen=True)
class Feature:
    """A named shapely geometry, in metres."""

    name: str | None
    geometry: Any


@dataclass(frozen=True)
class Drawing:
    """The features of a file, and the longitude and latitude of its origin, or None if unknown."""

    features: tuple[Feature, ...]
    origin_deg: tuple[float, float] | None = None


def read_drawing(path: Path, origin_deg: tuple[float, float] | None = None) -> Drawing:
    """Return the features of a GeoJSON (``.geojson``, ``.json``) or WKT (``.wkt``, one per line) file, in metres.

    Degrees are converted to metres east and north of ``origin_deg`` (longitude, latitude), by default the centre of the
    drawing. Coordinates in metres are not changed; ``origin_deg`` is then the position of (0, 0). Raises MissingError
    if the file cannot be read, and InputError if it is invalid.
    """
    text = _text_of(path)
    if path.suffix.lower() == '.wkt':
        return Drawing(tuple(_wkt_features(path, text)), origin_deg)
    if path.suffix.lower() not in ('.geojson', '.json'):
        raise InputError(f'{path}: the suffix is not .geojson, .json or .wkt; rename the file')
    return _geojson(path, text, origin_deg)


def venue_values(path: Path, origin_deg: tuple[float, float] | None = None) -> dict[str, Any]:
    """Return the obstacles, inside and origin of a file, laid out as in a scene file.

    Raises the same errors as ``read_drawing``.
    """
    obstacles: list[dict[str, Any]] = []
    out: dict[str, Any] = {}
    drawing = read_drawing(path, origin_deg)
    if drawing.origin_deg is not None:
        out['origin_deg'] = [*drawing.origin_deg]
    for n, feature in enumerate(drawing.features, 1):
        if feature.name is not None and feature.name.strip().lower() == INSIDE:
            if 'inside' in out:
                raise InputError(f'{path}: two features are named {INSIDE}; keep one')
            out['inside'], holes = _inside(path, feature.geometry)
            obstacles += holes
        else:
            obstacles += _obstacles(path, feature.name or f'obstacle {n}', feature.geometry)
    return {**out, 'obstacles': obstacles}


def _text_of(path: Path) -> str:
    try:
        with path.open('rb') as file:
            data = file.read(VENUE_BYTES + 1)
        if len(data) > VENUE_BYTES:
            raise InputError(f'{path}: it is too large; the limit for a venue is {VENUE_BYTES} bytes; keep only the '
                             'surroundings of the track')
        return data.decode()
    except OSError as error:
        raise MissingError(f'{path}: cannot be read: {error.strerror}') from None
    except ValueError as error:
        why = 'it is not UTF-8 text' if isinstance(error, UnicodeDecodeError) else str(error)
        raise MissingError(f'{shown(str(path))[1:-1]}: cannot be read: {why}') from None


def _inside(path: Path, geometry: Any) -> tuple[list[list[float]], list[dict[str, Any]]]:
    """Return the outer ring of the inside, and its holes as obstacles."""
    parts = list(_parts(geometry))
    if len(parts) != 1 or parts[0].geom_type != 'Polygon':
        raise InputError(f'{path}: {INSIDE}: it is a {geometry.geom_type} of {len(parts)} parts, not one polygon; join '
                         'its parts into one')
    ring, *holes = _rings(path, INSIDE, parts[0])
    return ring, [{'kind': 'polygon', 'name': f'hole {n} of {INSIDE}', 'points_m': hole}
                  for n, hole in enumerate(holes, 1)]


def _obstacles(path: Path, name: str, geometry: Any) -> list[dict[str, Any]]:
    """Return a feature as obstacles, one per part; several parts are numbered."""
    parts = list(_parts(geometry))
    if not parts:
        raise InputError(f'{path}: {name}: it is empty; draw it or remove it')
    names = [name] if len(parts) == 1 else [f'{name} {n}' for n in range(1, len(parts) + 1)]
    return [_obstacle(path, *one) for one in zip(names, parts, strict=True)]


def _obstacle(path: Path, name: str, part: Any) -> dict[str, Any]:
    if part.is_empty:
        raise InputError(f'{path}: {name}: it is empty; draw it or remove it')
    if part.geom_type == 'Polygon':
        ring, *holes = _rings(path, name, part)
        return {'kind': 'polygon', 'name': name, 'points_m': ring, **({'holes_m': holes} if holes else {})}
    if part.geom_type in ('LineString', 'LinearRing'):
        return {'kind': 'line', 'name': name, 'points_m': _points(part)}
    raise InputError(f'{path}: {name}: a {part.geom_type} has no extent; {_SHOWN.get(part.geom_type, "remove it")}')


def _parts(geometry: Any) -> Iterator[Any]:
    for part in getattr(geometry, 'geoms', [geometry]):
        if hasattr(part, 'geoms'):
            yield from _parts(part)
        else:
            yield part


def _rings(path: Path, name: str, polygon: Any) -> list[list[list[float]]]:
    if polygon.is_empty:
        raise InputError(f'{path}: {name}: it is empty; draw it or remove it')
    return [_points(ring) for ring in (polygon.exterior, *polygon.interiors)]


def _points(line: Any) -> list[list[float]]:
    """Return the points of a line in the plane, without heights."""
    from shapely import get_coordinates
    found: list[list[float]] = get_coordinates(line).tolist()
    return found


def _wkt_features(path: Path, text: str) -> Iterator[Feature]:
    """Yield the features from lines such as ``fountain: POLYGON ((0 0, 1 0, 1 1))``; # starts a comment."""
    import numpy as np
    from shapely import from_wkt
    from shapely.errors import ShapelyError
    for number, line in enumerate(text.splitlines(), 1):
        content = line.strip()
        if not content or content.startswith('#'):
            continue
        name, colon, wkt = content.partition(':')
        name, wkt = (name.strip(), wkt.strip()) if colon else ('', content)
        try:
            with np.errstate(invalid='ignore'):     # shapely warns of nan, which is rejected later
                yield Feature(name or None, from_wkt(wkt))
        except (ShapelyError, ValueError, NotImplementedError) as error:
            raise InputError(f'{path}:{number}: it is not WKT: {str(error).partition(chr(10))[0]}; write for example '
                             'fountain: POLYGON ((0 0, 4 0, 4 3))') from None


def _geojson(path: Path, text: str, origin_deg: tuple[float, float] | None) -> Drawing:
    try:
        values = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise InputError(f'{path}: it is not GeoJSON: {str(error)[:160]}') from None
    if not isinstance(values, dict):
        raise InputError(f'{path}: it is not GeoJSON: its top level is not an object')
    features = tuple(_features(path, values))
    if not features:
        raise InputError(f'{path}: it is empty; draw obstacles, or a polygon named {INSIDE}')
    crs = _crs(path, values)
    if crs is None:
        return Drawing(features, origin_deg)
    return _projected(path, features, crs, origin_deg)


def _no_number(text: str) -> Any:
    raise ValueError(f'{text} is not a finite number; draw that point again')


def _features(path: Path, values: dict[str, Any]) -> Iterator[Feature]:
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
        named = properties.get('name') if isinstance(properties, dict) else None
        name = named if isinstance(named, str) and named.strip() else values.get('id')
        yield Feature(None if name is None else str(name), _geometry(path, name, values.get('geometry')))
    else:
        yield Feature(None, _geometry(path, None, values))


def _geometry(path: Path, name: object, values: Any) -> Any:
    from shapely.errors import ShapelyError
    from shapely.geometry import shape
    label = f'{path}: {shown(name)[1:-1]}' if isinstance(name, str) else f'{path}'
    if values is None:
        raise InputError(f'{label}: a feature has no geometry; draw it or remove it')
    try:
        return shape(values)
    except (ShapelyError, ValueError, TypeError, AttributeError, LookupError) as error:
        why = str(error).partition('\n')[0][:160] or 'no geometry'
        raise InputError(f'{label}: it is not GeoJSON: {why}') from None


def _crs(path: Path, values: dict[str, Any]) -> str | None:
    """Return the coordinate reference system, or None for local metres."""
    units = values.get('units')
    if units is not None and units not in ('m', 'degrees'):
        raise InputError(f'{path}: units: {shown(units)} is neither "m" nor "degrees"')
    if units == 'm':
        return None
    given = values.get('crs')
    name = given.get('properties', {}).get('name') if isinstance(given, dict) and isinstance(
        given.get('properties'), dict) else None
    if given is not None and not isinstance(name, str):
        raise InputError(f'{path}: crs: it names no reference system; remove it, or write "units": "m" for metres')
    return 'OGC:CRS84' if name is None or name.endswith(_DEGREES) else str(name)


def _projected(path: Path, features: tuple[Feature, ...], crs: str,
               origin_deg: tuple[float, float] | None) -> Drawing:
    """Return features in metres east and north of an origin, using the transverse Mercator projection about it."""
    import numpy as np
    from shapely import get_coordinates, transform
    every = np.concatenate([get_coordinates(one.geometry) for one in features])
    if not every.size or not np.all(np.isfinite(every)):
        raise InputError(f'{path}: a coordinate is missing or not a finite number; draw that point again')
    if crs == 'OGC:CRS84' and not (np.all(np.abs(every[:, 0]) <= 180) and np.all(np.abs(every[:, 1]) < 90)):
        raise InputError(f'{path}: its coordinates are not degrees (longitude, latitude); if they are metres, write '
                         '"units": "m" at its top level')
    try:
        from pyproj import Transformer
        from pyproj.exceptions import ProjError
    except ImportError:
        raise MissingError(f"{path}: converting degrees to metres requires pyproj; pip install 'dragon_ros[maps]' or "
                           'pip install pyproj; or, if they are metres, write "units": "m" at its top level') from None
    try:
        to_degrees = Transformer.from_crs(crs, 'OGC:CRS84', always_xy=True)
        degrees = np.stack(to_degrees.transform(*every.T), axis=1)
        lon, lat = origin_deg or (0.5 * (degrees.min(axis=0) + degrees.max(axis=0))).tolist()
        project = Transformer.from_crs(crs, _plane((lon, lat)), always_xy=True)

        def metres(points: Any) -> Any:
            return np.stack(project.transform(*points[:, :2].T), axis=1)

        moved = tuple(Feature(one.name, transform(one.geometry, metres)) for one in features)
    except ProjError as error:
        raise InputError(f'{path}: crs: {shown(crs)} cannot be projected: {str(error)[:160]}') from None
    if not all(np.all(np.isfinite(get_coordinates(one.geometry))) for one in moved):
        raise FieldError(f'{path}', crs, 'a coordinate lies outside this reference system', 'check the crs of the file')
    far_m = max(float(np.max(np.abs(get_coordinates(one.geometry)), initial=0.0)) for one in moved)
    if far_m > _FAR_M:
        raise InputError(f'{path}: it reaches {far_m / 1000:.4g} km from its origin ({lon:g}, {lat:g}), and lengths '
                         f'are accurate only up to {_FAR_M / 1000:g} km; give an origin near the drawing, or a smaller '
                         'part of the map')
    return Drawing(moved, (lon, lat))


def degrees_of(geometry: Any, origin_deg: tuple[float, float]) -> Any:
    """Convert a shapely geometry from metres about an origin to longitude and latitude.

    Degrees are rounded to 1e-10 (10 um). Raises MissingError if pyproj is not installed.
    """
    import numpy as np
    from shapely import transform
    try:
        from pyproj import Transformer
    except ImportError:
        raise MissingError("venue.origin_deg: converting metres to degrees requires pyproj; pip install "
                           "'dragon_ros[maps]' or pip install pyproj; or omit the origin (--set "
                           'venue.origin_deg=null) to keep metres') from None
    project = Transformer.from_crs(_plane(origin_deg), 'OGC:CRS84', always_xy=True)

    def degrees(points: Any) -> Any:
        return np.round(np.stack(project.transform(*points.T), axis=1), 10)

    return transform(geometry, degrees)


def _plane(origin_deg: tuple[float, float]) -> Any:
    """Return the transverse Mercator projection about an origin."""
    from pyproj import CRS
    lon, lat = origin_deg
    return CRS.from_proj4(f'+proj=tmerc +lat_0={lat!r} +lon_0={lon!r} +k=1 +datum=WGS84 +units=m')
