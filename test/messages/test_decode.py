"""The general decoder agrees with the real rmw serialiser for every message type, alignment and byte order."""
import struct
import sys
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.limits import MARKER_RUNS
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages import decode as decoder
from dragon_ros.messages.cdr import Writer, float64_of
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import (
    Health,
    MessageError,
    decode,
    read_diagnostics,
    read_health,
    read_marker_array,
    read_multi_array,
    read_pose_array,
)
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.observation import observation_of, read_benches, read_handles
from dragon_ros.messages.schemas import PRIMITIVES, TEXT, fields_of

TYPES = sorted({row.type for row in channels().values()})
RANGES = {'b': (-128, 127), 'B': (0, 255), 'h': (-2**15, 2**15 - 1), 'H': (0, 2**16 - 1), 'i': (-2**31, 2**31 - 1),
          'I': (0, 2**32 - 1), 'q': (-2**63, 2**63 - 1), 'Q': (0, 2**64 - 1)}


def filled(message, rng):
    """Fill a message object with random values; random lengths of strings and sequences make every alignment occur."""
    for name, kind in message.get_fields_and_field_types().items():
        setattr(message, name, random_value(kind, getattr(message, name), rng))
    return message


def random_value(kind, old, rng):
    if kind.startswith('sequence<'):
        inner = kind[len('sequence<'):-1].split(',')[0]
        return [random_value(inner, None, rng) for _ in range(rng.integers(0, 4))]
    if kind.endswith(']'):
        inner, _, size = kind.rstrip(']').partition('[')
        return [random_value(inner, None, rng) for _ in range(int(size))]
    if '/' in kind:
        from dragon_ros.nodes.shell import message_type
        return filled(old if old is not None else message_type(kind.replace('/', '/msg/'))(), rng)
    if kind == 'string':
        return 'x' * int(rng.integers(0, 10))
    if kind == 'boolean':
        return bool(rng.integers(0, 2))
    if kind == 'octet':
        return bytes([rng.integers(0, 256)])
    if kind in ('float', 'double'):
        return float(np.float32(rng.normal()))
    low, high = RANGES[PRIMITIVES[kind]]
    return int(rng.integers(low, high, endpoint=True))


def plain(value):
    """Return a message object in the same form as the decoder's result."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (bytes, bytearray)):
        return value[0]
    if isinstance(value, np.generic):
        return value.item()
    return [plain(one) for one in value] if isinstance(value, (list, tuple)) or hasattr(value, 'tolist') else value


def flat(value):
    """Return all numbers and strings in a value in order, regardless of its structure."""
    if isinstance(value, dict):
        return [one for part in value.values() for one in flat(part)]
    if isinstance(value, (list, np.ndarray)):
        return [one for part in value for one in flat(part)]
    return [value.item() if hasattr(value, 'item') else value]


@pytest.mark.parametrize('name', TYPES)
def test_any_message_of_the_real_serialiser_is_decoded(name):
    serialization = pytest.importorskip('rclpy.serialization')
    from dragon_ros.nodes.shell import message_type
    for seed in range(25):
        message = filled(message_type(name)(), np.random.default_rng(seed))
        assert flat(decode(name, serialization.serialize_message(message))) == flat(plain(message)), seed


def encoded(fields, values, order, out):
    """Append field values in either byte order, as another machine may send them."""
    def put(kind, value):
        size = struct.calcsize(kind)
        out.extend(b'\xee' * (-(len(out) - 4) % size))      # the rmw leaves padding bytes uninitialised
        out.extend(struct.pack(order + kind, value))

    def one(field, value):
        if not field.kind:
            encoded(field.parts, value, order, out)
        elif field.kind == TEXT:
            put('I', len(value.encode()) + 1)
            out.extend(value.encode() + b'\0')
        else:
            for number in np.ravel(value).tolist():
                put(field.kind, number)
    for field in fields:
        value = values[field.name]
        if field.many == 0:
            put('I', len(value))
        for each in [value] if field.many is None else value:
            one(field, each)
    return out


def other_order(name, data):
    """Return a message in big-endian order, with nonzero padding."""
    return bytes(encoded(fields_of(name), decode(name, data), '>', bytearray(4)))


@pytest.mark.parametrize('name', TYPES)
def test_byte_order_and_padding_make_no_difference(name):
    serialization = pytest.importorskip('rclpy.serialization')
    from dragon_ros.nodes.shell import message_type
    for seed in range(5):
        data = serialization.serialize_message(filled(message_type(name)(), np.random.default_rng(seed)))
        assert flat(decode(name, other_order(name, data))) == flat(decode(name, data)), seed


@pytest.mark.parametrize('style', ['cubes', 'triangles'])
@pytest.mark.parametrize('frame_id', ['', 'a', 'map', 'odom', 'dragon', 'a_long_frame_id'])
def test_the_monitor_sees_the_same_in_either_byte_order(style, frame_id):
    scene = Scene(dragon=Dragon(9), run=Run(400, 413), markers=style)
    data = {name: encode(tick(scene, 7)) for name, encode in encoders(scene, frame_id).items()}
    other = {name: other_order(channels()[name].type, one) for name, one in data.items()}
    mine, theirs = (observation_of(read_handles(one['handles']), read_benches(one['benches'])) for one in (data, other))
    assert (mine.t_ns, mine.frame_id, mine.p.tolist()) == (theirs.t_ns, theirs.frame_id, theirs.p.tolist())
    for name in ('centre', 'axis', 'half_length', 'half_width'):
        np.testing.assert_array_equal(getattr(mine.benches, name), getattr(theirs.benches, name))
    labels, values = read_multi_array(data['velocities'])
    assert read_multi_array(other['velocities'])[0] == labels
    np.testing.assert_array_equal(read_multi_array(other['velocities'])[1], values)


@pytest.mark.parametrize('text', ['', 'x', 'xx', 'xxxx', 'xxxxxxxx'])
@pytest.mark.parametrize('ns', ['bench', 'be'])
def test_cubes_with_any_string_lengths_are_viewed_in_one_or_two_runs(text, ns):
    """A layout whose size is not a multiple of 8 bytes shifts the second marker; all later markers are alike."""
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import MarkerArray
    scene = Scene(dragon=Dragon(40), run=Run(400, 413))
    data = encoders(scene)['benches'](tick(scene, 0))
    message = serialization.deserialize_message(data, MarkerArray)
    for marker in message.markers:
        marker.text, marker.ns = text, ns
    again = read_marker_array(serialization.serialize_message(message))
    assert len(again.runs) <= 3
    np.testing.assert_array_equal(again.poses, read_marker_array(data).poses)
    np.testing.assert_array_equal(again.id, np.arange(40))


class Marking(decoder.Reader):
    """A reader that records which bytes it uses; all others are padding."""

    def skip(self, kind, count=1):
        start = super().skip(kind, count)
        self.used = getattr(self, 'used', {0, 1, 2, 3}) | set(range(start, self.at))
        return start


@pytest.mark.parametrize('style', ['cubes', 'triangles'])
@pytest.mark.parametrize('frame_id', ['', 'a', 'map', 'odom', 'dragon'])
@pytest.mark.parametrize('benches', [1, 2, 9])
def test_every_byte_that_is_not_padding_is_that_of_the_real_serialiser(style, frame_id, benches):
    serialization = pytest.importorskip('rclpy.serialization')
    from dragon_ros.nodes.shell import message_type
    scene = Scene(dragon=Dragon(benches), run=Run(400, 413), markers=style)
    messages = {channels()[name].type: encode(tick(scene, 3)) for name, encode in encoders(scene, frame_id).items()}
    for name, data in {**messages, 'std_msgs/msg/Float64': float64_of(0.1)}.items():
        again = serialization.serialize_message(serialization.deserialize_message(data, message_type(name)))
        reader = Marking(data)
        decoder._message(reader, fields_of(name))
        used = sorted(reader.used)
        assert [data[at] for at in used] == [again[at] for at in used], name
        assert not any(data[at] for at in set(range(len(data))) - set(used)), f'{name}: the padding is not zero'
        assert used[-1] >= len(again) - 1


@pytest.mark.parametrize('name', TYPES)
@given(data=st.binary(max_size=300))
@examples(40)
def test_random_bytes_are_values_or_a_message_error(name, data):
    try:
        decode(name, b'\0\1\0\0' + data)
    except MessageError:
        pass


@pytest.mark.parametrize('name', TYPES)
def test_a_message_that_ends_early_is_an_error_with_its_offset(name):
    serialization = pytest.importorskip('rclpy.serialization')
    from dragon_ros.nodes.shell import message_type
    data = serialization.serialize_message(filled(message_type(name)(), np.random.default_rng(3)))
    reader = Marking(data)
    decoder._message(reader, fields_of(name))
    for end in range(max(reader.used)):
        with pytest.raises(MessageError):
            decode(name, data[:end])


def test_diagnostics_are_read_as_the_monitor_writes_them():
    serialization = pytest.importorskip('rclpy.serialization')
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    row = DiagnosticStatus(level=b'\2', name='n', message='a message', values=[KeyValue(key='k', value='v')])
    (status,) = read_diagnostics(serialization.serialize_message(DiagnosticArray(status=[row])))
    assert (status.level, status.name, status.message, status.values) == (2, 'n', 'a message', {'k': 'v'})


def test_the_health_of_a_monitor_is_that_of_its_dragon_and_all_else_is_none():
    serialization = pytest.importorskip('rclpy.serialization')
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    def of(t_s, name='red: clearance', more=0, **values):
        rows = [DiagnosticStatus(name='battery')] * (1 + more) + [DiagnosticStatus(
            name=name, values=[KeyValue(key=key, value=value) for key, value in {'t_s': t_s, **values}.items()])]
        return read_health(bytes(serialization.serialize_message(DiagnosticArray(status=rows))), 'red')
    assert of('2147483647.000000001') == Health(2147483647 * 10**9 + 1, 0, leaves=False)
    assert [of(t_s) for t_s in ('soon', '1.5', '-1.000000000')] == [Health(None, 0, leaves=False)] * 3
    assert of('', waiting='37', leaves='true', reports='26') == Health(None, 37, leaves=True, reports=26)
    assert of('', waiting='-1', leaves='yes') == of('', waiting='9' * 10) == Health(None, 0, leaves=False)
    assert [of('1.000000000', name=f'{dragon}: clearance') for dragon in ('blue', 'white')] == [None] * 2
    assert of('1.000000000', more=9999) is None         # longer than any monitor's message
    assert read_health(b'\0\1\0\0', 'red') is None


def multi_array(sizes, values=0):
    writer = Writer()
    writer.put('I', len(sizes))
    for size in sizes:
        writer.text('')
        writer.put('I', size, 0)
    writer.put('I', 0, values)
    writer.put('d', *[1.5] * values)
    return bytes(writer.finish())


@given(st.lists(st.sampled_from([0, 1, 2, 2**31, 2**32 - 1]), max_size=80), st.integers(0, 2))
@example([1] * 65, 1)
@example([0, 2**32 - 1, 2**32 - 1], 0)
@examples(20)
def test_dimensions_of_any_number_and_size_give_an_array_or_a_message_error(sizes, values):
    with suppress(MessageError):
        array = read_multi_array(multi_array(sizes, values))[1]
        assert (array.shape, array.size) == (tuple(sizes), values)


def test_an_error_about_many_dimensions_is_short():
    with pytest.raises(MessageError) as error:
        read_multi_array(multi_array([2**32 - 1] * 1000))
    assert len(str(error.value)) < 200


@pytest.mark.parametrize('within', [True, False])
def test_a_message_makes_a_bounded_number_of_objects(monkeypatch, within):
    monkeypatch.setattr(decoder, 'LISTED_OBJECTS', 6)
    message = diagnostics(2 if within else 3)
    if within:
        assert len(read_diagnostics(message)) == 2
        return
    with pytest.raises(MessageError, match='the limit is 6'):
        read_diagnostics(message)


def diagnostics(statuses):
    """Return a DiagnosticArray whose statuses have two values each."""
    writer = Writer()
    writer.header('dragon', 0)
    writer.put('I', statuses)
    for _ in range(statuses):
        writer.put('B', 0)
        for _ in range(3):
            writer.text('a')
        writer.put('I', 2)
        for _ in range(4):
            writer.text('b')
    return bytes(writer.finish())


def test_poses_are_views_of_the_bytes():
    scene = Scene(dragon=Dragon(9), run=Run(400, 413))
    data = encoders(scene)['handles'](tick(scene, 0))
    assert np.shares_memory(read_pose_array(data).poses, np.frombuffer(data, 'u1'))
    assert np.shares_memory(decode('geometry_msgs/msg/PoseArray', data)['poses'], np.frombuffer(data, 'u1'))


def test_markers_that_change_their_layout_without_end_are_refused(monkeypatch):
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import Marker, MarkerArray

    def markers(count):
        return MarkerArray(markers=[Marker(ns='bench', text='x' * (n % 2 * 9)) for n in range(count)])

    def message(count):
        """Return the bytes of ``count`` markers that repeat a group of eight; neighbours never have the same layout."""
        one, two = (serialization.serialize_message(markers(8 * times)) for times in (1, 2))
        return one[:4] + struct.pack('<I', count) + one[8:] + (count // 8 - 1) * two[len(one):]

    assert serialization.deserialize_message(message(24), MarkerArray) == markers(24)
    most = 160      # far below the limit, and far above any message of the package
    assert most < MARKER_RUNS
    monkeypatch.setattr(decoder, 'MARKER_RUNS', most)
    assert len(read_marker_array(message(most)).runs) == most
    with pytest.raises(MessageError, match=f'more than {most} runs'):
        read_marker_array(message(most + 8))


def test_the_stamp_of_a_message_stands_where_it_is_looked_for():
    scene = Scene(dragon=Dragon(3), run=Run(7, 9))
    frame, wanted = tick(scene, 11), 0
    for name, encode in encoders(scene).items():
        at = decoder.stamp_at_of(channels()[name].type)
        if at is not None:
            seconds, rest = struct.unpack_from('<iI', bytes(encode(frame)), at)
            assert seconds * 10**9 + rest == frame.t_ns, name
            wanted += 1
    assert wanted >= 2


@pytest.mark.parametrize('letter', 'a\u00e9\u9f99\U0001f409')
def test_the_name_of_a_frame_counts_with_all_that_it_takes_as_text_and_as_bytes(letter):
    one, bare = (decoder.Poses(0, name, np.zeros((2, 7))) for name in (letter * 1000, ''))
    assert one.size_bytes - bare.size_bytes >= sys.getsizeof(letter * 1000) - sys.getsizeof('') - 100 + len(
        (letter * 1000).encode())
