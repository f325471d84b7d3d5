"""Read every byte of a bag once: what is in it, how far it can be trusted, and what can be saved of it."""
import zlib
from array import array
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import DataEnd, Header

from dragon_ros.bags.check.capped_log import CappedLog
from dragon_ros.bags.read.folder import files_of
from dragon_ros.bags.read.mcap import (
    MAGIC,
    BagError,
    Index,
    McapFile,
    Piece,
    Row,
    chunk_head,
    scanned_index,
    summary_index,
)
from dragon_ros.core.numerics.types import Ints
from dragon_ros.core.scene import NS, Run

MOST_TIMES = 10_000_000     # messages whose times are kept, for rates and gaps
_BLOCK = 2**20
_MOST_RANGES = 20
_REGULAR = 0.8      # a topic has ticks if so many of its steps are the usual one, to a tenth
_LEAST = 3


@dataclass
class TopicSeen:
    """A topic as it was found: type, encoding, messages and their bytes, and their log times in the bag's order."""

    type: str
    encoding: str
    messages: int = 0
    size: int = 0
    times_ns: 'array[int]' = field(default_factory=lambda: array('Q'))


@dataclass
class Contents:
    """What is in the files of a bag; ``problems`` are in words, with offsets; ``notes`` are none."""

    files: list[Path]
    size: int = 0
    writers: list[str] = field(default_factory=list)
    compressions: dict[str, int] = field(default_factory=dict)
    topics: dict[str, TopicSeen] = field(default_factory=dict)
    problems: CappedLog = field(default_factory=CappedLog)
    notes: CappedLog = field(default_factory=CappedLog)
    kept_times: int = 0


def examine(path: Path, progress: Callable[[int], object] = lambda size: None) -> Contents:
    """Return what is in a bag, damaged or not. Raises BagError where it is no bag at all, MissingError."""
    contents = Contents(files_of(path))
    for each in contents.files:
        with closing(McapFile(each)) as file:
            _examine(contents, file, progress)
    return contents


def _examine(contents: Contents, file: McapFile, progress: Callable[[int], object]) -> None:
    contents.size += file.size
    walked = scanned_index(file)
    if walked.damage:
        contents.problems.note(walked.damage)
    contents.writers.append(_writer(file))
    for piece in walked.pieces:
        _survey(contents, walked, piece)
        progress(piece.place.end - piece.place.offset)
    _hold_summary(contents, file, walked)
    if walked.data_end:
        _check_data_crc(contents, file, walked)


def _writer(file: McapFile) -> str:
    """Return profile and library, as the header says."""
    try:
        place = file.place(len(MAGIC))
        header = file.fields(place, Header.read) if place.opcode == Opcode.HEADER else Header('', '')
        return f'{header.profile} {header.library}'.strip()
    except BagError:
        return ''


def _survey(contents: Contents, index: Index, piece: Piece) -> None:
    """Take one piece's messages in."""
    try:
        if piece.place.opcode == Opcode.CHUNK:
            name = chunk_head(piece.file, piece.place).compression or 'none'
            contents.compressions[name] = contents.compressions.get(name, 0) + 1
        for row, _ in index.survey(piece):
            _count(contents, index, row)
    except BagError as error:
        contents.problems.note(error)


def _count(contents: Contents, index: Index, row: Row) -> None:
    channel = index.channels.get(row.channel)
    if channel is None:
        contents.problems.note(f'{index.file.path}: a message on channel {row.channel}, which nothing declares')
        return
    seen = contents.topics.get(channel.topic)
    if seen is None:
        schema = index.schemas.get(channel.schema_id)
        seen = TopicSeen(schema.name if schema else '', channel.message_encoding)
        contents.topics[channel.topic] = seen
    seen.messages += 1
    seen.size += row.end - row.start
    if contents.kept_times < MOST_TIMES:
        contents.kept_times += 1
        seen.times_ns.append(row.t_ns)


def _hold_summary(contents: Contents, file: McapFile, walked: Index) -> None:
    """Note where the summary says something else than the records."""
    if walked.damage and not file.closed_properly:
        return
    try:
        summary = summary_index(file)
    except BagError as error:
        contents.problems.note(error)
        return
    if summary is None:
        contents.notes.note(f'{file.path}: has no complete summary; readers have to walk through the whole file')
        return
    places = {piece.place for piece in walked.pieces}
    for piece in summary.pieces:
        if piece.place not in places:
            contents.problems.note(file.fault(piece.place.offset, 'the index has a chunk there, which it is not'))
    if summary.counts != walked.counts and not walked.damage:
        contents.problems.note(f'{file.path}: the summary counts {sum(summary.counts.values())} messages, the chunks '
                               f'hold {sum(walked.counts.values())}')


def _check_data_crc(contents: Contents, file: McapFile, walked: Index) -> None:
    """Hold the CRC of the whole data section, where a writer gave one."""
    assert walked.data_end is not None
    wanted, crc, end = file.fields(walked.data_end, DataEnd.read).data_section_crc, 0, walked.data_end.offset
    for at in range(0, end if wanted else 0, _BLOCK):
        crc = zlib.crc32(file.read(at, min(_BLOCK, end - at)), crc)
    if wanted and crc != wanted:
        contents.problems.note(file.fault(0, f'the CRC of all data is {crc:08x}; it should be {wanted:08x}'))


@dataclass(frozen=True)
class Gaps:
    """Messages a second, and for a topic with ticks: how many are missing, which, and how many are there twice.

    Ticks are numbered as the run of the scene numbers them, else from the first message; ``ranges`` has the first
    missing ones as (first, last). All but ``rate_hz`` are None where the messages come at no regular times.
    """

    rate_hz: float | None
    first: int | None = None
    last: int | None = None
    missing: int | None = None
    doubled: int | None = None
    ranges: tuple[tuple[int, int], ...] = ()


def gaps_of(times_ns: 'array[int]', run: Run | None) -> Gaps:
    """Return what is missing among the log times of a topic, given in any order."""
    times = np.sort(np.frombuffer(times_ns, np.uint64)).astype(np.float64) if times_ns else np.empty(0)
    span_s = (times[-1] - times[0]) / NS if times.size else 0.0
    rate_hz = float((times.size - 1) / span_s) if span_s > 0 else None
    steps = np.diff(np.unique(times))
    if steps.size + 1 < _LEAST:
        return Gaps(rate_hz)
    usual = float(np.median(steps))
    if np.mean(np.abs(steps - usual) <= 0.1 * usual) < _REGULAR:
        return Gaps(rate_hz)
    start_ns, period_ns = (run.start_ns, NS / run.rate_hz) if run else (times[0], usual)
    ticks: Ints = np.rint((times - start_ns) / period_ns).astype(np.int64)
    return _missing(rate_hz, ticks)


def _missing(rate_hz: float | None, ticks: Ints) -> Gaps:
    there = np.unique(ticks)
    after = np.flatnonzero(np.diff(there) > 1)
    ranges = tuple((int(there[n]) + 1, int(there[n + 1]) - 1) for n in after[:_MOST_RANGES])
    first, last = int(there[0]), int(there[-1])
    return Gaps(rate_hz, first, last, last - first + 1 - there.size, ticks.size - there.size, ranges)
