"""Watch a dragon tick by tick and report each contact with its bracket: the pure part of the monitor.

A watcher sees ticks only. It reports the last tick without contact, the first one with it, and between them the time
at which the signed gap, interpolated through the last three ticks, vanishes.
"""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.benches import Benches
from dragon_ros.core.contact import gaps, witness
from dragon_ros.core.neighbours import candidates
from dragon_ros.core.root import illinois
from dragon_ros.core.types import Floats, Ints

NS = 10**9


@dataclass(frozen=True)
class Sight:
    """What was seen at one tick: time, handles (N+1, 2) in m, bench rectangles, and the name of their frame."""

    t_ns: int
    p: Floats
    benches: Benches
    frame_id: str = ''


@dataclass(frozen=True)
class Event:
    """A contact began: benches (inner first), the bracket in ns, the interpolated time, the point, and the gap in m.

    ``before_ns`` is None where the first tick that was seen already had the contact. ``gap_m`` is the signed gap at
    ``after_ns``, negative for overlap.
    """

    benches: tuple[int, int]
    before_ns: int | None
    after_ns: int
    t_contact_s: float
    point_m: tuple[float, float]
    gap_m: float
    frame_id: str = ''


class Watch:
    """Looks at sights in the order of their times; one event for each contact, when it begins."""

    def __init__(self) -> None:
        """Start having seen nothing."""
        self._seen: list[Sight] = []
        self._touching = False

    def look(self, sight: Sight) -> Event | None:
        """Return the event if a contact begins with this sight.

        Time going back, or another dragon, starts afresh; the same time again tells nothing new.
        """
        if self._seen and sight.t_ns == self._seen[-1].t_ns:
            return None
        if self._seen and (sight.t_ns < self._seen[-1].t_ns or sight.p.shape != self._seen[-1].p.shape):
            self._seen, self._touching = [], False
        i, j = candidates(sight.p, sight.benches)
        gap = gaps(sight.benches, i, j)
        touching = np.flatnonzero(gap <= 0)
        begins = touching.size > 0 and not self._touching
        event = self._event(sight, i[touching], j[touching], gap[touching]) if begins else None
        self._touching = touching.size > 0
        self._seen = [*self._seen[-2:], sight]
        return event

    def _event(self, sight: Sight, i: Ints, j: Ints, gap: Floats) -> Event:
        """Return the event of the pair that touched first."""
        times = [self._contact_s(sight, a, b, g) for a, b, g in zip(i, j, gap, strict=True)]
        first = int(np.argmin(times))
        pair = (int(i[first]), int(j[first]))
        before = self._seen[-1] if self._seen else None
        point = witness(_between(before, sight, times[first]), *pair).point_m
        return Event(pair, before.t_ns if before else None, sight.t_ns, times[first], point, float(gap[first]),
                     sight.frame_id)

    def _contact_s(self, sight: Sight, i: int, j: int, gap: float) -> float:
        """Return when the gap of a pair vanished, by the parabola (or line) through the last ticks."""
        end = sight.t_ns / NS
        if not self._seen or gap == 0:
            return end
        pair = np.array([i]), np.array([j])
        known = [*(float(gaps(seen.benches, *pair)[0]) for seen in self._seen), gap]
        span = [(seen.t_ns - self._seen[-1].t_ns) / NS for seen in (*self._seen, sight)]
        if known[-2] <= 0:
            return end
        curve = np.poly1d(np.polyfit(span, known, len(known) - 1))
        root = illinois(lambda t: float(curve(t)), 0.0, span[-1], known[-2], gap)
        return float(self._seen[-1].t_ns / NS + root)


def _between(before: Sight | None, after: Sight, t_s: float) -> Benches:
    """Return the benches at a time between two sights, each moved along a line and turned evenly."""
    if before is None:
        return after.benches
    share = (t_s - before.t_ns / NS) * NS / (after.t_ns - before.t_ns)
    a, b = before.benches, after.benches
    axis = (1 - share) * a.axis + share * b.axis
    return Benches((1 - share) * a.centre + share * b.centre, axis / np.hypot(axis[:, 0], axis[:, 1])[:, None],
                   b.half_length, b.half_width)
