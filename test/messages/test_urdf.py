"""Forward kinematics on the URDF, with the angles from ``joint_states``, reproduces the dragon's benches."""
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from dragon_ros.__main__ import main
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import half_turns
from dragon_ros.messages.decode import decode
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.latched import latched_messages
from dragon_ros.messages.markers import BENCH_HEIGHT_M
from dragon_ros.messages.urdf import urdf_of

ROBOT = Effect.JOINTS | Effect.BENCHES
SCENES = {'classic': Scene(effects=ROBOT, run=Run(0, 430)), 'one': Scene(dragon=Dragon(1), effects=ROBOT),
          'mixed': Scene(dragon=Mixed((Group(3.41), Group(2.2, 20), Group(1.1, 9))), effects=ROBOT, run=Run(0, 400))}


def numbers(text):
    return [float(part) for part in text.split()]


def moved(x, y, turn):
    """Return a transform of the plane as a matrix."""
    return np.array([[np.cos(turn), -np.sin(turn), x], [np.sin(turn), np.cos(turn), y], [0, 0, 1]])


def places_of(text, root, angles):
    """Return each link's transform and box by its name, using only the URDF document and the messages."""
    robot, places = ElementTree.fromstring(text), {}
    links = {link.get('name'): link for link in robot.iter('link')}
    children = {joint.find('parent').get('link'): joint for joint in robot.iter('joint')}
    name = next(iter(set(links) - {joint.find('child').get('link') for joint in robot.iter('joint')}))
    here = moved(*root)
    while True:
        visual = links[name].find('visual')
        x, y, _ = numbers(visual.find('origin').get('xyz'))
        places[name] = here @ moved(x, y, 0.0), numbers(visual.find('geometry/box').get('size'))
        joint = children.get(name)
        if joint is None:
            return places
        assert numbers(joint.find('axis').get('xyz')) == [0, 0, 1]
        limit, angle = joint.find('limit').attrib, angles[joint.get('name')]
        assert float(limit['lower']) <= angle <= float(limit['upper'])
        x, y, _ = numbers(joint.find('origin').get('xyz'))
        here, name = here @ moved(x, y, 0.0) @ moved(0.0, 0.0, angle), joint.find('child').get('link')


@pytest.mark.parametrize('scene', SCENES.values(), ids=SCENES)
@pytest.mark.parametrize('part', [0.0, 0.5, 1.0])
def test_forward_kinematics_of_the_urdf_give_back_every_bench(scene, part):
    frame = tick(scene, round(part * scene.run.tick_at(round((scene.run.stop_s or 300) * 10**9))))
    message = decode('sensor_msgs/msg/JointState', encoders(scene)['joint_states'](frame))
    assert [len(message[name]) for name in ('velocity', 'effort')] == [0, 0]
    angles = dict(zip(message['name'], message['position'].tolist(), strict=True))
    assert list(angles) == [f'joint_{n}' for n in range(1, scene.dragon.benches)]
    root = (*frame.chain.p[0], np.arctan2(frame.axis[0, 1], frame.axis[0, 0]))
    places, benches = places_of(urdf_of(scene), root, angles), frame.benches
    assert list(places) == [f'bench_{n}' for n in range(scene.dragon.benches)]
    for n, (place, size) in enumerate(places.values()):
        assert np.hypot(*(place[:2, 2] - benches.centre[n])) < 1e-9
        assert np.hypot(*(place[:2, 0] - benches.axis[n])) < 1e-9
        assert size == [2 * benches.half_length[n], 2 * benches.half_width[n], BENCH_HEIGHT_M]


def test_the_command_writes_the_robot_of_a_scene(capsys, tmp_path):
    assert main(['urdf', 'winding', '--set', 'dragon.benches=3', '--output', str(tmp_path / 'a.urdf')]) == 0
    assert (tmp_path / 'a.urdf').read_text() == urdf_of(Scene(dragon=Dragon(3))) + '\n'
    assert main(['urdf', '--set', 'dragon.benches=3']) == 0
    assert capsys.readouterr().out == urdf_of(Scene(dragon=Dragon(3))) + '\n'


def test_the_path_is_the_track_in_one_frame_each_pose_along_the_way_to_the_next():
    assert 'path' not in latched_messages(Scene(), 'sea')
    scene = replace(Scene(run=Run(0, 20)), effects=Effect.PATH)
    message = decode('nav_msgs/msg/Path', latched_messages(scene, 'sea')['path'])
    assert {one['header']['frame_id'] for one in (message, *message['poses'])} == {'sea'}
    poses = np.array([one['pose'] for one in message['poses']]).reshape(-1, 7)
    track = decode('visualization_msgs/msg/Marker', latched_messages(scene, 'sea')['track'])['points'].reshape(-1, 3)
    assert np.array_equal(poses[:, :2], track[::-1, :2])
    steps = np.diff(poses[:, :2], axis=0)
    assert np.allclose(poses[:-1, 5:], half_turns(steps / np.hypot(*steps.T)[:, None]), rtol=0, atol=1e-12)


def test_a_bag_with_joints_and_path_is_checked_to_its_last_message(capsys, tmp_path):
    path = str(tmp_path / 'a.mcap')
    assert main(['simulate', '--set', 'run.stop_s=0.1', '--set', 'effects=[joints, path]', '--output', path]) == 0
    assert main(['inspect', path, '--check']) == 0
    assert 'unchecked' not in capsys.readouterr().out


def test_the_inertia_of_every_bench_is_that_of_points_spread_evenly_over_its_box():
    robot = ElementTree.fromstring(urdf_of(SCENES['mixed']))
    unit = (np.arange(60) + 0.5) / 60 - 0.5     # positions along each edge
    for link in list(robot.iter('link'))[:2]:
        size = np.array(numbers(link.find('visual/geometry/box').get('size')))
        mass = float(link.find('inertial/mass').get('value'))
        x, y, z = (mass * np.mean((unit * edge) ** 2) for edge in size)
        found = {name: float(value) for name, value in link.find('inertial/inertia').attrib.items()}
        assert found == pytest.approx({'ixx': y + z, 'iyy': x + z, 'izz': x + y, 'ixy': 0, 'ixz': 0, 'iyz': 0},
                                      rel=1e-3)
        assert link.find('inertial/origin').attrib == link.find('visual/origin').attrib
