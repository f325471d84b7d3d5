"""Frames as CDR bytes: one template per message, built once and patched in place by numpy.

This encoder is written by hand for speed: a template takes microseconds, whereas a general serialiser takes
milliseconds. Messages for several ticks are patched together, since the calls of numpy take longer than the copies.

The layout is plain CDR (OMG DDS-RTPS 2.3, 10.2; the first XCDR encoding): every primitive is aligned to its size,
counted from the end of the 4-byte encapsulation header. Padding is zero.
"""
import struct
from collections.abc import Sequence
from io import BytesIO
from typing import NamedTuple

import numpy as np

from dragon_ros.core.numerics.types import Array, Floats

LITTLE = b'\x00\x01\x00\x00'
NS = 10**9
_STAMP = struct.Struct('<Q')


class Writer:
    """Appends primitives as plain little-endian CDR."""

    def __init__(self) -> None:
        """Start with the encapsulation header."""
        self.data = bytearray(LITTLE)

    def put(self, kind: str, *values: float) -> int:
        """Append aligned values of one struct type ('i', 'I', 'd', 'f', '?'); return the offset of the first value."""
        size = struct.calcsize(kind)
        self.data += bytes(-(len(self.data) - 4) % size)
        offset = len(self.data)
        self.data += struct.pack(f'<{len(values)}{kind}', *values)
        return offset

    def room(self, kind: str, count: int) -> int:
        """Append ``count`` aligned zeros of one struct type; return the offset of the first zero."""
        offset = self.put(kind) if count else len(self.data)
        self.data += bytes(count * struct.calcsize(kind))
        return offset

    def text(self, text: str) -> None:
        """Append a string: its length including the terminating zero, followed by its bytes."""
        raw = text.encode() + b'\0'
        self.put('I', len(raw))
        self.data += raw

    def header(self, frame_id: str, t_ns: int = 0) -> int:
        """Append a std_msgs/Header and return the offset of its stamp."""
        stamp = self.put('I', *stamp_of(t_ns))
        self.text(frame_id)
        return stamp

    def finish(self) -> bytearray:
        """Return the data, padded to a multiple of 4 bytes so that recorded bytes are equal to sent bytes."""
        self.data += bytes(-len(self.data) % 4)
        return self.data


def string_message(text: str) -> bytes:
    """Return a std_msgs/String."""
    writer = Writer()
    writer.text(text)
    return bytes(writer.finish())


def stamp_of(t_ns: int) -> tuple[int, int]:
    """Convert a time in nanoseconds to (sec, nanosec)."""
    return t_ns // NS, t_ns % NS


def stamp_number(t_ns: int) -> int:
    """Return a stamp as the 64-bit number that its two fields form in memory."""
    seconds, rest_ns = stamp_of(t_ns)
    return seconds | rest_ns << 32


class Room(NamedTuple):
    """The bytes of M messages of equal layout: the offset of the first one, and the distance between their offsets."""

    data: memoryview
    messages: int = 1
    start: int = 0
    stride: int = 0


class RowLayout:
    """Rows of equal layout in a message: their count, offset, stride and fields."""

    def __init__(self, count: int, start: int, stride: int, fields: dict[str, tuple[str, int]]) -> None:
        """``fields`` maps the name of each field to its numpy type and its offset in a row."""
        kinds, offsets = zip(*fields.values(), strict=True)
        self._dtype = np.dtype({'names': list(fields), 'formats': kinds, 'offsets': offsets})
        self._count, self._start, self._stride = count, start, stride

    def of(self, room: Room) -> Array:
        """Return a view of the rows of one message or, if there are M, of shape (M, rows)."""
        data, messages, start, stride = room
        shape: tuple[int, ...] = (self._count,)
        strides: tuple[int, ...] = (self._stride,)
        if messages > 1:
            shape, strides = (messages, *shape), (stride, *strides)
        out: Array = np.ndarray(shape, self._dtype, data, start + self._start, strides)
        return out


def stamps_of(times_ns: Sequence[int]) -> int | Array:
    """Return the stamp of one message as a number (see ``stamp_number``) or those of M messages, of shape (M, 1)."""
    if len(times_ns) == 1:
        return stamp_number(times_ns[0])
    out: Array = np.array([[stamp_number(t_ns)] for t_ns in times_ns], dtype=np.uint64)
    return out


def put_stamps(room: Room, offset: int, stamps: int | Array) -> None:
    """Write the stamps of messages at an offset from their starts."""
    if isinstance(stamps, int):
        _STAMP.pack_into(room.data, room.start + offset, stamps)
    else:
        out: Array = np.ndarray((room.messages, 1), '<u8', room.data, room.start + offset, (room.stride, 8))
        out[:] = stamps


class Template:
    """The bytes of a message, laid out once and patched in place for each tick.

    BytesIO returns the bytes without copying them, unless the caller still holds the previous message when the next
    message is made. This matters because copying megabytes takes longer than patching them. Python caches the hash of a
    ``bytes`` object, so a caller that hashes a message must hold on to it until the next message is made.
    """

    def __init__(self, data: bytearray) -> None:
        """Start from a complete message."""
        self._message, self.size = BytesIO(bytes(data)), len(data)

    def fill(self, room: Room, stamps: int | Array, *values: Floats) -> None:
        """Patch copies of this template, given their stamps (see ``stamps_of``) and values.

        The values of several messages have a leading axis.
        """
        raise NotImplementedError

    def encode(self, t_ns: int, *values: Floats) -> bytes:
        """Return the bytes of the message for a tick."""
        with self._message.getbuffer() as data:
            self.fill(Room(data), stamp_number(t_ns), *values)
        return self._message.getvalue()

    def copies(self, messages: int) -> Room:
        """Return a number of copies of this template, one after another."""
        return Room(memoryview(bytearray(self._message.getvalue() * messages)), messages, 0, self.size)


class PoseArrayTemplate(Template):
    """A geometry_msgs/PoseArray of all handles."""

    def __init__(self, handles: int, frame_id: str) -> None:
        """Lay out the message for a number of handles."""
        writer = Writer()
        self._stamp = writer.header(frame_id)
        writer.put('I', handles)
        self._poses = RowLayout(handles, writer.room('d', 7 * handles), 56,
                                {'place': ('<c16', 0), 'turn': ('<c16', 40)})
        super().__init__(writer.finish())

    def fill(self, room: Room, stamps: int | Array, *values: Floats) -> None:
        """Patch messages; ``values`` are the handles (m, shape (..., N+1, 2)) and the axes of links (..., N, 2)."""
        p, axis = values
        put_stamps(room, self._stamp, stamps)
        poses, turns = self._poses.of(room), turns_of(axis)
        poses['place'] = plane(p)
        poses['turn'][..., :-1] = turns
        poses['turn'][..., -1] = turns[..., -1]


class VelocitiesTemplate(Template):
    """A std_msgs/Float64MultiArray with one row per handle and three columns, by default vx, vy, speed in m/s."""

    def __init__(self, handles: int, columns: str = 'vx_vy_speed') -> None:
        """Lay out the message for a number of handles."""
        writer = Writer()
        writer.put('I', 2)
        for label, size, stride in (('handle', handles, 3 * handles), (columns, 3, 3)):
            writer.text(label)
            writer.put('I', size, stride)
        writer.put('I', 0, 3 * handles)
        self._rows = RowLayout(handles, writer.room('d', 3 * handles), 24,
                               {'velocity': ('<c16', 0), 'speed': ('<f8', 16)})
        super().__init__(writer.finish())

    def fill(self, room: Room, stamps: int | Array, *values: Floats) -> None:
        """Patch messages, which have no stamp; the only value is the velocities (m/s, shape (..., N+1, 2))."""
        velocity_m_s, = values
        rows = self._rows.of(room)
        rows['velocity'] = plane(velocity_m_s)
        np.hypot(velocity_m_s[..., 0], velocity_m_s[..., 1], out=rows['speed'])


class CloudTemplate(Template):
    """A sensor_msgs/PointCloud2 of all handles: x, y, z (float32), vx, vy, speed (float64) and handle (uint32)."""

    _UINT32, _FLOAT32, _FLOAT64 = 6, 7, 8       # sensor_msgs/PointField
    _FIELDS = (('x', 0, _FLOAT32), ('y', 4, _FLOAT32), ('z', 8, _FLOAT32), ('vx', 16, _FLOAT64), ('vy', 24, _FLOAT64),
               ('speed', 32, _FLOAT64), ('handle', 40, _UINT32))
    _STEP = 48

    def __init__(self, handles: int, frame_id: str) -> None:
        """Lay out the message for a number of handles."""
        writer = Writer()
        self._stamp = writer.header(frame_id)
        writer.put('I', 1, handles, len(self._FIELDS))
        for name, offset, kind in self._FIELDS:
            writer.text(name)
            writer.put('I', offset)
            writer.put('B', kind)
            writer.put('I', 1)
        writer.put('?', False)
        writer.put('I', self._STEP, self._STEP * handles, self._STEP * handles)
        self._points = RowLayout(handles, writer.room('B', self._STEP * handles), self._STEP, {
            'x': ('<f4', 0), 'y': ('<f4', 4), 'velocity': ('<c16', 16), 'speed': ('<f8', 32), 'handle': ('<u4', 40)})
        writer.put('?', True)
        with memoryview(writer.data) as data:
            self._points.of(Room(data))['handle'] = np.arange(handles)
        super().__init__(writer.finish())

    def fill(self, room: Room, stamps: int | Array, *values: Floats) -> None:
        """Patch messages; ``values`` are the handles (m) and their velocities (m/s), both of shape (..., N+1, 2)."""
        p, velocity_m_s = values
        put_stamps(room, self._stamp, stamps)
        points = self._points.of(room)
        points['x'], points['y'] = p[..., 0], p[..., 1]
        points['velocity'] = plane(velocity_m_s)
        points['speed'] = np.hypot(velocity_m_s[..., 0], velocity_m_s[..., 1])


class JointsTemplate(Template):
    """A sensor_msgs/JointState that contains only positions."""

    def __init__(self, names: list[str], frame_id: str) -> None:
        """Lay out the message for joints with these names."""
        writer = Writer()
        self._stamp = writer.header(frame_id)
        writer.put('I', len(names))
        for name in names:
            writer.text(name)
        writer.put('I', len(names))
        self._positions = RowLayout(len(names), writer.room('d', len(names)), 8, {'position': ('<f8', 0)})
        writer.put('I', 0, 0)       # no velocities and no efforts
        super().__init__(writer.finish())

    def fill(self, room: Room, stamps: int | Array, *values: Floats) -> None:
        """Patch messages; the only value is the joint positions (rad, shape (..., joints))."""
        put_stamps(room, self._stamp, stamps)
        position_rad, = values
        self._positions.of(room)['position'] = position_rad


def float64_of(value: float) -> bytes:
    """Return a std_msgs/Float64."""
    return LITTLE + struct.pack('<d', value)


def half_turns(axis: Floats) -> Floats:
    """Return (z, w) of the quaternions that rotate x onto ``axis`` (..., N, 2): square roots of complex axes."""
    half, out = np.sqrt(plane(axis)), np.empty(axis.shape)
    out[..., 0], out[..., 1] = half.imag, half.real
    return out


class _Turns:
    """Computes the half turns once per tick, because all messages of a tick share a read-only array of axes."""

    def __init__(self) -> None:
        self._last: tuple[Floats | None, Array] = None, np.empty(0, np.complex128)

    def of(self, axis: Floats) -> Array:
        """Return (z, w) of the quaternions that rotate x onto ``axis`` (shape (..., N, 2)), as complex numbers."""
        known, turns = self._last
        if axis is not known or axis.flags.writeable:
            turns = plane(half_turns(axis))
            self._last = axis, turns
        return turns


def plane(points: Floats) -> Array:
    """View points (shape (..., N, 2)) as complex numbers (..., N), which numpy copies in a single loop."""
    out: Array = np.ascontiguousarray(points).view(np.complex128)[..., 0]
    return out


turns_of = _Turns().of


def strided(data: bytes | bytearray | memoryview, kind: str, offset: int, stride: int, rows: int,
            columns: int) -> Array:
    """Return a view of shape (rows, columns) of equal fields that are ``stride`` bytes apart."""
    width = np.dtype(kind).itemsize
    out: Array = np.ndarray((rows, columns), kind, data, offset, (stride, width))
    return out
