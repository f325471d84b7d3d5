"""Poses from /tf: chains of frames up and down the tree, their newest transforms, and rejected messages."""
import numpy as np
import pytest

from dragon_ros.messages import transforms
from dragon_ros.messages.cdr import Writer
from dragon_ros.messages.decode import MessageError
from dragon_ros.messages.transforms import FrameTree

LEVEL = (0.0, 0.0)


def message(*rows):
    """Return a TFMessage with the rows (parent, child, (x, y, z), yaw, (roll and pitch parts of the quaternion))."""
    writer = Writer()
    writer.put('I', len(rows))
    for parent, child, place, yaw, tilt in rows:
        writer.header(parent, 0)
        writer.text(child)
        writer.put('d', *place, *tilt, np.sin(yaw / 2), np.cos(yaw / 2))
    return bytes(writer.finish())


def pose(tree, frame, into):
    shift, turn = tree.pose(frame, into)
    return round(shift.real, 9), round(shift.imag, 9), round(float(np.angle(turn)), 9)


def test_a_pose_follows_the_tree_up_and_down_again():
    tree = FrameTree()
    assert tree.take(message(('earth', 'map', (10, 0, 5), np.pi / 2, LEVEL), ('/earth', 'hall', (0, 4, 0), 0, LEVEL),
                             ('hall', 'dragon', (1, 1, 0), np.pi, LEVEL)))
    assert pose(tree, 'map', 'earth') == (10, 0, round(np.pi / 2, 9))
    assert pose(tree, 'earth', 'map') == (0, 10, round(-np.pi / 2, 9))
    assert pose(tree, 'map', 'dragon') == (-9, 5, round(-np.pi / 2, 9))     # seen from (1, 5) after half a turn
    assert pose(tree, '/map', 'map') == (0, 0, 0)


def test_the_newest_transform_counts_and_only_a_change_is_new():
    tree, one = FrameTree(), message(('map', 'dragon', (1, 2, 0), 0.5, LEVEL))
    assert [tree.take(one), tree.take(one)] == [True, False]
    assert tree.take(message(('map', 'dragon', (1, 3, 0), 0.5, LEVEL)))
    assert pose(tree, 'dragon', 'map') == (1, 3, 0.5)
    assert tree.take(message(('hall', 'dragon', (1, 3, 0), 0.5, LEVEL)))
    assert tree.pose('dragon', 'map') is None


def test_unconnected_frames_have_no_pose_and_a_ring_of_frames_ends():
    tree = FrameTree()
    tree.take(message(('a', 'b', (1, 0, 0), 0, LEVEL), ('b', 'a', (1, 0, 0), 0, LEVEL)))
    assert tree.pose('a', 'c') is None
    assert tree.pose('a', 'b') is not None


def test_what_is_tilted_or_no_rotation_or_not_finite_is_refused():
    tree = FrameTree()
    tree.take(message(('map', 'wall', (0, 0, 0), 0, (0.01, 0)), ('wall', 'under', (0, 0, 0), np.pi, LEVEL)))
    with pytest.raises(MessageError, match="the frame 'wall' is tilted in 'map'"):
        tree.pose('wall', 'map')
    assert tree.pose('under', 'wall') is not None
    upside = message(('map', 'down', (0, 0, 0), np.pi / 2, (np.sqrt(0.5), 0)))
    with pytest.raises(MessageError, match='not a unit quaternion'):
        tree.take(upside)
    for bad in (np.nan, 1e10):
        with pytest.raises(MessageError, match="pose of the frame 'b' is not finite"):
            tree.take(message(('map', 'b', (bad, 0, 0), 0, LEVEL)))


def test_frames_beyond_the_budget_are_ignored_and_known_ones_go_on(monkeypatch):
    monkeypatch.setattr(transforms, 'KNOWN_FRAMES', 1)
    tree = FrameTree()
    tree.take(message(('map', 'a', (1, 0, 0), 0, LEVEL), ('map', 'b', (1, 0, 0), 0, LEVEL)))
    assert tree.pose('b', 'map') is None
    tree.take(message(('map', 'a', (2, 0, 0), 0, LEVEL)))
    assert pose(tree, 'a', 'map') == (2, 0, 0)
