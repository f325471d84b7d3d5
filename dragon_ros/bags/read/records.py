"""MCAP records by their offsets; no length is believed before it is held against the file.

The layout is that of the MCAP specification, version 0: a magic, then records of opcode (1 byte), length (8 bytes) and
content, then the magic again. The fields of small records are read by the ``mcap`` package, each from its own bytes.
"""
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from os import SEEK_END
from pathlib import Path
from typing import IO, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Footer

from dragon_ros.core.errors import InputError, MissingError

MAGIC = b'\x89MCAP0\r\n'
HEAD = struct.Struct('<BQ')
FOOTER_BYTES = HEAD.size + 20
MOST_RECORD = 16 * 2**20        # bytes of records that are read whole: schemas, indexes, metadata
T = TypeVar('T')


class BagError(InputError):
    """The file is not a bag that can be read."""


@dataclass(frozen=True)
class Place:
    """Where a record stands: opcode, offset of its first byte, and the length of its content."""

    opcode: int
    offset: int
    length: int

    @property
    def content(self) -> int:
        """Offset of the content."""
        return self.offset + HEAD.size

    @property
    def end(self) -> int:
        """Offset of the next record."""
        return self.content + self.length


class BagFile:
    """One .mcap file, open for reading."""

    def __init__(self, path: Path) -> None:
        """Open it and check its beginning. Raises MissingError or BagError."""
        self.path = path
        self._file = _open(path)
        self.size = self._file.seek(0, SEEK_END)
        if self.read(0, min(self.size, len(MAGIC))) != MAGIC:
            self.close()
            raise BagError(f'{path}: is {f"not an MCAP file ({self.size} bytes)" if self.size else "empty (0 bytes)"}')

    def fault(self, offset: int, what: str) -> BagError:
        """Return the error for damage at an offset."""
        return BagError(f'{self.path}: is damaged at byte {offset} of {self.size}: {what}', offset=offset)

    def read(self, offset: int, length: int) -> bytes:
        """Return bytes; all of them, or BagError."""
        if not 0 <= length <= self.size - offset:
            raise self.fault(offset, f'{length} bytes should follow, {max(0, self.size - offset)} do')
        try:
            self._file.seek(offset)
            data = self._file.read(length)
        except OSError as error:
            raise MissingError(f'{self.path}: cannot be read at byte {offset}: {error.strerror}') from None
        if len(data) != length:
            raise self.fault(offset, f'{length} bytes should follow, {len(data)} do')
        return data

    def place(self, offset: int, end: int | None = None) -> Place:
        """Return the record at an offset. Raises BagError where it does not fit before ``end`` (the file's end)."""
        end = self.size if end is None else min(end, self.size)
        if offset + HEAD.size > end:
            raise self.fault(offset, f'a record should begin, {max(0, end - offset)} bytes are left')
        place = Place(*_at(HEAD.unpack(self.read(offset, HEAD.size)), offset))
        if place.opcode == 0:
            raise self.fault(offset, 'a record of kind 0; there is no such kind')
        if place.end > end:
            raise self.fault(offset, f'a record of kind {place.opcode} claims {place.length} bytes, '
                             f'{end - place.content} are left')
        return place

    def places(self, offset: int, end: int | None = None) -> Iterator[Place]:
        """Yield the records from ``offset`` on, up to exactly ``end`` (the file's end)."""
        end = self.size if end is None else end
        while offset < end:
            place = self.place(offset, end)
            yield place
            offset = place.end

    def fields(self, place: Place, parse: Callable[[ReadDataStream], T]) -> T:
        """Return the fields of a small record, read by ``parse``, one of the ``mcap.records`` readers."""
        if place.length > MOST_RECORD:
            raise self.fault(place.offset, f'a record of kind {place.opcode} has {place.length} bytes; '
                             f'the largest that is read is {MOST_RECORD}')
        try:
            return parse_fields(self.read(place.content, place.length), parse)
        except ValueError as error:
            raise self.fault(place.offset, f'a record of kind {place.opcode}: {error}') from None

    @property
    def closed_properly(self) -> bool:
        """Whether the file ends as a bag does that was closed."""
        tail = FOOTER_BYTES + len(MAGIC)
        return self.size >= len(MAGIC) + tail and self.read(self.size - len(MAGIC), len(MAGIC)) == MAGIC

    def footer(self) -> tuple[Place, Footer]:
        """Return the footer. Raises BagError where the file was cut off or something else stands there."""
        if not self.closed_properly:
            raise BagError(f'{self.path}: was cut off before its end; it has no index ({self.size} bytes)')
        place = self.place(self.size - len(MAGIC) - FOOTER_BYTES, self.size - len(MAGIC))
        if place.opcode != Opcode.FOOTER or place.end != self.size - len(MAGIC):
            raise self.fault(place.offset, 'the footer should stand there')
        return place, self.fields(place, Footer.read)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class _Exact(ReadDataStream):
    """A stream that never returns less than it was asked for."""

    def __init__(self, data: bytes) -> None:
        super().__init__(BytesIO(data))
        self._left = len(data)

    def read(self, length: int) -> bytes:
        if length > self._left:
            raise ValueError(f'a field claims {length} bytes, {self._left} are left')
        self._left -= length
        return super().read(length)


def parse_fields(data: bytes, parse: Callable[[ReadDataStream], T]) -> T:
    """Return the fields in the content of a record. Raises ValueError where they do not fit."""
    return parse(_Exact(data))


def _at(head: tuple[int, int], offset: int) -> tuple[int, int, int]:
    return head[0], offset, head[1]


def _open(path: Path) -> IO[bytes]:
    try:
        if path.exists() and not path.is_file():    # opening a pipe would wait for ever
            raise MissingError(f'{path}: is not a file')
        return path.open('rb')
    except OSError as error:
        raise MissingError(f'{path}: cannot be read: {error.strerror}') from None
