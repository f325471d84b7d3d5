"""One MCAP file, chunk by chunk: a chunk reaches the disk whole or is taken back, so that the file can be closed.

The library's writer ends a chunk by its size alone and cannot take back what a full disk cut off. Here its records are
put together so that a chunk ends when it should; only the Message record, that of the hot path, is packed by hand.
A full chunk is compressed and written on a thread, while the next one is filled; two buffers take turns.
"""
import os
import zlib
from collections.abc import Callable
from contextlib import suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from functools import partial
from io import FileIO
from pathlib import Path

from mcap import records

from dragon_ros import __version__
from dragon_ros.bags.write.mcap_chunk import CHUNK_BYTES, OpenChunk
from dragon_ros.bags.write.mcap_index import MAGIC, around, closing, record_bytes
from dragon_ros.bags.write.mcap_parts import Parts, Stored
from dragon_ros.bags.write.worker import OneBehind
from dragon_ros.core.errors import DiskError, MissingError

COMPRESSIONS = ('zstd', 'lz4', 'none')
_Bytes = bytes | memoryview


class McapFile:
    """Writes one file. What fails to reach the disk raises DiskError and leaves the file as it was before.

    The error of a chunk comes with the next call that writes; what was put into the file since is lost with it.
    """

    def __init__(self, path: Path, overwrite: bool = False, compression: str = 'zstd', fsync: bool = False) -> None:
        """Create the file. Raises MissingError where it cannot be written or would overwrite another."""
        self.path = path
        self._compression = '' if compression == 'none' else compression
        self._compress = _compressor(compression)
        self._file = _create(path, overwrite)
        self._fsync = fsync
        self._schemas: list[records.Schema] = []
        self._channels: list[records.Channel] = []
        self.parts = Parts()        # of what has reached the file
        self._open, self._other = OpenChunk(), OpenChunk()
        self._thread = OneBehind('chunk')
        self._end = 0
        self._append([MAGIC, record_bytes(records.Header('ros2', f'dragon_ros {__version__}'))])

    @property
    def size(self) -> int:
        """Bytes of the file as if it were ended now, not counting the index: the open chunk counts uncompressed."""
        self._settle()
        return self._end + self._open.size

    @property
    def closed(self) -> bool:
        """Whether the file has been ended."""
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
        """Put one message into the open chunk; a full chunk is written."""
        self._open.add(channel, data, t_ns, sequence, publish_ns)
        if self._open.size >= CHUNK_BYTES:
            self._end_chunk()

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record behind what came before."""
        self.flush()
        data = record_bytes(records.Metadata(name=name, metadata=values))
        start = self._append([data])
        self.parts.others.append((start, records.MetadataIndex(offset=start, length=len(data), name=name)))

    def add_attachment(self, name: str, media_type: str, content: bytes) -> None:
        """Write an attachment behind what came before."""
        self.flush()
        row = records.Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=content)
        data = record_bytes(row)
        start = self._append([data])
        self.parts.others.append((start, records.AttachmentIndex(
            offset=start, length=len(data), log_time=0, create_time=0, data_size=len(content), name=name,
            media_type=media_type)))

    def flush(self) -> None:
        """Write the open chunk and wait until it is in the file."""
        self._end_chunk()
        self._settle()

    def _end_chunk(self) -> None:
        """Have the open chunk written, if there is anything in it."""
        if self._open.size:
            self._settle()
            done, self._open = self._open, self._other
            self._other = done
            self._open.clear()
            self._thread.start(partial(self._write_chunk, done, zlib.crc32(done.data)))

    def _settle(self) -> None:
        """Wait until the ended chunks are in the file. Behind one that is lost nothing may follow: there was a gap."""
        try:
            self._thread.settle()
        except DiskError:
            self._open.clear()
            raise

    def _write_chunk(self, done: OpenChunk, crc: int) -> None:
        """Write a chunk. Few calls on large buffers: each gives the interpreter away and waits to have it back."""
        data, times_ns = self._compress(done.data), done.times_ns()
        chunk = records.Chunk(compression=self._compression, data=b'', message_start_time=times_ns[0],
                              message_end_time=times_ns[1], uncompressed_crc=crc, uncompressed_size=done.size)
        head, tail = around(chunk, len(data), done.index)
        start = self._append([head, data, tail])
        self.parts.add(Stored(start, len(data), done.size, *times_ns, done.counts()))
        if self._fsync:
            self._sync()
        self._check_there()

    def finish(self) -> None:
        """Write the index and close. Where the disk has no room for it, the last chunks give theirs.

        Raises DiskError where messages are lost by that; the file is whole all the same.
        """
        try:
            try:
                self.flush()
            finally:
                self._write_index()
            if self._fsync:
                self._sync()
        finally:
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
        """Write at the end, whole or not at all; return where it starts."""
        try:
            self._write(data)
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self._end)
                self._file.seek(self._end)
            raise DiskError(f'{self.path}: cannot be written on: {error.strerror}; what was written before is kept'
                            ) from None
        start = self._end
        self._end += sum(map(len, data))
        return start

    def _write(self, data: list[_Bytes]) -> None:
        """Write buffers where the file stands; a disk that is almost full takes only a part at first."""
        done, whole = os.writev(self._file.fileno(), data), sum(map(len, data))
        if done < whole:
            rest = memoryview(b''.join(data))[done:]
            while rest:
                rest = rest[self._file.write(rest):]

    def _sync(self) -> None:
        with suppress(OSError):
            os.fdatasync(self._file.fileno())

    def _check_there(self) -> None:
        """Notice that the file was moved or removed: writing into it goes on without an error."""
        try:
            same = os.path.samestat(os.stat(self.path), os.fstat(self._file.fileno()))
        except OSError:
            same = False
        if not same:
            raise DiskError(f'{self.path}: is no longer there; it was moved or removed while it was written')


def _compressor(name: str) -> Callable[[memoryview], _Bytes]:
    """Return what compresses a chunk. Level 1 of zstd makes dragons as small as level 3 does."""
    if name == 'none':
        return lambda raw: raw
    if name == 'lz4':
        import lz4.frame
        return lambda raw: bytes(lz4.frame.compress(raw))
    from zstandard import ZstdCompressor
    return ZstdCompressor(level=1).compress


def _create(path: Path, overwrite: bool) -> FileIO:
    try:
        if overwrite and path.exists() and not path.stat().st_mode & 0o222:
            raise MissingError(f'{path}: is read-only; give another --output')
        # An existing file is emptied only once it is known that nobody else writes it.
        file = FileIO(path, 'r+' if overwrite and path.exists() else 'x')
        flock(file, LOCK_EX | LOCK_NB)
        file.truncate(0)
        return file
    except BlockingIOError:
        file.close()
        raise MissingError(f'{path}: another recorder is writing it; give another --output') from None
    except FileExistsError:
        raise MissingError(f'{path}: exists already; give another --output, or --force to replace it') from None
    except OSError as error:
        raise MissingError(f'{path}: cannot be written: {error.strerror}; give another --output') from None
