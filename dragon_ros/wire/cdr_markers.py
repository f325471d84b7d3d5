"""Benches as the bytes of a MarkerArray, in either style: a template built once, patched in place by numpy."""
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dragon_ros.core.types import Array, Floats
from dragon_ros.wire.cdr import Writer, plane, stamp_of, strided, turns_of

CUBE, LINE_LIST, TRIANGLE_LIST = 1, 5, 11
BENCH_HEIGHT_M = 0.1
BENCH, EDGES = 'bench', 'bench edges'       # namespaces of the markers
_EDGE_WIDTH_M, _ABOVE_M = 0.02, 0.002       # edges stand a little above the faces
_HEAD, _BODY, _BLACK = (0.84, 0.37, 0.0, 1.0), (0.0, 0.45, 0.70, 1.0), (0.0, 0.0, 0.0, 1.0)     # Okabe-Ito
_FACES, _EDGES = (0, 1, 2, 0, 2, 3), (0, 1, 1, 2, 2, 3, 3, 0)      # corners of the triangles and lines of a bench
Colour = tuple[float, float, float, float]


@dataclass(frozen=True)
class Look:
    """How one marker looks and where it is.

    ``turn`` is (z, w) of its quaternion, ``points`` how many there is room for, ``colours`` those of the triangles.
    """

    ns: str
    id: int
    type: int
    scale: tuple[float, float, float]
    colour: Colour
    points: int = 0
    colours: tuple[Colour, ...] = ()
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float] = (0.0, 1.0)
    text: str = ''
    action: int = 0


class Places(NamedTuple):
    """Offsets of what changes in a marker."""

    stamp: int
    pose: int
    points: int


def put_marker(writer: Writer, look: Look, frame_id: str, t_ns: int = 0) -> Places:
    """Append one Marker and return the offsets of its stamp, pose and points."""
    stamp = writer.header(frame_id, t_ns)
    writer.text(look.ns)
    writer.put('i', look.id, look.type, look.action)
    pose = writer.put('d', *look.place, 0, 0, *look.turn)
    writer.put('d', *look.scale)
    writer.put('f', *look.colour)
    writer.put('i', 0, 0)           # lifetime: for ever
    writer.put('?', False)          # frame_locked
    writer.put('I', look.points)
    points = writer.room('d', 3 * look.points)
    writer.put('I', len(look.colours))
    writer.put('f', *(part for colour in look.colours for part in colour))
    writer.text('')                 # texture_resource
    writer.header('')               # texture
    writer.text('')
    writer.put('I', 0, 0)           # texture data, uv_coordinates
    writer.text(look.text)
    writer.text('')                 # mesh_resource
    writer.text('')                 # mesh_file
    writer.put('I', 0)
    writer.put('?', False)          # mesh_use_embedded_materials
    return Places(stamp, pose, points)


class CubesTemplate:
    """visualization_msgs/MarkerArray with one CUBE a bench; z = 0 is the middle of the benches."""

    def __init__(self, lengths_m: Floats, width_m: float, frame_id: str) -> None:
        """Lay the message out for benches of the given full lengths and width."""
        writer = Writer()
        writer.put('I', lengths_m.size)
        looks = [Look(BENCH, bench, CUBE, (length_m, width_m, BENCH_HEIGHT_M), _BODY if bench else _HEAD)
                 for bench, length_m in enumerate(lengths_m.tolist())]
        places = [put_marker(writer, look, frame_id) for look in looks]
        self._data = writer.finish()
        stride = places[1].stamp - places[0].stamp if len(places) > 1 else len(self._data)
        assert all(after.stamp - before.stamp == stride for before, after in pairwise(places))
        self._stamp = strided(self._data, '<u4', places[0].stamp, stride, len(places), 2)
        self._place = strided(self._data, '<c16', places[0].pose, stride, len(places), 1)[:, 0]
        self._turn = strided(self._data, '<c16', places[0].pose + 40, stride, len(places), 1)[:, 0]

    def encode(self, t_ns: int, centre: Floats, axis: Floats) -> bytes:
        """Return the bytes for benches at ``centre`` (N, 2) m along ``axis`` (N, 2)."""
        self._stamp[:] = stamp_of(t_ns)
        self._place[:] = plane(centre)
        self._turn[:] = turns_of(axis)
        return bytes(self._data)


class TrianglesTemplate:
    """visualization_msgs/MarkerArray with the tops of all benches as one TRIANGLE_LIST and one LINE_LIST of edges.

    Corners are numbered counterclockwise from the front left one.
    """

    def __init__(self, lengths_m: Floats, width_m: float, frame_id: str) -> None:
        """Lay the message out for benches of the given full lengths and width."""
        benches = lengths_m.size
        writer = Writer()
        writer.put('I', 2)
        faces = put_marker(writer, Look(BENCH, 0, TRIANGLE_LIST, (1.0, 1.0, 1.0), _BODY, 6 * benches,
                                        (_HEAD,) * 2 + (_BODY,) * 2 * (benches - 1)), frame_id)
        edges = put_marker(writer, Look(EDGES, 0, LINE_LIST, (_EDGE_WIDTH_M, 0.0, 0.0), _BLACK, 8 * benches), frame_id)
        self._data = writer.finish()
        self._stamps = [np.frombuffer(self._data, '<u4', 2, marker.stamp) for marker in (faces, edges)]
        self._half_length, self._half_width = 0.5 * lengths_m, 0.5 * width_m
        self._points: list[list[Array]] = [[], [], [], []]      # of each corner, where it is among the points
        for start, corners, z_m in ((faces.points, _FACES, 0.0), (edges.points, _EDGES, _ABOVE_M)):
            each = 24 * len(corners)
            for n, corner in enumerate(corners):
                strided(self._data, '<f8', start + 24 * n + 16, each, benches, 1)[:] = 0.5 * BENCH_HEIGHT_M + z_m
                self._points[corner].append(strided(self._data, '<c16', start + 24 * n, each, benches, 1)[:, 0])

    def encode(self, t_ns: int, centre: Floats, axis: Floats) -> bytes:
        """Return the bytes for benches at ``centre`` (N, 2) m along ``axis`` (N, 2)."""
        for stamp in self._stamps:
            stamp[:] = stamp_of(t_ns)
        middle, forward = plane(centre), plane(axis)
        along, side = self._half_length * forward, 1j * self._half_width * forward
        front, rear = middle + along, middle - along
        for points, corner in zip(self._points, (front + side, rear + side, rear - side, front - side), strict=True):
            for point in points:
                point[:] = corner
        return bytes(self._data)
