"""Write the bag of a scene, without ROS and as fast as the machine allows."""
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from threading import Event
from typing import Any

from dragon_ros.bags.write.mcap import (
    CHUNK_BYTES,
    MESSAGE_BYTES,
    MESSAGE_HEAD_BYTES,
    PackedChunk,
    Packer,
    RepeatedChunk,
)
from dragon_ros.bags.write.writer import BagOptions, BagWriter, prompt_switches
from dragon_ros.core.batches import ticks
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import Room, string_message
from dragon_ros.messages.channels import channels, live
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.fixed_size import Encode, FixedSize, Together
from dragon_ros.messages.latched import latched_messages
from dragon_ros.scenes import provenance

_FRAME_ID = 'dragon'
_CHUNKS = 4     # largest number of chunks per job; sending a job to a process takes a tenth of the time for a chunk
_JOBS = 8       # smallest number of jobs per process if there are enough chunks, so that all processes end together


def write_bag(scene: Scene, path: Path, *, overwrite: bool = False, namespace: str = '/dragon',
              compression: str = 'zstd', workers: int = 1, in_order: Any = map, stop: Event | None = None,
              progress: Callable[[int], object] = lambda ticks: None) -> int:
    """Write the bag of a scene, and return the number of ticks written, which is smaller if ``stop`` was set.

    ``in_order(work, jobs)`` runs jobs in other processes if there are several ``workers``. ``progress(ticks)`` is
    called with the number of newly written ticks.
    """
    tick(scene, 0)      # rejects a scene that cannot be simulated, before an existing bag is replaced
    with prompt_switches(), BagWriter(path, overwrite, BagOptions(compression), workers == 1) as bag:
        _introduce(scene, bag, namespace)
        return simulate(scene, bag, namespace, stop or Event(), workers, in_order, progress)


def _introduce(scene: Scene, bag: BagWriter, namespace: str) -> None:
    """Write the provenance of the run as `sim` and `record` do: metadata, attachment and latched topics."""
    text = provenance.scene_file(scene, {'frame_id': _FRAME_ID})
    settings = {key: str(value) for key, value in vars(bag.options).items()}
    bag.describe(provenance.RECORD, provenance.run_metadata(text, scene, settings | provenance.versions()))
    bag.attach(provenance.ATTACHMENT, 'application/yaml', text.encode())
    latched = {**latched_messages(scene, _FRAME_ID), 'scene': string_message(text)}
    for name in (*latched, *(row.name for row in live(scene.effects))):
        bag.add_channel(f'{namespace}/{name}', channels()[name])
    for name, data in latched.items():
        bag.write(f'{namespace}/{name}', data, scene.run.start_ns, 1)
    bag.flush()


def simulate(scene: Scene, bag: BagWriter, namespace: str, stop: Event, workers: int = 1, in_order: Any = map,
             progress: Callable[[int], object] = lambda ticks: None) -> int:
    """Write the messages of every tick of the run until ``stop`` is set; return the number of written ticks.

    The size of the first tick determines the ticks at which chunks begin, so a bag has the same bytes with any number
    of workers. A single worker runs in this process and compresses on a thread. Several workers run in separate
    processes.
    """
    encoded = {f'{namespace}/{name}': encode for name, encode in encoders(scene, _FRAME_ID).items()}
    numbers, frame = {bag.channel_of(topic): encode for topic, encode in encoded.items()}, tick(scene, 0)
    size = sum(MESSAGE_HEAD_BYTES + len(encode(frame)) for encode in encoded.values())
    count = compile_scene(scene).last_tick + 1
    each = max(1, CHUNK_BYTES // size)
    parts = [(first, min(first + each, count)) for first in range(0, count, each)]
    if workers == 1 and (filled := _filled(scene, numbers, each)):
        return _filled_here(filled, bag, parts, stop, progress)
    if workers == 1 or size > MESSAGE_BYTES:
        return _in_this_process(scene, bag, encoded, parts, stop, progress)
    done = 0
    every = min(_CHUNKS, 1 + len(parts) // (_JOBS * workers))
    jobs = [parts[n:n + every] for n in range(0, len(parts), every)]
    made = in_order(_PackedTicks(scene, list(numbers), each, bag.options.compression), jobs)
    with closing(made):
        for (*_, (_, end)), chunks in zip(jobs, made, strict=True):
            for chunk in chunks:
                bag.write_chunk(chunk)
            progress(end - done)
            done = end
            if stop.is_set():
                break
    return done


def _in_this_process(scene: Scene, bag: BagWriter, encoded: dict[str, Encode], parts: list[tuple[int, int]],
                     stop: Event, progress: Callable[[int], object]) -> int:
    for first, end in parts:
        for k, frame in enumerate(ticks(scene, first, end), first):
            if stop.is_set():
                return k
            for topic, encode in encoded.items():
                bag.write(topic, encode(frame), frame.t_ns, k + 1)
        bag.end_chunk()
        progress(end - first)
    return parts[-1][1]


class _FilledTicks:
    """Fills chunks with the ticks of a scene, by patching the messages of all ticks of a chunk together, in place."""

    def __init__(self, scene: Scene, encoded: dict[int, FixedSize], each: int) -> None:
        """``encoded`` holds the encoders by channel, and ``each`` is the largest number of ticks in a chunk."""
        frame = tick(scene, 0)
        self._scene, self._encoders = scene, list(encoded.values())
        self._chunks = [RepeatedChunk([(number, encode(frame)) for number, encode in encoded.items()], each)
                        for _ in range(2)]

    def __call__(self, first: int, stop: int) -> RepeatedChunk:
        """Return a chunk with ticks ``first`` to ``stop`` - 1, which stays as it is until the next call but one."""
        self._chunks.reverse()
        chunk, together = self._chunks[0], Together(list(ticks(self._scene, first, stop)))
        starts = chunk.begin([frame.t_ns for frame in together.frames], first + 1)
        for encode, start in zip(self._encoders, starts, strict=True):
            encode.fill(Room(chunk.data, stop - first, start, chunk.stride), together)
        return chunk


def _filled(scene: Scene, encoded: dict[int, Encode], each: int) -> _FilledTicks | None:
    """Return what fills chunks of up to ``each`` ticks, or None if a chunk has a single tick or some sizes vary."""
    fixed = {number: encode for number, encode in encoded.items() if isinstance(encode, FixedSize)}
    return _FilledTicks(scene, fixed, each) if each > 1 and len(fixed) == len(encoded) else None


def _filled_here(filled: _FilledTicks, bag: BagWriter, parts: list[tuple[int, int]], stop: Event,
                 progress: Callable[[int], object]) -> int:
    for first, end in parts:
        if stop.is_set():
            return first
        bag.write_filled(filled(first, end))
        progress(end - first)
    return parts[-1][1]


class _PackedTicks:
    """Packs the ticks of a scene into chunks; every process of ``simulate`` does this work."""

    def __init__(self, scene: Scene, numbers: list[int], each: int, compression: str) -> None:
        """``numbers`` are the channels, and ``each`` is the largest number of ticks in a chunk."""
        self._settings = scene, numbers, each, compression
        self._scene, self._packer = scene, Packer(compression)
        self._encoders = dict(zip(numbers, encoders(scene, _FRAME_ID).values(), strict=True))
        self._filled = _filled(scene, self._encoders, each)

    def __reduce__(self) -> tuple[type['_PackedTicks'], tuple[Scene, list[int], int, str]]:
        """Return the class and the arguments with which another process creates its own instance."""
        return _PackedTicks, self._settings

    def __call__(self, parts: list[tuple[int, int]]) -> list[PackedChunk]:
        """Return the chunks for parts of the run; a part is given by its first tick and the first tick after it."""
        if self._filled is not None:
            return [self._packer.packed(self._filled(*part)) for part in parts]
        return [chunk for part in parts for chunk in self._packer.pack(
            (number, encode(frame), frame.t_ns, k) for k, frame in enumerate(ticks(self._scene, *part), part[0] + 1)
            for number, encode in self._encoders.items())]
