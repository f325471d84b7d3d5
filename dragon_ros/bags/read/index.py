"""What an MCAP file holds: from its summary where there is a whole one, else by walking over its records."""
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, MetadataIndex, Schema, Statistics

from dragon_ros.bags.read.chunk import MOST_CHUNK, Inner, Row, chunk_data, chunk_head, message_time_ns, records_in
from dragon_ros.bags.read.records import HEAD, MAGIC, BagError, BagFile, Place, parse_fields

MOST_SUMMARY = 64 * 2**20   # bytes, and as much for all schemas and channels
_RUN = 4 * 2**20            # messages outside of chunks are taken together up to so many bytes


@dataclass(frozen=True)
class Piece:
    """A chunk, or a run of messages outside of chunks: where it stands, and the times of its messages in ns."""

    file: BagFile
    place: Place
    start_ns: int
    end_ns: int

    def records(self) -> bytes:
        """Return its records, decompressed and checked. Raises BagError."""
        place = self.place
        if place.opcode != Opcode.CHUNK:
            return self.file.read(place.offset, place.end - place.offset)
        if self.file.place(place.offset) != place:
            raise self.file.fault(place.offset, 'the index has a chunk there, which it is not')
        return chunk_data(self.file, place)

    def inside(self, data: bytes) -> Iterator[Row | Inner]:
        """Yield what stands in its records. Raises BagError with the chunk's offset."""
        try:
            yield from records_in(data)
        except ValueError as error:
            raise self.file.fault(self.place.offset, f'a chunk: {error}') from None


@dataclass
class Index:
    """Contents of one file.

    ``damage`` is where and why a walk over it ended early, ``cut`` the chunk that it ended in. ``data_end`` is where
    the records end that the summary is about, None where that is not known.
    """

    file: BagFile
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    pieces: list[Piece] = field(default_factory=list)
    metadata: list[Place] = field(default_factory=list)
    attachments: list[Place] = field(default_factory=list)
    statistics: Statistics | None = None
    damage: BagError | None = None
    cut: Place | None = None
    data_end: Place | None = None
    _learned: int = 0

    def learn(self, opcode: int, content: bytes) -> None:
        """Take a schema or a channel in. Raises ValueError where its fields do not fit, or all of them are too much."""
        self._learned += len(content) if opcode in (Opcode.SCHEMA, Opcode.CHANNEL) else 0
        if self._learned > MOST_SUMMARY:
            raise ValueError(f'its schemas and channels are more than {MOST_SUMMARY} bytes')
        if opcode == Opcode.SCHEMA:
            schema = parse_fields(content, Schema.read)
            self.schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = parse_fields(content, Channel.read)
            self.channels.setdefault(channel.id, channel)

    def survey(self, piece: Piece) -> Iterator[tuple[Row, bytes]]:
        """Yield the messages of a piece and its records; count them, learn schemas and channels. Raises BagError."""
        data = piece.records()
        for record in piece.inside(data):
            if isinstance(record, Row):
                self.counts[record.channel] += 1
                yield record, data
                continue
            try:
                self.learn(record.opcode, data[record.start:record.end])
            except ValueError as error:
                raise piece.file.fault(piece.place.offset, f'a chunk: its record at {record.start}: {error}') from None


def summary_index(file: BagFile) -> Index | None:
    """Return what the summary says; None where there is none or it is not complete. Raises BagError."""
    at, footer = file.footer()
    if footer.summary_start == 0:
        return None
    if not len(MAGIC) <= footer.summary_start <= at.offset:
        raise file.fault(at.offset, f'the footer puts the summary at {footer.summary_start}')
    length = at.offset - footer.summary_start
    if length > MOST_SUMMARY:
        raise file.fault(at.offset, f'a summary of {length} bytes; the largest that is read has {MOST_SUMMARY}')
    data = file.read(footer.summary_start, length)
    crc = zlib.crc32(file.read(at.offset, HEAD.size + 16), zlib.crc32(data))
    if footer.summary_crc and footer.summary_crc != crc:
        raise file.fault(footer.summary_start, f'the CRC of the summary is {crc:08x}; it should be '
                         f'{footer.summary_crc:08x}')
    return _complete(_summary(file, footer.summary_start, data))


def _summary(file: BagFile, start: int, data: bytes) -> Index:
    index, at = Index(file), 0
    try:
        for record in records_in(data):
            if isinstance(record, Inner):
                at = record.start
                _take(index, record.opcode, data[record.start:record.end])
    except ValueError as error:
        raise file.fault(start + at, f'the summary: {error}') from None
    return index


def _take(index: Index, opcode: int, content: bytes) -> None:
    """Take one record of the summary in."""
    index.learn(opcode, content)
    if opcode == Opcode.STATISTICS:
        index.statistics = parse_fields(content, Statistics.read)
        index.counts.update(index.statistics.channel_message_counts)
    elif opcode == Opcode.CHUNK_INDEX:
        chunk = parse_fields(content, ChunkIndex.read)
        place = _indexed(index.file, Opcode.CHUNK, chunk.chunk_start_offset, chunk.chunk_length)
        index.pieces.append(Piece(index.file, place, chunk.message_start_time, chunk.message_end_time))
    elif opcode == Opcode.METADATA_INDEX:
        metadata = parse_fields(content, MetadataIndex.read)
        index.metadata.append(_indexed(index.file, Opcode.METADATA, metadata.offset, metadata.length))
    elif opcode == Opcode.ATTACHMENT_INDEX:
        # Only the first two fields matter here: offset and length of the attachment.
        offset, length = (parse_fields(content[at:at + 8], lambda fields: fields.read8()) for at in (0, 8))
        index.attachments.append(_indexed(index.file, Opcode.ATTACHMENT, offset, length))


def _indexed(file: BagFile, opcode: int, offset: int, length: int) -> Place:
    if not len(MAGIC) <= offset <= file.size - length or length < HEAD.size:
        raise ValueError(f'it puts a record of {length} bytes at {offset}; the file has {file.size}')
    return Place(opcode, offset, length - HEAD.size)


def _complete(index: Index) -> Index | None:
    """Return the index if it says all that a reader needs; writers may leave parts of a summary out."""
    said = index.statistics
    places = {piece.place.offset for piece in index.pieces}
    if said is None or len(places) != len(index.pieces):
        return None
    found = len(index.pieces), len(index.channels), len(index.metadata), len(index.attachments)
    wanted = said.chunk_count, said.channel_count, said.metadata_count, said.attachment_count
    whole = found == wanted and (bool(said.chunk_count) or not said.message_count)
    return index if whole and all(known(index, channel) for channel in index.channels.values()) else None


def known(index: Index, channel: Channel) -> bool:
    """Return whether the schema of a channel is there."""
    return channel.schema_id == 0 or channel.schema_id in index.schemas


def walked_index(file: BagFile, progress: Callable[[int], object] = lambda offset: None) -> Index:
    """Return what stands in the file, record by record, up to its end or the first damage; chunks stay closed."""
    index = Index(file)
    run: list[tuple[Place, int]] = []
    try:
        for place in file.places(len(MAGIC)):
            progress(place.end)
            if place.opcode == Opcode.MESSAGE:
                run = _grow(index, run, place)
                continue
            if place.opcode == Opcode.DATA_END:
                index.data_end = place
                break
            _note(index, place)
    except BagError as error:
        index.damage = error
        index.cut = _cut(file, error.fields.get('offset'))
    _end_run(index, run)
    if index.data_end is None and index.damage is None:
        index.damage = file.fault(file.size, 'the recording was cut off there')
    return index


def _note(index: Index, place: Place) -> None:
    """Take one record of the data section in."""
    if place.opcode == Opcode.CHUNK:
        head = chunk_head(index.file, place)
        index.pieces.append(Piece(index.file, place, head.start_ns, head.end_ns))
    elif place.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        index.file.fields(place, lambda fields: index.learn(place.opcode, fields.read(place.length)))
    elif place.opcode == Opcode.METADATA:
        index.metadata.append(place)
    elif place.opcode == Opcode.ATTACHMENT:
        index.attachments.append(place)


def _grow(index: Index, run: list[tuple[Place, int]], place: Place) -> list[tuple[Place, int]]:
    """Add a message to the run before it, or end that run and start another."""
    if place.length > MOST_CHUNK:
        raise index.file.fault(place.offset, f'a message of {place.length} bytes; the largest that is read has '
                               f'{MOST_CHUNK}')
    t_ns = message_time_ns(index.file, place)
    if run and (run[-1][0].end != place.offset or place.end - run[0][0].offset > _RUN):
        _end_run(index, run)
        run = []
    run.append((place, t_ns))
    return run


def _end_run(index: Index, run: list[tuple[Place, int]]) -> None:
    if run:
        first, last, times = run[0][0], run[-1][0], [t_ns for _, t_ns in run]
        whole = Place(Opcode.MESSAGE, first.offset, last.end - first.content)
        index.pieces.append(Piece(index.file, whole, min(times), max(times)))


def _cut(file: BagFile, offset: int | None) -> Place | None:
    """Return the chunk that begins at an offset if its end is not in the file."""
    if offset is None or offset + HEAD.size > file.size:
        return None
    opcode, length = HEAD.unpack(file.read(offset, HEAD.size))
    place = Place(opcode, offset, length)
    return place if opcode == Opcode.CHUNK and place.end > file.size else None
