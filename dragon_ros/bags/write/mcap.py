"""Writes one MCAP file chunk by chunk. A chunk is written completely or not at all, so the file can always be closed.

It is written by hand because the library's writer (mcap 1.6) takes 1.4 to 2 times the CPU time of `simulate`, accepts
no chunks that several cores have compressed, needs six times the memory for its index, has a fixed level of zstd, and
can neither go on nor be closed after a failed write. Records are encoded by the library, except for Message and
MessageIndex, which are packed here because they are on the hot path. With two alternating buffers, a thread compresses
and writes a full chunk while the next one is filled. A caller that has its own writer thread does not use this thread,
since handing over a chunk costs as much as filling it.
"""
import os
import struct
import zlib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from io import FileIO
from itertools import chain
from pathlib import Path
from pickle import PickleBuffer
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from dragon_ros.bags.write.empty_bag import holds_no_message
from dragon_ros.bags.write.lock import lock
from dragon_ros.core import limits
from dragon_ros.core.errors import DiskError, MissingError
from dragon_ros.core.numerics.types import Array
from dragon_ros.version import __version__

_CHUNK = struct.Struct('<QQQQQH')       # start, size, raw size, first log time, last log time, number of channels
_COUNT = struct.Struct('<HQ')           # channel, number of messages; each chunk's channels come before the chunk
_INDEX = struct.Struct('<BQHI')         # opcode, length, channel, size of the entries, which follow
_CHUNK_HEAD, _INDEX_HEAD, _INDEX_ENTRY = 49, 15, 16     # bytes: Chunk without its compression name, MessageIndex
CHUNK_BYTES = 2**20
_BUFFER_BYTES = 2 * CHUNK_BYTES
_MESSAGE = struct.Struct('<BQHIQQ')      # opcode, length, channel, sequence, log time, publish time; the data follow
_HEAD = np.dtype({'names': ['sequence', 'log', 'publish'], 'formats': ['<u4', '<u8', '<u8'], 'offsets': [11, 15, 23]})
MESSAGE_HEAD_BYTES = _MESSAGE.size
MESSAGE_BYTES = limits.CHUNK_BYTES - _MESSAGE.size      # limit on a message's data, since readers reject larger chunks
MAGIC = b'\x89MCAP0\r\n'
_Bytes = bytes | bytearray | memoryview


class Worker:
    """Runs jobs on a thread, in order; at most one is pending, which bounds memory use."""

    def __init__(self, name: str) -> None:
        """``name`` is the name of the thread, which starts with the first job."""
        self._pool = ThreadPoolExecutor(1, name)
        self._job: Future[None] | None = None

    def start(self, job: Callable[[], None]) -> None:
        """Wait for the previous job, then start the new one. If the previous job failed, raise its error instead.

        This method returns when the job first releases the interpreter lock. A thread that merely requests the lock can
        starve while its holder keeps releasing and retaking it, as numpy does; the job would then run only when the
        caller waits for it.
        """
        self.settle()
        begun = Lock()
        begun.acquire()
        self._job = self._pool.submit(_after, begun, job)
        begun.acquire()

    def settle(self) -> None:
        """Wait until the job is done. Raises the job's error, but only once."""
        if self._job is None:
            return
        error = self._job.exception()
        self._job = None
        if error is not None:
            raise error

    def close(self) -> None:
        """Wait for the job and end the thread."""
        self._pool.shutdown()


class NoWorker:
    """Runs jobs in the calling thread; replaces a Worker if the caller has its own thread."""

    def start(self, job: Callable[[], None]) -> None:
        """Run a job. Raises its error."""
        job()

    def settle(self) -> None:
        """Do nothing, since no job is ever pending."""

    def close(self) -> None:
        """Do nothing, since there is no thread."""


def _after(begun: Lock, job: Callable[[], None]) -> None:
    """Run a job. The caller waits until the job starts, and resumes when this thread releases the interpreter lock."""
    begun.release()
    job()


def packed_bytes(topics: int) -> int:
    """Return the size in bytes of the index entry for a chunk with messages on this many topics."""
    return _CHUNK.size + topics * _COUNT.size


class Stored(NamedTuple):
    """A chunk in a file: offset, compressed and raw size, first and last log time, and (channel, message count)."""

    start: int
    size: int
    raw_size: int
    first_ns: int
    last_ns: int
    counts: tuple[tuple[int, int], ...]

    def found_by(self, compression: str) -> records.ChunkIndex:
        """Return the chunk's index record; its channels' MessageIndex records follow the chunk in order."""
        length = _CHUNK_HEAD + len(compression) + self.size
        offsets, end = {}, self.start + length
        for channel, messages in self.counts:
            offsets[channel] = end
            end += _INDEX_HEAD + _INDEX_ENTRY * messages
        return records.ChunkIndex(
            message_start_time=self.first_ns, message_end_time=self.last_ns, chunk_start_offset=self.start,
            chunk_length=length, message_index_offsets=offsets, message_index_length=end - self.start - length,
            compression=compression, compressed_size=self.size, uncompressed_size=self.raw_size)


class FileParts:
    """The parts of a file in order: chunks and a few other records, packed because a long recording has many chunks."""

    def __init__(self) -> None:
        """Start empty."""
        self._rows = bytearray()
        self._chunks = 0
        self.others: list[tuple[int, records.MetadataIndex | records.AttachmentIndex]] = []

    def __len__(self) -> int:
        """Return the number of parts."""
        return self._chunks + len(self.others)

    def add(self, chunk: Stored) -> None:
        """Append a chunk."""
        for count in chunk.counts:
            self._rows += _COUNT.pack(*count)
        self._rows += _CHUNK.pack(*chunk[:-1], len(chunk.counts))
        self._chunks += 1

    def chunks(self) -> Iterator[Stored]:
        """Yield the chunks from last to first."""
        end = len(self._rows)
        while end:
            middle = end - _CHUNK.size
            start, size, raw_size, first_ns, last_ns, channels = _CHUNK.unpack_from(self._rows, middle)
            end = middle + _CHUNK.size - packed_bytes(channels)
            counts = tuple((channel, messages) for channel, messages in _COUNT.iter_unpack(self._rows[end:middle]))
            yield Stored(start, size, raw_size, first_ns, last_ns, counts)

    def pop(self) -> int:
        """Remove the last part and return its offset."""
        chunk = next(self.chunks(), None)
        if chunk is None or (self.others and self.others[-1][0] > chunk.start):
            return self.others.pop()[0]
        del self._rows[-packed_bytes(len(chunk.counts)):]
        self._chunks -= 1
        return chunk.start


class OpenChunk:
    """The chunk being filled: message records in a reused buffer; ``index`` lists (log time, offset) by channel."""

    def __init__(self) -> None:
        """Start empty."""
        self._buffer = _memory(_BUFFER_BYTES)
        self.clear()

    def clear(self) -> None:
        """Remove the messages, and free the memory of an unusually large chunk."""
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
        end = first + len(data)
        if end > len(self._buffer):
            larger = _memory(2 * end)
            larger[:start] = self._buffer[:start]
            self._buffer = larger
        _MESSAGE.pack_into(self._buffer, start, Opcode.MESSAGE, 22 + len(data), channel, sequence, t_ns, publish_ns)
        self._buffer[first:end] = data
        self.index[channel].append((t_ns, start))
        self.size = end

    def takes(self, size: int) -> bool:
        """Return whether a message of this size fits; readers would reject a larger chunk."""
        return self.size + _MESSAGE.size + size <= limits.CHUNK_BYTES

    @property
    def is_full(self) -> bool:
        """Whether the chunk is large enough to be written."""
        return self.size >= CHUNK_BYTES

    def times_ns(self) -> tuple[int, int]:
        """Return the first and the last log time."""
        times = [t_ns for entries in self.index.values() for t_ns, _ in entries]
        return min(times), max(times)

    def counts(self) -> tuple[tuple[int, int], ...]:
        """Return (channel, number of messages) for each channel that has messages."""
        return tuple((channel, len(entries)) for channel, entries in self.index.items())


class RepeatedChunk(OpenChunk):
    """A chunk that repeats a round of messages of fixed sizes: it is laid out once, and filled in place."""

    def __init__(self, messages: Sequence[tuple[int, bytes]], rounds: int) -> None:
        """Lay out ``rounds`` copies of a round; each message is given as (channel, data)."""
        layout, self._offsets = bytearray(), dict[int, int]()
        for channel, data in messages:
            self._offsets[channel] = len(layout)
            layout += _MESSAGE.pack(Opcode.MESSAGE, 22 + len(data), channel, 0, 0, 0) + data
        super().__init__()
        self._buffer, self.stride = memoryview(layout * rounds), len(layout)

    def clear(self) -> None:
        """Keep the layout, but count no round as filled."""
        self.size, self.index = 0, {}

    def begin(self, times_ns: Sequence[int], sequence: int) -> list[int]:
        """Begin a chunk with one round for each time, numbered from ``sequence`` on.

        Return the offset in ``data`` of each message's data in the first round; the caller patches these data and their
        copies, which are ``stride`` bytes apart.
        """
        rounds = len(times_ns)
        self.size = rounds * self.stride
        for channel, offset in self._offsets.items():
            heads: Array = np.ndarray(rounds, _HEAD, self._buffer, offset, (self.stride,))
            heads['sequence'] = np.arange(sequence, sequence + rounds)
            heads['log'] = heads['publish'] = np.array(times_ns, np.uint64)
            self.index[channel] = list(zip(times_ns, range(offset, self.size, self.stride), strict=True))
        return [offset + _MESSAGE.size for offset in self._offsets.values()]


def _memory(size: int) -> memoryview:
    """Return a buffer; pages that are never written use no memory."""
    return np.empty(size, np.uint8).data


def record_bytes(*rows: records.McapRecord) -> bytes:
    """Return records as bytes."""
    builder = RecordBuilder()
    for row in rows:
        row.write(builder)
    return _taken(builder)


def around(chunk: records.Chunk, size: int, messages: dict[int, list[tuple[int, int]]]) -> tuple[bytes, bytes]:
    """Return the bytes before and after the data of a chunk.

    ``chunk`` has no data, to save a copy; ``size`` is the size of its data in bytes. ``messages`` lists, by channel,
    (log time, offset in the chunk).
    """
    assert not chunk.data
    head = record_bytes(chunk)
    head = head[:1] + struct.pack('<Q', len(head) - 9 + size) + head[9:-8] + struct.pack('<Q', size)
    return head, b''.join(_message_index(channel, entries) for channel, entries in messages.items())


def _message_index(channel: int, entries: Sequence[tuple[int, int]]) -> bytes:
    """Return a MessageIndex record, packed with one call for all of its entries."""
    size = _INDEX_ENTRY * len(entries)
    return _INDEX.pack(Opcode.MESSAGE_INDEX, _INDEX_HEAD - 9 + size, channel, size) + struct.pack(
        f'<{2 * len(entries)}Q', *chain.from_iterable(entries))


class PackedChunk(NamedTuple):
    """A compressed chunk: the bytes around it, raw size, first and last log time, and (channel, message count)."""

    head: bytes
    data: _Bytes
    tail: bytes
    raw_size: int
    times_ns: tuple[int, int]
    counts: tuple[tuple[int, int], ...]

    def __reduce_ex__(self, protocol: Any) -> tuple[type['PackedChunk'], tuple[Any, ...]]:
        """Pickle the chunk; from protocol 5 on, its data can be transferred separately, through shared memory."""
        data = PickleBuffer(self.data) if protocol >= 5 else bytes(self.data)
        return PackedChunk, (self.head, data, *self[2:])


def packed(done: OpenChunk, compression: str, compress: Callable[[memoryview], _Bytes]) -> PackedChunk:
    """Return a chunk in its stored form; ``compression`` is MCAP's name for the algorithm of ``compress``."""
    data, times_ns = compress(done.data), done.times_ns()
    chunk = records.Chunk(compression=compression, data=b'', message_start_time=times_ns[0],
                          message_end_time=times_ns[1], uncompressed_crc=zlib.crc32(done.data),
                          uncompressed_size=done.size)
    head, tail = around(chunk, len(data), done.index)
    return PackedChunk(head, data, tail, done.size, times_ns, done.counts())


class Packer:
    """Packs messages into chunks in the same way as a McapWriter."""

    def __init__(self, compression: str) -> None:
        """``compression`` is a name from BagOptions."""
        self._compression, self._compress = mcap_name(compression), compressor(compression)
        self._open = OpenChunk()

    def pack(self, messages: Iterable[tuple[int, bytes, int, int]]) -> list[PackedChunk]:
        """Return messages as chunks; each message is given as (channel, data, time in ns, sequence number)."""
        chunks = []
        for channel, data, t_ns, sequence in messages:
            if self._open.size and not self._open.takes(len(data)):
                chunks.append(self._ended())
            self._open.add(channel, data, t_ns, sequence, t_ns)
            if self._open.is_full:
                chunks.append(self._ended())
        return [*chunks, self._ended()] if self._open.size else chunks

    def packed(self, chunk: OpenChunk) -> PackedChunk:
        """Return a filled chunk in its stored form."""
        done = packed(chunk, self._compression, self._compress)
        return done._replace(data=bytes(done.data))     # uncompressed data are in a buffer that will be reused

    def _ended(self) -> PackedChunk:
        done = self.packed(self._open)
        self._open.clear()
        return done


def mcap_name(compression: str) -> str:
    """Return MCAP's name for a compression."""
    return '' if compression == 'none' else compression


def closing(schemas: Sequence[records.Schema], channels: Sequence[records.Channel], parts: FileParts,
            compression: str, end: int) -> bytes:
    """Return the bytes that follow a file's last part, which ends at ``end``: DataEnd, index and footer."""
    data_end = record_bytes(records.DataEnd(data_section_crc=0))
    start = end + len(data_end)
    chunks = [record_bytes(chunk.found_by(compression)) for chunk in parts.chunks()]
    groups = [record_bytes(*schemas), record_bytes(*channels),
              record_bytes(statistics(len(schemas), len(channels), parts)), b''.join(reversed(chunks))]
    groups += [record_bytes(*(row for _, row in parts.others if isinstance(row, kind)))
               for kind in (records.AttachmentIndex, records.MetadataIndex)]
    summary, offsets = b'', []
    for group in groups:
        if group:
            offsets.append(records.SummaryOffset(group_opcode=Opcode(group[0]), group_start=start + len(summary),
                                                 group_length=len(group)))
            summary += group
    offset_start = start + len(summary)
    summary += record_bytes(*offsets)
    crc = zlib.crc32(struct.pack('<BQQQ', Opcode.FOOTER, 20, start, offset_start), zlib.crc32(summary))
    footer = records.Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc)
    return data_end + summary + record_bytes(footer) + MAGIC


def statistics(schemas: int, channels: int, parts: FileParts) -> records.Statistics:
    """Return the Statistics record of a file."""
    counts: Counter[int] = Counter()
    for chunk in parts.chunks():
        counts.update(dict(chunk.counts))
    others = Counter(type(row) for _, row in parts.others)
    return records.Statistics(
        message_count=counts.total(), channel_message_counts=dict(sorted(counts.items())),
        schema_count=schemas, channel_count=channels, chunk_count=len(parts) - len(parts.others),
        metadata_count=others[records.MetadataIndex], attachment_count=others[records.AttachmentIndex],
        message_start_time=min((chunk.first_ns for chunk in parts.chunks()), default=0),
        message_end_time=max((chunk.last_ns for chunk in parts.chunks()), default=0))


def _taken(builder: RecordBuilder) -> bytes:
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class McapWriter:
    """Writes one file. A failed write raises DiskError and leaves the file unchanged.

    If writing a chunk fails on a thread, the next call that writes raises the error; messages added in between are lost
    with the chunk.
    """

    def __init__(self, path: Path, overwrite: bool = False, compression: str = 'zstd', fsync: bool = False,
                 threaded: bool = True) -> None:
        """Create the file. Raises MissingError if the file cannot be written or would overwrite another file."""
        self.path = path
        self._compression = mcap_name(compression)
        self._compress = compressor(compression)
        self._file = _create(path, overwrite)
        self._fsync = fsync
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self.parts = FileParts()        # parts written to the file
        self._open, self._other = OpenChunk(), OpenChunk()
        self._thread = Worker('chunk') if threaded else NoWorker()
        self._end, self._noticed = 0, False
        try:
            self._append([_HEADER])
        except DiskError:
            self._close()
            with suppress(OSError):
                path.unlink()
            raise

    @property
    def size(self) -> int:
        """The size of the file in bytes, without its index; the open chunk is counted uncompressed."""
        self._settle()
        return self._end + self._open.size

    @property
    def closed(self) -> bool:
        """Whether the file has been closed."""
        return self._file.closed

    def add_schema(self, name: str, text: bytes) -> int:
        """Write a ros2msg schema and return its number."""
        schema = records.Schema(id=len(self._schemas) + 1, name=name, encoding='ros2msg', data=text)
        self._settle()
        self._append([record_bytes(schema)])
        self._schemas.append(schema)
        return schema.id

    def add_channel(self, topic: str, schema: int, metadata: dict[str, str]) -> int:
        """Write a channel of CDR messages and return its number."""
        channel = records.Channel(id=len(self._channels) + 1, topic=topic, message_encoding='cdr', metadata=metadata,
                                  schema_id=schema)
        self._settle()
        self._append([record_bytes(channel)])
        self._channels.append(channel)
        return channel.id

    def add_message(self, channel: int, data: bytes, t_ns: int, sequence: int, publish_ns: int) -> None:
        """Add one message of at most MESSAGE_BYTES to the open chunk; a full chunk is written."""
        if not self._open.takes(len(data)):
            self.end_chunk()
        self._open.add(channel, data, t_ns, sequence, publish_ns)
        if self._open.is_full:
            self.end_chunk()

    def add_filled(self, chunk: OpenChunk) -> None:
        """Write the open chunk, and then hand over another one, which must not change until the next call returns."""
        self.flush()
        self._thread.start(partial(self._write_chunk, chunk))

    def add_chunk(self, chunk: PackedChunk) -> None:
        """Write the open chunk, and then a chunk that was packed elsewhere."""
        self.flush()
        self._write_packed(chunk)

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Append a metadata record."""
        self.flush()
        data = record_bytes(records.Metadata(name=name, metadata=values))
        start = self._append([data])
        self.parts.others.append((start, records.MetadataIndex(offset=start, length=len(data), name=name)))

    def add_attachment(self, name: str, media_type: str, content: bytes) -> None:
        """Append an attachment."""
        self.flush()
        row = records.Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=content)
        data = record_bytes(row)
        start = self._append([data])
        self.parts.others.append((start, records.AttachmentIndex(
            offset=start, length=len(data), log_time=0, create_time=0, data_size=len(content), name=name,
            media_type=media_type)))

    def flush(self) -> None:
        """Write the open chunk and wait until it is in the file."""
        self.end_chunk()
        self._settle()

    def end_chunk(self) -> None:
        """Hand the open chunk over for writing unless it is empty."""
        if self._open.size:
            self._settle()
            done, self._open = self._open, self._other
            self._other = done
            self._open.clear()
            self._thread.start(partial(self._write_chunk, done))

    def _settle(self) -> None:
        """Wait until the ended chunks are in the file. If a chunk is lost, drop the open chunk too, to avoid a gap."""
        try:
            self._thread.settle()
        except DiskError:
            self._open.clear()
            raise

    def _write_chunk(self, done: OpenChunk) -> None:
        self._write_packed(packed(done, self._compression, self._compress))

    def _write_packed(self, chunk: PackedChunk) -> None:
        """Write a chunk with a single system call, because each call releases and retakes the interpreter lock."""
        start = self._append([chunk.head, chunk.data, chunk.tail])
        self.parts.add(Stored(start, len(chunk.data), chunk.raw_size, *chunk.times_ns, chunk.counts))
        if self._fsync:
            self._sync()
        self._check_there()

    def finish(self) -> None:
        """Write the index and close the file. If the disk is full, remove the last chunks to make space for the index.

        Raises DiskError if this loses messages; even then, the file is complete.
        """
        try:
            try:
                self.flush()
            finally:
                self._write_index()
            if self._fsync:
                self._sync()
            if not self._noticed:
                self._check_there()
        finally:
            self._close()

    def _close(self) -> None:
        self._thread.close()
        with suppress(OSError):
            self._file.close()

    def _write_index(self) -> None:
        full: DiskError | None = None
        while True:
            try:
                self._append([closing(self._schemas, self._channels, self.parts, self._compression, self._end)])
                break
            except DiskError as error:
                if not self.parts:
                    raise
                full = error
            self._end = self.parts.pop()
            self._file.truncate(self._end)
            self._file.seek(self._end)
        if full:
            raise full

    def _append(self, data: list[_Bytes]) -> int:
        """Append all of the bytes, or none of them if writing fails; return their offset."""
        if os.fstat(self._file.fileno()).st_size < self._end:
            raise self._truncated()
        try:
            self._write(data)
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self._end)
                self._file.seek(self._end)
            raise DiskError(f'{self.path}: cannot be continued: {error.strerror}; earlier data are kept') from None
        start = self._end
        self._end += sum(map(len, data))
        return start

    def _truncated(self) -> DiskError:
        """Remove the lost parts from the list after another program truncated the file; return the error."""
        size = os.fstat(self._file.fileno()).st_size
        while self.parts and self._end > size:
            self._end = self.parts.pop()
        if self._end > size:        # the records before the first part were truncated, too
            self._end = len(_HEADER)
            self._file.seek(0)
            self._write([_HEADER])
        self._file.truncate(self._end)
        self._file.seek(self._end)
        return DiskError(f'{self.path}: was truncated to {size} bytes by another program during recording; the '
                         'rest is lost')

    def _write(self, data: list[_Bytes]) -> None:
        """Write buffers at the current position, in several calls if an almost full disk accepts only a part."""
        done, whole = os.writev(self._file.fileno(), data), sum(map(len, data))
        if done < whole:
            rest = memoryview(b''.join(data))[done:]
            while rest:
                rest = rest[self._file.write(rest):]

    def _sync(self) -> None:
        with suppress(OSError):
            os.fdatasync(self._file.fileno())

    def _check_there(self) -> None:
        """Raise DiskError if the file was moved or removed, since writing does not detect that."""
        try:
            same = os.path.samestat(os.stat(self.path), os.fstat(self._file.fileno()))
        except OSError:
            same = False
        if not same:
            self._noticed = True
            raise DiskError(f'{self.path}: no longer exists; it was moved or removed during recording')


_HEADER = MAGIC + record_bytes(records.Header('ros2', f'dragon_ros {__version__}'))


def compressor(name: str) -> Callable[[memoryview], _Bytes]:
    """Return the function that compresses a chunk.

    MCAP's C++ library calls level -3 of zstd "fast". For 223 benches, bags are 5 % larger than at the default level 1,
    but writing them takes three fifths of the time, and reading them takes half the time.
    """
    if name == 'none':
        return lambda raw: raw
    if name == 'lz4':
        import lz4.frame
        return lambda raw: bytes(lz4.frame.compress(raw))
    from zstandard import ZstdCompressor
    return ZstdCompressor(level=-3).compress


def _create(path: Path, overwrite: bool) -> FileIO:
    try:
        if overwrite and path.exists() and not path.stat().st_mode & 0o222:
            raise MissingError(f'{path}: is read-only; give another --output')
        # An existing file is emptied only after it is locked, that is, when no other process is writing it.
        file = FileIO(path, 'r+' if path.exists() and (overwrite or holds_no_message(path)) else 'x')
        lock(file)
        file.truncate(0)
        return file
    except BlockingIOError:
        file.close()
        raise MissingError(f'{path}: another recorder is writing it; give another --output') from None
    except FileExistsError:
        raise MissingError(f'{path}: it already exists; give another --output, or --force to replace it') from None
    except OSError as error:
        raise MissingError(f'{path}: cannot be written: {error.strerror}; give another --output') from None
