"""The JSON Schema of scene files for editors and other programs, generated from their dataclasses.

The schema covers names, types and choices. Limits on numbers are checked when a scene is built, with clearer errors.
"""
import json
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from types import UnionType
from typing import Any, get_args, get_origin

from dragon_ros.core.chain.head_law import LEADERS, RAMPS
from dragon_ros.core.flags import MEANINGS
from dragon_ros.core.promise import REQUESTS
from dragon_ros.core.scene import MARKERS, SOLVERS, Scene
from dragon_ros.scenes.head_laws import PLUGIN
from dragon_ros.scenes.load import PARTS, SECTIONS

Schema = dict[str, Any]

_CHOICES = {'lead': LEADERS, 'ramps': RAMPS, 'side': ('left', 'right')}
_WAYS = {'solver': ('how handles are placed', SOLVERS), 'markers': ('how benches are shown', MARKERS)}
_PLAIN: dict[Any, Schema] = {int: {'type': 'integer'}, float: {'type': 'number'}, str: {'type': 'string'},
                             type(None): {'type': 'null'}}


# Points of a venue are given as pairs, or as text in WKT notation.
_POINTS: Schema = {'anyOf': [{'type': 'array', 'minItems': 2, 'items': {
    'type': 'array', 'prefixItems': [{'type': 'number'}] * 2, 'items': False, 'minItems': 2}}, {'type': 'string'}]}
_VENUE_FILE: Schema = {
    'file': {'description': 'map with the obstacles and the inside, relative to this file',
             'type': 'string', 'default': None},
    'origin_deg': {'description': 'the older form of origin.lon_lat_deg',
                   'type': ['array', 'null'], 'items': {'type': 'number'}, 'minItems': 2, 'maxItems': 2,
                   'default': None}}
_PLUGIN: Schema = {
    'description': 'A custom head law: the name of its entry point, and its settings (docs/ros.md).',
    'type': 'object', 'additionalProperties': False, 'required': ['kind', 'law'],
    'properties': {'kind': {'const': PLUGIN}, 'law': {'type': 'string'},
                   'settings': {'type': 'object', 'default': {}}}}


def scene_schema() -> Schema:
    """Return the schema of a whole scene file."""
    parts = {name: _section(kinds) for name, kinds in SECTIONS.items()}
    parts['head']['oneOf'].append(_PLUGIN)
    parts['venue']['properties'] |= _VENUE_FILE
    defaults = Scene()
    parts['accuracy'] = {'description': 'largest position error allowed, in metres', 'default': defaults.accuracy,
                         'anyOf': [{'type': 'number', 'exclusiveMinimum': 0}, {'enum': ['paper', *REQUESTS]}]}
    parts['effects'] = {
        'description': 'results to simulate besides the handles', 'type': 'array', 'default': defaults.effects.names,
        'items': {'oneOf': [{'const': effect.names[0], 'description': text} for effect, text in MEANINGS.items()]}}
    for name, (text, choices) in _WAYS.items():
        parts[name] = {'description': text, 'enum': list(choices), 'default': getattr(defaults, name)}
    return {'$schema': 'https://json-schema.org/draft/2020-12/schema', 'title': 'A scene of dragon_ros',
            'description': 'Omitted keys have their default values.', 'type': 'object', 'additionalProperties': False,
            'properties': parts}


def text() -> str:
    """Return the schema as the text of its file."""
    return json.dumps(scene_schema(), indent=1) + '\n'


def _section(kinds: Mapping[str, type]) -> Schema:
    """Return the schema of a section, which accepts any of its kinds; the first kind is the default."""
    made = [kind_schema(name, one, needed=number > 0) for number, (name, one) in enumerate(kinds.items())]
    return made[0] if len(made) == 1 else {'oneOf': made}


def kind_schema(name: str, one: type, needed: bool) -> Schema:
    """Return the schema of one dataclass; ``needed`` states whether the kind must be given."""
    properties = {field.name: _field(field) for field in fields(one)}
    required = [field.name for field in fields(one) if field.default is MISSING]
    if name:
        properties = {'kind': {'const': name}, **properties}
        required = ['kind', *required] if needed else required
    return {'description': (one.__doc__ or '').split('\n')[0], 'type': 'object', 'additionalProperties': False,
            'properties': properties, **({'required': required} if required else {})}


def _field(field: 'Field[Any]') -> Schema:
    default = {} if field.default is MISSING else {'default': field.default}
    if field.name in _CHOICES:
        return {'enum': list(_CHOICES[field.name]), **default}
    if field.name in PARTS:
        made = [kind_schema(name, one, needed=True) for name, one in PARTS[field.name].items()]
        least: Schema = {'minItems': 1} if field.default is MISSING else {'default': []}
        return {'type': 'array', **least, 'items': made[0] if len(made) == 1 else {'oneOf': made}}
    if field.name == 'holes_m':
        return {'type': 'array', 'items': _POINTS, 'default': []}
    if field.name in ('points_m', 'inside'):
        return {'anyOf': [*_POINTS['anyOf'], *([{'type': 'null'}] if default else [])], **default}
    return {**_type(field.type), **default}


def _type(kind: Any) -> Schema:
    """Return the schema of an annotation."""
    if isinstance(kind, UnionType):
        return {'anyOf': [_type(one) for one in get_args(kind)]}
    if get_origin(kind) is tuple:
        items = get_args(kind)
        if items[-1] is Ellipsis:
            return {'type': 'array', 'items': _type(items[0])}
        return {'type': 'array', 'prefixItems': [_type(one) for one in items], 'items': False, 'minItems': len(items)}
    return _PLAIN[kind]
