"""Place drawings in a scene's plane: one origin, in degrees or in metres of a map, for its track and its venue.

Coordinates of a drawing are degrees or metres in a known reference system (``crs``), or plain metres (``crs`` is None).
Plain metres within 10 km of (0, 0) are those of the scene, unless the scene's origin is on a map: then all plain metres
are those of the map.
"""
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from dragon_ros.core.errors import FieldError, InputError, MissingError, shown
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.venue import Origin

DEGREES = 'OGC:CRS84'       # longitude, latitude
WORLD_M = 10_000.0          # all coordinates of a scene are within this distance of its origin
_DECIMALS = 6               # of an origin in degrees, about 0.1 m
_FORM = 'write LONGITUDE,LATITUDE in degrees, or EASTm,NORTHm in metres of a map, or EASTm,NORTHm,EPSG:CODE'


def read_origin(text: str, option: str = '--origin') -> Origin:
    """Return an origin from text such as ``119.65,29.11`` or ``500000m,3400000m,EPSG:32650``. Raises FieldError."""
    x, _, rest = text.partition(',')
    y, _, crs = rest.partition(',')
    try:
        pair = float(x.strip().removesuffix('m')), float(y.strip().removesuffix('m'))
    except ValueError:
        raise FieldError(option, text, 'it is not a place', _FORM) from None
    metres = [one.strip().endswith('m') for one in (x, y)]
    if metres[0] != metres[1] or (crs and not metres[0]):
        raise FieldError(option, text, 'its units differ', _FORM)
    return Origin(map_m=pair, crs=crs.strip() or None) if metres[0] else Origin(pair)


def own_origin(where: str, geometries: Sequence[Any], crs: str | None) -> Origin | None:
    """Return the centre of geometries as an origin, or None if they are plain metres near (0, 0)."""
    points = _coordinates(where, geometries, crs)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    if crs is None:
        return Origin(map_m=tuple(np.round(centre).tolist())) if np.max(np.abs(points)) > WORLD_M else None
    (centre,) = _transformed(where, crs, DEGREES, centre[None])
    lon, lat = np.round(centre, _DECIMALS).tolist()
    return Origin((lon, lat))


def placed(where: str, geometries: Sequence[Any], crs: str | None, origin: Origin | None) -> list[Any]:
    """Return geometries in metres of the scene's plane. Raises InputError for coordinates outside its world."""
    out = unbounded(where, geometries, crs, origin)
    reach_m = float(np.max(np.abs(_coordinates(where, out, None))))
    if reach_m > WORLD_M:
        raise InputError(f'{where}: it reaches {reach_m / 1000:.4g} km from the origin ({origin or "(0, 0)"}); the '
                         f'limit is {WORLD_M / 1000:g} km; give an origin near it: {_FORM}', field='origin')
    return out


def unbounded(where: str, geometries: Sequence[Any], crs: str | None, origin: Origin | None) -> list[Any]:
    """Return geometries in metres of the scene's plane, however far away; the coordinates of the farthest are inf."""
    from shapely import force_2d, transform
    _coordinates(where, geometries, crs)
    plane = _plane(origin) if origin and crs else None
    if crs is not None and plane is None:
        raise InputError(f'{where}: it lies on earth, and the origin of the scene ({origin or "unknown"}) does not say '
                         f'where; give an origin: {_FORM}', field='origin')
    shift = np.array((origin.map_m if origin else None) or (0.0, 0.0))

    def to_plane(points: Any) -> Any:
        moved = points if crs is None else _transformed(where, crs, plane, points)
        return moved - shift

    return [transform(force_2d(one), to_plane) for one in geometries]


def _coordinates(where: str, geometries: Sequence[Any], crs: str | None) -> Floats:
    from shapely import get_coordinates
    points: Floats = get_coordinates(list(geometries))
    if not points.size or not np.all(np.isfinite(points)):
        raise InputError(f'{where}: a coordinate is missing or not a finite number; draw that point again')
    if crs == DEGREES and not (np.all(np.abs(points[:, 0]) <= 180) and np.all(np.abs(points[:, 1]) < 90)):
        raise InputError(f'{where}: its coordinates are not degrees (longitude, latitude); if they are metres, write '
                         '"units": "m" at its top level, or the crs of the map')
    return points


def _plane(origin: Origin) -> Any:
    """Return the reference system of the scene's plane, or None if it is unknown."""
    if origin.lon_lat_deg is None:
        return origin.crs
    lon, lat = origin.lon_lat_deg
    return f'+proj=tmerc +lat_0={lat!r} +lon_0={lon!r} +k=1 +datum=WGS84 +units=m +type=crs'


def _transformed(where: str, source: Any, target: Any, points: Floats) -> Floats:
    try:
        from pyproj import Transformer
        from pyproj.exceptions import ProjError
    except ImportError:
        raise MissingError(f'{where}: converting between degrees and metres requires pyproj; {sys.executable} -m pip '
                           'install pyproj; or give the drawing and the venue in metres ("units": "m")') from None
    try:
        x, y = Transformer.from_crs(source, target, always_xy=True).transform(*points.T.tolist())
    except ProjError as error:
        raise InputError(f'{where}: crs: {shown(source)} cannot be projected: {str(error)[:160]}') from None
    return np.stack((x, y), axis=1)


def degrees_of(geometry: Any, origin: Origin) -> Any:
    """Convert a shapely geometry from metres of the plane to longitude and latitude, rounded to 1e-10 (10 um).

    Raises InputError if the reference system of the origin is unknown, or pyproj is not installed.
    """
    from shapely import transform
    plane = _plane(origin)
    if plane is None:
        raise InputError(f'origin.crs: the reference system of the origin {origin} is unknown; name it (EPSG:CODE), or '
                         'omit the origin (--set origin=null) to keep metres', field='origin.crs')
    shift = np.array(origin.map_m or (0.0, 0.0))

    def degrees(points: Any) -> Any:
        return np.round(_transformed('origin', plane, DEGREES, points + shift), 10)

    return transform(geometry, degrees)
