"""Simulation time for every recorded message, even without a stamp of its own.

A message with a stamp is logged at that time. One without (velocities, clearance) belongs to the tick whose handles
were the last published before it, by the publishers' source times, since topics overtake each other in transit.
"""
import time
from bisect import bisect_right
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
    since_s: float


class SimulationClock:
    """Holds messages without a stamp back until their tick is known."""

    def __init__(self, write: Write) -> None:
        """``write(topic, data, t_ns, sequence, source_ns)`` receives every message once."""
        self._write = write
        self._sources: list[int] = []
        self._stamps: list[int] = []
        self._held: list[_Held] = []
        self._held_bytes = 0
        self.left_out = 0       # messages from before the first tick

    def mark(self, source_ns: int, t_ns: int) -> None:
        """Record that the handles of ``t_ns`` were published at ``source_ns``."""
        at = bisect_right(self._sources, source_ns)
        self._sources.insert(at, source_ns)
        self._stamps.insert(at, t_ns)
        if len(self._sources) > 2 * _KEEP:
            del self._sources[:_KEEP], self._stamps[:_KEEP]
        self._release(lambda held: held.source_ns < self._sources[-1])

    def unstamped(self, topic: str, data: bytes, source_ns: int, sequence: int, latched: bool = False) -> None:
        """Log a message without a stamp as soon as its tick is known.

        Of messages from before the first tick only latched ones are kept, logged at that tick.
        """
        self._held.append(_Held(source_ns, topic, data, sequence, latched, time.monotonic()))
        self._held_bytes += len(data)
        while not self._sources and (len(self._held) > _KEEP or self._held_bytes > HELD_BYTES):
            # The wait for a run may be long.
            left = self._held.pop(next((n for n, held in enumerate(self._held) if not held.latched), 0))
            self._held_bytes -= len(left.data)
            self.left_out += 1
        self._release(lambda held: bool(self._sources) and held.source_ns < self._sources[-1])

    def flush(self, age_s: float = 0.0) -> None:
        """Log what has waited for at least ``age_s``: without newer handles it belongs to the last tick."""
        before_s = time.monotonic() - age_s
        self._release(lambda held: held.since_s <= before_s and (age_s == 0 or bool(self._sources)))

    def _release(self, known: Callable[[_Held], bool]) -> None:
        """Log the held messages whose tick is known; those from before the first tick are omitted."""
        ready = [held for held in self._held if known(held)]
        if ready:
            self._held = [held for held in self._held if not known(held)]
            self._held_bytes = sum(len(held.data) for held in self._held)
        for held in ready:
            at = bisect_right(self._sources, held.source_ns) - 1
            if at < 0 and self._sources and not held.latched:
                self.left_out += 1
                continue
            t_ns = self._stamps[max(at, 0)] if self._sources else held.source_ns
            self._write(held.topic, held.data, t_ns, held.sequence, held.source_ns)
