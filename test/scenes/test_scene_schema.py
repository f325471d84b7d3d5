"""The published schema of scene files is up to date, and accepts and rejects the same files as the reader."""
import json

import pytest
import yaml

from dragon_ros import configuration
from dragon_ros.configuration import scene_names
from dragon_ros.core.errors import InputError
from dragon_ros.scenes.load import load_scene, scene_of, scene_values
from dragon_ros.scenes.schema import scene_schema, text
from dragon_ros.scenes.yaml import parse_document


@pytest.fixture(autouse=True, scope='module')
def _requires_jsonschema():
    pytest.importorskip('jsonschema')


def accepted(document):
    import jsonschema
    try:
        jsonschema.Draft202012Validator(scene_schema()).validate(yaml.safe_load(document) or {})
    except jsonschema.ValidationError:
        return False
    return True


def test_the_published_schema_is_current_and_a_schema():
    import jsonschema
    published = (configuration.folder() / 'scene.schema.json').read_text(encoding='utf-8')
    assert published == text(), 'run ./dragon schemas'
    jsonschema.Draft202012Validator.check_schema(json.loads(published))


@pytest.mark.parametrize('name', scene_names())
def test_every_scene_of_the_package_is_valid_as_written_and_as_completed(name):
    assert accepted((configuration.folder() / 'scenes' / f'{name}.yaml').read_text(encoding='utf-8'))
    assert accepted(yaml.safe_dump(scene_values(load_scene(name))))


@pytest.mark.parametrize('document', [
    'head: {kind: plugin}',
    'dragon: {benchs: 3}', 'track: {kind: circle}', 'effects: [glow]', 'effects: velocity', 'markers: stars',
    'accuracy: best', 'dragon: {benches: many}', 'head: {kind: profile}', 'noise: {seed: 0.5}', 'glow: 1',
    'head: {lead: nose}', 'head: {kind: profile, knots: [[0]]}', 'track: {kind: joined, pieces: [{kind: line}]}',
    'track: {kind: joined, pieces: []}', 'run: 3', 'dragon: {kind: mixed}', 'dragon: {groups: [{length_m: 2}]}',
    'dragon: {kind: mixed, groups: []}', 'dragon: {kind: mixed, groups: [{count: 2}]}',
    'dragon: {kind: mixed, groups: [{length_m: 2}], benches: 1}', 'dragon: {kind: mixed, groups: [{length_m: long}]}'])
def test_what_the_schema_refuses_the_reader_refuses(document):
    assert not accepted(document)
    with pytest.raises(InputError):
        scene_of(parse_document('f', document))


@pytest.mark.parametrize('document', [
    '', 'track: {pitch_m: 0.6}', 'track: {kind: turn, ratio: 1.5}', 'head: {kind: profile, knots: [[0, 0], [5, 1]]}',
    'dragon: {kind: equal, benches: 3}', 'dragon: {kind: mixed, groups: [{length_m: 3}, {count: 2, length_m: 2}]}',
    'accuracy: 1.0e-9', 'accuracy: fine', 'noise: {seed: 7}', 'trails: {seconds: 3}', 'run: {stop_s: null}',
    'effects: []', 'track: {kind: joined, pieces: [{kind: line, length_m: 5, at_m: [0, 1], heading_deg: 90}, '
    '{kind: arc, radius_m: 5, angle_deg: 90}]}'])
def test_what_the_reader_takes_the_schema_takes(document):
    scene_of(parse_document('f', document))
    assert accepted(document)
