"""One tick, from the scene to the frame: start reading here.

A frame is a function of (scene, k) alone. Any tick can be computed first, twice or in parallel, with the same bits.
"""
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np

from dragon_ros.core import paper
from dragon_ros.core.benches import axes_of, benches_of
from dragon_ros.core.chain import Chain, SpiralChain, stack
from dragon_ros.core.effects import Effect
from dragon_ros.core.errors import FieldError
from dragon_ros.core.frame import Frame
from dragon_ros.core.march import place
from dragon_ros.core.march_many import place_many
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.tiers import PAPER
from dragon_ros.core.walk import Place
from dragon_ros.core.walk_chain import stacked


def tick(scene: Scene, k: int) -> Frame:
    """Return the frame of tick k, at the integer nanosecond ``scene.run.time_ns(k)``."""
    if not 0 <= k <= scene.last_tick:
        raise FieldError('k', k, f'the run has the ticks 0 to {scene.last_tick}', 'ask for one of these')
    t_ns = scene.run.time_ns(k)
    return frame_of(scene, k, t_ns, state(scene, t_ns / NS))


def state(scene: Scene, t_s: float) -> Chain:
    """Return all handles at any instant. Raises ModelEnd beyond the end of the model."""
    scene.check_time(t_s)
    if scene.tier is PAPER:
        return _as_printed(scene, t_s)
    gone = scene.head.travelled_m(t_s)
    if scene.led:
        chained = scene.runs.place(scene.led.leader(gone)) if scene.runs else None
        return chained or scene.led.chain(gone, scene.effort)
    head = scene.spiral.inward(*gone)
    chain = scene.table.place(head) if scene.table else scene.runs.place(Place(0, head)) if scene.runs else None
    return chain or place(scene.spiral, scene.dragon.link_lengths_m, head, scene.effort)


def velocity_of(scene: Scene, chain: Chain, t_s: float | Sequence[float]) -> Floats:
    """Return the velocities of all handles in m/s, shape (..., N+1, 2), of a chain at ``t_s`` or of many at many."""
    if isinstance(t_s, Sequence):
        return chain.velocities(np.array([scene.head.speed_at_m_s(t) for t in t_s]))
    return chain.velocities(scene.head.speed_at_m_s(t_s))


def frame_of(scene: Scene, k: int | None, t_ns: int, chain: Chain) -> Frame:
    """Return the frame with the effects that the scene calls for, each computed only then."""
    axis, effects = axes_of(chain), scene.effects
    velocity = velocity_of(scene, chain, t_ns / NS) if Effect.VELOCITY in effects else None
    benches = benches_of(chain, scene.dragon, axis) if Effect.BENCHES in effects else None
    frame = Frame(k, t_ns, chain, axis, velocity, benches)
    for name, compute in plan(effects):
        frame = replace(frame, **{name: compute(scene, frame)})
    return frame


# The field of each further effect, and its function in ``effects``: (scene, frame with what comes before) -> value.
_FURTHER = {
    Effect.CLEARANCE: ('closeness', 'proximity', 'closeness'), Effect.CONTACT: ('contacts', 'proximity', 'contacts'),
    Effect.ACCELERATIONS: ('acceleration_m_s2', 'dynamics', 'accelerations'),
    Effect.FORCES: ('tension_n_kg', 'dynamics', 'tensions'), Effect.NOISE: ('measured', 'noise', 'measured'),
    Effect.TRAILS: ('trail_m', 'trails', 'trail'), Effect.DIAGNOSTICS: ('health', 'health', 'health')}


@lru_cache(maxsize=256)
def plan(effects: Effect) -> tuple[tuple[str, Callable[[Scene, Frame], Any]], ...]:
    """Return the further fields to fill, with their functions, in order; modules of effects that are off stay out."""
    return tuple((name, getattr(import_module(f'dragon_ros.core.effects.{module}'), function))
                 for effect, (name, module, function) in _FURTHER.items() if effect in effects)


def states(scene: Scene, times_s: Sequence[float]) -> Chain:
    """Return the chains at many instants at once: the same model to the tier's metres, arrays with a leading axis."""
    if scene.tier is PAPER:
        return stack([_as_printed(scene, t_s) for t_s in times_s])
    times = np.asarray(times_s, dtype=np.float64)
    scene.check_times(times)
    gone = scene.head.travelled_m(times)
    if scene.led:
        if scene.runs:
            return scene.runs.place_many(scene.led.leaders(gone))
        return stacked([scene.led.chain(one, scene.effort) for one in zip(*map(np.ndarray.tolist, gone), strict=True)])
    heads = scene.spiral.inward_many(*gone)
    if scene.runs:
        return scene.runs.place_many((np.zeros(times.shape, dtype=np.intp), *heads))
    chains = scene.table.place_many(*heads) if scene.table else None
    return chains or place_many(scene.spiral, scene.dragon.link_lengths_m, *heads, scene.effort)


def _as_printed(scene: Scene, t_s: float) -> SpiralChain:
    scene.check_time(t_s)
    return paper.place(scene.spiral, scene.dragon.link_lengths_m, scene.steady_m_s, t_s)
