"""One tick, from the scene to the frame: start reading here.

A scene is settings; ``compile_scene`` makes the simulation of it. The simulation maps a time to how far the leader has
gone, its model maps that to the chain of all handles, and each effect that the scene calls for adds its field to the
frame. A frame is a function of (scene, k) alone. Any tick can be computed first, twice or in parallel, with the same
bits.
"""
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.chain.chain import Chain, stack
from dragon_ros.core.chain.commanded import Walked
from dragon_ros.core.errors import FieldError
from dragon_ros.core.flags import Effect
from dragon_ros.core.frame import Frame
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.model import Simulation, compile_scene
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.tiers import PAPER

_BATCH_HANDLES = 2**18      # of a batch: with velocities 8 MB; where there are fewer, calls take longer than numbers
_TICK_HANDLES = 2**12       # of ticks in a row, whose frames stay in the cache until they are taken


def tick(scene: Scene, k: int) -> Frame:
    """Return the frame of tick k, at the integer nanosecond ``scene.run.time_ns(k)``."""
    simulation = compile_scene(scene)
    if not 0 <= k <= simulation.last_tick:
        raise FieldError('k', k, f'the run has the ticks 0 to {simulation.last_tick}', 'ask for one of these')
    t_ns = scene.run.time_ns(k)
    return frame_of(scene, k, t_ns, simulation.chain(t_ns / NS))


def ticks(scene: Scene, first: int, stop: int) -> Iterator[Frame]:
    """Yield the frames of ticks ``first`` to ``stop`` - 1 in order, each as ``tick`` returns it, to the last bit.

    Axes and rectangles are computed for some ticks at once: for one, numpy's calls take longer than its numbers.
    """
    simulation = compile_scene(scene)
    if not 0 <= first <= stop <= simulation.last_tick + 1:
        raise FieldError('ticks', f'{first} to {stop}', f'the run has the ticks 0 to {simulation.last_tick}',
                         'ask for some of these')
    size = max(1, _TICK_HANDLES // (scene.dragon.benches + 1)) if np.all(simulation.model.links_m) else 1
    for begin in range(first, stop, size):
        times_ns = [scene.run.time_ns(k) for k in range(begin, min(begin + size, stop))]
        chains = [simulation.chain(t_ns / NS) for t_ns in times_ns]
        if size == 1:       # links of no length lie along the track, which each chain knows for itself
            yield frame_of(scene, begin, times_ns[0], chains[0])
            continue
        together = replace(chains[0], p=np.stack([chain.p for chain in chains]))
        axes = axes_of(together)
        all_benches = benches_of(together, scene.dragon, axes) if Effect.BENCHES in scene.effects else None
        for n, (t_ns, chain) in enumerate(zip(times_ns, chains, strict=True)):
            benches = replace(all_benches, centre=all_benches.centre[n], axis=axes[n]) if all_benches else None
            yield _filled(simulation, begin + n, t_ns, chain, axes[n], benches)


def state(scene: Scene, t_s: float) -> Chain:
    """Return all handles at any instant. Raises ModelEnd beyond the end of the model."""
    return compile_scene(scene).chain(t_s)


def states(scene: Scene, times_s: Sequence[float], out: Floats | None = None) -> Chain:
    """Return the chains at many instants (S,) at once: the same model to the tier's metres, arrays with a leading axis.

    ``out`` (S, N+1, 2) takes the handles, if it is given. Raises FieldError where it cannot.
    """
    simulation = compile_scene(scene)
    if out is not None:
        _check_room(out, (len(times_s), scene.dragon.benches + 1, 2))
    if simulation.tier is PAPER:
        chain = stack([simulation.chain(t_s) for t_s in times_s])
        if out is None:
            return chain
        out[:] = chain.p
        return replace(chain, p=read_only(out.view()))
    times = np.asarray(times_s, dtype=np.float64)
    simulation.check_times(times)
    return simulation.model.place_many(scene.head.travelled_m(times), out)


def velocity_of(scene: Scene, chain: Chain, t_s: float | Sequence[float], out: Floats | None = None) -> Floats:
    """Return the velocities of all handles in m/s, shape (..., N+1, 2), of a chain at ``t_s`` or of many at many.

    ``out``, of the same shape, takes them, if it is given. Raises FieldError where it cannot.
    """
    if out is not None:
        _check_room(out, chain.p.shape)
    if isinstance(t_s, Sequence):
        return chain.velocities(np.array([scene.head.speed_at_m_s(t) for t in t_s]), out)
    return chain.velocities(scene.head.speed_at_m_s(t_s), out)


class Batch(NamedTuple):
    """Some of many instants: when (S,), all handles (S, N+1, 2) in m and velocities (S, N+1, 2) in m/s, read-only."""

    t_s: Floats
    handles_m: Floats
    velocity_m_s: Floats


def batches(scene: Scene, times_s: Sequence[float], size: int | None = None) -> Iterator[Batch]:
    """Yield many instants, ``size`` at a time, in memory that the next batch takes again: copy what is to stay.

    Fresh memory costs as much as what is computed into it; by itself a batch is about as large as a cache.
    """
    size = size or max(1, _BATCH_HANDLES // (scene.dragon.benches + 1))
    room: Floats = np.empty((2, min(size, len(times_s)), scene.dragon.benches + 1, 2))
    for first in range(0, len(times_s), size):
        some = times_s[first:first + size]
        handles, velocity = room[:, :len(some)]
        chain = states(scene, some, handles)
        yield Batch(np.array(some, dtype=np.float64), chain.p, velocity_of(scene, chain, some, velocity))


def _check_room(out: Floats, shape: tuple[int, ...]) -> None:
    if out.shape != shape or out.dtype != np.float64 or not (out.flags.c_contiguous and out.flags.writeable):
        raise FieldError('out', f'{out.dtype} {out.shape}', f'{shape} are to be filled in',
                         'give a writable array of that shape, float64 in C order')


def frame_of(scene: Scene, k: int | None, t_ns: int, chain: Chain) -> Frame:
    """Return the frame with the effects that the scene calls for, each computed only then."""
    return _filled(compile_scene(scene), k, t_ns, chain, axes_of(chain))


def contact_frame(scene: Scene, t_s: float) -> Frame:
    """Return the frame at exactly the time of a contact, at the exact tier; its stamp is rounded to a nanosecond."""
    exact = replace(scene, accuracy='exact')
    return frame_of(exact, None, round(t_s * NS), state(exact, t_s))


def ticks_before(scene: Scene, t_s: float) -> int:
    """Return the number of ticks before the stamp of a contact: a run that ends there goes on to its frame."""
    t_ns = round(t_s * NS)
    return scene.run.tick_at(t_ns - 1) + 1 if t_ns > scene.run.start_ns else 0


def led_tick(simulation: Simulation, law: Walked, k: int) -> Frame:
    """Return the frame of tick k of a led dragon, whose leader has walked by this law up to there."""
    led = Simulation(replace(simulation.scene, head=law), simulation.model)
    t_ns = led.scene.run.time_ns(k)
    chain = led.chain(t_ns / NS)
    return _filled(led, k, t_ns, chain, axes_of(chain))


def _filled(simulation: Simulation, k: int | None, t_ns: int, chain: Chain, axis: Floats,
            benches: Benches | None = None) -> Frame:
    """Return the frame of a chain with what its scene calls for; benches that are known are taken."""
    frame = object.__new__(Frame)       # frozen, and filled field by field: what is left out is None, as the class says
    known = vars(frame)
    known.update(k=k, t_ns=t_ns, chain=chain, axis=axis)
    for name, compute in plan(simulation.scene.effects):
        known[name] = benches if benches and name == 'benches' else compute(simulation, frame)
    return frame


def _velocity(simulation: Simulation, frame: Frame) -> Floats:
    return velocity_of(simulation.scene, frame.chain, frame.t_ns / NS)


def _benches(simulation: Simulation, frame: Frame) -> Benches:
    return benches_of(frame.chain, simulation.scene.dragon, frame.axis)


Compute = Callable[[Simulation, Frame], Any]


def _in(module: str, name: str) -> Callable[[], Compute]:
    """Return what imports a function of ``effects``: the modules of effects that are off stay unloaded."""
    def load() -> Compute:
        compute: Compute = getattr(import_module(f'dragon_ros.core.effects.{module}'), name)
        return compute
    return load


# The field of each effect, and what returns its function (simulation, frame with what comes before) -> value.
_PARTS: dict[Effect, tuple[str, Callable[[], Compute]]] = {
    Effect.VELOCITY: ('velocity_m_s', lambda: _velocity), Effect.BENCHES: ('benches', lambda: _benches),
    Effect.CLEARANCE: ('closeness', _in('proximity', 'closeness')),
    Effect.CONTACT: ('contacts', _in('proximity', 'contacts')),
    Effect.ACCELERATIONS: ('acceleration_m_s2', _in('dynamics', 'accelerations')),
    Effect.FORCES: ('tension_n_kg', _in('dynamics', 'tensions')), Effect.NOISE: ('measured', _in('noise', 'measured')),
    Effect.TRAILS: ('trail_m', _in('trails', 'trail')), Effect.DIAGNOSTICS: ('health', _in('health', 'health')),
    Effect.LEADER: ('leader', _in('leading', 'leading'))}


@lru_cache(maxsize=256)
def plan(effects: Effect) -> tuple[tuple[str, Compute], ...]:
    """Return the fields to fill, with their functions, in order."""
    return tuple((name, load()) for effect, (name, load) in _PARTS.items() if effect in effects)
