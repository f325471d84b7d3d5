"""Benches received in either marker style, from any publisher, are the rectangles of the model."""
import dataclasses

import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.geometry.tracker import ContactTracker
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.bench_reader import BenchReader
from dragon_ros.messages.cdr import PoseArrayTemplate
from dragon_ros.messages.decode import MessageError
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.observation import (
    BenchesFromHandles,
    observation_of,
    observations_of,
    placed,
    read_benches,
    read_handles,
)
from dragon_ros.scenes.load import load_scene

rng = np.random.default_rng(5)


def scene_in(style, benches=223):
    return Scene(dragon=Dragon(benches), run=Run(412, 415.2), markers=style)


def messages(scene, k=24):
    frame = tick(scene, k)
    return frame, {name: encode(frame) for name, encode in encoders(scene).items()}


def seen(data):
    return observation_of(read_handles(data['handles']), read_benches(data['benches']))


def edited(change, benches=5):
    """Return a frame, and its triangles as another publisher might change and serialise them."""
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import MarkerArray
    frame, data = messages(scene_in('triangles', benches))
    message = serialization.deserialize_message(data['benches'], MarkerArray)
    change(message)
    return frame, {**data, 'benches': serialization.serialize_message(message)}


def assert_shows(frame, data):
    got = seen(data).benches
    for name in ('centre', 'axis', 'half_length', 'half_width'):
        np.testing.assert_allclose(getattr(got, name), getattr(frame.benches, name), rtol=0, atol=2e-14)


@pytest.mark.parametrize('style', ['cubes', 'triangles'])
@pytest.mark.parametrize('benches', [1, 2, 7, 223])
def test_both_styles_show_the_rectangles_of_the_model(style, benches):
    assert_shows(*messages(scene_in(style, benches)))


@pytest.mark.parametrize('style', ['cubes', 'triangles'])
def test_a_tracker_sees_the_contact_of_mixed_benches_in_both_styles(style):
    scene = load_scene('mixed', ['run.start_s=395.5', 'run.stop_s=395.7', f'markers={style}'])
    tracker = ContactTracker()
    assert_shows(*messages(scene, 0))
    begins = [one for k in range(11) for report in tracker.add(seen(messages(scene, k)[1])) for one in report.begins]
    assert [(one.benches, round(one.t_contact_s, 4)) for one in begins] == [((40, 71), 395.6224)]


@pytest.mark.parametrize('spoil', [None, (0, np.nan), (0, 1e20), (3, 0.0, 0.0, 0.0, 0.0), (3, 0.1, 0.1)])
@pytest.mark.parametrize('style', ['cubes', 'triangles'])
def test_observations_of_several_ticks_equal_those_of_single_ticks(style, spoil):
    scenes, reader, pairs = [scene_in(style, 12)] * 4 + [scene_in(style, 7)] * 3, BenchReader(), []
    for k, scene in enumerate(scenes):
        data = {name: bytes(encode(tick(scene, k))) for name, encode in encoders(scene).items()}
        if spoil and k in (2, 5) and style == 'cubes':
            copy = bytearray(data['benches'])
            read_benches(copy).markers.poses[2, spoil[0]:spoil[0] + len(spoil) - 1] = spoil[1:]
            data['benches'] = bytes(copy)
        pairs.append((read_handles(data['handles']), reader.read(data['benches'])))
    pairs[1] = pairs[1][0], pairs[1][1].to_wait()
    pairs.append((pairs[0][0], pairs[-1][1]))       # handles and benches of different dragons
    pairs.append((dataclasses.replace(pairs[3][0], frame_id='other'), pairs[3][1]))
    assert [outcome(lambda each=each: each) for each in observations_of(pairs)] == [
        outcome(lambda pair=pair: observation_of(*pair)) for pair in pairs]


def outcome(observe):
    """Return all bits of an observation, or the text of the error that is raised or returned."""
    try:
        seen_ = observe()
    except MessageError as error:
        seen_ = error
    if isinstance(seen_, MessageError):
        return str(seen_)
    return seen_.t_ns, seen_.frame_id, seen_.p.tobytes(), *(each.tobytes() for each in vars(seen_.benches).values())


def test_both_styles_give_the_same_verdicts():
    reports = {}
    for style in ('cubes', 'triangles'):
        scene, tracker = scene_in(style, 60), ContactTracker()
        reports[style] = [report for k in range(22, 156, 4) for report in tracker.add(seen(messages(scene, k)[1]))]
    assert sum(len(report.begins) for report in reports['cubes']) == 1
    for mine, other in zip(*reports.values(), strict=True):
        assert mine.clearance_m == pytest.approx(other.clearance_m, abs=1e-13)
        assert (mine.closest, mine.touching, mine.count) == (other.closest, other.touching, other.count)
        assert [one.benches for one in mine.begins] == [one.benches for one in other.begins]
        assert [one.t_contact_s for one in mine.begins] == pytest.approx([one.t_contact_s for one in other.begins],
                                                                         abs=1e-10)
        assert [one.t_end_s for one in mine.ends] == pytest.approx([one.t_end_s for one in other.ends], abs=1e-10)


def other_cut(message):
    """Split each bench along its other diagonal, and give each triangle an arbitrary winding and first corner."""
    points = message.markers[0].points
    for n in range(0, len(points), 6):
        a, b, c, _, _, d = points[n:n + 6]
        pairs = [(b, c, d), (a, b, d)]
        rng.shuffle(pairs)
        points[n:n + 6] = [pair[k] for pair in pairs for k in rng.permutation(3)]


def test_triangles_may_be_cut_and_wound_in_any_way():
    for _ in range(10):
        assert_shows(*edited(other_cut, 40))


def test_the_pose_and_the_scale_of_the_list_are_obeyed():
    def change(message):
        faces = message.markers[0]
        faces.pose.orientation.z, faces.pose.orientation.w = 1.0, 0.0       # half a turn
        faces.pose.position.x = 3.0
        faces.scale.x, faces.scale.y = 2.0, 0.5
        for point in faces.points:
            point.x, point.y = (3.0 - point.x) / 2, -point.y / 0.5
    assert_shows(*edited(change))


@pytest.mark.parametrize(('name', 'factor'), [('x', 2.0), ('y', 0.5)])
def test_a_scale_along_one_axis_alone_is_obeyed(name, factor):
    def change(message):
        setattr(message.markers[0].scale, name, factor)
        for point in message.markers[0].points:
            setattr(point, name, getattr(point, name) / factor)
    assert_shows(*edited(change))


def test_a_scale_that_is_the_same_along_all_axes_is_obeyed():
    def change(message):
        message.markers[0].scale.x = message.markers[0].scale.y = message.markers[0].scale.z = 0.5
        for point in message.markers[0].points:
            point.x, point.y, point.z = 2 * point.x, 2 * point.y, 2 * point.z
    assert_shows(*edited(change))


def test_what_others_put_beside_the_triangles_does_not_disturb():
    def change(message):
        from visualization_msgs.msg import Marker
        message.markers.reverse()
        message.markers.insert(0, Marker(action=Marker.DELETEALL))
        message.markers.append(Marker(ns='label', text='a text', type=Marker.TEXT_VIEW_FACING))
    assert_shows(*edited(change))


def second_list(message):
    message.markers[1].ns, message.markers[1].type = 'bench', 11


@pytest.mark.parametrize(('change', 'says'), [
    (lambda m: setattr(m.markers[0].points[9], 'x', float('nan')), 'point 9'),
    (lambda m: setattr(m.markers[0].points[9], 'x', 100.0), 'bench 1 do not form a rectangle'),
    (lambda m: setattr(m.markers[0].points[9], 'y', m.markers[0].points[9].y + 1e-3),
     'bench 1 do not form a rectangle'),
    (lambda m: m.markers[0].points.__setitem__(9, m.markers[0].points[10]), 'bench 1 do not form a rectangle'),
    (lambda m: [setattr(p, 'x', 0.0) or setattr(p, 'y', 0.0) for p in m.markers[0].points], 'do not form a rectangle'),
    (lambda m: m.markers[0].points.pop(), '29 points; expected six'),
    (lambda m: [m.markers[0].points.pop() for _ in range(6)], '4 benches for 6 handles'),
    (lambda m: m.markers[0].points.clear(), '0 benches for 6 handles'),
    (lambda m: m.markers.pop(0), 'neither CUBEs nor a TRIANGLE_LIST'),
    (second_list, 'CUBEs or one TRIANGLE_LIST'),
    (lambda m: setattr(m.markers[0].pose.orientation, 'w', 0.0), 'no orientation'),
    (lambda m: setattr(m.markers[0].scale, 'x', 0.0), 'no size'),
    (lambda m: setattr(m.markers[0].header, 'frame_id', 'map'), "'map'"),
    (lambda m: setattr(m.markers[0].header.stamp, 'sec', -1), 'stamp'),
])
def test_unusable_triangles_are_rejected_by_field(change, says):
    with np.errstate(all='raise'), pytest.raises(MessageError, match=says):
        seen(edited(change)[1])


def test_benches_over_anybodys_handles_are_those_of_the_model():
    scene = Scene(dragon=Dragon(benches=9), run=Run(400, 413))
    builder = BenchesFromHandles()
    for k in (0, 100, 200):
        frame = tick(scene, k)
        handles = encoders(scene)['handles'](frame)
        seen = observation_of(read_handles(handles), read_benches(builder.encode(handles)))
        assert (seen.t_ns, seen.frame_id) == (frame.t_ns, 'dragon')
        np.testing.assert_allclose(seen.benches.corners, frame.benches.corners, atol=1e-9)


@pytest.mark.parametrize('dragon', [Dragon(9, body_length_m=2.5), Dragon(5), Dragon(12)],
                         ids=['longer benches', 'fewer benches', 'more benches'])
def test_handles_of_another_dragon_are_given_its_benches(dragon):
    builder = BenchesFromHandles()
    for scene in (Scene(Dragon(9), run=Run(400, 413)), Scene(dragon, run=Run(400, 413))):
        frame = tick(scene, 0)
        seen = read_benches(builder.encode(encoders(scene)['handles'](frame))).rectangles(frame.chain.p)
        np.testing.assert_allclose(seen.corners, frame.benches.corners, atol=1e-9)


def test_handles_without_a_direction_between_them_are_refused():
    handles = PoseArrayTemplate(3, 'dragon').encode(0, np.array([[0.0, 0], [1, 0], [1, 0]]), np.array([[1.0, 0]] * 2))
    with pytest.raises(MessageError, match='handles: 1 and the next'):
        BenchesFromHandles().encode(handles)


@pytest.mark.parametrize('quaternion', [(0.5, 0.5, 0.5, 0.5), (0.1, -0.7, 0.3, 0.5), (-0.6, 0.2, 0.5, -0.4)])
def test_a_list_that_lies_across_its_own_frame_is_turned_into_the_plane(quaternion):
    *axis, w = np.array(quaternion) / np.linalg.norm(quaternion)

    def change(message):
        faces = message.markers[0]
        for name, value in zip('xyzw', (*axis, w), strict=True):
            setattr(faces.pose.orientation, name, float(value))
        for point in faces.points:      # rotated back, by Rodrigues' formula
            here = np.array((point.x, point.y, point.z))
            aside = np.cross(axis, here)
            point.x, point.y, point.z = (here - 2 * w * aside + 2 * np.cross(axis, aside)).tolist()
    assert_shows(*edited(change))


@pytest.mark.parametrize(('share', 'upright'), [(0.9e-6, True), (1.1e-6, False)])
def test_a_bench_whose_axis_has_a_millionth_of_its_length_in_the_plane_has_a_direction(share, upright):
    tilt = 0.25 * np.pi - 0.5 * share
    pose = np.array([[1.0, 2.0, 0.0, 0.0, np.sin(tilt), 0.0, np.cos(tilt)]])
    if upright:
        with pytest.raises(MessageError, match='upright'):
            placed(pose)
    else:
        assert placed(pose)[1] == pytest.approx(np.array([[1.0, 0.0]]))


def test_axes_of_benches_in_any_orientation_are_those_of_the_rotated_vector():
    quaternions = np.random.default_rng(5).normal(size=(20, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    vector, w, unit = quaternions[:, :3], quaternions[:, 3:], np.array([1.0, 0.0, 0.0])
    aside = np.cross(vector, unit)      # Rodrigues' formula
    turned = (unit + 2 * w * aside + 2 * np.cross(vector, aside))[:, :2]
    poses = np.concatenate((np.zeros((20, 3)), quaternions), axis=1)
    assert placed(poses)[1] == pytest.approx(turned / np.linalg.norm(turned, axis=1)[:, None], abs=1e-12)
