"""``monitor``: observes the handles and benches of any publisher and reports contacts, clearance and health.

It observes a single dragon: if other dragons are published on the same topics, it continues to observe the first one
and logs a warning. Contacts with known obstacles (``obstacles``) are reported like contacts between benches.
"""
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Bool

from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.tracker import ContactTracker, Report
from dragon_ros.core.words import counted
from dragon_ros.messages.cdr import float64_of
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import MessageError
from dragon_ros.messages.monitor_markers import clearance_marker, report_markers, stamped_clearance, vector_of
from dragon_ros.nodes import contact_messages as messages
from dragon_ros.nodes import publisher_queue, publishers, qos, shell
from dragon_ros.nodes.base import STEADY, DragonNode
from dragon_ros.nodes.obstacles import Obstacles
from dragon_ros.nodes.params import MONITOR
from dragon_ros.nodes.tick_reader import TickReader

_HEALTH_S = 1.0         # interval between messages on /diagnostics, in wall time
_REST_S = 5.0           # maximum time to read what arrived before a signal, which launch sends when the source ends
_STAMPED = 'clearance/stamped'
_OBSTACLES = 'collision/obstacles'
_CONTACTS = 'collision/contacts'
_TOPICS = ('collision', _CONTACTS, 'collision/active', 'collision/point', 'collision/markers', _OBSTACLES, 'clearance',
           _STAMPED, 'clearance/marker', '/diagnostics')
_VECTOR = 'clearance/vector'


class Monitor(DragonNode):
    """Pairs handles with benches by their stamps, tracks the contacts of all bench pairs, and publishes them."""

    def __init__(self, **overrides: Any) -> None:
        """Subscribe to the raw bytes of handles and benches."""
        super().__init__('monitor', MONITOR, overrides)
        self._warn_below_m = float(self.setting['warn_below_m'])
        rows = channels()
        self._tracker = ContactTracker()
        self._obstacles = Obstacles(self, self._tracker.surround, lambda: self._ticks.work(),
                                    lambda data: self.topic_publishers[_OBSTACLES].publish(data))
        self._ticks = TickReader(self, self._tracker.expect, self._observe, self._skip, self._obstacles.awaited,
                                 self._obstacles.wait)
        self.pace = messages.Pace()
        self._several: dict[str, list[str]] = {}
        self.seen = 0
        self._changes = messages.Changes()
        names = (*_TOPICS, *([_VECTOR] if self.setting['clearance_vector'] else []))
        self.topic_publishers = {name: self.create_publisher(shell.message_type(row.type), name, qos.of_channel(row))
                                 for name, row in rows.items() if name in names}
        self.topic_publishers['collision/active'].publish(Bool(data=False))
        self.create_timer(_HEALTH_S, self._on_timer, clock=STEADY)
        self._ticks.subscribe()

    @property
    def dropped(self) -> int:
        """The number of messages that could not be used."""
        return self._ticks.dropped

    def changed(self, name: str) -> None:
        """Apply a new warning limit, starting with the next tick."""
        self._warn_below_m = float(self.setting['warn_below_m'])

    def _skip(self) -> None:
        """Report immediately that ticks are skipped."""
        if self.pace.skip(self._ticks.skipped, time.monotonic()):
            self._publish_health(always=True)

    def _on_timer(self) -> None:
        """Drop messages whose counterpart has not arrived, check for other publishers, and publish the diagnostics."""
        sources = (*self._ticks.sources.values(), self._obstacles.venue)
        self._several = publishers.several_of(self, sources, self._several)
        self._obstacles.look()
        self._ticks.expire()
        self._publish_health(always=True)

    def _observe(self, t_ns: int, number: int, observed: Observation | MessageError) -> None:
        if self.pace.see(t_ns, number, time.monotonic()):
            self._publish_health(always=True)
        if isinstance(observed, MessageError):
            raise observed
        self._ticks.adopt(observed.t_ns)
        self._obstacles.see(observed.frame_id, observed.t_ns)
        for report in self._tracker.add(observed):
            self._report(report)

    def _report(self, report: Report) -> None:
        """Publish the result of one tick on each topic that has subscribers or whose value has changed."""
        changed = self._changes.contact(report)
        self.seen += 1
        if self.topic_publishers[_STAMPED].get_subscription_count():    # first: it tells recorders the tick
            self.topic_publishers[_STAMPED].publish(stamped_clearance(report))
        if self.topic_publishers['clearance'].get_subscription_count():
            self.topic_publishers['clearance'].publish(float64_of(report.clearance_m))
        self._publish_vector(report)
        self._show_clearance(report, at_once=changed)
        if message := messages.collision_of(report):
            self.topic_publishers['collision'].publish(message)
            self._log(message)
        if cloud := messages.cloud_of(report):
            self.topic_publishers[_CONTACTS].publish(cloud)
        if changed:
            self.topic_publishers['collision/active'].publish(Bool(data=bool(report.count)))
        for event in report.begins:
            self.topic_publishers['collision/point'].publish(messages.point_of(event))
        markers = self.topic_publishers['collision/markers']
        if message or changed or (report.count and markers.get_subscription_count()):
            markers.publish(report_markers(report))
        self._publish_health()

    def _publish_vector(self, report: Report) -> None:
        """Publish the shortest vector if this is enabled and any benches are near each other."""
        vector = self.topic_publishers.get(_VECTOR)
        if vector and report.closest and vector.get_subscription_count():
            vector.publish(vector_of(report))

    def _show_clearance(self, report: Report, at_once: bool) -> None:
        """Publish the clearance as a marker: now if ``at_once``, otherwise no more often than a person can read it."""
        marker = self.topic_publishers['clearance/marker']
        if marker.get_subscription_count() and self._changes.label(time.monotonic(), at_once):
            marker.publish(clearance_marker(report))

    def _log(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.level == status.ERROR:    # rclpy requires one severity per line of code
                self.get_logger().error(status.message)
            else:
                self.get_logger().info(status.message)

    def leave(self) -> None:
        """Publish the last message, which tells recorders that no reports follow."""
        self._publish_health(always=True, leaves=True)

    def _publish_health(self, always: bool = False, leaves: bool = False) -> None:
        """Publish on /diagnostics if the level has changed or ``always`` is true."""
        dragon = self.get_namespace().strip('/')
        last = self._changes.last
        if self._changes.level(messages.level_of(last, self._warn_below_m)) or always:
            status = messages.health_of(dragon, last, self._warn_below_m, self.dropped,
                                        self._ticks.waiting, leaves, self.seen)
            message = DiagnosticArray(status=[status, *self._obstacles.statuses(dragon),
                                              *self.pace.warnings(dragon, time.monotonic()),
                                              *publishers.warnings_of(f'{dragon}: monitor', self._several)])
            message.header.stamp = self.get_clock().now().to_msg()
            self.topic_publishers['/diagnostics'].publish(message)


def run(stop: threading.Event) -> int:
    """Run the monitor in a new executor until ``stop`` is set; return the exit code."""
    node = Monitor()
    try:
        code = shell.spin(node, stop, rest_s=_REST_S)
        node.leave()
        publisher_queue.drain(node.topic_publishers.values(), stop, node.get_logger().warning)
        return code
    finally:
        missed = node.pace.before
        before = f'; {counted(missed, "", "was")} published before it subscribed' if missed else ''
        node.get_logger().info(f'saw {counted(node.seen, "tick")}{before}')
        if unseen := node.pace.text():
            node.get_logger().warning(unseen)
        if node.dropped:
            node.get_logger().warning(f'dropped {counted(node.dropped, "message")}')
        node.destroy_node()
