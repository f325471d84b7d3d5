"""The cost of each effect per tick: the time to compute and encode the effect, and the number of bytes."""
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from dragon_ros.core.flags import NEEDS, Effect, known
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import frame_of, state, tick
from dragon_ros.cost.measure import Timing, timing_of
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.fixed_size import Encode

LEAST, MOST = 15, 400         # number of calls
_PLACES, _RUN = 7, 20           # number of starting points along a run, and of consecutive ticks from each
Call = Callable[[], object]


@dataclass(frozen=True)
class Price:
    """The time and the bytes that an effect adds to a tick; ``timing`` is None if nothing is computed for it."""

    effect: str
    size: int
    timing: Timing | None


def price(effect: Effect, scene: Scene, budget_s: float) -> Price:
    """Return the cost of an effect in a scene, with all effects that it needs and without those that depend on it.

    The time is the difference between a tick with the effect, whose topics are encoded, and a tick without it.
    """
    without = scene.effects & ~effect & ~_above(effect) | _below(effect)
    off, on = (replace(scene, effects=effects) for effects in (without, without | effect))
    encode = [one for name, one in encoders(on).items() if channels()[name].effect is effect]
    size = sum(len(one(tick(on, 0))) for one in encode)
    return Price(effect.names[0], size, _added(off, on, encode, budget_s) if encode else None)


def _added(off: Scene, on: Scene, encode: list[Encode], budget_s: float) -> Timing:
    """Time ticks without and with an effect in turn; placing the handles, which both need, is not timed."""
    both = (compile_scene(off), list[Encode]()), (compile_scene(on), encode)
    times = [on.run.time_ns(k) for k in followed(both[0][0].last_tick)]
    spent: list[float] = []
    while len(spent) <= LEAST or (sum(spent) < budget_s and len(spent) < MOST):
        t_ns, taken = times[len(spent) % len(times)], []
        for simulation, encoded in both:
            chain = state(simulation.scene, on.run.seconds(t_ns))
            start = time.perf_counter()
            frame = frame_of(simulation, None, t_ns, chain)
            for one in encoded:
                one(frame)
            taken.append(time.perf_counter() - start)
        spent.append(max(0.0, taken[1] - taken[0]))
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
