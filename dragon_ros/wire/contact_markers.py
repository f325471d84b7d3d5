"""Contacts and clearance of a tick as the bytes of markers: while there is contact they come with every tick."""
from dragon_ros.core.contact.signed_distance import witness
from dragon_ros.core.contact.tracker import Report, Sight
from dragon_ros.wire.cdr import Writer, half_turns
from dragon_ros.wire.cdr_markers import BENCH_HEIGHT_M, CUBE, Colour, Look, put_marker

_SPHERE, _TEXT_VIEW_FACING, _DELETE, _DELETEALL = 2, 9, 2, 3
_RED: Colour = (0.84, 0.37, 0.0, 1.0)      # vermilion: the red that colour-blind people see (Okabe-Ito)
_BLACK: Colour = (0.0, 0.0, 0.0, 1.0)
_POINT_M, _TEXT_M, _PROUD = 0.12, 0.35, 1.1


def contact_markers(report: Report) -> bytes:
    """Return the deepest contacts of a tick as markers that replace all earlier ones; DELETEALL alone without any."""
    looks = [Look('', 0, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), action=_DELETEALL)]
    if report.touching:
        looks += [_bench(report.sight, bench) for bench in sorted({n for pair in report.touching for n in pair})]
        looks += _point_and_label(report)
    writer = Writer()
    writer.put('I', len(looks))
    for look in looks:
        put_marker(writer, look, report.sight.frame_id, report.sight.t_ns)
    return bytes(writer.finish())


def clearance_marker(report: Report) -> bytes:
    """Return the clearance as text above the place between the closest benches; DELETE where none are near."""
    look = Look('clearance', 0, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), action=_DELETE)
    if report.closest:
        x, y = witness(report.sight.benches, *report.closest).point_m
        look = Look('clearance', 0, _TEXT_VIEW_FACING, (0.0, 0.0, _TEXT_M), _BLACK,
                    place=(x, y - 2 * _TEXT_M, -_TEXT_M), text=f'{report.clearance_m * 1e3:.2f} mm')
    writer = Writer()
    put_marker(writer, look, report.sight.frame_id, report.sight.t_ns)
    return bytes(writer.finish())


def _point_and_label(report: Report) -> list[Look]:
    i, j = report.touching[0]
    seen = witness(report.sight.benches, i, j)
    (x, y), more = seen.point_m, f' (+{report.count - 1})' if report.count > 1 else ''
    return [Look('point', 0, _SPHERE, (_POINT_M, _POINT_M, _POINT_M), _BLACK, place=(x, y, BENCH_HEIGHT_M)),
            Look('label', 0, _TEXT_VIEW_FACING, (0.0, 0.0, _TEXT_M), _BLACK, place=(x, y, 2 * _TEXT_M),
                 text=f'{i} x {j}: {seen.gap_m * 1e3:.2f} mm{more}')]


def _bench(sight: Sight, bench: int) -> Look:
    """Return one bench in red, a little higher than it is so that it covers the blue one."""
    b = sight.benches
    (x, y), (z, w) = b.centre[bench].tolist(), half_turns(b.axis[bench:bench + 1])[0].tolist()
    scale = 2 * float(b.half_length[bench]), 2 * float(b.half_width[bench]), _PROUD * BENCH_HEIGHT_M
    return Look('bench in contact', bench, CUBE, scale, _RED, place=(x, y, 0.0), turn=(z, w))
