"""Rebuild a complete bag from a truncated or damaged one."""
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata
from mcap.writer import CompressionType, Writer

from dragon_ros.bags.check.capped_log import CappedLog
from dragon_ros.bags.read.folder import files_of
from dragon_ros.bags.read.mcap import (
    BagError,
    Index,
    Location,
    McapFile,
    MessageBatch,
    StoredMessage,
    chunk_data,
    chunk_head,
    first_bytes,
    records_in,
    scanned_index,
    summary_index,
)
from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.words import counted
from dragon_ros.version import __version__


@dataclass
class Repaired:
    """The number of recovered messages, and a line for each part that was lost.

    ``unsaved`` counts messages that can be parsed but were not saved, because of a wrong CRC or an unknown channel.
    """

    messages: int = 0
    unsaved: int = 0
    lost: CappedLog = field(default_factory=CappedLog)


class _Sink:
    """Writes recovered messages; channels are renumbered but keep all other properties."""

    def __init__(self, file: IO[bytes]) -> None:
        self.writer = Writer(file, compression=CompressionType.ZSTD)
        self.writer.start('ros2', f'dragon_ros {__version__} repair')
        self._channels: dict[tuple[object, ...], int] = {}
        self._schemas: dict[tuple[object, ...], int] = {}

    def channel(self, index: Index, channel: Channel) -> int:
        """Return the number of a channel; equal channels from several files share one number."""
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
    """Write all readable parts of a bag to one complete file, in file order. Raises BagError or MissingError."""
    done, parts = Repaired(), files_of(path)
    with _created(output) as out:
        sink = _Sink(out)
        for each in parts:
            try:
                file = McapFile(each)
            except InputError as error:
                if len(parts) == 1:
                    raise
                done.lost.note(error)       # the recorder was killed just after it began this part
                continue
            with closing(file):
                _save(done, sink, file, progress)
        sink.writer.finish()    # type: ignore[no-untyped-call]
    return done


@contextmanager
def _created(output: Path) -> Iterator[IO[bytes]]:
    """Create a file, and remove it if writing fails."""
    try:
        with whole_or_none(output, overwrite=False) as out:
            yield out
    except FileExistsError:
        raise MissingError(f'{output}: it already exists; give another path to --repair') from None
    except OSError as error:
        raise MissingError(f'{output}: cannot be written: {error.strerror}; give another path to --repair') from None


def _save(done: Repaired, sink: _Sink, file: McapFile, progress: Callable[[int], object]) -> None:
    scanned, before = scanned_index(file), done.unsaved
    for fault in (*scanned.faults, *([scanned.damage] if scanned.damage else ())):
        done.lost.note(fault)
    done.lost.count += scanned.fault_count - len(scanned.faults)
    for place in (*scanned.metadata, *scanned.attachments):
        _copy(done, sink, file, place)
    for batch in (*scanned.batches, *_beyond(file, scanned)):
        counted_before = done.messages + done.unsaved
        try:
            for row, data in scanned.survey(batch):
                _put(done, sink, scanned, row, data)
        except BagError as error:
            done.lost.note(error)
            done.unsaved += max(0, _parsed_in(file, batch.place) + counted_before - done.messages - done.unsaved)
        progress(batch.place.end - batch.place.offset)
    for row, data in _first(scanned):
        _put(done, sink, scanned, row, data)
    if done.unsaved > before:
        done.lost.note_first(f'{file.path}: {counted(done.unsaved - before, "readable message", "was")} not saved')


def _put(done: Repaired, sink: _Sink, index: Index, row: StoredMessage, data: bytes) -> None:
    channel = index.channels.get(row.channel)
    if channel is None:
        done.lost.note(f'{index.file.path}: a message on the undeclared channel {row.channel}')
        done.unsaved += 1
        return
    sink.writer.add_message(sink.channel(index, channel), row.t_ns, data[row.start:row.end], row.publish_ns,
                            row.sequence)
    done.messages += 1


def _parsed_in(file: McapFile, place: Location) -> int:
    """Count the messages of a chunk that can be parsed, even if its CRC is wrong or a record is invalid."""
    found = 0
    if place.opcode != Opcode.CHUNK:
        return found
    with suppress(BagError, ValueError):
        for record in records_in(chunk_data(file, place, checked=False), invalid=True):
            found += isinstance(record, StoredMessage)
    return found


def _beyond(file: McapFile, scanned: Index) -> list[MessageBatch]:
    """Return the chunks that the summary lists beyond the end of the scan."""
    try:
        summary = summary_index(file)
    except BagError:
        return []
    if summary is None:
        return []
    for channel in summary.channels.values():
        scanned.channels.setdefault(channel.id, channel)
    for schema in summary.schemas.values():
        scanned.schemas.setdefault(schema.id, schema)
    return [batch for batch in summary.batches if batch.place.offset > scanned.reach]


def _first(index: Index) -> Iterator[tuple[StoredMessage, bytes]]:
    """Yield the complete messages of a chunk that the end of the file truncates."""
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
            if isinstance(record, StoredMessage):
                yield record, data
            else:
                index.learn(record.opcode, data[record.start:record.end])
    except ValueError:
        return      # the last record is incomplete


def _copy(done: Repaired, sink: _Sink, file: McapFile, place: Location) -> None:
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
