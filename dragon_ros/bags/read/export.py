"""Write the ticks of a bag as CSV, Parquet or NumPy arrays."""
import csv
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from io import StringIO
from itertools import chain, islice
from pathlib import Path
from typing import IO, Any, Generic, TypeVar

import numpy as np

from dragon_ros.bags.read.frames import BagFrame, frames
from dragon_ros.bags.read.parts import in_parts
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.numerics.types import Array, Floats
from dragon_ros.core.scene import NS
from dragon_ros.core.words import COLUMNS

R = TypeVar('R')
_TICKS = 64         # number of ticks per Parquet row group


class ExportedTicks:
    """Every ``every``-th tick of a dragon in a bag, with the chosen ``handles``; it can be iterated repeatedly.

    ``mapped`` runs jobs, in this process or in others. ``progress(ticks)`` is called with the number of newly exported
    ticks: those read, divided by ``passes``, the number of passes over all ticks.
    """

    def __init__(self, bag: BagReader, namespace: str, every: int, handles: Sequence[int], mapped: Any,
                 progress: Callable[[int], object]) -> None:
        self._bag, self._namespace, self._every = bag, namespace, every
        self._mapped, self._progress = mapped, progress
        self.passes, self._read, self._exported = 1, 0, 0
        self.first = next(frames(bag, namespace))
        self.handles = list(handles)

    def picked(self, pick: 'Callable[[Iterator[BagFrame]], R]') -> 'Iterator[R]':
        """Yield the result of ``pick`` for the ticks of each part.

        Several processes call ``pick``. Raises InputError if the number of handles changes.
        """
        body = _Picked(pick, self._bag.path, self.first.handles_m.shape)
        if self._every == 1:
            for ticks, one in in_parts(self._bag, self._namespace, body, self._mapped):
                yield one
                self._count(ticks)
            return
        chosen = islice(self._all(), 0, None, self._every)
        while some := list(islice(chosen, _TICKS)):
            yield body(iter(some))[1]

    def _all(self) -> Iterator[BagFrame]:
        for some in in_parts(self._bag, self._namespace, list, self._mapped):
            yield from some
            self._count(len(some))

    def _count(self, ticks: int) -> None:
        self._read += ticks
        before, self._exported = self._exported, self._read // self.passes
        self._progress(self._exported - before)


def values_of(frame: BagFrame, handles: list[int]) -> Floats:
    """Return an array (handles, 5) of x and y (m) and vx, vy and speed (m/s); missing velocities are nan."""
    out = np.full((len(handles), 5), np.nan)
    out[:, :2] = frame.handles_m[handles]
    if frame.velocity_m_s is not None:
        out[:, 2:4] = frame.velocity_m_s[handles]
        out[:, 4] = np.hypot(out[:, 2], out[:, 3])
    return out


@dataclass(frozen=True)
class _Picked(Generic[R]):
    """Counts ticks and picks their values; all ticks must have the same number of handles as the first tick."""

    pick: Callable[[Iterator[BagFrame]], R]
    path: Path
    shape: tuple[int, ...]

    def __call__(self, some: Iterator[BagFrame]) -> tuple[int, R]:
        """Return the number of ticks and the picked values."""
        ticks = 0

        def counted() -> Iterator[BagFrame]:
            nonlocal ticks
            for frame in some:
                if frame.handles_m.shape != self.shape:
                    raise InputError(f'{self.path}: {len(frame.handles_m)} handles at {frame.t_ns / NS:.9f} s, '
                                     f'but {self.shape[0]} before; export each part separately')
                yield frame
                ticks += 1
        picked = self.pick(counted())
        return ticks, picked


def _csv(source: ExportedTicks, file: IO[bytes]) -> None:
    file.write(f'{",".join(COLUMNS)}\n'.encode())
    for lines in source.picked(partial(_csv_lines, source.handles)):
        file.write(lines)


def _csv_lines(handles: list[int], some: Iterator[BagFrame]) -> bytes:
    out = StringIO()
    writer = csv.writer(out, lineterminator='\n')
    for frame in some:
        t_s = frame.t_ns / NS
        rows = zip(handles, values_of(frame, handles).tolist(), strict=True)
        writer.writerows([(t_s, handle, *values) for handle, values in rows])
    return out.getvalue().encode()


def _parquet(source: ExportedTicks, file: IO[bytes]) -> None:
    try:
        import pyarrow
        from pyarrow.parquet import ParquetWriter
    except ImportError:
        raise MissingError('--format parquet: pyarrow is not installed; run `pip install pyarrow`, or write csv or npz'
                           ) from None
    schema = pyarrow.schema([('t_ns', pyarrow.int64()), *((name, pyarrow.int32() if name == 'handle' else
                                                           pyarrow.float64()) for name in COLUMNS)])
    rows = chain.from_iterable(source.picked(partial(_times_and_values, source.handles)))
    with ParquetWriter(file, schema, compression='zstd') as writer:
        while some := list(islice(rows, _TICKS)):
            writer.write_table(pyarrow.Table.from_arrays(_columns(some, source.handles), schema=schema))


def _times_and_values(handles: list[int], some: Iterator[BagFrame]) -> list[tuple[int, Array]]:
    return [(frame.t_ns, values_of(frame, handles)) for frame in some]


def _columns(some: list[tuple[int, Array]], handles: list[int]) -> list[Array]:
    """Return the columns for these ticks: t_ns, followed by COLUMNS."""
    t_ns = np.repeat(np.array([t_ns for t_ns, _ in some], np.int64), len(handles))
    values = np.concatenate([values for _, values in some])
    return [t_ns, t_ns / NS, np.tile(np.array(handles, np.int32), len(some)), *values.T]


def _npz(source: ExportedTicks, file: IO[bytes]) -> None:
    """Write each array in a separate pass over the ticks, so that no complete array is ever in memory."""
    first, handles = source.first, source.handles
    names = ['handles_m', *(['velocities_m_s'] if first.velocity_m_s is not None else []),
             *(['bench_centres_m', 'bench_axes'] if first.benches is not None else [])]
    source.passes = 1 + len(names)
    times = np.array(list(chain.from_iterable(source.picked(_times))), np.int64)
    with zipfile.ZipFile(file, 'w', zipfile.ZIP_STORED) as archive:
        _whole(archive, 't_ns', times)
        _whole(archive, 'handle_numbers', np.array(handles, np.int64))
        if first.benches is not None:
            sizes = np.stack((2 * first.benches.half_length, 2 * first.benches.half_width), axis=1)
            _whole(archive, 'bench_sizes_m', sizes)
        for name in names:
            shape = _array(name, handles, first).shape
            _stacked(archive, name, times.size, source.picked(partial(_bytes, name, handles)), shape)


def _times(some: Iterator[BagFrame]) -> list[int]:
    return [frame.t_ns for frame in some]


def _array(name: str, handles: list[int], frame: BagFrame) -> Array:
    """Return the values that a tick adds to an array of doubles."""
    if name == 'handles_m':
        return frame.handles_m[handles]
    if name == 'velocities_m_s':
        velocity: Array = _there(frame, frame.velocity_m_s, 'velocities')
        return velocity[handles]
    benches: Benches = _there(frame, frame.benches, 'benches')
    return benches.centre if name == 'bench_centres_m' else benches.axis


def _bytes(name: str, handles: list[int], some: Iterator[BagFrame]) -> bytes:
    return b''.join(np.ascontiguousarray(_array(name, handles, frame), '<f8').tobytes() for frame in some)


def _there(frame: BagFrame, part: Any, name: str) -> Any:
    if part is None:
        raise InputError(f'the tick at {frame.t_ns / NS:.9f} s has no {name}, unlike other ticks; write csv instead')
    return part


def _whole(archive: zipfile.ZipFile, name: str, values: Array) -> None:
    with archive.open(f'{name}.npy', 'w', force_zip64=True) as entry:
        np.lib.format.write_array(entry, values, allow_pickle=False)


def _stacked(archive: zipfile.ZipFile, name: str, rows: int, values: Iterator[bytes], shape: tuple[int, ...]) -> None:
    """Write an array of doubles, of shape (rows, *shape), part by part."""
    with archive.open(f'{name}.npy', 'w', force_zip64=True) as entry:
        np.lib.format.write_array_header_1_0(
            entry, {'descr': '<f8', 'fortran_order': False, 'shape': (rows, *shape)})
        for value in values:
            entry.write(value)


FORMATS: dict[str, Callable[[ExportedTicks, IO[bytes]], None]] = {'csv': _csv, 'parquet': _parquet, 'npz': _npz}


def export(source: ExportedTicks, path: Path, kind: str, overwrite: bool = False) -> None:
    """Write ticks to a file, which is removed if it is not written completely. Raises MissingError."""
    try:
        with whole_or_none(path, overwrite) as file:
            FORMATS[kind](source, file)
    except FileExistsError:
        raise MissingError(f'{path}: it already exists; give another --output, or --force to replace it') from None
    except OSError as error:
        raise MissingError(f'--output {path}: it cannot be written: {error.strerror}') from None
