"""``export``: write the ticks of a bag as CSV, Parquet or NumPy arrays."""
import csv
import zipfile
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from io import StringIO
from itertools import chain, islice
from pathlib import Path
from typing import IO, Any, Generic, TypeVar

import numpy as np

from dragon_ros.bags.read.frames import BagFrame, frames, namespace_of
from dragon_ros.bags.read.parts import in_parts
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.cli import command_line
from dragon_ros.cli.pool import Pool
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.ranges import handles_of
from dragon_ros.commands.table import COLUMNS, values_of
from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.numerics.types import Array
from dragon_ros.core.scene import NS

R = TypeVar('R')
_TICKS = 64         # number of ticks per Parquet row group


def run(arguments: Namespace) -> int:
    """Write the file; return the exit code."""
    if arguments.every < 1:
        raise InputError(f'--every {arguments.every}: give 1 or more', field='every')
    pool = Pool(arguments.workers)
    with BagReader(arguments.bag) as bag:
        source = _ExportedTicks(bag, arguments, pool)
        with _created(arguments.output, arguments.force) as file:
            _FORMATS[arguments.format](source, file)
    return command_line.OK


class _ExportedTicks:
    """The ticks to export, which can be iterated repeatedly."""

    def __init__(self, bag: BagReader, arguments: Namespace, pool: Pool) -> None:
        self._bag, self._every, self._pool = bag, arguments.every, pool
        self._namespace = namespace_of(bag, arguments.namespace)
        first = next(frames(bag, self._namespace), None)
        if first is None:
            raise InputError(f'{bag.path}: it has no handles in namespace {self._namespace}')
        self.first = first
        self.handles = handles_of(arguments.handles, len(first.handles_m) - 1)
        self._ticks = next(t.messages for t in bag.topics if t.name == f'{self._namespace}/handles')

    def picked(self, what: str, pick: 'Callable[[Iterator[BagFrame]], R]') -> 'Iterator[R]':
        """Yield the result of ``pick`` for the ticks of each part, and show a progress bar.

        Several processes call ``pick``. Raises InputError if the number of handles changes.
        """
        body = _Picked(pick, self._bag.path, self.first.handles_m.shape)
        with Progress(what, 'ticks', self._ticks) as bar:
            if self._every == 1:
                for ticks, one in in_parts(self._bag, self._namespace, body, self._pool.in_order):
                    yield one
                    bar.update(ticks)
                return
            chosen = islice(self._all(bar), 0, None, self._every)
            while some := list(islice(chosen, _TICKS)):
                yield body(iter(some))[1]

    def _all(self, bar: Progress) -> Iterator[BagFrame]:
        for some in in_parts(self._bag, self._namespace, list, self._pool.in_order):
            yield from some
            bar.update(len(some))


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


def _csv(source: _ExportedTicks, file: IO[bytes]) -> None:
    file.write(command_line.csv_of(COLUMNS, ()).encode())
    for lines in source.picked('csv', partial(_csv_lines, source.handles)):
        file.write(lines)


def _csv_lines(handles: list[int], some: Iterator[BagFrame]) -> bytes:
    out = StringIO()
    writer = csv.writer(out, lineterminator='\n')
    for frame in some:
        t_s = frame.t_ns / NS
        rows = zip(handles, values_of(frame, handles).tolist(), strict=True)
        writer.writerows([(t_s, handle, *values) for handle, values in rows])
    return out.getvalue().encode()


def _parquet(source: _ExportedTicks, file: IO[bytes]) -> None:
    try:
        import pyarrow
        from pyarrow.parquet import ParquetWriter
    except ImportError:
        raise MissingError('--format parquet: pyarrow is not installed; run `pip install pyarrow`, or write csv or npz'
                           ) from None
    schema = pyarrow.schema([('t_ns', pyarrow.int64()), *((name, pyarrow.int32() if name == 'handle' else
                                                           pyarrow.float64()) for name in COLUMNS)])
    rows = chain.from_iterable(source.picked('parquet', partial(_times_and_values, source.handles)))
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


def _npz(source: _ExportedTicks, file: IO[bytes]) -> None:
    """Write each array in a separate pass over the ticks, so that no complete array is ever in memory."""
    first, handles = source.first, source.handles
    times = np.array(list(chain.from_iterable(source.picked('t_ns', _times))), np.int64)
    names = ['handles_m', *(['velocities_m_s'] if first.velocity_m_s is not None else []),
             *(['bench_centres_m', 'bench_axes'] if first.benches is not None else [])]
    with zipfile.ZipFile(file, 'w', zipfile.ZIP_STORED) as archive:
        _whole(archive, 't_ns', times)
        _whole(archive, 'handle_numbers', np.array(handles, np.int64))
        if first.benches is not None:
            sizes = np.stack((2 * first.benches.half_length, 2 * first.benches.half_width), axis=1)
            _whole(archive, 'bench_sizes_m', sizes)
        for name in names:
            shape = _array(name, handles, first).shape
            _stacked(archive, name, times.size, source.picked(name, partial(_bytes, name, handles)), shape)


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


@contextmanager
def _created(path: Path, overwrite: bool) -> Iterator[IO[bytes]]:
    """Create a file, and remove it if it is not written completely."""
    try:
        with whole_or_none(path, overwrite) as file:
            yield file
    except FileExistsError:
        raise MissingError(f'{path}: it already exists; give another --output, or --force to replace it') from None
    except OSError as error:
        raise MissingError(f'--output {path}: it cannot be written: {error.strerror}') from None


_FORMATS: dict[str, Callable[[_ExportedTicks, IO[bytes]], None]] = {'csv': _csv, 'parquet': _parquet, 'npz': _npz}
