"""A busy subscriber takes every message that has arrived exactly once and in order, over real DDS."""
import pytest

pytest.importorskip('rclpy')


@pytest.mark.parametrize('count', [1, 5, 64, 200])
def test_what_came_while_the_node_was_busy_is_taken_in_order_and_other_topics_have_their_turn(node, count):
    from std_msgs.msg import Float64

    from dragon_ros.messages.cdr import float64_of
    from dragon_ros.messages.decode import decode
    from dragon_ros.nodes import qos
    from dragon_ros.nodes.raw_subscription import subscribe_raw
    profile, got, sources = qos.profile('reliable', 'volatile', 1000), [], set()

    def take(data, info):
        got.append(decode('std_msgs/msg/Float64', data)['data'])
        sources.add(info['publication_sequence_number'] is not None)
    subscribe_raw(node, Float64, 'a', take, profile)
    other = []
    subscribe_raw(node, Float64, 'b', lambda data, _: other.append(data), profile)
    a, b = (node.create_publisher(Float64, name, profile) for name in 'ab')
    node.until(lambda: a.get_subscription_count() and b.get_subscription_count())
    for n in range(count):
        a.publish(float64_of(n))
    b.publish(float64_of(0.0))
    node.until(lambda: len(got) == count and other)
    assert got == list(range(count))
    assert len(sources) == 1


@pytest.mark.parametrize(('most_bytes', 'taken'), [(0, 3), (5 * 12, 5), (10**6, 7)])
def test_messages_are_taken_up_to_a_number_and_a_size(monkeypatch, most_bytes, taken):
    from contextlib import nullcontext
    from types import SimpleNamespace

    from dragon_ros.nodes import raw_subscription
    for name, value in {'_AT_ONCE': 3, '_AT_ONCE_BYTES': most_bytes, '_MOST_AT_ONCE': 7}.items():
        monkeypatch.setattr(raw_subscription, name, value)
    got, ends, handle = [], [], nullcontext()
    handle.take_message = lambda *_: (bytes(12), None)
    callback = raw_subscription._Callback(lambda data, _: got.append(data), lambda: ends.append(len(got)))
    callback.subscription = SimpleNamespace(handle=handle, msg_type=None, raw=True)
    callback.take_all()
    assert ends == [taken]


def test_one_turn_takes_a_quarter_second_of_a_fast_run_and_leaves_the_inbox_half_empty(node):
    """Fast DDS searches the messages that were not taken, so a turn takes many; then other callbacks have theirs."""
    from geometry_msgs.msg import PoseArray
    from rclpy.duration import Duration

    from dragon_ros.core.limits import INBOX_BYTES
    from dragon_ros.core.scene import Scene
    from dragon_ros.core.step import tick
    from dragon_ros.messages.encode import encoders
    from dragon_ros.messages.skipping import FROM_FILL
    from dragon_ros.nodes import qos
    from dragon_ros.nodes.raw_subscription import subscribe_raw, taker_of
    profile, sizes, turns = qos.lossless(qos.profile('reliable', 'volatile', 1)), [], []
    subscribe_raw(node, PoseArray, 'handles', lambda data, _: sizes.append(len(data)), profile,
                  lambda: turns.append(len(sizes)))
    (take_turn,) = filter(None, map(taker_of, node.subscriptions))
    publisher = node.create_publisher(PoseArray, 'handles', profile)
    node.until(publisher.get_subscription_count)
    data, count = bytes(encoders(Scene())['handles'](tick(Scene(), 0))), 950
    for _ in range(count):
        publisher.publish(data)
    assert publisher.wait_for_all_acked(Duration(seconds=60))
    take_turn()
    assert 250 <= len(sizes) < count        # at 1,000 ticks per second
    topics = 2      # the inbox holds handles and benches; above FROM_FILL, ticks are skipped
    assert topics * sum(sizes) < FROM_FILL * INBOX_BYTES
    while len(sizes) < count:
        take_turn()
    assert len(turns) > 1
    assert set(sizes) == {len(data)}
