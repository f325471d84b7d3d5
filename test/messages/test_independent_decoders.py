"""Every message of sim, decoded by two libraries that share no code with the package, contains the frame's numbers."""
import re
from functools import lru_cache

import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import tick
from dragon_ros.messages import markers
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.markers import track_marker
from dragon_ros.messages.schemas import schema_text

pytest.importorskip('mcap_ros2')
pytest.importorskip('rosbags')

T_NS, FRAME_ID = 413_000_000_000, 'somewhere'
SCENES = {style: Scene(dragon=Dragon(benches=24), effects=~Effect.NONE, markers=style)
          for style in ('cubes', 'triangles')}


@lru_cache
def made(style):
    """Return a frame with every effect and touching benches, and the frame's messages."""
    scene = SCENES[style]
    frame = tick(scene, 413 * 50)
    assert len(np.unique(frame.benches.yaw_rad)) == 24
    return frame, {**{name: encode(frame) for name, encode in encoders(scene, FRAME_ID).items()},
                   'track': track_marker(scene, FRAME_ID)}


@lru_cache
def by_mcap(kind, data):
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory
    schema = Schema(id=1, name=kind, encoding='ros2msg', data=schema_text(kind).encode())
    return DecoderFactory().decoder_for('cdr', schema)(data)


@lru_cache
def types():
    from rosbags.typesys import Stores, get_typestore
    return get_typestore(Stores.ROS2_JAZZY)


@lru_cache
def by_rosbags(kind, data):
    return types().deserialize_cdr(data, kind)


@pytest.fixture(params=[by_mcap, by_rosbags], ids=['mcap_ros2', 'rosbags'])
def read(request):
    """A function that decodes a topic's message for a given marker style."""
    return lambda topic, style='cubes': request.param(channels()[topic].type, made(style)[1][topic])


def stamp_ns(header):
    assert header.frame_id == FRAME_ID
    return header.stamp.sec * 10**9 + getattr(header.stamp, 'nanosec', 0)


def turned(orientation):
    """Return the direction of the x axis of a pose that is rotated only about z."""
    assert (orientation.x, orientation.y) == (0.0, 0.0)
    angle = 2 * np.arctan2(orientation.z, orientation.w)
    return np.array([np.cos(angle), np.sin(angle)])


def placed(poses):
    """Return the positions and the directions of poses in the plane (both of shape (n, 2))."""
    assert all(one.position.z == 0.0 for one in poses)
    return (np.array([(one.position.x, one.position.y) for one in poses]),
            np.array([turned(one.orientation) for one in poses]))


def values_of(message):
    """Return the labels of a Float64MultiArray, and its values (rows, columns) as its layout describes them."""
    layout = message.layout
    rows, columns = (one.size for one in layout.dim)
    assert [one.stride for one in layout.dim] == [rows * columns, columns]
    assert layout.data_offset == 0
    return [one.label for one in layout.dim], np.array(message.data).reshape(rows, columns)


def near(found, true, atol=1e-14):
    np.testing.assert_allclose(found, true, rtol=0, atol=atol)


@pytest.mark.parametrize('topic', ['handles', 'measured'])
def test_poses_have_the_place_and_the_direction_of_each_handle(read, topic):
    frame, message = made('cubes')[0], read(topic)
    p, axis = (frame.chain.p, frame.axis) if topic == 'handles' else (frame.measured.p, frame.measured.axis)
    places, directions = placed(message.poses)
    assert stamp_ns(message.header) == T_NS
    np.testing.assert_array_equal(places, p)
    near(directions, np.concatenate((axis, axis[-1:])))       # the last handle has the direction of the last bench


def test_cubes_have_the_place_the_direction_and_the_size_of_each_bench(read):
    frame, message = made('cubes')[0], read('benches')
    places, directions = placed([one.pose for one in message.markers])
    near(places, frame.benches.centre)
    near(directions, frame.benches.axis)
    sizes = np.array([(one.scale.x, one.scale.y) for one in message.markers])
    near(sizes, np.stack((2 * frame.benches.half_length, 2 * frame.benches.half_width), axis=1))
    assert [one.id for one in message.markers] == list(range(24))
    assert {stamp_ns(one.header) for one in message.markers} == {T_NS}
    assert {(one.type, one.action) for one in message.markers} == {(1, 0)}


def test_triangles_have_the_corners_of_each_bench(read):
    frame, message = made('triangles')[0], read('benches', 'triangles')
    faces = next(one for one in message.markers if one.type == 11)
    points = np.array([(one.x, one.y) for one in faces.points]).reshape(24, -1, 2)
    # A viewer multiplies points by the scale.
    assert (faces.scale.x, faces.scale.y, faces.scale.z) == (1.0, 1.0, 1.0)
    assert (faces.pose.position.x, faces.pose.position.y) == (0.0, 0.0)
    for triangles, corners in zip(points, frame.benches.corners, strict=True):
        distance = np.hypot(*(triangles[:, None] - corners[None]).transpose(2, 0, 1))
        assert np.max(np.min(distance, axis=1)) < 1e-12         # each point is a corner
        assert np.max(np.min(distance, axis=0)) < 1e-12         # each corner is a point
    (a, b), (c, d) = ((points[:, n::3] - points[:, ::3]).transpose(2, 0, 1) for n in (1, 2))
    near(0.5 * np.abs(a * d - b * c).sum(axis=1), 4 * frame.benches.half_length * frame.benches.half_width, 1e-12)


def test_each_side_of_each_bench_has_an_edge(read):
    frame, message = made('triangles')[0], read('benches', 'triangles')
    edges = next(one for one in message.markers if one.type == 5)
    drawn = np.array([(one.x, one.y) for one in edges.points]).reshape(24, 4, 2, 2)
    for lines, corners in zip(drawn, frame.benches.corners, strict=True):
        sides = np.stack((corners, np.roll(corners, -1, axis=0)), axis=1)
        distance = np.stack([np.abs(lines[:, None] - each[None]).max(axis=(2, 3)) for each in (sides, sides[:, ::-1])])
        assert np.max(np.min(distance, axis=(0, 1))) < 1e-12


@pytest.mark.parametrize(('topic', 'field', 'labels'), [
    ('velocities', 'velocity_m_s', ['handle', 'vx_vy_speed']),
    ('accelerations', 'acceleration_m_s2', ['handle', 'ax_ay_size'])])
def test_arrays_of_vectors_have_both_parts_and_the_size(read, topic, field, labels):
    vectors = getattr(made('cubes')[0], field)
    names, values = values_of(read(topic))
    assert names == labels
    np.testing.assert_array_equal(values[:, :2], vectors)
    np.testing.assert_allclose(values[:, 2], np.hypot(*vectors.T), rtol=1e-15)


def test_tables_have_the_numbers_of_the_frame(read):
    frame = made('cubes')[0]
    names, forces = values_of(read('forces'))
    assert names == ['link', 'tension']
    np.testing.assert_array_equal(forces[:, 0], frame.tension_n_kg)
    names, contacts = values_of(read('model/contacts'))
    assert names == ['pair', 'inner_outer_gap_x_y']
    found = frame.contacts
    np.testing.assert_array_equal(contacts, np.column_stack((found.benches, found.gap_m, found.point_m)))
    assert read('model/clearance').data == frame.closeness.clearance_m


def test_the_leader_has_its_place_direction_speed_and_rate_of_turn(read):
    leader, message = made('cubes')[0].leader, read('leader')
    pose, twist = message.pose.pose, message.twist.twist
    assert (stamp_ns(message.header), message.child_frame_id) == (T_NS, f'{FRAME_ID}/leader')
    assert (pose.position.x, pose.position.y) == tuple(leader.p)
    near(turned(pose.orientation), leader.direction)
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (leader.speed_m_s, 0.0, leader.turn_rad_s)
    assert not np.any(message.pose.covariance)
    assert not np.any(message.twist.covariance)


def test_the_cloud_has_places_and_velocities_by_its_own_fields(read):
    frame, cloud = made('cubes')[0], read('cloud')
    kinds = {7: 'f4', 8: 'f8', 6: 'u4'}
    fields = {'names': [one.name for one in cloud.fields], 'formats': [kinds[one.datatype] for one in cloud.fields],
              'offsets': [one.offset for one in cloud.fields], 'itemsize': cloud.point_step}
    rows = np.frombuffer(bytes(cloud.data), fields)
    assert stamp_ns(cloud.header) == T_NS
    assert (cloud.height, cloud.width, cloud.row_step) == (1, 25, 25 * cloud.point_step)
    assert {one.count for one in cloud.fields} == {1}
    np.testing.assert_array_equal(np.stack((rows['x'], rows['y']), 1), frame.chain.p.astype(np.float32))
    np.testing.assert_array_equal(np.stack((rows['vx'], rows['vy']), 1), frame.velocity_m_s)
    assert rows['handle'].tolist() == list(range(25))
    assert not np.any(rows['z'])


def test_fields_of_a_point_of_the_cloud_are_aligned_and_apart(read):
    cloud, size = read('cloud'), {7: 4, 8: 8, 6: 4}
    ends = [0]
    for one in sorted(cloud.fields, key=lambda field: field.offset):
        assert one.offset % size[one.datatype] == 0
        assert one.offset >= ends[-1]
        ends.append(one.offset + size[one.datatype])
    assert cloud.point_step == -(-ends[-1] // 8) * 8       # as small as possible; the next point is aligned too


def markers_of(message):
    return message.markers if hasattr(message, 'markers') else [message]


@pytest.mark.parametrize('style', ['cubes', 'triangles'])
@pytest.mark.parametrize('topic', ['benches', 'model/markers', 'trail', 'track'])
def test_every_marker_has_a_colour_a_size_and_a_place_that_can_be_seen(read, topic, style):
    for one in markers_of(read(topic, style)):
        assert one.type in range(12)
        if one.action != 0:
            continue
        colours = [one.color, *one.colors]
        assert {colour.a for colour in colours} == {1.0}
        assert all(0 <= part <= 1 for colour in colours for part in (colour.r, colour.g, colour.b))
        width_m = 0.3       # a bench's width; lines must be thinner, points must fit on it, and text must be legible
        assert one.scale.x > 0 or one.type == 9
        if one.type in (4, 5):
            assert one.scale.x < 0.2 * width_m
        elif one.type == 2:
            assert one.scale.x == one.scale.y == one.scale.z < width_m
        elif one.type == 9:
            assert width_m < one.scale.z < 2 * width_m
        heights = [one.pose.position.z + point.z for point in one.points] or [one.pose.position.z]
        assert max(map(abs, heights)) < 1.0


def test_benches_lie_above_the_track_edges_above_the_benches_and_points_above_all(read):
    def height(one):
        return one.points[0].z if one.points else one.pose.position.z
    (track,), faces, edges = markers_of(read('track')), *markers_of(read('benches', 'triangles'))
    assert all(len({point.z for point in one.points}) == 1 for one in (track, faces, edges))
    cube, red = (next(one for one in read(topic).markers if one.type == 1) for topic in ('benches', 'model/markers'))
    top = 0.5 * cube.scale.z
    assert height(track) < -top
    assert height(faces) == top < height(edges) < 0.5 * red.scale.z
    points = [one for one in read('model/markers').markers if one.type == 2]
    assert all(height(one) + 0.5 * one.scale.z > 0.5 * red.scale.z for one in points)


def test_markers_have_the_types_of_the_schema_and_those_of_lines_and_triangles_hold_whole_ones(read):
    kinds = dict(re.findall(r'^int32 (\w+)=(\d+)$', schema_text('visualization_msgs/msg/Marker'), re.MULTILINE))
    for name in ('CUBE', 'SPHERE', 'LINE_STRIP', 'LINE_LIST', 'TEXT_VIEW_FACING', 'TRIANGLE_LIST'):
        assert getattr(markers, name) == int(kinds[name])
    for name in ('ADD', 'DELETE'):
        assert getattr(markers, name) == int(kinds[name])
    assert int(kinds['DELETEALL']) == markers.DELETE_ALL
    faces, edges = markers_of(read('benches', 'triangles'))
    assert (len(faces.points), len(faces.colors), len(edges.points)) == (24 * 6, 24 * 2, 24 * 8)


def test_the_track_and_the_trail_are_grey_and_the_head_differs_from_the_body(read):
    for topic in ('track', 'trail'):
        for one in markers_of(read(topic)):
            assert one.color.r == one.color.g == one.color.b > 0
    head, *body = [(one.color.r, one.color.g, one.color.b) for one in read('benches').markers]
    assert len({*body}) == 1
    assert head not in body


def test_the_trail_and_the_track_are_lines_through_their_points(read):
    frame, trail, track = made('cubes')[0], read('trail'), read('track')
    line = trail.markers[0] if hasattr(trail, 'markers') else trail
    np.testing.assert_array_equal(np.array([(one.x, one.y) for one in line.points]), frame.trail_m)
    line = track.markers[0] if hasattr(track, 'markers') else track
    points = np.array([(one.x, one.y) for one in line.points])
    radius, turns = np.hypot(*points.T), np.unwrap(np.arctan2(*points.T[::-1]))
    near(np.diff(radius), 0.55 / (2 * np.pi) * np.abs(np.diff(turns)), 1e-9)      # r = b theta
    assert {line.type for line in (line,)} == {4}


def test_markers_of_contacts_stand_on_the_benches_that_touch(read):
    frame, message = made('cubes')[0], read('model/markers')
    which = np.unique(frame.contacts.benches)
    cubes = [one for one in message.markers if one.type == 1 and one.action == 0]
    spheres = [one for one in message.markers if one.type == 2 and one.action == 0]
    places, directions = placed([one.pose for one in cubes])
    near(places, frame.benches.centre[which])
    near(directions, frame.benches.axis[which])
    near(placed([one.pose for one in spheres])[0], frame.contacts.point_m)


def test_diagnostics_say_which_link_is_the_worst(read):
    health, message = made('cubes')[0].health, read('model/diagnostics')
    (status,) = message.status
    values = {one.key: one.value for one in status.values}
    assert stamp_ns(message.header) == T_NS
    level = status.level[0] if isinstance(status.level, bytes) else status.level
    assert (level, int(values['worst_link']), float(values['off_m'])) == (0, health.link, health.off_m)


def test_joint_states_have_the_angle_between_each_bench_and_the_one_before(read):
    frame, message = made('cubes')[0], read('joint_states')
    yaw = np.arctan2(frame.benches.axis[:, 1], frame.benches.axis[:, 0])
    angles = np.array(message.position)
    assert stamp_ns(message.header) == T_NS
    assert len(message.name) == len(set(message.name)) == len(angles) == 23
    near(np.exp(1j * angles), np.exp(1j * np.diff(yaw)), atol=1e-13)
    assert np.all(np.abs(angles) <= np.pi)


def test_every_topic_of_sim_with_messages_of_its_own_is_read_here():
    tested = {'handles', 'measured', 'benches', 'velocities', 'accelerations', 'forces', 'model/contacts',
              'model/clearance', 'leader', 'cloud', 'trail', 'track', 'model/markers', 'model/diagnostics',
              'joint_states'}
    assert set(made('cubes')[1]) == tested
