"""The chunk of an MCAP file that is being filled: messages one after another in one piece of memory, used again."""
import struct
from collections import defaultdict

import numpy as np
from mcap.opcode import Opcode

CHUNK_BYTES = 2**20
_BUFFER_BYTES = 2 * CHUNK_BYTES
_MESSAGE = struct.Struct('<BQHIQQ')      # opcode, length, channel, sequence, log time, publish time; then the data


class OpenChunk:
    """Messages as records, and where they are: ``index`` has (log time, offset) by channel."""

    def __init__(self) -> None:
        """Start with no message."""
        self._buffer = _memory(_BUFFER_BYTES)
        self.clear()

    def clear(self) -> None:
        """Forget the messages; memory that an unusually large one took is given back."""
        if len(self._buffer) > _BUFFER_BYTES:
            self._buffer = _memory(_BUFFER_BYTES)
        self.size = 0
        self.index: dict[int, list[tuple[int, int]]] = defaultdict(list)

    @property
    def data(self) -> memoryview:
        """The records, valid until ``clear``."""
        return self._buffer[:self.size]

    def add(self, channel: int, data: bytes, t_ns: int, sequence: int, publish_ns: int) -> None:
        """Append one message."""
        start, first = self.size, self.size + _MESSAGE.size
        self.size = first + len(data)
        if self.size > len(self._buffer):
            larger = _memory(2 * self.size)
            larger[:start] = self._buffer[:start]
            self._buffer = larger
        self.index[channel].append((t_ns, start))
        _MESSAGE.pack_into(self._buffer, start, Opcode.MESSAGE, 22 + len(data), channel, sequence, t_ns, publish_ns)
        self._buffer[first:self.size] = data

    def times_ns(self) -> tuple[int, int]:
        """Return the first and the last log time."""
        times = [t_ns for entries in self.index.values() for t_ns, _ in entries]
        return min(times), max(times)

    def counts(self) -> tuple[tuple[int, int], ...]:
        """Return (channel, messages) of each channel that has any."""
        return tuple((channel, len(entries)) for channel, entries in self.index.items())


def _memory(size: int) -> memoryview:
    """Return so many bytes; those that are never written take no memory."""
    return np.empty(size, np.uint8).data
