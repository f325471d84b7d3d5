"""Counts the first reports of a monitor that a recorder did not receive.

A monitor numbers its messages only while they have a subscriber, so their sequence numbers do not show how many were
never sent to the recorder. However, the monitor's health states how many ticks it has reported on.
"""
from collections import OrderedDict

from dragon_ros.messages.decode import Health

_MOST_TICKS = 100_000       # maximum number of ticks that are kept until a report arrives
_MOST_REPORTS = 10_000      # maximum number of reports that are kept until the health arrives that refers to them


class FirstReport:
    """Compares the number of reports that a monitor has made with the number of reports received."""

    def __init__(self) -> None:
        """Start without a monitor and without ticks."""
        self._ticks: list[int] = []     # the ticks received before the first report
        self._received = 0
        self._numbers: OrderedDict[int, int] = OrderedDict()    # how many reports had been received, by tick
        self._last: Health | None = None
        self._unreceived: int | None = None     # the number of reports before the first one received, if known

    def examinable(self, t_ns: int) -> None:
        """Note a tick that a monitor can examine, because the recorder has received its benches."""
        if not self._received and len(self._ticks) < _MOST_TICKS:
            self._ticks.append(t_ns)

    def begins(self, t_ns: int) -> None:
        """Note that a report has been received."""
        if not self._received:
            self._ticks = [tick for tick in self._ticks if tick < t_ns]
        self._received += 1
        if self._unreceived is None:
            self._numbers[t_ns] = self._received
            if len(self._numbers) > _MOST_REPORTS:
                self._numbers.popitem(last=False)
            self._compare()

    def health(self, health: Health) -> None:
        """Note the health of a monitor, which may arrive before or after the report on the tick it refers to."""
        self._last = health
        self._compare()

    def _compare(self) -> None:
        """Determine the number of reports before the first one received, which does not change afterwards."""
        last = self._last
        number = None if last is None or last.t_ns is None else self._numbers.get(last.t_ns)
        if last and number and self._unreceived is None:
            self._unreceived = max(0, last.reports - number)
            self._numbers.clear()

    @property
    def missing(self) -> int:
        """The number of reports on received ticks that a monitor made before the first one received."""
        if self._received:
            return min(len(self._ticks), self._unreceived or 0)
        if self._last is None or self._last.t_ns is None:
            return 0
        return min(sum(tick <= self._last.t_ns for tick in self._ticks), self._last.reports)
