"""Make the valid and damaged bags of this folder: ``./dragon python test/data/corpus/make_corpus.py``.

Each bag is small. CORPUS contains the expected results: None for a bag that can be read to its end, and otherwise
words of the error.
"""
import struct
import zlib
from io import BytesIO
from pathlib import Path

import lz4.frame
import zstandard
from mcap.writer import CompressionType, IndexType, Writer

from dragon_ros.bags.write.writer import qos_text
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import live
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.schemas import schema_text, type_hash

HERE = Path(__file__).parent
MAGIC = b'\x89MCAP0\r\n'
SCENE = Scene(Dragon(benches=3), run=Run(10, 10.1))
HUGE = 2**62


def bag(compression=CompressionType.NONE, **options):
    """Return a bag of six ticks of a small dragon."""
    out = BytesIO()
    writer = Writer(out, compression=compression, chunk_size=4000, **options)
    writer.start('ros2', 'corpus')
    encode, ids = encoders(SCENE), {}
    for row in live(SCENE.effects):
        if row.name in encode:
            schema = writer.register_schema(row.type, 'ros2msg', schema_text(row.type)[:40].encode())
            metadata = {'offered_qos_profiles': qos_text(row), 'topic_type_hash': type_hash(row.type)}
            ids[row.name] = writer.register_channel(f'/dragon/{row.name}', 'cdr', schema, metadata)
    for k in range(compile_scene(SCENE).last_tick + 1):
        frame = tick(SCENE, k)
        for name, build in encode.items():
            writer.add_message(ids[name], frame.t_ns, build(frame), frame.t_ns, k + 1)
    writer.finish()
    return out.getvalue()


def foreign(encoding='cdr', times=(1, 2, 3), topic='/chatter', name='std_msgs/msg/String'):
    """Return the bag of another robot."""
    out = BytesIO()
    writer = Writer(out, compression=CompressionType.NONE)
    writer.start('ros2', 'another robot')
    channel = writer.register_channel(topic, encoding, writer.register_schema(name, 'ros2msg', b'string data'))
    for t_ns in times:
        writer.add_message(channel, t_ns, b'\0\1\0\0\2\0\0\0a\0', t_ns)
    writer.finish()
    return out.getvalue()


def record(opcode, content, length=None):
    """Return a record, whose ``length`` may be wrong."""
    return struct.pack('<BQ', opcode, len(content) if length is None else length) + content


def text(value):
    """Return a string in the form in which records contain it."""
    return struct.pack('<I', len(value)) + value


def chunk(data, size, compression, crc=0, length=None):
    """Return a chunk whose claims may be wrong."""
    return record(6, struct.pack('<QQQI', 1, 1, size, crc) + text(compression)
                  + struct.pack('<Q', len(data) if length is None else length) + data)


def closed(*parts):
    """Return a file that has some records and no summary."""
    return b''.join((MAGIC, record(1, text(b'ros2') + text(b'corpus')), *parts, record(15, bytes(4)),
                     record(2, bytes(20)), MAGIC))


def summed(*rows, crc=True):
    """Return a file that has only a summary with some records."""
    head = MAGIC + record(1, text(b'ros2') + text(b'corpus')) + record(15, bytes(4))
    summary = b''.join(rows)
    footer = struct.pack('<BQQQ', 2, 20, len(head), 0)
    return head + summary + footer + struct.pack('<I', zlib.crc32(footer, zlib.crc32(summary)) if crc else 1) + MAGIC


def message(channel=1, data=bytes(8), t_ns=1):
    """Return a message record."""
    return record(5, struct.pack('<HIQQ', channel, 0, t_ns, t_ns) + data)


def bomb(megabytes, pack):
    """Return a chunk of zeros, which is small on the disk and large in memory."""
    return chunk(pack(bytes(megabytes * 2**20)), megabytes * 2**20, b'zstd' if pack is zstd else b'lz4')


def zstd(data):
    """Compress bytes."""
    return zstandard.ZstdCompressor(level=19).compress(data)


def statistics(messages, chunks):
    """Return a statistics record."""
    return record(11, struct.pack('<QHIIIIQQI', messages, 0, 0, 0, 0, chunks, 0, 1, 0))


def chunk_index(offset, length):
    """Return a chunk index record."""
    return record(8, struct.pack('<QQQQIQ', 0, 1, offset, length, 0, 0) + text(b'') + bytes(16))


def flipped(data, at):
    """Return the bytes with one bit flipped."""
    return data[:at] + bytes([data[at] ^ 4]) + data[at + 1:]


def liar_in_zstd():
    """Return a chunk whose zstd frame claims a far larger size than the chunk does."""
    frame = bytearray(zstandard.ZstdCompressor(level=1).compress(bytes(2**20)))
    return chunk(bytes(frame), 100, b'zstd')


GOOD = bag()
# Each file with words of its error. Tests import this module, so slow compression runs only when files are written.
CORPUS = {
    'good_none': (GOOD, None),
    'good_zstd': (bag(CompressionType.ZSTD), None),
    'good_lz4': (bag(CompressionType.LZ4), None),
    'good_without_chunks': (bag(use_chunking=False), None),
    'good_without_indexes': (bag(index_types=IndexType.NONE), None),
    'good_without_summary': (bag(index_types=IndexType.NONE, use_statistics=False, repeat_channels=False,
                                 repeat_schemas=False, use_summary_offsets=False), None),
    'foreign': (foreign(), None),
    'foreign_out_of_order': (foreign(times=(3, 1, 2)), None),
    'foreign_json': (foreign('json'), 'only cdr'),
    'foreign_broken_handles': (foreign(topic='/handles', name='geometry_msgs/msg/PoseArray'), None),
    'empty': (b'', 'empty (0 bytes)'),
    'text': (b'hello world, I am not a bag\n' * 9, 'not an MCAP file'),
    'magic_only': (MAGIC, 'is truncated'),
    'magic_twice': (MAGIC + MAGIC, 'is truncated'),
    'no_messages': (closed(), 'it has no messages'),
    'cut_in_a_chunk': (GOOD[:6000], 'is truncated'),
    'cut_in_the_summary': (GOOD[:-200], 'is truncated'),
    'cut_then_zeros': (GOOD[:6000] + bytes(3000), 'is truncated'),
    'flipped_in_a_chunk': (flipped(GOOD, 2000), 'CRC of a chunk'),
    'flipped_in_the_summary': (flipped(GOOD, len(GOOD) - 300), 'CRC of the summary'),
    'twice': (GOOD + GOOD, 'the summary'),
    'chunk_claims_too_much': (closed(chunk(b'abc', HUGE, b'')), 'the limit is'),
    'chunk_of_unknown_compression': (closed(chunk(b'abc', 3, b'brotli')), "compression 'brotli'"),
    'chunk_data_claim_too_much': (closed(chunk(b'abc', 3, b'', length=HUGE)), 'claims 4611686018427387904 bytes'),
    'record_claims_too_much': (closed(record(4, b'abc', length=HUGE)), 'claims 4611686018427387904 bytes'),
    'record_claims_all_ones': (closed(record(4, b'abc', length=2**64 - 1)), 'claims 18446744073709551615 bytes'),
    'string_claims_too_much': (closed(record(4, bytes(4) + struct.pack('<I', 2**32 - 1))), 'a field claims'),
    'message_too_short': (closed(record(5, b'abc')), 'a message has 3 bytes'),
    'message_in_chunk_too_long': (closed(chunk(record(5, bytes(22), length=HUGE), 31, b'')), 'its record at 0 claims'),
    'message_on_no_channel': (closed(message()), 'it has no messages'),
    'bomb_zstd': (lambda: closed(*[bomb(100, zstd)] * 2), 'a record with opcode 0'),
    'bomb_zstd_too_large': (lambda: closed(bomb(300, zstd)), 'the limit is'),
    'bomb_lz4': (lambda: closed(bomb(16, lz4.frame.compress)), 'a record with opcode 0'),
    'bomb_lz4_that_lies': (closed(chunk(lz4.frame.compress(bytes(2**24)), 100, b'lz4')), 'claims 100 bytes'),
    'bomb_zstd_that_lies': (closed(liar_in_zstd()), 'claims 1048576 bytes, the chunk 100'),
    'bomb_of_messages': (lambda: closed(chunk(zstd(message(data=b'') * 20_000), 31 * 20_000, b'zstd')),
                         'it has no messages'),
    'index_to_nowhere': (summed(statistics(1, 1), chunk_index(HUGE, 100)), 'it puts a record'),
    'index_to_no_chunk': (summed(statistics(1, 1), chunk_index(8, 19)), 'it has no messages'),
    'index_with_many_same': (summed(statistics(1, 9), *[chunk_index(8, 22)] * 9), 'it has no messages'),
    'summary_of_another_crc': (summed(statistics(1, 1), crc=False), 'CRC of the summary'),
    'summary_before_the_file': (GOOD[:-28] + struct.pack('<QQI', 2, 0, 0) + MAGIC, 'puts the summary at 2'),
}


def main():
    """Write the files."""
    for name, (data, _) in CORPUS.items():
        (HERE / f'{name}.mcap').write_bytes(data() if callable(data) else data)


if __name__ == '__main__':
    main()
