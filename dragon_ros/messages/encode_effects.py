"""Encodes the topics of rarely used effects; this module is imported only if a scene enables one of these effects."""
from collections.abc import Callable, Mapping

import numpy as np

from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import Frame
from dragon_ros.messages.cdr import (
    CloudTemplate,
    JointsTemplate,
    PoseArrayTemplate,
    VelocitiesTemplate,
    Writer,
    float64_of,
    half_turns,
    stamp_of,
)
from dragon_ros.messages.fixed_size import HANDLES, VELOCITIES, Encode, FixedSize
from dragon_ros.messages.markers import SPHERE, YELLOW, MarkerSpec, contact_markers, red_benches, trail_marker
from dragon_ros.messages.urdf import joint_names

_OK, _ERROR = 0, 2          # levels of a diagnostic status
_POINT_M = 0.12
_COVARIANCE = 36


def _clearance(_: Scene, __: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        assert frame.closeness is not None
        return float64_of(frame.closeness.clearance_m)
    return encode


def _contacts(_: Scene, __: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        found = frame.contacts
        assert found is not None
        values: Floats = np.concatenate((found.benches, found.gap_m[:, None], found.point_m), axis=1)
        return _table('pair', 'inner_outer_gap_x_y', values)
    return encode


def _contact_markers(scene: Scene, frame_id: str) -> Encode:
    lengths, width_m = scene.dragon.bench_lengths_m, scene.dragon.width_m

    def encode(frame: Frame) -> bytes:
        assert frame.contacts is not None
        assert frame.benches is not None
        which = np.unique(frame.contacts.benches)
        which = which[which < lengths.size]     # obstacles are numbered after the benches
        size = np.stack((lengths[which], np.full(which.size, width_m)), axis=1)
        benches = red_benches('contact bench', range(which.size), frame.benches.centre[which], frame.axis[which], size)
        points = [MarkerSpec('contact point', n, SPHERE, (_POINT_M,) * 3, YELLOW, place=(x, y, 0.0))
                  for n, (x, y) in enumerate(frame.contacts.point_m.tolist())]
        return contact_markers(frame.t_ns, frame_id, benches, points)
    return encode


def _accelerations(scene: Scene, _: str) -> Encode:
    return FixedSize(VelocitiesTemplate(scene.dragon.benches + 1, 'ax_ay_size'), 'acceleration_m_s2')


def _forces(_: Scene, __: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        assert frame.tension_n_kg is not None
        return _table('link', 'tension', frame.tension_n_kg[:, None])
    return encode


def _measured(scene: Scene, frame_id: str) -> Encode:
    return FixedSize(PoseArrayTemplate(scene.dragon.benches + 1, frame_id), 'measured.p', 'measured.axis')


def _trail(_: Scene, frame_id: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        assert frame.trail_m is not None
        return trail_marker(frame.t_ns, frame.trail_m, frame_id)
    return encode


def _diagnostics(_: Scene, frame_id: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        health = frame.health
        assert health is not None
        level, message = (_OK, 'all links keep their lengths') if health.good else (
            _ERROR, f'the length of link {health.link} is off by {health.off_m:.3g} m')
        values = {'solver': health.solver, 'evaluations': health.evaluations, 'worst_link': health.link,
                  'off_m': health.off_m, 'allowed_m': health.allowed_m}
        return _status_of(frame.t_ns, frame_id, level, 'dragon: model', message, values)
    return encode


def _leader(_: Scene, frame_id: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        leader = frame.leader
        assert leader is not None
        writer, turn = Writer(), half_turns(leader.direction[None])[0].tolist()
        writer.header(frame_id, frame.t_ns)
        writer.text(f'{frame_id}/leader')
        writer.put('d', *leader.p.tolist(), 0.0, 0.0, 0.0, *turn)
        writer.room('d', _COVARIANCE)
        writer.put('d', leader.speed_m_s, 0.0, 0.0, 0.0, 0.0, leader.turn_rad_s)
        writer.room('d', _COVARIANCE)
        return bytes(writer.finish())
    return encode


def _cloud(scene: Scene, frame_id: str) -> Encode:
    return FixedSize(CloudTemplate(scene.dragon.benches + 1, frame_id), HANDLES, VELOCITIES)


def _joints(scene: Scene, frame_id: str) -> Encode:
    return FixedSize(JointsTemplate(joint_names(scene.dragon.benches), frame_id), 'joint_rad')


BUILDERS: dict[str, Callable[[Scene, str], Encode]] = {
    'model/clearance': _clearance, 'model/contacts': _contacts, 'model/markers': _contact_markers,
    'accelerations': _accelerations, 'forces': _forces, 'measured': _measured, 'trail': _trail,
    'model/diagnostics': _diagnostics, 'leader': _leader, 'cloud': _cloud,
    'joint_states': _joints}


def _table(rows: str, columns: str, values: Floats) -> bytes:
    """Return values (shape (rows, columns)) as a std_msgs/Float64MultiArray whose dimensions have these labels."""
    writer = Writer()
    writer.put('I', 2)
    count, width = values.shape
    for label, size, stride in ((rows, count, count * width), (columns, width, width)):
        writer.text(label)
        writer.put('I', size, stride)
    writer.put('I', 0, count * width)
    writer.put('d', *values.ravel().tolist())
    return bytes(writer.finish())


def _status_of(t_ns: int, frame_id: str, level: int, name: str, message: str, values: Mapping[str, object]) -> bytes:
    """Return a DiagnosticArray with one status."""
    writer = Writer()
    writer.put('I', *stamp_of(t_ns))
    writer.text(frame_id)
    writer.put('I', 1)
    writer.put('B', level)
    for text in (name, message, ''):
        writer.text(text)
    writer.put('I', len(values))
    for key, value in values.items():
        writer.text(key)
        writer.text(str(value))
    return bytes(writer.finish())
