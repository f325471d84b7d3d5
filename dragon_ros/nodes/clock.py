"""Publish the simulation time on /clock, for other nodes."""
import time

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from dragon_ros.messages.cdr import stamp_of
from dragon_ros.nodes.base import STEADY

_BEAT_S = 1.0


class ClockPublisher:
    """Publishes the time of each tick and, while time is stopped, repeats it every second for late subscribers."""

    def __init__(self, node: Node, t_ns: int) -> None:
        """Start at the time ``t_ns``."""
        self._publisher = node.create_publisher(Clock, '/clock', QoSProfile(depth=10))
        self._t_ns, self._sent_s = t_ns, 0.0
        node.create_timer(_BEAT_S, self._beat, clock=STEADY)

    def publish(self, t_ns: int) -> None:
        """Publish the time."""
        self._t_ns, self._sent_s = t_ns, time.monotonic()
        message = Clock()
        message.clock.sec, message.clock.nanosec = stamp_of(t_ns)
        self._publisher.publish(message)

    def _beat(self) -> None:
        if time.monotonic() - self._sent_s >= _BEAT_S:
            self.publish(self._t_ns)
