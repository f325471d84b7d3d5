"""Messages are tested against the real rmw serialiser and golden hex dumps, with round trips and damaged bytes."""
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import PoseArrayTemplate, Writer, half_turns, turns_of
from dragon_ros.messages.decode import MessageError, Reader, read_marker_array, read_multi_array, read_pose_array
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.markers import BLUE, CUBE, VERMILION, CubesTemplate, MarkerSpec, put_marker
from dragon_ros.messages.observation import observation_of, read_benches, read_handles


def seen(handles, benches):
    return observation_of(read_handles(handles), read_benches(benches))


def frame_and_bytes(benches=223, k=100):
    scene = Scene(dragon=Dragon(benches), run=Run(400, 413))
    frame = tick(scene, k)
    return frame, {name: encode(frame) for name, encode in encoders(scene).items()}


@pytest.mark.snapshot
def test_golden_hex_of_a_pose_array():
    places = np.array([[1.0, 2.0], [3.0, 4.0]])
    data = PoseArrayTemplate(2, 'dragon').encode(1_500_000_002, places, np.array([[1.0, 0.0]]))
    pose = '{}{}' + '00' * 32 + '000000000000f03f'
    assert data.hex() == ('00010000' '01000000' '0265cd1d' '07000000' '647261676f6e0000' '02000000'
                          + pose.format('000000000000f03f', '0000000000000040')
                          + pose.format('0000000000000840', '0000000000001040'))


@pytest.mark.parametrize('benches', [1, 2, 7, 223])
def test_frames_come_back_from_their_bytes_bit_for_bit(benches):
    frame, data = frame_and_bytes(benches)
    poses, markers = read_pose_array(data['handles']), read_marker_array(data['benches'])
    assert (poses.t_ns, poses.frame_id) == (frame.t_ns, 'dragon')
    assert markers.t_ns.tolist() == [frame.t_ns] * benches
    assert [(run.frame_id, run.ns, run.count) for run in markers.runs] == [('dragon', 'bench', benches)]
    assert poses.poses[:, :2].tobytes() == frame.chain.p.tobytes()
    assert markers.poses[:, :2].tobytes() == frame.benches.centre.tobytes()
    assert markers.scale[0].tolist() == [3.41, 0.3, 0.1]
    labels, values = read_multi_array(data['velocities'])
    assert labels == ['handle', 'vx_vy_speed']
    assert values[:, :2].tobytes() == frame.velocity_m_s.tobytes()
    np.testing.assert_allclose(values[:, 2], np.hypot(*frame.velocity_m_s.T))


@pytest.mark.parametrize('benches', thinned([1, 2, 8, 223], (1, 223).__contains__))
@pytest.mark.parametrize(('name', 'markers'), [('handles', 'cubes'), ('velocities', 'cubes'), ('benches', 'cubes'),
                                               ('benches', 'triangles')])
@pytest.mark.parametrize('frame_id', thinned(['dragon', '', 'map', 'a_long_frame'], ('dragon', '').__contains__))
def test_the_real_serialiser_reads_and_writes_the_same(benches, name, markers, frame_id):
    serialization = pytest.importorskip('rclpy.serialization')
    from dragon_ros.messages.channels import channels
    from dragon_ros.nodes.shell import message_type
    kind = message_type(channels()[name].type)
    scene = Scene(dragon=Dragon(benches), run=Run(400, 413), markers=markers)
    data = encoders(scene, frame_id)[name](tick(scene, 100))
    message = serialization.deserialize_message(data, kind)
    again = serialization.serialize_message(message)
    assert len(data) - len(again) in (0, 1, 2, 3)
    different = [n for n, (a, b) in enumerate(zip(data, again, strict=False)) if a != b]
    assert all(data[n] == 0 for n in different), 'only padding may differ, and it must be zero'
    assert serialization.deserialize_message(again, kind) == message


def test_markers_with_strings_of_unequal_length_decode_to_the_same():
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import MarkerArray
    data = frame_and_bytes(9)[1]['benches']
    message = serialization.deserialize_message(data, MarkerArray)
    message.markers[3].text = 'a text that shifts everything after it'
    message.markers[5].points.append(message.markers[5].pose.position)
    even, uneven = read_marker_array(data), read_marker_array(serialization.serialize_message(message))
    np.testing.assert_array_equal(even.poses, uneven.poses)
    np.testing.assert_array_equal(even.scale, uneven.scale)
    np.testing.assert_array_equal(even.id, uneven.id)
    assert [run.ns for run in even.runs] == ['bench']
    assert {run.ns for run in uneven.runs} == {'bench'}
    assert len(uneven.runs) > 2


def test_big_endian_messages_are_read():
    little = PoseArrayTemplate(3, 'dragon').encode(7 * 10**9, np.arange(6.0).reshape(3, 2), np.eye(2))
    big = bytearray(b'\0\0\0\0' + little[4:])
    for start, size, count in ((4, 4, 3), (24, 4, 1), (28, 8, 21)):
        block = np.frombuffer(little, f'<u{size}', count, start).astype(f'>u{size}')
        big[start:start + size * count] = block.tobytes()
    assert read_pose_array(bytes(big)).t_ns == 7 * 10**9
    np.testing.assert_array_equal(read_pose_array(bytes(big)).poses, read_pose_array(little).poses)


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)).filter(lambda v: np.hypot(*v) > 1e-3), min_size=1))
def test_quaternions_turn_x_onto_the_axis(vectors):
    axis = np.array(vectors) / np.hypot(*np.array(vectors).T)[:, None]
    z, w = half_turns(axis).T
    np.testing.assert_allclose(np.stack((w * w - z * z, 2 * w * z), 1), axis, atol=1e-15)


def test_turns_that_are_kept_are_those_of_the_axis_asked_for():
    ahead, left = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    left.flags.writeable = False
    assert turns_of(left) is turns_of(left)
    assert turns_of(ahead).tolist() == [1j]
    ahead[:] = -1.0, 0.0
    assert turns_of(ahead).tolist() == [1.0]        # the array is writable, so the message must not be cached
    assert turns_of(left).tolist() == pytest.approx([np.sqrt(0.5) * (1 + 1j)])


@pytest.mark.parametrize('name', ['handles', 'benches', 'velocities'])
def test_a_message_cut_anywhere_is_an_error_with_its_offset(name):
    read = {'handles': read_pose_array, 'benches': read_marker_array, 'velocities': read_multi_array}[name]
    data = frame_and_bytes(2)[1][name]
    whole = len(data.rstrip(b'\0')) if name != 'benches' else len(data) - 3
    for end in range(whole):
        with pytest.raises(MessageError):
            read(data[:end])


@given(st.binary(max_size=400))
def test_random_bytes_never_raise_anything_else(data):
    for read in (read_pose_array, read_marker_array, read_multi_array):
        try:
            read(b'\0\1\0\0' + data)
        except MessageError:
            pass


@given(st.integers(4, 700), st.integers(0, 255))
def test_a_changed_byte_gives_values_or_a_message_error(at, value):
    data = bytearray(frame_and_bytes(2)[1]['benches'])
    data[at % len(data)] = value
    try:
        seen(frame_and_bytes(2)[1]['handles'], bytes(data))
    except MessageError:
        pass


def test_other_encodings_are_refused_by_name():
    with pytest.raises(MessageError, match='XCDR2'):
        Reader(b'\0\7\0\0')
    with pytest.raises(MessageError, match='nothing'):
        Reader(b'')


def edit(name, benches=5, **changes):
    serialization = pytest.importorskip('rclpy.serialization')
    from dragon_ros.messages.channels import channels
    from dragon_ros.nodes.shell import message_type
    kind = message_type(channels()[name].type)
    message = serialization.deserialize_message(frame_and_bytes(benches)[1][name], kind)
    changes['change'](message)
    return serialization.serialize_message(message)


@pytest.mark.parametrize(('change', 'says'), [
    (lambda m: setattr(m.markers[1].pose.position, 'x', float('nan')), 'pose'),
    (lambda m: setattr(m.markers[1].scale, 'y', 0.0), 'positive'),
    (lambda m: setattr(m.markers[1], 'id', 7), '0, 1, 2'),
    (lambda m: m.markers.pop(), r'benches: \d+ benches for \d+ handles'),
    (lambda m: m.markers.clear(), 'neither CUBEs nor a TRIANGLE_LIST'),
    (lambda m: setattr(m.markers[0].header, 'frame_id', 'map'), "'map'"),
    (lambda m: setattr(m.markers[2].pose.orientation, 'w', 0.0) or setattr(m.markers[2].pose.orientation, 'z', 0.0),
     'orientation'),
    (lambda m: setattr(m.markers[1].scale, 'x', 1e300), 'finite'),
])
def test_unusable_benches_are_rejected_by_field(change, says):
    handles = frame_and_bytes(5)[1]['handles']
    with pytest.raises(MessageError, match=says):
        seen(handles, edit('benches', change=change))


@pytest.mark.parametrize(('change', 'says'), [
    (lambda m: setattr(m.poses[1].position, 'y', float('inf')), 'position'),
    (lambda m: m.poses.clear(), 'the number of poses is 0'),
    (lambda m: [m.poses.pop() for _ in range(5)], 'the number of poses is 1'),
])
def test_unusable_handles_are_rejected_by_field(change, says):
    with pytest.raises(MessageError, match=says):
        seen(edit('handles', change=change), frame_and_bytes(5)[1]['benches'])


def test_markers_of_others_and_in_any_order_do_not_disturb():
    def shuffle(message):
        from visualization_msgs.msg import Marker
        message.markers.reverse()
        message.markers.insert(0, Marker(action=Marker.DELETEALL))
        message.markers.append(Marker(ns='rviz', id=99))
    mine = seen(*(frame_and_bytes(5)[1][name] for name in ('handles', 'benches')))
    theirs = seen(frame_and_bytes(5)[1]['handles'], edit('benches', change=shuffle))
    np.testing.assert_array_equal(mine.benches.centre, theirs.benches.centre)
    assert read_benches(edit('benches', change=shuffle)).t_ns == mine.t_ns


@pytest.mark.parametrize(('sec', 'nanosec'), [(-1, 0), (0, 10**9), (2**31 - 1, 2**32 - 1)])
def test_stamps_that_no_clock_shows_are_refused(sec, nanosec):
    def change(message):
        message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    with pytest.raises(MessageError, match='stamp'):
        read_pose_array(edit('handles', change=change))


@pytest.mark.parametrize('markers', ['cubes', 'triangles'])
def test_a_message_that_is_held_stays_as_it_was(markers):
    scene = Scene(dragon=Dragon(20), run=Run(400, 413), markers=markers)
    frames, encode = [tick(scene, k) for k in range(3)], encoders(scene)
    held = [{name: encode[name](frame) for name in encode} for frame in frames]
    viewed = [{name: memoryview(encode[name](frame)) for name in encode} for frame in frames]
    for frame, data, view in zip(frames, held, viewed, strict=True):
        assert data == view == {name: fresh(frame) for name, fresh in encoders(scene).items()}


@pytest.mark.parametrize('name', ['handles', 'benches', 'velocities'])
def test_a_message_that_is_not_held_is_not_copied(name):
    scene = Scene(dragon=Dragon(2000), run=Run(400, 413))
    frame, encode = tick(scene, 0), encoders(scene)[name]
    size = len(encode(frame))
    tracemalloc.start()
    try:
        encode(frame)
        once = tracemalloc.get_traced_memory()[1]
        held = encode(frame), encode(frame)
        twice = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert held[0] is not held[1]
    assert once < 0.5 * size < size < twice


def test_templates_are_patched_not_rebuilt():
    template = CubesTemplate(np.array([3.41, 2.2]), 0.3, 'dragon')
    first = template.encode(0, np.zeros((2, 2)), np.array([[1.0, 0], [0, 1]]))
    second = template.encode(5, np.ones((2, 2)), np.array([[1.0, 0], [0, 1]]))
    assert first != second
    assert template.encode(0, np.zeros((2, 2)), np.array([[1.0, 0], [0, 1]])) == first


@pytest.mark.parametrize('frame_id', ['', 'map', 'dragon'])
@pytest.mark.parametrize('benches', [1, 2, 3, 4, 9])
def test_repeated_cubes_have_the_bytes_of_markers_laid_out_one_by_one(benches, frame_id):
    writer, lengths_m = Writer(), np.linspace(1.0, 2.0, benches)
    writer.put('I', benches)
    for bench, length_m in enumerate(lengths_m.tolist()):
        put_marker(writer, MarkerSpec('bench', bench, CUBE, (length_m, 0.3, 0.1), BLUE if bench else VERMILION),
                   frame_id)
    assert CubesTemplate(lengths_m, 0.3, frame_id).copies(1).data.tobytes() == bytes(writer.finish())
