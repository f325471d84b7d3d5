"""Loss accounting: compares what a recorder received with what was published, so that no loss is silent.

There are two sources. A publisher numbers its messages (the publication sequence number of DDS): a gap is a message
that was lost on the way. And where the scene is known a stamp is a tick: a gap is a missing tick, lost or never
published.
"""
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from dragon_ros.bags.record import interval_set
from dragon_ros.bags.record.interval_set import Interval, IntervalSet
from dragon_ros.core.scene import Run, Scene
from dragon_ros.messages.channels import live

_MOST_STEPS = 1000


@dataclass
class TopicCount:
    """The account of one topic."""

    received: int = 0
    lost: int = 0               # by publishers that have been replaced by another
    sequence: IntervalSet = field(default_factory=IntervalSet)
    ticks: IntervalSet = field(default_factory=IntervalSet)
    off_ticks: int = 0
    shared: bool = False        # several publishers at a time: their numbers cannot be separated

    def number(self, sequence: int) -> None:
        """Count a sequence number; it restarts at 1 with the next publisher. 0 is unknown."""
        if sequence == 1 and self.sequence.last is not None:
            self.lost += interval_set.count(self.sequence.gaps())
            self.sequence = IntervalSet()
        if sequence:
            self.sequence.add(sequence)

    @property
    def lost_on_the_way(self) -> int:
        """How many messages after the first received one were published and not received."""
        return 0 if self.shared else self.lost + interval_set.count(self.sequence.gaps()) + self.sequence.forgotten

    @property
    def before(self) -> int:
        """How many messages were published before the first received one."""
        return 0 if self.shared else (self.sequence.first or 1) - 1


class LossAccount:
    """Counts messages by topic; ``report`` says what is missing."""

    def __init__(self) -> None:
        """Start without topics."""
        self.topics: dict[str, TopicCount] = {}
        self._run: Run | None = None
        self._each_tick: set[str] = set()
        self._steps: Counter[int] = Counter()
        self._last_ns: int | None = None

    def scene(self, scene: Scene | None, namespace: str) -> None:
        """Set the run that is recorded, which gives each stamp its tick. Another run resets the ticks."""
        run = None if scene is None else scene.run
        if run != self._run:
            for row in self.topics.values():
                row.ticks, row.off_ticks = IntervalSet(), 0
        self._run = run
        rows = [] if scene is None else live(scene.effects)
        self._each_tick = {f'{namespace}/{row.name}' for row in rows}

    def share(self, topics: Iterable[str]) -> None:
        """Mark topics that have several publishers at a time: nobody can say what of them is missing."""
        for topic in topics:
            self.topics.setdefault(topic, TopicCount()).shared = True

    def note(self, topic: str, t_ns: int, sequence: int) -> None:
        """Count a message that was logged at ``t_ns``."""
        row = self.topics.setdefault(topic, TopicCount())
        row.received += 1
        row.number(sequence)
        if self._run is not None and topic in self._each_tick:
            tick = self._run.tick_at(t_ns)
            if tick >= 0 and self._run.time_ns(tick) == t_ns:
                row.ticks.add(tick)
            else:
                row.off_ticks += 1

    def stamp(self, t_ns: int) -> None:
        """Record the stamp of handles, whose spacing is reported where no scene is known."""
        if self._last_ns is not None and (len(self._steps) < _MOST_STEPS or t_ns - self._last_ns in self._steps):
            self._steps[t_ns - self._last_ns] += 1
        self._last_ns = t_ns

    def missing(self, ended: bool) -> dict[str, list[Interval]]:
        """Return the missing ticks by topic, between its first and its last.

        Where the run has ``ended``, its last tick is that of any topic: what others lack at the end is missing too.
        """
        ticks = {topic: row.ticks for topic, row in self.topics.items()
                 if row.ticks.last is not None and not row.shared}
        last = max((row.last or 0 for row in ticks.values()), default=None) if ended else None
        found = {topic: row.gaps(last) for topic, row in ticks.items()}
        return {topic: gaps for topic, gaps in found.items() if gaps}

    def complete(self, ended: bool) -> bool:
        """Return whether nothing is missing, as far as anybody can say."""
        return not self.missing(ended) and not any(row.lost_on_the_way for row in self.topics.values())

    @property
    def received(self) -> int:
        """How many messages were received on all topics."""
        return sum(row.received for row in self.topics.values())

    def report(self, ended: bool) -> dict[str, str]:
        """Return the whole account as a metadata record."""
        out, missing = {'complete': str(self.complete(ended)).lower(), 'spacing': self.spacing()}, self.missing(ended)
        for topic, row in self.topics.items():
            out[f'{topic} received'] = str(row.received)
            out[f'{topic} lost'] = 'unknown: several publishers' if row.shared else str(row.lost_on_the_way)
            out[f'{topic} before'] = str(row.before)
            if row.ticks.last is not None:
                out[f'{topic} ticks'] = f'{row.ticks.first}-{row.ticks.last}'
                out[f'{topic} missing ticks'] = 'unknown: several publishers' if row.shared else (
                    interval_set.text(missing.get(topic, [])) or 'none')
                out[f'{topic} off ticks'] = str(row.off_ticks)
        return out

    def lines(self, ended: bool) -> list[str]:
        """Return a line for each topic that lacks anything."""
        out = [f'{topic}: {interval_set.count(gaps)} ticks are missing: {interval_set.text(gaps)}'
               for topic, gaps in self.missing(ended).items()]
        out += [f'{topic}: {row.lost_on_the_way} messages were lost on the way, of '
                f'{row.received + row.lost_on_the_way} published' for topic, row in self.topics.items()
                if row.lost_on_the_way]
        out += [f'{topic}: several published on it at a time, so nobody can say what is missing'
                for topic, row in self.topics.items() if row.shared]
        return out

    def spacing(self) -> str:
        """Return the usual spacing of the stamps, and how many deviate from it."""
        if not self._steps:
            return 'too few stamps'
        (usual, _), = self._steps.most_common(1)
        odd = sum(count for step, count in self._steps.items() if abs(step - usual) > 1)
        more = sum(count for step, count in self._steps.items() if step > 1.5 * usual)
        return f'{usual} ns apart' + (f', but {odd} of {self._steps.total()} are not: {more} are longer' if odd else '')
