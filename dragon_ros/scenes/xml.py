"""Parse XML drawings within budgets; entities, which can grow without bound, are rejected."""
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree
from xml.parsers import expat

from dragon_ros.core.errors import InputError, shown
from dragon_ros.core.limits import XML_DEPTH

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


def tree(path: Path, data: bytes, what: str, most_elements: int) -> 'Element':
    """Parse a file; reject it while parsing if it declares entities, is nested too deeply or has too many elements."""
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate(namespace_separator='}')
    depth, count = 0, 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > XML_DEPTH or count > most_elements:
            raise InputError(f'{path}: it is nested {depth} levels deep or has {count} elements; the limits are '
                             f'{XML_DEPTH} and {most_elements}')
        builder.start(_qualified(tag), {_qualified(key): value for key, value in attributes.items()})

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(_qualified(tag))

    def entity(*_: object) -> None:
        raise InputError(f'{path}: it declares entities, which are not supported; save it as plain {what}')

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.EntityDeclHandler = builder.data, entity
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(f'{path}: it is not {what}: {error}') from None
    except ValueError as error:     # Python does not support the encoding
        raise InputError(f'{path}: it is not {what}: {shown(str(error))[1:-1]}') from None
    return builder.close()


def _qualified(name: str) -> str:
    return f'{{{name}' if '}' in name else name


def local_name(element: 'Element') -> str:
    """Return the tag of an element without its namespace."""
    return str(element.tag).rpartition('}')[2]
