"""Markers as CDR bytes: benches (from a template that numpy patches in place), contacts, the track and trails.

MarkerArrays are encoded by hand for speed: for 223 benches, rclpy takes 6,700 µs, and patching a template takes 4 µs.
"""
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.core.scene import Scene
from dragon_ros.messages.cdr import (
    Room,
    RowLayout,
    Template,
    Writer,
    half_turns,
    plane,
    put_stamps,
    strided,
    turns_of,
)

CUBE, SPHERE, LINE_STRIP, LINE_LIST, TEXT_VIEW_FACING, TRIANGLE_LIST = 1, 2, 4, 5, 9, 11
ADD, DELETE, DELETE_ALL = 0, 2, 3
BENCH_HEIGHT_M = 0.1
BENCH, EDGES = 'bench', 'bench edges'       # namespaces of the markers
_EDGE_WIDTH_M, _ABOVE_M = 0.02, 0.002       # edges are drawn slightly above the faces
_TRACK_WIDTH_M, _TRACK_Z_M, _TRAIL_WIDTH_M = 0.03, -0.06, 0.04      # the track is just below the benches
_PROUD = 1.1        # height of a red bench relative to the bench that it covers
Colour = tuple[float, float, float, float]
# Okabe-Ito colours, which colour-blind people can distinguish.
VERMILION: Colour = (0.84, 0.37, 0.0, 1.0)
BLUE: Colour = (0.0, 0.45, 0.70, 1.0)
BLACK: Colour = (0.0, 0.0, 0.0, 1.0)
YELLOW: Colour = (0.94, 0.89, 0.26, 1.0)
_TRACK_GREY, _TRAIL_GREY = (0.6, 0.6, 0.6, 1.0), (0.4, 0.4, 0.4, 1.0)
_NO_SCALE, _NO_COLOUR = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
_HEAD, _BODY = VERMILION, BLUE
_DIFFERENT = 3      # number of cubes that are laid out one by one; others repeat the bytes of the second
_FACES, _EDGES = (0, 1, 2, 0, 2, 3), (0, 1, 1, 2, 2, 3, 3, 0)      # corners of a bench's triangles and lines


@dataclass(frozen=True)
class MarkerSpec:
    """One marker: its shape, place and appearance.

    ``turn`` is (z, w) of the quaternion, ``points`` is the number of points, and ``colours`` are the triangles'
    colours.
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
    action: int = ADD


class Offsets(NamedTuple):
    """The offsets of the fields of a marker that change from tick to tick or from marker to marker."""

    stamp: int
    id: int
    pose: int
    scale: int
    points: int


def put_marker(writer: Writer, spec: MarkerSpec, frame_id: str, t_ns: int = 0) -> Offsets:
    """Append one Marker with all points set to zero; return the offsets of its fields."""
    stamp = writer.header(frame_id, t_ns)
    writer.text(spec.ns)
    number = writer.put('i', spec.id, spec.type, spec.action)
    pose = writer.put('d', *spec.place, 0, 0, *spec.turn)
    scale = writer.put('d', *spec.scale)
    writer.put('f', *spec.colour)
    writer.put('i', 0, 0)           # lifetime: unlimited
    writer.put('?', False)          # frame_locked
    writer.put('I', spec.points)
    points = writer.room('d', 3 * spec.points)
    writer.put('I', len(spec.colours))
    writer.put('f', *(part for colour in spec.colours for part in colour))
    writer.text('')                 # texture_resource
    writer.header('')               # texture
    writer.text('')
    writer.put('I', 0, 0)           # texture data, uv_coordinates
    writer.text(spec.text)
    writer.text('')                 # mesh_resource
    writer.text('')                 # mesh_file
    writer.put('I', 0)
    writer.put('?', False)          # mesh_use_embedded_materials
    return Offsets(stamp, number, pose, scale, points)


class CubesTemplate(Template):
    """A visualization_msgs/MarkerArray with one CUBE per bench, centred at z = 0."""

    def __init__(self, lengths_m: Floats, width_m: float, frame_id: str) -> None:
        """Lay out the message for benches with these full lengths and this common width."""
        writer = Writer()
        writer.put('I', lengths_m.size)
        specs = [MarkerSpec(BENCH, bench, CUBE, (length_m, width_m, BENCH_HEIGHT_M), _BODY if bench else _HEAD)
                 for bench, length_m in enumerate(lengths_m[:_DIFFERENT].tolist())]
        offsets = [put_marker(writer, spec, frame_id) for spec in specs]
        data = writer.finish()
        start, number, pose, scale, _ = offsets[0]
        stride = offsets[1].stamp - start if len(offsets) > 1 else 0
        assert all(after.stamp - before.stamp == stride for before, after in pairwise(offsets))
        if alike := lengths_m.size - len(offsets):
            second = data[offsets[1].stamp:offsets[2].stamp]
            data[offsets[1].stamp:offsets[1].stamp] = second * alike
        self._markers = RowLayout(lengths_m.size, start, stride, {
            'stamp': ('<u8', 0), 'id': ('<i4', number - start), 'place': ('<c16', pose - start),
            'turn': ('<c16', pose - start + 40), 'length': ('<f8', scale - start)})
        markers = self._markers.of(Room(memoryview(data)))
        markers['id'], markers['length'] = np.arange(lengths_m.size), lengths_m
        super().__init__(data)

    def fill(self, room: Room, stamps: int | Array, *values: Floats) -> None:
        """Patch messages; ``values`` are the centres (m) and axes of the benches, both of shape (..., N, 2)."""
        centre, axis = values
        markers = self._markers.of(room)
        markers['stamp'] = stamps
        markers['place'] = plane(centre)
        markers['turn'] = turns_of(axis)


class TrianglesTemplate(Template):
    """A MarkerArray with the top faces of all benches as a TRIANGLE_LIST and their edges as a LINE_LIST.

    Corners are numbered counterclockwise from the front left corner.
    """

    def __init__(self, lengths_m: Floats, width_m: float, frame_id: str) -> None:
        """Lay out the message for benches with these full lengths and this common width."""
        benches = lengths_m.size
        writer = Writer()
        writer.put('I', 2)
        faces = put_marker(writer, MarkerSpec(BENCH, 0, TRIANGLE_LIST, (1.0, 1.0, 1.0), _BODY, 6 * benches,
                                              (_HEAD,) * 2 + (_BODY,) * 2 * (benches - 1)), frame_id)
        edges = put_marker(writer, MarkerSpec(EDGES, 0, LINE_LIST, (_EDGE_WIDTH_M, 0.0, 0.0), BLACK, 8 * benches),
                           frame_id)
        self._half_length, self._half_width = 0.5 * lengths_m, 0.5 * width_m
        self._stamps = (faces.stamp, edges.stamp)
        data = writer.finish()
        self._points = [(corners, _points(memoryview(data), benches, start, len(corners), 0.5 * BENCH_HEIGHT_M + z_m))
                        for start, corners, z_m in ((faces.points, _FACES, 0.0), (edges.points, _EDGES, _ABOVE_M))]
        super().__init__(data)

    def fill(self, room: Room, stamps: int | Array, *values: Floats) -> None:
        """Patch messages; ``values`` are the centres (m) and axes of the benches, both of shape (..., N, 2)."""
        centre, axis = values
        middle, forward = plane(centre), plane(axis)
        along, side = self._half_length * forward, 1j * self._half_width * forward
        front, rear = middle + along, middle - along
        places = (front + side, rear + side, rear - side, front - side)
        for offset in self._stamps:
            put_stamps(room, offset, stamps)
        for corners, points in self._points:
            benches = points.of(room)
            for n, corner in enumerate(corners):
                benches[f'place {n}'] = places[corner]


def _points(data: memoryview, benches: int, start: int, each: int, z_m: float) -> RowLayout:
    """Lay out ``each`` points per bench at the height ``z_m``; return the layout of the rows."""
    strided(data, '<f8', start + 16, 24, each * benches, 1)[:] = z_m
    return RowLayout(benches, start, 24 * each, {f'place {n}': ('<c16', 24 * n) for n in range(each)})


def contact_markers(t_ns: int, frame_id: str, benches: Iterable[MarkerSpec], others: Iterable[MarkerSpec]) -> bytes:
    """Return a MarkerArray that replaces all earlier markers, with these benches (see ``red_benches``) and others."""
    return _marker_array(t_ns, frame_id, [delete_all(), *benches, *others])


def red_benches(ns: str, ids: Iterable[int], centre: Floats, axis: Floats, size: Floats) -> list[MarkerSpec]:
    """Return the markers of M benches in contact, given centres (m), unit axes and full sizes (m), all of shape (M, 2).

    The markers are vermilion and slightly higher than the benches that they cover.
    """
    rows = zip(ids, centre.tolist(), half_turns(axis).tolist(), size.tolist(), strict=True)
    return [MarkerSpec(ns, number, CUBE, (length, width, _PROUD * BENCH_HEIGHT_M), VERMILION, place=(x, y, 0.0),
                       turn=(z, w)) for number, (x, y), (z, w), (length, width) in rows]


def single_marker(t_ns: int, frame_id: str, spec: MarkerSpec) -> bytes:
    """Return a visualization_msgs/Marker."""
    writer = Writer()
    put_marker(writer, spec, frame_id, t_ns)
    return bytes(writer.finish())


def delete_all() -> MarkerSpec:
    """Return the marker that deletes all markers on its topic."""
    return MarkerSpec('', 0, 0, _NO_SCALE, _NO_COLOUR, action=DELETE_ALL)


def deleted(ns: str) -> MarkerSpec:
    """Return the marker that deletes marker 0 in a namespace."""
    return MarkerSpec(ns, 0, 0, _NO_SCALE, _NO_COLOUR, action=DELETE)


def trail_marker(t_ns: int, points: Floats, frame_id: str) -> bytes:
    """Return a MarkerArray with one LINE_STRIP through points (m, shape (K, 2))."""
    writer = Writer()
    writer.put('I', 1)
    _put_line(writer, 'trail', _TRAIL_WIDTH_M, _TRAIL_GREY, points, 0.0, t_ns, frame_id)
    return bytes(writer.finish())


def track_marker(scene: Scene, frame_id: str) -> bytes:
    """Return a Marker with the track as a line, stamped with the start of the run."""
    writer = Writer()
    points = compile_scene(scene).track_line()
    _put_line(writer, 'track', _TRACK_WIDTH_M, _TRACK_GREY, points, _TRACK_Z_M, scene.run.start_ns, frame_id)
    return bytes(writer.finish())


def _marker_array(t_ns: int, frame_id: str, specs: list[MarkerSpec]) -> bytes:
    writer = Writer()
    writer.put('I', len(specs))
    for spec in specs:
        put_marker(writer, spec, frame_id, t_ns)
    return bytes(writer.finish())


def _put_line(writer: Writer, ns: str, width_m: float, colour: Colour, points: Floats, z_m: float, t_ns: int,
              frame_id: str) -> None:
    """Append a LINE_STRIP through points (m, shape (K, 2)) at the height ``z_m``."""
    spec = MarkerSpec(ns, 0, LINE_STRIP, (width_m, 0.0, 0.0), colour, len(points))
    start = put_marker(writer, spec, frame_id, t_ns).points
    out = np.frombuffer(writer.data, '<f8', 3 * len(points), start).reshape(-1, 3)
    out[:, :2], out[:, 2] = points, z_m
