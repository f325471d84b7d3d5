"""The cost of each effect per tick: the time to compute and encode the effect, and the number of bytes."""
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from dragon_ros.core import effects
from dragon_ros.core.flags import NEEDS, Effect, known
from dragon_ros.core.frame import Frame
from dragon_ros.core.geometry.rectangles import benches_of
from dragon_ros.core.model import Simulation, compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import frame_of, state, tick
from dragon_ros.cost.measure import Timing, timing_of
from dragon_ros.messages.channels import live
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.fixed_size import Encode

ALONE = 'alone'
LEAST, MOST = 15, 400         # number of calls
_PLACES, _RUN = 7, 20           # number of starting points along a run, and of consecutive ticks from each
Call = Callable[[], object]


def _t_s(of: Simulation, to: Frame) -> float:
    return of.scene.run.seconds(to.t_ns)


# The field of each effect, and a function that computes this field in the same way as ``frame_of`` does. The function
# uses a frame that contains all fields that the effect needs. A test compares the results with those of ``frame_of``.
# If ``frame_of`` itself called functions from such a table, a tick would take 1.05 times as long.
FIELDS: dict[Effect, tuple[str, Callable[[Simulation, Frame], Any]]] = {
    Effect.VELOCITY: ('velocity_m_s', lambda of, to: to.chain.velocities(of.scene.head.speed_at_m_s(_t_s(of, to)))),
    Effect.BENCHES: ('benches', lambda of, to: benches_of(to.chain, of.scene.dragon, to.axis)),
    Effect.CLEARANCE: ('closeness', lambda of, to: effects.proximity.closeness(of, to.chain, to.benches)),
    Effect.CONTACT: ('contacts', lambda of, to: effects.proximity.contacts(of, to.closeness, to.benches)),
    Effect.ACCELERATIONS: ('acceleration_m_s2',
                           lambda of, to: effects.dynamics.accelerations(of, _t_s(of, to), to.chain)),
    Effect.FORCES: ('tension_n_kg', lambda _, to: effects.dynamics.tensions(to.chain, to.acceleration_m_s2)),
    Effect.NOISE: ('measured', lambda of, to: effects.noise.noisy_handles(of.scene.noise, None, to.t_ns, to.chain.p,
                                                                    to.axis)),
    Effect.TRAILS: ('trail_m', lambda of, to: effects.trails.trail(of, _t_s(of, to))),
    Effect.DIAGNOSTICS: ('health', lambda of, to: effects.health.chain_health(to.chain, of.promise_m)),
    Effect.LEADER: ('leader', lambda of, to: effects.leading.leader_motion(of, _t_s(of, to), to.chain)),
    Effect.JOINTS: ('joint_rad', lambda _, to: effects.joints.joint_angles(to.axis))}


@dataclass(frozen=True)
class Price:
    """The time and the bytes that an effect adds to a tick of a scene.

    The scene ALONE is the classic scene with only the effects that this effect needs. ``timing`` is None if nothing is
    computed for the effect.
    """

    effect: str
    scene: str
    size: int
    timing: Timing | None


def price(effect: Effect, name: str, scene: Scene, budget_s: float) -> Price:
    """Return the cost of an effect in a scene, with all effects that it needs and without those that depend on it.

    Only the effect's own work is timed: filling its field in a frame that contains the other effects, and encoding its
    topics.
    """
    without = scene.effects & ~effect & ~_above(effect) | _below(effect)
    off, on = (replace(scene, effects=effects) for effects in (without, without | effect))
    encode = encoders(on)
    encode = {row.name: encode[row.name] for row in live(on.effects) if row.effect is effect}
    size = sum(len(one(tick(on, 0))) for one in encode.values())
    return Price(effect.names[0], name, size, _own(effect, off, list(encode.values()), budget_s) if encode else None)


def _own(effect: Effect, scene: Scene, encode: list[Encode], budget_s: float) -> Timing:
    """Time only the effect's own work, on new frames of a scene without the effect."""
    simulation = compile_scene(scene)
    times = [scene.run.time_ns(k) for k in followed(simulation.last_tick)]
    spent: list[float] = []
    name, compute = FIELDS.get(effect, ('', None))
    while len(spent) <= LEAST or (sum(spent) < budget_s and len(spent) < MOST):
        t_ns = times[len(spent) % len(times)]
        frame = frame_of(simulation, None, t_ns, state(scene, scene.run.seconds(t_ns)))
        start = time.perf_counter()
        if compute:
            frame = frame._replace(**{name: compute(simulation, frame)})
        for one in encode:
            one(frame)
        spent.append(time.perf_counter() - start)
    return timing_of(spent[1:])


def followed(last: int) -> list[int]:
    """Return consecutive ticks after several starting points along a run."""
    return [min(k * last // _PLACES + n, last) for k in range(_PLACES) for n in range(_RUN)]


def _below(effect: Effect) -> Effect:
    """Return the effects that an effect needs, directly or indirectly."""
    need = NEEDS.get(effect, Effect.NONE)
    return need | _below(need) if need else need


def _above(effect: Effect) -> Effect:
    """Return the effects that depend on an effect, directly or indirectly."""
    out = Effect.NONE
    for other in known().values():
        out |= other if effect in _below(other) else Effect.NONE
    return out
