"""Read the obstacles of a venue from a map, and the boundary: a polygon named ``inside``.

In a map with OpenStreetMap's tags, buildings, water, barriers and the like are obstacles, and so are polygons that were
added to it; streets are not. In any other map, all polygons and lines are obstacles. The property ``name`` of a feature
is its name; repeated names are numbered.
"""
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dragon_ros.core.errors import InputError
from dragon_ros.core.venue import INSIDE, Origin
from dragon_ros.core.words import counted
from dragon_ros.scenes.georeference import WORLD_M, placed, unbounded
from dragon_ros.scenes.maps import Drawing, Feature, read_drawing

# Keys of OpenStreetMap whose areas, or lines, block the way.
_BLOCKS = ('building', 'building:part', 'barrier', 'man_made', 'historic', 'waterway', 'water', 'power', 'advertising',
           'shop', 'tourism')
_BLOCKING = {('natural', 'water'), ('natural', 'cliff'), ('natural', 'tree_row'), ('amenity', 'fountain'),
             ('leisure', 'swimming_pool'), ('landuse', 'basin'), ('amenity', 'shelter'), ('amenity', 'kiosk'),
             ('railway', 'platform'), ('public_transport', 'platform')}
_OTHERS = ('highway', 'landuse', 'leisure', 'natural', 'amenity', 'railway', 'boundary', 'place', 'route',
           'public_transport', 'area:highway', 'emergency', 'aeroway', 'office', 'type')
_IDENTITIES = ('@id', 'id', 'osm_id', 'osm_way_id', 'full_id')     # that exporters write
_NO_BARRIER = ('kerb', 'entrance', 'gate', 'lift_gate', 'toll_booth', 'cattle_grid', 'border_control')
_LEAST_M2 = 1e-6        # smaller polygons, such as three points on a line, have no extent
_LONGEST_NAME = 80


@dataclass(frozen=True)
class Found:
    """The obstacles and the inside of a map, laid out as in a scene file, and notes on what was left out or changed."""

    values: dict[str, Any]
    notes: tuple[str, ...]


def venue_values(path: Path, origin: Origin | None = None) -> dict[str, Any]:
    """Return the obstacles and the inside of a map, in metres about an origin, laid out as in a scene file.

    Raises the errors of ``read_drawing`` and ``placed``.
    """
    return venue_of(read_drawing(path), origin).values


def venue_of(drawing: Drawing, origin: Origin | None, near: Any = None, *, has_track: bool = False) -> Found:
    """Return the obstacles and the inside of a map.

    ``near`` is a shapely geometry in metres; obstacles that do not touch it are left out. ``has_track`` tells whether
    the track is a line of this map, which then belongs to it, however far its obstacles are. Raises InputError.
    """
    kept, counts = _sorted(drawing)
    if not kept:
        raise InputError(f'{drawing.path}: it contains no obstacle{_in_brackets(counts)}; draw polygons, lines, or a '
                         f'polygon named {INSIDE}')
    geometries, far = _placed(drawing, kept, origin, near, has_track)
    builder = _Builder(drawing.path)
    for feature, geometry in zip(kept, geometries, strict=True):
        if geometry is not None:
            builder.add(feature, geometry)
    counts += builder.dropped
    notes = [f'not obstacles: {_summary(counts)}'] if counts else []
    notes += [far] if far else []
    notes += [f'repaired: {builder.repaired} outlines that cross themselves'] if builder.repaired else []
    return Found(builder.values, tuple(f'{drawing.path.name}: {note}' for note in notes))


def has_obstacles(drawing: Drawing) -> bool:
    """Return whether a map with the line of a track also holds polygons or walls that are obstacles."""
    return any(_is_area(one) or 'barrier' in one.tags for one in _sorted(drawing)[0])


def without_lines(drawing: Drawing) -> Drawing:
    """Return a map with the line of a track without its lines, except barriers."""
    return Drawing(drawing.path, tuple(one for one in drawing.features if _is_area(one) or _is_point(one)
                                       or 'barrier' in one.tags), drawing.crs, drawing.left_out)


def _is_area(feature: Feature) -> bool:
    return any(part.geom_type == 'Polygon' for part in _parts(feature.geometry))


def _is_point(feature: Feature) -> bool:
    return all(part.geom_type == 'Point' for part in _parts(feature.geometry))


def _sorted(drawing: Drawing) -> tuple[list[Feature], Counter[str]]:
    """Return the features that are obstacles, and counts of the others by kind."""
    kept, counts = list[Feature](), Counter(drawing.left_out)
    is_osm = any(key in one.tags for one in drawing.features for key in (*_BLOCKS[:3], *_OTHERS[:5]))
    for one in drawing.features:
        if _is_point(one):
            counts['points'] += 1
        elif is_osm and not _blocks(one) and not _is_drawn(one):
            counts[next((key for key in (*_BLOCKS, *_OTHERS) if key in one.tags), 'features without a kind')] += 1
        else:
            kept.append(one)
    return kept, counts


def _is_drawn(feature: Feature) -> bool:
    """Return whether a polygon has neither a kind nor an identity in OpenStreetMap, so that somebody drew it there."""
    return _is_area(feature) and not any(key in feature.tags for key in (*_BLOCKS, *_OTHERS, *_IDENTITIES))


def _blocks(feature: Feature) -> bool:
    tags = feature.tags
    if (feature.name or '').strip().lower() == INSIDE:
        return True
    if tags.get('barrier', '') in _NO_BARRIER or tags.get('building') == 'no' or tags.get('tunnel') == 'yes':
        return False
    if 'barrier' not in tags and not _is_area(feature) and 'waterway' not in tags and (
            tags.get('natural') not in ('cliff', 'tree_row')):
        return False
    if 'historic' in tags and not _is_area(feature):
        return False
    return any(key in tags for key in _BLOCKS) or any(tags.get(key) == value for key, value in _BLOCKING)


def _placed(drawing: Drawing, kept: list[Feature], origin: Origin | None, near: Any,
            has_track: bool) -> tuple[list[Any], str]:
    """Return the features in metres, None for those that are not near the track, and a note on these.

    Raises InputError if nothing in a map without the track is within 10 km of the track.
    """
    from shapely import bounds, box, distance
    where, geometries = str(drawing.path), [one.geometry for one in kept]
    if near is None or (drawing.crs is None and (origin is None or origin.map_m is None)):
        out = placed(where, geometries, drawing.crs, origin)
    else:
        out = unbounded(where, geometries, drawing.crs, origin)
    if near is None:
        return out, ''
    around = bounds(out)
    away_m = np.where(np.all(np.isfinite(around), axis=1), distance(box(*around.T), near), np.inf)
    if np.min(away_m) > WORLD_M and not has_track:
        raise InputError(f'{where}: it lies {np.min(away_m) / 1000:.4g} km from the track; the limit is '
                         f'{WORLD_M / 1000:g} km; check the origin ({origin}), and which map belongs to the track',
                         field='origin')
    is_kept = (away_m == 0) | [(one.name or '').strip().lower() == INSIDE for one in kept]
    nearest = f' (the nearest is {np.min(away_m):.0f} m away)' if 0 < np.min(away_m) < WORLD_M else ''
    far = counted(int(np.sum(~is_kept)), 'obstacle')
    note = f'left out: {far} far from the track{nearest}' if not np.all(is_kept) else ''
    return [one if is_one else None for one, is_one in zip(out, is_kept, strict=True)], note


def _in_brackets(counts: Counter[str]) -> str:
    return f' (not obstacles: {_summary(counts)})' if counts else ''


def _summary(counts: Counter[str]) -> str:
    """Return counts by kind in one line; the most frequent kinds come first."""
    listed = [f'{count} {what}' for what, count in counts.most_common(12)]
    more = sum(count for _, count in counts.most_common()[12:])
    return ', '.join([*listed, *([f'{more} others'] if more else [])])


class _Builder:
    """Collects obstacles with unique names."""

    def __init__(self, path: Path) -> None:
        self.path, self.repaired = path, 0
        self.values: dict[str, Any] = {'obstacles': []}
        self.dropped = Counter[str]()
        self._names = Counter[str]()

    def add(self, feature: Feature, geometry: Any) -> None:
        """Add a feature as the inside, or as obstacles, one per part."""
        name = (feature.name or '').strip()
        if name.lower() == INSIDE:
            self._inside(geometry)
            return
        usable = [part for whole in _parts(geometry) for part in self._usable(whole)]
        for n, part in enumerate(usable, 1):
            self._obstacle((name or f'obstacle {len(self.values["obstacles"]) + 1}') + (
                f' {n}' if len(usable) > 1 else ''), part)

    def _usable(self, part: Any) -> Iterator[Any]:
        """Yield a part, repaired if its outline crosses itself, without points and parts without extent."""
        from shapely import is_valid, make_valid
        if part.geom_type == 'Polygon' and not is_valid(part):
            self.repaired += 1
            pieces = [one for one in _parts(make_valid(part)) if one.geom_type == 'Polygon']
        else:
            pieces = [part]
        for one in pieces:
            if (one.geom_type == 'Polygon' and one.area > _LEAST_M2) or (
                    one.geom_type in ('LineString', 'LinearRing') and one.length > 0):
                yield one
            else:
                self.dropped['points' if one.geom_type == 'Point' else 'without extent'] += 1

    def _obstacle(self, name: str, part: Any) -> None:
        whole = _printable(name)
        self._names[whole] += 1
        unique = whole if self._names[whole] == 1 else f'{whole} {self._names[whole]}'
        while unique != whole and unique in self._names:
            self._names[whole] += 1
            unique = f'{whole} {self._names[whole]}'
        self._names[unique] += unique != whole
        if part.geom_type == 'Polygon':
            ring, *holes = [_points(one) for one in (part.exterior, *part.interiors)]
            one = {'kind': 'polygon', 'name': unique, 'points_m': ring, **({'holes_m': holes} if holes else {})}
        else:
            one = {'kind': 'line', 'name': unique, 'points_m': _points(part)}
        self.values['obstacles'].append(one)

    def _inside(self, geometry: Any) -> None:
        if 'inside' in self.values:
            raise InputError(f'{self.path}: two features are named {INSIDE}; keep one')
        parts = list(_parts(geometry))
        if len(parts) != 1 or parts[0].geom_type != 'Polygon':
            raise InputError(f'{self.path}: {INSIDE}: it is a {geometry.geom_type} of {len(parts)} parts, not one '
                             'polygon; join its parts into one')
        self.values['inside'], *holes = [_points(one) for one in (parts[0].exterior, *parts[0].interiors)]
        self.values['obstacles'] += [{'kind': 'polygon', 'name': f'hole {n} of {INSIDE}', 'points_m': hole}
                                     for n, hole in enumerate(holes, 1)]


def _printable(name: str) -> str:
    """Return a name as the venue accepts it: printable, on one line, not too long."""
    text = ' '.join(''.join(letter if letter.isprintable() else ' ' for letter in name).split())
    return text[:_LONGEST_NAME] or 'obstacle'


def _parts(geometry: Any) -> Iterator[Any]:
    parts: Iterable[Any] = getattr(geometry, 'geoms', [geometry])
    for part in parts:
        if hasattr(part, 'geoms'):
            yield from _parts(part)
        else:
            yield part


def _points(line: Any) -> list[list[float]]:
    """Return the points of a line in the plane."""
    from shapely import get_coordinates
    found: list[list[float]] = get_coordinates(line).tolist()
    return found
