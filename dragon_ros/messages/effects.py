"""What effects add to a frame, as CDR bytes: tables of numbers, markers of contacts and trails, diagnostics."""
import struct
from collections.abc import Iterable, Mapping

import numpy as np

from dragon_ros.core.numerics.types import Floats
from dragon_ros.messages.cdr import Writer, half_turns, stamp_of
from dragon_ros.messages.markers import BENCH_HEIGHT_M, CUBE, Look, put_marker

_SPHERE, _LINE_STRIP = 2, 4
_DELETE_ALL = 3
_RED, _YELLOW, _GREY = (0.9, 0.1, 0.1, 1.0), (0.94, 0.89, 0.26, 1.0), (0.4, 0.4, 0.4, 1.0)
_POINT_M, _TRAIL_M = 0.12, 0.04
OK, ERROR = 0, 2


def table(rows: str, columns: str, values: Floats) -> bytes:
    """Return a std_msgs/Float64MultiArray with labelled rows and columns, for values (rows, columns)."""
    writer = Writer()
    writer.put('I', 2)
    count, width = values.shape
    for label, size, stride in ((rows, count, count * width), (columns, width, width)):
        writer.text(label)
        writer.put('I', size, stride)
    writer.put('I', 0, count * width)
    writer.put('d', *values.ravel().tolist())
    return bytes(writer.finish())


def contact_markers(t_ns: int, centre: Floats, axis: Floats, size: Floats, points: Floats, frame_id: str) -> bytes:
    """Return a MarkerArray: DELETEALL, red cubes for M benches in contact, (M, 2) each, and spheres at the points."""
    writer = Writer()
    writer.put('I', 1 + len(centre) + len(points))
    _put(writer, Look('contact', 0, CUBE, (0.0, 0.0, 0.0), _RED, action=_DELETE_ALL), frame_id, t_ns)
    for n, (place, turn, (length, width)) in enumerate(zip(centre, half_turns(axis), size.tolist(), strict=True)):
        look = Look('contact bench', n, CUBE, (length, width, 1.05 * BENCH_HEIGHT_M), _RED)
        _put(writer, look, frame_id, t_ns, place, turn)
    for n, place in enumerate(points):
        _put(writer, Look('contact point', n, _SPHERE, (_POINT_M,) * 3, _YELLOW), frame_id, t_ns, place)
    return bytes(writer.finish())


def _put(writer: Writer, look: Look, frame_id: str, t_ns: int, place: Iterable[float] = (0.0, 0.0),
         turn: Iterable[float] = (0.0, 1.0)) -> None:
    """Append one marker with its stamp and pose."""
    at = put_marker(writer, look, frame_id)
    struct.pack_into('<2I', writer.data, at.stamp, *stamp_of(t_ns))
    struct.pack_into('<7d', writer.data, at.pose, *place, 0.0, 0.0, 0.0, *turn)


def trail_marker(t_ns: int, points: Floats, frame_id: str) -> bytes:
    """Return a MarkerArray with one LINE_STRIP through points (K, 2)."""
    writer = Writer()
    writer.put('I', 1)
    at = put_marker(writer, Look('trail', 0, _LINE_STRIP, (_TRAIL_M, 0.0, 0.0), _GREY, len(points)), frame_id)
    data = writer.finish()
    np.frombuffer(data, '<u4', 2, at.stamp)[:] = stamp_of(t_ns)
    np.frombuffer(data, '<f8', 3 * len(points), at.points).reshape(-1, 3)[:, :2] = points
    return bytes(data)


def diagnostics(t_ns: int, frame_id: str, level: int, name: str, message: str, values: Mapping[str, object]) -> bytes:
    """Return a DiagnosticArray with one status."""
    writer = Writer()
    writer.put('I', *stamp_of(t_ns))
    writer.text(frame_id)
    writer.put('I', 1)
    writer.put('B', level)
    for text in (name, message, ''):
        writer.text(text)
    writer.put('I', len(values))
    for key, value in values.items():
        writer.text(key)
        writer.text(str(value))
    return bytes(writer.finish())
