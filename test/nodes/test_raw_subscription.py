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
