"""Parse YAML documents with the line of every key, and raise errors that name the file, line and key.

ruamel.yaml also keeps lines, but takes 5.4 times as long as this module with libyaml (a scene of 1.8 MB).
"""
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from re import compile as pattern
from typing import Any, NoReturn

import yaml

from dragon_ros.core.errors import InputError, MissingError, did_you_mean, shown
from dragon_ros.core.limits import SCENE_FILE_BYTES, YAML_DEPTH, YAML_VALUES

_EXPONENT = pattern(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+')


@dataclass
class Document:
    """The mapping in a file, the position of each dotted key (``file:line``), and notes for the user."""

    name: str
    values: dict[str, Any]
    places: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def refuse(self, key: str, why: str) -> NoReturn:
        """Raise an InputError that names the position of ``key``."""
        raise InputError(f'{self.place(key)}: {key}: {why}', field=key)

    def place(self, key: str) -> str:
        """Return the position of ``key``, of a key below it, or of the nearest section above it.

        List items are numbered from 1: ``track.pieces.2``. The position of a list is that of its key.
        """
        start = f'{key}.'
        below = (place for place in self.places
                 if place.startswith(start) and not place[len(start):len(start) + 1].isdigit())
        key = key if key.rpartition('.')[2].isdigit() and key in self.places else next(below, key)
        while key and key not in self.places:
            key = key.rpartition('.')[0]
        return self.places.get(key, self.name)

    def section(self, key: str) -> dict[str, Any]:
        """Return the mapping under ``key``, which is empty if the key is omitted."""
        value = self.values.get(key, {})
        if not isinstance(value, dict):
            self.refuse(key, f'its value is {shown(value)}; write a mapping of keys to values')
        return value

    def check_keys(self, prefix: str, given: Iterable[str], known: Iterable[str]) -> None:
        """Reject unknown keys, and suggest the nearest known one."""
        known = list(known)
        for key in given:
            if key not in known:
                hint = did_you_mean(key, known, f'the keys are {", ".join(known)}')
                self.refuse(f'{prefix}{key}', f'unknown key; {hint}')


def read_own(path: Path) -> Document:
    """Read a YAML mapping that comes with the package, using libyaml if available (ten times as fast)."""
    return _document(str(path), path.read_text(encoding='utf-8'), getattr(yaml, 'CSafeLoader', _Loader))


def read_document(path: Path) -> Document:
    """Read a YAML mapping. Raises MissingError or InputError, which name the file and, if known, the line."""
    try:
        with path.open('rb') as file:
            data = file.read(SCENE_FILE_BYTES + 1)
        text = data.decode()
    except OSError as error:
        raise MissingError(f'{path}: cannot be read: {error.strerror}') from None
    except ValueError as error:     # also raised for a path that contains a NUL character
        reason = 'it is not UTF-8 text' if isinstance(error, UnicodeDecodeError) else str(error)
        raise MissingError(f'{shown(str(path))[1:-1]}: cannot be read: {reason}') from None
    if len(data) > SCENE_FILE_BYTES:
        raise InputError(f'{path}: it is too large; the limit for YAML files is {SCENE_FILE_BYTES} bytes')
    return parse_document(str(path), text)


def parse_document(name: str, text: str) -> Document:
    """Parse a YAML mapping; duplicate keys are rejected."""
    return _document(name, text, _Loader)


def _document(name: str, text: str, kind: Callable[[str], Any]) -> Document:
    document = Document(name, {})
    try:
        loader, root = _composed(text, kind)
        check_size(root)
        if root is not None and not isinstance(root, yaml.MappingNode):
            raise InputError(f'{name}: it is not a mapping of keys to values')
        if root is not None:
            _collect(document, root, '')
            document.values = _value_of(loader, root)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, 'problem_mark', None)
        place = f'{name}:{mark.line + 1}' if mark else name
        raise InputError(f'{place}: it is not YAML: {getattr(error, "problem", None) or error}') from None
    return document


def _composed(text: str, kind: Callable[[str], Any]) -> tuple[Any, yaml.Node | None]:
    """Return a loader and the root node of a text, using libyaml if PyYAML includes it, because it is faster.

    ``kind`` reads texts that libyaml rejects or that are nested too deeply, because the errors of ``kind`` quote the
    text and the position. Raises YAMLError or ValueError.
    """
    fast = getattr(yaml, 'CSafeLoader', None)
    if fast is not None and kind is _Loader:
        with suppress(yaml.YAMLError, UnicodeError):
            if _is_shallow(text, fast):
                loader = fast(text)
                return loader, loader.get_single_node()
    loader = kind(text)
    return loader, loader.get_single_node()


def _is_shallow(text: str, kind: Any) -> bool:
    """Return whether a text is within the nesting limit; libyaml composes nodes recursively."""
    depth = 0
    for event in yaml.parse(text, kind):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > YAML_DEPTH:
            return False
    return True


def values_of(text: str) -> Any:
    """Return the value of untrusted YAML. Raises YAMLError, ValueError or RecursionError."""
    loader = _Loader(text)
    root = loader.get_single_node()
    check_size(root)
    return None if root is None else _value_of(loader, root)


def _value_of(loader: Any, root: yaml.Node) -> Any:
    """Return the value of a node. Raises YAMLError, ValueError or RecursionError."""
    try:
        return loader.construct_document(root)
    except (AttributeError, LookupError, TypeError, OverflowError) as error:    # raised for a tag such as !!int ''
        raise ValueError(f'a value does not match its tag ({error})') from None


class _Loader(yaml.SafeLoader):
    """A loader that rejects deep nesting while scanning, because PyYAML would take quadratic time and then recurse."""

    def fetch_flow_collection_start(self, kind: Any) -> None:
        self._refuse_deeper_than(self.flow_level)
        super().fetch_flow_collection_start(kind)

    def add_indent(self, column: int) -> bool:
        self._refuse_deeper_than(len(self.indents))
        return bool(super().add_indent(column))

    def _refuse_deeper_than(self, depth: int) -> None:
        if depth >= YAML_DEPTH:
            mark = self.get_mark()
            raise yaml.scanner.ScannerError(None, None, f'it is nested more than {YAML_DEPTH} levels deep', mark)


def check_size(root: yaml.Node | None) -> None:
    """Raise ValueError if aliases expand to too many values, or if a value contains itself."""
    sizes: dict[int, int] = {}

    def size(node: yaml.Node) -> int:
        if id(node) not in sizes:
            sizes[id(node)] = YAML_VALUES + 1       # a value that contains itself counts as too many values
            sizes[id(node)] = 1 + sum(map(size, _below(node)))
        return sizes[id(node)]
    if root is not None and size(root) > YAML_VALUES:
        raise ValueError(f'it has more than {YAML_VALUES} values after its aliases are expanded')


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
            raise InputError(f'{place}: {dotted}: it is given twice, first in {document.places[dotted]}', field=dotted)
        document.places[dotted] = place
        if isinstance(value, yaml.MappingNode):
            _collect(document, value, f'{dotted}.')
        elif isinstance(value, yaml.SequenceNode):
            _collect_items(document, value, dotted)


def _collect_items(document: Document, node: yaml.SequenceNode, key: str) -> None:
    """Record the line of each mapping in a list, and of its keys."""
    for n, item in enumerate(node.value, 1):
        if isinstance(item, yaml.MappingNode):
            document.places[f'{key}.{n}'] = f'{document.name}:{item.start_mark.line + 1}'
            _collect(document, item, f'{key}.{n}.')


def plain_number(value: Any) -> Any:
    """Convert text such as 1e-9, which YAML 1.1 does not parse as a number; return other values unchanged."""
    return float(value) if isinstance(value, str) and _EXPONENT.fullmatch(value) else value
