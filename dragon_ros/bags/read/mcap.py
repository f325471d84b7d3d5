"""A bounded MCAP reader: each length in a file is checked against the file's size before it is used.

It is written by hand because the library's reader (mcap 1.6) takes 1 GB for a zstd frame of 33 kB, checks no size of an
lz4 frame, reads a whole file on opening, and stops at the first damage with errors of six types that give no offset.
Here every allocation is bounded, damage is reported with its offset, and the records before and after it can be
recovered. The tests judge this reader by the library's.

The layout follows the MCAP specification, version 0: a magic number, records that consist of opcode (1 byte), length (8
bytes) and content, and the magic number again. The ``mcap`` package parses only the fields of small records, and
receives only the bytes of one record at a time.
"""
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from io import BytesIO
from math import inf
from os import SEEK_END
from pathlib import Path
from typing import IO, NamedTuple, TypeVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from dragon_ros.core.errors import InputError, MissingError, shown
from dragon_ros.core.limits import CHUNK_BYTES, RECORD_BYTES, SUMMARY_BYTES
from dragon_ros.core.words import counted

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
FOOTER_BYTES = HEAD.size + 20
T = TypeVar('T')
_FIXED = struct.Struct('<QQQII')
_MESSAGE = struct.Struct('<HIQQ')
_INDEX_HEAD, _INDEX_ENTRY = struct.Struct('<HI'), 16     # head: channel, bytes of its entries; entry: time, offset
_LONGEST_NAME = 32              # limit on the length of a compression's name
_MOST_FAULTS = 100      # limit on the stored faults
_PACKED_MORE = 1 / 128          # largest fraction by which compression can enlarge a chunk (of random bytes)
_RUN = 4 * 2**20            # limit on the size (bytes) of a batch of consecutive messages outside chunks


class BagError(InputError):
    """The file is not a readable bag."""


@dataclass(frozen=True, order=True)
class Location:
    """The location of a record: opcode, offset of its first byte, and length of its content."""

    opcode: int
    offset: int
    length: int

    @property
    def content(self) -> int:
        """The offset of the content."""
        return self.offset + HEAD.size

    @property
    def end(self) -> int:
        """The offset of the next record."""
        return self.content + self.length


class McapFile:
    """One .mcap file, open for reading."""

    def __init__(self, path: Path) -> None:
        """Open the file and check its beginning. Raises MissingError or BagError."""
        self.path = path
        self._file = _open(path)
        try:
            self.size = self._file.seek(0, SEEK_END)
        except OSError as error:
            self.close()
            raise MissingError(f'{path}: cannot be read: {error.strerror}') from None
        if self.read(0, min(self.size, len(MAGIC))) != MAGIC:
            self.close()
            raise BagError(f'{path}: is {"not an MCAP file" if self.size else "empty"} ({counted(self.size, "byte")})')

    def fault(self, offset: int, what: str) -> BagError:
        """Return the error for damage at an offset."""
        return BagError(f'{self.path}: is damaged at byte {offset} of {self.size}: {what}', offset=offset)

    def read(self, offset: int, length: int) -> bytes:
        """Return exactly the requested bytes. Raises BagError if the file has fewer."""
        if not 0 <= length <= self.size - offset:
            raise self.fault(offset, f'{length} bytes should follow, but only {max(0, self.size - offset)} do')
        try:
            self._file.seek(offset)
            data = self._file.read(length)
        except OSError as error:
            raise MissingError(f'{self.path}: cannot be read at byte {offset}: {error.strerror}') from None
        if len(data) != length:
            raise self.fault(offset, f'{length} bytes should follow, but only {len(data)} do')
        return data

    def place(self, offset: int, end: int | None = None) -> Location:
        """Locate the record at an offset. Raises BagError if it ends after ``end`` (by default, the file's end)."""
        end = self.size if end is None else min(end, self.size)
        if offset + HEAD.size > end:
            raise self.fault(offset, 'a record should begin, but only '
                                     f'{counted(max(0, end - offset), "byte", "is")} left')
        place = Location(*_at(HEAD.unpack(self.read(offset, HEAD.size)), offset))
        if place.opcode == 0:
            raise self.fault(offset, 'a record with opcode 0, which is invalid')
        if place.end > end:
            raise self.fault(offset, f'a record with opcode {place.opcode} claims {place.length} bytes, but '
                             f'{end - place.content} remain')
        return place

    def places(self, offset: int, end: int | None = None) -> Iterator[Location]:
        """Locate the records from ``offset`` to exactly ``end`` (by default, the end of the file)."""
        end = self.size if end is None else end
        while offset < end:
            place = self.place(offset, end)
            yield place
            offset = place.end

    def fields(self, place: Location, parse: Callable[[ReadDataStream], T]) -> T:
        """Return the fields of a small record; ``parse`` is the ``read`` method of a class in ``mcap.records``."""
        if place.length > RECORD_BYTES:
            raise self.fault(place.offset, f'a record with opcode {place.opcode} has {counted(place.length, "byte")}; '
                             f'the limit is {RECORD_BYTES}')
        try:
            return parse_fields(self.read(place.content, place.length), parse)
        except ValueError as error:
            raise self.fault(place.offset, f'a record with opcode {place.opcode}: {error}') from None

    @property
    def closed_properly(self) -> bool:
        """Whether the file ends as a properly closed bag does."""
        tail = FOOTER_BYTES + len(MAGIC)
        return self.size >= len(MAGIC) + tail and self.read(self.size - len(MAGIC), len(MAGIC)) == MAGIC

    def footer(self) -> tuple[Location, Footer]:
        """Return the footer. Raises BagError if the file is truncated or has no footer."""
        if not self.closed_properly:
            raise BagError(f'{self.path}: is truncated and has no index ({counted(self.size, "byte")})')
        place = self.place(self.size - len(MAGIC) - FOOTER_BYTES, self.size - len(MAGIC))
        if place.opcode != Opcode.FOOTER or place.end != self.size - len(MAGIC):
            raise self.fault(place.offset, 'expected the footer')
        return place, self.fields(place, Footer.read)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class _Exact(ReadDataStream):
    """A stream that raises an error if fewer bytes remain than requested."""

    def __init__(self, data: bytes) -> None:
        super().__init__(BytesIO(data))
        self._left = len(data)

    def read(self, length: int) -> bytes:
        if length > self._left:
            raise ValueError(f'a field claims {length} bytes, but {self._left} remain')
        self._left -= length
        return super().read(length)


def parse_fields(data: bytes, parse: Callable[[ReadDataStream], T]) -> T:
    """Return the fields of a record's content. Raises ValueError if the fields extend beyond the content."""
    return parse(_Exact(data))


def _at(head: tuple[int, int], offset: int) -> tuple[int, int, int]:
    return head[0], offset, head[1]


def _open(path: Path) -> IO[bytes]:
    try:
        if path.exists() and not path.is_file():    # because opening a pipe would block forever
            raise MissingError(f'{path}: is not a file')
        return path.open('rb')
    except (OSError, ValueError) as error:      # a path that contains a NUL raises ValueError
        raise MissingError(f'{shown(str(path))}: cannot be read: {getattr(error, "strerror", error)}') from None


@dataclass(frozen=True)
class ChunkHead:
    """The head of a chunk: its range of message times (ns), and the size, CRC and location of its records."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    offset: int
    length: int


class StoredMessage(NamedTuple):
    """One message in a chunk; its data are the bytes from ``start`` to ``end``."""

    t_ns: int
    start: int
    end: int
    channel: int
    sequence: int
    publish_ns: int


class OtherRecord(NamedTuple):
    """A record other than a message: its opcode and the location of its content."""

    opcode: int
    start: int
    end: int


def chunk_head(file: McapFile, place: Location) -> ChunkHead:
    """Return the head of a chunk. Raises BagError if the head contradicts the record's length."""
    if place.length < _FIXED.size + 8:
        raise file.fault(place.offset, f'a chunk of {counted(place.length, "byte")}')
    start_ns, end_ns, size, crc, name = _FIXED.unpack(file.read(place.content, _FIXED.size))
    fixed = _FIXED.size + name + 8
    if name > _LONGEST_NAME or fixed > place.length:
        raise file.fault(place.offset, f'a chunk whose compression name has {counted(name, "byte")}')
    text = file.read(place.content + _FIXED.size, name + 8)
    length = int.from_bytes(text[name:], 'little')
    if length != place.length - fixed:
        raise file.fault(place.offset, f'a chunk claims {length} bytes of records, but {place.length - fixed} follow')
    return ChunkHead(start_ns, end_ns, size, crc, text[:name].decode(errors='replace'), place.content + fixed, length)


def chunk_data(file: McapFile, place: Location, checked: bool = True) -> bytes:
    """Return a chunk's records, decompressed and checked against its size and, on request, its CRC. Raises BagError."""
    head = chunk_head(file, place)
    if head.size > CHUNK_BYTES or head.length > (1 + _PACKED_MORE) * CHUNK_BYTES:
        raise file.fault(place.offset, f'a chunk of {max(head.size, head.length)} bytes; the limit is {CHUNK_BYTES}')
    unpack = _UNPACK.get(head.compression)
    if unpack is None:
        raise file.fault(place.offset, f'a chunk with compression {head.compression!r}; zstd, lz4 and none are '
                         'supported')
    try:
        data = unpack(file.read(head.offset, head.length), head.size)
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError) as error:
        raise file.fault(place.offset, f'a chunk cannot be decompressed: {error}') from None
    if len(data) != head.size:
        raise file.fault(place.offset, f'a chunk claims {counted(head.size, "byte")} but contains {len(data)}')
    if checked and head.crc and zlib.crc32(data) != head.crc:
        raise file.fault(place.offset, f'the CRC of a chunk is {zlib.crc32(data):08x}; it should be {head.crc:08x}')
    return data


def message_time_ns(file: McapFile, place: Location) -> int:
    """Return the time of a message outside chunks. Raises BagError."""
    if place.length < _MESSAGE.size:
        raise file.fault(place.offset, f'a message has {counted(place.length, "byte")}')
    t_ns: int = _MESSAGE.unpack(file.read(place.content, _MESSAGE.size))[2]
    return t_ns


def records_in(data: bytes, invalid: bool = False) -> Iterator[StoredMessage | OtherRecord]:
    """Yield the records of a chunk. Raises ValueError with the offset if the records are truncated.

    It also raises ValueError at a record with the invalid opcode 0, unless ``invalid`` is true.
    """
    at, size = 0, len(data)
    while at < size:
        if at + HEAD.size > size:
            raise ValueError(f'its last record, at {at}, is truncated')
        opcode, length = HEAD.unpack_from(data, at)
        start, end = at + HEAD.size, at + HEAD.size + length
        if end > size:
            raise ValueError(f'its record at {at} claims {length} bytes, but {size - start} remain')
        if opcode == 0 and not invalid:
            raise ValueError(f'a record with opcode 0, which is invalid, at {at}')
        if opcode != Opcode.MESSAGE:
            yield OtherRecord(opcode, start, end)
        elif length < _MESSAGE.size:
            raise ValueError(f'its message at {at} has {counted(length, "byte")}')
        else:
            yield row_of(data, start + _MESSAGE.size, end)
        at = end


def row_of(data: bytes, start: int, end: int) -> StoredMessage:
    """Return the message whose data are the bytes from ``start`` to ``end``."""
    channel, sequence, t_ns, publish_ns = _MESSAGE.unpack_from(data, start - _MESSAGE.size)
    return StoredMessage(t_ns, start, end, channel, sequence, publish_ns)


def first_bytes(data: bytes, compression: str) -> bytes:
    """Return the part of a truncated chunk that can be decompressed, up to CHUNK_BYTES bytes."""
    if compression == 'zstd':
        return _first_of_zstd(data)
    if compression == 'lz4':
        return _first_of_lz4(data)
    return data[:CHUNK_BYTES] if compression == '' else b''


def _first_of_zstd(data: bytes) -> bytes:
    # Small steps preserve the data decompressed before the damage.
    reader, out = zstandard.ZstdDecompressor(max_window_size=CHUNK_BYTES).stream_reader(data), bytearray()
    try:
        while len(out) < CHUNK_BYTES and (part := reader.read(2**17)):
            out += part
    except zstandard.ZstdError:
        pass
    return bytes(out)


def _first_of_lz4(data: bytes) -> bytes:
    out, reader = bytearray(), lz4.frame.LZ4FrameDecompressor()
    try:
        for start in range(0, len(data), 2**12):
            if len(out) >= CHUNK_BYTES or reader.eof:
                break
            out += reader.decompress(data[start:start + 2**12], max_length=CHUNK_BYTES - len(out))
    except (RuntimeError, EOFError):
        pass
    return bytes(out)


def _plain(data: bytes, size: int) -> bytes:
    return data


def _zstd(data: bytes, size: int) -> bytes:
    """Check, before allocating memory, that a frame claims the same size as the chunk; then decompress it."""
    claimed = zstandard.frame_content_size(data)
    if claimed not in (-1, size):
        raise ValueError(f'its zstd frame claims {claimed} bytes, the chunk {size}')
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size) if size else b''


def _lz4(data: bytes, size: int) -> bytes:
    out: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    return out


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {'': _plain, 'zstd': _zstd, 'lz4': _lz4}


@dataclass(frozen=True)
class MessageBatch:
    """A chunk, or a run of messages outside chunks, with its location and its range of message times (ns).

    ``messages`` is the number of messages in a chunk according to the indexes that follow it, or None if this number
    need not be checked.
    """

    file: McapFile
    place: Location
    start_ns: int
    end_ns: int
    messages: int | None = None

    def records(self) -> bytes:
        """Return the records of the batch, decompressed and checked. Raises BagError."""
        place = self.place
        if place.opcode != Opcode.CHUNK:
            return self.file.read(place.offset, place.end - place.offset)
        if self.file.place(place.offset) != place:
            raise self.file.fault(place.offset, 'the index lists a chunk there, but there is none')
        return chunk_data(self.file, place)

    def inside(self, data: bytes) -> Iterator[StoredMessage | OtherRecord]:
        """Yield the records of the batch. Raises BagError with the chunk's offset."""
        try:
            yield from records_in(data)
        except ValueError as error:
            raise self.file.fault(self.place.offset, f'a chunk: {error}') from None


@dataclass
class Index:
    """The contents of one file.

    ``damage`` describes where and why a scan ended early; ``cut`` is the incomplete chunk at that point.
    ``fault_count`` is the number of unreadable records between readable records, and ``faults`` lists the first of
    these. ``data_end`` is the last DataEnd record, or None if there is none. ``stray`` lists the DataEnd records that
    are followed by data or by another DataEnd. ``numbered`` counts messages by channel according to the message
    indexes, which ``indexes`` counts. ``reach`` is the offset where the last record ends.

    ``declared`` maps ('schema', number) and ('channel', number) to the offset of the first such record, or of its
    chunk. ``used`` maps channels to the offset of the first batch with a message, or to -1 if that message precedes the
    channel. ``is_late`` tells whether a message index precedes its channel, which may be declared in a chunk.
    """

    file: McapFile
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    batches: list[MessageBatch] = field(default_factory=list)
    metadata: list[Location] = field(default_factory=list)
    attachments: list[Location] = field(default_factory=list)
    statistics: Statistics | None = None
    damage: BagError | None = None
    cut: Location | None = None
    faults: list[BagError] = field(default_factory=list)
    fault_count: int = 0
    data_end: Location | None = None
    stray: list[Location] = field(default_factory=list)
    numbered: Counter[int] = field(default_factory=Counter)
    indexes: Counter[int] = field(default_factory=Counter)
    reach: int = 0
    declared: dict[tuple[str, int], int] = field(default_factory=dict)
    used: dict[int, int] = field(default_factory=dict)
    is_late: bool = False
    _learned: int = 0

    def learn(self, opcode: int, content: bytes, offset: int = 0) -> None:
        """Register a schema or a channel. Raises ValueError if it is malformed or if the total exceeds the limit."""
        if opcode == Opcode.SCHEMA:
            schema = parse_fields(content, Schema.read)
            self._declare(('schema', schema.id), offset)
            self._count(content, schema, self.schemas.setdefault(schema.id, schema))
        elif opcode == Opcode.CHANNEL:
            channel = parse_fields(content, Channel.read)
            self._declare(('channel', channel.id), offset)
            self._count(content, channel, self.channels.setdefault(channel.id, channel))

    def _declare(self, what: tuple[str, int], offset: int) -> None:
        # Not the first one learned: a scan learns those of the summary before those in chunks.
        self.declared[what] = min(offset, self.declared.get(what, offset))

    def _count(self, content: bytes, found: Schema | Channel, known: Schema | Channel) -> None:
        if found is known:
            self._learned += len(content)
            if self._learned > SUMMARY_BYTES:
                raise ValueError(f'its schemas and channels exceed the limit of {SUMMARY_BYTES} bytes')
        elif found != known:
            raise ValueError(f'it declares {type(found).__name__.lower()} {found.id} twice, with different contents')

    @property
    def lacking(self) -> list[str]:
        """A line for each schema or channel that is not declared before its use; other readers stop there."""
        lines = [f'channel {number} has the schema {channel.schema_id}, which is not declared before it'
                 for number, channel in self.channels.items() if channel.schema_id and not (
                     self._at('schema', channel.schema_id) <= self._at('channel', number))]
        return lines + [f'a message on channel {number} precedes the declaration of the channel'
                        for number, offset in self.used.items() if offset < self._at('channel', number) < inf]

    def _at(self, kind: str, number: int) -> float:
        return self.declared.get((kind, number), inf)

    def fault(self, error: BagError) -> None:
        """Count an unreadable record."""
        self.fault_count += 1
        if len(self.faults) < _MOST_FAULTS:
            self.faults.append(error)

    def survey(self, batch: MessageBatch) -> Iterator[tuple[StoredMessage, bytes]]:
        """Yield each message of a batch with the batch's records; count messages, register schemas and channels.

        Raises BagError.
        """
        data = batch.records()
        for record in batch.inside(data):
            if isinstance(record, StoredMessage):
                self.counts[record.channel] += 1
                if record.channel not in self.used:
                    known = self._at('channel', record.channel) <= batch.place.offset
                    self.used[record.channel] = batch.place.offset if known else -1
                yield record, data
            else:
                self.learn_inside(batch, record, data)

    def learn_inside(self, batch: MessageBatch, record: OtherRecord, data: bytes) -> None:
        """Register a schema or a channel in a chunk. Raises BagError."""
        try:
            self.learn(record.opcode, data[record.start:record.end], batch.place.offset)
        except ValueError as error:
            raise batch.file.fault(batch.place.offset, f'a chunk: its record at {record.start}: {error}') from None


def summary_index(file: McapFile) -> Index | None:
    """Return the index from the summary, or None if there is no summary. Raises BagError."""
    at, footer = file.footer()
    if footer.summary_start == 0:
        return None
    if not len(MAGIC) <= footer.summary_start <= at.offset:
        raise file.fault(at.offset, f'the footer puts the summary at {footer.summary_start}')
    length = at.offset - footer.summary_start
    if length > SUMMARY_BYTES:
        raise file.fault(at.offset, f'a summary of {length} bytes; the limit is {SUMMARY_BYTES}')
    data = file.read(footer.summary_start, length)
    crc = zlib.crc32(file.read(at.offset, HEAD.size + 16), zlib.crc32(data))
    if footer.summary_crc and footer.summary_crc != crc:
        raise file.fault(footer.summary_start, f'the CRC of the summary is {crc:08x}; it should be '
                         f'{footer.summary_crc:08x}')
    return _summary(file, footer.summary_start, data)


def _summary(file: McapFile, start: int, data: bytes) -> Index:
    index, at = Index(file), 0
    try:
        for record in records_in(data):
            if isinstance(record, OtherRecord):
                at = record.start
                _take(index, record.opcode, data[record.start:record.end])
    except ValueError as error:
        raise file.fault(start + at, f'the summary: {error}') from None
    return index


def _take(index: Index, opcode: int, content: bytes) -> None:
    """Add one record of the summary to the index."""
    index.learn(opcode, content)
    if opcode == Opcode.STATISTICS:
        index.statistics = parse_fields(content, Statistics.read)
        index.counts.update(index.statistics.channel_message_counts)
    elif opcode == Opcode.CHUNK_INDEX:
        chunk = parse_fields(content, ChunkIndex.read)
        place = _indexed(index.file, Opcode.CHUNK, chunk.chunk_start_offset, chunk.chunk_length)
        index.batches.append(MessageBatch(index.file, place, chunk.message_start_time, chunk.message_end_time))
        index.indexes.update(chunk.message_index_offsets.keys())
    elif opcode == Opcode.METADATA_INDEX:
        metadata = parse_fields(content, MetadataIndex.read)
        index.metadata.append(_indexed(index.file, Opcode.METADATA, metadata.offset, metadata.length))
    elif opcode == Opcode.ATTACHMENT_INDEX:
        # Only the first two fields are needed: offset and length of the attachment.
        offset, length = (parse_fields(content[at:at + 8], lambda fields: fields.read8()) for at in (0, 8))
        index.attachments.append(_indexed(index.file, Opcode.ATTACHMENT, offset, length))


def _indexed(file: McapFile, opcode: int, offset: int, length: int) -> Location:
    if not len(MAGIC) <= offset <= file.size - length or length < HEAD.size:
        raise ValueError(f'it puts a record of {counted(length, "byte")} at byte {offset}, but the file has '
                         f'{file.size}')
    return Location(opcode, offset, length - HEAD.size)


def scanned_index(file: McapFile, progress: Callable[[int], object] = lambda offset: None) -> Index:
    """Scan all records up to the first damage, without decompressing chunks, and return the index.

    All commands use this index as the definition of a bag's contents. It contains the messages that a stream reader
    sees: those inside and outside chunks, including any after a stray DataEnd. The summary, which only repeats
    information, follows the last DataEnd.
    """
    scan = _Scan(Index(file))
    try:
        for place in file.places(len(MAGIC)):
            progress(place.end)
            if place.offset == len(MAGIC) and place.opcode != Opcode.HEADER:
                scan.index.fault(file.fault(place.offset, f'a record with opcode {place.opcode} instead of the header'))
            if not scan.take(place):
                break
    except BagError as error:
        scan.end(error)
    else:
        scan.end(None)
    return scan.index


_DATA = (Opcode.MESSAGE, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA)
# Records that a scan only parses, because other readers stop at a malformed one.
_PARSED: dict[int, Callable[[ReadDataStream], object]] = {
    Opcode.HEADER: Header.read, Opcode.DATA_END: DataEnd.read, Opcode.STATISTICS: Statistics.read,
    Opcode.METADATA: Metadata.read, Opcode.ATTACHMENT: Attachment.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read, Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex.read, Opcode.SUMMARY_OFFSET: SummaryOffset.read}
_LARGE = (Opcode.METADATA, Opcode.ATTACHMENT)      # they may exceed the limit, and are then not read


class _Scan:
    """Processes records one by one."""

    def __init__(self, index: Index) -> None:
        self.index = index
        self._run: list[tuple[Location, int]] = []
        self._numbered: int | None = None       # number of messages in the last chunk, from its indexes
        self._end: Location | None = None       # the last DataEnd record, unless data followed it

    def take(self, place: Location) -> bool:
        """Process a record; return whether further records may follow."""
        index = self.index
        if place.opcode == Opcode.FOOTER:
            if place.end + len(MAGIC) != index.file.size:
                raise index.file.fault(place.offset, 'a footer that does not end the file: '
                                       f'{counted(index.file.size - place.end, "more byte")}')
            return False
        if place.opcode == Opcode.DATA_END:
            self._end_stray()
            self._end = index.data_end = place
        elif place.opcode in _DATA:
            self._end_stray()
        try:
            self._note(place)
        except BagError as error:
            index.fault(error)
        return True

    def end(self, error: BagError | None) -> None:
        """Note where the records end, and any damage there. Ignore damage to the summary, as it loses no messages."""
        self._end_batch()
        index, file = self.index, self.index.file
        index.reach = file.size if error is None else error.fields.get('offset', file.size)
        index.damage = None if self._end else error or file.fault(file.size, 'the recording is truncated there')
        index.cut = None if self._end or error is None else _cut(file, error.fields.get('offset'))

    def _end_stray(self) -> None:
        """Note that the last DataEnd, if there was one, did not end the data section after all."""
        if self._end:
            self.index.stray.append(self._end)
            self._end = None

    def _note(self, place: Location) -> None:
        """Add one record to the index."""
        index = self.index
        if place.opcode == Opcode.MESSAGE:
            self._grow(place)
        elif place.opcode == Opcode.CHUNK:
            self._end_batch()
            head = chunk_head(index.file, place)
            index.batches.append(MessageBatch(index.file, place, head.start_ns, head.end_ns))
            self._numbered = 0
        elif place.opcode == Opcode.MESSAGE_INDEX:
            self._number(place)
        elif place.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            index.file.fields(place, lambda fields: index.learn(place.opcode, fields.read(place.length), place.offset))
        elif place.opcode in _PARSED and (place.opcode not in _LARGE or place.length <= RECORD_BYTES):
            index.file.fields(place, _PARSED[place.opcode])
        if place.opcode == Opcode.METADATA:
            index.metadata.append(place)
        elif place.opcode == Opcode.ATTACHMENT:
            index.attachments.append(place)

    def _number(self, place: Location) -> None:
        """Count the messages listed in one of a chunk's indexes."""
        if self._numbered is None or place.length < _INDEX_HEAD.size:
            raise self.index.file.fault(place.offset, 'a message index that belongs to no chunk')
        channel, size = _INDEX_HEAD.unpack(self.index.file.read(place.content, _INDEX_HEAD.size))
        if size % _INDEX_ENTRY or size > place.length - _INDEX_HEAD.size:
            raise self.index.file.fault(place.offset, f'a message index of {place.length} bytes claims {size} for its '
                                        'entries')
        self._numbered += size // _INDEX_ENTRY
        self.index.numbered[channel] += size // _INDEX_ENTRY
        self.index.indexes[channel] += 1
        self.index.is_late |= ('channel', channel) not in self.index.declared

    def _grow(self, place: Location) -> None:
        """Add a message to the current batch, or end that batch and start another."""
        file, run = self.index.file, self._run
        if place.length > CHUNK_BYTES:
            raise file.fault(place.offset, f'a message of {place.length} bytes; the limit is {CHUNK_BYTES}')
        t_ns = message_time_ns(file, place)
        if not run or run[-1][0].end != place.offset or place.end - run[0][0].offset > _RUN:
            self._end_batch()
        self._run.append((place, t_ns))

    def _end_batch(self) -> None:
        """End the current batch: a chunk or a run of messages outside chunks."""
        batches = self.index.batches
        if self._numbered is not None:
            batches[-1] = replace(batches[-1], messages=self._numbered)
            self._numbered = None
        if self._run:
            first, last, times = self._run[0][0], self._run[-1][0], [t_ns for _, t_ns in self._run]
            whole = Location(Opcode.MESSAGE, first.offset, last.end - first.content)
            batches.append(MessageBatch(self.index.file, whole, min(times), max(times)))
            self._run = []


def is_indexed(scanned: Index, summary: Index) -> bool:
    """Return whether a file's summary, chunk indexes and records agree, so that no chunk needs to be opened.

    The counts in the summary are then correct. An intact file may fail this check, since writers may omit parts of a
    summary.
    """
    said, counts, channels = summary.statistics, +summary.counts, scanned.channels
    return (said is not None and not scanned.fault_count and _chunks(summary) == _chunks(scanned)
            and (said.message_count, said.channel_count) == (counts.total(), len(channels))
            and +scanned.numbered == counts and scanned.indexes == summary.indexes
            and set(counts) <= set(channels) == set(summary.channels)
            and not (scanned.is_late or scanned.lacking or summary.lacking))


def _chunks(index: Index) -> list[tuple[Location, int, int]]:
    """Return the locations and times of a file's batches."""
    return sorted((one.place, one.start_ns, one.end_ns) for one in index.batches)


def _cut(file: McapFile, offset: int | None) -> Location | None:
    """Return the chunk at an offset if it extends beyond the end of the file."""
    if offset is None or offset + HEAD.size > file.size:
        return None
    opcode, length = HEAD.unpack(file.read(offset, HEAD.size))
    place = Location(opcode, offset, length)
    return place if opcode == Opcode.CHUNK and place.end > file.size else None
