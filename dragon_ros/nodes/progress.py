"""Log the progress and the end of a playback."""
import time
from typing import Any

from dragon_ros.core.words import counted
from dragon_ros.nodes import logs
from dragon_ros.nodes.pacer import Pacer
from dragon_ros.nodes.play_source import PlaySource

_PERIOD_S = 1.0     # interval between messages


class ProgressLog:
    """Logs the position of a source every second if anyone reads the log, and its end."""

    def __init__(self, logger: Any, source: PlaySource, pacer: Pacer) -> None:
        """Start at the current position."""
        self._logger, self._source, self._pacer = logger, source, pacer
        self.note_place()

    def note_place(self) -> None:
        """Measure the speed, and the time until the next message, from here."""
        self._logged_s, self._logged_ns = time.monotonic(), self._pacer.last_ns

    def log(self) -> None:
        """Log the position if a second has passed."""
        if time.monotonic() - self._logged_s >= _PERIOD_S and logs.progress_wanted():
            pacer, left_s = self._pacer, self._left_s()
            left = '' if left_s is None else f', {left_s:.0f} s left'
            self._logger.info(f'{self._source.place()}{left}, {counted(pacer.overruns, "overrun")}', {
                't_s': self._source.seconds(pacer.last_ns or 0), 'left_s': left_s, 'overruns': pacer.overruns,
                'time_scale': pacer.scale})
            self.note_place()

    def log_end(self, then: str) -> None:
        """Log why no frame follows, what happens ``then``, and the overruns."""
        pacer, ending = self._pacer, self._source.ending()
        if pacer.overruns:
            self._logger.warning(f'{ending}{then}; {counted(pacer.overruns, "overrun")}, the worst '
                                 f'{pacer.worst_late_s:.3f} s late')
        else:
            self._logger.info(f'{ending}{then}')

    def _left_s(self) -> float | None:
        """Return the wall time (s) until the end at the recent speed, or None if time has not advanced."""
        t_ns = self._pacer.last_ns
        if t_ns is None or self._logged_ns is None or t_ns <= self._logged_ns:
            return None
        wall_s = time.monotonic() - self._logged_s
        return round(wall_s * (self._source.last_ns() - t_ns) / (t_ns - self._logged_ns), 3)
