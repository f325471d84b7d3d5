"""Compute many ticks or instants per call, because numpy's overhead would dominate a call for a single instant."""
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dragon_ros.core.chain.chain import Chain, stack
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats, read_only
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import Frame, frame_of

_BATCH_HANDLES = 2**18      # handles per batch (8 MB with velocities); the cost of the calls dominates smaller batches
_TICK_HANDLES = 2**12       # handles per group of consecutive ticks, few enough for their frames to stay in the cache


def ticks(scene: Scene, first: int, stop: int) -> Iterator[Frame]:
    """Yield the frames of ticks ``first`` to ``stop`` - 1 in order, each bit-identical to the result of ``tick``.

    Axes and rectangles are computed for several ticks together.
    """
    simulation = compile_scene(scene)
    if not 0 <= first <= stop <= simulation.last_tick + 1:
        raise FieldError('ticks', f'{first} to {stop}', f'the run has ticks 0 to {simulation.last_tick}',
                         'give a range of these ticks')
    size = max(1, _TICK_HANDLES // (scene.dragon.benches + 1))
    for begin in range(first, stop, size):
        times_ns = [scene.run.time_ns(k) for k in range(begin, min(begin + size, stop))]
        chains = [simulation.chain(scene.run.seconds(t_ns)) for t_ns in times_ns]
        together = replace(chains[0], p=np.stack([chain.p for chain in chains]))
        axes = axes_of(together)
        all_benches = benches_of(together, scene.dragon, axes) if simulation.on.benches else None
        half = scene.dragon.half_sizes_m
        for n, (t_ns, chain, axis) in enumerate(zip(times_ns, chains, axes, strict=True)):
            benches = Benches(all_benches.centre[n], axis, *half) if all_benches else None
            yield frame_of(simulation, begin + n, t_ns, chain, axis, benches)


def states(scene: Scene, times_s: Sequence[float], out: Floats | None = None) -> Chain:
    """Return the chains at S instants as one Chain with a leading axis; it equals single chains to within the promise.

    If given, ``out`` (shape (S, N+1, 2)) receives the handle positions. Raises FieldError if ``out`` does not fit.
    """
    simulation = compile_scene(scene)
    if out is not None:
        _check_room(out, (len(times_s), scene.dragon.benches + 1, 2))
    if simulation.is_paper:
        chain = stack([simulation.chain(t_s) for t_s in list(times_s) or [0.0]], len(times_s))
        if out is None:
            return chain
        out[:] = chain.p
        return replace(chain, p=read_only(out.view()))
    times = np.asarray(times_s, dtype=np.float64)
    simulation.check_times(times)
    return simulation.model.place_many(scene.head.travelled_m(times), out)


def velocity_of(scene: Scene, chain: Chain, t_s: float | Sequence[float], out: Floats | None = None) -> Floats:
    """Return the velocities of all handles (m/s, shape (..., N+1, 2)), either at one time or at many times.

    If given, ``out`` is an array of the same shape that receives the velocities. Raises FieldError if ``out`` does not
    fit.
    """
    if out is not None:
        _check_room(out, chain.p.shape)
    if isinstance(t_s, Sequence):
        return chain.velocities(np.array([scene.head.speed_at_m_s(t) for t in t_s]), out)
    return chain.velocities(scene.head.speed_at_m_s(t_s), out)


class Batch(NamedTuple):
    """S instants: their times (s), and the positions (m) and velocities (m/s) of all handles, shape (S, N+1, 2)."""

    t_s: Floats
    handles_m: Floats
    velocity_m_s: Floats


def batches(scene: Scene, times_s: Sequence[float], size: int | None = None) -> Iterator[Batch]:
    """Yield many instants, ``size`` at a time, in memory that the next batch reuses: copy what you want to keep.

    Allocating new memory would take as long as the computation. By default, a batch is about as large as a CPU cache.
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
        raise FieldError('out', f'{out.dtype} {out.shape}', f'the result has shape {shape}',
                         'give a writable array of that shape, float64 in C order')
