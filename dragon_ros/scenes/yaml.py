"""YAML documents with the line of every key, and errors that name file, line and key."""
import difflib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import yaml

from dragon_ros.core.errors import InputError, MissingError

MOST_VALUES = 100_000


@dataclass
class Document:
    """The mapping in a file, and the place of each dotted key (``file:line``)."""

    name: str
    values: dict[str, Any]
    places: dict[str, str] = field(default_factory=dict)

    def refuse(self, key: str, why: str) -> NoReturn:
        """Raise an InputError that names the place of ``key``."""
        raise InputError(f'{self.place(key)}: {key}: {why}', field=key)

    def place(self, key: str) -> str:
        """Return the place of ``key``, of a key below it, or of the nearest section above it."""
        key = next((place for place in self.places if place.startswith(f'{key}.')), key)
        while key and key not in self.places:
            key = key.rpartition('.')[0]
        return self.places.get(key, self.name)

    def section(self, key: str) -> dict[str, Any]:
        """Return the mapping under ``key`` (empty if it is omitted)."""
        value = self.values.get(key, {})
        if not isinstance(value, dict):
            self.refuse(key, f'it holds {value!r}; write a mapping of keys below it')
        return value

    def check_keys(self, prefix: str, given: Iterable[str], known: Iterable[str]) -> None:
        """Reject unknown keys, and suggest the nearest known one."""
        known = list(known)
        for key in given:
            if key not in known:
                near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.4)
                hint = f'did you mean {near[0]}?' if near else f'the keys are {", ".join(known)}'
                self.refuse(f'{prefix}{key}', f'unknown key; {hint}')


def read_document(path: Path) -> Document:
    """Read a YAML mapping. Raises MissingError or InputError with the file and, where known, the line."""
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else 'it is not UTF-8 text'
        raise MissingError(f'{path}: cannot be read: {reason}') from None
    return parse_document(str(path), text)


def parse_document(name: str, text: str) -> Document:
    """Parse a YAML mapping; duplicate keys are rejected."""
    document = Document(name, {})
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        check_size(root)
        if root is not None and not isinstance(root, yaml.MappingNode):
            raise InputError(f'{name}: holds no mapping of keys and values')
        if root is not None:
            _collect(document, root, '')
            document.values = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, 'problem_mark', None)
        place = f'{name}:{mark.line + 1}' if mark else name
        raise InputError(f'{place}: is not YAML: {getattr(error, "problem", None) or error}') from None
    return document


def values_of(text: str) -> Any:
    """Return the value of untrusted YAML. Raises YAMLError, ValueError or RecursionError."""
    check_size(yaml.compose(text, Loader=yaml.SafeLoader))
    return yaml.safe_load(text)


def check_size(root: yaml.Node | None) -> None:
    """Raise ValueError where aliases expand to too many values, or a value contains itself."""
    sizes: dict[int, int] = {}

    def size(node: yaml.Node) -> int:
        if id(node) not in sizes:
            sizes[id(node)] = MOST_VALUES + 1       # for a value that contains itself
            sizes[id(node)] = 1 + sum(map(size, _below(node)))
        return sizes[id(node)]
    if root is not None and size(root) > MOST_VALUES:
        raise ValueError(f'with its aliases expanded it has more than {MOST_VALUES} values')


def _below(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _collect(document: Document, node: yaml.MappingNode, prefix: str) -> None:
    """Record the line of each key below ``node``."""
    for key, value in node.value:
        dotted = f'{prefix}{key.value}'
        place = f'{document.name}:{key.start_mark.line + 1}'
        if dotted in document.places:
            raise InputError(f'{place}: {dotted}: is given twice, first in {document.places[dotted]}', field=dotted)
        document.places[dotted] = place
        if isinstance(value, yaml.MappingNode):
            _collect(document, value, f'{dotted}.')
