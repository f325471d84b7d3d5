"""A malformed record of any known kind among the data of a file is damage, as it is for the mcap library's reader."""
import io
import struct

import pytest
from mcap.opcode import Opcode
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
