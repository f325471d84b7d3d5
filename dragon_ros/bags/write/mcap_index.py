"""The index at the end of an MCAP file, and the place of each chunk in it."""
import struct
import zlib
from collections import Counter
from collections.abc import Sequence

from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from dragon_ros.bags.write.mcap_parts import Parts

MAGIC = b'\x89MCAP0\r\n'


def record_bytes(*rows: records.McapRecord) -> bytes:
    """Return records as they stand in a file."""
    builder = RecordBuilder()
    for row in rows:
        row.write(builder)
    return _taken(builder)


def around(chunk: records.Chunk, size: int, messages: dict[int, list[tuple[int, int]]]) -> tuple[bytes, bytes]:
    """Return what stands before and after the data of a chunk.

    ``chunk`` has no data itself, to copy none: ``size`` bytes follow. ``messages`` has (log time, offset in the
    chunk) by channel.
    """
    assert not chunk.data
    head = record_bytes(chunk)
    head = head[:1] + struct.pack('<Q', len(head) - 9 + size) + head[9:-8] + struct.pack('<Q', size)
    return head, record_bytes(*(records.MessageIndex(channel_id=channel, records=entries)
                                for channel, entries in messages.items()))


def closing(schemas: Sequence[records.Schema], channels: Sequence[records.Channel], parts: Parts, compression: str,
            end: int) -> bytes:
    """Return all that follows the last part of a file, which is at ``end``: data end, index, footer."""
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


def statistics(schemas: int, channels: int, parts: Parts) -> records.Statistics:
    """Return the counts of a file."""
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
