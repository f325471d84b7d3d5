"""Bags: recorded runs that are read, checked, exported, written and repaired."""
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import islice
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from dragon_ros.api.simulated import Motion, Progress, given_path, quiet
from dragon_ros.bags.read.frames import (
    BagFrame,
    Walk,
    ends_in_contact,
    frame_of_bag,
    frames,
    namespace_of,
    scene_of_bag,
    surrounded_frames,
    walk_in,
)
from dragon_ros.bags.read.mcap import BagError
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.cli.pool import Pool
from dragon_ros.core.checks import choice, whole
from dragon_ros.core.errors import InputError, naming_arguments
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import read_only
from dragon_ros.core.scene import NS, Scene
from dragon_ros.messages.decode import Status
from dragon_ros.scenes.provenance import RECORD

if TYPE_CHECKING:
    from dragon_ros.bags.check.compare import Comparison
    from dragon_ros.bags.check.repair import Repaired
    from dragon_ros.bags.check.summary import BagSummary
    from dragon_ros.pictures.sources import Touch


class Bag:
    """A recorded run: its scene, and its ticks, which are read lazily. Use it in a ``with`` block, or close it."""

    @naming_arguments()
    def __init__(self, path: str | PathLike[str], namespace: str | None = None, trust: bool = False) -> None:
        """Open a bag (an .mcap file or a rosbag2 folder). Raises InputError unless exactly one dragon is selected."""
        self._reader, self._trust = BagReader(Path(given_path('path', path))), trust
        try:
            self.namespace = namespace_of(self._reader, namespace)
        except InputError:
            self._reader.close()
            raise

    def __enter__(self) -> 'Bag':
        """Return the bag."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Close the bag."""
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    @cached_property
    @naming_arguments()
    def scene(self) -> Scene | None:
        """The scene of the run, or None if the bag has no scene.

        Raises InputError if an untrusted scene exceeds the budgets.
        """
        return scene_of_bag(self._reader, self.namespace, self._trust)

    @cached_property
    @naming_arguments()
    def walk(self) -> Walk | None:
        """The scene of the run, in which a led dragon has the recorded walk, and how much of it is known; or None."""
        return None if self.scene is None else walk_in(self._reader, self.scene, self.namespace)

    @property
    def ticks(self) -> int:
        """The number of recorded ticks."""
        return sum(one.messages for one in self._reader.topics if one.name == f'{self.namespace}/handles')

    @property
    def reader(self) -> BagReader:
        """The underlying reader, which gives access to other topics."""
        return self._reader

    def __iter__(self) -> Iterator[BagFrame]:
        """Yield the ticks in order: stamp, handles, benches, velocities, obstacles.

        Raises InputError if the simulated time goes back, because the bag then holds several runs.
        """
        return surrounded_frames(self._reader, self.namespace)

    def at(self, times_s: Iterable[float]) -> Iterator[BagFrame]:
        """For each time (s) up to the last tick, yield the first tick at or after that time."""
        for t_s in times_s:
            yield from islice(frames(self._reader, self.namespace, max(0, round(t_s * NS))), 1)

    def arrays(self) -> Motion:
        """Return all ticks; velocities that were not recorded are nan. Raises InputError if there are no ticks."""
        rows = list(self)
        if not rows:
            raise InputError(f'{self._reader.path}: it has no ticks')
        blank = np.full_like(rows[0].handles_m, np.nan)
        velocity = np.array([blank if one.velocity_m_s is None else one.velocity_m_s for one in rows])
        promise_m = compile_scene(self.scene).promise_m if self.scene else np.nan
        return Motion(read_only(np.array([one.t_ns for one in rows]) / NS),
                      read_only(np.array([one.handles_m for one in rows])), read_only(velocity), float(promise_m))

    def contact_events(self) -> list[Status]:
        """Return the reports of a monitor about contacts that begin."""
        from dragon_ros.bags.check.contacts import contacts_on
        return list(contacts_on(self._reader, f'{self.namespace}/collision'))

    @naming_arguments()
    def first_touch(self, progress: Progress = quiet) -> 'Touch | None':
        """Return the first contact in the recorded ticks, also with recorded obstacles, or None.

        Its time is interpolated between two ticks. Raises InputError if handles or benches were not recorded.
        """
        from dragon_ros.pictures.sources import dragon_in

        def counted(ticks: Iterable[Any]) -> Iterator[Any]:
            for one in ticks:
                yield one
                progress(1)
        return dragon_in(self._reader, self.namespace).first_touch(counted)

    @naming_arguments()
    def check(self, *, workers: int | None = 1, progress: Progress = quiet) -> 'Comparison':
        """Recompute every tick from the scene, and compare it bit for bit or, if bits differ, within the promise.

        ``workers`` is the number of processes (None: one per core for long work). ``progress(k)`` is called with the
        number of ticks up to the last compared one. Raises InputError if the bag has no scene, or if the contact at
        which the run ends is neither found within the budgets nor proved.
        """
        from dragon_ros.bags.check.compare import compare_with_model
        from dragon_ros.bags.check.contacts import end_in_contact
        if self.scene is None:
            raise BagError(f'{self._reader.path}: it cannot be recomputed without its scene (metadata record {RECORD}, '
                           'key scene, or the topic scene); record the topic scene')
        contact_s, proof = None, None
        if ends_in_contact(self._reader, self.namespace) and not self.scene.is_led:
            contact_s, proof = end_in_contact(self._reader, self.namespace, self.scene, self._trust)
        found = compare_with_model(self._reader, self.scene, self.namespace, lambda k: progress(k + 1),
                                   frame_of_bag(self._reader, self.namespace), contact_s, Pool(workers).in_order)
        found.end_proved = proof
        return found

    @naming_arguments()
    def export(self, path: str | PathLike[str], kind: str = 'csv', *, handles: Sequence[int] | None = None,
               every: int = 1, overwrite: bool = False, workers: int | None = 1, progress: Progress = quiet) -> None:
        """Write the ticks to a file: as rows ('csv', 'parquet') or as arrays that include the benches ('npz').

        ``handles`` are the handles to write (None: all), and ``every`` is n for every nth tick. ``progress(ticks)`` is
        called with the number of newly exported ticks. Raises InputError if the number of handles changes, and
        MissingError if the file cannot be written.
        """
        from dragon_ros.bags.read.export import FORMATS, ExportedTicks, export
        every = whole('every', every, low=1, high=2**31)
        chosen = range(self.handles) if handles is None else [
            whole('handles', one, low=0, high=self.handles - 1) for one in handles]
        source = ExportedTicks(self._reader, self.namespace, every, chosen, Pool(workers).in_order, progress)
        export(source, Path(given_path('path', path)), choice('kind', kind, tuple(FORMATS)), overwrite)

    @cached_property
    def handles(self) -> int:
        """The number of handles in the first tick. Raises InputError if there are no ticks."""
        first = next(frames(self._reader, self.namespace), None)
        if first is None:
            raise InputError(f'{self._reader.path}: it has no handles in namespace {self.namespace}')
        return len(first.handles_m)


def read_bag(path: str | PathLike[str], namespace: str | None = None, trust: bool = False) -> Bag:
    """Open a recorded run.

    ``namespace`` selects one of several dragons; ``trust`` lifts the budgets for the scene.
    """
    return Bag(path, namespace, trust)


@naming_arguments()
def inspect_bag(path: str | PathLike[str], namespace: str | None = None, trust: bool = False, *, looks: int = 200,
                progress: Callable[[str, int], object] = lambda what, more: None) -> 'BagSummary':
    """Return what a bag contains, also a damaged one: topics, missing ticks, scene, first contact, clearance, faults.

    The clearance is computed at ``looks`` ticks (0: all). ``progress(what, more)`` is called with 'bytes', 'states' or
    'ticks', and with the number of newly read ones.
    """
    from dragon_ros.bags.check.summary import summary_of
    return summary_of(Path(given_path('path', path)), namespace, trust, whole('looks', looks, low=0, high=2**31),
                      progress)


@naming_arguments()
def repair_bag(path: str | PathLike[str], output: str | PathLike[str], *, progress: Progress = quiet) -> 'Repaired':
    """Write all readable messages of a damaged bag to a complete one. ``progress(size)`` is called with bytes read."""
    from dragon_ros.bags.check.repair import repair
    return repair(Path(given_path('path', path)), Path(given_path('output', output)), progress)
