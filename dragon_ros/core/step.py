"""One tick, from the scene to the frame: start reading here.

A scene consists of settings; ``compile_scene`` turns it into a simulation. The simulation maps a time to the distance
travelled by the leader, its model maps that distance to the chain of all handles, and each effect that the scene
requests adds its field to the frame. A frame is a function of (scene, k) alone: ticks can be computed in any order,
repeatedly or in parallel, with bit-identical results. ``batches`` computes many instants at once.
"""
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from dragon_ros.core import effects
from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.chain.commanded import Walked
from dragon_ros.core.geometry.contacts import Closeness, Contacts
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.model import Simulation, compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene

if TYPE_CHECKING:       # the modules of effects that are off are not imported
    from dragon_ros.core.effects.health import Health
    from dragon_ros.core.effects.leading import LeaderMotion
    from dragon_ros.core.effects.noise import NoisyHandles


class Frame(NamedTuple):
    """All results of the core at one instant; arrays are read-only, and the field of an effect that is off is None.

    A frame is a tuple, because every tick creates one: a frozen dataclass of so many fields takes 2 µs longer.
    """

    k: int | None
    t_ns: int
    chain: Chain
    axis: Floats
    velocity_m_s: Floats | None = None
    benches: Benches | None = None
    closeness: Closeness | None = None
    contacts: Contacts | None = None
    acceleration_m_s2: Floats | None = None
    tension_n_kg: Floats | None = None
    measured: 'NoisyHandles | None' = None
    trail_m: Floats | None = None
    health: 'Health | None' = None
    leader: 'LeaderMotion | None' = None
    joint_rad: Floats | None = None

    def __repr__(self) -> str:
        """Name the tick and the fields that are set, but omit their long arrays."""
        there = [one for one in self._fields[2:] if getattr(self, one) is not None]
        return f'Frame(k={self.k}, t_ns={self.t_ns}, with {", ".join(there)})'


def tick(scene: Scene, k: int) -> Frame:
    """Return the frame of tick k, at the time ``scene.run.time_ns(k)``. Raises FieldError if there is no such tick."""
    simulation = compile_scene(scene)
    t_ns = simulation.time_ns(k)
    return frame_of(simulation, k, t_ns, simulation.chain(scene.run.seconds(t_ns)))


def frame_of(simulation: Simulation, k: int | None, t_ns: int, chain: Chain, axis: Floats | None = None,
             benches: Benches | None = None) -> Frame:
    """Return the frame of a chain at tick k or at a time between ticks; an effect is computed only if it is on.

    Each effect receives its inputs by name; the field of an effect that is off is None. If the link directions ``axis``
    or the ``benches`` are given, they are not computed again.
    """
    axis = axes_of(chain) if axis is None else axis
    on, scene, t_s = simulation.on, simulation.scene, simulation.scene.run.seconds(t_ns)
    velocity = chain.velocities(scene.head.speed_at_m_s(t_s)) if on.velocity else None
    benches = (benches or benches_of(chain, scene.dragon, axis)) if on.benches else None
    closeness = effects.proximity.closeness(simulation, chain, benches) if on.clearance else None
    contacts = effects.proximity.contacts(simulation, closeness, benches) if on.contact else None
    acceleration = effects.dynamics.accelerations(simulation, t_s, chain) if on.accelerations else None
    tension = effects.dynamics.tensions(chain, acceleration) if on.forces else None
    noisy = effects.noise.noisy_handles(scene.noise, k, t_ns, chain.p, axis) if on.noise else None
    trail = effects.trails.trail(simulation, t_s) if on.trails else None
    health = effects.health.chain_health(chain, simulation.promise_m) if on.diagnostics else None
    leader = effects.leading.leader_motion(simulation, t_s, chain) if on.leader else None
    joints = effects.joints.joint_angles(axis) if on.joints else None
    return Frame(k, t_ns, chain, axis, velocity, benches, closeness, contacts, acceleration, tension, noisy, trail,
                 health, leader, joints)


def state(scene: Scene, t_s: float) -> Chain:
    """Return the chain at any instant. Raises ModelEnd beyond the end of the model."""
    return compile_scene(scene).chain(t_s)


def led_tick(simulation: Simulation, law: Walked, k: int) -> Frame:
    """Return the frame of tick k of a commanded dragon whose leader has followed this law so far."""
    led = Simulation(replace(simulation.scene, head=law), simulation.model)
    t_ns = led.scene.run.time_ns(k)
    return frame_of(led, k, t_ns, led.chain(led.scene.run.seconds(t_ns)))


def contact_frame(scene: Scene, t_s: float) -> Frame:
    """Return the frame at the exact time of a contact, placed accurately; its stamp is rounded to a nanosecond."""
    simulation = compile_scene(scene.exactly)
    return frame_of(simulation, None, scene.run.stamp_ns(t_s), simulation.chain(t_s))


def ticks_before(scene: Scene, t_s: float) -> int:
    """Return the number of ticks before the stamp of a contact; a run that ends with the contact has one more frame."""
    t_ns = scene.run.stamp_ns(t_s)
    return scene.run.tick_at(t_ns - 1) + 1 if t_ns > scene.run.start_ns else 0
