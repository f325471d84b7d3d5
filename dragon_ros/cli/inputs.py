"""What a package beside dragon_ros needs to read and write its own files as scene files are read, and to word errors.

Such a package uses only ``import dragon_ros`` and ``dragon_ros.cli``; the names below come from the rooms under it.
They are imported on first use, so that ``--help`` stays fast.
"""
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dragon_ros.bags.write import COMPRESSIONS
    from dragon_ros.bags.write.lock import lock
    from dragon_ros.configuration import folder as configuration_folder
    from dragon_ros.core.checks import choice, number, settle, whole
    from dragon_ros.core.domain import COORDINATE, PITCH, SPEED
    from dragon_ros.core.errors import (
        DiskError,
        DragonError,
        FieldError,
        InputError,
        MissingError,
        naming_arguments,
        shown,
    )
    from dragon_ros.core.limits import Limit
    from dragon_ros.core.numerics.types import Floats, Ints, read_only
    from dragon_ros.core.words import COLUMNS, counted
    from dragon_ros.scenes.load import changed_scene, scene_of, scene_values
    from dragon_ros.scenes.provenance import versions
    from dragon_ros.scenes.schema import Schema, kind_schema, scene_schema
    from dragon_ros.scenes.yaml import Document, parse_document, plain_number, read_document
    from dragon_ros.version import __version__

__all__ = [
    'COLUMNS', 'COMPRESSIONS', 'COORDINATE', 'PITCH', 'SPEED', 'DiskError', 'Document', 'DragonError', 'FieldError',
    'Floats', 'InputError', 'Ints', 'Limit', 'MissingError', 'Schema', '__version__', 'changed_scene', 'choice',
    'configuration_folder', 'counted', 'kind_schema', 'lock', 'naming_arguments', 'number', 'parse_document',
    'plain_number', 'read_document', 'read_only', 'scene_of', 'scene_schema', 'scene_values', 'settle', 'shown',
    'versions', 'whole']
_FROM = {
    'dragon_ros.bags.write': 'COMPRESSIONS',
    'dragon_ros.bags.write.lock': 'lock',
    'dragon_ros.core.checks': 'choice number settle whole',
    'dragon_ros.core.domain': 'COORDINATE PITCH SPEED',
    'dragon_ros.core.errors': 'DiskError DragonError FieldError InputError MissingError naming_arguments shown',
    'dragon_ros.core.limits': 'Limit',
    'dragon_ros.core.numerics.types': 'Floats Ints read_only',
    'dragon_ros.core.words': 'COLUMNS counted',
    'dragon_ros.scenes.load': 'changed_scene scene_of scene_values',
    'dragon_ros.scenes.provenance': 'versions',
    'dragon_ros.scenes.schema': 'Schema kind_schema scene_schema',
    'dragon_ros.scenes.yaml': 'Document parse_document plain_number read_document',
    'dragon_ros.version': '__version__',
}
_PLACES = {name: module for module, names in _FROM.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Import a name on first use (PEP 562)."""
    if name == 'configuration_folder':
        return import_module('dragon_ros.configuration').folder
    if name in _PLACES:
        return getattr(import_module(_PLACES[name]), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
