"""Handles and benches as entities of a simulator, in arrays: names, states, and filters by name, tag and region."""
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.bags.read.reader import Message
from dragon_ros.core.chain.dragon import AnyDragon
from dragon_ros.core.errors import FieldError, InputError
from dragon_ros.core.geometry.rectangles import Benches, benches_of
from dragon_ros.core.limits import COORDINATE_M, FILTER_CHARACTERS, FILTER_POINTS, FILTER_S
from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.core.step import Frame
from dragon_ros.messages.decode import MessageError, Poses, is_empty_array, read_multi_array
from dragon_ros.messages.observation import observation_of, placed, read_benches, read_handles

_TINY_M = 1e-100      # coordinates below this are taken as 0
TOPICS = ('handles', 'benches', 'velocities', 'accelerations')     # topics from which a dragon's state is read


@dataclass(frozen=True)
class Bodies:
    """All handles, followed by all benches, at one instant.

    ``place_m``, the unit vector ``axis`` towards the head, ``velocity_m_s`` and ``acceleration_m_s2`` have the shape
    (M, 2); the derivatives of the yaw have the shape (M,). Unknown derivatives are NaN. ``benches`` is None if only
    handles are known.
    """

    t_ns: int
    frame_id: str
    benches: Benches | None
    place_m: Floats
    axis: Floats
    velocity_m_s: Floats
    yaw_rate_rad_s: Floats
    acceleration_m_s2: Floats
    yaw_acceleration_rad_s2: Floats

    @property
    def names(self) -> list[str]:
        """Unique names, such as handle_0 and bench_0 at the head."""
        return [f'handle_{i}' for i in range(self.handle_count)] + [f'bench_{i}' for i in range(self.bench_count)]

    @property
    def handle_count(self) -> int:
        """Number of handles."""
        return len(self.place_m) - self.bench_count

    @property
    def bench_count(self) -> int:
        """Number of benches."""
        return 0 if self.benches is None else len(self.benches.centre)

    def tags_of(self, entity: int) -> list[str]:
        """Return the tags of an entity: bench or handle, and head or tail if it is at that end of the dragon."""
        is_bench = entity >= self.handle_count
        i, count = (entity - self.handle_count, self.bench_count) if is_bench else (entity, self.handle_count)
        return ['bench' if is_bench else 'handle'] + ['head'] * (i == 0) + ['tail'] * (i == count - 1)

    def description_of(self, entity: int) -> str:
        """Return a one-line description of an entity."""
        if self.benches is None or entity < self.handle_count:
            return f'handle {entity} of {self.handle_count}, counted from the head'
        i = entity - self.handle_count
        return (f'bench {i} of {self.bench_count}, counted from the head: {2 * self.benches.half_length[i]:g} m by '
                f'{2 * self.benches.half_width[i]:g} m')


def bodies_of_frame(frame: Frame, dragon: AnyDragon, frame_id: str) -> Bodies:
    """Return the bodies of a frame; velocities and accelerations are known if their effects are on."""
    return _bodies(frame.t_ns, frame_id, (frame.chain.p, frame.axis), benches_of(frame.chain, dragon, frame.axis),
                   (frame.velocity_m_s, frame.acceleration_m_s2))


def bodies_of_messages(last: Mapping[str, Message]) -> Bodies | None:
    """Return the bodies described by the last message on each topic, or None if there are no handles.

    Benches must have the stamp of the handles; messages without a stamp must have the log time of the handles. Raises
    MessageError.
    """
    if 'handles' not in last:
        return None
    poses = read_handles(last['handles'].data)
    p, axis = placed(poses.poses)
    known = (_same_tick('velocities', last, len(p)), _same_tick('accelerations', last, len(p)))
    return _bodies(poses.t_ns, poses.frame_id, (p, axis[:-1]), _benches(poses, last), known)


def _benches(poses: Poses, last: Mapping[str, Message]) -> Benches | None:
    if 'benches' not in last or is_empty_array(last['benches'].data):
        return None
    shown = read_benches(last['benches'].data)
    return observation_of(poses, shown).benches if shown.t_ns == poses.t_ns else None


def _same_tick(name: str, last: Mapping[str, Message], handles: int) -> Floats | None:
    """Return the first two columns of an unstamped message, or None unless it has the log time of the handles."""
    if name not in last or last[name].t_ns != last['handles'].t_ns:
        return None
    labels, values = read_multi_array(last[name].data)
    if values.ndim != 2 or values.shape[0] != handles or values.shape[1] < 2:
        raise MessageError(f'{name}: it has {labels} of shape {values.shape}; expected {handles} rows of x, y and size')
    return values[:, :2]


def _bodies(t_ns: int, frame_id: str, links: tuple[Floats, Floats], benches: Benches | None,
            known: tuple[Floats | None, Floats | None]) -> Bodies:
    """Return the bodies, given the handles, the directions of the links and any known velocities and accelerations.

    A rigid link of length L in direction e has the yaw rate w = e x (v[i] - v[i+1]) / L, and its derivative is
    w' = e x (a[i] - a[i+1]) / L.
    """
    (p, axis), (v, a) = links, (np.full_like(links[0], np.nan) if each is None else each for each in known)
    length = np.hypot(*(p[:-1] - p[1:]).T)
    with np.errstate(divide='ignore', invalid='ignore'):
        w, w_rate = (_cross(axis, each[:-1] - each[1:]) / length for each in (v, a))
    parts = [(p, v, a, *(np.concatenate((each, each[-1:])) for each in (axis, w, w_rate)))]
    if benches is not None:
        off = benches.centre - 0.5 * (p[:-1] + p[1:])
        side = np.stack((-off[:, 1], off[:, 0]), axis=-1)
        parts.append((benches.centre, 0.5 * (v[:-1] + v[1:]) + w[:, None] * side,
                      0.5 * (a[:-1] + a[1:]) + w_rate[:, None] * side - (w**2)[:, None] * off, benches.axis, w, w_rate))
    place, velocity, acceleration, axis, w, w_rate = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Bodies(t_ns, frame_id, benches, place, axis, velocity, w, acceleration, w_rate)


def _cross(a: Floats, b: Floats) -> Floats:
    out: Floats = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out


class Region(NamedTuple):
    """All points of the plane within a given distance, in metres, of a shapely geometry."""

    shape: Any
    within_m: float = 0.0


def sphere(points: Floats) -> Region:
    """Return the part of the plane inside a sphere, given its centre and the point (radius, unused, unused)."""
    _check(len(points) == 2 and points[1, 0] >= 0, points,
           'a sphere needs its centre, and a second point whose x is its radius, at least 0 m')
    from shapely import Point
    (x, y, z), radius = points[0].tolist(), float(points[1, 0])
    return Region(Point(x, y), float(np.sqrt(radius**2 - z**2))) if abs(z) <= radius else Region(Point())


def box(points: Floats) -> Region:
    """Return the part of the plane inside a box, given two opposite corners (shape (2, 3))."""
    _check(len(points) == 2, points, 'a box needs two opposite corners')
    import shapely
    low, high = _without_tiny(points.min(axis=0)), _without_tiny(points.max(axis=0))
    return Region(shapely.box(*low[:2], *high[:2]) if low[2] <= 0 <= high[2] else shapely.Point())


def convex_hull(points: Floats) -> Region:
    """Return the part of the plane inside the convex hull of points (shape (n, 3)) that are not collinear."""
    _check(3 <= len(points) <= FILTER_POINTS, points, f'a hull needs 3 to {FILTER_POINTS} points')
    _check(np.linalg.matrix_rank(points - points[0]) > 1, points, 'the points lie on one line')
    from shapely import MultiPoint
    above, below = points[points[:, 2] > 0], points[points[:, 2] < 0]
    rise, fall = above[:, None, 2:], -below[None, :, 2:]
    crossings = (above[:, None, :2] * fall + below[None, :, :2] * rise) / (rise + fall)
    corners = _without_tiny(np.concatenate((points[points[:, 2] == 0, :2], crossings.reshape(-1, 2))))
    return Region(MultiPoint(corners).convex_hull)


def _without_tiny(values: Floats) -> Floats:
    """Return coordinates with 0 in place of tiny ones: GEOS divides by squares of lengths, which would underflow."""
    return np.where(np.abs(values) < _TINY_M, 0.0, values)


def _check(is_valid: Any, points: Floats, limit: str) -> None:
    if not (is_valid and (np.abs(points) <= COORDINATE_M).all()):
        raise FieldError('bounds.points', points.tolist(), limit, f'give numbers up to {COORDINATE_M:g}')


def chosen(bodies: Bodies, pattern: str, tags: Collection[str], every: bool, region: Region | None) -> list[int]:
    """Return the entities that pass all filters, in order; an empty filter accepts every entity. Raises InputError.

    ``pattern`` is a regular expression that must match the whole name. An entity must have one of the ``tags`` (all of
    them if ``every`` is true), and it must overlap or touch the ``region``.
    """
    names, wanted = bodies.names, set(tags)
    found = range(len(names)) if region is None else np.flatnonzero(_overlapping(bodies, region)).tolist()
    if wanted:
        found = [i for i in found if (wanted.issubset if every else wanted.intersection)(bodies.tags_of(i))]
    return _matching(pattern, names, found) if pattern else list(found)


def _overlapping(bodies: Bodies, region: Region) -> Array:
    import shapely
    shapes = [shapely.points(bodies.place_m[:bodies.handle_count])]
    if bodies.benches is not None:
        shapes.append(shapely.polygons(bodies.benches.corners))
    with np.errstate(invalid='ignore'):     # raised by old versions of GEOS if the region has no width
        out: Array = shapely.distance(np.concatenate(shapes), region.shape) <= region.within_m
    return out


def _matching(pattern: str, names: Sequence[str], found: Sequence[int]) -> list[int]:
    """Return the entities whose whole name matches, using ``regex`` because Python's ``re`` has no time limit."""
    import regex
    if len(pattern) > FILTER_CHARACTERS:
        raise InputError(f'filter: it has {len(pattern)} characters; the limit is {FILTER_CHARACTERS}')
    end_s = time.monotonic() + FILTER_S
    try:
        matches = regex.compile(pattern).fullmatch
        return [i for i in found if matches(names[i], timeout=_left_s(end_s))]
    except regex.error as error:
        limit, cure = f'it is not a regular expression: {error}', 'escape special characters'
    except TimeoutError:
        limit, cure = f'it takes more than {FILTER_S:g} s to match', 'use a simpler expression'
    raise FieldError('filter', pattern, limit, cure)


def _left_s(end_s: float) -> float:
    """Return the remaining time in seconds. Raises TimeoutError if no time remains."""
    left_s = end_s - time.monotonic()
    if left_s <= 0:
        raise TimeoutError
    return left_s
