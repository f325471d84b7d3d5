"""``metadata.yaml`` of a rosbag2 directory, version 9, as ROS 2 Jazzy writes it."""
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from dragon_ros.core.errors import DiskError

_VERSION = 9


class File(NamedTuple):
    """One file of a bag: name, first and last log time, messages by topic, bytes."""

    name: str
    start_ns: int
    end_ns: int
    counts: dict[str, int]
    size: int

    @property
    def messages(self) -> int:
        """How many messages are in it."""
        return sum(self.counts.values())


def metadata_text(files: Sequence[File], topics: Mapping[str, tuple[str, str, str]], custom: Mapping[str, str]) -> str:
    """Return the file's text; ``topics`` has type, offered QoS (as text) and type hash by name."""
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
        'custom_data': dict(custom) or None, 'ros_distro': os.environ.get('ROS_DISTRO', 'jazzy')}}, sort_keys=False)


def write_metadata(folder: Path, text: str) -> None:
    """Replace metadata.yaml in one step: a reader finds the old one or the new one. Raises DiskError."""
    new = folder / 'metadata.yaml.new'
    try:
        new.write_text(text, encoding='utf-8')
        new.replace(folder / 'metadata.yaml')
    except OSError as error:
        new.unlink(missing_ok=True)
        raise DiskError(f'{folder / "metadata.yaml"}: cannot be written: {error.strerror}; the .mcap files beside it '
                        'are whole') from None


def _times(start_ns: int, end_ns: int) -> dict[str, Any]:
    return {'duration': {'nanoseconds': end_ns - start_ns}, 'starting_time': {'nanoseconds_since_epoch': start_ns}}


def _topic(name: str, kind: str, qos: str, type_hash: str, count: int) -> dict[str, Any]:
    return {'topic_metadata': {
        'name': name, 'type': kind, 'serialization_format': 'cdr', 'offered_qos_profiles': yaml.safe_load(qos),
        'type_description_hash': type_hash}, 'message_count': count}
