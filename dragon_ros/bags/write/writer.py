"""Writes bags in rosbag2's profile: ros2msg schemas, CDR bytes, QoS and type hash for each channel.

A path that ends in .mcap names a single file; any other path names a rosbag2 directory with ``metadata.yaml`` and one
or more files.
"""
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from dragon_ros.bags.write import COMPRESSIONS
from dragon_ros.bags.write.bag_folder import BagFolder
from dragon_ros.bags.write.mcap import MESSAGE_BYTES, McapWriter, OpenChunk, PackedChunk, statistics
from dragon_ros.core.checks import number
from dragon_ros.core.errors import DiskError, FieldError, InputError, MissingError
from dragon_ros.messages.channels import Channel
from dragon_ros.messages.schemas import schema_text, type_hash
from dragon_ros.scenes.provenance import ros_distro

MB = 10**6
_SWITCH_S = 2e-5        # shorter than the intervals at which numpy releases the interpreter lock
_VERSION = 9            # the version of metadata.yaml that ROS 2 Jazzy writes
_FOREVER = {'sec': 9223372036, 'nsec': 854775807}
_INDEX_BYTES, _INDEX_BYTES_A_CHUNK = 100_000, 600        # schemas, channels and metadata; per chunk, with 10 channels
_LISTED_BYTES, _LISTED_BYTES_A_PART = 65_536, 512       # size of metadata.yaml: for the topics; per part


@dataclass(frozen=True)
class BagOptions:
    """The options for writing a bag. None means no limit, a megabyte is 10^6 bytes, and durations are in log time.

    ``fsync`` waits for the disk after each chunk, which protects against power cuts as well as killed processes.
    """

    compression: str = 'zstd'
    split_size_mb: float | None = None
    split_duration_s: float | None = None
    max_size_mb: float | None = None
    fsync: bool = False

    def __post_init__(self) -> None:
        """Check the values."""
        if self.compression not in COMPRESSIONS:
            raise FieldError('compression', self.compression, f'it is one of {", ".join(COMPRESSIONS)}', 'give one')
        for row in fields(self):
            value = getattr(self, row.name)
            if row.name.endswith(('_mb', '_s')) and value is not None:
                number(row.name, value, above=0.0, high=1e9)

    @property
    def splits(self) -> bool:
        """Whether the bag may consist of several files."""
        return self.split_size_mb is not None or self.split_duration_s is not None


class BagPart(NamedTuple):
    """One file of a bag: name, first and last log time, number of messages by topic, and size in bytes."""

    name: str
    start_ns: int
    end_ns: int
    counts: dict[str, int]
    size: int

    @property
    def messages(self) -> int:
        """The number of messages in the file."""
        return sum(self.counts.values())


@dataclass
class _Extras:
    """The records that every file of a bag contains, so that each file documents its run independently."""

    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: list[tuple[str, str, bytes]] = field(default_factory=list)


class BagWriter:
    """Writes messages unchanged. Close the writer (or use ``with``), because a bag that is not closed has no index."""

    def __init__(self, path: Path, overwrite: bool = False, options: BagOptions | None = None,
                 threaded: bool = True) -> None:
        """Create the bag. Raises MissingError if the bag cannot be written or would overwrite another bag.

        If ``threaded``, chunks are compressed and written on a thread while the caller continues.
        """
        self.path, self.options, self._threaded = path, options or BagOptions(), threaded
        self._overwrite, self._single = overwrite, path.suffix == '.mcap'
        if self._single and self.options.splits:
            raise InputError(f'--output {path}: is one file and cannot be split; give a directory')
        self._folder = None if self._single else BagFolder(path, overwrite)
        self._broken: DiskError | None = None       # the error after which no further part can begin
        self._channels: dict[str, Channel] = {}
        self._ids: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._extras = _Extras()
        self._files: list[BagPart] = []
        self._start_ns: int | None = None
        self._limited = self.options.splits or self.options.max_size_mb is not None
        self.counts: dict[str, int] = {}
        self._closed = False
        self.left_out: Counter[str] = Counter()     # by topic: the number of messages too large for any reader
        try:
            self._file = self._new_file()
        except BaseException:
            if self._folder is not None:
                self._folder.abandon()
            raise

    def add_channel(self, topic: str, channel: Channel) -> None:
        """Register a topic by its full name, with a channel's type and QoS; it is written with its first message."""
        self._channels[topic] = channel
        self.counts.setdefault(topic, 0)

    def describe(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record to this file and all later ones."""
        self._extras.metadata.append((name, values))
        self._open_file().add_metadata(name, values)

    def attach(self, name: str, media_type: str, content: bytes) -> None:
        """Write an attachment to this file and all later ones."""
        self._extras.attachments.append((name, media_type, content))
        self._open_file().add_attachment(name, media_type, content)

    def write(self, topic: str, data: bytes, t_ns: int, sequence: int, publish_ns: int | None = None) -> None:
        """Append one message with its simulation time and its publication time (``t_ns`` if None).

        A message that is too large for any reader is left out and counted. Raises DiskError if the message cannot be
        written, or if the bag reaches its size limit.
        """
        if len(data) > MESSAGE_BYTES:
            self.left_out[topic] += 1
            return
        if self._limited:
            self._make_room(len(data), t_ns)
        self._file.add_message(self.channel_of(topic), data, t_ns, sequence, t_ns if publish_ns is None else publish_ns)
        self.counts[topic] += 1

    def channel_of(self, topic: str) -> int:
        """Return the number of a topic's channel in this file; the channel is written on the topic's first use."""
        if topic not in self._ids:
            self._announce(topic)
        return self._ids[topic]

    def write_chunk(self, chunk: PackedChunk) -> None:
        """Append a chunk that was packed elsewhere with channels from ``channel_of``; the bag must have no limits."""
        assert not self._limited
        self._open_file().add_chunk(chunk)
        self._count(chunk.counts)

    def write_filled(self, chunk: OpenChunk) -> None:
        """Append a chunk filled elsewhere, which must not change until the next call; the bag must have no limits."""
        assert not self._limited
        self._open_file().add_filled(chunk)
        self._count(chunk.counts())

    def end_chunk(self) -> None:
        """End the open chunk, so that the next message begins a new one."""
        self._open_file().end_chunk()

    def flush(self) -> None:
        """Flush all messages written so far to the file, so that a killed process loses none of them."""
        self._open_file().flush()

    def close(self) -> None:
        """Write the index and close the file; repeated calls are harmless. Raises DiskError if messages are lost."""
        if self._closed:
            return
        self._closed = True
        try:
            if not self._file.closed:
                self._end_file()
        finally:
            try:
                self._write_metadata()
            finally:
                self._leave_folder()

    def __enter__(self) -> 'BagWriter':
        """Return the writer, for a ``with`` block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close at the end of the block."""
        self.close()

    def _open_file(self) -> McapWriter:
        """Return the file being written, or raise the earlier DiskError after which no file was opened."""
        if self._broken is not None:
            raise self._broken
        return self._file

    def _count(self, counts: Iterable[tuple[int, int]]) -> None:
        topics = {channel: topic for topic, channel in self._ids.items()}
        for channel, messages in counts:
            self.counts[topics[channel]] += messages

    def _leave_folder(self) -> None:
        if self._folder is not None:
            self._folder.close()

    def _new_file(self) -> McapWriter:
        path = self.path
        if self._folder is not None:
            path /= f'{Path(os.path.realpath(self.path)).name}_{len(self._files)}.mcap'
            described = sum(len(value) for _, values in self._extras.metadata for value in values.values())
            self._folder.reserve(_LISTED_BYTES + _LISTED_BYTES_A_PART * (len(self._files) + 1) + 2 * described)
        file = McapWriter(path, self._overwrite, self.options.compression, self.options.fsync, self._threaded)
        for name, values in self._extras.metadata:
            file.add_metadata(name, values)
        for attachment in self._extras.attachments:
            file.add_attachment(*attachment)
        self._ids, self._schemas, self._start_ns = {}, {}, None
        return file

    def _announce(self, topic: str) -> None:
        channel = self._channels[topic]
        if channel.type not in self._schemas:
            self._schemas[channel.type] = self._file.add_schema(channel.type, schema_text(channel.type).encode())
        metadata = {'offered_qos_profiles': qos_text(channel), 'topic_type_hash': type_hash(channel.type)}
        self._ids[topic] = self._file.add_channel(topic, self._schemas[channel.type], metadata)

    def _make_room(self, more: int, t_ns: int) -> None:
        """Start the next file if this one is full. Raises DiskError if the bag would exceed its limit."""
        limit, options = self.options.max_size_mb, self.options
        size = self._open_file().size + more
        whole = size + sum(file.size for file in self._files) + self._index_bytes()
        if limit is not None and whole > limit * MB:
            raise DiskError(f'{self.path}: has reached its limit of {limit:g} MB (--max-size-mb); recording stops')
        self._start_ns = t_ns if self._start_ns is None else self._start_ns
        if self._file.parts and (size > (options.split_size_mb or float('inf')) * MB
                                 or t_ns - self._start_ns >= (options.split_duration_s or float('inf')) * 10**9):
            self._next_file()
            self._start_ns = t_ns

    def _next_file(self) -> None:
        """End this part and begin the next one. Raises DiskError; no further part can then begin."""
        try:
            self._end_file()
            self._write_metadata()
            self._file = self._new_file()
        except DiskError as error:
            self._broken = error
            raise
        except MissingError as error:
            self._broken = DiskError(f'the next part cannot begin: {error}')
            raise self._broken from None

    def _index_bytes(self) -> int:
        """Return an upper bound on the size of the index in bytes."""
        return _INDEX_BYTES * (len(self._files) + 1) + _INDEX_BYTES_A_CHUNK * len(self._file.parts)

    def _end_file(self) -> None:
        try:
            self._file.finish()
        finally:
            self._files.append(self._summary())

    @property
    def kept(self) -> int:
        """The number of messages in the closed bag: all that were written, unless the disk became full."""
        return sum(file.messages for file in self._files)

    def _summary(self) -> BagPart:
        found = statistics(0, 0, self._file.parts)
        by_id = {number: topic for topic, number in self._ids.items()}
        counts = {by_id[number]: count for number, count in found.channel_message_counts.items()}
        return BagPart(self._file.path.name, found.message_start_time, found.message_end_time, counts,
                       self._file.size)

    def _write_metadata(self) -> None:
        """Write metadata.yaml, which rosbag2 requires in the folder."""
        if self._folder is None:
            return
        profiles = {topic: (channel.type, qos_text(channel), type_hash(channel.type))
                    for topic, channel in self._channels.items()}
        custom = {key: value for _, values in self._extras.metadata for key, value in values.items()}
        self._folder.write_metadata(_metadata_text(self._files, profiles, custom))


@lru_cache
def qos_text(channel: Channel) -> str:
    """Return a channel's QoS as rosbag2 stores it."""
    row: dict[str, Any] = {
        'history': 'keep_last', 'depth': channel.depth, 'reliability': channel.reliability,
        'durability': channel.durability, 'deadline': dict(_FOREVER), 'lifespan': dict(_FOREVER),
        'liveliness': 'automatic', 'liveliness_lease_duration': dict(_FOREVER),
        'avoid_ros_namespace_conventions': False}
    return yaml.safe_dump([row], sort_keys=False)


def _metadata_text(files: Sequence[BagPart], topics: Mapping[str, tuple[str, str, str]],
                   custom: Mapping[str, str]) -> str:
    """Return the text of metadata.yaml; ``topics`` maps each name to its type, offered QoS (as text) and type hash."""
    filled = [file for file in files if file.messages]
    start = min((file.start_ns for file in filled), default=0)
    end = max((file.end_ns for file in filled), default=0)
    counts: Counter[str] = Counter()
    for file in files:
        counts.update(file.counts)
    return yaml.safe_dump({'rosbag2_bagfile_information': {
        'version': _VERSION, 'storage_identifier': 'mcap', **_times(start, end), 'message_count': counts.total(),
        'topics_with_message_count': [_topic(name, *topics[name], counts[name]) for name in topics if counts[name]],
        'compression_format': '', 'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [{'path': file.name, **_times(file.start_ns, file.end_ns), 'message_count': file.messages}
                  for file in files],
        'custom_data': dict(custom) or None, 'ros_distro': ros_distro()}}, sort_keys=False)


def _times(start_ns: int, end_ns: int) -> dict[str, Any]:
    return {'duration': {'nanoseconds': end_ns - start_ns}, 'starting_time': {'nanoseconds_since_epoch': start_ns}}


def _topic(name: str, kind: str, qos: str, type_hash: str, count: int) -> dict[str, Any]:
    return {'topic_metadata': {
        'name': name, 'type': kind, 'serialization_format': 'cdr', 'offered_qos_profiles': yaml.safe_load(qos),
        'type_description_hash': type_hash}, 'message_count': count}


@contextmanager
def prompt_switches() -> Iterator[None]:
    """Let the compression thread obtain the interpreter lock quickly, since the thread is idle until then.

    By default, a thread can demand the lock only after waiting for 5 ms, and each release restarts that wait.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
