"""Assigns a simulation time to every recorded message, even to messages without a stamp.

A message with a stamp is logged at that time. A message without one belongs to the tick of its publisher's last
stamped message before it. Source times decide this order, since topics overtake each other in transit. The stamped
message of a sim is the handles (velocities follow); of a monitor, which lags behind the sim, the stamped clearance. A
message that cannot be paired is left out and counted.
"""
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from dragon_ros.core.limits import HELD_BYTES

Write = Callable[[str, bytes, int, int, int], None]
_KEEP = 1000


class _Held(NamedTuple):
    source_ns: int
    topic: str
    data: bytes
    sequence: int
    latched: bool
    exact: bool
    since_s: float


class _Mark(NamedTuple):
    t_ns: int
    sequence: int
    source_ns: int


class SimulationClock:
    """Holds back a publisher's messages without a stamp until their tick is known."""

    def __init__(self, write: Write) -> None:
        """``write(topic, data, t_ns, sequence, source_ns)`` receives every message once."""
        self._write = write
        self._sources: list[int] = []
        self._marks: list[_Mark] = []
        self._held: list[_Held] = []
        self._held_bytes = 0
        self._last: dict[str, _Mark] = {}       # by topic, the tick of its last message
        self.first_ns: int | None = None        # time of the first tick
        self.left_out = 0                       # messages from before the first tick
        self.unpaired: Counter[str] = Counter()     # messages with an unknown tick, by topic

    def mark(self, source_ns: int, t_ns: int, sequence: int = 0) -> None:
        """Record that the stamped message of the tick at ``t_ns`` was published at ``source_ns``, with this number."""
        at = bisect_right(self._sources, source_ns)
        self._sources.insert(at, source_ns)
        self._marks.insert(at, _Mark(t_ns, sequence, source_ns))
        self.first_ns = t_ns if self.first_ns is None else self.first_ns
        if len(self._marks) > 2 * _KEEP:
            del self._sources[:_KEEP], self._marks[:_KEEP]
        self._release(lambda held: held.source_ns < self._sources[-1])

    def unstamped(self, topic: str, data: bytes, source_ns: int, sequence: int, latched: bool = False,
                  exact: bool = True) -> None:
        """Log a message without a stamp when its tick is known.

        Of messages before the first tick only latched ones are kept, and logged at that tick. A message that is not
        ``exact`` belongs to no tick and is logged at the last tick before it.
        """
        self._held.append(_Held(source_ns, topic, data, sequence, latched, exact, time.monotonic()))
        self._held_bytes += len(data)
        while not self._marks and (len(self._held) > _KEEP or self._held_bytes > HELD_BYTES):
            # The wait for a run may be long.
            left = self._held.pop(next((n for n, held in enumerate(self._held) if not held.latched), 0))
            self._held_bytes -= len(left.data)
            self.left_out += 1
        self._release(lambda held: bool(self._sources) and held.source_ns < self._sources[-1])

    def flush(self, age_s: float = 0.0, first_ns: int | None = None) -> None:
        """Log messages that have waited for at least ``age_s``: without a newer tick they belong to the last one.

        At the end, with an age of 0, latched messages are logged even without a tick: at ``first_ns`` if given.
        """
        before_s = time.monotonic() - age_s
        self._release(lambda held: held.since_s <= before_s and (age_s == 0 or (
            bool(self._marks) and not self._is_second(held, self._marks[-1]))), first_ns)

    def _release(self, known: Callable[[_Held], bool], first_ns: int | None = None) -> None:
        """Log the held messages whose tick is known, and count those without one."""
        waiting, self._held = self._held, []
        for held in waiting:
            if not known(held):
                self._held.append(held)
                continue
            self._held_bytes -= len(held.data)
            t_ns = self._time_of(held, first_ns)
            if t_ns is not None:
                self._write(held.topic, held.data, t_ns, held.sequence, held.source_ns)

    def _time_of(self, held: _Held, first_ns: int | None) -> int | None:
        """Return the time of a message; if it has none, count it and return None."""
        at = bisect_right(self._sources, held.source_ns) - 1
        if at < 0:
            return self._early_time_of(held, first_ns)
        mark = self._marks[at]
        if held.exact and (self._is_gap(at) or self._is_second(held, mark)):
            self.unpaired[held.topic] += 1
            return None
        self._last[held.topic] = mark
        return mark.t_ns

    def _early_time_of(self, held: _Held, first_ns: int | None) -> int | None:
        """Return the time of a message from before the first tick."""
        if held.latched or not (held.exact or self._marks):
            return self._marks[0].t_ns if self._marks else held.source_ns if first_ns is None else first_ns
        if self._marks:
            self.left_out += 1
        else:
            self.unpaired[held.topic] += 1
        return None

    def _is_gap(self, at: int) -> bool:
        """Return whether the stamped message of a later tick was lost: messages after it may belong to either tick."""
        if at + 1 == len(self._marks):
            return False
        here, there = self._marks[at].sequence, self._marks[at + 1].sequence
        return bool(here and there) and there not in (here + 1, 1)

    def _is_second(self, held: _Held, mark: _Mark) -> bool:
        """Return whether its topic already has a message of that tick; this one then belongs to a later tick."""
        return held.exact and not held.latched and self._last.get(held.topic) == mark
