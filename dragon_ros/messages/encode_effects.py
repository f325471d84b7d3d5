"""The topics of the effects that few scenes switch on."""
from collections.abc import Callable

import numpy as np

from dragon_ros.core.frame import Frame
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.messages import effects
from dragon_ros.messages.cdr import PoseArrayTemplate, VelocitiesTemplate, float64_of

Encode = Callable[[Frame], bytes]


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
        return effects.table('pair', 'inner_outer_gap_x_y', values)
    return encode


def _contact_markers(scene: Scene, frame_id: str) -> Encode:
    lengths, width_m = scene.dragon.bench_lengths_m, scene.dragon.width_m

    def encode(frame: Frame) -> bytes:
        assert frame.contacts is not None
        assert frame.benches is not None
        which = np.unique(frame.contacts.benches)
        size = np.stack((lengths[which], np.full(which.size, width_m)), axis=1)
        return effects.contact_markers(frame.t_ns, frame.benches.centre[which], frame.axis[which], size,
                                       frame.contacts.point_m, frame_id)
    return encode


def _accelerations(scene: Scene, _: str) -> Encode:
    template = VelocitiesTemplate(scene.dragon.benches + 1, 'ax_ay_size')

    def encode(frame: Frame) -> bytes:
        assert frame.acceleration_m_s2 is not None
        return template.encode(frame.acceleration_m_s2)
    return encode


def _forces(_: Scene, __: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        assert frame.tension_n_kg is not None
        return effects.table('link', 'tension', frame.tension_n_kg[:, None])
    return encode


def _measured(scene: Scene, frame_id: str) -> Encode:
    template = PoseArrayTemplate(scene.dragon.benches + 1, frame_id)

    def encode(frame: Frame) -> bytes:
        assert frame.measured is not None
        return template.encode(frame.t_ns, frame.measured.p, frame.measured.axis)
    return encode


def _trail(_: Scene, frame_id: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        assert frame.trail_m is not None
        return effects.trail_marker(frame.t_ns, frame.trail_m, frame_id)
    return encode


def _diagnostics(_: Scene, frame_id: str) -> Encode:
    def encode(frame: Frame) -> bytes:
        health = frame.health
        assert health is not None
        level, message = (effects.OK, 'all links keep their lengths') if health.good else (
            effects.ERROR, f'link {health.link} is off by {health.off_m:.3g} m')
        values = {'solver': health.solver, 'evaluations': health.evaluations, 'worst_link': health.link,
                  'off_m': health.off_m, 'allowed_m': health.allowed_m}
        return effects.diagnostics(frame.t_ns, frame_id, level, 'dragon: model', message, values)
    return encode


BUILDERS: dict[str, Callable[[Scene, str], Encode]] = {
    'model/clearance': _clearance, 'model/contacts': _contacts, 'model/markers': _contact_markers,
    'accelerations': _accelerations, 'forces': _forces, 'measured': _measured, 'trail': _trail,
    'model/diagnostics': _diagnostics}
