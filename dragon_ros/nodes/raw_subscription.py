"""Raw subscriptions in batches: when a message wakes a node, the node takes all waiting messages on that topic."""
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

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
        handle, kind, raw = self.subscription.handle, self.subscription.msg_type, self.subscription.raw
        with ExitStack() as held:
            try:
                held.enter_context(handle)
            except InvalidHandle:
                return
            size = 0
            for taken in range(_MOST_AT_ONCE):
                more = handle.take_message(kind, raw) if taken < _AT_ONCE or size < _AT_ONCE_BYTES else None
                if more is None:
                    return
                size += len(more[0])
                self._take(*more)


def subscribe_raw(node: Node, kind: Any, name: str, take: Callable[[bytes, Any], None], profile: QoSProfile,
                  then: Callable[[], None] = lambda: None) -> Callable[[], None]:
    """Call ``take(data, info)`` for each message in order, and ``then()`` after a batch, in any executor or Spinner.

    This lets a node that has fallen behind catch up, since waking it costs as much as taking several messages. The
    result is a function that takes the messages that have arrived, for a callback that must wait for them.
    """
    callback = _Callback(take, then)
    callback.subscription = node.create_subscription(kind, name, callback, profile, raw=True)
    return callback.take_all


def takers(node: Node) -> Iterator[tuple[int, Callable[[], None]]]:
    """Yield, for each raw subscription of a node, its pointer and the function that takes its waiting messages."""
    for subscription in node.subscriptions:
        if isinstance(subscription.callback, _Callback):
            yield subscription.handle.pointer, subscription.callback.take_all


def number(info: Any) -> int:
    """Return the sequence number that the publisher gave a message, or 0 if the middleware does not provide it."""
    return info['publication_sequence_number'] or 0
