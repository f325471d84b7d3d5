import re

import pytest
import yaml

from dragon_ros.configuration import scene_names
from dragon_ros.core.errors import DragonError, InputError, MissingError
from dragon_ros.core.flags import Effect
from dragon_ros.core.scene import Run, Scene
from dragon_ros.messages.channels import channels, channels_of, live
from dragon_ros.scenes.load import load_scene, scene_of, scene_values, strangers_scene
from dragon_ros.scenes.yaml import parse_document


def text_of(scene):
    """A complete scene file."""
    return yaml.safe_dump(scene_values(scene), sort_keys=False)


def test_winding_is_the_default_scene_of_the_code():
    assert load_scene('winding') == Scene()


def test_first_contact_says_only_when_it_runs():
    assert load_scene('first_contact') == Scene(run=Run(400, 413))


@pytest.mark.parametrize('name', scene_names())
def test_scenes_survive_a_round_trip(name):
    scene = load_scene(name)
    assert scene_of(parse_document('again', text_of(scene))) == scene


def test_an_empty_file_is_the_classic_scene():
    assert scene_of(parse_document('empty', '# nothing')) == Scene()


@pytest.mark.parametrize(('text', 'says'), [
    ('track:\n  pich_m: 1', r'f:2: track.pich_m: unknown key; did you mean pitch_m\?'),
    ('drago: {}', r'f:1: drago: unknown key; did you mean dragon\?'),
    ('dragon:\n  benches: 0', r'f:2: dragon.benches: 0 .* smallest is 1'),
    ('dragon:\n  benches: two', r'f:2: dragon.benches: .* not a whole number'),
    ('dragon:\n  benches: 2.5', r'f:2: dragon.benches: 2.5 is not valid: it is a fraction, not a whole number'),
    ('dragon:\n  benches: 30.0', r'f:2: dragon.benches: 30.0 is not valid: .* decimal point or exponent; write 30$'),
    ('dragon:\n  benches: .inf', r'f:2: dragon.benches: inf is not valid: it is not finite'),
    ('track:\n\n  pitch_m: -0.55', r'f:3: track.pitch_m: -0.55'),
    ('track: 3', r'f:1: track: its value is 3; write a mapping'),
    ('run:', r'f:1: run: its value is None'),
    ('effects: velocity', r'f:1: effects: .* not a list'),
    ('effects: [velocty]', r'f:1: effects: .velocty.'),
    ('markers: cube', r'f:1: markers: .cube. .* cubes, triangles'),
    ('markers: [cubes]', r'f:1: markers: '),
    ('accuracy: 1e-16', r'f:1: accuracy: 1e-16 .* 2e-12'),
    ('head: {speed_m_s: yes}', r'f:1: head.speed_m_s: True'),
    ('head: {speed_m_s: .nan}', r'f:1: head.speed_m_s: nan'),
    ('head: {}\nhead: {}', r'f:2: head: it is given twice, first in f:1'),
    ('run: {stop_s: 1, start_s: 2}', r'f:1: run.stop_s: 1'),
    ('track: {kind: circle}', r'f:1: track.kind: .circle. is not known'),
    ('dragon: {kind: [a]}', r'f:1: dragon.kind: ..a.. is not known'),
    (f'dragon: {{benches: {"9" * 400}}}', r'f:1: dragon.benches: 9+\.\.\.9+ is not valid: it is not finite'),
    (f'track: {{pitch_m: 0x{"f" * 9000}}}', r'f:1: track.pitch_m: a huge int is not valid: it is not finite'),
    ('[' * 60_000, r'f:1: it is not YAML: it is nested more than 32 levels deep'),
    ('? ' * 30_000, r'f:1: it is not YAML: it is nested more than 32 levels deep'),
    ('\n'.join(' ' * n + 'a:' for n in range(60)), r'f:33: it is not YAML: it is nested more than 32 levels deep'),
    ('run: !!int ""', r'f: it is not YAML: a value does not match its tag'),
    ('run: !!bool x', r'f: it is not YAML: a value does not match its tag'),
    ('run: !!timestamp x', r'f: it is not YAML: a value does not match its tag'),
    ('a: [', r'f:\d: it is not YAML'),
    ('- a', r'f: it is not a mapping'),
    ('&a [*a]', r'f: '),
    ('track: {pitch_m: 1e400}', r'f:1: track.pitch_m'),
    ('1: 2', r'f:1: 1: unknown key'),
    ('track: {kind: turn, start_turns: 3}', r'f:1: track.start_turns: unknown key for kind turn; it belongs to kind: '
                                            r'spiral'),
    ('track: {kind: turn, ratio: 3}', r'f:1: track.ratio: .*bends tighter than'),
    ('track: {kind: joined}', r'f:1: track.pieces: it is missing; kind joined requires it'),
    ('track: {kind: joined, pieces: 3}', r'f:1: track.pieces: 3 is not a list of pieces'),
    ('track: {kind: joined, pieces: [3]}', r'f:1: track.pieces.1: its value is 3; write for example'),
    ('track: {kind: joined, pieces: [{kind: bow}]}', r'f:1: track.pieces.1.kind: .bow. is not known; the kinds are'),
    ('track: {kind: joined, pieces: [{kind: line}]}', r'f:1: track.pieces.1.length_m: it is missing'),
    ('track: {kind: joined, pieces: [{kind: line, length: 1}]}', r'f:1: .*did you mean length_m'),
    ('track: {kind: joined, pieces: [{kind: line, length_m: 1, at_m: 3}]}', r'f:1: .*at_m: 3 is not a point'),
    ('dragon: {kind: mixed}', r'f:1: dragon.groups: it is missing; kind mixed requires it'),
    ('dragon:\n  groups: [{length_m: 2}]', r'f:2: dragon.groups: unknown key for kind equal; .* kind: mixed'),
    ('dragon: {kind: mixed, benches: 3}', r'f:1: dragon.benches: unknown key for kind mixed; .* kind: equal'),
    ('dragon: {kind: mixed, groups: 3}', r'f:1: dragon.groups: 3 is not a list of groups; write for example'),
    ('dragon: {kind: mixed, groups: []}', r'f:1: dragon.groups: 0 .* 1 to 20000 groups'),
    ('dragon: {kind: mixed, groups: [3]}', r'f:1: dragon.groups.1: its value is 3; write for example {count: 100'),
    ('dragon: {kind: mixed, groups: [{count: 3}]}', r'f:1: dragon.groups.1.length_m: it is missing'),
    ('dragon: {kind: mixed, groups: [{length_m: 2, counts: 3}]}', r'f:1: dragon.groups.1.counts: .*did you mean count'),
    ('dragon:\n  kind: mixed\n  groups: [{length_m: 2}, {length_m: 0.5}]', r'f:3: dragon.groups.2.length_m: 0.5 .*'),
    ('dragon: {kind: mixed, groups: [{length_m: 2, count: two}]}', r'f:1: dragon.groups.1.count: .*not a whole number'),
    ('dragon: {kind: mixed, groups: [{length_m: 2, count: 0}]}', r'f:1: dragon.groups.1.count: 0 .* smallest is 1'),
    ('head: {kind: profile}', r'f:1: head.knots: it is missing'),
    ('head: {kind: profile, knots: [1, 2]}', r'f:1: head.knots: .* is not a list of pairs'),
    ('head: {kind: profile, knots: [[0, fast]]}', r'f:1: head.knots.1: .fast. is not valid: it is text'),
    ('head: {lead: middle}', r'f:1: head.lead: .middle.'),
    ('accuracy: paper\nhead: {lead: tail}', r'f: solver: .paper.* one spiral, led by the head'),
], ids=lambda text: text[:40])
def test_bad_scenes_name_file_line_and_key_with_and_without_libyaml(monkeypatch, text, says):
    for fast in (True, False):
        if not fast:
            monkeypatch.delattr(yaml, 'CSafeLoader', raising=False)
        with pytest.raises(InputError) as error:
            scene_of(parse_document('f', text))
        assert re.match(says, str(error.value)), str(error.value)


@pytest.mark.parametrize('text', [
    'dragon: {kind: mixed, groups: [{length_m: 3.41}, {count: 100, length_m: 2.2}], width_m: 0.2}',
    'track: {kind: turn, ratio: 1.5, before_m: 3}\nhead: {lead: tail}\nrun: {stop_s: 1}',
    'head: {kind: profile, ramps: smooth, knots: [[0, 1], [1e1, -2]]}\nrun: {stop_s: 1}',
    """
track:
  kind: joined
  start_m: 3
  pieces:
    - {kind: line, length_m: 5, at_m: [1, 2], heading_deg: 30}
    - {kind: arc, radius_m: 3, angle_deg: -90}
    - {kind: spiral, pitch_m: 1.7, from_turns: 2, to_turns: 4, side: left}
"""])
def test_every_kind_of_dragon_track_and_law_survives_a_round_trip(text):
    scene = scene_of(parse_document('f', text))
    assert scene_of(parse_document('again', text_of(scene))) == scene
    assert text_of(scene_of(parse_document('again', text_of(scene)))) == text_of(scene)


def test_a_kind_can_be_overridden_with_its_keys():
    scene = load_scene('turning', ['track.ratio=1', 'head.kind=profile', 'head.knots=[[0, 2]]'])
    assert (scene.track.ratio, scene.head.knots) == (1, ((0, 2),))


def test_numbers_that_yaml_takes_for_text_are_numbers():
    assert scene_of(parse_document('f', 'accuracy: 1e-9')).accuracy == 1e-9


@pytest.mark.parametrize('text', ['dragon: {benches: "40"}', 'dragon: {width_m: "0.3"}'])
def test_a_number_in_quotes_is_refused_with_its_cure(text):
    with pytest.raises(InputError, match=r'it is text, not a .*number; write [\d.]+ without quotes'):
        scene_of(parse_document('f', text))


def test_the_scene_of_a_file_that_is_there_is_read_whatever_its_suffix(tmp_path, monkeypatch):
    (tmp_path / 'street.txt').write_text('dragon: {benches: 7}')
    monkeypatch.chdir(tmp_path)
    assert load_scene('street.txt').dragon.benches == 7


STREET = """
track:
  kind: joined
  pieces:
    - {kind: line, length_m: 60}
    - kind: arc
      radius_m: 9
      angle_deg: 90
"""


def test_an_override_reaches_a_piece_by_the_number_that_errors_print(tmp_path):
    path = tmp_path / 'street.yaml'
    path.write_text(STREET)
    pieces = load_scene(str(path), ['track.pieces.2.radius_m=5', 'track.pieces.1.length_m=70']).track.pieces
    assert (pieces[0].length_m, pieces[1].radius_m) == (70, 5)
    for bad, says in (('track.pieces.3.radius_m=5', 'count from 1 to 2'), ('track.pieces.0.radius_m=5', 'from 1 to 2'),
                      ('track.pieces.two.radius_m=5', 'count from 1 to 2'), ('track.pieces.2.radius_m=x', 'it is text'),
                      ('track.pieces.1.length_m.x=5', 'length_m is not a section')):
        with pytest.raises(InputError, match=re.escape(f'--set {bad}')) as error:
            load_scene(str(path), [bad])
        assert says in str(error.value)


@pytest.mark.parametrize(('old', 'new', 'line', 'key'), [
    ('radius_m: 9', 'radius_m: 0.1', 5, 'track.pieces.2'),
    ('radius_m: 9', 'radius_m: -1', 6, 'track.pieces.2.radius_m'),
    ('length_m: 60', 'length_m: 0', 4, 'track.pieces.1.length_m')])
def test_an_error_in_a_piece_names_the_line_of_the_piece(old, new, line, key):
    with pytest.raises(InputError, match=f'^f:{line}: {key}: '):
        scene_of(parse_document('f', STREET.replace(old, new).lstrip()))


def test_overrides_reach_any_key_and_say_where_they_are_wrong():
    scene = load_scene('winding', ['dragon.benches=20', 'run.stop_s=3', 'effects=[velocity]'])
    assert (scene.dragon.benches, scene.run.stop_s, scene.effects) == (20, 3, Effect.VELOCITY)
    for bad, says in (('dragon.benchs=3', 'did you mean benches'), ('benches', 'key=value'), ('=3', 'key=value'),
                      ('dragon.benches.x=3', 'benches'), ('head.speed_m_s=[', 'YAML'), ('dragon.=3', 'unknown key'),
                      ('track.pitch_m.=3', 'not a number'), ('.=3', 'unknown key'),
                      (f'solver=0x{"f" * 5000}', 'the choices are table, march')):
        with pytest.raises(InputError, match=re.escape(f'--set {bad[:90]}')) as error:
            load_scene('winding', [bad])
        assert says in str(error.value)


def test_a_scene_that_is_not_there_names_those_that_are():
    with pytest.raises(MissingError, match='the scenes are first_contact, led, long'):
        load_scene('windng')
    with pytest.raises(MissingError, match='cannot be read'):
        load_scene('./nowhere.yaml')


def test_a_binary_file_is_no_scene(tmp_path):
    (tmp_path / 's.yaml').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(DragonError, match='UTF-8'):
        load_scene(str(tmp_path / 's.yaml'))


def test_a_file_that_is_too_large_is_refused_before_it_is_read(tmp_path):
    with pytest.raises(InputError, match=r'/dev/zero: it is too large; the limit for YAML files is \d+ bytes'):
        load_scene('/dev/zero')
    with pytest.raises(MissingError, match='cannot be read: embedded null byte'):
        load_scene('a\0.yaml')


@pytest.mark.parametrize(('text', 'says'), [
    ('# ' + 'x' * 2**16, '65538 characters'),
    ('{head: {speed_m_s: 0}, run: {rate_hz: 10000, stop_s: 2000}}', '20000001 ticks')])
def test_a_stranger_s_scene_beyond_a_budget_is_read_only_if_it_is_trusted(text, says):
    with pytest.raises(InputError, match=f'from here: it has {says}; the limit .* is [0-9]+; give --trust'):
        strangers_scene('from here', text)
    assert strangers_scene('from here', text, trust=True) == scene_of(parse_document('f', text))


def test_topics_follow_the_effects():
    assert [row.name for row in live(Effect.NONE)] == ['handles']
    assert [row.name for row in live(Effect.VELOCITY | Effect.BENCHES)] == ['handles', 'benches', 'velocities']


def test_the_event_is_latched_for_late_joiners():
    assert channels()['collision'].durability == 'transient_local'


@pytest.mark.parametrize(('change', 'says'), [
    ({'qos': {'reliability': 'sure', 'durability': 'volatile', 'depth': 1}}, 'handles.qos.reliability'),
    ({'qos': {'reliability': 'reliable', 'durability': 'volatile', 'depth': 0}}, 'handles.qos.depth'),
    ({'qos': 3}, 'handles.qos'), ({'type': 'PoseArray'}, 'handles.type'), ({'meaning': None}, 'handles.meaning'),
    ({'efect': 'benches'}, 'did you mean effect'), ({'effect': 'glow'}, 'handles.effect'),
])
def test_bad_topic_rows_are_refused_by_key(change, says):
    row = {'type': 'geometry_msgs/msg/PoseArray', 'from': 'sim', 'meaning': 'x',
           'qos': {'reliability': 'reliable', 'durability': 'volatile', 'depth': 10}, **change}
    with pytest.raises(InputError, match=says):
        channels_of(parse_document('t', yaml.safe_dump({'handles': row})))


@pytest.mark.parametrize(('asked', 'meant'), [
    (['winding', 'pich_m=1'], None), (['windng'], 'winding'), (['first_contct'], 'first_contact'),
    (['turn'], 'turning'), (['winding', 'accuracy=good'], None),
    (['obstacles'], None), (['x'], None), (['winding', 'obstacles=[]'], None), (['winding', 'trials={}'], 'trails'),
    (['winding', 'track.pitch=1'], 'pitch_m'), (['winding', 'track.kind=spirl'], 'spiral'),
    (['winding', 'track.kind=square'], None), (['winding', 'effects=[velocty]'], 'velocity'),
    (['winding', 'effects=[fire]'], None), (['winding', 'accuracy=exct'], 'exact'),
    (['winding', 'solver=tabel'], 'table'), (['winding', 'markers=spheres'], None)])
def test_what_is_near_a_name_is_suggested_and_nothing_else(asked, meant):
    with pytest.raises(InputError) as error:
        load_scene(asked[0], asked[1:])
    assert ('did you mean' in str(error.value), f'did you mean {meant}?' in str(error.value)) == (bool(meant),) * 2
