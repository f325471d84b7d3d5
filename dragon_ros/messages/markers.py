"""Benches as the bytes of a MarkerArray, in either style: a template built once, patched in place by numpy."""
import struct
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.messages.cdr import Rows, Template, Writer, plane, stamp_number, stamp_of, strided, turns_of

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


class CubesTemplate(Template):
    """visualization_msgs/MarkerArray with one CUBE a bench; z = 0 is the middle of the benches."""

    def __init__(self, lengths_m: Floats, width_m: float, frame_id: str) -> None:
        """Lay the message out for benches of the given full lengths and width."""
        writer = Writer()
        writer.put('I', lengths_m.size)
        looks = [Look(BENCH, bench, CUBE, (length_m, width_m, BENCH_HEIGHT_M), _BODY if bench else _HEAD)
                 for bench, length_m in enumerate(lengths_m.tolist())]
        places = [put_marker(writer, look, frame_id) for look in looks]
        super().__init__(writer.finish())
        stride = places[1].stamp - places[0].stamp if len(places) > 1 else 0
        assert all(after.stamp - before.stamp == stride for before, after in pairwise(places))
        start, pose = places[0].stamp, places[0].pose - places[0].stamp
        self._markers = Rows(len(places), start, stride, {
            'stamp': ('<u8', 0), 'place': ('<c16', pose), 'turn': ('<c16', pose + 40)})

    def encode(self, t_ns: int, centre: Floats, axis: Floats) -> bytes:
        """Return the bytes for benches at ``centre`` (N, 2) m along ``axis`` (N, 2)."""
        return self.patched(lambda data: self._patch(data, t_ns, centre, axis))

    def _patch(self, data: memoryview, t_ns: int, centre: Floats, axis: Floats) -> None:
        markers = self._markers.of(data)
        markers['stamp'] = stamp_number(t_ns)
        markers['place'] = plane(centre)
        markers['turn'] = turns_of(axis)


class TrianglesTemplate(Template):
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
        self._half_length, self._half_width = 0.5 * lengths_m, 0.5 * width_m
        self._stamps = (faces.stamp, edges.stamp)
        data = writer.finish()
        self._points = [(corners, _points(memoryview(data), benches, start, len(corners), 0.5 * BENCH_HEIGHT_M + z_m))
                        for start, corners, z_m in ((faces.points, _FACES, 0.0), (edges.points, _EDGES, _ABOVE_M))]
        super().__init__(data)

    def encode(self, t_ns: int, centre: Floats, axis: Floats) -> bytes:
        """Return the bytes for benches at ``centre`` (N, 2) m along ``axis`` (N, 2)."""
        middle, forward = plane(centre), plane(axis)
        along, side = self._half_length * forward, 1j * self._half_width * forward
        front, rear = middle + along, middle - along
        places = (front + side, rear + side, rear - side, front - side)
        return self.patched(lambda data: self._patch(data, t_ns, places))

    def _patch(self, data: memoryview, t_ns: int, places: tuple[Array, ...]) -> None:
        for stamp in self._stamps:
            struct.pack_into('<II', data, stamp, *stamp_of(t_ns))
        for corners, points in self._points:
            benches = points.of(data)
            for n, corner in enumerate(corners):
                benches[f'place {n}'] = places[corner]


def _points(data: memoryview, benches: int, start: int, each: int, z_m: float) -> Rows:
    """Lay ``each`` points a bench out, all at one height, and return where their places are."""
    strided(data, '<f8', start + 16, 24, each * benches, 1)[:] = z_m
    return Rows(benches, start, 24 * each, {f'place {n}': ('<c16', 24 * n) for n in range(each)})
