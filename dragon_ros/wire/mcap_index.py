"""The index at the end of an MCAP file, and the place of each chunk in it."""
import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import NamedTuple

from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

Index = records.ChunkIndex | records.MetadataIndex | records.AttachmentIndex
MAGIC = b'\x89MCAP0\r\n'


class Part(NamedTuple):
    """What the index says of one part of a file: where it starts, its index record, messages by channel in it."""

    start: int
    record: Index
    counts: dict[int, int]


def record_bytes(*rows: records.McapRecord) -> bytes:
    """Return records as they stand in a file."""
    builder = RecordBuilder()
    for row in rows:
        row.write(builder)
    return _taken(builder)


def placed(chunk: records.Chunk, messages: dict[int, list[tuple[int, int]]],
           start: int) -> tuple[bytes, records.ChunkIndex]:
    """Return the bytes of a chunk that starts at ``start`` with its message indexes, and the record that finds it.

    ``messages`` has (log time, offset in the chunk) by channel.
    """
    builder, offsets = RecordBuilder(), {}
    chunk.write(builder)
    length = builder.count
    for channel, entries in messages.items():
        offsets[channel] = start + builder.count
        records.MessageIndex(channel_id=channel, records=entries).write(builder)
    index = records.ChunkIndex(
        message_start_time=chunk.message_start_time, message_end_time=chunk.message_end_time,
        chunk_start_offset=start, chunk_length=length, message_index_offsets=offsets,
        message_index_length=builder.count - length, compression=chunk.compression, compressed_size=len(chunk.data),
        uncompressed_size=chunk.uncompressed_size)
    return _taken(builder), index


def closing(schemas: Sequence[records.Schema], channels: Sequence[records.Channel], parts: Sequence[Part],
            end: int) -> bytes:
    """Return all that follows the last part of a file, which is at ``end``: data end, index, footer."""
    data_end = record_bytes(records.DataEnd(data_section_crc=0))
    start = end + len(data_end)
    by_kind = sorted((part.record for part in parts), key=_opcode)
    summary, offsets = b'', []
    for row in (schemas, channels, [statistics(len(schemas), len(channels), parts)],
                *(list(rows) for _, rows in groupby(by_kind, _opcode))):
        if row:
            group = record_bytes(*row)
            offsets.append(records.SummaryOffset(group_opcode=Opcode(group[0]), group_start=start + len(summary),
                                                 group_length=len(group)))
            summary += group
    offset_start = start + len(summary)
    summary += record_bytes(*offsets)
    crc = zlib.crc32(struct.pack('<BQQQ', Opcode.FOOTER, 20, start, offset_start), zlib.crc32(summary))
    footer = records.Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc)
    return data_end + summary + record_bytes(footer) + MAGIC


def statistics(schemas: int, channels: int, parts: Iterable[Part]) -> records.Statistics:
    """Return the counts of a file."""
    counts: Counter[int] = Counter()
    for part in parts:
        counts.update(part.counts)
    kinds = Counter(_opcode(part.record) for part in parts)
    chunks = [part.record for part in parts if isinstance(part.record, records.ChunkIndex)]
    return records.Statistics(
        message_count=counts.total(), channel_message_counts=dict(counts), schema_count=schemas,
        channel_count=channels, chunk_count=len(chunks), metadata_count=kinds[Opcode.METADATA_INDEX],
        attachment_count=kinds[Opcode.ATTACHMENT_INDEX],
        message_start_time=min((chunk.message_start_time for chunk in chunks), default=0),
        message_end_time=max((chunk.message_end_time for chunk in chunks), default=0))


def _taken(builder: RecordBuilder) -> bytes:
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _opcode(index: Index) -> Opcode:
    return {records.ChunkIndex: Opcode.CHUNK_INDEX, records.MetadataIndex: Opcode.METADATA_INDEX,
            records.AttachmentIndex: Opcode.ATTACHMENT_INDEX}[type(index)]
