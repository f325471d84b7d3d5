"""What an MCAP file holds so far, kept packed until its index is written: a long recording has many chunks."""
import struct
from collections.abc import Iterator
from typing import NamedTuple

from mcap import records

_CHUNK = struct.Struct('<QQQQQH')       # start, size, raw size, first and last log time, channels
_COUNT = struct.Struct('<HQ')           # channel, messages; of each channel, before the chunk's own row
_CHUNK_HEAD, _INDEX_HEAD, _INDEX_ENTRY = 49, 15, 16     # bytes of Chunk (without its compression's name), MessageIndex


def packed_bytes(topics: int) -> int:
    """Return what is kept of a chunk with messages of so many topics."""
    return _CHUNK.size + topics * _COUNT.size


class Stored(NamedTuple):
    """A chunk in a file: where it starts, bytes of its data and before compression, log times, (channel, messages)."""

    start: int
    size: int
    raw_size: int
    first_ns: int
    last_ns: int
    counts: tuple[tuple[int, int], ...]

    def found_by(self, compression: str) -> records.ChunkIndex:
        """Return its index record: after the chunk, each channel has a MessageIndex, in order."""
        length = _CHUNK_HEAD + len(compression) + self.size
        offsets, end = {}, self.start + length
        for channel, messages in self.counts:
            offsets[channel] = end
            end += _INDEX_HEAD + _INDEX_ENTRY * messages
        return records.ChunkIndex(
            message_start_time=self.first_ns, message_end_time=self.last_ns, chunk_start_offset=self.start,
            chunk_length=length, message_index_offsets=offsets, message_index_length=end - self.start - length,
            compression=compression, compressed_size=self.size, uncompressed_size=self.raw_size)


class Parts:
    """The parts of a file by place: many chunks and the few others."""

    def __init__(self) -> None:
        """Start with none."""
        self._rows = bytearray()
        self._chunks = 0
        self.others: list[tuple[int, records.MetadataIndex | records.AttachmentIndex]] = []

    def __len__(self) -> int:
        """Return how many there are."""
        return self._chunks + len(self.others)

    def add(self, chunk: Stored) -> None:
        """Note a chunk behind all others."""
        for count in chunk.counts:
            self._rows += _COUNT.pack(*count)
        self._rows += _CHUNK.pack(*chunk[:-1], len(chunk.counts))
        self._chunks += 1

    def chunks(self) -> Iterator[Stored]:
        """Yield the chunks, the last one first."""
        end = len(self._rows)
        while end:
            middle = end - _CHUNK.size
            start, size, raw_size, first_ns, last_ns, channels = _CHUNK.unpack_from(self._rows, middle)
            end = middle + _CHUNK.size - packed_bytes(channels)
            counts = tuple((channel, messages) for channel, messages in _COUNT.iter_unpack(self._rows[end:middle]))
            yield Stored(start, size, raw_size, first_ns, last_ns, counts)

    def pop(self) -> int:
        """Forget the last part and return where it starts."""
        chunk = next(self.chunks(), None)
        if chunk is None or (self.others and self.others[-1][0] > chunk.start):
            return self.others.pop()[0]
        del self._rows[-packed_bytes(len(chunk.counts)):]
        self._chunks -= 1
        return chunk.start
