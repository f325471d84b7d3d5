"""Pacing by the steady clock: due times are computed from simulation time, never by adding up waits."""
import time

from dragon_ros.core.errors import FieldError

_AT_ONCE_NS = 50_000_000            # maximum delay that is made up by playing ticks without waiting
_ON_TIME_NS = 5_000_000             # maximum delay at which a tick is on time, so that the run may speed up
_FASTER = 0.1                       # fraction by which the run speeds up to make up a larger delay
_LONGEST_NS = 3_600_000_000_000     # maximum wait; a later tick needs several waits (a timer supports at most 2^63 ns)
_FOREVER_NS = 1e18                  # limit on a computed wait (30 years), since a tiny scale can make it infinite
_MOST_BEHIND_NS = 1_000_000_000     # maximum delay that is made up, so that a slow machine does not run fast for long


class Pacer:
    """Computes when each simulation time is due; with ``scale`` 0, it is due immediately.

    After a late tick, the next ticks follow immediately until they are on time again, so that a short stall does not
    lower the rate. A tick is an overrun if it starts more than 50 ms late, and after its successor was due. Overruns
    are counted, and pacing continues from there without a burst. While later ticks are on time, the run is 10 % faster,
    until it has made up the delay (at most one second of it).
    """

    def __init__(self, scale: float) -> None:
        """Set the pace to ``scale`` seconds of simulation per second of wall time."""
        self._scale = _checked(scale)
        self._origin: tuple[int, int] | None = None
        self.last_ns: int | None = None
        self.late_ns = 0            # how late the last tick started
        self.overruns = 0
        self.worst_late_s = 0.0
        self._behind_ns = 0         # delay that remains to be made up

    @property
    def scale(self) -> float:
        """Seconds of simulation per second of wall time; a change takes effect immediately, without a jump."""
        return self._scale

    @scale.setter
    def scale(self, scale: float) -> None:
        now, old, self._scale = time.monotonic_ns(), self._scale, _checked(scale)
        if self._origin:
            self._origin = (now, self._origin[1] + round((now - self._origin[0]) * old)) if old and scale else None

    def rest(self) -> None:
        """Reset the pace: the next tick is due one step after its due time is first requested."""
        self._origin, self._behind_ns = None, 0

    def delay_ns(self, t_ns: int) -> int:
        """Return the wall time (ns) until ``t_ns`` is due: 0 if it is already due, and at most an hour."""
        return min(_LONGEST_NS, max(0, -self._late_ns(t_ns))) if self._scale else 0

    def start(self, t_ns: int) -> None:
        """Record that the tick at ``t_ns`` starts now."""
        step_ns = t_ns - self.last_ns if self.last_ns is not None else 0
        self.last_ns = t_ns
        if not self._scale:
            return
        self.late_ns = late = max(0, self._late_ns(t_ns))
        if step_ns > 0 and late > max(step_ns / self._scale, _AT_ONCE_NS):
            self.overruns += 1
            self.worst_late_s = max(self.worst_late_s, late / 1e9)
            self._behind_ns = min(_MOST_BEHIND_NS, self._behind_ns + late)
            self._origin = time.monotonic_ns(), t_ns
        elif step_ns > 0 and self._behind_ns and late < _ON_TIME_NS and self._origin:
            sooner_ns = round(min(self._behind_ns, _FASTER * step_ns / self._scale))
            self._behind_ns -= sooner_ns
            self._origin = self._origin[0] - sooner_ns, self._origin[1]

    def _late_ns(self, t_ns: int) -> int:
        now = time.monotonic_ns()
        if self._origin is None:
            self._origin = now, t_ns if self.last_ns is None else min(self.last_ns, t_ns)
        wait_ns = (t_ns - self._origin[1]) / self._scale
        return now - self._origin[0] - round(max(-_FOREVER_NS, min(wait_ns, _FOREVER_NS)))


def _checked(scale: float) -> float:
    if not 0 <= scale <= 1e6:
        raise FieldError('time_scale', scale, 'it must be between 0 and 1e6', 'give 0 to run as fast as possible')
    return scale
