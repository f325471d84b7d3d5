"""Encodes frames as the bytes of messages, for each topic that a scene's effects enable."""
from collections.abc import Callable

from dragon_ros.core.scene import Scene
from dragon_ros.messages.cdr import PoseArrayTemplate, VelocitiesTemplate
from dragon_ros.messages.channels import live
from dragon_ros.messages.fixed_size import AXES, HANDLES, VELOCITIES, Encode, FixedSize
from dragon_ros.messages.markers import CubesTemplate, TrianglesTemplate


def encoders(scene: Scene, frame_id: str = 'dragon') -> dict[str, Encode]:
    """Return, by topic, the functions that encode frames of this scene; each template is built once."""
    return {channel.name: _builder(channel.name)(scene, frame_id) for channel in live(scene.effects)}


def _handles(scene: Scene, frame_id: str) -> Encode:
    return FixedSize(PoseArrayTemplate(scene.dragon.benches + 1, frame_id), HANDLES, AXES)


def _benches(scene: Scene, frame_id: str) -> Encode:
    template = _STYLES[scene.markers](scene.dragon.bench_lengths_m, scene.dragon.width_m, frame_id)
    return FixedSize(template, 'benches.centre', AXES)


def _velocities(scene: Scene, _: str) -> Encode:
    return FixedSize(VelocitiesTemplate(scene.dragon.benches + 1), VELOCITIES)


_STYLES: dict[str, type[CubesTemplate] | type[TrianglesTemplate]] = {
    'cubes': CubesTemplate, 'triangles': TrianglesTemplate}
_BUILDERS = {'handles': _handles, 'benches': _benches, 'velocities': _velocities}


def _builder(topic: str) -> Callable[[Scene, str], Encode]:
    """Return the builder for a topic; import the module for rarely used effects only when it is needed."""
    if topic in _BUILDERS:
        return _BUILDERS[topic]
    from dragon_ros.messages.encode_effects import BUILDERS
    return BUILDERS[topic]
