"""``route --topic``: a nav_msgs/Path that a robot publishes becomes the track of a scene, over real DDS."""
import numpy as np
import pytest
from properties import thinned

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from dragon_ros.core.model import compile_scene
from dragon_ros.scenes.load import load_scene

CORNER = (0, 0), (60, 0), (60, 50)
QUALITY = {'latched': QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
           'reliable': QoSProfile(depth=1),
           'best effort': QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)}


def plan(frame_id, points):
    message = Path()
    message.header.frame_id = frame_id
    for x, y in points:
        pose = PoseStamped()
        pose.header.frame_id = frame_id
        pose.pose.position.x, pose.pose.position.y = float(x), float(y)
        message.poses.append(pose)
    return message


def routed(start, node, quality, message, *options):
    """Run ``route`` while a path is published (only once if it is latched), and return the finished process."""
    # The default callbacks would print warnings about subscribers that request a higher QoS.
    silent = PublisherEventCallbacks(use_default_callbacks=False)
    publisher = node.create_publisher(Path, '/plan', QUALITY[quality], event_callbacks=silent)
    publisher.publish(message)
    if quality != 'latched':
        node.create_timer(0.1, lambda: publisher.publish(message))
    process = start('route', '--topic', '/plan', '--radius', '4', '--set', 'dragon.benches=30', '--timeout', '60',
                    '--output', 'scene.yaml', *options)
    node.until(lambda: not process.running)
    process.end()
    return process


def ends_of(path):
    """Return the start and the end of a drawn track, and the radii of its pieces."""
    scene = load_scene(str(path))
    line = compile_scene(scene).track_line(1e-3)
    return line[[-1, 0]], [getattr(piece, 'radius_m', None) for piece in scene.track.pieces]


@pytest.mark.parametrize('quality', thinned(QUALITY, lambda quality: quality == 'latched'))
def test_a_live_path_of_any_quality_becomes_a_track(start, node, tmp_path, quality):
    process = routed(start, node, quality, plan('dragon', CORNER))
    assert process.end() == 0, process.text
    assert 'the corner at (60.000, 0.000) m now has a radius of 4 m' in process.text
    (first, last), radii = ends_of(tmp_path / 'scene.yaml')
    np.testing.assert_allclose([first, last], [CORNER[0], CORNER[-1]], atol=1e-6)
    assert radii == [None, 4.0, None]


def test_a_live_path_in_another_frame_is_moved_by_the_given_pose_or_refused(start, node, tmp_path):
    refused = routed(start, node, 'latched', plan('map', CORNER))
    assert refused.end() == 2
    assert "/plan: its path is in the frame 'map', and the dragon is in" in refused.text
    moved = routed(start, node, 'latched', plan('map', CORNER), '--frame-pose', '1,2,90')
    assert moved.end() == 0, moved.text
    (first, last), _ = ends_of(tmp_path / 'scene.yaml')
    np.testing.assert_allclose([first, last], [(1, 2), (-49, 62)], atol=1e-6)


def test_where_no_path_comes_it_says_so_and_ends_with_2(start, node):
    process = start('route', '--topic', '/plan', '--timeout', '0.5')
    assert process.end() == 2
    assert 'no nav_msgs/Path arrived within 0.5 s; publish one, or give a larger --timeout' in process.text
