"""A MarkerArray as columns: views of the bytes for each run of markers that are laid out alike."""
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.messages.cdr import NS, strided
from dragon_ros.messages.decode import Layout, MessageError, Reader, layout_of
from dragon_ros.messages.schemas import fields_of

_SMALLEST_MARKER = 180


@dataclass(frozen=True)
class Run:
    """Markers in a row with one layout and the same frame and namespace, ``stride`` bytes apart."""

    layout: Layout
    stride: int
    count: int
    frame_id: str
    ns: str


@dataclass(frozen=True)
class Markers:
    """Of each marker: stamp, the run that it is in, id, type, action, pose (N, 7) and scale (N, 3)."""

    runs: tuple[Run, ...]
    run_of: Ints
    t_ns: Ints
    id: Array
    type: Array
    action: Array
    poses: Floats
    scale: Floats
    data: bytes | bytearray

    def points_of(self, marker: int) -> Floats:
        """View the points (K, 3) of one marker."""
        first = int(np.searchsorted(self.run_of, self.run_of[marker]))
        run, reader = self.runs[self.run_of[marker]], Reader(self.data)
        reader.at = run.layout.at['points'] + (marker - first) * run.stride
        count = reader.take('I')
        return reader.array('d', 3 * count).reshape(count, 3)

    @property
    def geometry(self) -> Floats:
        """All coordinates: the poses, or the points of the first marker where it is a list."""
        points = self.points_of(0) if self.type.size else np.empty((0, 3))
        return points if points.size else self.poses


def read_marker_array(data: bytes | bytearray) -> Markers:
    """Return a visualization_msgs/MarkerArray.

    Markers of one layout (equal string lengths and counts) and a stride of whole 8 bytes are viewed at once; where the
    layout changes, one marker is walked by its schema and a new run begins.
    """
    reader = Reader(data)
    count = reader.take('I')
    if count > len(data) // _SMALLEST_MARKER:
        raise MessageError(f'{len(data)} bytes cannot hold {count} markers')
    runs = tuple(_runs(reader, count))
    run_of = np.repeat(np.arange(len(runs)), [run.count for run in runs])
    stamp = _column(reader, runs, 'header.stamp.sec', 'i4', 2).astype(np.int64)
    stamp[:, 1] &= 0xffffffff
    ids = _column(reader, runs, 'id', 'i4', 3)
    doubles = _column(reader, runs, 'pose', 'f8', 10)
    return Markers(runs, run_of, stamp @ np.array([NS, 1]), ids[:, 0], ids[:, 1], ids[:, 2], doubles[:, :7],
                   doubles[:, 7:], data)


def _runs(reader: Reader, count: int) -> Iterator[Run]:
    (markers,) = fields_of('visualization_msgs/msg/MarkerArray')
    most = count
    while count:
        layout = layout_of(reader, markers.parts)
        stride = layout.end - layout.start + -(layout.end - layout.start) % 4
        same = 1 if stride % 8 else _alike(reader, layout, stride, min(count, most))
        reader.at = layout.end + (same - 1) * stride
        yield Run(layout, stride, same, _text(reader, layout.at['header.frame_id']), _text(reader, layout.at['ns']))
        count -= same
        most = 8 * same         # so that a message of many short runs is not looked through again and again


def _alike(reader: Reader, layout: Layout, stride: int, most: int) -> int:
    """Return how many markers from here on have the same lengths, frame and namespace."""
    most = min(most, 1 + (len(reader.data) - layout.end) // stride)
    if most == 1:
        return 1
    columns = (np.array(layout.lengths) - layout.start) // 4
    marks = strided(reader.data, 'u4', layout.start, stride, most, int(columns[-1]) + 1)[:, columns]
    most = _equal(marks)
    for name in ('header.frame_id', 'ns'):
        at = layout.at[name]
        length = struct.unpack_from(f'{reader.order}I', reader.data, at)[0]
        most = _equal(strided(reader.data, 'u1', at + 4, stride, most, length))
    return most


def _equal(rows: Array) -> int:
    """Return how many rows equal the first one before one differs."""
    same = rows == rows[0]
    return len(rows) if same.all() else int(np.argmin(same.all(axis=1)))


def _text(reader: Reader, at: int) -> str:
    after, reader.at = reader.at, at
    text = reader.text()
    reader.at = after
    return text


def _column(reader: Reader, runs: tuple[Run, ...], name: str, kind: str, columns: int) -> Array:
    """Return one field of all markers (rows), a view where there is one run."""
    parts = [strided(reader.data, reader.order + kind, run.layout.at[name], run.stride, run.count, columns)
             for run in runs]
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.empty((0, columns), kind)
