"""``monitor``: watches the handles and benches of any publisher and reports each contact as an event."""
import threading
import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from dragon_ros.core.errors import InputError
from dragon_ros.core.watch import NS, Event, Watch
from dragon_ros.nodes import qos, shell
from dragon_ros.wire import cli
from dragon_ros.wire.cdr import stamp_of
from dragon_ros.wire.cdr_read import Markers, Poses
from dragon_ros.wire.channels import channels
from dragon_ros.wire.pairing import Pairing
from dragon_ros.wire.sights import check_handles, read_benches, sight_of

_PARTNER_S = 10.0       # to wait for the other half of a tick: what is lost is sent again within 3 s (Fast DDS)


class Monitor(Node):
    """Pairs handles with benches by their stamp, looks at each pair, publishes ``collision``."""

    def __init__(self) -> None:
        """Subscribe to the raw bytes of handles and benches."""
        super().__init__('monitor', namespace=shell.NAMESPACE)
        rows = channels()
        self._pairs, self._watch = Pairing(), Watch()
        self.dropped = 0
        self.create_timer(1.0, self._on_timer)
        self._out = self.create_publisher(DiagnosticArray, 'collision', qos.of_channel(rows['collision']))
        for name, take in (('handles', self._on_handles), ('benches', self._on_benches)):
            row = rows[name]
            self.create_subscription(shell.message_type(row.type), name, take, qos.lossless(qos.of_channel(row)),
                                     raw=True)

    def _on_handles(self, data: bytes) -> None:
        self._guarded(lambda: self._look(self._pairs.add_handles(check_handles(data), time.monotonic())))

    def _on_benches(self, data: bytes) -> None:
        self._guarded(lambda: self._look(self._pairs.add_benches(*read_benches(data), time.monotonic())))

    def _on_timer(self) -> None:
        """Give up messages whose partner does not come."""
        self._pairs.expire(time.monotonic() - _PARTNER_S)
        self._tell_unmatched()

    def _guarded(self, work: Callable[[], None]) -> None:
        """Do the work; a message that nobody can use is counted and logged, and the node goes on."""
        try:
            work()
        except InputError as error:
            self._drop(str(error))

    def _tell_unmatched(self) -> None:
        for topic, t_ns in self._pairs.take_unmatched():
            other = {'handles': 'benches', 'benches': 'handles'}[topic]
            self._drop(f'{topic} at {t_ns / NS:.9f} s: no {other} came with that stamp')

    def _look(self, pair: tuple[Poses, Markers] | None) -> None:
        self._tell_unmatched()
        if pair is not None and (event := self._watch.look(sight_of(*pair))):
            self._report(event)

    def _drop(self, why: str) -> None:
        self.dropped += 1
        self.get_logger().warning(f'message dropped ({self.dropped} so far): {why}', throttle_duration_sec=1.0)

    def _report(self, event: Event) -> None:
        message = DiagnosticArray(status=[status_of(event)])
        message.header.frame_id = event.frame_id
        message.header.stamp.sec, message.header.stamp.nanosec = stamp_of(event.after_ns)
        self._out.publish(message)
        self.get_logger().error(message.status[0].message)


def status_of(event: Event) -> DiagnosticStatus:
    """Return a contact as a diagnostic status with all its numbers."""
    before = event.after_ns if event.before_ns is None else event.before_ns
    values = {
        'inner': str(event.benches[0]), 'outer': str(event.benches[1]),
        't_before_s': f'{before / NS:.9f}', 't_after_s': f'{event.after_ns / NS:.9f}',
        't_contact_s': f'{event.t_contact_s:.9f}', 'x_m': f'{event.point_m[0]:.9f}', 'y_m': f'{event.point_m[1]:.9f}',
        'gap_m': f'{event.gap_m:.12f}', 'bracket': 'open' if event.before_ns is None else 'closed'}
    return DiagnosticStatus(
        level=DiagnosticStatus.ERROR, name='dragon: collision', hardware_id='dragon',
        message=f'contact of benches {event.benches[0]} and {event.benches[1]} at {event.t_contact_s:.6f} s, '
                f'at ({event.point_m[0]:.4f}, {event.point_m[1]:.4f}) m',
        values=[KeyValue(key=key, value=value) for key, value in values.items()])


def main(argv: list[str]) -> int:
    """Run the monitor; return the exit code."""
    options = cli.parser('monitor', 'Watch topics handles and benches, and publish each contact on collision.',
                         'ros2 run dragon_ros monitor --ros-args -r __ns:=/other_dragon')
    shell.parse(options, argv)
    return shell.run('monitor', argv, _run)


def _run(stop: threading.Event) -> int:
    node = Monitor()
    try:
        return shell.spin(node, stop)
    finally:
        if node.dropped:
            node.get_logger().warning(f'{node.dropped} messages were dropped')
        node.destroy_node()
