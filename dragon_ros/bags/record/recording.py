"""Everything that a recorder makes of what it receives: the order of the bag, the scenes, and the account of losses."""
import resource
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

from dragon_ros.bags.record.first_report import FirstReport
from dragon_ros.bags.record.last_report import LastReport
from dragon_ros.bags.record.loss_accounting import RECEIVED, LossAccount
from dragon_ros.bags.record.scene_reader import SceneReader
from dragon_ros.bags.record.simulation_clock import SimulationClock
from dragon_ros.bags.record.writer_thread import WriterThread
from dragon_ros.bags.write.mcap import MESSAGE_BYTES
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.errors import DiskError
from dragon_ros.core.limits import RECORDED_SCENES
from dragon_ros.core.words import counted
from dragon_ros.messages.channels import Channel, channels
from dragon_ros.messages.decode import MessageError, read_health, read_string, stamp_of_message
from dragon_ros.messages.skipping import FROM_FILL, TickSkipper
from dragon_ros.scenes import provenance

_NUMBERS = 2**32    # bags store sequence numbers in 32 bits
_IDLE_S = 0.25      # maximum time that messages without a stamp wait for the next handles
_MOST_UNACCOUNTED = 100_000     # limit on messages that await a scene; above it, the recorder waits until it is read
HEALTH = '/diagnostics'
REPORT = 'clearance/stamped'        # the first message of a monitor's report on a tick
_MARKS = ('handles', REPORT)        # their stamps also apply to the next messages from the same publisher


class Recording:
    """A bag that is being recorded.

    ``receiver`` returns the function that takes the messages of a topic; ``last_s`` is when one was last received, and
    ``seen`` tells whether handles have been received. Times are of the monotonic clock.
    """

    def __init__(self, bag: BagWriter, names: dict[str, str], namespace: str, settings: dict[str, str], *,
                 flush_s: float, queue_mb: float, trust: bool, warn: Callable[[str], object],
                 warn_of_invalid: Callable[[str], object], publisher_waits: Callable[[], bool],
                 on_monitor: Callable[[], object]) -> None:
        """Add the channels to the bag; ``names`` are the full names of the topics, by their names in topics.yaml.

        ``publisher_waits()`` tells whether the publisher of handles waits for its readers, so that nothing is left out
        if the disk is slow. ``on_monitor`` is called when a monitor is first heard.
        """
        self.bag, self.losses = bag, LossAccount()
        self.writer = WriterThread(bag, flush_s, queue_mb)
        self.last_report, self.last_s, self.heard_s, self.seen = LastReport(), time.monotonic(), 0.0, False
        self.skipper = TickSkipper()
        self._names, self._namespace = names, namespace
        self._warn, self._warn_of_invalid = warn, warn_of_invalid
        self._publisher_waits, self._on_monitor = publisher_waits, on_monitor
        self._simulation, self._monitored = (SimulationClock(self._log, self.losses.skip) for _ in range(2))
        self._first_report = FirstReport()
        self._scenes, self._scene, self._attached = SceneReader(settings, trust), '', set[str]()
        self._limit_told = False
        self._unaccounted: list[tuple[str, int, int, bool]] = []    # messages received while a scene is being read
        self._each_tick = {names[name] for name, channel in channels().items() if channel.each_tick}
        self._latched = {names[name] for name, channel in channels().items() if channel.latched}
        self._invalid = Counter[str]()      # by topic, the number of messages whose stamp or content is invalid
        self._named = set[str]()            # topics with messages that were left out
        for channel in channels().values():
            bag.add_channel(names[channel.name], channel)

    def flush(self) -> None:
        """Write what has waited too long, and account for scenes that have been read."""
        self._take_scene()
        if time.monotonic() - self.last_s > _IDLE_S:
            self._simulation.flush(_IDLE_S)
            self._monitored.flush(_IDLE_S)

    def close(self, gone: bool) -> None:
        """Write held messages and the loss account, and close the bag; ``gone`` tells whether the run has ended.

        Raises DiskError.
        """
        self._take_scene(wait=True)
        self._scenes.close()
        self._simulation.flush()
        self._monitored.flush(first_ns=self._simulation.first_ns)
        self.writer.stop()
        with suppress(DiskError):
            self.bag.describe(RECEIVED, self.losses.report(gone) | self._left_out() | self._pressure())
        self.bag.close()
        if self.writer.error is not None:
            raise self.writer.error

    def is_complete(self, gone: bool) -> bool:
        """Return whether the closed bag contains all messages that are known to have been published."""
        return (self.losses.complete(gone) and not self._unpaired and not self._invalid
                and not self.last_report.is_missing and self.bag.kept >= self.losses.received)

    @property
    def _unpaired(self) -> Counter[str]:
        """By topic, the number of unstamped messages that were left out because their tick is unknown."""
        return self._simulation.unpaired + self._monitored.unpaired

    def too_large(self) -> list[str]:
        """Return the topics that have messages too large for any reader and were not returned before."""
        found = sorted(set(self.bag.left_out) - self._named)
        self._named |= set(found)
        return found

    def _left_out(self) -> dict[str, str]:
        """Return what is missing: messages by topic (too large, invalid, or of an unknown tick), and reports."""
        found = {f'{topic} too large': str(count) for topic, count in self.bag.left_out.items()}
        found |= {f'{topic} of an unknown tick': str(count) for topic, count in self._unpaired.items()}
        found |= {f'{topic} invalid': str(count) for topic, count in self._invalid.items()}
        found |= {'monitor last word': 'missing'} if self.last_report.is_missing else {}
        found |= {'complete': 'false'} if found else {}
        return found | ({'monitor first reports missing': str(count)} if (count := self._first_missing) else {})

    @property
    def _first_missing(self) -> int:
        """The number of reports on recorded ticks before the first one received; 0 if there are several monitors."""
        row = self.losses.topics.get(self._names[REPORT])
        return 0 if row and row.shared else self._first_report.missing

    def _whole(self, gone: bool) -> str:
        """Return the part of the summary that states whether anything is missing."""
        if not self.is_complete(gone):
            return 'NOT COMPLETE'
        if self.losses.is_uncertain:
            return 'it is unknown whether anything is missing'
        return 'no tick is missing' if self._first_missing else 'nothing is missing'

    def summary(self, gone: bool) -> str:
        """Return a line that states what the bag contains, and whether anything is missing."""
        writer, topics = self.writer, sum(count > 0 for count in self.bag.counts.values())
        return (f'{self.bag.path}: {counted(self.bag.kept, "message")} on {counted(topics, "topic")}, '
                f'{self._whole(gone)}; the queue was at most {writer.fullest:.1%} full, and the longest write took '
                f'{writer.slowest_write_s:.3f} s')

    def lacks(self, gone: bool) -> Iterator[str]:
        """Yield a line about each thing that the bag lacks."""
        writer = self.writer
        yield from self.losses.lines(gone)
        if writer.waits:
            yield f'the queue was full {counted(writer.waits, "time")}, for {writer.waited_s:.3f} s in total'
        for topic, count in self.bag.left_out.items():
            yield f'{topic}: left out {counted(count, "message")} of more than {MESSAGE_BYTES} bytes'
        for topic, count in self._unpaired.items():
            yield (f'{topic}: left out {counted(count, "message")} without a stamp; the tick is unknown, because '
                   'no stamped message from the same publisher was received just before')
        for topic, count in self._invalid.items():
            yield f'{topic}: left out {counted(count, "invalid message")}'
        if count := self._first_missing:
            yield (f"the monitor's first reports are missing: {counted(count, '', 'was')} published before it had "
                   'found this recorder; record with --wait-monitor')
        if self.last_report.is_missing:
            yield "the monitor's last reports are missing: it has not reported on the last ticks"
        if self.losses.received > self.bag.kept:
            yield f'not in the bag: {counted(self.losses.received - self.bag.kept, "received message")}'

    def _pressure(self) -> dict[str, str]:
        """Return, by name, figures that show how close the recorder came to its limits."""
        writer = self.writer
        return {'queue fullest': f'{writer.fullest:.4f}', 'queue waits': str(writer.waits),
                'queue waited_s': f'{writer.waited_s:.6f}', 'ticks left out': str(self.skipper.skipped),
                'slowest write_s': f'{writer.slowest_write_s:.6f}',
                'before the first tick': str(self._simulation.left_out + self._monitored.left_out),
                'peak memory_mb': f'{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000:.1f}'}

    def _log(self, topic: str, data: bytes, t_ns: int, sequence: int, source_ns: int) -> None:
        fill = self.writer.fill
        patient = topic in self._latched or (fill > FROM_FILL and self._publisher_waits())
        if kept := patient or self._keeps(topic, t_ns, fill):
            # A publisher may send no source time, which Fast DDS reports as a negative one.
            self.writer.write(topic, data, t_ns, sequence % _NUMBERS, source_ns if source_ns >= 0 else t_ns, patient)
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
        return self.skipper.keeps(topic, t_ns, fill) if topic in self._each_tick else fill < 1

    def receiver(self, channel: Channel) -> Callable[[bytes, Any], None]:
        """Return the function that takes the messages of one topic, with the information that DDS gives on them."""
        topic = self._names[channel.name]
        shared = channel.name.startswith('/')      # all nodes of the graph publish this topic, stamped with wall time
        latched = channel.latched and channel.publisher == 'sim'   # valid for all ticks, regardless of its stamp
        stamped = not (shared or latched)
        handles, benches, scene, report, health = (
            channel.name == name for name in ('handles', 'benches', 'scene', REPORT, HEALTH))
        watched = self._monitored if channel.publisher == 'monitor' and not shared else self._simulation
        marks = channel.name in _MARKS

        def callback(data: bytes, info: dict[str, int]) -> None:
            self.last_s = self.last_s if shared else time.monotonic()
            self.seen = self.seen or handles
            source_ns, sequence = info['source_timestamp'], info['publication_sequence_number'] or 0
            try:
                t_ns = self._note_health(data) if health else stamp_of_message(
                    channel.type, data) if stamped else None
                if t_ns is None:
                    watched.unstamped(topic, data, source_ns, sequence, channel.latched, stamped)
                    if scene:
                        self._read_scene(read_string(data))
                    return
                if handles:
                    self.losses.stamp(t_ns)
                elif benches:
                    self.last_report.examinable(t_ns)
                    self._first_report.examinable(t_ns)
                elif report:
                    self.last_report.begins(t_ns)
                    self._first_report.begins(t_ns)
                    self.heard_s = self.last_s
                if marks:       # the previous tick's messages are written first, to keep the bag in order
                    watched.mark(source_ns, t_ns, sequence)
                self._log(topic, data, t_ns, sequence, source_ns)
            except MessageError as error:
                self._invalid[topic] += 1
                self.losses.skip(topic, sequence)
                self._warn_of_invalid(f'{topic}: message not recorded: {error}')
        return callback

    def _note_health(self, data: bytes) -> int | None:
        """Record the health of a monitor; return the time of the tick that it refers to, if any."""
        health = read_health(data, self._namespace)
        if health is None:
            return None
        if not self.last_report.heard:
            self._on_monitor()
        self.last_report.health(health)
        self._first_report.health(health)
        if health.waiting:
            self.heard_s = time.monotonic()
        return health.t_ns

    def _read_scene(self, text: str) -> None:
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
            self._warn(f'scene: it is recorded unchanged, although it cannot be read: {found.why}')
        self.losses.scene(found.scene, self._names['handles'].rpartition('/')[0])
        for noted in self._unaccounted:
            self.losses.note(*noted)
        self._unaccounted.clear()
        if found.metadata is not None and found.text not in self._attached:
            self._attach(found.text, found.metadata)

    def _attach(self, text: str, metadata: dict[str, str]) -> None:
        if len(self._attached) >= RECORDED_SCENES:
            if not self._limit_told:
                self._limit_told = True
                self._warn(f'scene: the bag has {RECORDED_SCENES} attached scenes, which is the limit; '
                           'later scenes are only recorded as messages')
            return
        self._attached.add(text)
        self.writer.describe(provenance.RECORD, metadata)
        self.writer.attach(provenance.ATTACHMENT, 'application/yaml', text.encode(errors='replace'))
