"""Raw subscriptions that keep up: waking an rclpy executor costs as much as taking fifteen messages."""
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

_AT_ONCE = 64       # then timers and the other topics have their turn


def subscribe_raw(node: Node, kind: Any, name: str, take: Callable[[bytes, Any], None], profile: QoSProfile) -> None:
    """Call ``take(data, info)`` for every message, in order.

    When one wakes the node, all that have come are taken: a node that falls behind spends its time on messages.
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
