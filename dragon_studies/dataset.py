"""A study's data set: a folder with the study file and its rows as Parquet parts, each complete or absent.

A part contains the rows of one index range and is named after it. Each part is written under a temporary name,
synchronised to disk and renamed, so a killed study, a full disk or a power cut leaves no partial file. The parts of
batches are joined into larger ones, block by block, and then removed. If the study is killed between these two steps,
duplicate rows are ignored until the next run removes them. In the end, each block of ``BLOCK`` rows is one file,
regardless of the sizes of the batches.
"""
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from dragon_ros.cli.inputs import DiskError, InputError, MissingError, counted, lock, read_document, versions
from dragon_studies.definition import Study, as_text, study_of
from dragon_studies.rows import Row, columns_of, parsed

STUDY_FILE, ROWS, LOCK = 'study.yaml', 'rows', '.lock'
BLOCK = 16_384      # number of rows in a joined part
_STUDY = b'dragon_ros.study'     # the key of the metadata that contain the study
_PART = re.compile(r'part-(\d{10})-(\d{10})\.parquet')
_TYPES: dict[type, Any] = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), str: pa.string()}


class RowFile(NamedTuple):
    """A file that contains the rows start <= index < stop."""

    start: int
    stop: int
    path: Path


def schema_of(study: Study) -> pa.Schema:
    """Return the schema of a study's Parquet files; its metadata contain the study."""
    columns = [(name, pa.list_(_TYPES[one.type]) if one.is_list else _TYPES[one.type])
               for name, one in columns_of(study).items()]
    return pa.schema(columns, metadata={_STUDY: study.text.encode()})


def part_of(study: Study, rows: list[Row]) -> bytes:
    """Return rows as the bytes of a Parquet file."""
    return _as_bytes(pa.Table.from_pylist(rows, schema=schema_of(study)))


def _as_bytes(table: pa.Table) -> bytes:
    out = pa.BufferOutputStream()
    pq.write_table(table, out, compression='zstd')
    data: bytes = out.getvalue().to_pybytes()
    return data


class DataSet:
    """The rows of a study in a folder to which a single process writes."""

    def __init__(self, folder: Path, study: Study) -> None:
        """``folder`` must exist."""
        self.folder, self.study = folder, study

    @property
    def parts(self) -> list[RowFile]:
        """The parts in order, except those covered by another part."""
        kept: list[RowFile] = []
        for part in sorted(self._files(), key=lambda one: (one.start, -one.stop)):
            if not kept or part.start >= kept[-1].stop:
                kept.append(part)
        return kept

    def _files(self) -> Iterator[RowFile]:
        try:
            for path in (self.folder / ROWS).iterdir():
                if found := _PART.fullmatch(path.name):
                    yield RowFile(int(found[1]), int(found[2]), path)
        except OSError as error:
            raise MissingError(f'{self.folder / ROWS}: cannot be read: {error.strerror}') from None

    @property
    def count(self) -> int:
        """The number of rows."""
        return sum(part.stop - part.start for part in self.parts)

    @property
    def missing(self) -> list[tuple[int, int]]:
        """The ranges of indices whose rows are missing, as (start, stop) with ``stop`` excluded."""
        out, at = [], 0
        for part in [*self.parts, RowFile(self.study.rows, self.study.rows, Path())]:
            if part.start > at:
                out.append((at, min(part.start, self.study.rows)))
            at = max(at, part.stop)
        return [one for one in out if one[0] < one[1]]

    def table(self, columns: list[str] | None = None) -> pa.Table:
        """Return all rows in order. Raises InputError if a part cannot be read or belongs to another study."""
        schema = schema_of(self.study)
        if columns is not None:
            schema = pa.schema([schema.field(name) for name in columns], metadata=schema.metadata)
        tables = [_read(part, schema) for part in self.parts if part.start < self.study.rows]
        table = pa.concat_tables(tables) if tables else schema.empty_table()
        return table.slice(0, self.study.rows) if len(table) > self.study.rows else table

    def write(self, start: int, stop: int, data: bytes) -> None:
        """Write the rows of a range. Raises DiskError."""
        self._write(RowFile(start, stop, self._path(start, stop)), data)
        block = start // BLOCK * BLOCK
        if start == block and stop - start >= min(BLOCK, self.study.rows - block):
            return
        self._join(block)

    def _path(self, start: int, stop: int) -> Path:
        return self.folder / ROWS / f'part-{start:010d}-{stop:010d}.parquet'

    def _write(self, part: RowFile, data: bytes) -> None:
        temporary = part.path.with_suffix('.tmp')
        try:
            with temporary.open('wb') as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(part.path)
        except OSError as error:
            temporary.unlink(missing_ok=True)
            raise DiskError(f'{part.path}: cannot be written: {error.strerror}; '
                            f'{counted(self.count, "row", "is")} kept; free some space, and start the study again to '
                            'continue') from None

    def _join(self, block: int) -> None:
        """If all rows of a block exist, join its parts into one and remove them."""
        stop = min(block + BLOCK, self.study.rows)
        parts = [part for part in self.parts if block <= part.start < stop]
        if sum(part.stop - part.start for part in parts) == stop - block and len(parts) > 1:
            table = pa.concat_tables([_read(part, schema_of(self.study)) for part in parts])
            self._write(RowFile(block, stop, self._path(block, stop)), _as_bytes(table))
            self.tidy()

    def tidy(self) -> None:
        """Remove the remains of a killed run: unfinished files, and parts covered by another part."""
        kept = {part.path for part in self.parts}
        try:
            for path in (self.folder / ROWS).iterdir():
                if path.suffix == '.tmp' or (_PART.fullmatch(path.name) and path not in kept):
                    path.unlink(missing_ok=True)
        except OSError as error:
            raise DiskError(f'{self.folder / ROWS}: cannot be cleaned up: {error.strerror}') from None

    def check(self) -> None:
        """Reject a part that cannot be read or belongs to another study. Raises InputError."""
        schema = schema_of(self.study)
        for part in self.parts:
            with _named(part):
                _check_study(part, pq.read_schema(part.path), schema)

    def join_blocks(self) -> None:
        """Join the parts of complete blocks that an earlier run did not join."""
        for block in range(0, self.study.rows, BLOCK):
            self._join(block)


def _read(part: RowFile, schema: pa.Schema) -> pa.Table:
    with _named(part):
        table = pq.read_table(part.path, columns=schema.names)
        _check_study(part, table.schema, schema)
        if len(table) != part.stop - part.start:
            raise InputError(f'{part.path}: it has {counted(len(table), "row")} instead of {part.stop - part.start}; '
                             'remove it and start the study again')
        return table.cast(schema)


@contextmanager
def _named(part: RowFile) -> Iterator[None]:
    """Convert an error of reading a part into an InputError that names the part."""
    try:
        yield
    except (OSError, pa.ArrowException, ValueError) as error:
        why = ' '.join(str(error).split())[:200]
        raise InputError(f'{part.path}: cannot be read as rows of this study ({why}); remove it and start the study '
                         'again to recompute its rows') from None


def _check_study(part: RowFile, found: pa.Schema, schema: pa.Schema) -> None:
    """Raise InputError if the metadata of a part describe another study; the number of samples may differ."""
    said, wanted = ((one.metadata or {}).get(_STUDY, b'').decode() for one in (found, schema))
    if said != wanted and (not said or parsed(said).identity != parsed(wanted).identity):
        raise InputError(f'{part.path}: it contains rows of another study; remove it and start the study again to '
                         'compute its rows')


def open_set(folder: Path) -> DataSet:
    """Return the data set in a folder. Raises MissingError or InputError if it contains none."""
    document = read_document(folder / STUDY_FILE)
    return DataSet(folder, study_of(document, None))


@contextmanager
def writing(folder: Path, study: Study) -> Iterator[DataSet]:
    """Yield the data set of a study in a new or existing folder, for one process at a time.

    Raises InputError if the folder contains another study or another process is writing to it, and MissingError or
    DiskError if it is not writable.
    """
    try:
        (folder / ROWS).mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open('wb')
    except OSError as error:
        raise MissingError(f'--output {folder}: cannot be written: {error.strerror}') from None
    with file:
        _lock(file, folder)
        _check_same(folder, study)
        _write_study(folder, study)
        kept = DataSet(folder, study)
        kept.check()
        kept.tidy()
        yield kept


def _lock(file: IO[bytes], folder: Path) -> None:
    try:
        lock(file)
    except OSError:
        raise InputError(f'{folder}: another process is writing this study; wait for it, or give another --output'
                         ) from None


def _check_same(folder: Path, study: Study) -> None:
    """Reject a folder with rows of another study or version; a folder with fewer samples is accepted."""
    path = folder / STUDY_FILE
    if not path.exists():
        if DataSet(folder, study).count:
            raise InputError(f'{folder}: it contains rows, but no {STUDY_FILE} that describes them; give another '
                             '--output')
        return
    document = read_document(path)
    before = study_of(document, None)
    if before.identity != study.identity:
        key = next(key for key, value in study.identity.items() if before.identity[key] != value)
        raise InputError(f'{folder}: it contains rows of another study, which differs in {key}; give another --output, '
                         'or remove the folder', field=key)
    if before.rows > study.rows:
        raise InputError(f'{folder}: it contains a study with {counted(before.samples, "sample")}, but this one has '
                         f'{study.samples}; give at least as many', field='samples')
    made_by = document.section('about').get('dragon_ros')
    if made_by != versions()['dragon_ros']:
        raise InputError(f'{folder}: it contains rows of dragon_ros {made_by}, but this is {versions()["dragon_ros"]}; '
                         'give another --output')


def _write_study(folder: Path, study: Study) -> None:
    """Write the study file with the versions of the software that computes its rows."""
    text = as_text({**study.values, 'about': versions()})
    temporary = folder / f'{STUDY_FILE}.tmp'
    try:
        temporary.write_text(text, encoding='utf-8')
        temporary.replace(folder / STUDY_FILE)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise DiskError(f'{folder / STUDY_FILE}: cannot be written: {error.strerror}') from None
