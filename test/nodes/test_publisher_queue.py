"""Topics without subscribers are never encoded; publishers and subscribers communicate over real DDS."""
import pytest

pytest.importorskip('rclpy')

from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.decode import read_pose_array
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.fixed_size import Together
from dragon_ros.nodes import publisher_queue, qos

READER = ('geometry_msgs/msg/PoseArray', 'handles')


class Source:
    """A source of handles that records the ticks that it encodes."""

    def __init__(self, node, durability):
        from dragon_ros.nodes.shell import message_type
        self.scene, self.encoded = Scene(run=Run(400, 413)), []
        encode = encoders(self.scene)['handles']
        publisher = node.create_publisher(message_type(READER[0]), READER[1], qos.profile('reliable', durability, 100))
        self.feed = publisher_queue.EncodedTopic(publisher, lambda frame: self.encoded.append(frame.k) or encode(frame))

    def show(self, *ticks):
        queue = publisher_queue.PublisherQueue()
        for k in ticks:
            self.feed.put(Together([tick(self.scene, k)]), queue)
        assert queue.flush()


def listen(node, durability='volatile'):
    from dragon_ros.nodes.shell import message_type
    got = []
    subscription = node.create_subscription(message_type(READER[0]), READER[1], got.append,
                                            qos.profile('reliable', durability, 100), raw=True)
    return subscription, got


def test_a_frame_is_encoded_only_while_somebody_listens_and_a_late_joiner_hears_from_the_next_one_on(node):
    source = Source(node, 'volatile')
    source.show(0, 1)
    assert (source.encoded, source.feed.published) == ([], 0)
    subscription, got = listen(node)
    node.until(source.feed.publisher.get_subscription_count)
    source.show(2, 3)
    node.until(lambda: len(got) == 2)
    assert [read_pose_array(data).t_ns for data in got] == [source.scene.run.time_ns(k) for k in (2, 3)]
    node.destroy_subscription(subscription)
    node.until(lambda: not source.feed.publisher.get_subscription_count())
    source.show(4)
    assert (source.encoded, source.feed.published) == ([2, 3], 2)


def test_the_frames_ahead_are_encoded_once_and_published_in_the_order_of_the_run(node):
    source, (_, got) = Source(node, 'volatile'), listen(node)
    node.until(source.feed.publisher.get_subscription_count)
    queue, frames = publisher_queue.PublisherQueue(), [tick(source.scene, k) for k in range(8)]
    for k in (0, 1):
        source.feed.put(Together(frames[k:4]), queue)
    for k in (5, 6, 2):     # seeks to tick 5, and back
        source.feed.put(Together(frames[5:7] if k == 5 else frames[k:k + 1]), queue)
    assert queue.flush()
    node.until(lambda: len(got) == 5)
    assert [read_pose_array(data).t_ns for data in got] == [source.scene.run.time_ns(k) for k in (0, 1, 5, 6, 2)]
    assert source.encoded == [0, 1, 2, 3, 5, 6, 2]


def test_a_latched_topic_is_published_for_those_who_come_later(node):
    source = Source(node, 'transient_local')
    source.show(0, 1)
    _, got = listen(node, 'transient_local')
    node.until(lambda: len(got) == 2)
    assert source.encoded == [0, 1]


@pytest.mark.parametrize(('name', 'most'), [
    ('std_msgs/msg/Float64', 12), ('std_msgs/msg/Bool', 8), ('geometry_msgs/msg/Twist', 52),
    ('geometry_msgs/msg/PoseWithCovariance', 348), ('geometry_msgs/msg/PoseArray', None), ('std_msgs/msg/String', None),
    ('nav_msgs/msg/Odometry', None)])
def test_a_type_of_fixed_size_cannot_hold_a_longer_message(name, most):
    from dragon_ros.nodes.shell import message_type
    kind = message_type(name)
    assert publisher_queue.can_hold(kind, 4)
    assert publisher_queue.can_hold(kind, 10**9 if most is None else most)
    assert most is None or not publisher_queue.can_hold(kind, most + 4)
