"""Study files are read like scenes and are self-contained; errors name file, line and key."""
import json

import pytest
import yaml

from dragon_ros import configuration
from dragon_ros.core.errors import InputError, MissingError
from dragon_studies.definition import load_study, study_names
from dragon_studies.rows import parsed
from dragon_studies.schema import study_schema, text

MIXED = 'set: {dragon: {kind: mixed, groups: [{length_m: 3.41}, {count: 4, length_m: 2.2}]}}\n'
GRID = 'vary: {track.pitch_m: [0.5, 0.6]}\nask: [lock]\n'


def test_a_study_is_the_same_when_it_is_written_and_read_again(study):
    for words in (GRID, MIXED +
                  'vary: {dragon.groups.2.length_m: {normal: [2.2, 0.01], within: [2.1, 2.3], per: bench}}\n'
                  'design: sobol\nsamples: 3\nseed: 9\nask: {min_pitch: {diameter_m: 8}, contact: }\nbudget_s: 3'):
        one = study(words)
        assert parsed(one.text) == one
        assert parsed(one.text).text == one.text


def test_a_study_takes_a_scene_by_name_by_file_beside_it_or_written_out(tmp_path):
    (tmp_path / 'mine.yaml').write_text('track: {pitch_m: 0.7}')
    for scene, pitch_m in (('unwinding', 0.55), ('mine.yaml', 0.7), ('{track: {pitch_m: 0.8}}', 0.8)):
        (tmp_path / 'study.yaml').write_text(f'scene: {scene}\n{GRID}')
        assert load_study(str(tmp_path / 'study.yaml')).scene.track.pitch_m == pitch_m


def test_a_range_on_a_whole_number_gives_whole_numbers_and_a_grid_counts_itself(study):
    one = study('vary: {dragon.benches: {from: 3, to: 9, steps: 4}, head.lead: [head, tail]}\nask: [lock]')
    assert one.rows == 8


def test_samples_can_be_changed_but_not_those_of_a_grid(study):
    assert study().with_samples(99).rows == 99
    with pytest.raises(InputError, match='samples: 3 is not valid: the number of points of a grid is fixed at 2'):
        study(GRID).with_samples(3)


@pytest.mark.parametrize(('words', 'error'), [
    ('vary: {track.pitch: [1]}\nask: [lock]', r'f.yaml:1: vary.track.pitch: .*the base scene has no such key'),
    ('vary: {track: [1]}\nask: [lock]', 'not a single value'),
    ('vary: {track.pitch_m: 0.5}\nask: [lock]', r'f.yaml:1: vary.track.pitch_m: 0.5 is not a list'),
    ('vary: {track.pitch_m: []}\nask: [lock]', '1 to 100000 values'),
    ('vary: {track.pitch_m: [a, 1]}\nask: [lock]', 'numbers or words'),
    ('vary: {track.pitch_m: {from: 2, to: 1, steps: 2}}\nask: [lock]', r'vary.track.pitch_m.to: 1.* not above 2'),
    ('vary: {track.pitch_m: {from: 1}}\nask: [lock]', 'to: it is missing'),
    ('vary: {track.pitch_m: {from: 1, too: 2}}\nask: [lock]', 'did you mean to'),
    ('vary: {track.pitch_m: {from: 1, to: 2}}\nask: [lock]', 'a grid needs lists, or ranges with steps'),
    ('vary: {track.pitch_m: [1]}\nask: {min_pitch: {smallest_m: few}}', 'ask.min_pitch.smallest_m: .few. is not'),
    ('vary: {track.pitch_m: {uniform: [1, 2]}}\nask: [lock]', 'a grid needs lists'),
    ('vary: {track.pitch_m: {uniform: 1}}\ndesign: random\nsamples: 1\nask: [lock]', 'not a pair'),
    ('vary: {track.pitch_m: {normal: [1, 2]}}\ndesign: random\nsamples: 1\nask: [lock]', 'within: it is missing'),
    ('vary: {track.pitch_m: {normal: [1, 0.1], within: [5, 6]}}\ndesign: random\nsamples: 1\nask: [lock]',
     '6 standard deviations or more'),
    ('vary: {track.pitch_m: {uniform: [1, 2], per: bench}}\ndesign: random\nsamples: 1\nask: [lock]',
     'only a group of mixed benches'),
    ('vary: {track.pitch_m: {uniform: [1, 2], per: day}}\ndesign: random\nsamples: 1\nask: [lock]', 'write per: bench'),
    ('vary: {head.lead: {from: 1, to: 2, steps: 2}}\nask: [lock]', 'its value is a word'),
    ('vary: {dragon.benches: [3, 3.5]}\nask: [lock]', r'f.yaml:1: vary.dragon.benches: 3.5 .* a whole number, 223'),
    ('vary: {track.pitch_m: [1]}\nask: [luck]', 'did you mean lock'),
    ('vary: {track.pitch_m: [1]}\nask: 3', 'is not a list'),
    ('vary: {track.pitch_m: [1]}\nask: {fit: {square: 3}}', 'did you mean square_m'),
    ('vary: {track.pitch_m: [1]}\nask: {fit: {square_m: -3}}', 'ask.fit.square_m: -3'),
    ('vary: {track.pitch_m: [1]}', 'asks at least one question'),
    ('ask: [lock]', 'varies at least one key'),
    ('vary: {track.pitch_m: [1]}\nask: [lock]\ndesign: fancy', 'f.yaml:3: design: .*grid, random, sobol, saltelli'),
    ('vary: {track.pitch_m: [1]}\nask: [lock]\nsamples: 3', 'the number of points of a grid is fixed'),
    ('vary: {track.pitch_m: [1]}\nask: [lock]\ndesign: random\nsamples: 0', 'f.yaml:4: samples: 0'),
    ('vary: {track.pitch_m: [1], dragon.width_m: [1]}\nask: [lock]\ndesign: saltelli\nsamples: 3', 'a power of 2'),
    ('vary: {track.pitch_m: [1]}\nask: [lock]\ndesign: saltelli\nsamples: 4', 'vary at least two'),
    ('vary: {track.pitch_m: [1]}\nask: [lock]\nbudget_s: 0', 'f.yaml:3: budget_s'),
    ('vary: {track.pitch_m: [1]}\nask: [lock]\nseeds: 1', 'did you mean seed'),
    ('scene: nowhere\nvary: {track.pitch_m: [1]}\nask: [lock]', 'f.yaml:1: scene: .*nowhere.* is not known'),
    ('scene: {track: {pitch_m: -1}}\nvary: {track.pitch_m: [1]}\nask: [lock]', 'track.pitch_m: -1'),
    ('scene: {}\nset: {run: {}}\nvary: {track.pitch_m: [1]}\nask: [lock]', 'a scene that is given in full'),
    ('set: {track: {pitch_m: x}}\nvary: {track.pitch_m: [1]}\nask: [lock]', 'track.pitch_m'),
])
def test_an_unacceptable_study_is_refused_with_its_place(study, words, error):
    with pytest.raises(InputError, match=error):
        study(words)


def test_an_unknown_study_is_refused_with_those_that_there_are():
    with pytest.raises(MissingError, match='pitch_map, tolerances'):
        load_study('nothing')


@pytest.mark.parametrize('name', study_names())
def test_the_studies_of_the_package_are_good_and_follow_the_schema(name):
    jsonschema = pytest.importorskip('jsonschema')
    assert load_study(name).rows > 50
    path = configuration.folder() / 'studies' / f'{name}.yaml'
    for values in (yaml.safe_load(path.read_text()), yaml.safe_load(load_study(name).text)):
        jsonschema.Draft202012Validator(study_schema()).validate(values)


def test_the_published_schema_is_current_and_a_schema():
    jsonschema = pytest.importorskip('jsonschema')
    published = (configuration.folder() / 'study.schema.json').read_text(encoding='utf-8')
    assert published == text(), 'run ./dragon schemas'
    jsonschema.Draft202012Validator.check_schema(json.loads(published))


@pytest.mark.parametrize('words', ['vary: 3', 'vary: {track.pitch_m: 0.5}', 'vary: {}', 'ask: [luck]', 'seed: a',
                                   'design: fancy', 'vary: {track.pitch_m: {from: 1}}', 'samples: 0', 'colour: 1',
                                   'vary: {track.pitch_m: {uniform: [1]}}', 'ask: {fit: {square: 1}}'])
def test_what_the_schema_refuses_the_reader_refuses(study, words):
    jsonschema = pytest.importorskip('jsonschema')
    values = {**yaml.safe_load(GRID), **yaml.safe_load(words)}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft202012Validator(study_schema()).validate(values)
    with pytest.raises(InputError):
        study(yaml.safe_dump(values))
