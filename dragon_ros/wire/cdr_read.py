"""CDR bytes as numpy views: any publisher's encoding, both endiannesses, any string lengths.

Every reader checks lengths before it looks, and raises MessageError with the offset where the bytes end early.
"""
import struct
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.errors import InputError
from dragon_ros.core.types import Array, Floats
from dragon_ros.wire.cdr import NS, strided

_SMALLEST_MARKER = 200


class MessageError(InputError):
    """The bytes are not a message of the expected type, or hold values that nobody can use."""


class Reader:
    """Walks over plain CDR; offsets count from the start of the data."""

    def __init__(self, data: bytes | bytearray) -> None:
        """Read the encapsulation header."""
        if len(data) < 4 or data[0] != 0 or data[1] > 1:
            raise MessageError(f'not plain CDR: it starts with {bytes(data[:4]).hex() or "nothing"}; '
                               'expected 0000 or 0001 (XCDR2 and parameter lists are not supported)')
        self.data, self.order, self.at = data, '><'[data[1]], 4

    def skip(self, kind: str, count: int = 1) -> int:
        """Pass aligned values of one type and return the first one's offset."""
        size = struct.calcsize(kind)
        start = self.at + -(self.at - 4) % size if count else self.at
        if count > (len(self.data) - start) // size:
            raise MessageError(f'the bytes end at {len(self.data)}, inside {count} x {size} bytes at {start}')
        self.at = start + count * size
        return start

    def take(self, kind: str) -> int:
        """Read one integer."""
        value: int = struct.unpack_from(self.order + kind, self.data, self.skip(kind))[0]
        return value

    def text(self) -> str:
        """Read a string."""
        length = self.take('I')
        start = self.skip('B', length)
        return self.data[start:start + max(length - 1, 0)].decode(errors='replace')

    def stamp_ns(self) -> int:
        """Read a time stamp."""
        sec, nanosec = self.take('i'), self.take('I')
        if sec < 0 or nanosec >= NS:
            raise MessageError(f'stamp: {sec} s and {nanosec} ns; expected no negative time and less than 1e9 ns')
        return sec * NS + nanosec

    def doubles(self, count: int) -> Floats:
        """View ``count`` doubles."""
        start = self.skip('d', count)
        view: Floats = np.frombuffer(self.data, self.order + 'f8', count, start)
        return view


@dataclass(frozen=True)
class Poses:
    """A PoseArray: stamp, frame and a view (N, 7) of x, y, z and quaternion x, y, z, w."""

    t_ns: int
    frame_id: str
    poses: Floats


@dataclass(frozen=True)
class Markers:
    """Of each marker of a MarkerArray: stamp, frame, namespace, id, type, action, pose (N, 7) and scale (N, 3)."""

    t_ns: tuple[int, ...]
    frame_id: tuple[str, ...]
    ns: tuple[str, ...]
    id: Array
    type: Array
    action: Array
    poses: Floats
    scale: Floats


def read_stamp_ns(data: bytes) -> int:
    """Return the stamp of a message that starts with a std_msgs/Header."""
    return Reader(data).stamp_ns()


def read_pose_array(data: bytes | bytearray) -> Poses:
    """Return a geometry_msgs/PoseArray."""
    reader = Reader(data)
    t_ns, frame_id, count = reader.stamp_ns(), reader.text(), reader.take('I')
    return Poses(t_ns, frame_id, reader.doubles(7 * count).reshape(count, 7))


def read_multi_array(data: bytes | bytearray) -> tuple[list[str], Floats]:
    """Return labels and values of a std_msgs/Float64MultiArray, in the shape of its dimensions."""
    reader = Reader(data)
    labels, shape = [], []
    for _ in range(reader.take('I')):
        labels.append(reader.text())
        shape.append(reader.take('I'))
        reader.take('I')
    padding = reader.take('I')
    values = reader.doubles(reader.take('I'))[padding:]
    if int(np.prod(shape, dtype=object)) != values.size:
        raise MessageError(f'{values.size} values do not fill the shape {shape}')
    return labels, values.reshape(shape)


@dataclass(frozen=True)
class Status:
    """One diagnostic_msgs/DiagnosticStatus."""

    level: int
    name: str
    message: str
    values: dict[str, str]


def read_diagnostics(data: bytes) -> list[Status]:
    """Return the statuses of a diagnostic_msgs/DiagnosticArray."""
    reader = Reader(data)
    reader.stamp_ns()
    reader.text()
    return [_status(reader) for _ in range(reader.take('I'))]


def _status(reader: Reader) -> Status:
    level = reader.take('B')
    name, message, _ = reader.text(), reader.text(), reader.text()
    return Status(level, name, message, {reader.text(): reader.text() for _ in range(reader.take('I'))})


@dataclass
class _Marker:
    """Offsets of one marker's fields; ``lengths`` are those of the counts that shape its layout."""

    stamp: int
    id: int
    pose: int
    lengths: list[int]
    frame_id: str
    ns: str
    end: int


def read_marker_array(data: bytes | bytearray) -> Markers:
    """Return a visualization_msgs/MarkerArray.

    Markers of one layout (equal string lengths and counts, a stride of whole 8 bytes) are viewed at once, others are
    walked one by one.
    """
    reader = Reader(data)
    count = reader.take('I')
    if count > len(data) // _SMALLEST_MARKER:
        raise MessageError(f'{len(data)} bytes cannot hold {count} markers')
    if not count:
        empty = np.empty(0, np.int32)
        return Markers((), (), (), empty, empty, empty, np.empty((0, 7)), np.empty((0, 3)))
    markers = [_walk(reader)]
    if not (even := _even(reader, markers[0], count)):
        markers += [_walk(reader) for _ in range(count - 1)]
    times = _fields(reader, 'u4', [m.stamp for m in markers], even, 2).astype(np.int64) @ [NS, 1]
    frames = (markers[0].frame_id,) * count if even else tuple(m.frame_id for m in markers)
    ids = _fields(reader, 'i4', [m.id for m in markers], even, 3)
    ns = (markers[0].ns,) * count if even else tuple(m.ns for m in markers)
    doubles = _fields(reader, 'f8', [m.pose for m in markers], even, 10)
    return Markers(tuple(times.tolist()), frames, ns, ids[:, 0], ids[:, 1], ids[:, 2], doubles[:, :7], doubles[:, 7:])


def _walk(reader: Reader) -> _Marker:
    """Pass one marker and note where its fields are."""
    lengths: list[int] = []

    def text() -> str:
        lengths.append(reader.skip('I'))
        reader.at = lengths[-1]
        return reader.text()

    def sequence(kind: str, each: int = 1) -> None:
        lengths.append(reader.skip('I'))
        reader.at = lengths[-1]
        reader.skip(kind, reader.take('I') * each)

    stamp = reader.skip('I', 0) + -(reader.at - 4) % 4
    reader.stamp_ns()
    frame_id, ns = text(), text()
    identity = reader.skip('i', 3)
    pose = reader.skip('d', 10)
    reader.skip('f', 4)
    reader.skip('i', 2)
    reader.skip('B')
    sequence('d', 3)        # points
    sequence('f', 4)        # colors
    text()                  # texture_resource
    reader.skip('I', 2)
    text()
    text()
    sequence('B')           # texture
    sequence('f', 2)        # uv_coordinates
    text()                  # text
    text()                  # mesh_resource
    text()
    sequence('B')           # mesh_file
    reader.skip('B')
    return _Marker(stamp, identity, pose, lengths, frame_id, ns, reader.at)


def _even(reader: Reader, first: _Marker, count: int) -> int:
    """Return the stride if all markers are laid out like the first one with the same strings, else 0."""
    start = first.stamp
    stride = first.end - start + -(first.end - start) % 4
    if stride % 8 or len(reader.data) < first.end + (count - 1) * stride:
        return 0
    for offset in first.lengths:
        values = strided(reader.data, reader.order + 'u4', offset, stride, count, 1)
        if np.any(values != values[0]):
            return 0
    for offset in first.lengths[:2]:     # frame_id and ns
        length = struct.unpack_from(reader.order + 'I', reader.data, offset)[0]
        text = strided(reader.data, 'u1', offset + 4, stride, count, length)
        if np.any(text != text[0]):
            return 0
    return stride


def _fields(reader: Reader, kind: str, offsets: list[int], stride: int, columns: int) -> Array:
    """Return one field of all markers (rows), by stride where there is one, else from each offset."""
    kind = reader.order + kind
    if stride:
        count = struct.unpack_from(reader.order + 'I', reader.data, 4)[0]
        return strided(reader.data, kind, offsets[0], stride, count, columns)
    return np.stack([np.frombuffer(reader.data, kind, columns, offset) for offset in offsets])


def read_string(data: bytes) -> str:
    """Return the text of a std_msgs/String."""
    return Reader(data).text()
