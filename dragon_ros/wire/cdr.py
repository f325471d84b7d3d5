"""Frames as CDR bytes: a template built once for each message, patched in place by numpy.

The layout is plain CDR (OMG DDS-RTPS 2.3, 10.2; the first XCDR encoding): every primitive is aligned to its size,
counted from the end of the 4-byte encapsulation header. Padding is zero.
"""
import struct
from itertools import pairwise

import numpy as np

from dragon_ros.core.types import Array, Floats

LITTLE = b'\x00\x01\x00\x00'
NS = 10**9
CUBE = 1
BENCH_HEIGHT_M = 0.1
_BENCH_COLOURS = ((0.84, 0.37, 0.0, 1.0), (0.0, 0.45, 0.70, 1.0))     # Okabe-Ito: vermilion head, blue body


class Writer:
    """Appends primitives in plain little-endian CDR."""

    def __init__(self) -> None:
        """Start with the encapsulation header."""
        self.data = bytearray(LITTLE)

    def put(self, kind: str, *values: float) -> int:
        """Append aligned values of one struct type ('i', 'I', 'd', 'f', '?') and return the first one's offset."""
        size = struct.calcsize(kind)
        self.data += bytes(-(len(self.data) - 4) % size)
        offset = len(self.data)
        self.data += struct.pack(f'<{len(values)}{kind}', *values)
        return offset

    def text(self, text: str) -> None:
        """Append a string: length with its closing zero, then the bytes."""
        raw = text.encode() + b'\0'
        self.put('I', len(raw))
        self.data += raw

    def header(self, frame_id: str) -> int:
        """Append a std_msgs/Header and return the offset of its stamp."""
        stamp = self.put('I', 0, 0)
        self.text(frame_id)
        return stamp

    def finish(self) -> bytearray:
        """Return the data, filled up to whole 4 bytes as it travels: what is recorded then equals what was made."""
        self.data += bytes(-len(self.data) % 4)
        return self.data


def string_message(text: str) -> bytes:
    """Return a std_msgs/String."""
    writer = Writer()
    writer.text(text)
    return bytes(writer.finish())


def stamp_of(t_ns: int) -> tuple[int, int]:
    """Return (sec, nanosec) of a time in nanoseconds."""
    return t_ns // NS, t_ns % NS


class PoseArrayTemplate:
    """geometry_msgs/PoseArray of all handles."""

    def __init__(self, handles: int, frame_id: str) -> None:
        """Lay the message out for a number of handles."""
        writer = Writer()
        stamp = writer.header(frame_id)
        writer.put('I', handles)
        poses = writer.put('d', *([0.0] * (7 * handles)))
        self._data = writer.finish()
        self._stamp = np.frombuffer(self._data, '<u4', 2, stamp)
        self._poses = np.frombuffer(self._data, '<f8', 7 * handles, poses).reshape(handles, 7)

    def encode(self, t_ns: int, p: Floats, axis: Floats) -> bytes:
        """Return the bytes for handles at ``p`` (N+1, 2) m and links along ``axis`` (N, 2)."""
        self._stamp[:] = stamp_of(t_ns)
        self._poses[:, :2] = p
        half = half_turns(axis)
        self._poses[:-1, 5:] = half
        self._poses[-1, 5:] = half[-1]
        return bytes(self._data)


class BenchMarkersTemplate:
    """visualization_msgs/MarkerArray with one CUBE a bench; z = 0 is the middle of the benches."""

    def __init__(self, lengths_m: Floats, width_m: float, frame_id: str) -> None:
        """Lay the message out for benches of the given full lengths and width."""
        writer = Writer()
        writer.put('I', lengths_m.size)
        places = [_bench_marker(writer, bench, length, width_m, frame_id)
                  for bench, length in enumerate(lengths_m.tolist())]
        self._data = writer.finish()
        stride = places[1][0] - places[0][0] if len(places) > 1 else len(self._data)
        assert all(after[0] - before[0] == stride for before, after in pairwise(places))
        stamp, pose = places[0]
        self._stamp = strided(self._data, '<u4', stamp, stride, len(places), 2)
        self._pose = strided(self._data, '<f8', pose, stride, len(places), 7)

    def encode(self, t_ns: int, centre: Floats, axis: Floats) -> bytes:
        """Return the bytes for benches at ``centre`` (N, 2) m along ``axis`` (N, 2)."""
        self._stamp[:] = stamp_of(t_ns)
        self._pose[:, :2] = centre
        self._pose[:, 5:] = half_turns(axis)
        return bytes(self._data)


class VelocitiesTemplate:
    """std_msgs/Float64MultiArray: rows are handles, columns vx, vy, speed in m/s."""

    def __init__(self, handles: int) -> None:
        """Lay the message out for a number of handles."""
        writer = Writer()
        writer.put('I', 2)
        for label, size, stride in (('handle', handles, 3 * handles), ('vx_vy_speed', 3, 3)):
            writer.text(label)
            writer.put('I', size, stride)
        writer.put('I', 0, 3 * handles)
        values = writer.put('d', *([0.0] * (3 * handles)))
        self._data = writer.finish()
        self._values = np.frombuffer(self._data, '<f8', 3 * handles, values).reshape(handles, 3)

    def encode(self, velocity_m_s: Floats) -> bytes:
        """Return the bytes for velocities (N+1, 2) in m/s."""
        self._values[:, :2] = velocity_m_s
        np.hypot(velocity_m_s[:, 0], velocity_m_s[:, 1], out=self._values[:, 2])
        return bytes(self._data)


def half_turns(axis: Floats) -> Floats:
    """Return (z, w) of the quaternions that turn x onto ``axis`` (N, 2)."""
    half = 0.5 * np.arctan2(axis[:, 1], axis[:, 0])
    out = np.empty((half.size, 2))      # not np.stack, which takes as long as the sines here
    np.sin(half, out=out[:, 0])
    np.cos(half, out=out[:, 1])
    return out


def strided(data: bytes | bytearray, kind: str, offset: int, stride: int, rows: int, columns: int) -> Array:
    """Return a (rows, columns) view of equal fields that stand ``stride`` bytes apart."""
    width = np.dtype(kind).itemsize
    out: Array = np.ndarray((rows, columns), kind, data, offset, (stride, width))
    return out


def _bench_marker(writer: Writer, bench: int, length_m: float, width_m: float, frame_id: str) -> tuple[int, int]:
    """Append one Marker and return the offsets of its stamp and pose."""
    stamp = writer.header(frame_id)
    writer.text('bench')
    writer.put('i', bench, CUBE, 0)
    pose = writer.put('d', 0, 0, 0, 0, 0, 0, 1)
    writer.put('d', length_m, width_m, BENCH_HEIGHT_M)
    writer.put('f', *_BENCH_COLOURS[min(bench, 1)])
    writer.put('i', 0, 0)           # lifetime: for ever
    writer.put('?', False)          # frame_locked
    writer.put('I', 0, 0)           # points, colors
    writer.text('')                 # texture_resource
    writer.header('')               # texture
    writer.text('')
    writer.put('I', 0, 0)           # texture data, uv_coordinates
    writer.text('')                 # text
    writer.text('')                 # mesh_resource
    writer.text('')                 # mesh_file
    writer.put('I', 0)
    writer.put('?', False)          # mesh_use_embedded_materials
    return stamp, pose
