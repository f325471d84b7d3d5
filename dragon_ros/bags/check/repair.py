"""A whole bag out of what a cut or damaged one still holds."""
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata
from mcap.writer import CompressionType, Writer

from dragon_ros import __version__
from dragon_ros.bags.check.capped_log import CappedLog
from dragon_ros.bags.read.folder import files_of
from dragon_ros.bags.read.mcap import (
    BagError,
    Index,
    McapFile,
    Piece,
    Place,
    Row,
    chunk_head,
    first_bytes,
    records_in,
    scanned_index,
    summary_index,
)
from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.core.errors import MissingError


@dataclass
class Repaired:
    """How many messages were saved, and a line for each part that could not be."""

    messages: int = 0
    lost: CappedLog = field(default_factory=CappedLog)


class _Sink:
    """Writes what is found, with channels as they were; channel numbers are its own."""

    def __init__(self, file: IO[bytes]) -> None:
        self.writer = Writer(file, compression=CompressionType.ZSTD)
        self.writer.start('ros2', f'dragon_ros {__version__} repair')
        self._channels: dict[tuple[object, ...], int] = {}
        self._schemas: dict[tuple[object, ...], int] = {}

    def channel(self, index: Index, channel: Channel) -> int:
        """Return the number of a channel; the same channel of another file of the bag is the same."""
        schema = index.schemas.get(channel.schema_id)
        named = (schema.name, schema.encoding, schema.data) if schema else ('', '', b'')
        if schema and named not in self._schemas:
            self._schemas[named] = self.writer.register_schema(*named)
        key = channel.topic, channel.message_encoding, named, tuple(sorted(channel.metadata.items()))
        if key not in self._channels:
            self._channels[key] = self.writer.register_channel(
                channel.topic, channel.message_encoding, self._schemas.get(named, 0), channel.metadata)
        return self._channels[key]


def repair(path: Path, output: Path, progress: Callable[[int], object] = lambda size: None) -> Repaired:
    """Write what can be read of a bag as one whole file, in the order it has there. Raises BagError, MissingError."""
    done, parts = Repaired(), files_of(path)
    with _created(output) as out:
        sink = _Sink(out)
        for each in parts:
            with closing(McapFile(each)) as file:
                _save(done, sink, file, progress)
        sink.writer.finish()    # type: ignore[no-untyped-call]
    return done


@contextmanager
def _created(output: Path) -> Iterator[IO[bytes]]:
    """Create a file; what was not written to its end is removed."""
    try:
        with whole_or_none(output, overwrite=False) as out:
            yield out
    except FileExistsError:
        raise MissingError(f'{output}: exists already; give another --repair') from None
    except OSError as error:
        raise MissingError(f'{output}: cannot be written: {error.strerror}; give another --repair') from None


def _save(done: Repaired, sink: _Sink, file: McapFile, progress: Callable[[int], object]) -> None:
    walked = scanned_index(file)
    if walked.damage:
        done.lost.note(walked.damage)
    for place in (*walked.metadata, *walked.attachments):
        _copy(done, sink, file, place)
    for piece in (*walked.pieces, *_beyond(file, walked)):
        try:
            for row, data in walked.survey(piece):
                _put(done, sink, walked, row, data)
        except BagError as error:
            done.lost.note(error)
        progress(piece.place.end - piece.place.offset)
    for row, data in _first(walked):
        _put(done, sink, walked, row, data)


def _put(done: Repaired, sink: _Sink, index: Index, row: Row, data: bytes) -> None:
    channel = index.channels.get(row.channel)
    if channel is None:
        done.lost.note(f'{index.file.path}: a message on channel {row.channel}, which nothing declares')
        return
    sink.writer.add_message(sink.channel(index, channel), row.t_ns, data[row.start:row.end], row.publish_ns,
                            row.sequence)
    done.messages += 1


def _beyond(file: McapFile, walked: Index) -> list[Piece]:
    """Return chunks that the walk did not come to, because of damage before them, and that the summary knows."""
    if not walked.damage:
        return []
    try:
        summary = summary_index(file)
    except BagError:
        return []
    seen = {piece.place.offset for piece in walked.pieces}
    for channel in summary.channels.values() if summary else ():
        walked.channels.setdefault(channel.id, channel)
    for schema in summary.schemas.values() if summary else ():
        walked.schemas.setdefault(schema.id, schema)
    return [piece for piece in summary.pieces if piece.place.offset not in seen] if summary else []


def _first(index: Index) -> Iterator[tuple[Row, bytes]]:
    """Yield the whole messages of the chunk in which the file ends."""
    file = index.file
    try:
        head = chunk_head(file, index.cut) if index.cut else None
    except BagError:
        return
    if head is None:
        return
    data = first_bytes(file.read(head.offset, file.size - head.offset), head.compression)
    try:
        for record in records_in(data):
            if isinstance(record, Row):
                yield record, data
            else:
                index.learn(record.opcode, data[record.start:record.end])
    except ValueError:
        return      # the last one is not whole


def _copy(done: Repaired, sink: _Sink, file: McapFile, place: Place) -> None:
    """Copy a metadata record or an attachment."""
    try:
        if place.opcode == Opcode.METADATA:
            metadata = file.fields(place, Metadata.read)
            sink.writer.add_metadata(metadata.name, metadata.metadata)
        else:
            found = file.fields(place, Attachment.read)
            sink.writer.add_attachment(found.create_time, found.log_time, found.name, found.media_type, found.data)
    except BagError as error:
        done.lost.note(error)
