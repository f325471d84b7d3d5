"""Reads bags (single MCAP files or rosbag2 folders) in chronological order and in bounded memory."""
from array import array
from bisect import bisect_left
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from heapq import heappop, heappush
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from mcap.records import Attachment, Channel, Metadata

from dragon_ros.bags.read.folder import files_of
from dragon_ros.bags.read.mcap import (
    BagError,
    Index,
    McapFile,
    MessageBatch,
    OtherRecord,
    StoredMessage,
    is_indexed,
    row_of,
    scanned_index,
    summary_index,
)
from dragon_ros.core.limits import OPEN_CHUNKS_BYTES, QOS_CHARACTERS
from dragon_ros.core.words import counted
from dragon_ros.scenes.yaml import values_of

__all__ = ['BagError', 'BagReader', 'Message', 'Topic']
END_OF_TIME_NS = 2**64
_SPAN_BYTES = 2**20     # minimum size of a span in the file; reading it takes tens of milliseconds
_MOST_SPANS = 2000      # limit on the number of spans, since each span searches all batches


@dataclass(frozen=True)
class Message:
    """One message of a bag; ``t_ns`` is its log time."""

    topic: str
    data: bytes
    t_ns: int
    sequence: int
    publish_ns: int


@dataclass(frozen=True)
class Topic:
    """One topic of a bag: its full name, type, encoding, QoS as in rosbag2, and number of messages."""

    name: str
    type: str
    encoding: str
    qos: dict[str, Any]
    messages: int


class BagReader:
    """Reads a complete bag or, with ``damaged``, the intact batches of a damaged one."""

    def __init__(self, path: Path, damaged: bool = False) -> None:
        """Open a bag and read its index. Raises MissingError or BagError."""
        self.path, self._damaged = path, damaged
        self._indexes: list[Index] = []
        try:
            files = files_of(path)
            for each in files:
                with suppress(BagError) if damaged and len(files) > 1 else nullcontext():
                    self._indexes.append((_readable if damaged else _index_of)(_opened(each, path)))
            self._take()
        except BaseException:
            self.close()
            raise

    def _take(self) -> None:
        """Collect topics and times from the indexes."""
        self._by_file = rows = {index.file: index for index in self._indexes}
        self._names = {file: {number: channel.topic for number, channel in index.channels.items()}
                       for file, index in rows.items()}
        self.topics = _topics([(index, channel) for index in self._indexes for channel in index.channels.values()])
        for topic in self.topics:
            if topic.encoding != 'cdr':
                raise BagError(f'{self.path}: topic {topic.name} has the message encoding '
                               f'{topic.encoding or "unknown"}; only cdr can be played')
        spans = [span for index in self._indexes for span in _spans(index)]
        self.empty = not sum(topic.messages for topic in self.topics) or not spans
        if self.empty and not self._damaged:
            raise BagError(f'{self.path}: is empty: it has no messages')
        self.start_ns = min((start for start, _ in spans), default=0)
        self.end_ns = max((end for _, end in spans), default=0)

    def __reduce__(self) -> tuple[type['BagReader'], tuple[Path, bool]]:
        """Pickle the path, so that another process opens the bag itself."""
        return BagReader, (self.path, self._damaged)

    @property
    def files(self) -> list[Path]:
        """The files of the bag."""
        return [index.file.path for index in self._indexes]

    def messages(self, topics: list[str] | None = None, start_ns: int | None = None,
                 end_ns: int | None = None) -> Iterator[Message]:
        """Yield messages with start_ns <= t < end_ns, in order of log time. Raises BagError on reaching damage."""
        wanted = None if topics is None else set(topics)

        def choose(batch: MessageBatch, row: StoredMessage) -> bool:
            return wanted is None or self._name(batch, row) in wanted
        batches = [batch for index in self._indexes for batch in index.batches]
        last_ns = END_OF_TIME_NS if end_ns is None else end_ns
        for batch, row, data in TimeOrder(batches, choose, self._learn).between(start_ns or 0, last_ns):
            yield Message(self._name(batch, row), data[row.start:row.end], row.t_ns, row.sequence, row.publish_ns)

    def spans(self, start_ns: int, end_ns: int) -> list[tuple[int, int]]:
        """Return consecutive spans of time from start_ns to end_ns with about equal shares of the bag's bytes.

        Each span begins where a batch begins, so that few batches belong to two spans.
        """
        starts = sorted((batch.start_ns, batch.place.length) for index in self._indexes for batch in index.batches)
        each = max(_SPAN_BYTES, sum(size for _, size in starts) // _MOST_SPANS)
        cuts, more = [start_ns], 0
        for batch_ns, size in starts:
            if more >= each and cuts[-1] < batch_ns < end_ns:
                cuts.append(batch_ns)
                more = 0
            more += size
        return list(zip(cuts, [*cuts[1:], end_ns], strict=True))

    def _learn(self, batch: MessageBatch, record: OtherRecord, data: bytes) -> None:
        """Check the schemas and channels in a chunk against the index. Raises BagError."""
        self._by_file[batch.file].learn_inside(batch, record, data)

    def _name(self, batch: MessageBatch, row: StoredMessage) -> str:
        try:
            return self._names[batch.file][row.channel]
        except KeyError:
            raise batch.file.fault(batch.place.offset, f'a message on channel {row.channel}, which is '
                                   'not declared') from None

    def metadata(self, name: str) -> dict[str, str]:
        """Return the first metadata record with the given name, or {} if there is none. Raises BagError."""
        for index in self._indexes:
            for place in index.metadata:
                record = index.file.fields(place, Metadata.read)
                if record.name == name:
                    return dict(record.metadata)
        return {}

    def attachment(self, name: str) -> bytes | None:
        """Return the first attachment with the given name that is small enough to read, or None if there is none."""
        for index in self._indexes:
            for place in index.attachments:
                with suppress(BagError):
                    record = index.file.fields(place, Attachment.read)
                    if record.name == name:
                        return bytes(record.data)
        return None

    def close(self) -> None:
        """Close the files."""
        for index in self._indexes:
            index.file.close()

    def __enter__(self) -> 'BagReader':
        """Return the reader, for a ``with`` block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close at the end of the block."""
        self.close()


def _opened(file: Path, bag: Path) -> McapFile:
    """Return a file of a bag. Raises MissingError or BagError."""
    try:
        return McapFile(file)
    except BagError as error:
        if file == bag:
            raise
        raise BagError(f'{error}; `inspect BAG --repair OUT` writes the other parts to a complete bag') from None


def _index_of(file: McapFile) -> Index:
    """Return the index of a complete file; count its messages unless a consistent summary states their number."""
    index = None
    try:
        summary, index = summary_index(file), scanned_index(file)
        if index.damage or index.faults:
            raise index.damage or index.faults[0]
        if summary is not None and is_indexed(index, summary):
            index.counts.update(summary.counts)
        else:
            _survey(index)
        if index.lacking:
            raise BagError(f'{file.path}: is damaged: {index.lacking[0]}')
        return index
    except BagError as error:
        readable = (scanned_index(file) if index is None else index).batches
        reach = readable[-1].place.end if readable else 0
        file.close()
        to = '`inspect BAG --repair OUT` writes'
        if readable:
            cure = f'{counted(len(readable), "chunk")}, up to byte {reach}, can be read: {to} them to a complete bag'
        else:
            cure = ('none of its messages can be read; '
                    f'if the bag has other files, {to} their messages to a complete bag; otherwise, record it again')
        raise BagError(f'{error}; {cure}', **error.fields) from None


def _survey(index: Index) -> None:
    """Count the messages of each batch by opening it, and omit empty batches. Raises BagError."""
    batches, index.batches = index.batches, []
    for batch in batches:
        if sum(1 for _ in index.survey(batch)):
            index.batches.append(replace(batch, messages=None))


def _readable(file: McapFile) -> Index:
    """Return an index of the intact batches in a damaged file."""
    index = scanned_index(file)
    batches, index.batches = index.batches, []
    for batch in batches:
        with suppress(BagError):
            for _ in index.survey(batch):
                pass
            index.batches.append(replace(batch, messages=None))
    return index


def _spans(index: Index) -> list[tuple[int, int]]:
    """Return the time ranges (ns) of a file's batches."""
    return [(batch.start_ns, batch.end_ns) for batch in index.batches if batch.messages != 0]


def _topics(channels: list[tuple[Index, Channel]]) -> list[Topic]:
    """Return the topics of all channels; channels with the same name form one topic."""
    out: dict[str, Topic] = {}
    for index, channel in channels:
        schema = index.schemas.get(channel.schema_id)
        before = out.get(channel.topic)
        messages = index.counts[channel.id] + (before.messages if before else 0)
        out[channel.topic] = Topic(channel.topic, schema.name if schema else '', channel.message_encoding,
                                   qos_of(channel.metadata), messages)
    return list(out.values())


def qos_of(metadata: dict[str, str]) -> dict[str, Any]:
    """Return the first QoS profile of a channel, or {} if none is readable."""
    text = metadata.get('offered_qos_profiles', '')
    return dict(_first_profile(text)) if len(text) <= QOS_CHARACTERS else {}


@lru_cache(maxsize=64)      # the channels of a bag share a few profiles, and parsing one takes milliseconds
def _first_profile(text: str) -> dict[str, Any]:
    try:
        profiles = values_of(text)
        return dict(profiles[0]) if profiles else {}
    except (yaml.YAMLError, TypeError, ValueError, KeyError, RecursionError):
        return {}


class ChosenMessage(NamedTuple):
    """A message and the records that contain it."""

    batch: MessageBatch
    row: StoredMessage
    data: bytes


class _OpenBatch(NamedTuple):
    """The records of a batch, and the times and offsets of the accepted messages, ordered by time."""

    data: bytes
    times: 'array[int]'
    starts: 'array[int]'
    ends: 'array[int]'

    @property
    def size(self) -> int:
        return len(self.data) + 24 * len(self.times)


class TimeOrder:
    """Yields the messages that ``choose`` accepts, ordered by time and then by position in the file.

    ``learn`` receives all records other than messages, and raises BagError if a record contradicts the index.
    """

    def __init__(self, batches: Sequence[MessageBatch], choose: Callable[[MessageBatch, StoredMessage], bool],
                 learn: Callable[[MessageBatch, OtherRecord, bytes], None]) -> None:
        """``batches`` must be in file order."""
        self._pieces, self._choose, self._learn = batches, choose, learn
        self._open: OrderedDict[int, _OpenBatch] = OrderedDict()

    def between(self, start_ns: int, end_ns: int) -> Iterator[ChosenMessage]:
        """Yield messages with start_ns <= t < end_ns. Raises BagError if a chunk is damaged."""
        waiting = deque(sorted((batch.start_ns, number) for number, batch in enumerate(self._pieces)
                               if batch.end_ns >= start_ns and batch.start_ns < end_ns))
        heap: list[tuple[int, int, int]] = []
        while waiting or heap:
            while waiting and (not heap or waiting[0][0] <= heap[0][0]):
                number = waiting.popleft()[1]
                self._push(heap, number, bisect_left(self._opened(number).times, start_ns), end_ns)
            if heap:
                _, number, position = heappop(heap)
                opened = self._opened(number)
                row = row_of(opened.data, opened.starts[position], opened.ends[position])
                yield ChosenMessage(self._pieces[number], row, opened.data)
                self._push(heap, number, position + 1, end_ns)

    def _push(self, heap: list[tuple[int, int, int]], number: int, position: int, end_ns: int) -> None:
        times = self._opened(number).times
        if position < len(times) and times[position] < end_ns:
            heappush(heap, (times[position], number, position))

    def _opened(self, number: int) -> _OpenBatch:
        """Return an open batch; close the least recently used batches when too many are open."""
        if number in self._open:
            self._open.move_to_end(number)
            return self._open[number]
        opened = self._open[number] = self._read(self._pieces[number])
        while len(self._open) > 1 and sum(one.size for one in self._open.values()) > OPEN_CHUNKS_BYTES:
            self._open.popitem(last=False)
        return opened

    def _read(self, batch: MessageBatch) -> _OpenBatch:
        data, times, starts, ends = batch.records(), array('Q'), array('Q'), array('Q')
        left = 0
        for row in batch.inside(data):
            if isinstance(row, OtherRecord):
                self._learn(batch, row, data)
            elif self._choose(batch, row):
                times.append(row.t_ns)
                starts.append(row.start)
                ends.append(row.end)
            else:
                left += 1
        if batch.messages not in (None, left + len(times)):
            raise batch.file.fault(batch.place.offset, f'a chunk has {counted(left + len(times), "message")}, but its '
                                   f'indexes list {batch.messages}')
        if times and not batch.start_ns <= min(times) <= max(times) <= batch.end_ns:
            raise batch.file.fault(batch.place.offset, f'a chunk claims messages from {batch.start_ns} to '
                                   f'{batch.end_ns} ns, but its messages are from {min(times)} to {max(times)} ns')
        order = np.argsort(np.frombuffer(times, np.uint64), kind='stable')
        return _OpenBatch(data, *(array('Q', np.frombuffer(column, np.uint64)[order].tobytes())
                                  for column in (times, starts, ends)))
