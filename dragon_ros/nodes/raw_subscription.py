"""Raw subscriptions in batches: waking an rclpy executor costs as much as taking fifteen messages."""
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

_AT_ONCE = 64       # most messages before timers and other topics are served


def subscribe_raw(node: Node, kind: Any, name: str, take: Callable[[bytes, Any], None], profile: QoSProfile) -> None:
    """Call ``take(data, info)`` for every message, in order.

    When one message wakes the node, all that have arrived are taken, so that a node that falls behind catches up.
    """
    def callback(data: bytes, info: Any) -> None:
        take(data, info)
        for _ in range(_AT_ONCE):
            with subscription.handle:
                more = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if more is None:
                return
            take(*more)
    subscription = node.create_subscription(kind, name, callback, profile, raw=True)


def number(info: Any) -> int:
    """Return the number that the publisher gave a message; 0 where the middleware gives none."""
    return info['publication_sequence_number'] or 0
