"""The price of each effect in a tick, and whole ticks side by side."""
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import cycle
from statistics import median, quantiles
from typing import Any

from dragon_ros.core import effects
from dragon_ros.core.flags import NEEDS, Effect, known
from dragon_ros.core.frame import Frame
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.model import Simulation, compile_scene
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import frame_of, state, tick
from dragon_ros.cost.measure import Timing
from dragon_ros.messages.cdr import PoseArrayTemplate
from dragon_ros.messages.channels import live
from dragon_ros.messages.encode import Encode, encoders
from dragon_ros.scenes.load import load_scene

ALONE = 'alone'
ALL = ~Effect.NONE
_LEAST, _MOST = 15, 400         # calls
_PLACES, _RUN = 7, 20           # along the run, from each of which so many ticks follow each other, as in a simulator
Call = Callable[[], object]
# The field of each effect, and how it is filled in a frame that has what it needs, as ``frame_of`` does.
_FIELDS: dict[Effect, tuple[str, Callable[[Simulation, Frame], Any]]] = {
    Effect.VELOCITY: ('velocity_m_s', lambda of, to: to.chain.velocities(of.scene.head.speed_at_m_s(to.t_ns / NS))),
    Effect.BENCHES: ('benches', lambda of, to: benches_of(to.chain, of.scene.dragon, to.axis)),
    Effect.CLEARANCE: ('closeness', lambda of, to: effects.closeness(of.model, to.chain, to.benches)),
    Effect.CONTACT: ('contacts', lambda _, to: effects.contacts(to.closeness, to.benches)),
    Effect.ACCELERATIONS: ('acceleration_m_s2', lambda of, to: effects.accelerations(of, to.t_ns / NS, to.chain)),
    Effect.FORCES: ('tension_n_kg', lambda _, to: effects.tensions(to.chain, to.acceleration_m_s2)),
    Effect.NOISE: ('measured', lambda of, to: effects.noisy_handles(of.scene.noise, None, to.t_ns, to.chain.p,
                                                                    to.axis)),
    Effect.TRAILS: ('trail_m', lambda of, to: effects.trail(of, to.t_ns / NS)),
    Effect.DIAGNOSTICS: ('health', lambda of, to: effects.chain_health(to.chain, of.promise_m)),
    Effect.LEADER: ('leader', lambda of, to: effects.leader_motion(of, to.t_ns / NS, to.chain))}


@dataclass(frozen=True)
class Price:
    """What an effect adds to a tick of a scene (ALONE: of the classic one with what it needs), and to its bytes.

    ``timing`` is None where nothing is computed for it.
    """

    effect: str
    scene: str
    size: int
    timing: Timing | None


@dataclass(frozen=True)
class Whole:
    """A whole tick of the classic scene, computed and encoded, and its time over that of another, both in turns."""

    name: str
    timing: Timing
    ratio: float
    over: str


def price(effect: Effect, name: str, scene: Scene, budget_s: float) -> Price:
    """Return what an effect adds to a scene that has all effects that it needs, and none that need it.

    Only its own work is timed: filling its field of a frame that has the others, and encoding its topics.
    """
    without = scene.effects & ~effect & ~_above(effect) | _below(effect)
    off, on = (replace(scene, effects=effects) for effects in (without, without | effect))
    encode = encoders(on)
    encode = {row.name: encode[row.name] for row in live(on.effects) if row.effect is effect}
    size = sum(len(one(tick(on, 0))) for one in encode.values())
    return Price(effect.names[0], name, size, _own(effect, off, list(encode.values()), budget_s) if encode else None)


def _own(effect: Effect, scene: Scene, encode: list[Encode], budget_s: float) -> Timing:
    """Time an effect's own work on frames of a scene that is without it, each of them new."""
    simulation = compile_scene(scene)
    times = [scene.run.time_ns(k) for k in _followed(simulation.last_tick)]
    spent: list[float] = []
    name, compute = _FIELDS.get(effect, ('', None))
    while len(spent) <= _LEAST or (sum(spent) < budget_s and len(spent) < _MOST):
        t_ns = times[len(spent) % len(times)]
        frame = frame_of(simulation, None, t_ns, state(scene, t_ns / NS))
        start = time.perf_counter()
        if compute:
            frame = replace(frame, **{name: compute(simulation, frame)})
        for one in encode:
            one(frame)
        spent.append(time.perf_counter() - start)
    return _timing(spent[1:])


def _followed(last: int) -> list[int]:
    """Return ticks that follow each other, from several places along a run on."""
    return [min(k * last // _PLACES + n, last) for k in range(_PLACES) for n in range(_RUN)]


def wholes(budget_s: float) -> list[Whole]:
    """Return whole ticks: all effects, the defaults, none, and a program without effects."""
    scene = load_scene('minimal')
    everything, defaults = (replace(scene, effects=effects) for effects in (ALL, Scene().effects))
    rows = [('everything on', worker(everything), 'minimal', worker(scene)),
            ('winding', worker(defaults), 'minimal', worker(scene)),
            ('minimal', worker(scene), 'winding with everything on', worker(everything)),
            ('minimal', worker(scene), 'a build without effects', bare(scene))]
    out = []
    for what, call, over, other in rows:
        first, second = paired(other, call, budget_s)
        out.append(Whole(what, second, second.median_s / first.median_s, over))
    return out


def worker(scene: Scene) -> Call:
    """Return a call that computes and encodes one tick of a scene, the next each time."""
    encode, numbers = encoders(scene), cycle(_followed(compile_scene(scene).last_tick))

    def work() -> object:
        frame = tick(scene, next(numbers))
        return [one(frame) for one in encode.values()]
    return work


def bare(scene: Scene) -> Call:
    """Return a call that does the same for handles alone, written as if effects did not exist."""
    template = PoseArrayTemplate(scene.dragon.benches + 1, 'dragon')
    numbers = cycle(_followed(compile_scene(scene).last_tick))

    def work() -> object:
        t_ns = scene.run.time_ns(next(numbers))
        chain = state(scene, t_ns / NS)
        return [template.encode(t_ns, chain.p, axes_of(chain))]
    return work


def paired(first: Call, second: Call, budget_s: float) -> tuple[Timing, Timing]:
    """Time two calls in turns."""
    first(), second()
    spent: list[tuple[float, float]] = []
    while len(spent) < _LEAST or (sum(map(sum, spent)) < budget_s and len(spent) < _MOST):
        spent.append((_time(first), _time(second)))
    return _timing([one for one, _ in spent]), _timing([other for _, other in spent])


def _time(call: Call) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _timing(spent: list[float]) -> Timing:
    low, _, high = quantiles(spent, n=4)
    return Timing(median(spent), low, high, len(spent))


def _below(effect: Effect) -> Effect:
    """Return what an effect needs, and what that needs."""
    need = NEEDS.get(effect, Effect.NONE)
    return need | _below(need) if need else need


def _above(effect: Effect) -> Effect:
    """Return the effects that need an effect."""
    out = Effect.NONE
    for other in known().values():
        out |= other if effect in _below(other) else Effect.NONE
    return out
