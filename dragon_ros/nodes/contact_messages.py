"""What the monitor says, as messages: contacts, markers, health."""
from collections.abc import Mapping
from math import isnan

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PointStamped, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from dragon_ros.core.contact import witness
from dragon_ros.core.watch import NS, EpisodeEnd, Event, Report, Sight
from dragon_ros.wire.cdr import half_turns, stamp_of
from dragon_ros.wire.cdr_markers import BENCH_HEIGHT_M

_RED = ColorRGBA(r=0.9, g=0.05, b=0.05, a=1.0)
_BLACK = ColorRGBA(r=0.0, g=0.0, b=0.0, a=1.0)
_POINT_M, _TEXT_M, _PROUD = 0.12, 0.35, 1.1


def header_of(frame_id: str, t_ns: int) -> Header:
    """Return a header at a time in ns."""
    out = Header(frame_id=frame_id)
    out.stamp.sec, out.stamp.nanosec = stamp_of(t_ns)
    return out


def collision_of(report: Report) -> DiagnosticArray | None:
    """Return the contacts that began or ended with a tick; None where none did."""
    rows = [end_status_of(end) for end in report.ends] + [status_of(event, report.more) for event in report.begins]
    sight = report.sight
    return DiagnosticArray(header=header_of(sight.frame_id, sight.t_ns), status=rows) if rows else None


def status_of(event: Event, more: int = 0) -> DiagnosticStatus:
    """Return the begin of a contact as a diagnostic status with all its numbers; ``more`` began unreported."""
    before = event.after_ns if event.before_ns is None else event.before_ns
    values = {
        'phase': 'begin', 'inner': str(event.benches[0]), 'outer': str(event.benches[1]),
        't_before_s': f'{before / NS:.9f}', 't_after_s': f'{event.after_ns / NS:.9f}',
        't_contact_s': f'{event.t_contact_s:.9f}', 'x_m': f'{event.point_m[0]:.9f}', 'y_m': f'{event.point_m[1]:.9f}',
        'gap_m': f'{event.gap_m:.12f}',
        'approach_m_s': 'unknown' if isnan(event.approach_m_s) else f'{event.approach_m_s:.9f}',
        'bracket': 'open' if event.before_ns is None else 'closed', **({'more': str(more)} if more else {})}
    return _status(
        DiagnosticStatus.ERROR, 'dragon: collision', f'contact of benches {event.benches[0]} and {event.benches[1]} at '
        f'{event.t_contact_s:.6f} s, at ({event.point_m[0]:.4f}, {event.point_m[1]:.4f}) m'
        + (f'; and {more} more pairs' if more else ''), values)


def end_status_of(end: EpisodeEnd) -> DiagnosticStatus:
    """Return the end of a contact as a diagnostic status: OK, since ERROR is for contact and nothing else."""
    values = {
        'phase': 'end', 'inner': str(end.benches[0]), 'outer': str(end.benches[1]), 't_end_s': f'{end.t_end_s:.9f}',
        'deepest_gap_m': f'{end.deepest_gap_m:.12f}', 't_deepest_s': f'{end.deepest_ns / NS:.9f}',
        'cause': 'parted' if end.parted else 'restart'}
    how = 'end of contact' if end.parted else 'contact left behind by a restart'
    return _status(
        DiagnosticStatus.OK, 'dragon: collision', f'{how}: benches {end.benches[0]} and {end.benches[1]} at '
        f'{end.t_end_s:.6f} s, deepest {end.deepest_gap_m:.6f} m at {end.deepest_ns / NS:.6f} s', values)


def point_of(event: Event) -> PointStamped:
    """Return where a contact began."""
    return PointStamped(header=header_of(event.frame_id, event.after_ns), point=_point(*event.point_m))


def markers_of(report: Report) -> MarkerArray:
    """Return the deepest contacts of a tick as markers that replace all earlier ones; DELETEALL alone without any."""
    sight = report.sight
    header = header_of(sight.frame_id, sight.t_ns)
    out = [Marker(header=header, action=Marker.DELETEALL)]
    if report.touching:
        i, j = report.touching[0]
        seen = witness(sight.benches, i, j)
        (x, y), text = seen.point_m, f'{i} x {j}: {seen.gap_m * 1e3:.2f} mm'
        more = f' (+{report.count - 1})' if report.count > 1 else ''
        out += [_bench(sight, header, bench) for bench in sorted({n for pair in report.touching for n in pair})]
        out.append(Marker(header=header, ns='point', type=Marker.SPHERE, pose=_pose(x, y), color=_BLACK,
                          scale=Vector3(x=_POINT_M, y=_POINT_M, z=_POINT_M)))
        out.append(Marker(header=header, ns='label', type=Marker.TEXT_VIEW_FACING, color=_BLACK, text=text + more,
                          pose=_pose(x, y, 2 * _TEXT_M), scale=Vector3(z=_TEXT_M)))
    return MarkerArray(markers=out)


def clearance_of(report: Report) -> Marker:
    """Return the clearance as text above the place between the closest benches; DELETE where none are near."""
    out = Marker(header=header_of(report.sight.frame_id, report.sight.t_ns), ns='clearance', action=Marker.DELETE)
    if report.closest:
        x, y = witness(report.sight.benches, *report.closest).point_m
        out.action, out.type, out.color, out.scale = Marker.ADD, Marker.TEXT_VIEW_FACING, _BLACK, Vector3(z=_TEXT_M)
        out.pose, out.text = _pose(x, y, -_TEXT_M), f'{report.clearance_m * 1e3:.2f} mm'
        out.pose.position.y -= 2 * _TEXT_M
    return out


def level_of(report: Report | None, warn_below_m: float) -> bytes:
    """Return ERROR for contact, WARN for a clearance below ``warn_below_m``, else OK."""
    if report is None or (not report.count and report.clearance_m >= warn_below_m):
        return DiagnosticStatus.OK
    return DiagnosticStatus.ERROR if report.count else DiagnosticStatus.WARN


def health_of(name: str, report: Report | None, warn_below_m: float, dropped: int) -> DiagnosticStatus:
    """Return OK, WARN or ERROR for the last tick that was seen, with its numbers."""
    level = level_of(report, warn_below_m)
    if report is None:
        return _status(level, name, 'waits for handles and benches', {'dropped': str(dropped)})
    pair = ' and '.join(map(str, report.closest or ()))
    message = {DiagnosticStatus.OK: f'clearance {report.clearance_m:.6f} m',
               DiagnosticStatus.WARN: f'benches {pair} are {report.clearance_m:.6f} m apart',
               DiagnosticStatus.ERROR: f'{report.count} pairs in contact, the deepest is {pair}'}[level]
    return _status(level, name, message, {
        't_s': f'{report.sight.t_ns / NS:.9f}', 'clearance_m': f'{report.clearance_m:.12f}', 'closest': pair,
        'warn_below_m': f'{warn_below_m:g}', 'in_contact': str(report.count), 'dropped': str(dropped)})


def _status(level: bytes, name: str, message: str, values: Mapping[str, str]) -> DiagnosticStatus:
    return DiagnosticStatus(level=level, name=name, hardware_id='dragon', message=message,
                            values=[KeyValue(key=key, value=value) for key, value in values.items()])


def _bench(sight: Sight, header: Header, bench: int) -> Marker:
    """Return one bench in red, a little higher than it is so that it covers the blue one."""
    b = sight.benches
    pose = _pose(*b.centre[bench].tolist(), 0.0)
    z, w = half_turns(b.axis[bench:bench + 1])[0].tolist()
    pose.orientation = Quaternion(z=z, w=w)
    scale = Vector3(x=2 * float(b.half_length[bench]), y=2 * float(b.half_width[bench]), z=_PROUD * BENCH_HEIGHT_M)
    return Marker(header=header, ns='bench in contact', id=bench, type=Marker.CUBE, pose=pose, scale=scale, color=_RED)


def _pose(x_m: float, y_m: float, z_m: float = BENCH_HEIGHT_M) -> Pose:
    return Pose(position=_point(x_m, y_m, z_m), orientation=Quaternion(w=1.0))


def _point(x_m: float, y_m: float, z_m: float = 0.0) -> Point:
    return Point(x=x_m, y=y_m, z=z_m)
