import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.bags.check.examine import examine
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.errors import DragonError, InputError, MissingError


@pytest.mark.parametrize('damage', ['empty', 'text', 'truncated', 'magic only', 'no messages'])
def test_a_damaged_bag_is_a_clear_error_naming_the_file(tmp_path, bag_bytes, damage):
    path = tmp_path / 'bad.mcap'
    if damage == 'no messages':
        BagWriter(path).close()
    else:
        path.write_bytes({'empty': b'', 'text': b'hello world, I am not a bag' * 9, 'magic only': bag_bytes[:8],
                          'truncated': bag_bytes[:len(bag_bytes) // 2]}[damage])
    with pytest.raises(InputError, match='bad.mcap'), BagReader(path) as bag:
        list(bag.messages())


def test_a_missing_bag_is_a_clear_error(tmp_path):
    with pytest.raises(MissingError, match='nothing.mcap'):
        BagReader(tmp_path / 'nothing.mcap')


@given(st.booleans(), st.integers(0, 2**20), st.integers(1, 255))
def test_a_flipped_byte_is_noticed_or_harmless(tmp_path_factory, bag_bytes, from_the_end, place, flip):
    path = tmp_path_factory.mktemp('flip') / 'a.mcap'
    at = len(bag_bytes) - 1 - place % 3000 if from_the_end else place % len(bag_bytes)
    path.write_bytes(bag_bytes[:at] + bytes([bag_bytes[at] ^ flip]) + bag_bytes[at + 1:])
    try:
        with BagReader(path) as bag:
            for _ in bag.messages():
                pass
    except DragonError:
        pass


def test_a_bag_of_another_encoding_is_refused(tmp_path):
    from mcap.writer import Writer
    with (tmp_path / 'j.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel('/x', 'json', writer.register_schema('std_msgs/msg/String', 'ros2msg', b''))
        writer.add_message(channel, 0, b'{}', 0)
        writer.finish()
    with pytest.raises(InputError, match='only cdr'):
        BagReader(tmp_path / 'j.mcap')


@pytest.mark.parametrize('opcode', [9, 12], ids=['attachment', 'metadata'])
def test_a_record_that_other_readers_stop_at_is_a_problem(tmp_path, bag_bytes, opcode):
    # The record is inserted after the header.
    path, begin = tmp_path / 'a.mcap', 8 + 9 + int.from_bytes(bag_bytes[9:17], 'little')
    record = bytes([opcode]) + (5).to_bytes(8, 'little') + bytes(4) + b'\1'
    path.write_bytes(bag_bytes[:begin] + record + bag_bytes[begin:])
    said = f'damaged at byte {begin} of {path.stat().st_size}: a record with opcode {opcode}'
    assert any(said in line for line in examine(path).problems.lines)
