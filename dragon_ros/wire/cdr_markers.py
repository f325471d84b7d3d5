"""Benches as the bytes of a MarkerArray, in either style: a template built once, patched in place by numpy."""
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dragon_ros.core.types import Floats
from dragon_ros.wire.cdr import Writer, half_turns, stamp_of, strided

CUBE, LINE_LIST, TRIANGLE_LIST = 1, 5, 11
BENCH_HEIGHT_M = 0.1
BENCH, EDGES = 'bench', 'bench edges'       # namespaces of the markers
_EDGE_WIDTH_M, _ABOVE_M = 0.02, 0.002       # edges stand a little above the faces
_HEAD, _BODY, _BLACK = (0.84, 0.37, 0.0, 1.0), (0.0, 0.45, 0.70, 1.0), (0.0, 0.0, 0.0, 1.0)     # Okabe-Ito
_FACE = np.array([0, 1, 2, 0, 2, 3])        # corners of the two triangles of a bench, counterclockwise
_EDGE = np.array([0, 1, 1, 2, 2, 3, 3, 0])
Colour = tuple[float, float, float, float]


@dataclass(frozen=True)
class Look:
    """How one marker looks; ``points`` is how many there is room for, ``colours`` (K, 4) are those of the triangles."""

    ns: str
    id: int
    type: int
    scale: tuple[float, float, float]
    colour: Colour
    points: int = 0
    colours: tuple[Colour, ...] = ()


class Places(NamedTuple):
    """Offsets of what changes in a marker."""

    stamp: int
    pose: int
    points: int


def put_marker(writer: Writer, look: Look, frame_id: str) -> Places:
    """Append one Marker and return the offsets of its stamp, pose and points."""
    stamp = writer.header(frame_id)
    writer.text(look.ns)
    writer.put('i', look.id, look.type, 0)
    pose = writer.put('d', 0, 0, 0, 0, 0, 0, 1)
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
    writer.text('')                 # text
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
        self._pose = strided(self._data, '<f8', places[0].pose, stride, len(places), 7)

    def encode(self, t_ns: int, centre: Floats, axis: Floats) -> bytes:
        """Return the bytes for benches at ``centre`` (N, 2) m along ``axis`` (N, 2)."""
        self._stamp[:] = stamp_of(t_ns)
        self._pose[:, :2] = centre
        self._pose[:, 5:] = half_turns(axis)
        return bytes(self._data)


class TrianglesTemplate:
    """visualization_msgs/MarkerArray with the tops of all benches as one TRIANGLE_LIST and one LINE_LIST of edges.

    The two triangles of a bench share the diagonal from its front left corner to its rear right one.
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
        self._faces = np.frombuffer(self._data, '<f8', 18 * benches, faces.points).reshape(benches, 6, 3)
        self._edges = np.frombuffer(self._data, '<f8', 24 * benches, edges.points).reshape(benches, 8, 3)
        self._faces[..., 2] = 0.5 * BENCH_HEIGHT_M
        self._edges[..., 2] = 0.5 * BENCH_HEIGHT_M + _ABOVE_M
        self._half = 0.5 * np.stack((lengths_m, np.full(benches, width_m)))[..., None]

    def encode(self, t_ns: int, centre: Floats, axis: Floats) -> bytes:
        """Return the bytes for benches at ``centre`` (N, 2) m along ``axis`` (N, 2)."""
        for stamp in self._stamps:
            stamp[:] = stamp_of(t_ns)
        along, side = self._half * axis
        side = np.stack((-side[:, 1], side[:, 0]), axis=1)
        front, rear = centre + along, centre - along
        corners = np.stack((front + side, rear + side, rear - side, front - side), axis=1)
        self._faces[..., :2] = corners[:, _FACE]
        self._edges[..., :2] = corners[:, _EDGE]
        return bytes(self._data)
