"""``export``: write the ticks of a bag as CSV, Parquet or NumPy arrays."""
import csv
import zipfile
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from dragon_ros.bags.read.frames import BagFrame, frames, namespace_of
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.cli import command_line
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.ranges import handles_of
from dragon_ros.commands.table import COLUMNS, values_of
from dragon_ros.core.errors import InputError, MissingError
from dragon_ros.core.numerics.types import Array
from dragon_ros.core.scene import NS

_TICKS = 64         # rows per row group of Parquet


def run(arguments: Namespace) -> int:
    """Write the file; return the exit code."""
    if arguments.every < 1:
        raise InputError(f'--every {arguments.every}: give 1 or more', field='every')
    with BagReader(arguments.bag) as bag:
        source = _ExportedTicks(bag, arguments)
        with _created(arguments.output, arguments.force) as file:
            _FORMATS[arguments.format](source, file)
    return command_line.OK


class _ExportedTicks:
    """The ticks to export; they can be iterated repeatedly."""

    def __init__(self, bag: BagReader, arguments: Namespace) -> None:
        self._bag, self._every = bag, arguments.every
        self._namespace = namespace_of(bag, arguments.namespace)
        first = next(frames(bag, self._namespace), None)
        if first is None:
            raise InputError(f'{bag.path}: it has no handles in namespace {self._namespace}')
        self.first = first
        self.handles = handles_of(arguments.handles, len(first.handles_m) - 1)
        self._ticks = next(t.messages for t in bag.topics if t.name == f'{self._namespace}/handles')

    def frames(self, what: str) -> Iterator[BagFrame]:
        """Yield the ticks with a progress bar. Raises InputError if the number of handles changes."""
        shown = Progress(what, 'ticks', self._ticks)(frames(self._bag, self._namespace))
        for frame in islice(shown, 0, None, self._every):
            if frame.handles_m.shape != self.first.handles_m.shape:
                raise InputError(f'{self._bag.path}: {len(frame.handles_m)} handles at {frame.t_ns / NS:.9f} s, '
                                 f'{len(self.first.handles_m)} before; export the parts one by one')
            yield frame


def _csv(source: _ExportedTicks, file: IO[bytes]) -> None:
    writer = csv.writer(_Text(file), lineterminator='\n')
    writer.writerow(COLUMNS)
    for frame in source.frames('csv'):
        t_s = frame.t_ns / NS
        rows = zip(source.handles, values_of(frame, source.handles).tolist(), strict=True)
        writer.writerows([(t_s, handle, *values) for handle, values in rows])


class _Text:
    """A text file over a binary one."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def write(self, text: str) -> int:
        return self._file.write(text.encode())


def _parquet(source: _ExportedTicks, file: IO[bytes]) -> None:
    try:
        import pyarrow
        from pyarrow.parquet import ParquetWriter
    except ImportError:
        raise MissingError('--format parquet: pyarrow is not installed; `pip install pyarrow`, or write csv or npz'
                           ) from None
    schema = pyarrow.schema([('t_ns', pyarrow.int64()), *((name, pyarrow.int32() if name == 'handle' else
                                                           pyarrow.float64()) for name in COLUMNS)])
    shown = source.frames('parquet')
    with ParquetWriter(file, schema, compression='zstd') as writer:
        while some := list(islice(shown, _TICKS)):
            writer.write_table(pyarrow.Table.from_arrays(_columns(some, source.handles), schema=schema))


def _columns(some: list[BagFrame], handles: list[int]) -> list[Array]:
    """Return the columns of some ticks: t_ns, then COLUMNS."""
    t_ns = np.repeat(np.array([frame.t_ns for frame in some], np.int64), len(handles))
    values = np.concatenate([values_of(frame, handles) for frame in some])
    return [t_ns, t_ns / NS, np.tile(np.array(handles, np.int32), len(some)), *values.T]


def _npz(source: _ExportedTicks, file: IO[bytes]) -> None:
    """Write the arrays one by one, each in its own pass, so that no array is ever in memory as a whole."""
    first, handles = source.first, source.handles
    times = np.array([frame.t_ns for frame in source.frames('t_ns')], np.int64)
    parts: dict[str, Callable[[BagFrame], Array]] = {'handles_m': lambda frame: frame.handles_m[handles]}
    if first.velocity_m_s is not None:
        parts['velocities_m_s'] = lambda frame: _there(frame, frame.velocity_m_s, 'velocities')[handles]
    if first.benches is not None:
        parts['bench_centres_m'] = lambda frame: _there(frame, frame.benches, 'benches').centre
        parts['bench_axes'] = lambda frame: _there(frame, frame.benches, 'benches').axis
    with zipfile.ZipFile(file, 'w', zipfile.ZIP_STORED) as archive:
        _whole(archive, 't_ns', times)
        _whole(archive, 'handle_numbers', np.array(handles, np.int64))
        if first.benches is not None:
            sizes = np.stack((2 * first.benches.half_length, 2 * first.benches.half_width), axis=1)
            _whole(archive, 'bench_sizes_m', sizes)
        for name, pick in parts.items():
            _stacked(archive, name, times.size, map(pick, source.frames(name)), pick(first).shape)


def _there(frame: BagFrame, part: Any, name: str) -> Any:
    if part is None:
        raise InputError(f'the tick at {frame.t_ns / NS:.9f} s has no {name}, unlike others; write csv instead')
    return part


def _whole(archive: zipfile.ZipFile, name: str, values: Array) -> None:
    with archive.open(f'{name}.npy', 'w', force_zip64=True) as entry:
        np.lib.format.write_array(entry, values, allow_pickle=False)     # type: ignore[no-untyped-call]


def _stacked(archive: zipfile.ZipFile, name: str, rows: int, values: Iterator[Array], shape: tuple[int, ...]) -> None:
    """Write an array (rows, *shape) of doubles row by row."""
    with archive.open(f'{name}.npy', 'w', force_zip64=True) as entry:
        np.lib.format.write_array_header_1_0(       # type: ignore[no-untyped-call]
            entry, {'descr': '<f8', 'fortran_order': False, 'shape': (rows, *shape)})
        for value in values:
            entry.write(np.ascontiguousarray(value, '<f8').tobytes())


@contextmanager
def _created(path: Path, overwrite: bool) -> Iterator[IO[bytes]]:
    """Create a file, and remove it if writing does not complete."""
    try:
        with whole_or_none(path, overwrite) as file:
            yield file
    except FileExistsError:
        raise MissingError(f'{path}: it already exists; give another --output, or --force to replace it') from None
    except OSError as error:
        raise MissingError(f'--output {path}: it cannot be written: {error.strerror}') from None


_FORMATS: dict[str, Callable[[_ExportedTicks, IO[bytes]], None]] = {'csv': _csv, 'parquet': _parquet, 'npz': _npz}
