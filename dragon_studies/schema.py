"""The JSON Schema of study files for editors and other programs, generated from the package's dataclasses.

The schema covers names, types and choices. Checks that need the base scene (for example, whether a key can be varied)
are made when a study is read, with clearer errors.
"""
import json

from dragon_ros.cli.inputs import Schema, kind_schema, scene_schema
from dragon_studies.definition import DESIGNS, Study
from dragon_studies.questions import QUESTIONS

_PAIR: Schema = {'type': 'array', 'items': {'type': 'number'}, 'minItems': 2, 'maxItems': 2}
_ENDS: dict[str, Schema] = {'from': {'type': 'number'}, 'to': {'type': 'number'}}
_PER: Schema = {'description': 'one value for each bench of a group', 'const': 'bench'}


def _form(description: str, required: list[str], **properties: Schema) -> Schema:
    return {'description': description, 'type': 'object', 'additionalProperties': False, 'required': required,
            'properties': properties}


_VARIATION: Schema = {'anyOf': [
    {'description': 'a list', 'type': 'array', 'minItems': 1, 'items': {'type': ['number', 'string', 'boolean']}},
    _form('from low to high, both included', ['from', 'to'], **_ENDS, steps={'type': 'integer', 'minimum': 2}),
    _form('uniformly distributed between two values', ['uniform'], uniform=_PAIR, per=_PER),
    _form('mean and standard deviation, truncated', ['normal', 'within'], normal=_PAIR, within=_PAIR, per=_PER)]}


def study_schema() -> Schema:
    """Return the schema of a whole study file."""
    scene = {key: value for key, value in scene_schema().items() if key != '$schema'}
    questions = {name: {'anyOf': [{'type': 'null'}, kind_schema('', kind, needed=False)]}
                 for name, kind in QUESTIONS.items()}
    parts = {
        'scene': {'description': 'the base scene: a name, a file, or the keys of a scene file',
                  'anyOf': [{'type': 'string'}, scene], 'default': 'winding'},
        'set': {'description': 'keys of the base scene to change', 'type': 'object',
                'properties': scene['properties']},
        'vary': {'description': 'the variations, by dotted keys such as track.pitch_m', 'type': 'object',
                 'minProperties': 1, 'additionalProperties': _VARIATION},
        'design': {'description': 'how points are chosen; saltelli estimates the influence of each key',
                   'enum': list(DESIGNS), 'default': Study.design},
        'samples': {'description': 'number of points; ignored for a grid', 'type': 'integer', 'minimum': 1},
        'seed': {'description': 'ignored for a grid', 'type': 'integer', 'minimum': 0, 'default': Study.seed},
        'ask': {'description': 'the questions about each scene', 'anyOf': [
            {'type': 'array', 'minItems': 1, 'items': {'enum': list(QUESTIONS)}},
            {'type': 'object', 'minProperties': 1, 'additionalProperties': False, 'properties': questions}]},
        'budget_s': {'description': 'CPU seconds that a row may take', 'type': 'number', 'exclusiveMinimum': 0,
                     'default': Study.budget_s},
        'about': {'description': 'free-form notes, which have no effect', 'type': 'object'}}
    return {'$schema': 'https://json-schema.org/draft/2020-12/schema', 'title': 'A study of dragon_ros',
            'description': 'The scenes to compute, and the questions to answer about each.', 'type': 'object',
            'additionalProperties': False, 'required': ['vary', 'ask'], 'properties': parts}


def text() -> str:
    """Return the schema as the text of its file."""
    return json.dumps(study_schema(), indent=1) + '\n'
