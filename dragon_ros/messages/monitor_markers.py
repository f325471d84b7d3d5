"""The monitor's markers for a tick, as bytes: the deepest contacts, and the clearance as a label and as a vector."""
import struct
from functools import lru_cache

import numpy as np

from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.signed_distance import shortest_vector, witness
from dragon_ros.core.geometry.tracker import Report
from dragon_ros.messages.cdr import Room, Writer, put_stamps, stamp_number
from dragon_ros.messages.markers import (
    BENCH_HEIGHT_M,
    BLACK,
    SPHERE,
    TEXT_VIEW_FACING,
    MarkerSpec,
    contact_markers,
    deleted,
    red_benches,
    single_marker,
)

_POINT_M, _TEXT_M = 0.12, 0.35


def report_markers(report: Report) -> bytes:
    """Return a DELETEALL that removes earlier markers, and then the markers of the tick's deepest contacts, if any."""
    observation = report.observation
    if not report.touching:
        return contact_markers(observation.t_ns, observation.frame_id, [], [])
    all_benches = observation.benches
    count = len(all_benches.centre)         # obstacles are numbered from this value on
    ids = sorted({bench for pair in report.touching for bench in pair if bench < count})
    size = 2 * np.stack((all_benches.half_length[ids], all_benches.half_width[ids]), axis=1)
    benches = red_benches('bench in contact', ids, all_benches.centre[ids], all_benches.axis[ids], size)
    return contact_markers(observation.t_ns, observation.frame_id, benches, _point_and_label(report))


def clearance_marker(report: Report) -> bytes:
    """Return the clearance as a text marker.

    If there is no closest pair, or during a contact (which has a label of its own), the marker deletes the old text.
    """
    spec = deleted('clearance')
    if report.closest and not report.touching:
        point_m = witness(*report.two(report.closest)).point_m
        obstacle = report.obstacle(report.closest)
        to = f' to {obstacle}' if obstacle else ''
        spec = _text('clearance', point_m, f'{report.clearance_m * 1e3:.2f} mm{to}')
    return single_marker(report.observation.t_ns, report.observation.frame_id, spec)


def stamped_clearance(report: Report) -> bytes:
    """Return the clearance of a tick, with its stamp, in field x of a geometry_msgs/Vector3Stamped."""
    return _stamped_vector(report.observation, report.clearance_m, 0.0)


def vector_of(report: Report) -> bytes:
    """Return the shortest vector between the closest pair as a geometry_msgs/Vector3Stamped; the pair must exist."""
    assert report.closest
    return _stamped_vector(report.observation, *shortest_vector(*report.two(report.closest)))


@lru_cache(maxsize=16)
def _vector_layout(frame_id: str) -> tuple[bytes, int, int]:
    """Return a geometry_msgs/Vector3Stamped with this frame, and the offsets of its stamp and of its vector."""
    writer = Writer()
    stamp, vector = writer.header(frame_id), writer.put('d', 0.0, 0.0, 0.0)
    return bytes(writer.finish()), stamp, vector


def _stamped_vector(observation: Observation, x: float, y: float) -> bytes:
    layout, stamp, vector = _vector_layout(observation.frame_id)
    data = bytearray(layout)
    put_stamps(Room(memoryview(data)), stamp, stamp_number(observation.t_ns))
    struct.pack_into('<dd', data, vector, x, y)
    return bytes(data)


def _point_and_label(report: Report) -> list[MarkerSpec]:
    pair = report.touching[0]
    seen, other = witness(*report.two(pair)), report.obstacle(pair) or str(pair[1])
    (x, y), more = seen.point_m, f' (+{report.count - 1})' if report.count > 1 else ''
    return [MarkerSpec('point', 0, SPHERE, (_POINT_M, _POINT_M, _POINT_M), BLACK, place=(x, y, BENCH_HEIGHT_M)),
            _text('label', seen.point_m, f'{pair[0]} x {other}: {seen.gap_m * 1e3:.2f} mm{more}')]


def _text(namespace: str, point_m: tuple[float, float], text: str) -> MarkerSpec:
    """Return a text marker beside a point and above the benches, so that it neither is hidden nor hides a contact."""
    x, y = point_m
    return MarkerSpec(namespace, 0, TEXT_VIEW_FACING, (0.0, 0.0, _TEXT_M), BLACK,
                      place=(x, y - 2 * _TEXT_M, 2 * _TEXT_M), text=text)
