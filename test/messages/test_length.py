"""For every type in the package, a message's length is compared with the length that its contents require."""
import struct

import pytest

from dragon_ros.core.scene import Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.length import LengthCheck
from dragon_ros.messages.schemas import is_schema_of, schema_text

SCENE = Scene()
BENCHES = LengthCheck('visualization_msgs/msg/MarkerArray')


@pytest.mark.parametrize('name', encoders(SCENE))
def test_a_message_of_the_package_is_whole_and_neither_a_part_nor_more_of_it_is(name):
    kind, encode = channels()[name].type, encoders(SCENE)[name]
    data, check = bytes(encode(tick(SCENE, 0))), LengthCheck(kind)
    for fresh in (check, check, LengthCheck(kind)):
        assert fresh.fault(data) is None
        assert f'{kind}: the message ends at byte' in fresh.fault(data + bytes(8))
        assert f'{kind}: the bytes end at' in fresh.fault(data[:-4])
        assert fresh.fault(data) is None


def test_a_message_may_be_padded_to_its_alignment_and_no_further():
    check, data = LengthCheck('std_msgs/msg/Bool'), b'\0\1\0\0\1'
    assert [check.fault(data + bytes(n)) is None for n in range(9)] == [True, False, False, True, *[False] * 5]


def test_a_double_of_16_bytes_is_too_long_and_no_encoding_is_named():
    check = LengthCheck('std_msgs/msg/Float64')
    assert check.fault(b'\0\1\0\0' + bytes(12)) == 'std_msgs/msg/Float64: the message ends at byte 12 of 16'
    assert 'not plain CDR' in check.fault(b'\0\7\0\0' + bytes(8))


def test_texts_of_any_length_in_both_byte_orders_are_followed():
    check = LengthCheck('std_msgs/msg/String')
    for order, head in (('<', b'\0\1\0\0'), ('>', b'\0\0\0\0')):
        for size in (1, 4, 1, 9):
            data = head + struct.pack(f'{order}I', size) + bytes(size)
            assert check.fault(data) is None
            assert check.fault(data[:-1]) is not None


def test_schemas_are_the_same_whatever_their_comments_and_spaces():
    name = 'std_msgs/msg/Float64'
    assert is_schema_of(name, f'# a number\n\n{schema_text(name)}  # of 8 bytes\n')
    assert not is_schema_of(name, 'float32 data')
    assert not is_schema_of('../std_msgs/msg/Float64', schema_text(name))
