"""MCAP files in rosbag2's profile, written: ros2msg schemas, CDR bytes, QoS and type hash for each channel."""
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, flock
from pathlib import Path
from typing import IO

import yaml
from mcap.writer import CompressionType, Writer

from dragon_ros import __version__
from dragon_ros.core.errors import MissingError
from dragon_ros.wire import config
from dragon_ros.wire.channels import Channel
from dragon_ros.wire.documents import read_document

_FOREVER = {'sec': 9223372036, 'nsec': 854775807}


class LogWriter:
    """Writes messages as they are. Close it (or use ``with``): a bag without its end has no index."""

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        """Create the file. Raises MissingError where it cannot be written or would overwrite another."""
        self.path = path
        self._file = _create(path, overwrite)
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start('ros2', f'dragon_ros {__version__}')
        self._ids: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self.counts: dict[str, int] = {}

    def add_channel(self, topic: str, channel: Channel) -> None:
        """Announce a topic by its full name, with the type and QoS of a channel."""
        if channel.type not in self._schemas:
            self._schemas[channel.type] = self._writer.register_schema(
                channel.type, 'ros2msg', schema_text(channel.type).encode())
        metadata = {'offered_qos_profiles': qos_text(channel), 'topic_type_hash': type_hash(channel.type)}
        self._ids[topic] = self._writer.register_channel(topic, 'cdr', self._schemas[channel.type], metadata)
        self.counts[topic] = 0

    def write(self, topic: str, data: bytes, t_ns: int, sequence: int) -> None:
        """Append one message; ``t_ns`` is simulation time."""
        with _disk_errors(self.path):
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


def schema_text(name: str) -> str:
    """Return the ros2msg schema of a message type."""
    return (config.folder() / 'schemas' / f'{name.replace("/msg/", ".")}.msg').read_text()


def type_hash(name: str) -> str:
    """Return the RIHS01 hash of a message type."""
    return str(read_document(config.folder() / 'schemas' / 'types.yaml').values[name])


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


@contextmanager
def _disk_errors(path: Path) -> Iterator[None]:
    """Turn a full or vanished disk into one clear error."""
    try:
        yield
    except OSError as error:
        raise MissingError(f'{path}: cannot be written on: {error.strerror}; the bag has no index') from None
