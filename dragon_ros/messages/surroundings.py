"""Read surroundings from the markers of a venue or from an occupancy grid."""
from cmath import exp
from dataclasses import dataclass
from math import atan2

import numpy as np

from dragon_ros.core.geometry.occupancy import outlines
from dragon_ros.core.geometry.venue import LINE, WITHIN, PlanePose, Surroundings
from dragon_ros.core.limits import MAP_BYTES, MAP_EDGES
from dragon_ros.core.numerics.types import Complexes, Floats
from dragon_ros.core.venue import FARTHEST_M, INSIDE
from dragon_ros.messages.decode import Markers, MessageError, Reader, read_marker_array
from dragon_ros.messages.markers import ADD, LINE_LIST, LINE_STRIP, TEXT_VIEW_FACING
from dragon_ros.messages.venue_markers import EDGES, KINDS, NAMES

MAP = 'map'             # name of the obstacles from a grid
_FLAT = 1e-6            # limit on the sine of a plane's tilt
_SIDES = {text: side for side, text in KINDS.items()}


@dataclass(frozen=True)
class Located:
    """Surroundings and their frame; ``left_out`` describes the parts of the message that were not used.

    ``around`` is None if there are no obstacles. ``frame_id`` is None for the dragon's frame, whatever its name.
    """

    frame_id: str | None
    around: Surroundings | None
    left_out: str = ''


def read_venue(data: bytes) -> Located:
    """Return the obstacles in a MarkerArray: the LINE_LIST and LINE_STRIP markers in the namespace ``venue``.

    The text of a marker gives its kind (polygon, line or inside); a marker without text is a line. An obstacle is named
    by the text marker with the same id in the namespace ``venue names``. Raises MessageError if a marker is invalid or
    if the markers are in several frames.
    """
    markers = read_marker_array(data)
    of = np.array([run.ns for run in markers.runs], dtype=object)[markers.run_of]
    added = markers.action == ADD
    lines = (markers.type == LINE_LIST) | (markers.type == LINE_STRIP)
    drawn = np.flatnonzero((of == EDGES) & added & lines)
    others = int(np.count_nonzero((of == EDGES) & added & ~lines))
    what, are = ('marker', 'is') if others == 1 else ('markers', 'are')
    left_out = f'{others} {what} in the namespace {EDGES} {are} neither LINE_LIST nor LINE_STRIP' if others else ''
    if not drawn.size:
        return Located('', None, left_out)
    frames = {run.frame_id for n, run in enumerate(markers.runs) if n in set(markers.run_of[drawn].tolist())}
    if len(frames) > 1:
        raise MessageError(f'venue: its markers are in several frames: {", ".join(sorted(frames))}')
    named = np.flatnonzero((of == NAMES) & added & (markers.type == TEXT_VIEW_FACING))
    names = {int(markers.id[n]): markers.text_of(n) for n in named.tolist()}
    return Located(frames.pop(), _surroundings(markers, drawn.tolist(), names), left_out)


def _surroundings(markers: Markers, drawn: list[int], names: dict[int, str]) -> Surroundings | None:
    """Return the surroundings described by markers."""
    starts, stops, owner, titles, sides = [], [], [], list[str](), list[int]()
    count = 0
    for marker in drawn:
        start, stop = _edges(markers, marker)
        apart = start != stop
        count += int(np.count_nonzero(apart))
        if count > MAP_EDGES:
            raise MessageError(f'venue: it has more than {MAP_EDGES} edges; simplify its obstacles')
        if not np.any(apart):
            continue
        number = int(markers.id[marker])
        starts.append(start[apart])
        stops.append(stop[apart])
        owner.append(np.full(starts[-1].size, len(titles)))
        titles.append(names.get(number) or f'obstacle {number}')
        sides.append(_SIDES.get(markers.text_of(marker), WITHIN if titles[-1] == INSIDE else LINE))
    if not titles:
        return None
    start, stop = np.concatenate(starts), np.concatenate(stops)
    return Surroundings(tuple(titles), start, stop, np.concatenate(owner), np.array(sides))


def _edges(markers: Markers, marker: int) -> tuple[Complexes, Complexes]:
    """Return the edges of a marker, with its pose applied. Raises MessageError."""
    points = markers.points_of(marker)
    size: Floats = np.abs(points[:, :2])
    if not np.max(size, initial=0.0) < FARTHEST_M:
        raise MessageError(f'venue: marker {int(markers.id[marker])} has a point that is not finite or is beyond '
                           f'{FARTHEST_M:g} m')
    shift, turn = plane_pose_of(markers.poses[marker], 'venue: pose')
    z: Complexes = np.ascontiguousarray(points[:, :2], dtype=np.float64).view(np.complex128).ravel()
    z = z if (shift, turn) == (0, 1) else shift + z * turn
    return (z[:-1], z[1:]) if markers.type[marker] == LINE_STRIP else (z[:len(z) // 2 * 2:2], z[1::2])


def plane_pose_of(pose: Floats, what: str) -> PlanePose:
    """Return a pose (shape (7,)) in the plane, ignoring its height. Raises MessageError for a tilted or infinite pose.

    A quaternion of zeros, which many programs send, means no rotation.
    """
    x, y, _, *quaternion = pose.tolist()
    if not all(abs(one) < FARTHEST_M for one in pose.tolist()):
        raise MessageError(f'{what}: {pose.tolist()} is not finite or is beyond {FARTHEST_M:g} m')
    a, b, c, w = quaternion if any(quaternion) else (0.0, 0.0, 0.0, 1.0)
    size = a * a + b * b + c * c + w * w
    if a * a + b * b > _FLAT**2 * size:
        raise MessageError(f'{what}: it is tilted; only poses in the plane are supported')
    return complex(x, y), 1.0 + 0j if c == 0 else exp(2j * atan2(c, w))


@dataclass(frozen=True)
class CellRules:
    """The rule for obstacles in a grid: cells of at least ``occupied`` percent and, optionally, unknown cells."""

    occupied: int = 65
    unknown: bool = False


def read_grid(data: bytes, rules: CellRules) -> Located:
    """Return the obstacles in a nav_msgs/OccupancyGrid: the boundaries of its occupied cells.

    Negative values mark unknown cells. Raises MessageError for an invalid grid, and InputError for a grid that
    exceeds a limit.
    """
    if len(data) > MAP_BYTES:
        raise MessageError(f'map: it has {len(data)} bytes; the limit is {MAP_BYTES}; reduce its resolution')
    reader = Reader(data)
    _, frame_id = reader.stamp_ns(), reader.text()
    reader.take('i'), reader.take('I')          # map_load_time
    resolution_m, columns, rows = reader.take('f'), reader.take('I'), reader.take('I')
    shift, turn = plane_pose_of(reader.array('d', 7), 'map: origin')
    count = reader.take('I')
    if count != columns * rows:
        raise MessageError(f'map: it has {count} cells; its width and height are {columns} and {rows}')
    if not 1e-4 <= resolution_m <= 1e4:
        raise MessageError(f'map: resolution: {resolution_m:g} m is outside 0.0001 to 10000 m')
    cells = reader.array('b', count).reshape(rows, columns)
    occupied = cells >= rules.occupied
    if rules.unknown:
        occupied |= cells < 0
    cell_m = float(f'{resolution_m:.7g}')       # for example, exactly 0.05 instead of the nearest 32-bit float
    return Located(frame_id, outlines(occupied, MAP, shift, turn * cell_m) if count else None)
