"""``monitor``: observes the handles and benches of any publisher and reports contacts, clearance and health.

It observes a single dragon: if other dragons are published on the same topics, it continues to observe the first one
and logs a warning. Contacts with known obstacles (``obstacles``) are reported like contacts between benches.
"""
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Bool

from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.tracker import NS, ContactTracker, Report
from dragon_ros.core.limits import INBOX_MESSAGES
from dragon_ros.core.words import counted
from dragon_ros.messages.bench_reader import BenchReader
from dragon_ros.messages.cdr import float64_of
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import MessageError, is_empty_array
from dragon_ros.messages.monitor_markers import clearance_marker, report_markers, stamped_clearance, vector_of
from dragon_ros.messages.observation import observations_of, read_handles
from dragon_ros.messages.synchronizer import Pair, Synchronizer
from dragon_ros.nodes import contact_messages as messages
from dragon_ros.nodes import publisher_queue, publishers, qos, raw_subscription, shell
from dragon_ros.nodes.base import STEADY, DragonNode
from dragon_ros.nodes.inbox import Inbox
from dragon_ros.nodes.logs import Seldom
from dragon_ros.nodes.obstacles import Obstacles
from dragon_ros.nodes.params import MONITOR

_TOGETHER_HANDLES = 2**11   # handles of the ticks that are examined together: few enough to stay in the cache
_PARTNER_S = 10.0       # maximum wait for the other message of a tick; Fast DDS resends lost messages within 3 s
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
        self._pairs, self._tracker = Synchronizer(), ContactTracker()
        self._read: dict[str, Callable[[bytes], Any]] = {'handles': read_handles, 'benches': BenchReader().read}
        self._sources = {name: publishers.Publishers(self, self.resolve_topic_name(name))
                         for name in ('handles', 'benches')}
        self._obstacles = Obstacles(self, self._tracker.surround, lambda: self._inbox.work(),
                                    lambda data: self.topic_publishers[_OBSTACLES].publish(data))
        self._inbox = Inbox(self, self._sources, self._take, self._examine, self._skip, self._obstacles.awaited,
                            self._obstacles.wait)
        self._complete: list[tuple[Pair, int]] = []     # ticks to examine, with the sequence numbers of their handles
        self._unexamined = 0        # number of ticks that are examined after the current one
        self.pace, self._numbers = messages.Pace(), dict[int, int]()
        self._several: dict[str, list[str]] = {}
        self.seen = self.dropped = 0
        self._seldom = Seldom(1.0)
        self._changes = messages.Changes()
        names = (*_TOPICS, *([_VECTOR] if self.setting['clearance_vector'] else []))
        self.topic_publishers = {name: self.create_publisher(shell.message_type(row.type), name, qos.of_channel(row))
                                 for name, row in rows.items() if name in names}
        self.topic_publishers['collision/active'].publish(Bool(data=False))
        self.create_timer(_HEALTH_S, self._on_timer, clock=STEADY)
        for name in self._sources:
            row = rows[name]
            raw_subscription.subscribe_raw(self, shell.message_type(row.type), name,
                                           partial(self._inbox.put, name, row.type), qos.lossless(qos.of_channel(row)),
                                           self._inbox.work)

    def changed(self, name: str) -> None:
        """Apply a new warning limit, starting with the next tick."""
        self._warn_below_m = float(self.setting['warn_below_m'])

    def _take(self, topic: str, data: bytes, info: Any) -> None:
        """Read a message; if it belongs to the observed dragon, it may complete a tick, which is then examined."""
        def take() -> None:
            if topic == 'benches' and is_empty_array(data):
                return
            half, number = self._read[topic](data), raw_subscription.number(info)
            if self._sources[topic].keeps(number, half.t_ns):
                if topic == 'handles':
                    self._number(half.t_ns, number)
                self._gather(self._pairs.add(topic, half, time.monotonic()))
        self._guarded(take)

    def _number(self, t_ns: int, number: int) -> None:
        """Keep the sequence number of handles until their tick is complete."""
        self._numbers[t_ns] = number
        if len(self._numbers) > INBOX_MESSAGES:
            del self._numbers[next(iter(self._numbers))]

    def _skip(self) -> None:
        """Report immediately that ticks are skipped."""
        if self.pace.skip(self._inbox.skipped, time.monotonic()):
            self._publish_health(always=True)

    def _on_timer(self) -> None:
        """Drop messages whose counterpart has not arrived, check for other publishers, and publish the diagnostics."""
        self._several = publishers.several_of(self, (*self._sources.values(), self._obstacles.venue), self._several)
        self._obstacles.look()
        self._pairs.expire(time.monotonic() - _PARTNER_S)
        self._drop_unmatched()
        self._publish_health(always=True)

    def _guarded(self, work: Callable[[], None]) -> None:
        """Call ``work``; if a message is unusable, count and log it, and continue."""
        try:
            work()
        except InputError as error:
            self._drop(str(error))

    def _drop_unmatched(self) -> None:
        for topic, t_ns in self._pairs.take_unmatched():
            other = {'handles': 'benches', 'benches': 'handles'}[topic]
            self._drop(f'{topic} at {t_ns / NS:.9f} s: no {other} arrived with that stamp')

    def _gather(self, pair: Pair | None) -> None:
        """Examine ticks once some are complete, because several take less time together than one by one.

        Until a dragon has been chosen, each tick is examined at once, since it decides which messages belong to it.
        """
        self._drop_unmatched()
        if pair is None:
            return
        self._complete.append((pair, self._numbers.pop(pair[0].t_ns, 0)))
        adopted = all(source.streams.has_adopted for source in self._sources.values())
        if not adopted or len(self._complete) * len(pair[0].poses) >= _TOGETHER_HANDLES:
            self._examine()

    def _examine(self) -> None:
        """Examine the complete ticks in order."""
        complete, self._complete = self._complete, []
        if not complete:
            return
        observed = observations_of([pair for pair, _ in complete])
        self._tracker.expect([each for each in observed if isinstance(each, Observation)])
        for n, ((pair, number), each) in enumerate(zip(complete, observed, strict=True), 1):
            self._unexamined = len(complete) - n
            self._guarded(partial(self._observe, pair[0].t_ns, number, each))

    def _observe(self, t_ns: int, number: int, observed: Observation | MessageError) -> None:
        if self.pace.see(t_ns, number, time.monotonic()):
            self._publish_health(always=True)
        if isinstance(observed, MessageError):
            raise observed
        for source in self._sources.values():       # their publishers form a dragon: observe it from now on
            source.streams.adopt(observed.t_ns)
        self._obstacles.see(observed.frame_id, observed.t_ns)
        for report in self._tracker.add(observed):
            self._report(report)

    def _drop(self, why: str) -> None:
        self.dropped += 1
        if self._seldom():
            self.get_logger().warning(f'message dropped ({self.dropped} so far): {why}')

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
                                        self._inbox.waiting + 2 * self._unexamined, leaves, self.seen)
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
