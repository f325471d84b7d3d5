"""The index at the end of an MCAP file, and the place of each chunk in it."""
import struct
import zlib
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

Index = records.ChunkIndex | records.MetadataIndex | records.AttachmentIndex
MAGIC = b'\x89MCAP0\r\n'


class Part(NamedTuple):
    """What the index says of one part of a file, small: a long recording keeps one for each of its chunks.

    Where it starts, its index record as bytes, first and last log time, and (channel, messages) of what is in it.
    """

    start: int
    record: bytes
    start_ns: int = 0
    end_ns: int = 0
    counts: tuple[tuple[int, int], ...] = ()


def part_of(start: int, index: Index, counts: dict[int, int]) -> Part:
    """Return what is kept of a part."""
    if isinstance(index, records.ChunkIndex):
        return Part(start, record_bytes(index), index.message_start_time, index.message_end_time,
                    tuple(counts.items()))
    return Part(start, record_bytes(index))


def record_bytes(*rows: records.McapRecord) -> bytes:
    """Return records as they stand in a file."""
    builder = RecordBuilder()
    for row in rows:
        row.write(builder)
    return _taken(builder)


def placed(chunk: records.Chunk, size: int, messages: dict[int, list[tuple[int, int]]],
           start: int) -> tuple[bytes, bytes, records.ChunkIndex]:
    """Return what stands before and after the data of a chunk that starts at ``start``, and the record that finds it.

    ``chunk`` has no data itself, to copy none: ``size`` bytes follow. ``messages`` has (log time, offset in the
    chunk) by channel.
    """
    assert not chunk.data
    head = record_bytes(chunk)
    head = head[:1] + struct.pack('<Q', len(head) - 9 + size) + head[9:-8] + struct.pack('<Q', size)
    builder, offsets, length = RecordBuilder(), {}, len(head) + size
    for channel, entries in messages.items():
        offsets[channel] = start + length + builder.count
        records.MessageIndex(channel_id=channel, records=entries).write(builder)
    index = records.ChunkIndex(
        message_start_time=chunk.message_start_time, message_end_time=chunk.message_end_time,
        chunk_start_offset=start, chunk_length=length, message_index_offsets=offsets,
        message_index_length=builder.count, compression=chunk.compression, compressed_size=size,
        uncompressed_size=chunk.uncompressed_size)
    return head, _taken(builder), index


def closing(schemas: Sequence[records.Schema], channels: Sequence[records.Channel], parts: Sequence[Part],
            end: int) -> bytes:
    """Return all that follows the last part of a file, which is at ``end``: data end, index, footer."""
    data_end = record_bytes(records.DataEnd(data_section_crc=0))
    start = end + len(data_end)
    groups = [record_bytes(*schemas), record_bytes(*channels),
              record_bytes(statistics(len(schemas), len(channels), parts))]
    for _, rows in groupby(sorted((part.record for part in parts), key=_opcode), _opcode):
        groups.append(b''.join(rows))
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


def statistics(schemas: int, channels: int, parts: Sequence[Part]) -> records.Statistics:
    """Return the counts of a file."""
    counts: Counter[int] = Counter()
    for part in parts:
        counts.update(dict(part.counts))
    kinds = Counter(_opcode(part.record) for part in parts)
    chunks = [part for part in parts if part.counts]
    return records.Statistics(
        message_count=counts.total(), channel_message_counts=dict(counts), schema_count=schemas,
        channel_count=channels, chunk_count=len(chunks), metadata_count=kinds[Opcode.METADATA_INDEX],
        attachment_count=kinds[Opcode.ATTACHMENT_INDEX],
        message_start_time=min((part.start_ns for part in chunks), default=0),
        message_end_time=max((part.end_ns for part in chunks), default=0))


def _taken(builder: RecordBuilder) -> bytes:
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _opcode(record: bytes) -> int:
    return record[0]
