"""Read every byte of a bag once, and report its contents, its integrity and the gaps in its topics."""
import zlib
from array import array
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Header

from dragon_ros.bags.check.capped_log import CappedLog
from dragon_ros.bags.read.folder import files_of, unlisted
from dragon_ros.bags.read.mcap import (
    MAGIC,
    BagError,
    Index,
    McapFile,
    MessageBatch,
    StoredMessage,
    chunk_head,
    is_indexed,
    scanned_index,
    summary_index,
)
from dragon_ros.core.errors import InputError
from dragon_ros.core.limits import CHECKED_TIMES
from dragon_ros.core.numerics.types import Ints, distinct
from dragon_ros.core.scene import NS, Run
from dragon_ros.messages.length import LengthCheck
from dragon_ros.messages.schemas import is_schema_of

_BLOCK = 2**20
_MOST_RANGES = 20
_REGULAR = 0.8      # a topic has ticks if at least this fraction of its steps is within 10 % of the median step
_LEAST = 3
Checks = dict[int, LengthCheck | str]       # by channel: its length check, or the reason why it has none


@dataclass
class TopicSeen:
    """A topic of a bag: the type, encoding, count and total size of its messages, and their log times in file order.

    ``measured`` is the number of messages whose length was checked against their type; ``unmeasured`` is the reason why
    the other messages were not checked.
    """

    type: str
    encoding: str
    messages: int = 0
    size: int = 0
    times_ns: 'array[int]' = field(default_factory=lambda: array('Q'))
    measured: int = 0
    unmeasured: str = ''


@dataclass
class Contents:
    """The contents of a bag's files; ``problems`` lists faults, and ``notes`` lists harmless observations."""

    files: list[Path]
    size: int = 0
    writers: list[str] = field(default_factory=list)
    compressions: dict[str, int] = field(default_factory=dict)
    topics: dict[str, TopicSeen] = field(default_factory=dict)
    problems: CappedLog = field(default_factory=CappedLog)
    notes: CappedLog = field(default_factory=CappedLog)
    kept_times: int = 0


def examine(path: Path, progress: Callable[[int], object] = lambda size: None) -> Contents:
    """Return the contents of a bag, damaged or not. Raises BagError (not a bag) or MissingError."""
    contents = Contents(files_of(path))
    for each in contents.files:
        try:
            file = McapFile(each)
        except InputError as error:
            if len(contents.files) == 1:
                raise
            contents.problems.note(error)       # the recorder was killed just after it began this part
            continue
        with closing(file):
            _examine(contents, file, progress)
    for each in unlisted(path):
        contents.problems.note(f'{each}: is not listed in metadata.yaml, probably because its recorder was killed: '
                               '`inspect BAG --repair OUT` writes all parts to a complete bag')
    return contents


def _examine(contents: Contents, file: McapFile, progress: Callable[[int], object]) -> None:
    contents.size += file.size
    scanned = scanned_index(file)
    for fault in (*scanned.faults, *([scanned.damage] if scanned.damage else ())):
        contents.problems.note(fault)
    contents.problems.count += scanned.fault_count - len(scanned.faults)
    for place in scanned.stray:
        contents.problems.note(file.fault(place.offset, 'the data section ends there, but other records follow'))
    contents.writers.append(_writer(file))
    checks: Checks = {}
    for batch in scanned.batches:
        _survey(contents, scanned, batch, checks)
        progress(batch.place.end - batch.place.offset)
    for line in scanned.lacking:
        contents.problems.note(f'{file.path}: is damaged: {line}')
    _hold_summary(contents, file, scanned)
    if scanned.data_end:
        _check_data_crc(contents, file, scanned)


def _writer(file: McapFile) -> str:
    """Return the profile and the library named in the header."""
    try:
        place = file.place(len(MAGIC))
        header = file.fields(place, Header.read) if place.opcode == Opcode.HEADER else Header('', '')
        return f'{header.profile} {header.library}'.strip()
    except BagError:
        return ''


def _survey(contents: Contents, index: Index, batch: MessageBatch, checks: Checks) -> None:
    """Count the messages of one batch, and check their lengths."""
    try:
        if batch.place.opcode == Opcode.CHUNK:
            name = chunk_head(batch.file, batch.place).compression or 'none'
            contents.compressions[name] = contents.compressions.get(name, 0) + 1
        for row, data in index.survey(batch):
            if seen := _count(contents, index, row):
                _measure(contents, index, checks, seen, row, data)
    except BagError as error:
        contents.problems.note(error)


def _count(contents: Contents, index: Index, row: StoredMessage) -> TopicSeen | None:
    """Count a message; return its topic, or None if its channel is not declared."""
    channel = index.channels.get(row.channel)
    if channel is None:
        contents.problems.note(f'{index.file.path}: a message on the undeclared channel {row.channel}')
        return None
    seen = contents.topics.get(channel.topic)
    if seen is None:
        schema = index.schemas.get(channel.schema_id)
        seen = TopicSeen(schema.name if schema else '', channel.message_encoding)
        contents.topics[channel.topic] = seen
    seen.messages += 1
    seen.size += row.end - row.start
    if contents.kept_times < CHECKED_TIMES:
        contents.kept_times += 1
        seen.times_ns.append(row.t_ns)
    return seen


def _measure(contents: Contents, index: Index, checks: Checks, seen: TopicSeen, row: StoredMessage,
             data: bytes) -> None:
    """Check the length of a message against its type."""
    if row.channel not in checks:
        checks[row.channel] = _check_of(index, index.channels[row.channel])
    check = checks[row.channel]
    if isinstance(check, str):
        seen.unmeasured = check
        return
    seen.measured += 1
    if fault := check.fault(data[row.start:row.end]):
        contents.problems.note(f'{index.file.path}: {index.channels[row.channel].topic} at {row.t_ns} ns: {fault}')


def _check_of(index: Index, channel: Channel) -> LengthCheck | str:
    """Return the length check for a channel, or the reason why there is none."""
    schema = index.schemas.get(channel.schema_id)
    if schema is None:
        return 'no schema'
    if channel.message_encoding != 'cdr' or schema.encoding != 'ros2msg':
        return f'{channel.message_encoding or "no encoding"} with a {schema.encoding or "missing"} schema'
    if not is_schema_of(schema.name, schema.data.decode(errors='replace')):
        return f'the schema of {schema.name} is not known here'
    return LengthCheck(schema.name)


def _hold_summary(contents: Contents, file: McapFile, scanned: Index) -> None:
    """Report contradictions between the summary and the records."""
    if scanned.damage and not file.closed_properly:
        return
    try:
        summary = summary_index(file)
    except BagError as error:
        contents.problems.note(error)
        return
    if summary is None or not is_indexed(scanned, summary):
        contents.notes.note(f'{file.path}: has no complete summary; readers must scan the whole file')
    if summary is None:
        return
    for line in [] if scanned.lacking else summary.lacking:
        contents.problems.note(f'{file.path}: the summary: {line}')
    places = {batch.place for batch in scanned.batches}
    for batch in summary.batches:
        if batch.place not in places:
            contents.problems.note(file.fault(batch.place.offset, 'the index lists a chunk there, but there is none'))
    said, found = summary.statistics, +scanned.counts
    if said is None or scanned.damage:
        return
    if said.message_count != found.total():
        contents.problems.note(f'{file.path}: according to the summary, the number of messages is '
                               f'{said.message_count}; it is {found.total()}')
    elif summary.counts:
        wrong = (number for number in sorted({*found, *summary.counts}) if found[number] != summary.counts[number])
        for number in wrong:
            contents.problems.note(f'{file.path}: according to the summary, the number of messages on channel {number} '
                                   f'is {summary.counts[number]}; it is {found[number]}')


def _check_data_crc(contents: Contents, file: McapFile, scanned: Index) -> None:
    """Check the CRC of the whole data section if the writer stored one."""
    assert scanned.data_end is not None
    wanted, crc, end = file.fields(scanned.data_end, DataEnd.read).data_section_crc, 0, scanned.data_end.offset
    for at in range(0, end if wanted else 0, _BLOCK):
        crc = zlib.crc32(file.read(at, min(_BLOCK, end - at)), crc)
    if wanted and crc != wanted:
        contents.problems.note(file.fault(0, f'the CRC of the data section is {crc:08x}; it should be {wanted:08x}'))


@dataclass(frozen=True)
class Gaps:
    """The message rate of a topic and, if it has ticks, its missing ticks and the number of duplicate messages.

    Ticks are numbered as in the scene's run or, if the bag has no scene, from the first message; ``ranges`` lists the
    first missing ticks as (first, last). If messages are irregularly spaced, all fields except ``rate_hz`` are None.
    """

    rate_hz: float | None
    first: int | None = None
    last: int | None = None
    missing: int | None = None
    doubled: int | None = None
    ranges: tuple[tuple[int, int], ...] = ()


def gaps_of(times_ns: 'array[int]', run: Run | None, each_tick: bool = True) -> Gaps:
    """Return the gaps in a topic's log times, given in any order; without ``each_tick``, return only the rate."""
    times = np.sort(np.frombuffer(times_ns, np.uint64)).astype(np.float64) if times_ns else np.empty(0)
    span_s = (times[-1] - times[0]) / NS if times.size else 0.0
    rate_hz = float((times.size - 1) / span_s) if span_s > 0 else None
    steps = np.diff(distinct(times))
    if not each_tick or steps.size + 1 < _LEAST:
        return Gaps(rate_hz)
    usual = float(np.mean(np.sort(steps)[(steps.size - 1) // 2:steps.size // 2 + 1]))     # median step
    if np.mean(np.abs(steps - usual) <= 0.1 * usual) < _REGULAR:
        return Gaps(rate_hz)
    start_ns, period_ns = (run.start_ns, NS / run.rate_hz) if run else (times[0], usual)
    ticks: Ints = np.rint((times - start_ns) / period_ns).astype(np.int64)
    return _missing(rate_hz, ticks)


def _missing(rate_hz: float | None, ticks: Ints) -> Gaps:
    there = distinct(ticks)
    after = np.flatnonzero(np.diff(there) > 1)
    ranges = tuple((int(there[n]) + 1, int(there[n + 1]) - 1) for n in after[:_MOST_RANGES])
    first, last = int(there[0]), int(there[-1])
    return Gaps(rate_hz, first, last, last - first + 1 - there.size, ticks.size - there.size, ranges)
