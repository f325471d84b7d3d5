"""Pairs the handles and benches of each tick, which arrive on two topics, by stamp, within bounded memory and time.

If a topic has several publishers, ``Streams`` tells their messages apart.
"""
from collections import Counter, deque
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, NamedTuple

from dragon_ros.core.limits import MONITOR_BYTES
from dragon_ros.messages.decode import Poses
from dragon_ros.messages.observation import BenchCubes, BenchMarkers, ShownBenches

_EACH_BYTES = 4096      # maximum overhead per message
_LONGEST_JUMP = 1000    # limit on consecutive lost messages before a publisher is considered new
_MOST_OTHERS = 7        # limit on the number of publishers tracked in addition to the adopted one
_EXACT = 0.25           # limit on the deviation (in steps) of a stamp that still identifies its publisher
_HANDLES, _BENCHES = 'handles', 'benches'
Pair = tuple[Poses, ShownBenches]


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
    """Holds unpaired messages in order of arrival, and drops them when a later pair is complete or a limit is reached.

    If a run restarts while one topic lags, a stamp may occur again; the oldest messages are then paired first. Since
    one topic may run ahead while the other is being resent, the limit applies to the total bytes of both topics.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._waiting: dict[str, deque[_Waiting]] = {_HANDLES: deque(), _BENCHES: deque()}
        self._stamps: dict[str, Counter[int]] = {_HANDLES: Counter(), _BENCHES: Counter()}
        self._unmatched: list[Unmatched] = []
        self.held_bytes = 0

    def add_handles(self, poses: Poses, now_s: float) -> Pair | None:
        """Add handles that arrived at ``now_s``; return (handles, benches) once both are present."""
        return self._add(_HANDLES, poses, now_s)

    def add_benches(self, shown: BenchMarkers | BenchCubes, now_s: float) -> Pair | None:
        """Add benches that arrived at ``now_s``; return (handles, benches) once both are present."""
        return self._add(_BENCHES, shown if self._stamps[_HANDLES][shown.t_ns] else shown.to_wait(), now_s)

    def add(self, topic: str, message: Poses | BenchMarkers | BenchCubes, now_s: float) -> Pair | None:
        """Add handles or benches, depending on the topic."""
        return self.add_handles(message, now_s) if isinstance(message, Poses) else self.add_benches(message, now_s)

    def expire(self, before_s: float) -> None:
        """Drop messages that have waited since before ``before_s``."""
        for topic, waiting in self._waiting.items():
            while waiting and waiting[0].since_s < before_s:
                self._give_up(topic)

    def take_unmatched(self) -> list[Unmatched]:
        """Return the messages dropped since the last call."""
        out, self._unmatched = self._unmatched, []
        return out

    def _add(self, topic: str, message: Any, now_s: float) -> Pair | None:
        """Add a message and return its pair, if any; if too many bytes are waiting, drop the oldest messages."""
        new = _Waiting(message.t_ns, message, now_s, message.size_bytes + _EACH_BYTES)
        self._waiting[topic].append(new)
        self._stamps[topic][new.t_ns] += 1
        self.held_bytes += new.size_bytes
        pair = self._match(new.t_ns)
        while self.held_bytes > MONITOR_BYTES:
            self._give_up(min((name for name in self._waiting if self._waiting[name]),
                              key=lambda name: self._waiting[name][0].since_s))
        return pair

    def _match(self, t_ns: int) -> Pair | None:
        """Return the oldest pair with this stamp, if any; drop messages older than either message of the pair."""
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


@dataclass
class _Stream:
    """The state of one publisher: its last sequence number and stamp, and the step between consecutive stamps."""

    sequence: int
    t_ns: int
    step_ns: float | None = None

    def off(self, sequence: int, t_ns: int) -> float:
        """Return how many steps a stamp is away from the one expected for a number, or inf if the step is unknown."""
        if self.step_ns is None:
            return inf
        return abs(t_ns - self.t_ns - self.step_ns * (sequence - self.sequence)) / max(self.step_ns, 1.0)

    def jump(self, sequence: int) -> float:
        """Return how far a sequence number is ahead of the expected one, or inf if it is too far ahead or too old."""
        ahead = sequence - self.sequence - 1
        return ahead if 0 <= ahead <= _LONGEST_JUMP else inf

    def advance(self, sequence: int, t_ns: int) -> None:
        """Update the state with a message."""
        steps = sequence - self.sequence
        self.step_ns = (t_ns - self.t_ns) / steps if steps > 0 and t_ns > self.t_ns else self.step_ns
        self.sequence, self.t_ns = sequence, t_ns


class Streams:
    """Tells the publishers of a topic apart by their messages, because the middleware does not name the sender.

    Each publisher numbers its messages, and its stamps increase evenly with the numbers. A message belongs to the
    publisher whose sequence it continues. Publishers with equal numbers and stamps cannot be told apart; the same is
    true of publishers with equal numbers at the moment when one of them seeks. Until a publisher is adopted, messages
    from all publishers are accepted; from then on, only messages from the adopted publisher are.
    """

    def __init__(self) -> None:
        """Start without a publisher."""
        self._all: list[_Stream] = []
        self._known: _Stream | None = None

    def follows(self, sequence: int) -> bool:
        """Return whether a message's number continues the sequence of any known publisher."""
        return any(sequence == stream.sequence + 1 for stream in self._all)

    def take(self, sequence: int, t_ns: int, alone: bool) -> bool:
        """Return whether to accept a message; always true if the topic has a single publisher (``alone``)."""
        if alone:
            self._all = self._all if len(self._all) == 1 and self.follows(sequence) else [_Stream(sequence, t_ns)]
            self._known = self._known and self._all[0]
        stream = self._all[0] if alone else self._owner(sequence, t_ns)
        stream.advance(sequence, t_ns)
        return self._known is None or stream is self._known

    def adopt(self, t_ns: int) -> None:
        """Adopt the publisher whose last stamp is nearest to this stamp, unless a publisher is already adopted."""
        if self._known is None and self._all:
            self._known = min(self._all, key=lambda stream: abs(stream.t_ns - t_ns))

    @property
    def has_adopted(self) -> bool:
        """Whether a publisher has been adopted."""
        return self._known is not None

    def forget(self) -> None:
        """Forget all publishers because the adopted publisher is gone."""
        self._known = None
        self._all.clear()

    def _owner(self, sequence: int, t_ns: int) -> _Stream:
        exact = min(self._all, key=lambda stream: stream.off(sequence, t_ns), default=None)
        if exact and exact.off(sequence, t_ns) < _EXACT:
            return exact
        near = min(self._all, key=lambda stream: stream.jump(sequence), default=None)
        if near and isfinite(near.jump(sequence)):
            return near
        kept = [stream for stream in self._all if stream is self._known]
        others = [stream for stream in self._all if stream is not self._known]
        self._all = [*kept, *others[-_MOST_OTHERS:], _Stream(sequence, t_ns)]
        return self._all[-1]
