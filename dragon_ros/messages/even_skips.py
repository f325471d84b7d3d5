"""Which ticks are skipped where more arrive than can be taken: whole ones, evenly, the more the fuller the queue."""
from dataclasses import dataclass, field

FROM_FILL = 0.5     # of its budget a queue is filled before a tick is skipped
_REMEMBERED = 8192      # stamps: one topic may run ahead of another


@dataclass
class _Tick:
    kept: bool
    topics: set[str] = field(default_factory=set)


class EvenSkips:
    """Decides for each stamp, when its first message arrives, and says the same of its other messages.

    Up to ``FROM_FILL`` of the budget all ticks are kept, at the whole budget none, between in proportion: the queue
    settles where as many are kept as can be taken.
    """

    def __init__(self) -> None:
        """Start having skipped nothing."""
        self.skipped = 0        # ticks
        self._ticks: dict[int, _Tick] = {}
        self._credit = 0.0

    def keeps(self, topic: str, t_ns: int, fill: float) -> bool:
        """Return whether a message of a tick is to be kept; ``fill`` is that of the queue, 1 is full.

        A topic that has a stamp once more is of a run that started again.
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
