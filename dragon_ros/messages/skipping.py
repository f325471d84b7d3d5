"""Skips whole ticks evenly if they arrive too fast to be processed; a fuller queue skips more ticks."""
from dataclasses import dataclass, field

FROM_FILL = 0.5     # fraction of a queue's budget above which ticks are skipped
_REMEMBERED = 8192      # number of remembered stamps, because one topic may run ahead of another


@dataclass
class _Tick:
    kept: bool
    topics: set[str] = field(default_factory=set)


class TickSkipper:
    """Decides for each stamp when its first message arrives; the decision applies to all messages with that stamp.

    Up to a fill level of ``FROM_FILL``, all ticks are kept; at a fill level of 1, none are; in between, the fraction of
    kept ticks decreases linearly. The queue settles at the level where ticks are kept as fast as they are processed.
    """

    def __init__(self) -> None:
        """Start without any skipped tick."""
        self.skipped = 0        # number of skipped ticks
        self._ticks: dict[int, _Tick] = {}
        self._credit = 0.0

    def keeps(self, topic: str, t_ns: int, fill: float) -> bool:
        """Return whether to keep a message of a tick; ``fill`` is the fill level of the queue, from 0 to 1 (full).

        If a stamp is repeated on a topic, the run has restarted.
        """
        tick = self._ticks.get(t_ns)
        if tick is None or topic in tick.topics:
            tick = self._ticks[t_ns] = _Tick(self._decide(fill))
            if len(self._ticks) > _REMEMBERED:
                del self._ticks[next(iter(self._ticks))]
        tick.topics.add(topic)
        return tick.kept

    def _decide(self, fill: float) -> bool:
        self._credit += min(1.0, max(0.0, (1.0 - fill) / (1.0 - FROM_FILL)))
        kept = self._credit >= 1.0
        self._credit -= kept
        self.skipped += not kept
        return kept
