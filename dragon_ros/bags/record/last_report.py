"""Decides whether a monitor has reported on the last tick, so that a recorder does not exit before that report.

A monitor begins its report on a tick with a stamped clearance. Every second, and when it exits, the monitor publishes
its health: the last tick that it has reported on, and the number of messages that it has yet to read.
"""
from dragon_ros.messages.decode import Health

_IDLE = 2       # number of idle health messages after which no reports are expected; the first may be outdated


class LastReport:
    """Compares a monitor's reports with the ticks that it can examine."""

    def __init__(self) -> None:
        """Start without a monitor and without ticks."""
        self.heard = False      # whether a monitor has published its health
        self._due_ns: int | None = None         # the last tick on which a report is expected
        self._begun_ns: int | None = None       # the last tick on which a report has begun
        self._done_ns: int | None = None        # the last tick with a complete report
        self._fixed = self._has_passed = self._has_left = False
        self._idle = 0

    def examinable(self, t_ns: int) -> None:
        """Note a tick that a monitor can examine, because the recorder has received its benches."""
        if not self._fixed:
            self._due_ns, self._idle = t_ns, 0

    def fix(self) -> None:
        """Expect no reports on ticks that arrive from now on."""
        self._fixed = True
        self._note_passed()

    def begins(self, t_ns: int) -> None:
        """Note that a report begins; the previous one is then complete."""
        self._done_ns, self._begun_ns, self._idle = self._begun_ns, t_ns, 0
        self._note_passed()

    def health(self, health: Health) -> None:
        """Note the health of a monitor."""
        self.heard, self._has_left = True, health.leaves
        self._idle = 0 if health.waiting or health.leaves else self._idle + 1
        if health.t_ns is not None:
            self._done_ns = self._begun_ns = health.t_ns
            self._note_passed()

    @property
    def is_said(self) -> bool:
        """Whether no further reports are expected from a monitor, if there is one."""
        return self.heard and (self._has_left or self._due_ns is None or self._idle >= _IDLE or self._has_passed
                               or self._is_done())

    @property
    def is_missing(self) -> bool:
        """Whether a monitor has published its health, but its reports on the last ticks have not arrived."""
        return self.heard and not self.is_said

    def _note_passed(self) -> None:
        """Remember that the fixed tick has been reported on: if the run loops, later reports are on earlier ticks."""
        self._has_passed = self._has_passed or (self._fixed and self._is_done())

    def _is_done(self) -> bool:
        """Return whether the report on the last tick is complete.

        A later report counts only for a fixed tick, because time may have jumped backwards.
        """
        if self._done_ns is None or self._due_ns is None:
            return False
        return self._done_ns == self._due_ns or (self._fixed and self._done_ns > self._due_ns)
