"""The topics of the package, read from ``msg_configs/topics.yaml``."""
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from dragon_ros.configuration import folder as configuration_folder
from dragon_ros.core.errors import FieldError
from dragon_ros.core.flags import Effect, effects_of
from dragon_ros.scenes.yaml import Document, read_own

_KEYS = ('type', 'from', 'effect', 'qos', 'meaning')
_QOS = {'reliability': ('reliable', 'best_effort'), 'durability': ('volatile', 'transient_local')}


@dataclass(frozen=True)
class Channel:
    """One topic: its relative name, message type, publisher and QoS, and the effect that enables it (or None)."""

    name: str
    type: str
    publisher: str
    reliability: str
    durability: str
    depth: int
    effect: Effect | None
    meaning: str

    @property
    def latched(self) -> bool:
        """Whether late subscribers receive the last message."""
        return self.durability == 'transient_local'

    @property
    def each_tick(self) -> bool:
        """Whether the topic has one message per tick; a monitor's topics have their own rate."""
        return self.publisher == 'sim' and not self.latched


@lru_cache(maxsize=1)
def channels() -> dict[str, Channel]:
    """Return all topics by name, in the order of the file."""
    return channels_of(read_own(configuration_folder() / 'topics.yaml'))


def channels_of(document: Document) -> dict[str, Channel]:
    """Return the topics listed in a document. Raises InputError with file, line and key."""
    return {name: _channel(document, name) for name in document.values}


def channel_of(topic: str) -> Channel | None:
    """Return the channel with the longest name that is a suffix of a full topic name."""
    return max((row for row in channels().values() if f'/{topic}'.endswith(f'/{row.name.lstrip("/")}')),
               key=lambda row: len(row.name), default=None)


def live(effects: Effect) -> list[Channel]:
    """Return the topics on which ``sim`` publishes in every tick for these effects, excluding latched topics."""
    return [channel for channel in channels().values()
            if channel.each_tick and (channel.effect is None or channel.effect in effects)]


def _channel(document: Document, name: str) -> Channel:
    row = document.section(name)
    document.check_keys(f'{name}.', row, _KEYS)
    for key in ('type', 'from', 'meaning'):
        if not isinstance(row.get(key), str):
            document.refuse(f'{name}.{key}', f'{row.get(key)!r} is not a string; every topic needs one')
    if row['type'].count('/') != 2:
        document.refuse(f'{name}.type', f'{row["type"]!r} is not of the form package/msg/Type')
    qos = _qos(document, f'{name}.qos', row.get('qos'))
    return Channel(name, row['type'], row['from'], qos['reliability'], qos['durability'], qos['depth'],
                   _effect(document, name, row.get('effect')), row['meaning'])


def _qos(document: Document, key: str, qos: Any) -> dict[str, Any]:
    if not isinstance(qos, dict):
        document.refuse(key, 'write {reliability: ..., durability: ..., depth: ...}')
    document.check_keys(f'{key}.', qos, (*_QOS, 'depth'))
    for policy, allowed in _QOS.items():
        if qos.get(policy) not in allowed:
            document.refuse(f'{key}.{policy}', f'{qos.get(policy)!r} is not one of {", ".join(allowed)}')
    depth = qos.get('depth')
    if isinstance(depth, bool) or not isinstance(depth, int) or not 1 <= depth <= 10_000:
        document.refuse(f'{key}.depth', f'{depth!r} is not an integer from 1 to 10000')
    return qos


def _effect(document: Document, name: str, effect: Any) -> Effect | None:
    try:
        return None if effect is None else effects_of([effect])
    except FieldError as error:
        document.refuse(f'{name}.effect', str(error))
