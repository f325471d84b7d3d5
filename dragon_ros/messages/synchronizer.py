"""Pairs handles and benches of one tick, which arrive on two topics, by stamp, in bounded memory and time."""
from collections import Counter, deque
from typing import Any, NamedTuple

from dragon_ros.core.limits import MONITOR_BYTES
from dragon_ros.messages.decode import Poses
from dragon_ros.messages.observation import BenchMarkers

_EACH_BYTES = 4096      # of one message beside its own bytes, at most
_HANDLES, _BENCHES = 'handles', 'benches'


class _Waiting(NamedTuple):
    t_ns: int
    message: Any
    since_s: float
    size_bytes: int


class Unmatched(NamedTuple):
    """An unmatched message: its topic and its stamp."""

    topic: str
    t_ns: int


class Synchronizer:
    """Holds messages without a partner, in order of arrival, until a later pair overtakes them or a limit drops them.

    A stamp may repeat where a run restarts while the other topic still lags: the oldest messages are paired first.
    One topic may run ahead while the other is resent: what waits is bounded in bytes alone, over both topics.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._waiting: dict[str, deque[_Waiting]] = {_HANDLES: deque(), _BENCHES: deque()}
        self._stamps: dict[str, Counter[int]] = {_HANDLES: Counter(), _BENCHES: Counter()}
        self._unmatched: list[Unmatched] = []
        self.held_bytes = 0

    def add_handles(self, poses: Poses, now_s: float) -> tuple[Poses, BenchMarkers] | None:
        """Add handles that arrived at ``now_s``; return (handles, benches) once both are present."""
        return self._add(_HANDLES, _Waiting(poses.t_ns, poses, now_s, poses.size_bytes + _EACH_BYTES))

    def add_benches(self, shown: BenchMarkers, now_s: float) -> tuple[Poses, BenchMarkers] | None:
        """Add benches that arrived at ``now_s``; return (handles, benches) once both are present."""
        return self._add(_BENCHES, _Waiting(shown.t_ns, shown, now_s, shown.markers.size_bytes + _EACH_BYTES))

    def expire(self, before_s: float) -> None:
        """Drop messages that have waited since before ``before_s``."""
        for topic, waiting in self._waiting.items():
            while waiting and waiting[0].since_s < before_s:
                self._give_up(topic)

    def take_unmatched(self) -> list[Unmatched]:
        """Return the messages dropped since the last call."""
        out, self._unmatched = self._unmatched, []
        return out

    def _add(self, topic: str, new: _Waiting) -> tuple[Poses, BenchMarkers] | None:
        """Add a message; return its pair, or drop the messages that have waited longest where too many bytes wait."""
        self._waiting[topic].append(new)
        self._stamps[topic][new.t_ns] += 1
        self.held_bytes += new.size_bytes
        pair = self._match(new.t_ns)
        while self.held_bytes > MONITOR_BYTES:
            self._give_up(min((name for name in self._waiting if self._waiting[name]),
                              key=lambda name: self._waiting[name][0].since_s))
        return pair

    def _match(self, t_ns: int) -> tuple[Poses, BenchMarkers] | None:
        """Return the oldest pair of a stamp, if any; messages that arrived before its halves are dropped."""
        if not all(stamps[t_ns] for stamps in self._stamps.values()):
            return None
        for topic, waiting in self._waiting.items():
            while waiting[0].t_ns != t_ns:
                self._give_up(topic)
        return self._pop(_HANDLES).message, self._pop(_BENCHES).message

    def _give_up(self, topic: str) -> None:
        self._unmatched.append(Unmatched(topic, self._pop(topic).t_ns))

    def _pop(self, topic: str) -> _Waiting:
        oldest = self._waiting[topic].popleft()
        self.held_bytes -= oldest.size_bytes
        stamps = self._stamps[topic]
        stamps[oldest.t_ns] -= 1
        if not stamps[oldest.t_ns]:
            del stamps[oldest.t_ns]
        return oldest
