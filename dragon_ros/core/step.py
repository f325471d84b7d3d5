"""One tick, from the scene to the frame: start reading here.

A frame is a function of (scene, k) alone. Any tick can be computed first, twice or in parallel, with the same bits.
"""
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dragon_ros.core import paper
from dragon_ros.core.benches import Benches, axes_of, benches_of
from dragon_ros.core.chain import Chain, SpiralChain, stack
from dragon_ros.core.effects import Effect
from dragon_ros.core.errors import FieldError
from dragon_ros.core.march import place
from dragon_ros.core.march_many import place_many
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.tiers import PAPER
from dragon_ros.core.types import Floats
from dragon_ros.core.walk_chain import stacked


@dataclass(frozen=True)
class Frame:
    """All that leaves the core at one instant; arrays are read-only, what the scene does not call for is None."""

    k: int | None
    t_ns: int
    chain: Chain
    axis: Floats
    velocity_m_s: Floats | None
    benches: Benches | None


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
        return scene.led.chain(gone, scene.effort)
    head = scene.spiral.inward(*gone)
    chain = scene.table.place(head) if scene.table else None
    return chain or place(scene.spiral, scene.dragon.link_lengths_m, head, scene.effort)


def velocity_of(scene: Scene, chain: Chain, t_s: float | Sequence[float]) -> Floats:
    """Return the velocities of all handles in m/s, shape (..., N+1, 2), of a chain at ``t_s`` or of many at many."""
    if isinstance(t_s, Sequence):
        return chain.velocities(np.array([scene.head.speed_at_m_s(t) for t in t_s]))
    return chain.velocities(scene.head.speed_at_m_s(t_s))


def frame_of(scene: Scene, k: int | None, t_ns: int, chain: Chain) -> Frame:
    """Return the frame with the effects that the scene calls for, each computed only then."""
    effects, axis = scene.effects, axes_of(chain)
    return Frame(k, t_ns, chain, axis,
                 velocity_of(scene, chain, t_ns / NS) if Effect.VELOCITY in effects else None,
                 benches_of(chain, scene.dragon, axis) if Effect.BENCHES in effects else None)


def states(scene: Scene, times_s: Sequence[float]) -> Chain:
    """Return the chains at many instants at once: the same model to the tier's metres, arrays with a leading axis."""
    if scene.tier is PAPER:
        return stack([_as_printed(scene, t_s) for t_s in times_s])
    times = np.asarray(times_s, dtype=np.float64)
    scene.check_times(times)
    if scene.led:
        return stacked([scene.led.chain(scene.head.travelled_m(t_s), scene.effort) for t_s in times_s])
    heads = scene.spiral.inward_many(*scene.head.travelled_m(times))
    chains = scene.table.place_many(*heads) if scene.table else None
    return chains or place_many(scene.spiral, scene.dragon.link_lengths_m, *heads, scene.effort)


def _as_printed(scene: Scene, t_s: float) -> SpiralChain:
    scene.check_time(t_s)
    return paper.place(scene.spiral, scene.dragon.link_lengths_m, scene.steady_m_s, t_s)
