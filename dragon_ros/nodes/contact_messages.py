"""The messages of the monitor: contacts and health."""
from collections.abc import Mapping
from math import inf, isnan

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PointStamped
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from dragon_ros.core.geometry.contacts import pair_words
from dragon_ros.core.geometry.tracker import NS, PARTED, RESTART, EpisodeEnd, Event, Report
from dragon_ros.core.words import counted
from dragon_ros.messages.cdr import stamp_of

_LABEL_S = 0.1      # minimum interval between messages on clearance/marker
_AGAIN_S = 1.0      # interval between reports of unseen ticks
_OVER_S = 3.0       # how long a WARN lasts after the last unseen tick
# A column of a contact: its name and its numpy type. RViz requires x, y and z as float32.
CONTACT_FIELDS = (('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('inner', '<u4'), ('outer', '<u4'), ('depth', '<f8'),
                  ('t_contact', '<f8'))
CONTACT = np.dtype(list(CONTACT_FIELDS))
_DATATYPES = {'<u4': PointField.UINT32, '<f4': PointField.FLOAT32, '<f8': PointField.FLOAT64}
_HOW = {PARTED: 'end of contact', RESTART: 'contact ended by a restart'}


def header_of(frame_id: str, t_ns: int) -> Header:
    """Return a header with this frame and this time (ns)."""
    out = Header(frame_id=frame_id)
    out.stamp.sec, out.stamp.nanosec = stamp_of(t_ns)
    return out


def collision_of(report: Report) -> DiagnosticArray | None:
    """Return the contacts that began or ended at a tick, or None if there are none."""
    rows = [end_status_of(end) for end in report.ends] + [status_of(event, report.more) for event in report.begins]
    observation = report.observation
    return DiagnosticArray(header=header_of(observation.frame_id, observation.t_ns), status=rows) if rows else None


def status_of(event: Event, more: int = 0) -> DiagnosticStatus:
    """Return a diagnostic status with all data on the start of a contact; ``more`` is the number of further pairs.

    Obstacles are numbered in the venue's order, after the last bench; the key ``obstacle`` holds the obstacle's name.
    """
    before = event.after_ns if event.before_ns is None else event.before_ns
    values = {
        'phase': 'begin', **_pair(event),
        't_before_s': f'{before / NS:.9f}', 't_after_s': f'{event.after_ns / NS:.9f}',
        't_contact_s': f'{event.t_contact_s:.9f}', 'x_m': f'{event.point_m[0]:.9f}', 'y_m': f'{event.point_m[1]:.9f}',
        'gap_m': f'{event.gap_m:.12f}',
        'approach_m_s': 'unknown' if isnan(event.approach_m_s) else f'{event.approach_m_s:.9f}',
        'bracket': 'open' if event.before_ns is None else 'closed', **({'more': str(more)} if more else {})}
    return _status(
        DiagnosticStatus.ERROR, 'dragon: collision', f'contact of {pair_words(event.benches, event.obstacle)} at '
        f'{event.t_contact_s:.6f} s, at ({event.point_m[0]:.4f}, {event.point_m[1]:.4f}) m'
        + (f', and {counted(more, "more pair")}' if more else ''), values)


def end_status_of(end: EpisodeEnd) -> DiagnosticStatus:
    """Return a diagnostic status for the end of a contact, with level OK, since ERROR is reserved for contact."""
    values = {
        'phase': 'end', **_pair(end), 't_end_s': f'{end.t_end_s:.9f}',
        'deepest_gap_m': f'{end.deepest_gap_m:.12f}', 't_deepest_s': f'{end.deepest_ns / NS:.9f}',
        'cause': end.cause}
    how = _HOW.get(end.cause, 'contact ended by a change of the venue')
    return _status(
        DiagnosticStatus.OK, 'dragon: collision', f'{how}: {pair_words(end.benches, end.obstacle)} at '
        f'{end.t_end_s:.6f} s, deepest {end.deepest_gap_m:.6f} m at {end.deepest_ns / NS:.6f} s', values)


def _pair(of: Event | EpisodeEnd) -> dict[str, str]:
    named = {'obstacle': of.obstacle} if of.obstacle else {}
    return {'inner': str(of.benches[0]), 'outer': str(of.benches[1]), **named}


def cloud_of(report: Report) -> PointCloud2 | None:
    """Return the contacts that began at a tick for programs, as named columns of numbers, or None if there are none."""
    if not report.begins:
        return None
    observation = report.observation
    rows = np.array([(*event.point_m, 0.0, *event.benches, -event.gap_m, event.t_contact_s)
                     for event in report.begins], dtype=CONTACT)
    offsets = np.cumsum([0, *(np.dtype(kind).itemsize for _, kind in CONTACT_FIELDS)]).tolist()
    fields = [PointField(name=name, offset=offset, datatype=_DATATYPES[kind], count=1)
              for (name, kind), offset in zip(CONTACT_FIELDS, offsets[:-1], strict=True)]
    return PointCloud2(header=header_of(observation.frame_id, observation.t_ns), height=1, width=len(rows),
                       fields=fields, point_step=CONTACT.itemsize, row_step=CONTACT.itemsize * len(rows),
                       data=rows.tobytes(), is_dense=True)


def point_of(event: Event) -> PointStamped:
    """Return the point at which a contact began."""
    x_m, y_m = event.point_m
    return PointStamped(header=header_of(event.frame_id, event.after_ns), point=Point(x=x_m, y=y_m))


def level_of(report: Report | None, warn_below_m: float) -> bytes:
    """Return ERROR for a contact, WARN for a clearance below ``warn_below_m``, and otherwise OK."""
    if report is None or (not report.count and report.clearance_m >= warn_below_m):
        return bytes(DiagnosticStatus.OK)
    return bytes(DiagnosticStatus.ERROR if report.count else DiagnosticStatus.WARN)


def health_of(dragon: str, report: Report | None, warn_below_m: float, dropped: int, waiting: int = 0,
              leaves: bool = False, reports: int = 0) -> DiagnosticStatus:
    """Return a status (OK, WARN or ERROR) with the data of the last observed tick; ``dragon`` is the namespace.

    ``waiting`` is the number of unread messages, and ``reports`` the number of ticks reported on so far; ``leaves``
    marks the monitor's last message before it exits.
    """
    state = {'reports': str(reports), 'dropped': str(dropped), 'waiting': str(waiting),
             **({'leaves': 'true'} if leaves else {})}
    name = f'{dragon}: clearance'
    level = level_of(report, warn_below_m)
    if report is None:
        return _status(level, name, 'waiting for handles and benches', state, dragon)
    obstacle = report.obstacle(report.closest) if report.closest else ''
    pair = ' and '.join((str(report.closest[0]), repr(obstacle) if obstacle else str(report.closest[1]))
                        ) if report.closest else ''
    apart = pair_words(report.closest, obstacle) if report.closest else ''
    touching = counted(report.count, 'pair', 'is')
    message = {DiagnosticStatus.OK: f'clearance {report.clearance_m:.6f} m',
               DiagnosticStatus.WARN: f'{apart} are {report.clearance_m:.6f} m apart',
               DiagnosticStatus.ERROR: f'{touching} in contact; the deepest is {pair}'}[level]
    return _status(level, name, message, {
        't_s': '{}.{:09d}'.format(*stamp_of(report.observation.t_ns)), 'clearance_m': f'{report.clearance_m:.12f}',
        'closest': pair, 'warn_below_m': f'{warn_below_m:g}', 'in_contact': str(report.count),
        **state}, dragon)


class Changes:
    """Holds the last report, and decides whether there is anything new for topics that publish only changes."""

    def __init__(self) -> None:
        """Start without a report."""
        self.last: Report | None = None
        self._level, self._labelled_s = b'', -inf

    def contact(self, report: Report) -> bool:
        """Record the report of the next tick; return whether contact has begun or ended."""
        before, self.last = self.last, report
        return bool(before and before.count) != bool(report.count)

    def level(self, level: bytes) -> bool:
        """Record the current level; return whether it has changed."""
        before, self._level = self._level, level
        return level != before

    def label(self, now_s: float, at_once: bool) -> bool:
        """Return whether to label the clearance now: always if ``at_once``, otherwise at most every 0.1 s."""
        due = at_once or now_s - self._labelled_s >= _LABEL_S
        self._labelled_s = now_s if due else self._labelled_s
        return due


class Pace:
    """Counts the ticks that a monitor does not see, and measures the longest gap, which may hide shorter contacts."""

    def __init__(self) -> None:
        """Start without any unseen tick."""
        self.skipped = 0        # number of ticks skipped because ticks arrive faster than they can be read
        self._unseen, self._step_ns = 0, 0
        self._since_s = self._told_s = -inf         # times of the last event to report and of the last report
        self._last: tuple[int, int] | None = None       # stamp and sequence number of the last tick that was seen
        self.before = 0         # number of ticks published before the first seen tick

    def see(self, t_ns: int, number: int, now_s: float) -> bool:
        """Record a seen tick and the sequence number of its handles; return whether to report now."""
        last, self._last = self._last, (t_ns, number)
        if last is None:
            self.before = max(0, number - 1)
        if last is None or number <= last[1] + 1:
            return False
        self._unseen += number - last[1] - 1
        self._step_ns = max(self._step_ns, t_ns - last[0])
        return self._news(now_s)

    def skip(self, skipped: int, now_s: float) -> bool:
        """Record how many ticks have been skipped so far; return whether to report now."""
        self.skipped = skipped
        return self._news(now_s)

    def _news(self, now_s: float) -> bool:
        self._since_s, due = now_s, now_s - self._told_s > _AGAIN_S
        self._told_s = now_s if due else self._told_s
        return due

    def text(self) -> str:
        """Return one line about the unseen ticks, or '' if there are none."""
        if not (self._unseen or self.skipped):
            return ''
        missed = f'; contacts shorter than {self._step_ns / NS:.9f} s may be missed' if self._step_ns else ''
        return (f'{counted(max(self._unseen, self.skipped), "unseen tick")}, {self.skipped} skipped because ticks '
                f'arrive faster than they can be read{missed}')

    def warnings(self, dragon: str, now_s: float) -> list[DiagnosticStatus]:
        """Return a WARN while ticks are missed, and for a few seconds afterwards."""
        if now_s - self._since_s > _OVER_S:
            return []
        return [_status(DiagnosticStatus.WARN, f'{dragon}: monitor: pace', self.text(), {
            'unseen': str(self._unseen), 'skipped': str(self.skipped),
            'longest_step_s': f'{self._step_ns / NS:.9f}'}, dragon)]


def _status(level: bytes, name: str, message: str, values: Mapping[str, str],
            hardware_id: str = 'dragon') -> DiagnosticStatus:
    return DiagnosticStatus(level=level, name=name, hardware_id=hardware_id, message=message,
                            values=[KeyValue(key=key, value=value) for key, value in values.items()])
