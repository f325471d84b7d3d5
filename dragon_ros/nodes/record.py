"""``record``: records the topics of a dragon as raw bytes in an MCAP bag, and accounts for missing messages."""
import os
import resource
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.publisher import Publisher

from dragon_ros.bags.record.first_report import FirstReport
from dragon_ros.bags.record.last_report import LastReport
from dragon_ros.bags.record.loss_accounting import RECEIVED, LossAccount
from dragon_ros.bags.record.scene_reader import SceneReader
from dragon_ros.bags.record.simulation_clock import SimulationClock
from dragon_ros.bags.record.writer_thread import WriterThread
from dragon_ros.bags.write.mcap import MESSAGE_BYTES
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.cli import command_line
from dragon_ros.core.errors import DiskError
from dragon_ros.core.limits import RECORDED_SCENES
from dragon_ros.core.words import counted
from dragon_ros.messages.channels import Channel, channels
from dragon_ros.messages.decode import MessageError, read_health, read_string, stamp_of_message
from dragon_ros.messages.skipping import FROM_FILL, TickSkipper
from dragon_ros.nodes import publishers, qos, raw_subscription, shell
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.logs import Seldom
from dragon_ros.scenes import provenance

_REST_S = 5.0       # maximum time after a signal to write earlier messages and the reports on their ticks
_QUIET_S = 0.5      # a run ends when its publisher has left and nothing has arrived for this long
_MONITOR_S = 10.0   # maximum wait for a monitor that neither reports nor has messages to read
_IDLE_S = 0.25      # maximum time that messages without a stamp wait for the next handles
_GATHER_S = 0.005   # maximum time that messages wait, since taking several together costs less CPU time
_COUNT_S = 1.0      # interval between counts of publishers
_MOST_UNACCOUNTED = 100_000     # limit on messages that await a scene; above it, the recorder waits until it is read
_HEALTH = '/diagnostics'
_REPORT = 'clearance/stamped'       # the first message of a monitor's report on a tick
_MARKS = ('handles', _REPORT)       # their stamps also apply to the next messages from the same publisher


class Recorder(DragonNode):
    """Subscribes to every topic of topics.yaml and writes what it receives."""

    def __init__(self, bag: BagWriter, flush_s: float = 1.0, queue_mb: float = 256.0, trust: bool = False,
                 wait_monitor: bool = False) -> None:
        """Subscribe; ``close`` closes ``bag``. Scenes are read within budgets, unless ``trust`` is true.

        With ``wait_monitor``, subscribe to the topics of ``sim`` only after a monitor has been heard.
        """
        super().__init__('record')
        self.bag, self.losses = bag, LossAccount()
        self.writer = WriterThread(bag, flush_s, queue_mb)
        self._simulation, self._monitored = (SimulationClock(self._log, self.losses.skip) for _ in range(2))
        self._last, self._seen, self._counted, self._scene = time.monotonic(), False, 0.0, ''
        self._scenes, self._attached = SceneReader(self._settings(), trust), set[str]()
        self._seldom, self._limit_told = Seldom(1.0), False
        self._unaccounted: list[tuple[str, int, int, bool]] = []    # messages received while a scene is being read
        self._names = {name: self.resolve_topic_name(name) for name in channels()}
        # The nodes of all dragons share absolute topics.
        self._sources = [publishers.Publishers(self, topic) for name, topic in self._names.items() if name[0] != '/']
        self._handles, = (one for one in self._sources if one.topic == self._names['handles'])
        self._each_tick = {self._names[name] for name, channel in channels().items() if channel.each_tick}
        self._latched = {self._names[name] for name, channel in channels().items() if channel.latched}
        self._first_report, self._last_report, self._awaited_s, self._heard_s = FirstReport(), LastReport(), 0.0, 0.0
        self._skips, self._skipped_before = TickSkipper(), 0
        self._several: dict[str, list[str]] = {}
        self._invalid = Counter[str]()       # by topic, the number of messages whose stamp or content is invalid
        self._named = set[str]()        # topics with messages that were left out
        self._health: Publisher | None = None
        self._unsubscribed = list(channels().values())
        for channel in self._unsubscribed:
            bag.add_channel(self._names[channel.name], channel)
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
        for channel in sorted(own, key=lambda channel: channel.name == _HEALTH):
            self._subscribe(channel)

    def _subscribe_to_all(self) -> None:
        """Subscribe to the remaining topics."""
        while self._unsubscribed:
            self._subscribe(self._unsubscribed.pop(0))

    def _subscribe(self, channel: Channel) -> None:
        raw_subscription.subscribe_raw(self, shell.message_type(channel.type), channel.name,
                                       self._take(self._names[channel.name], channel),
                                       qos.lossless(qos.of_channel(channel)))

    def poll(self, keep_going: bool) -> bool:
        """Do periodic work; return whether the recording has ended."""
        now = time.monotonic()
        self._take_scene()
        if now - self._last > _IDLE_S:
            self._simulation.flush(_IDLE_S)
            self._monitored.flush(_IDLE_S)
        if now - self._counted > _COUNT_S:
            self._counted = now
            self._look_around()
        if self.writer.error is not None:
            return True
        quiet = self._seen and not keep_going and now - self._last > _QUIET_S
        if not quiet or self.count_publishers('handles') or self._awaits_monitor():
            return False
        self.get_logger().info('the publisher of handles has left')
        return True

    def has_rested(self) -> bool:
        """Return whether all reports on ticks received before the first call have arrived."""
        self._last_report.fix()
        return self.writer.error is not None or not self._awaits_monitor()

    def _awaits_monitor(self) -> bool:
        """Return whether a monitor has not yet reported on the last tick; log this once."""
        if self._last_report.is_said or not self.count_publishers(_REPORT):
            return False
        now = time.monotonic()
        if not self._awaited_s:
            self._awaited_s = now
            self.get_logger().info('waiting for the monitor to report on the last tick')
        return now - max(self._awaited_s, self._heard_s) < _MONITOR_S

    def close(self) -> bool:
        """Write held messages and the loss account, close the bag, and return whether it is complete.

        Raises DiskError.
        """
        gone = not self.count_publishers('handles')
        self._share_absolute()
        self._take_scene(wait=True)
        self._scenes.close()
        self._simulation.flush()
        self._monitored.flush(first_ns=self._simulation.first_ns)
        self.writer.stop()
        try:
            with suppress(DiskError):
                self.bag.describe(RECEIVED, self.losses.report(gone) | self._left_out() | self._pressure())
            self.bag.close()
            if self.writer.error is not None:
                raise self.writer.error
        finally:
            self._log_summary(gone)
        return self._is_complete(gone)

    def _is_complete(self, gone: bool) -> bool:
        """Return whether the closed bag contains all messages that are known to have been published."""
        return (self.losses.complete(gone) and not self._unpaired and not self._invalid
                and not self._last_report.is_missing and self.bag.kept >= self.losses.received)

    @property
    def _unpaired(self) -> Counter[str]:
        """By topic, the number of unstamped messages that were left out because their tick is unknown."""
        return self._simulation.unpaired + self._monitored.unpaired

    def _look_around(self) -> None:
        """Warn about topics with several publishers, whose missing messages cannot be counted."""
        self._several = publishers.several_of(self, self._sources, self._several)
        self.losses.share(self._several)
        if self.count_publishers('handles'):
            self.losses.offer(self._names['handles'])
        self._name_left_out()
        name = f'{self.get_namespace().strip("/")}: record'
        if warnings := [*publishers.warnings_of(name, self._several), *self._skips_now(name)]:
            row = channels()[_HEALTH]
            self._health = self._health or self.create_publisher(DiagnosticArray, _HEALTH, qos.of_channel(row))
            message = DiagnosticArray(status=warnings)
            message.header.stamp = self.get_clock().now().to_msg()
            self._health.publish(message)
        self._share_absolute()

    def _share_absolute(self) -> None:
        """Note the absolute topics, shared by all nodes of the graph, that have several publishers."""
        self.losses.share(topic for topic in self._names.values()
                          if topic in channels() and self.count_publishers(topic) > 1)

    def _skips_now(self, name: str) -> list[DiagnosticStatus]:
        """Log and return a WARN if ticks have been left out since the last call."""
        before, self._skipped_before = self._skipped_before, self._skips.skipped
        if self._skips.skipped == before:
            return []
        said = (f'left out {counted(self._skips.skipped, "tick")} so far, evenly spaced: the disk is too slow, and the '
                f'queue (--queue-mb) is {self.writer.fill:.0%} full')
        self.get_logger().warning(said)
        return [DiagnosticStatus(level=DiagnosticStatus.WARN, name=f'{name}: queue', hardware_id='dragon', message=said,
                                 values=[KeyValue(key='left out', value=str(self._skips.skipped))])]

    def _name_left_out(self) -> None:
        """Warn once about each topic that has messages too large for any reader."""
        for topic in set(self.bag.left_out) - self._named:
            self._named.add(topic)
            self.get_logger().warning(f'{topic}: messages of more than {MESSAGE_BYTES} bytes are left out, because '
                                      'no reader accepts them')

    def _left_out(self) -> dict[str, str]:
        """Return what is missing: messages by topic (too large, invalid, or of an unknown tick), and reports."""
        found = {f'{topic} too large': str(count) for topic, count in self.bag.left_out.items()}
        found |= {f'{topic} of an unknown tick': str(count) for topic, count in self._unpaired.items()}
        found |= {f'{topic} invalid': str(count) for topic, count in self._invalid.items()}
        found |= {'monitor last word': 'missing'} if self._last_report.is_missing else {}
        found |= {'complete': 'false'} if found else {}
        return found | ({'monitor first reports missing': str(count)} if (count := self._first_missing) else {})

    @property
    def _first_missing(self) -> int:
        """The number of reports on recorded ticks before the first one received; 0 if there are several monitors."""
        row = self.losses.topics.get(self._names[_REPORT])
        return 0 if row and row.shared else self._first_report.missing

    def _whole(self, gone: bool) -> str:
        """Return the part of the summary that states whether anything is missing."""
        if not self._is_complete(gone):
            return 'NOT COMPLETE'
        if self.losses.is_uncertain:
            return 'it is unknown whether anything is missing'
        return 'no tick is missing' if self._first_missing else 'nothing is missing'

    def _log_summary(self, gone: bool) -> None:
        writer, log = self.writer, self.get_logger()
        topics = sum(count > 0 for count in self.bag.counts.values())
        log.info(f'{self.bag.path}: {counted(self.bag.kept, "message")} on {counted(topics, "topic")}, '
                 f'{self._whole(gone)}; the queue was at most {writer.fullest:.1%} full, and the longest write took '
                 f'{writer.slowest_write_s:.3f} s')
        for lack in self.losses.lines(gone):
            log.warning(lack)
        if writer.waits:
            log.warning(f'the queue was full {counted(writer.waits, "time")}, for {writer.waited_s:.3f} s in total')
        for topic, count in self.bag.left_out.items():
            log.warning(f'{topic}: left out {counted(count, "message")} of more than {MESSAGE_BYTES} bytes')
        for topic, count in self._unpaired.items():
            log.warning(f'{topic}: left out {counted(count, "message")} without a stamp; the tick is unknown, because '
                        'no stamped message from the same publisher was received just before')
        for topic, count in self._invalid.items():
            log.warning(f'{topic}: left out {counted(count, "invalid message")}')
        if count := self._first_missing:
            log.warning(f"the monitor's first reports are missing: {counted(count, '', 'was')} published before it had "
                        'found this recorder; record with --wait-monitor')
        if self._last_report.is_missing:
            log.warning("the monitor's last reports are missing: it has not reported on the last ticks")
        if self.losses.received > self.bag.kept:
            log.warning(f'not in the bag: {counted(self.losses.received - self.bag.kept, "received message")}')

    def _pressure(self) -> dict[str, str]:
        """Return, by name, figures that show how close the recorder came to its limits."""
        writer = self.writer
        return {'queue fullest': f'{writer.fullest:.4f}', 'queue waits': str(writer.waits),
                'queue waited_s': f'{writer.waited_s:.6f}', 'ticks left out': str(self._skips.skipped),
                'slowest write_s': f'{writer.slowest_write_s:.6f}',
                'before the first tick': str(self._simulation.left_out + self._monitored.left_out),
                'peak memory_mb': f'{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000:.1f}'}

    def _log(self, topic: str, data: bytes, t_ns: int, sequence: int, source_ns: int) -> None:
        fill = self.writer.fill
        patient = topic in self._latched or (fill > FROM_FILL and self._handles.waits())
        if kept := patient or self._keeps(topic, t_ns, fill):
            self.writer.write(topic, data, t_ns, sequence, source_ns, patient)
        if not self._scenes.busy:
            self.losses.note(topic, t_ns, sequence, kept)
            return
        self._unaccounted.append((topic, t_ns, sequence, kept))
        if len(self._unaccounted) > _MOST_UNACCOUNTED:
            self._take_scene(wait=True)

    def _keeps(self, topic: str, t_ns: int, fill: float) -> bool:
        """Return whether to write a message; if the disk is too slow, whole ticks are left out.

        A publisher that waits for its readers also waits for the disk, so that nothing is left out.
        """
        return self._skips.keeps(topic, t_ns, fill) if topic in self._each_tick else fill < 1

    def _take(self, topic: str, channel: Channel) -> Callable[[bytes, Any], None]:
        """Return the callback that writes one topic."""
        shared = channel.name.startswith('/')      # all nodes of the graph publish this topic, stamped with wall time
        once = channel.latched and channel.publisher == 'sim'      # valid for all ticks, regardless of its stamp
        stamped = not (shared or once)
        handles, benches, scene, report, health = (
            channel.name == name for name in ('handles', 'benches', 'scene', _REPORT, _HEALTH))
        watched = self._monitored if channel.publisher == 'monitor' and not shared else self._simulation
        dragon, marks = self.get_namespace().strip('/'), channel.name in _MARKS

        def callback(data: bytes, info: dict[str, int]) -> None:
            self._last = self._last if shared else time.monotonic()
            self._seen = self._seen or handles
            source_ns, sequence = info['source_timestamp'], info['publication_sequence_number'] or 0
            try:
                t_ns = self._heed(data, dragon) if health else stamp_of_message(
                    channel.type, data) if stamped else None
                if t_ns is None:
                    watched.unstamped(topic, data, source_ns, sequence, channel.latched, stamped)
                    if scene:
                        self._learn(read_string(data))
                    return
                if handles:
                    self.losses.stamp(t_ns)
                elif benches:
                    self._last_report.examinable(t_ns)
                    self._first_report.examinable(t_ns)
                elif report:
                    self._last_report.begins(t_ns)
                    self._first_report.begins(t_ns)
                    self._heard_s = self._last
                if marks:       # the previous tick's messages are written first, to keep the bag in order
                    watched.mark(source_ns, t_ns, sequence)
                self._log(topic, data, t_ns, sequence, source_ns)
            except MessageError as error:
                self._invalid[topic] += 1
                self.losses.skip(topic, sequence)
                if self._seldom():
                    self.get_logger().warning(f'{topic}: message not recorded: {error}')
        return callback

    def _heed(self, data: bytes, dragon: str) -> int | None:
        """Record the health of a monitor; return the time of the tick that it refers to, if any."""
        health = read_health(data, dragon)
        if health is None:
            return None
        if not self._last_report.heard:
            self.get_logger().info('a monitor has been found')
            self._subscribe_to_all()
        self._last_report.health(health)
        self._first_report.health(health)
        if health.waiting:
            self._heard_s = time.monotonic()
        return health.t_ns

    def _learn(self, text: str) -> None:
        """Start reading the scene of the run unless it is the last one that was read."""
        if text != self._scene:
            self._scene = text
            self._scenes.read(text)
        elif not self._scenes.busy:
            self.losses.scene_again()

    def _take_scene(self, wait: bool = False) -> None:
        """Account for the ticks of a scene that has been read, and store the scene in the bag."""
        found = self._scenes.take(wait)
        if found is None:
            return
        if found.scene is None:
            self.get_logger().warning(f'scene: it is recorded unchanged, although it cannot be read: {found.why}')
        self.losses.scene(found.scene, self.resolve_topic_name('handles').rpartition('/')[0])
        for noted in self._unaccounted:
            self.losses.note(*noted)
        self._unaccounted.clear()
        if found.metadata is not None and found.text not in self._attached:
            self._attach(found.text, found.metadata)

    def _attach(self, text: str, metadata: dict[str, str]) -> None:
        if len(self._attached) >= RECORDED_SCENES:
            if not self._limit_told:
                self._limit_told = True
                self.get_logger().warning(f'scene: the bag has {RECORDED_SCENES} attached scenes, which is the limit; '
                                          'later scenes are only recorded as messages')
            return
        self._attached.add(text)
        self.writer.describe(provenance.RECORD, metadata)
        self.writer.attach(provenance.ATTACHMENT, 'application/yaml', text.encode(errors='replace'))

    def _settings(self) -> dict[str, str]:
        """Return the settings of this recorder, for the metadata of the run."""
        settings = {key: str(value) for key, value in vars(self.bag.options).items()}
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
