"""Raw subscriptions in batches: when one message wakes a node, all that have arrived on its topic are taken."""
from collections.abc import Callable, Iterator
from typing import Any
from weakref import WeakKeyDictionary

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

_AT_ONCE = 64       # most messages before timers and other topics are served
_OF_NODE: WeakKeyDictionary[Node, list[tuple[Subscription, Callable[[], None]]]] = WeakKeyDictionary()


def subscribe_raw(node: Node, kind: Any, name: str, take: Callable[[bytes, Any], None], profile: QoSProfile) -> None:
    """Call ``take(data, info)`` for every message, in order, in any executor or in a Spinner.

    A node that falls behind catches up, since waking it costs as much as taking several messages.
    """
    def take_all() -> None:
        for _ in range(_AT_ONCE):
            with subscription.handle:
                more = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if more is None:
                return
            take(*more)

    def callback(data: bytes, info: Any) -> None:
        take(data, info)
        take_all()
    subscription = node.create_subscription(kind, name, callback, profile, raw=True)
    _OF_NODE.setdefault(node, []).append((subscription, take_all))


def takers(node: Node) -> Iterator[tuple[Subscription, Callable[[], None]]]:
    """Yield each raw subscription of a node and what takes the messages that have arrived for it."""
    yield from _OF_NODE.get(node, ())


def number(info: Any) -> int:
    """Return the number that the publisher gave a message; 0 where the middleware gives none."""
    return info['publication_sequence_number'] or 0
