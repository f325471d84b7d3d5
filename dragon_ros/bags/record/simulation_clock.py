"""Assigns a simulation time to every recorded message, with or without a stamp.

A message with a stamp is logged at that time. A message without a stamp belongs to the tick of the last stamped message
that its publisher sent before it. The order of sending follows from source times, since messages on different topics
may overtake each other in transit. The stamped message of a sim is the handles message, which is followed by the
velocities; the stamped message of a monitor, which lags behind the sim, is the clearance. A message that cannot be
assigned to a tick is left out and counted.

Source times come from the system clock, which may be set back during a run. The next message on a topic then has an
earlier source time than the previous one. Messages are therefore ordered by a "moment": the number of times that the
clock has been set back so far, and the source time.
"""
import time
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from dragon_ros.core.limits import HELD_BYTES

Write = Callable[[str, bytes, int, int, int], None]
# A stopped recorder later receives some topics before others, by up to the messages that the middleware keeps: 5,000 at
# the publisher and 5,000 at the reader with Fast DDS.
MOST_HELD = 10_000      # maximum number of messages that wait for their tick
_MARKS = 10_000         # number of ticks that are kept for late messages
_DROPPED = 1000         # number of ticks that are dropped together
_SURELY_NS = 10**9      # delays in transit never make source times decrease by more than this
_Moment = tuple[int, int]       # how often the clock has been set back so far, and the source time in ns


class _Held(NamedTuple):
    moment: _Moment
    topic: str
    data: bytes
    sequence: int
    latched: bool
    exact: bool
    since_s: float


def _moment(held: _Held) -> _Moment:
    return held.moment


class _Mark(NamedTuple):
    t_ns: int
    sequence: int
    moment: _Moment


class _Sent(NamedTuple):
    """The last message on a topic."""

    moment: _Moment
    sequence: int

    def is_before_setting_back(self, source_ns: int, sequence: int) -> bool:
        """Return whether the clock was set back between this message and its publisher's next message."""
        earlier_ns = self.moment[1] - source_ns
        return earlier_ns > (0 if sequence in (self.sequence + 1, 1) else _SURELY_NS)


class SimulationClock:
    """Holds each unstamped message of a publisher until its tick is known."""

    def __init__(self, write: Write, skip: Callable[[str, int], None] = lambda topic, sequence: None) -> None:
        """``write(topic, data, t_ns, sequence, source_ns)`` is called once for each logged message.

        ``skip(topic, sequence)`` is called for each message that is counted in ``unpaired``.
        """
        self._write, self._skip = write, skip
        self._moments: list[_Moment] = []       # moments of the stamped messages, in order
        self._marks: list[_Mark] = []
        # How often the clock was set back, and the source times just before and after it was last set back.
        self._set_back, self._turn_ns = 0, (0, 0)
        self._sent: dict[str, _Sent] = {}
        self._held: list[_Held] = []        # in order of their moments
        self._held_bytes = 0
        self._last: dict[str, _Mark] = {}       # by topic: the tick of its last message
        self._first_moment: _Moment | None = None
        self.first_ns: int | None = None        # time of the first tick
        self.left_out = 0                       # number of messages from before the first tick
        self.unpaired: Counter[str] = Counter()     # by topic: the number of messages with an unknown tick

    def mark(self, source_ns: int, t_ns: int, sequence: int = 0) -> None:
        """Record the source time and the sequence number of a tick's stamped message; ``t_ns`` is the stamp."""
        last = self._marks[-1] if self._marks else None
        if last and source_ns < last.moment[1] and _Sent(last.moment, last.sequence).is_before_setting_back(
                source_ns, sequence):
            self._set_back, self._turn_ns = self._set_back + 1, (last.moment[1], source_ns)
        moment = self._set_back, source_ns
        at = len(self._moments)
        if last and moment < last.moment:
            at = bisect_right(self._moments, moment)
        self._moments.insert(at, moment)
        self._marks.insert(at, _Mark(t_ns, sequence, moment))
        if self._first_moment is None or moment < self._first_moment:
            self._first_moment = moment
        self.first_ns = t_ns if self.first_ns is None else self.first_ns
        if len(self._marks) >= _MARKS + _DROPPED:
            del self._moments[:_DROPPED], self._marks[:_DROPPED]
        self._release_known()

    def unstamped(self, topic: str, data: bytes, source_ns: int, sequence: int, latched: bool = False,
                  exact: bool = True) -> None:
        """Log a message without a stamp when its tick is known.

        Among messages before the first tick, only latched messages are kept; they are logged at that tick. A message
        that is not ``exact`` belongs to no tick and is logged at the last tick before it.
        """
        moment = self._moment_of(topic, source_ns, sequence, exact)
        at = len(self._held)
        if at and moment < self._held[-1].moment:
            at = bisect_right(self._held, moment, key=_moment)
        self._held.insert(at, _Held(moment, topic, data, sequence, latched, exact, time.monotonic()))
        self._held_bytes += len(data)
        self._release_known()
        while len(self._held) > MOST_HELD or self._held_bytes > HELD_BYTES:
            self._give_up()

    def _moment_of(self, topic: str, source_ns: int, sequence: int, exact: bool) -> _Moment:
        """Return the moment of a message without a stamp.

        If the clock was set back, a topic's next message may reveal this before the next stamped message does.
        """
        last = self._sent.get(topic)
        times = last.moment[0] if last else 0
        if last and self._marks and exact and last.is_before_setting_back(source_ns, sequence):
            times = min(times, self._set_back) + 1
        if times < self._set_back and self._is_after_turn(source_ns):
            times = self._set_back
        self._sent[topic] = _Sent((times, source_ns), sequence)
        return times, source_ns

    def _is_after_turn(self, source_ns: int) -> bool:
        """Return whether a message was sent after the clock was last set back, rather than delayed in transit.

        If the clock was set back by less than a second, source times can be ambiguous for up to a second.
        """
        before_ns, after_ns = self._turn_ns
        if before_ns - after_ns < _SURELY_NS:
            return source_ns > before_ns + _SURELY_NS
        return abs(source_ns - after_ns) <= abs(source_ns - before_ns)

    def _give_up(self) -> None:
        """Give up on messages that have waited too long because the run began late or the tick never arrived."""
        if self._marks:
            self._sent.clear()
            self._release(lambda held: True)
            return
        left = self._held.pop(next((n for n, held in enumerate(self._held) if not held.latched), 0))
        self._held_bytes -= len(left.data)
        self.left_out += 1

    def flush(self, age_s: float = 0.0, first_ns: int | None = None) -> None:
        """Log messages that have waited for at least ``age_s``; without a newer tick, they belong to the last tick.

        At the end, with an age of 0, latched messages are logged even without a tick, at ``first_ns`` if given.
        """
        before_s = time.monotonic() - age_s
        self._release(lambda held: held.since_s <= before_s and (age_s == 0 or (
            bool(self._marks) and not self._is_second(held, self._marks[-1]))), first_ns)

    def _release_known(self) -> None:
        """Log the held messages that were sent before the last stamped message."""
        if not self._held or not self._moments or self._held[0].moment >= self._moments[-1]:
            return
        count = bisect_left(self._held, self._moments[-1], key=_moment)
        known, self._held = self._held[:count], self._held[count:]
        for held in known:
            self._log(held)

    def _release(self, known: Callable[[_Held], bool], first_ns: int | None = None) -> None:
        """Log the held messages whose tick is known, and count those without one."""
        waiting, self._held = self._held, []
        for held in waiting:
            if known(held):
                self._log(held, first_ns)
            else:
                self._held.append(held)

    def _log(self, held: _Held, first_ns: int | None = None) -> None:
        """Log a message that is no longer held, or count it if its tick is unknown."""
        self._held_bytes -= len(held.data)
        t_ns = self._time_of(held, first_ns)
        if t_ns is not None:
            self._write(held.topic, held.data, t_ns, held.sequence, held.moment[1])

    def _time_of(self, held: _Held, first_ns: int | None) -> int | None:
        """Return the log time of a message; if it has no tick, count it and return None."""
        at = bisect_right(self._moments, held.moment) - 1
        if at < 0:
            return self._early_time_of(held, first_ns)
        mark = self._marks[at]
        if held.latched and held.exact and self._is_gap(at):
            mark = self._marks[at + 1]      # a latched message that had arrived by then is still valid
        elif held.exact and (self._is_gap(at) or self._is_second(held, mark)):
            self._leave_out(held)
            return None
        self._last[held.topic] = mark
        return mark.t_ns

    def _early_time_of(self, held: _Held, first_ns: int | None) -> int | None:
        """Return the log time of a message from before the first tick, or None if the message is left out."""
        if held.latched or not (held.exact or self._marks):
            return self._marks[0].t_ns if self._marks else held.moment[1] if first_ns is None else first_ns
        if self._first_moment is not None and held.moment < self._first_moment:
            self.left_out += 1
        else:
            self._leave_out(held)
        return None

    def _leave_out(self, held: _Held) -> None:
        """Count a message whose tick is unknown."""
        self.unpaired[held.topic] += 1
        self._skip(held.topic, held.sequence)

    def _is_gap(self, at: int) -> bool:
        """Return whether a stamped message was lost between this mark and the next, so that ticks are ambiguous."""
        if at + 1 == len(self._marks):
            return False
        here, there = self._marks[at].sequence, self._marks[at + 1].sequence
        return bool(here and there) and there not in (here + 1, 1)

    def _is_second(self, held: _Held, mark: _Mark) -> bool:
        """Return whether the topic already has a message for this tick, so that ``held`` belongs to a later tick."""
        return held.exact and not held.latched and self._last.get(held.topic) == mark
