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
    head = scene.track.inward(*scene.head.travelled_m(t_s))
    chain = scene.table.place(head) if scene.table else None
    return chain or place(scene.track, scene.dragon.link_lengths_m, head, scene.effort)


def velocity_of(scene: Scene, chain: Chain) -> Floats:
    """Return the velocities of all handles in m/s, shape (..., N+1, 2)."""
    return chain.velocities(scene.head.speed_m_s)


def frame_of(scene: Scene, k: int | None, t_ns: int, chain: Chain) -> Frame:
    """Return the frame with the effects that the scene calls for, each computed only then."""
    effects, axis = scene.effects, axes_of(chain)
    return Frame(k, t_ns, chain, axis,
                 velocity_of(scene, chain) if Effect.VELOCITY in effects else None,
                 benches_of(chain, scene.dragon, axis) if Effect.BENCHES in effects else None)


def states(scene: Scene, times_s: Sequence[float]) -> Chain:
    """Return the chains at many instants at once: the same model to the tier's metres, arrays with a leading axis."""
    if scene.tier is PAPER:
        return stack([_as_printed(scene, t_s) for t_s in times_s])
    scene.check_times(np.asarray(times_s, dtype=np.float64))
    heads = scene.track.inward_many(*scene.head.travelled_m(np.asarray(times_s, dtype=np.float64)))
    chains = scene.table.place_many(*heads) if scene.table else None
    return chains or place_many(scene.track, scene.dragon.link_lengths_m, *heads, scene.effort)


def _as_printed(scene: Scene, t_s: float) -> SpiralChain:
    scene.check_time(t_s)
    return paper.place(scene.track, scene.dragon.link_lengths_m, scene.head.speed_m_s, t_s)
