"""The dragon as a life-size URDF robot, with benches as links and handles as revolute joints.

The frame of bench i is at its front handle, with x towards the head. Joint i rotates bench i relative to bench i - 1
about handle i; its angle is published on the topic ``joint_states``.
"""
from math import pi
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from dragon_ros.core.scene import Scene
from dragon_ros.messages.markers import BENCH_HEIGHT_M

ROOT = 'bench_0'
_UNLIMITED = 1e3        # N m and rad/s; nothing drives the joints, but importers require positive limits
_MASS_KG = 1.0          # scenes define no masses, but importers drop links without a mass


def joint_names(benches: int) -> list[str]:
    """Return the names of the joints between benches: joint_1 rotates bench 1 relative to bench 0."""
    return [f'joint_{n}' for n in range(1, benches)]


def urdf_of(scene: Scene) -> str:
    """Return a URDF document that describes the dragon of a scene."""
    dragon = scene.dragon
    robot = Element('robot', name='dragon')
    size = zip(dragon.bench_lengths_m.tolist(), dragon.link_lengths_m.tolist(), strict=True)
    for n, (length_m, link_m) in enumerate(size):
        _add_bench(robot, n, (length_m, dragon.width_m, BENCH_HEIGHT_M), link_m)
    for n, (name, link_m) in enumerate(zip(joint_names(dragon.benches), dragon.link_lengths_m.tolist(), strict=False)):
        _add_joint(robot, name, n, link_m)
    indent(robot)
    return '<?xml version="1.0"?>\n' + tostring(robot, encoding='unicode')


def _add_bench(robot: Element, n: int, size_m: tuple[float, float, float], link_m: float) -> None:
    """Add a homogeneous box, with its moments of inertia, centred between the bench's handles."""
    link = SubElement(robot, 'link', name=f'bench_{n}')
    x, y, z = size_m
    for kind in ('visual', 'collision'):
        part = SubElement(link, kind)
        _add_origin(part, -link_m / 2)
        SubElement(SubElement(part, 'geometry'), 'box', size=f'{x!r} {y!r} {z!r}')
    inertial = SubElement(link, 'inertial')
    _add_origin(inertial, -link_m / 2)
    SubElement(inertial, 'mass', value=repr(_MASS_KG))
    moments = {'ixx': y * y + z * z, 'iyy': x * x + z * z, 'izz': x * x + y * y, 'ixy': 0.0, 'ixz': 0.0, 'iyz': 0.0}
    SubElement(inertial, 'inertia', {key: repr(_MASS_KG * value / 12) for key, value in moments.items()})


def _add_joint(robot: Element, name: str, n: int, link_m: float) -> None:
    """Add the joint behind bench n."""
    joint = SubElement(robot, 'joint', name=name, type='revolute')
    _add_origin(joint, -link_m)
    SubElement(joint, 'parent', link=f'bench_{n}')
    SubElement(joint, 'child', link=f'bench_{n + 1}')
    SubElement(joint, 'axis', xyz='0 0 1')
    SubElement(joint, 'limit', lower=repr(-pi), upper=repr(pi), effort=repr(_UNLIMITED), velocity=repr(_UNLIMITED))


def _add_origin(part: Element, x_m: float) -> None:
    SubElement(part, 'origin', xyz=f'{x_m!r} 0 0', rpy='0 0 0')
