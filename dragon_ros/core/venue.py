"""Settings of the venue: named obstacles, a polygon that benches must not leave, and the required gap.

An origin places the scene's plane, with its track and its venue, on earth or on a map.

``geometry.venue`` uses these settings. Shapely checks the polygons; it is imported only if the venue has polygons.
"""
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain, pairwise
from math import isfinite
from typing import Any

from dragon_ros.core.checks import number, settle
from dragon_ros.core.domain import VENUE
from dragon_ros.core.errors import FieldError
from dragon_ros.core.limits import VENUE_CORNERS
from dragon_ros.core.words import counted

INSIDE = 'inside'       # the name of the boundary, which no obstacle may have
FARTHEST_M = 1e9      # coordinates in messages, which may be those of a map
_MAP_M = 2.1e7           # no map of the earth has larger coordinates
_LONGEST = 100          # maximum number of characters of a name
_AROUND = 'list its corners in order around the polygon'

Point = tuple[float, float]
Points = tuple[Point, ...]


@dataclass(frozen=True)
class Origin:
    """The place of the plane's origin (0, 0): on earth (longitude, latitude), or on a map in metres (east, north).

    On earth, x points east and y north, in the transverse Mercator projection about the origin. On a map, the plane is
    the map, shifted; ``crs`` names the map's reference system, such as EPSG:32650, or is None if it is unknown.
    """

    lon_lat_deg: Point | None = None
    map_m: Point | None = None
    crs: str | None = None

    def __post_init__(self) -> None:
        """Reject an origin without a place, with two places, or with a reference system for degrees."""
        if (self.lon_lat_deg is None) == (self.map_m is None):
            raise FieldError('origin', None if self.map_m is None else self.map_m, 'it needs one place, in degrees or '
                             'in metres of a map', 'give lon_lat_deg, or map_m with the crs')
        if self.crs is not None and (self.map_m is None or not isinstance(self.crs, str) or not self.crs.isprintable()
                                     or not 0 < len(self.crs) <= _LONGEST):
            raise FieldError('origin.crs', self.crs, 'it must name the reference system of map_m',
                             'write for example EPSG:32650')
        settle(self, lon_lat_deg=_place('origin.lon_lat_deg', self.lon_lat_deg, (180.0, 90.0)),
               map_m=_place('origin.map_m', self.map_m, (_MAP_M, _MAP_M)))

    def __str__(self) -> str:
        """Return the origin as the option ``--origin`` reads it."""
        if self.lon_lat_deg is not None:
            return f'{self.lon_lat_deg[0]!r},{self.lon_lat_deg[1]!r}'
        assert self.map_m is not None
        east, north = self.map_m
        return f'{east!r}m,{north!r}m' + (f',{self.crs}' if self.crs else '')


def _place(field: str, value: Any, most: Point) -> Point | None:
    if value is None:
        return None
    if not isinstance(value, tuple) or len(value) != 2:
        raise FieldError(field, value, 'it is not a position', 'write [longitude, latitude] or [east, north]')
    x, y = (number(field, one, low=-high, high=high) for one, high in zip(value, most, strict=True))
    return x, y


@dataclass(frozen=True)
class PolygonObstacle:
    """A polygon that no bench may touch, given by its corners in order and by the corners of its holes (courtyards)."""

    name: str
    points_m: Points
    holes_m: tuple[Points, ...] = ()

    def checked(self, field: str) -> 'PolygonObstacle':
        """Return the polygon with its values normalised. Raises FieldError for an invalid polygon."""
        name = _name(field, self.name)
        holes = tuple(_ring(f'{field}.holes_m.{n}', name, hole) for n, hole in enumerate(self.holes_m, 1))
        ring = _ring(f'{field}.points_m', name, self.points_m)
        _check_simple(field, name, ring, holes)
        return PolygonObstacle(name, ring, holes)

    @property
    def rings_m(self) -> tuple[Points, ...]:
        """The outer ring and the rings of the holes."""
        return self.points_m, *self.holes_m


@dataclass(frozen=True)
class LineObstacle:
    """A line that no bench may touch, such as a wall, given by its points in order."""

    name: str
    points_m: Points

    def checked(self, field: str) -> 'LineObstacle':
        """Return the line with its values normalised. Raises FieldError for an invalid line."""
        name = _name(field, self.name)
        points = _points(f'{field}.points_m', name, self.points_m)
        if len(points) < 2:
            raise FieldError(f'{field}.points_m', name, f'a line needs at least 2 different points; this line has '
                             f'{len(points)}', 'add points, or remove the line')
        return LineObstacle(name, points)


Obstacle = PolygonObstacle | LineObstacle
OBSTACLES: dict[str, type[Obstacle]] = {'polygon': PolygonObstacle, 'line': LineObstacle}


@dataclass(frozen=True)
class Venue:
    """Obstacles, the corners of a polygon that benches must not leave, and the required gap (m) to all of these."""

    obstacles: tuple[Obstacle, ...] = ()
    inside: Points | None = None
    margin_m: float = 0.0

    def __post_init__(self) -> None:
        """Reject a venue that is empty or too large, and invalid polygons and lines."""
        if not self.obstacles and self.inside is None:
            raise FieldError('venue.obstacles', 0, 'a venue needs obstacles or an inside polygon',
                             'add one, or remove the section venue')
        count = corners(self)
        if count > VENUE_CORNERS:
            raise FieldError('venue', f'{count} corners', f'the limit is {VENUE_CORNERS}',
                             'simplify its outlines, or keep only those near the track')
        inside = self.inside
        if inside is not None:
            inside = _ring('venue.inside', INSIDE, inside)
            _check_simple('venue.inside', INSIDE, inside, ())
        settle(self, obstacles=tuple(one.checked(f'venue.obstacles.{n}') for n, one in enumerate(self.obstacles, 1)),
               inside=inside, margin_m=number('venue.margin_m', self.margin_m, low=0.0, high=VENUE.high))
        self._check_names()

    def _check_names(self) -> None:
        known = {INSIDE}
        for n, one in enumerate(self.obstacles, 1):
            if one.name in known:
                raise FieldError(f'venue.obstacles.{n}.name', one.name, 'another obstacle has this name' if
                                 one.name != INSIDE else 'it is the name of the boundary', 'give it another name')
            known.add(one.name)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the obstacles, followed by the name of the boundary if the venue has one."""
        return (*(one.name for one in self.obstacles), *([INSIDE] if self.inside is not None else []))

    def __repr__(self) -> str:
        """Summarise the size instead of listing all corners."""
        return f'Venue({counted(len(self.obstacles), "obstacle")}, {corners(self)} corners, margin_m={self.margin_m:g})'


def corners(venue: Venue) -> int:
    """Return the number of corners of a venue."""
    rings = chain.from_iterable(_rings(one) for one in venue.obstacles)
    return sum(map(len, rings)) + len(venue.inside or ())


def _rings(one: Obstacle) -> Iterable[Points]:
    return one.rings_m if isinstance(one, PolygonObstacle) else (one.points_m,)


def _name(field: str, value: Any) -> str:
    if not isinstance(value, str) or not value.strip() or len(value) > _LONGEST or not value.isprintable():
        raise FieldError(f'{field}.name', value, f'a name is 1 to {_LONGEST} printable characters',
                         'name it, for example fountain')
    return value


def _ring(field: str, name: str, values: Any) -> Points:
    """Return the corners of a ring without repeating the first corner at the end. Raises FieldError."""
    points = _points(field, name, values)
    points = points[:-1] if len(points) > 1 and points[0] == points[-1] else points
    if len(points) < 3:
        raise FieldError(field, name, 'a polygon needs at least 3 different corners; this polygon has '
                                      f'{len(points)}', _AROUND)
    return points


def _points(field: str, name: str, values: Any) -> Points:
    """Return points without consecutive duplicates. Raises FieldError for an invalid coordinate."""
    if not isinstance(values, tuple) or not all(isinstance(one, tuple) and len(one) == 2 for one in values):
        raise FieldError(field, values, f'{name!r} needs a list of points', 'write for example [[0, 0], [4, 0]]')
    flat = [*chain.from_iterable(values)]
    for n, one in enumerate(flat):
        if type(one) not in (float, int) or not isfinite(one) or abs(one) > VENUE.high:
            raise FieldError(f'{field}.{n // 2 + 1}', one, f'coordinates of {name!r} must be finite and at most '
                             f'{VENUE.high:g} m', f'give this point in metres, {VENUE.cure}')
    points = [*zip((float(x) + 0.0 for x in flat[::2]), (float(y) + 0.0 for y in flat[1::2]), strict=True)]
    return (*points[:1], *(after for before, after in pairwise(points) if after != before))


def _check_simple(field: str, name: str, ring: Points, holes: tuple[Points, ...]) -> None:
    """Reject a polygon that crosses or touches itself, and holes that overlap or do not lie inside it."""
    from shapely import Polygon, is_valid, is_valid_reason
    polygon = Polygon(ring, holes)
    if not is_valid(polygon):
        reason, _, place = str(is_valid_reason(polygon)).rstrip(']').partition('[')
        at = f' at ({place.replace(" ", ", ")}) m' if place else ''
        crosses = 'elf-intersection' in reason
        what = 'it crosses or touches itself' if crosses else f'it is not a polygon ({reason.lower()})'
        raise FieldError(field, name, f'{what}{at}', _AROUND)
