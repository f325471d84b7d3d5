"""Bags with unusual structures, on which all readers of the package must agree.

A mix is built from bytes, two for each step. It may contain messages inside and outside of chunks, stray DataEnd
records, messages of the wrong length for their type, topics of other dragons and undeclared channels; its summary may
be right, wrong or absent.
"""
import struct
import zlib
from collections import Counter
from contextlib import suppress
from functools import cache
from pathlib import Path

import lz4.frame
import zstandard
from lines import hold_lines, span_of, topics_in
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from dragon_ros.bags.check.compare import compare_with_model
from dragon_ros.bags.read.frames import frames, log_times_are_ticks, namespace_of
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.errors import DragonError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.schemas import schema_text
from dragon_ros.scenes.provenance import RECORD, run_metadata

SCENE = Scene(dragon=Dragon(3), run=Run(412, 412.1))
_SCENE_TEXT = 'dragon: {benches: 3}\nrun: {start_s: 412, stop_s: 412.1}'     # short, since the run is read many times
TICKS = 6
NAMES = tuple(encoders(SCENE))
MAGIC = b'\x89MCAP0\r\n'
Row = tuple[str, int, bytes]
_TOPICS = (*(f'/dragon/{name}' for name in NAMES), '/other/handles', '/dragon/forces', '/dragon/clearance', '/tf')
_UNDECLARED = 77
_PACK = (('', bytes), ('zstd', zstandard.ZstdCompressor(level=1).compress), ('lz4', lz4.frame.compress))


@cache
def model() -> dict[tuple[str, int], bytes]:
    """Return the messages of the run by topic and log time."""
    encode = encoders(SCENE)
    return {(f'/dragon/{name}', SCENE.run.time_ns(k)): bytes(encode[name](tick(SCENE, k)))
            for k in range(TICKS) for name in NAMES}


def record(opcode: int, content: bytes) -> bytes:
    """Return a record."""
    return struct.pack('<BQ', opcode, len(content)) + content


def text(value: str) -> bytes:
    """Return a string as it is encoded in records."""
    return struct.pack('<I', len(value)) + value.encode()


def message(channel: int, t_ns: int, data: bytes) -> bytes:
    """Return a message."""
    return record(5, struct.pack('<HIQQ', channel, 1, t_ns, t_ns) + data)


def declared() -> bytes:
    """Return the schemas and channels of all topics."""
    out = b''
    for number, topic in enumerate(_TOPICS, 1):
        row = channels().get(topic.rpartition('/')[2], channels()['clearance'])
        out += record(3, struct.pack('<H', number) + text(row.type) + text('ros2msg') + text(schema_text(row.type)))
        out += record(4, struct.pack('<HH', number, number) + text(topic) + text('cdr') + text(''))
    return out


@cache
def recorded_scene() -> bytes:
    """Return the metadata record that a recorder writes about the scene."""
    rows = b''.join(text(key) + text(value) for key, value in run_metadata(_SCENE_TEXT, SCENE, {}).items())
    return record(12, text(RECORD) + struct.pack('<I', len(rows)) + rows)


class Mix:
    """A bag file that is built step by step."""

    def __init__(self, summary: int) -> None:
        """Begin a file; ``summary`` selects the summary at its end, and whether the bag contains its scene."""
        self._summary = summary % 4
        self.out = bytearray(MAGIC + record(1, text('ros2') + text('mix')) + declared())
        if summary & 4:
            self.out += recorded_scene()
        self._inside: list[tuple[int, int, bytes]] | None = None
        self._rows = b''
        self._counts: Counter[int] = Counter()
        self._chunks = 0

    def put(self, channel: int, t_ns: int, data: bytes) -> None:
        """Add a message to the open chunk or, if none is open, outside of chunks."""
        self._counts[channel] += 1
        if self._inside is None:
            self.out += message(channel, t_ns, data)
        else:
            self._inside.append((channel, t_ns, data))

    def step(self, what: int, argument: int) -> None:
        """Add the part of the file that two bytes describe."""
        topic, k = argument % len(_TOPICS), argument // len(_TOPICS) % TICKS
        t_ns, kind = SCENE.run.time_ns(k), what % 16
        data = model()[_TOPICS[topic] if topic < len(NAMES) else '/dragon/handles', t_ns]
        if kind < 4:
            self.put(topic + 1, t_ns, data)
        elif kind == 4:
            self.whole_tick(argument % TICKS)
        elif kind == 5:
            for number in range(TICKS):
                self.whole_tick(number)
        elif kind == 6:
            self.end_chunk(argument)
            self._inside = []
        elif kind == 7:
            self.end_chunk(argument)
        elif kind == 8:
            self.end_chunk(argument)
            self.out += record(15, bytes(4))
        elif kind == 9:
            self.put(topic + 1, t_ns, data[:argument] if what & 16 else data + bytes(argument))
        elif kind == 10:
            self.put(_UNDECLARED, t_ns, data)
        elif kind == 11:
            self.put(topic + 1, t_ns + argument * (what >> 4), data)
        elif kind == 12:
            changed = bytearray(data)
            changed[argument % len(changed)] ^= 1 + what
            self.put(topic + 1, t_ns, bytes(changed))
        elif kind == 13:
            self.end_chunk(argument)
            self.out += record(12, text('note') + text('')) if what & 16 else record(
                9, struct.pack('<QQ', 0, 0) + text('a') + text('text/plain') + struct.pack('<QI', 0, 0))
        elif kind == 14:
            self.end_chunk(argument)
            self.out += record(4, struct.pack('<HH', topic + 1, 1) + text(_TOPICS[argument % 3]) + text('cdr')
                               + text(''))
        else:
            self.end_chunk(argument)
            self.out += record(argument or 1, bytes(what))

    def whole_tick(self, k: int) -> None:
        """Add the messages of a tick."""
        t_ns = SCENE.run.time_ns(k)
        for number, name in enumerate(NAMES, 1):
            self.put(number, t_ns, model()[f'/dragon/{name}', t_ns])

    def end_chunk(self, how: int) -> None:
        """Write the open chunk, compressed as ``how`` selects, and its indexes (omitted for one value in eight)."""
        rows, self._inside = self._inside, None
        if not rows:
            return
        name, pack = _PACK[how % 3]
        data, at, index = b''.join(message(*row) for row in rows), 0, dict[int, bytes]()
        for channel, t_ns, content in rows:
            index[channel] = index.get(channel, b'') + struct.pack('<QQ', t_ns, at)
            at += 31 + len(content)
        times = [t_ns for _, t_ns, _ in rows]
        packed, start = pack(data), len(self.out)
        chunk = record(6, struct.pack('<QQQI', min(times), max(times), len(data), zlib.crc32(data)) + text(name)
                       + struct.pack('<Q', len(packed)) + packed)
        self.out += chunk
        self._chunks += 1
        offsets, end = b'', len(self.out)
        for channel, entries in index.items() if how % 8 != 7 else ():
            offsets += struct.pack('<HQ', channel, len(self.out))
            self.out += record(7, struct.pack('<HI', channel, len(entries)) + entries)
        self._rows += record(8, struct.pack('<QQQQI', min(times), max(times), start, len(chunk), len(offsets)) + offsets
                             + struct.pack('<Q', len(self.out) - end) + text(name)
                             + struct.pack('<QQ', len(packed), len(data)))

    def finish(self) -> bytes:
        """Return the file, either without a summary or with one that is correct, lacks indexes or has wrong counts."""
        self.end_chunk(0)
        self.out += record(15, bytes(4))
        start, counts = len(self.out), self._counts
        if self._summary == 0:
            return bytes(self.out) + record(2, bytes(20)) + MAGIC
        if self._summary == 3:
            counts = counts + Counter({1: 1})
        entries = b''.join(struct.pack('<HQ', channel, count) for channel, count in sorted(counts.items()))
        statistics = record(11, struct.pack('<QHIIIIQQI', counts.total(), len(_TOPICS), len(_TOPICS), 0, 0,
                                            self._chunks, 0, 1, len(entries)) + entries)
        summary = declared() + statistics + (self._rows if self._summary != 2 else b'')
        footer = struct.pack('<BQQQ', 2, 20, start, 0)
        return bytes(self.out) + summary + footer + struct.pack('<I', zlib.crc32(footer, zlib.crc32(summary))) + MAGIC


def built(data: bytes) -> bytes:
    """Return the bag described by bytes."""
    mix = Mix(data[0] if data else 0)
    for at in range(1, min(len(data), 120) - 1, 2):
        mix.step(data[at], data[at + 1])
    return mix.finish()


def streamed(path: Path) -> tuple[list[Row], bool]:
    """Return the messages that the mcap stream reader finds on declared topics, and whether it reached the end."""
    found, names = list[Row](), dict[int, str]()
    try:
        with path.open('rb') as file:
            for row in StreamReader(file, validate_crcs=True).records:
                if isinstance(row, Channel):
                    names.setdefault(row.id, row.topic)
                elif isinstance(row, Message) and row.channel_id in names:
                    found.append((names[row.channel_id], row.log_time, row.data))
    except (McapError, ValueError, RuntimeError, OSError, EOFError, MemoryError, OverflowError, struct.error,
            zstandard.ZstdError):
        return found, False
    return found, True


def read_by_library(path: Path) -> list[Row]:
    """Return the messages in a file by the mcap library's reader, which parses all other records, too."""
    with path.open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        reader.get_header()
        reader.get_summary()
        assert all(one.name is not None for one in (*reader.iter_metadata(), *reader.iter_attachments()))
        return [(channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()]


def hold(path: Path, folder: Path) -> None:
    """Compare all ways to read a bag with each other and with the mcap library's readers. Raises AssertionError."""
    wanted, ended = streamed(path)
    told = hold_lines(path, folder, wanted, ended, model())
    if told.code in (0, 3):
        assert ended, 'inspect finds no damage, but the library does'
        indexed = Counter(read_by_library(path))
        assert indexed == Counter(wanted) or any('has no complete summary' in line for line in told.lines), (
            'the index leads the library to different messages')
    read = None
    with suppress(DragonError), BagReader(path) as bag:
        read = Counter((one.topic, one.t_ns, one.data) for one in bag.messages())
        assert {topic.name: topic.messages for topic in bag.topics if topic.messages} == topics_in(told.lines)
    if read is None:
        return
    if ended:
        assert read == Counter(wanted), 'reader and stream reader find different messages'
    with suppress(DragonError), BagReader(path) as bag:
        namespace_of(bag, 'dragon')
        hold_frames(bag, read)
        hold_check(bag, read)


def hold_frames(bag: BagReader, read: Counter[Row]) -> None:
    """Compare the values read by tables, exports and pictures with the bag's messages."""
    with suppress(DragonError):
        ticks = [frame.t_ns for frame in frames(bag, '/dragon')]
        assert len(ticks) <= sum(count for (topic, _, _), count in read.items() if topic == '/dragon/handles')


def hold_check(bag: BagReader, read: Counter[Row]) -> None:
    """If the check accepts a bag, each tick must have exactly one message per topic, equal to the model's."""
    found = compare_with_model(bag, SCENE, '/dragon')
    each = {f'/dragon/{name}' for name, row in channels().items() if row.each_tick}
    ticks = Counter({row: count for row, count in read.items() if row[0] in each})
    assert found.equal + found.close + found.once + found.fault_count - found.missing_count + sum(
        count for count, _ in found.unchecked.values()) >= read.total() or found.fault_count
    if not found.passed or not log_times_are_ticks(bag, '/dragon'):      # other recorders' times are not compared
        return
    assert {row[:2] for row in ticks} == span_of(model(), [row[:2] for row in ticks])
    assert set(ticks.values()) == {1}
    assert sum(model()[row[:2]] == row[2] for row in ticks) == found.equal


def seeds() -> list[bytes]:
    """Return the bytes of several complete bags with different structures."""
    return [bytes((5, 6, 0, 5, 0, 7, 0)), bytes((4, 5, 0)), bytes((7, 6, 0, 5, 0, 7, 2, 13, 0, 0, 1)),
            bytes((1, 6, 0, 5, 0, 7, 0)), bytes((0, 5, 0)), bytes((1, 6, 0, 4, 0, 4, 1, 4, 2, 7, 1, 4, 3, 4, 4, 4, 5)),
            bytes((1, 6, 0, 5, 0, 7, 2, 8, 0, 6, 0, 0, 3, 7, 0)), bytes((2, 4, 0, 6, 0, 5, 0, 7, 7, 10, 0)),
            bytes((3, 6, 0, 5, 0, 7, 0, 9, 5, 25, 9, 11, 2, 12, 200)), bytes((1, 6, 0, 5, 0, 0, 4, 0, 5, 7, 0, 13, 0))]
