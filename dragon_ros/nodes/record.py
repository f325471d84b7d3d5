"""``record``: records the topics of a dragon as raw bytes in an MCAP bag, and accounts for missing messages."""
import os
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.publisher import Publisher

from dragon_ros.bags.record.recording import HEALTH, REPORT, Recording
from dragon_ros.bags.write.mcap import MESSAGE_BYTES
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.cli import command_line
from dragon_ros.core.words import counted
from dragon_ros.messages.channels import Channel, channels
from dragon_ros.nodes import publishers, qos, raw_subscription, shell
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.logs import Seldom
from dragon_ros.scenes import provenance

_REST_S = 5.0       # maximum time after a signal to write earlier messages and the reports on their ticks
_QUIET_S = 0.5      # a run ends when its publisher has left and nothing has arrived for this long
_MONITOR_S = 10.0   # maximum wait for a monitor that neither reports nor has messages to read
_GATHER_S = 0.005   # maximum time that messages wait, since taking several together costs less CPU time
_COUNT_S = 1.0      # interval between counts of publishers


class Recorder(DragonNode):
    """Subscribes to every topic of topics.yaml, and passes what it receives to a ``Recording``."""

    def __init__(self, bag: BagWriter, flush_s: float = 1.0, queue_mb: float = 256.0, trust: bool = False,
                 wait_monitor: bool = False) -> None:
        """Subscribe; ``close`` closes ``bag``. Scenes are read within budgets, unless ``trust`` is true.

        With ``wait_monitor``, subscribe to the topics of ``sim`` only after a monitor has been heard.
        """
        super().__init__('record')
        self._names = {name: self.resolve_topic_name(name) for name in channels()}
        # The nodes of all dragons share absolute topics.
        self._sources = [publishers.Publishers(self, topic) for name, topic in self._names.items() if name[0] != '/']
        handles, = (one for one in self._sources if one.topic == self._names['handles'])
        self.recording = Recording(bag, self._names, self.get_namespace().strip('/'), self._settings(bag),
                                   flush_s=flush_s, queue_mb=queue_mb, trust=trust, warn=self._warn,
                                   warn_of_invalid=self._warn_of_invalid, publisher_waits=handles.waits,
                                   on_monitor=self._on_monitor)
        self._seldom, self._counted, self._awaited_s, self._skipped_before = Seldom(1.0), 0.0, 0.0, 0
        self._several: dict[str, list[str]] = {}
        self._health: Publisher | None = None
        self._unsubscribed = list(channels().values())
        if wait_monitor:
            self._subscribe_to_monitor()
            self.get_logger().info('waiting for a monitor')
        else:
            self._subscribe_to_all()

    def _subscribe_to_monitor(self) -> None:
        """Subscribe to a monitor's topics, and to its health last.

        The monitor discovers these subscriptions in this order, so when its health arrives, it has discovered them all.
        """
        own = [channel for channel in self._unsubscribed if channel.publisher == 'monitor']
        self._unsubscribed = [channel for channel in self._unsubscribed if channel.publisher != 'monitor']
        for channel in sorted(own, key=lambda channel: channel.name == HEALTH):
            self._subscribe(channel)

    def _on_monitor(self) -> None:
        """Subscribe to the remaining topics when a monitor is first heard."""
        self.get_logger().info('a monitor has been found')
        self._subscribe_to_all()

    def _subscribe_to_all(self) -> None:
        """Subscribe to the remaining topics."""
        while self._unsubscribed:
            self._subscribe(self._unsubscribed.pop(0))

    def _subscribe(self, channel: Channel) -> None:
        raw_subscription.subscribe_raw(self, shell.message_type(channel.type), channel.name,
                                       self.recording.receiver(channel), qos.lossless(qos.of_channel(channel)))

    def poll(self, keep_going: bool) -> bool:
        """Do periodic work; return whether the recording has ended."""
        now, recording = time.monotonic(), self.recording
        recording.flush()
        if now - self._counted > _COUNT_S:
            self._counted = now
            self._look_around()
        if recording.writer.error is not None:
            return True
        quiet = recording.seen and not keep_going and now - recording.last_s > _QUIET_S
        if not quiet or self.count_publishers('handles') or self._awaits_monitor():
            return False
        self.get_logger().info('the publisher of handles has left')
        return True

    def has_rested(self) -> bool:
        """Return whether all reports on ticks received before the first call have arrived."""
        self.recording.last_report.fix()
        return self.recording.writer.error is not None or not self._awaits_monitor()

    def _awaits_monitor(self) -> bool:
        """Return whether a monitor has not yet reported on the last tick; log this once."""
        if self.recording.last_report.is_said or not self.count_publishers(REPORT):
            return False
        now = time.monotonic()
        if not self._awaited_s:
            self._awaited_s = now
            self.get_logger().info('waiting for the monitor to report on the last tick')
        return now - max(self._awaited_s, self.recording.heard_s) < _MONITOR_S

    def close(self) -> bool:
        """Close the bag, log what it contains and what it lacks, and return whether it is complete.

        Raises DiskError.
        """
        gone = not self.count_publishers('handles')
        self._share_absolute()
        try:
            self.recording.close(gone)
        finally:
            self.get_logger().info(self.recording.summary(gone))
            for lack in self.recording.lacks(gone):
                self.get_logger().warning(lack)
        return self.recording.is_complete(gone)

    def _look_around(self) -> None:
        """Warn about topics with several publishers, whose missing messages cannot be counted, and a slow disk."""
        losses = self.recording.losses
        self._several = publishers.several_of(self, self._sources, self._several)
        losses.share(self._several)
        if self.count_publishers('handles'):
            losses.offer(self._names['handles'])
        for topic in self.recording.too_large():
            self.get_logger().warning(f'{topic}: messages of more than {MESSAGE_BYTES} bytes are left out, because '
                                      'no reader accepts them')
        name = f'{self.get_namespace().strip("/")}: record'
        if warnings := [*publishers.warnings_of(name, self._several), *self._skips_now(name)]:
            self._health = self._health or self.create_publisher(DiagnosticArray, HEALTH,
                                                                 qos.of_channel(channels()[HEALTH]))
            message = DiagnosticArray(status=warnings)
            message.header.stamp = self.get_clock().now().to_msg()
            self._health.publish(message)
        self._share_absolute()

    def _share_absolute(self) -> None:
        """Note the absolute topics, shared by all nodes of the graph, that have several publishers."""
        self.recording.losses.share(topic for topic in self._names.values()
                                    if topic in channels() and self.count_publishers(topic) > 1)

    def _skips_now(self, name: str) -> list[DiagnosticStatus]:
        """Log and return a WARN if ticks have been left out since the last call."""
        before, skipped = self._skipped_before, self.recording.skipper.skipped
        self._skipped_before = skipped
        if skipped == before:
            return []
        said = (f'left out {counted(skipped, "tick")} so far, evenly spaced: the disk is too slow, and the queue '
                f'(--queue-mb) is {self.recording.writer.fill:.0%} full')
        self.get_logger().warning(said)
        return [DiagnosticStatus(level=DiagnosticStatus.WARN, name=f'{name}: queue', hardware_id='dragon', message=said,
                                 values=[KeyValue(key='left out', value=str(skipped))])]

    def _warn(self, line: str) -> None:
        self.get_logger().warning(line)

    def _warn_of_invalid(self, line: str) -> None:
        if self._seldom():
            self.get_logger().warning(line)

    @staticmethod
    def _settings(bag: BagWriter) -> dict[str, str]:
        """Return the settings of this recorder, for the metadata of the run."""
        settings = {key: str(value) for key, value in vars(bag.options).items()}
        return settings | provenance.versions() | {'ros_distro': provenance.ros_distro(),
                                                   'rmw': os.environ.get('RMW_IMPLEMENTATION', 'default')}


def run(bag: BagWriter, keep_going: bool, flush_s: float, queue_mb: float, trust: bool, wait_monitor: bool,
        stop: threading.Event) -> int:
    """Record a bag until the run ends or a signal arrives; return the exit code."""
    node = Recorder(bag, flush_s, queue_mb, trust, wait_monitor)
    try:
        try:
            node.get_logger().info(f'recording to {bag.path}')
            shell.spin(node, stop, lambda: node.poll(keep_going), _REST_S, node.has_rested, _GATHER_S)
        finally:
            complete = node.close()
    finally:
        node.destroy_node()     # even if the disk fails: a publisher would wait for a reader that seems to be there
    return command_line.OK if complete else command_line.INCOMPLETE
