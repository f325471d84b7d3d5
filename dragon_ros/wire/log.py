"""MCAP files in rosbag2's profile: ros2msg schemas, CDR bytes, QoS and type hash for each channel."""
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fcntl import LOCK_EX, LOCK_NB, flock
from os import SEEK_END
from pathlib import Path
from typing import IO, Any

import yaml
from mcap.reader import SeekingReader
from mcap.summary import Summary
from mcap.writer import CompressionType, Writer

from dragon_ros import __version__
from dragon_ros.core.errors import DragonError, InputError, MissingError
from dragon_ros.wire.channels import Channel
from dragon_ros.wire.schemas import schema_text, type_hash

_MAGIC = b'\x89MCAP0\r\n'
_FOREVER = {'sec': 9223372036, 'nsec': 854775807}


class BagError(InputError):
    """The file is not a bag that can be read."""


class LogWriter:
    """Writes messages as they are. Close it (or use ``with``): a bag without its end has no index."""

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        """Create the file. Raises MissingError where it cannot be written or would overwrite another."""
        self.path = path
        self._file = _create(path, overwrite)
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start('ros2', f'dragon_ros {__version__}')
        self._ids: dict[str, int] = {}
        self._announced: dict[str, Channel] = {}
        self._schemas: dict[str, int] = {}
        self.counts: dict[str, int] = {}

    def add_channel(self, topic: str, channel: Channel) -> None:
        """Announce a topic by full name, with type and QoS of a channel; without messages it leaves no trace."""
        self._announced[topic] = channel
        self.counts[topic] = 0

    def _open(self, topic: str) -> int:
        """Write the topic's channel, and its schema if it is the first of its type; return its number."""
        channel = self._announced[topic]
        if channel.type not in self._schemas:
            self._schemas[channel.type] = self._writer.register_schema(
                channel.type, 'ros2msg', schema_text(channel.type).encode())
        metadata = {'offered_qos_profiles': qos_text(channel), 'topic_type_hash': type_hash(channel.type)}
        return self._writer.register_channel(topic, 'cdr', self._schemas[channel.type], metadata)

    def write(self, topic: str, data: bytes, t_ns: int, sequence: int) -> None:
        """Append one message; ``t_ns`` is simulation time."""
        with _disk_errors(self.path):
            if topic not in self._ids:
                self._ids[topic] = self._open(topic)
            self._writer.add_message(self._ids[topic], t_ns, data, t_ns, sequence)
        self.counts[topic] += 1

    def close(self) -> None:
        """Write the index and close the file; twice does no harm."""
        if self._file.closed:
            return
        try:
            with _disk_errors(self.path):
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.flush()
        finally:
            with suppress(OSError):
                self._file.close()

    def __enter__(self) -> 'LogWriter':
        """Use it in a ``with`` block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close at the end of the block."""
        self.close()


@dataclass(frozen=True)
class Message:
    """One message of a bag."""

    topic: str
    data: bytes
    t_ns: int
    sequence: int


@dataclass(frozen=True)
class Topic:
    """One topic of a bag: full name, message type, QoS as rosbag2 writes it, and how many messages there are."""

    name: str
    type: str
    qos: dict[str, Any]
    messages: int


class LogReader:
    """Reads a bag that was closed properly."""

    def __init__(self, path: Path) -> None:
        """Open a bag and read its index. Raises MissingError or BagError."""
        self.path = path
        try:
            self._file = path.open('rb')
        except OSError as error:
            raise MissingError(f'{path}: cannot be read: {error.strerror}') from None
        try:
            with _bag_errors(path):
                _check_ends(path, self._file)
                self._reader = SeekingReader(self._file, validate_crcs=True)
                self._take(self._reader.get_summary())
        except BagError:
            self._file.close()
            raise

    def _take(self, summary: Summary | None) -> None:
        """Keep what the index says."""
        if summary is None or summary.statistics is None:
            raise BagError(f'{self.path}: has no index at its end; the recording was cut off')
        self.start_ns = summary.statistics.message_start_time
        self.end_ns = summary.statistics.message_end_time
        counts = summary.statistics.channel_message_counts
        for channel in summary.channels.values():
            if channel.message_encoding != 'cdr':
                raise BagError(f'{self.path}: topic {channel.topic} holds {channel.message_encoding or "unknown"} '
                               'messages; only cdr can be played')
        self.topics = [Topic(channel.topic, summary.schemas[channel.schema_id].name,
                             _qos_of(channel.metadata), counts.get(channel.id, 0))
                       for channel in summary.channels.values()]
        if not summary.statistics.message_count:
            raise BagError(f'{self.path}: is empty, there is no message in it')

    def messages(self, topics: list[str] | None = None, start_ns: int | None = None) -> Iterator[Message]:
        """Yield messages in order of time."""
        with _bag_errors(self.path):
            for _, channel, message in self._reader.iter_messages(topics, start_ns):
                yield Message(channel.topic, message.data, message.log_time, message.sequence)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> 'LogReader':
        """Use it in a ``with`` block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close at the end of the block."""
        self.close()


def qos_text(channel: Channel) -> str:
    """Return a channel's QoS as rosbag2 stores it."""
    return yaml.safe_dump([{
        'history': 'keep_last', 'depth': channel.depth, 'reliability': channel.reliability,
        'durability': channel.durability, 'deadline': _FOREVER, 'lifespan': _FOREVER, 'liveliness': 'automatic',
        'liveliness_lease_duration': _FOREVER, 'avoid_ros_namespace_conventions': False}], sort_keys=False)


def _create(path: Path, overwrite: bool) -> IO[bytes]:
    try:
        # An existing file is emptied only once it is known that nobody else writes it.
        file = path.open('r+b' if overwrite and path.exists() else 'xb')
        flock(file, LOCK_EX | LOCK_NB)
        file.truncate(0)
        return file
    except BlockingIOError:
        file.close()
        raise MissingError(f'{path}: another recorder is writing it; give another --output') from None
    except FileExistsError:
        raise MissingError(f'{path}: exists already; give another --output, or --force to replace it') from None
    except OSError as error:
        raise MissingError(f'{path}: cannot be written: {error.strerror}; give another --output') from None


def _qos_of(metadata: dict[str, str]) -> dict[str, Any]:
    """Return the first QoS profile of a channel; {} where there is none that can be read."""
    try:
        profiles = yaml.safe_load(metadata.get('offered_qos_profiles', '')) or []
        return dict(profiles[0]) if profiles else {}
    except (yaml.YAMLError, TypeError, ValueError, KeyError):
        return {}


@contextmanager
def _disk_errors(path: Path) -> Iterator[None]:
    """Turn a full or vanished disk into one clear error."""
    try:
        yield
    except OSError as error:
        raise MissingError(f'{path}: cannot be written on: {error.strerror}; the bag has no index') from None


def _check_ends(path: Path, file: IO[bytes]) -> None:
    """Refuse a file that does not start or end as a closed MCAP file does."""
    size = file.seek(0, SEEK_END)
    file.seek(0)
    if file.read(len(_MAGIC)) != _MAGIC:
        raise BagError(f'{path}: is {f"not an MCAP file ({size} bytes)" if size else "empty (0 bytes)"}')
    file.seek(max(0, size - len(_MAGIC)))
    if file.read() != _MAGIC or size == len(_MAGIC):
        raise BagError(f'{path}: was cut off before its end; it has no index ({size} bytes)')
    file.seek(0)


@contextmanager
def _bag_errors(path: Path) -> Iterator[None]:
    """Turn what the MCAP library raises on damaged files into one clear error."""
    try:
        yield
    except DragonError:
        raise
    except Exception as error:  # the library and its decompressors trip over damage in many ways
        raise BagError(f'{path}: is damaged: {str(error) or type(error).__name__}') from None
