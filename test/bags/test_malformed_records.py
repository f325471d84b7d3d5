"""A malformed record of any known kind among the data of a file is damage, as it is for the mcap library's reader."""
import io
import re
import struct

import pytest
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from dragon_ros.bags.check.examine import examine
from dragon_ros.bags.read.mcap import MAGIC, BagError
from dragon_ros.bags.read.reader import BagReader

KINDS = [Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX,
         Opcode.CHUNK_INDEX, Opcode.ATTACHMENT, Opcode.ATTACHMENT_INDEX, Opcode.STATISTICS, Opcode.METADATA,
         Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET]


@pytest.mark.parametrize('kind', KINDS)
def test_a_malformed_record_is_damage(tmp_path, bag_bytes, kind):
    path = tmp_path / 'a.mcap'
    first = len(MAGIC) + 9 + int.from_bytes(bag_bytes[len(MAGIC) + 1:len(MAGIC) + 9], 'little')
    content = b'\xff' * 3       # shorter than the fixed fields of any kind
    path.write_bytes(bag_bytes[:first] + struct.pack('<BQ', kind, len(content)) + content + bag_bytes[first:])
    with pytest.raises(Exception):      # noqa: B017, PT011 - the library raises errors of several types
        list(StreamReader(io.BytesIO(path.read_bytes())).records)
    assert any(f'byte {first} of' in line for line in examine(path).problems.lines)
    with pytest.raises(BagError):
        BagReader(path)


@pytest.mark.parametrize('kind', KINDS)
def test_a_malformed_record_is_the_only_damage_that_a_reader_finds(tmp_path, kind):
    path = tmp_path / 'a.mcap'
    schema = record(Opcode.SCHEMA, struct.pack('<H', 1) + text('std_msgs/msg/String') + text('ros2msg') + text(''))
    head = (MAGIC + record(Opcode.HEADER, text('ros2') + text('')) + schema
            + record(Opcode.CHANNEL, channel(1, schema=1)))
    end = MESSAGE + record(Opcode.DATA_END, bytes(4)) + record(Opcode.FOOTER, bytes(20)) + MAGIC
    path.write_bytes(head + end)
    BagReader(path).close()
    path.write_bytes(head + record(kind, b'\xff' * 3) + end)
    assert_damaged(path, f'byte {len(head)} of')


def test_a_file_that_does_not_begin_with_its_header_is_damaged(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(MAGIC + record(Opcode.METADATA, bytes(8)) + record(Opcode.DATA_END, bytes(4))
                     + record(Opcode.FOOTER, bytes(20)) + MAGIC)
    with pytest.raises(McapError):
        make_reader(io.BytesIO(path.read_bytes())).get_header()
    assert_damaged(path, 'instead of the header')


@pytest.mark.parametrize('where', ['data', 'chunk', 'summary', 'late schema', 'late channel', 'late in chunk',
                                   'late in chunk, again in the summary'])
def test_schemas_and_channels_that_are_not_declared_before_their_use_are_damage(tmp_path, where):
    path, undeclared = tmp_path / 'a.mcap', record(Opcode.CHANNEL, channel(2, schema=9))
    schema = record(Opcode.SCHEMA, struct.pack('<H', 1) + text('std_msgs/msg/String') + text('ros2msg') + text(''))
    known = record(Opcode.CHANNEL, channel(1, schema=1))
    data = {'data': [schema, known, undeclared, MESSAGE], 'chunk': [schema, known, chunk(undeclared + MESSAGE)],
            'summary': [schema, known, MESSAGE], 'late schema': [known, schema, MESSAGE],
            'late channel': [schema, MESSAGE, known]}.get(where, [schema, chunk(MESSAGE + known)])
    made = MAGIC + record(Opcode.HEADER, text('ros2') + text('')) + b''.join(data) + record(Opcode.DATA_END, bytes(4))
    summary = {'summary': known, 'late in chunk, again in the summary': schema + known}.get(where, b'')
    path.write_bytes(made + summary + record(Opcode.FOOTER, struct.pack('<QQI', len(made) if summary else 0, 0, 0))
                     + MAGIC)
    reader = make_reader(io.BytesIO(path.read_bytes()))
    if where == 'summary':
        assert reader.get_summary().channels[1].schema_id not in reader.get_summary().schemas
    else:
        with pytest.raises(McapError):
            list(reader.iter_messages())
    assert_damaged(path, 'which is not declared|precedes the declaration', readable=where == 'summary')


MESSAGE = struct.pack('<BQHIQQ', Opcode.MESSAGE, 22, 1, 1, 5, 5)


def record(opcode, content):
    return struct.pack('<BQ', opcode, len(content)) + content


def chunk(records):
    return record(Opcode.CHUNK, struct.pack('<QQQIIQ', 5, 5, len(records), 0, 0, len(records)) + records)


def text(value):
    return struct.pack('<I', len(value)) + value.encode()


def channel(number, schema):
    return struct.pack('<HH', number, schema) + text('/a') + text('cdr') + text('')


def assert_damaged(path, words, readable=False):
    """Check that ``inspect`` finds the damage, and that readers refuse the file unless only its summary is wrong."""
    assert any(re.search(words, line) for line in examine(path).problems.lines)
    if readable:
        BagReader(path).close()
    else:
        with pytest.raises(BagError, match=words):
            BagReader(path)
