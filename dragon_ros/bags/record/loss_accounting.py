"""Loss accounting: compares received with published messages so that every loss is reported.

Losses are found in two ways. Publishers number their messages (DDS publication sequence numbers): a gap in the numbers
means that messages were lost in transit, and a first number above 1 shows how many messages were published before the
recorder subscribed.

If the scene is known, a stamp also identifies a tick: a gap in the ticks means that ticks are missing (lost or never
published), and a first tick after tick 0 means that the beginning of the run is missing.
"""
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from dragon_ros.bags.record import interval_set
from dragon_ros.bags.record.interval_set import Interval, IntervalSet
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.words import counted
from dragon_ros.messages.channels import channel_of, channels, live

RECEIVED = 'dragon_ros.received'     # name of the metadata record that contains the account
_MOST_STEPS = 1000
_MOST_EARLY = 100_000       # maximum number of stamps kept until the scene is known


@dataclass
class TopicCount:
    """The loss account of one topic."""

    received: int = 0
    left_out: int = 0           # number of messages dropped because the disk was too slow
    lost: int = 0               # number of lost messages from earlier publishers
    sequence: IntervalSet = field(default_factory=IntervalSet)
    ticks: IntervalSet = field(default_factory=IntervalSet)
    off_ticks: int = 0
    early: list[int] | None = None      # stamps that arrived before their publisher's scene, or None if it is known
    scene_ahead: bool = False           # the next publisher's scene arrived before its first message
    shared: bool = False        # there are several simultaneous publishers, whose sequence numbers cannot be separated

    def number(self, sequence: int) -> None:
        """Count a sequence number; every publisher starts at 1, and 0 stands for an unknown number."""
        if sequence == 1 and self.sequence.last is not None:
            self.lost += interval_set.count(self.sequence.gaps())
            self.sequence = IntervalSet()
            self.early, self.scene_ahead = None if self.scene_ahead else [], False
        if sequence:
            self.sequence.add(sequence)

    def scene_came(self) -> list[int]:
        """Note that the scene has arrived, and return the stamps that waited for it."""
        early, self.early = self.early or [], None
        self.scene_ahead = not early
        return early

    def tick(self, run: Run, t_ns: int) -> None:
        """Count a stamp as a tick of a run."""
        tick = run.tick_at(t_ns)
        if tick >= 0 and run.time_ns(tick) == t_ns:
            self.ticks.add(tick)
        else:
            self.off_ticks += 1

    @property
    def lost_on_the_way(self) -> int:
        """The number of messages that were published after the first received message but were not received."""
        return 0 if self.shared else self.lost + interval_set.count(self.sequence.gaps()) + self.sequence.forgotten

    @property
    def before(self) -> int:
        """The number of messages published before the first received message."""
        return 0 if self.shared else (self.sequence.first or 1) - 1


class LossAccount:
    """Counts messages by topic; ``report`` lists missing messages."""

    def __init__(self) -> None:
        """Start without topics."""
        self.topics: dict[str, TopicCount] = {}
        self._run: Run | None = None
        self._each_tick: set[str] = set()
        self._offered: set[str] = set()
        self._steps: Counter[int] = Counter()
        self._last_ns: int | None = None

    def scene(self, scene: Scene | None, namespace: str) -> None:
        """Set the scene, whose run assigns a tick to each stamp, including stamps that arrived just before the scene.

        A different run resets the ticks.
        """
        run = None if scene is None else scene.run
        self._each_tick = {f'{namespace}/{row.name}' for row in (() if scene is None else live(scene.effects))}
        for row in self.topics.values():
            if run != self._run:
                row.ticks, row.off_ticks = IntervalSet(), 0
        self._run = run
        self.scene_again()

    def scene_again(self) -> None:
        """Count the stamps that arrived just before a scene that equals the previous scene."""
        for topic, row in self.topics.items():
            for t_ns in row.scene_came():
                if self._run is not None and topic in self._each_tick:
                    row.tick(self._run, t_ns)

    def offer(self, topic: str) -> None:
        """Note that a topic with one message per tick has a publisher."""
        self._offered.add(topic)

    def share(self, topics: Iterable[str]) -> None:
        """Mark topics with several simultaneous publishers, since their missing messages cannot be counted."""
        for topic in topics:
            self._row(topic).shared = True

    def _row(self, topic: str) -> TopicCount:
        row = self.topics.get(topic)
        if row is None:
            row = self.topics[topic] = TopicCount(early=[] if self._run is None else None)
        return row

    def note(self, topic: str, t_ns: int, sequence: int, kept: bool = True) -> None:
        """Count a message that was logged at ``t_ns`` or, if not ``kept``, left out of the bag."""
        row = self._row(topic)
        row.received += 1
        row.number(sequence)
        if not kept:
            row.left_out += 1
            return
        if row.early is not None and len(row.early) < _MOST_EARLY:
            row.early.append(t_ns)
        if self._run is not None and topic in self._each_tick:
            row.tick(self._run, t_ns)

    def skip(self, topic: str, sequence: int) -> None:
        """Record that a message was received, and not lost in transit, although its tick is unknown."""
        self._row(topic).number(sequence)

    def stamp(self, t_ns: int) -> None:
        """Record the stamp of a handles message; if no scene is known, the spacing of these stamps is reported."""
        if self._last_ns is not None and (len(self._steps) < _MOST_STEPS or t_ns - self._last_ns in self._steps):
            self._steps[t_ns - self._last_ns] += 1
        self._last_ns = t_ns

    def missing(self, ended: bool) -> dict[str, list[Interval]]:
        """Return the missing ticks of each topic, between its first and its last tick.

        If the run has ``ended``, its last tick is the latest tick of any topic, and a topic that ends earlier lacks
        ticks.
        """
        ticks = {topic: row.ticks for topic, row in self.topics.items()
                 if row.ticks.last is not None and not row.shared}
        last = max((row.last or 0 for row in ticks.values()), default=None) if ended else None
        found = {topic: row.gaps(last) for topic, row in ticks.items()}
        return {topic: gaps for topic, gaps in found.items() if gaps}

    def beginnings(self) -> dict[str, int]:
        """Return, by topic, how many messages are missing before the first received message.

        The number follows from the ticks or, without a scene, from the sequence numbers. Only topics with one message
        per tick are counted and, without a scene, only those of ``sim``, because other topics continue across runs.
        """
        if self._run is None:
            found = {topic: row.before for topic, row in self.topics.items()
                     if (channel := channel_of(topic)) and channel.each_tick}
        else:
            found = {topic: row.ticks.first or 0 for topic, row in self.topics.items()}
        return {topic: count for topic, count in found.items() if count}

    def unheard(self) -> list[str]:
        """Return the topics that should have one message per tick but have none.

        The scene declares these topics, or they have a publisher.
        """
        return sorted((self._each_tick | self._offered) - {topic for topic, row in self.topics.items() if row.received})

    def complete(self, ended: bool) -> bool:
        """Return whether no message is known to be missing."""
        lost = any(row.lost_on_the_way or row.left_out for row in self.topics.values())
        return not (self.missing(ended) or self.beginnings() or self.unheard() or lost)

    @property
    def is_uncertain(self) -> bool:
        """Whether losses may be unnoticed because a topic of the dragon has had several simultaneous publishers."""
        return any(row.shared and topic not in channels() for topic, row in self.topics.items())

    @property
    def received(self) -> int:
        """The number of messages received on all topics."""
        return sum(row.received for row in self.topics.values())

    def report(self, ended: bool) -> dict[str, str]:
        """Return the whole account as a metadata record."""
        complete = ('unknown' if self.is_uncertain else 'true') if self.complete(ended) else 'false'
        out, missing = {'complete': complete, 'spacing': self.spacing()}, self.missing(ended)
        beginnings = self.beginnings()
        out |= {f'{topic} received': '0' for topic in self.unheard()}
        for topic, row in self.topics.items():
            out[f'{topic} received'] = str(row.received)
            out[f'{topic} lost'] = 'unknown: several publishers' if row.shared else str(row.lost_on_the_way)
            out[f'{topic} left out'] = str(row.left_out)
            out[f'{topic} before'] = str(row.before)
            out[f'{topic} missing at the beginning'] = str(beginnings.get(topic, 0))
            if row.ticks.last is not None:
                out[f'{topic} ticks'] = f'{row.ticks.first}-{row.ticks.last}'
                out[f'{topic} missing ticks'] = 'unknown: several publishers' if row.shared else (
                    interval_set.text(missing.get(topic, [])) or 'none')
                out[f'{topic} off ticks'] = str(row.off_ticks)
        return out

    def lines(self, ended: bool) -> list[str]:
        """Return a line for each topic with missing messages."""
        what = 'message' if self._run is None else 'tick'
        out = [f'{topic}: the beginning is missing: {counted(count, what, "was")} published before the first one '
               'received' for topic, count in self.beginnings().items()]
        out += [f'{topic}: no message was received' for topic in self.unheard()]
        out += [f'{topic}: {counted(count, "tick", "is")} missing: {interval_set.text(gaps)}'
                for topic, gaps in self.missing(ended).items() for count in (interval_set.count(gaps),)]
        out += [f'{topic}: {counted(row.lost_on_the_way, "message", "was")} lost in transit, of '
                f'{row.received + row.lost_on_the_way} published' for topic, row in self.topics.items()
                if row.lost_on_the_way]
        out += [f'{topic}: {counted(row.left_out, "message", "was")} left out because the disk was too slow'
                for topic, row in self.topics.items() if row.left_out]
        out += [f'{topic}: there are several publishers, so missing messages cannot be counted'
                for topic, row in self.topics.items() if row.shared]
        return out

    def spacing(self) -> str:
        """Return the usual spacing of the stamps and the number of deviations."""
        if not self._steps:
            return 'too few stamps'
        (usual, _), = self._steps.most_common(1)
        odd = sum(count for step, count in self._steps.items() if abs(step - usual) > 1)
        more = sum(count for step, count in self._steps.items() if step > 1.5 * usual)
        return f'{usual} ns apart' + (f', but {odd} of {self._steps.total()} are not: {more} are longer' if odd else '')
