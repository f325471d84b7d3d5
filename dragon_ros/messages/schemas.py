"""The ros2msg schemas included in the package, and the CDR layout of each type."""
import re
from dataclasses import dataclass
from functools import lru_cache

from dragon_ros.configuration import folder as configuration_folder
from dragon_ros.scenes.yaml import read_own

PRIMITIVES = {'bool': '?', 'byte': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H',
              'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f', 'float64': 'd'}
TEXT = 's'
_FIELD = re.compile(r'([\w/]+)(?:<=\d+)?(\[(?:<=\d+|\d*)\])?\s+(\w+)\s*(=)?')


@dataclass(frozen=True)
class Field:
    """One field of a message.

    ``kind`` is a struct code, TEXT, or '' for a nested message with ``parts``. ``each`` is the number of equal
    primitives in one value (7 for a Pose), or 0 for a single primitive. ``many`` is None for one value, 0 for a
    sequence, and otherwise the length of an array.
    """

    name: str
    kind: str
    each: int
    parts: tuple['Field', ...]
    many: int | None


@lru_cache
def schema_text(name: str) -> str:
    """Return the ros2msg schema of a message type such as geometry_msgs/msg/PoseArray."""
    return (configuration_folder() / 'schemas' / f'{name.replace("/msg/", ".")}.msg').read_text()


@lru_cache
def type_hash(name: str) -> str:
    """Return the RIHS01 hash of a message type."""
    return str(_types()[name])


def is_schema_of(name: str, text: str) -> bool:
    """Return whether a ros2msg schema equals the package's schema of that type, ignoring comments and white space."""
    return name in _types() and _plain(text) == _plain(schema_text(name))


@lru_cache
def _types() -> dict[str, str]:
    return read_own(configuration_folder() / 'schemas' / 'types.yaml').values


def _plain(text: str) -> list[str]:
    """Return a schema's lines without comments and white space, and with type separators of equal length."""
    lines = (' '.join(line.partition('#')[0].split()) for line in text.splitlines())
    return ['=' if set(line) == {'='} else line for line in lines if line]


@lru_cache
def fields_of(name: str) -> tuple[Field, ...]:
    """Return the fields of a message type, in order."""
    whole, *rest = re.split(r'^=+\nMSG: ', schema_text(name), flags=re.MULTILINE)
    texts = {section.partition('\n')[0].strip(): section.partition('\n')[2] for section in rest}
    package = name.partition('/')[0]
    return _fields(whole, package, texts)


def _fields(text: str, package: str, texts: dict[str, str]) -> tuple[Field, ...]:
    """Return the fields declared in one section of a schema, excluding constants."""
    lines = (_FIELD.match(line.partition('#')[0].strip()) for line in text.splitlines())
    return tuple(_field(line, package, texts) for line in lines if line and not line[4])


def _field(line: re.Match[str], package: str, texts: dict[str, str]) -> Field:
    kind, array, name = line[1], line[2], line[3]
    many = None if array is None else int(array.strip('[]')) if array.strip('[]').isdecimal() else 0
    if kind in PRIMITIVES or kind == 'string':
        return Field(name, PRIMITIVES.get(kind, TEXT), 0, (), many)
    whole = kind if '/' in kind else f'{package}/{kind}'
    parts = _fields(texts[whole], whole.partition('/')[0], texts)
    codes = {part.kind for part in parts}
    if len(codes) == 1 and not codes & {TEXT, ''} and all(part.many is None for part in parts):
        return Field(name, codes.pop(), sum(part.each or 1 for part in parts), (), many)
    return Field(name, '', 0, parts, many)
