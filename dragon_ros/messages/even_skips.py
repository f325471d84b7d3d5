"""Skips whole ticks evenly when more arrive than can be processed: the fuller the queue, the more are skipped."""
from dataclasses import dataclass, field

FROM_FILL = 0.5     # fraction of its budget to which a queue fills before a tick is skipped
_REMEMBERED = 8192      # remembered stamps, since one topic may run ahead of another


@dataclass
class _Tick:
    kept: bool
    topics: set[str] = field(default_factory=set)


class EvenSkips:
    """Decides for each stamp when its first message arrives, and repeats the decision for its other messages.

    All ticks are kept up to a fill of ``FROM_FILL``, none at a fill of 1; in between, the fraction is linear. The queue
    settles at the fill at which ticks are kept as fast as they are processed.
    """

    def __init__(self) -> None:
        """Start without any skipped tick."""
        self.skipped = 0        # ticks
        self._ticks: dict[int, _Tick] = {}
        self._credit = 0.0

    def keeps(self, topic: str, t_ns: int, fill: float) -> bool:
        """Return whether to keep a message of a tick; ``fill`` is the fill of the queue, where 1 is full.

        If a topic repeats a stamp, its run has restarted.
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
