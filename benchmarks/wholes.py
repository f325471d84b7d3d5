"""Compare the times of whole ticks of the classic dragon."""
import time
from dataclasses import dataclass, replace
from itertools import cycle

from benchmarks.passes import PASSES
from benchmarks.rates import Amounts, limit, tick_rates
from benchmarks.stages import needs_of
from dragon_ros.core.flags import Effect
from dragon_ros.core.geometry.rectangles import axes_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import state, tick
from dragon_ros.cost.effects import LEAST, MOST, Call, followed
from dragon_ros.cost.measure import Timing, timing_of
from dragon_ros.messages.cdr import PoseArrayTemplate
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.load import load_scene

ALL = ~Effect.NONE


@dataclass(frozen=True)
class Whole:
    """A whole tick of the classic scene, computed and encoded, and its time relative to that of another tick.

    ``limit_s`` is the shortest time in which the machine could place the handles and copy the messages.
    """

    name: str
    timing: Timing
    ratio: float
    over: str
    limit_s: float


def wholes(budget_s: float) -> list[Whole]:
    """Measure whole ticks with all effects, with the defaults and with none, and ticks without any code for effects.

    The fastest of several passes over all rows counts.
    """
    scene = load_scene('minimal')
    everything, defaults = (replace(scene, effects=effects) for effects in (ALL, Scene().effects))
    rows = [('everything on', everything, 'minimal', worker(scene)),
            ('winding', defaults, 'minimal', worker(scene)),
            ('minimal', scene, 'winding with everything on', worker(everything)),
            ('minimal', scene, 'a build without effects', bare(scene))]
    rates = tick_rates(budget_s)
    passes = [[paired(other, worker(measured), budget_s / PASSES) for _, measured, _, other in rows]
              for _ in range(PASSES)]
    best = [min(pairs, key=lambda pair: pair[1].median_s) for pairs in zip(*passes, strict=True)]
    return [Whole(what, second, second.median_s / first.median_s, over, limit_of(measured, rates))
            for (what, measured, over, _), (first, second) in zip(rows, best, strict=True)]


def limit_of(scene: Scene, rates: Amounts) -> float:
    """Return the shortest time in seconds for placing the handles and copying all messages of a tick."""
    needs = needs_of(scene, scene.run.start_s)
    return limit(needs['chain'], rates)[0] + limit(needs['encode'], rates)[0]


def worker(scene: Scene) -> Call:
    """Return a call that computes and encodes the next tick of a scene."""
    encode, numbers = encoders(scene), cycle(followed(compile_scene(scene).last_tick))

    def work() -> object:
        frame = tick(scene, next(numbers))
        return [one(frame) for one in encode.values()]
    return work


def bare(scene: Scene) -> Call:
    """Return a call that computes and encodes only the handles of the next tick, without any code for effects."""
    template = PoseArrayTemplate(scene.dragon.benches + 1, 'dragon')
    numbers = cycle(followed(compile_scene(scene).last_tick))

    def work() -> object:
        t_ns = scene.run.time_ns(next(numbers))
        chain = state(scene, t_ns / NS)
        return [template.encode(t_ns, chain.p, axes_of(chain))]
    return work


def paired(first: Call, second: Call, budget_s: float) -> tuple[Timing, Timing]:
    """Measure two calls alternately."""
    first(), second()
    spent: list[tuple[float, float]] = []
    while len(spent) < LEAST or (sum(map(sum, spent)) < budget_s and len(spent) < MOST):
        spent.append((_time(first), _time(second)))
    return timing_of([one for one, _ in spent]), timing_of([other for _, other in spent])


def _time(call: Call) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start
