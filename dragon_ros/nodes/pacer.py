"""Pacing by a steady clock: due times follow from simulation time, never from a sum of waits."""
import threading
import time

from dragon_ros.core.errors import FieldError


class Pacer:
    """Waits for the wall time at which each simulation time is due; ``scale`` 0 means do not wait at all.

    A tick that starts later than the one after it was due is an overrun. It is counted, and pacing goes on from
    there at the steady rate: no burst follows.
    """

    def __init__(self, scale: float, stop: threading.Event) -> None:
        """Pace at ``scale`` seconds of simulation for each second."""
        if not 0 <= scale <= 1e6:
            raise FieldError('time_scale', scale, 'it must lie between 0 and 1e6', '0 is as fast as possible')
        self._scale, self._stop = scale, stop
        self._origin: tuple[int, int] | None = None
        self._last_ns = 0
        self.overruns = 0
        self.worst_late_s = 0.0

    def wait(self, t_ns: int) -> bool:
        """Wait until ``t_ns`` is due; return False if told to stop."""
        if self._scale == 0:
            return not self._stop.is_set()
        now = time.monotonic_ns()
        if self._origin is None:
            self._origin, self._last_ns = (now, t_ns), t_ns
        due = self._origin[0] + round((t_ns - self._origin[1]) / self._scale)
        late = now - due
        if late > (t_ns - self._last_ns) / self._scale and t_ns > self._last_ns:
            self.overruns += 1
            self.worst_late_s = max(self.worst_late_s, late / 1e9)
            self._origin = (now, t_ns)
        self._last_ns = t_ns
        return not (self._stop.wait(-late / 1e9) if late < 0 else self._stop.is_set())
