"""Publish the simulation time on /clock, for other nodes."""
import time

from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from dragon_ros.messages.cdr import stamp_of
from dragon_ros.nodes.base import STEADY, DragonNode

TOPIC = '/clock'
_BEAT_S = 1.0


class ClockPublisher:
    """Publishes the time of each tick and, while time is stopped, repeats it every second for late subscribers.

    If another node publishes /clock when the first time is due, or a second after the start, nothing is published.
    """

    def __init__(self, node: DragonNode, t_ns: int) -> None:
        """Start at the time ``t_ns``."""
        self._node, self._is_off = node, False
        self._publisher: Publisher | None = None
        self._others = list[str]()
        self._t_ns, self._sent_s = t_ns, 0.0
        node.create_timer(_BEAT_S, self._beat, clock=STEADY)

    def publish(self, t_ns: int) -> None:
        """Publish the time."""
        self._t_ns = t_ns
        if self._publisher is None and not self._is_off:
            self._begin()
        if self._publisher is not None:
            self._sent_s = time.monotonic()
            message = Clock()
            message.clock.sec, message.clock.nanosec = stamp_of(t_ns)
            self._publisher.publish(message)

    def _begin(self) -> None:
        """Advertise /clock, unless another node publishes it."""
        self._others = self._look()
        self._is_off = bool(self._others)
        if self._is_off:
            self._node.get_logger().info(f'{TOPIC} is published by {" and ".join(self._others)}, so this node does not '
                                         'publish it')
        else:
            self._publisher = self._node.create_publisher(Clock, TOPIC, QoSProfile(depth=10))

    def _look(self) -> list[str]:
        """Return the names of the other nodes that publish /clock."""
        own = (self._node.get_name(), self._node.get_namespace()) if self._publisher else None
        return sorted(f'{one.node_namespace.rstrip("/")}/{one.node_name}'
                      for one in self._node.get_publishers_info_by_topic(TOPIC)
                      if (one.node_name, one.node_namespace) != own)

    def _beat(self) -> None:
        before, self._others = self._others, self._others if self._is_off else self._look()
        if self._publisher and self._others and self._others != before:
            self._node.get_logger().warning(f'{TOPIC} is also published by {" and ".join(self._others)}; start all but '
                                            'one of them with publish_clock:=false (launch: clock:=false)')
        if time.monotonic() - self._sent_s >= _BEAT_S:
            self.publish(self._t_ns)
