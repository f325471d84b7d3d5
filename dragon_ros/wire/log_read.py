"""MCAP files in rosbag2's profile, read."""
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from os import SEEK_END
from pathlib import Path
from typing import IO, Any

import yaml
from mcap.reader import SeekingReader
from mcap.summary import Summary

from dragon_ros.core.errors import DragonError, InputError, MissingError

_MAGIC = b'\x89MCAP0\r\n'


class BagError(InputError):
    """The file is not a bag that can be read."""


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


def _qos_of(metadata: dict[str, str]) -> dict[str, Any]:
    """Return the first QoS profile of a channel; {} where there is none that can be read."""
    try:
        profiles = yaml.safe_load(metadata.get('offered_qos_profiles', '')) or []
        return dict(profiles[0]) if profiles else {}
    except (yaml.YAMLError, TypeError, ValueError, KeyError):
        return {}


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
