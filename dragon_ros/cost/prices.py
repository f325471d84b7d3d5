"""What each effect adds to a tick: measured in pairs of calls, with the effect and without, in turns."""
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count, cycle
from statistics import median, quantiles

from dragon_ros.core.benches import axes_of
from dragon_ros.core.effects import NEEDS, Effect, known
from dragon_ros.core.errors import FieldError
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import frame_of, state, tick
from dragon_ros.cost.measure import Timing
from dragon_ros.wire.cdr import PoseArrayTemplate
from dragon_ros.wire.channels import live
from dragon_ros.wire.encode import encoders
from dragon_ros.wire.scenes import load_scene

ALONE = 'alone'
ALL = ~Effect.NONE
_LEAST, _MOST = 15, 400         # pairs of calls
_TICKS, _PLACES = 97, 7         # ticks apart, and places along the run: successive calls are of unlike ones
Call = Callable[[], object]


@dataclass(frozen=True)
class Price:
    """What an effect adds to a tick of a scene (ALONE: of the classic one with what it needs), and to its bytes.

    ``timing`` is None where the scene refuses the effect, or where nothing is computed for it.
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
    """Return what an effect adds to a scene that has all that it needs, and nothing that needs it."""
    without = scene.effects & ~effect & ~_above(effect) | _below(effect)
    try:
        off, on = (replace(scene, effects=effects) for effects in (without, without | effect))
    except FieldError:
        return Price(effect.names[0], name, 0, None)
    size = sum(map(len, _frame_bytes(on, 0).values())) - sum(map(len, _frame_bytes(off, 0).values()))
    topics = len(live(on.effects)) - len(live(off.effects))
    timing = paired(*finishers(off, on), budget_s)[2] if topics else None
    return Price(effect.names[0], name, size, timing)


def wholes(budget_s: float) -> list[Whole]:
    """Return whole ticks: everything on, the defaults, nothing on, and a program that knows no effects."""
    scene = load_scene('minimal')
    everything, defaults = (replace(scene, effects=effects) for effects in (ALL, Scene().effects))
    rows = [('everything on', worker(everything), 'minimal', worker(scene)),
            ('winding', worker(defaults), 'minimal', worker(scene)),
            ('minimal', worker(scene), 'winding with everything on', worker(everything)),
            ('minimal', worker(scene), 'a build without effects', bare(scene))]
    out = []
    for what, call, over, other in rows:
        first, second, _ = paired(other, call, budget_s)
        out.append(Whole(what, second, second.median_s / first.median_s, over))
    return out


def worker(scene: Scene) -> Call:
    """Return a call that computes and encodes one tick of a scene, another each time."""
    encode, numbers = encoders(scene), count(0, _TICKS)
    ticks = scene.last_tick + 1

    def work() -> object:
        frame = tick(scene, next(numbers) % ticks)
        return [one(frame) for one in encode.values()]
    return work


def finishers(*scenes: Scene) -> list[Call]:
    """Return calls that make and encode frames of chains that are there already, the same for scenes alike."""
    times = [scenes[0].run.time_ns(k * scenes[0].last_tick // _PLACES) for k in range(_PLACES)]
    chains = [(t_ns, state(scenes[0], t_ns / NS)) for t_ns in times]

    def finisher(scene: Scene) -> Call:
        encode, turn = encoders(scene), cycle(chains)

        def finish() -> object:
            t_ns, chain = next(turn)
            frame = frame_of(scene, None, t_ns, chain)
            return [one(frame) for one in encode.values()]
        return finish
    return [finisher(scene) for scene in scenes]


def bare(scene: Scene) -> Call:
    """Return a call that does the same for handles alone, written out as if there were no effects."""
    template, numbers = PoseArrayTemplate(scene.dragon.benches + 1, 'dragon'), count(0, _TICKS)
    ticks = scene.last_tick + 1

    def work() -> object:
        t_ns = scene.run.time_ns(next(numbers) % ticks)
        chain = state(scene, t_ns / NS)
        return [template.encode(t_ns, chain.p, axes_of(chain))]
    return work


def paired(first: Call, second: Call, budget_s: float) -> tuple[Timing, Timing, Timing]:
    """Time two calls in turns; return the timings of both, and of the difference of each pair."""
    first(), second()
    spent: list[tuple[float, float]] = []
    while len(spent) < _LEAST or (sum(map(sum, spent)) < budget_s and len(spent) < _MOST):
        spent.append((_time(first), _time(second)))
    return (_timing([one for one, _ in spent]), _timing([other for _, other in spent]),
            _timing([other - one for one, other in spent]))


def _time(call: Call) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _timing(spent: list[float]) -> Timing:
    low, _, high = quantiles(spent, n=4)
    return Timing(median(spent), low, high, len(spent))


def _frame_bytes(scene: Scene, k: int) -> dict[str, bytes]:
    frame = tick(scene, k)
    return {name: encode(frame) for name, encode in encoders(scene).items()}


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
