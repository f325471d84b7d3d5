"""Reads the benches from a run's messages, which differ only in stamps and poses."""
import struct
import sys

import numpy as np

from dragon_ros.core.numerics.types import Array, read_only
from dragon_ros.messages.cdr import NS, strided
from dragon_ros.messages.decode import MessageError
from dragon_ros.messages.markers import CUBE
from dragon_ros.messages.observation import BenchCubes, BenchMarkers, checked_stamp, half_sizes, read_benches

_NATIVE = 1 if sys.byteorder == 'little' else 0     # the encapsulation header's second byte in the native order
_WORD = 4


class BenchReader:
    """Reads benches from successive messages; a message with the same layout as the previous message is not parsed."""

    def __init__(self) -> None:
        """Start without a message."""
        self._last: _Pattern | None = None

    def read(self, data: bytes) -> BenchMarkers | BenchCubes:
        """Return the benches in a MarkerArray, ignoring other markers. Raises MessageError."""
        if self._last and self._last.fits(data):
            return self._last.benches(data)
        read = read_benches(data)
        self._last = _pattern_of(read)
        return read


class _Pattern:
    """The words that determine the layout of a message if its markers are equal cubes in the order of the benches."""

    def __init__(self, read: BenchMarkers) -> None:
        """Keep all words except stamps, poses, colours and lifetimes. Raises MessageError for invalid sizes."""
        markers = read.markers
        (run,), at = markers.runs, markers.runs[0].layout.at
        self._frame_id, self._size, self._count = read.frame_id, len(markers.data), run.count
        self._half_length, self._half_width = map(read_only, half_sizes(markers.scale))
        self._stamp, self._pose, self._stride = at['header.stamp.sec'], at['pose'], run.stride
        self._head = bytes(markers.data[:self._stamp])
        self._first, last = at['header.frame_id'], run.layout.lengths[-1]
        row = (last + _WORD - self._first) // _WORD     # words of a marker from the frame to the last length
        free = np.ones((self._count, max(self._stride // _WORD, row)), dtype=bool)
        free[:, :row] = False
        for start, end in ((at['pose'], at['scale']), (at['color'], at['points'])):
            free[:, (start - self._first) // _WORD:(end - self._first) // _WORD] = True
        self._free = free.ravel()[:free.size - free.shape[1] + row]
        self._same = self._words(markers.data).copy()
        self._equal = np.empty(self._same.shape, dtype=bool)

    def _words(self, data: bytes | bytearray) -> Array:
        """Return a view of the words of a message from the first marker's frame to the last marker's last length.

        It includes words between the markers, because numpy compares contiguous words several times as fast as rows.
        """
        out: Array = np.frombuffer(data, 'u4', self._free.size, self._first)
        return out

    def fits(self, data: bytes) -> bool:
        """Return whether a message has the same layout as the previous message."""
        if len(data) != self._size or not data.startswith(self._head):
            return False
        equal = np.equal(self._words(data), self._same, out=self._equal)
        equal |= self._free
        return bool(equal.all())

    def benches(self, data: bytes) -> BenchCubes:
        """Return the benches in a message that ``fits``. Raises MessageError if its stamp is invalid."""
        sec, nanosec = struct.unpack_from('=iI', data, self._stamp)
        poses = strided(data, 'f8', self._pose, self._stride, self._count, 7)
        return BenchCubes(checked_stamp(sec * NS + nanosec), self._frame_id, poses, self._half_length,
                          self._half_width, self._size)


def _pattern_of(read: BenchMarkers) -> _Pattern | None:
    """Return the pattern of a message, or None if the next message must be parsed in any case."""
    markers = read.markers
    plain = (markers.data[1] == _NATIVE and len(markers.runs) == 1 and markers.type[0] == CUBE
             and np.array_equal(read.order, np.arange(markers.type.size)))
    try:
        return _Pattern(read) if plain else None
    except MessageError:
        return None
