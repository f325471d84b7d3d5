"""Raw subscriptions in batches: when a message wakes a node, the node takes all waiting messages on that topic."""
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from dragon_ros.nodes import rclpy_internals

# Messages are taken until there are at least this many of them and this many bytes; then the callbacks of timers and
# other topics run. The middleware searches through all messages that have not been taken whenever another one arrives.
_AT_ONCE, _AT_ONCE_BYTES = 64, 8_000_000
_MOST_AT_ONCE = 1000


class _Callback:
    """The callback of a raw subscription: an executor passes one message to it; a Spinner calls ``take_all``."""

    subscription: Subscription

    def __init__(self, take: Callable[[bytes, Any], None], then: Callable[[], None]) -> None:
        self._take, self._then = take, then

    def __call__(self, data: bytes, info: Any) -> None:
        self._take(data, info)
        self.take_all()

    def take_all(self) -> None:
        """Take the messages that have arrived, unless the subscription was destroyed before this call."""
        self._take_some()
        self._then()

    def _take_some(self) -> None:
        size = 0
        for taken, (data, info) in enumerate(rclpy_internals.waiting_messages(self.subscription), 1):
            size += len(data)
            self._take(data, info)
            if taken >= _MOST_AT_ONCE or (taken >= _AT_ONCE and size >= _AT_ONCE_BYTES):
                return


def subscribe_raw(node: Node, kind: Any, name: str, take: Callable[[bytes, Any], None], profile: QoSProfile,
                  then: Callable[[], None] = lambda: None) -> Callable[[], None]:
    """Call ``take(data, info)`` for each message in order, and ``then()`` after a batch, in any executor or Spinner.

    This lets a node that has fallen behind catch up, since waking it costs as much as taking several messages. The
    result is a function that takes the messages that have arrived, for a callback that must wait for them.
    """
    callback = _Callback(take, then)
    callback.subscription = node.create_subscription(kind, name, callback, profile, raw=True)
    return callback.take_all


def taker_of(subscription: Subscription) -> Callable[[], None] | None:
    """Return the function that takes the waiting messages of a raw subscription, or None for any other subscription."""
    callback = subscription.callback
    return callback.take_all if isinstance(callback, _Callback) else None


def number(info: Any) -> int:
    """Return the sequence number that the publisher gave a message, or 0 if the middleware does not provide it."""
    return info['publication_sequence_number'] or 0
