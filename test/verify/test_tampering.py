"""Every change that makes a certificate false is rejected with its own error."""
import copy
import re
from functools import cache

import pytest
from certificates import proved, refusal, written

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn

LAW = Profile(((0.0, 0.3), (1.0, -1.0), (9.0, -1.2)), 'smooth')
KINDS = {
    'contact': Scene(dragon=Dragon(12), run=Run(411.5, 413.0)),
    'none': Scene(dragon=Dragon(12), run=Run(410.5, 412.4)),
    'lock': Scene(dragon=Dragon(3, width_m=0.01), run=Run(430.0)),
    'start': Scene(dragon=Dragon(12), run=Run(413.0)),
    'law': Scene(dragon=Dragon(14, 0.9, 2.9, 0.2), track=Spiral(0.55, 4.28), run=Run(0, 9), head=LAW),
    'tail': Scene(dragon=Dragon(14, 0.9, 2.9, 0.2), track=Spiral(0.55, 4.28), head=Head(1.0, 'tail'), run=Run(0, 5)),
    'mixed': Scene(dragon=Mixed((Group(2.0), Group(1.4, 9), Group(2.9, 2))), track=Spiral(0.5, 4.0), run=Run(0, 60)),
    'turn': Scene(dragon=Dragon(18), track=STurn(0.8, before_m=100.0), run=Run(110, 114)),
    'joined': Scene(dragon=Dragon(14), run=Run(12, 40), track=Composite((
        Line(5.0, (1.0, 2.0), 30.0), SpiralArc(0.6, 6.0, 5.5, 'left'), Arc(2.0, 300.0), Arc(2.0, 400.0)))),
    'other': Scene(dragon=Dragon(8), track=Composite((Line(20.0), Arc(4.0, 90.0), Line(20.0)), 18.0), run=Run(0, 9))}


@pytest.fixture(scope='module')
def honest():
    return {name: written(scene) for name, scene in KINDS.items()}


@pytest.fixture(scope='module')
def proof_of(honest):
    """Return a function that returns what the checker says of a certificate as it is."""
    return cache(lambda name: proved(honest[name]))


@pytest.mark.parametrize('name', KINDS)
def test_each_is_accepted_as_it_is(proof_of, name):
    assert proof_of(name)


def tampered(values, path, change):
    """Return a copy in which one value is changed, removed or added."""
    out = copy.deepcopy(values)
    *above, last = path
    target = out
    for key in above:
        target = target[key]
    if change is REMOVED:
        del target[last]
    else:
        target[last] = change(target[last]) if callable(change) else change     # a missing key is added
    return out


REMOVED = object()
T, PAIR = ('contact', 't_s'), ('contact', 'benches')
PIECES = 'scene', 'track', 'pieces'


def more(step):
    return lambda value: value + step


def scene(section, key):
    return 'scene', section, key


FALSE = 'overlap|do not|beyond|after the'       # rejected by the proof
TAMPERINGS = [
    # The contact: another time, other benches, or no contact
    ('contact', T, more(3e-9), FALSE), ('contact', T, more(-3e-9), FALSE), ('contact', T, more(0.1), FALSE),
    ('contact', T, more(-0.5), FALSE), ('contact', T, 411.5, 'do not overlap'), ('contact', T, 413.0, 'overlap'),
    ('contact', T, 500.0, 'after the run stops'), ('contact', T, 411.0, 'not between'),
    ('contact', T, -1.0, 'not between'), ('contact', T, None, 'there must be no benches'),
    ('contact', ('contact',), {'t_s': None}, 'benches 0 and 8 overlap'), ('contact', PAIR, [0, 9], 'do not overlap'),
    ('contact', PAIR, [1, 9], 'do not overlap'), ('contact', PAIR, [8, 0], 'inner one first'),
    ('contact', PAIR, [3, 3], 'inner one first'), ('contact', PAIR, [3, 4], 'inner one first'),
    ('contact', PAIR, [0, 12], 'not between'), ('contact', PAIR, [0], 'list of 2'),
    ('contact', PAIR, REMOVED, 'list of 2'), ('contact', PAIR, [0.0, 8], 'whole'),
    ('contact', ('contact', 'grazing'), 'no', 'neither true nor false'),
    ('none', ('contact',), {'t_s': 412.4, 'benches': [0, 8], 'grazing': True}, 'do not graze'),
    ('none', ('contact',), {'t_s': 412.4, 'benches': [0, 8]}, 'do not overlap'),
    ('none', ('contact',), {'t_s': 410.5, 'benches': [0, 8]}, 'do not overlap'),
    ('none', ('contact', 'grazing'), True, 'there must be no benches'), ('start', T, 413.1, FALSE),
    ('start', ('contact',), {'t_s': None}, 'benches 0 and 8 overlap'), ('start', PAIR, [0, 4], 'do not overlap'),
    ('law', T, more(1e-6), FALSE), ('law', T, more(-1e-6), FALSE), ('law', ('contact',), {'t_s': None}, 'overlap'),
    ('tail', T, more(1e-6), FALSE), ('tail', PAIR, [2, 11], FALSE), ('tail', ('contact',), {'t_s': None}, 'overlap'),
    ('mixed', T, more(1e-6), FALSE), ('mixed', PAIR, [0, 5], FALSE),
    ('mixed', ('contact',), {'t_s': None}, 'overlap'), ('turn', T, more(1e-6), FALSE),
    ('turn', T, more(-1e-6), FALSE), ('turn', ('contact',), {'t_s': None}, 'overlap'),
    ('joined', T, more(1e-6), FALSE), ('joined', T, more(-1e-6), FALSE),
    ('joined', ('contact',), {'t_s': None}, 'overlap'),
    # Another scene
    ('contact', scene('dragon', 'width_m'), 0.30001, FALSE), ('contact', scene('dragon', 'width_m'), 0.29999, FALSE),
    ('contact', scene('dragon', 'hole_inset_m'), 0.27501, FALSE),
    ('contact', scene('dragon', 'head_length_m'), 3.42, FALSE),
    ('contact', scene('dragon', 'body_length_m'), 2.2001, FALSE),
    ('contact', scene('dragon', 'benches'), 8, 'not between'),
    ('contact', scene('track', 'pitch_m'), 0.5500001, FALSE),
    ('contact', scene('track', 'start_turns'), 16.0001, FALSE),
    ('contact', scene('head', 'speed_m_s'), 1.0000001, FALSE), ('contact', scene('head', 'speed_m_s'), -1.0, FALSE),
    ('contact', scene('head', 'lead'), 'tail', 'scene|track|' + FALSE),
    ('contact', scene('head', 'lead'), 'both', 'neither'),
    ('contact', scene('run', 'stop_s'), 412.0, 'after the run stops'),
    ('contact', scene('run', 'start_s'), 412.6, 'not between'),
    ('contact', scene('run', 'start_s'), 500.0, 'not between'), ('none', scene('run', 'stop_s'), None, 'overlap'),
    ('none', scene('run', 'stop_s'), 412.475, 'overlap'), ('none', scene('dragon', 'width_m'), 0.31, 'overlap'),
    ('none', scene('dragon', 'hole_inset_m'), 0.3, FALSE), ('none', scene('track', 'pitch_m'), 0.5, 'overlap|locks'),
    ('none', scene('head', 'speed_m_s'), 1.01, FALSE), ('none', scene('run', 'start_s'), 440.0, 'not between'),
    ('lock', ('contact',), {'t_s': 432.0, 'benches': [0, 2]}, 'do not overlap'),
    ('lock', scene('run', 'start_s'), 433.0, 'model ends before'),
    ('lock', scene('head', 'speed_m_s'), 0.0, 'nothing ends'),
    ('lock', ('contact',), {'t_s': 432.92, 'benches': [0, 2]}, 'after the end of the run'),
    ('law', scene('head', 'knots'), [[0.0, 0.3], [1.0, -1.0], [9.0, -1.0]], FALSE),
    ('law', scene('head', 'knots'), [[0.0, 0.5], [1.0, -1.0], [9.0, -1.2]], FALSE),
    ('law', scene('head', 'knots'), [[1.0, 0.3], [9.0, -1.0]], 'not between'),
    ('law', scene('head', 'knots'), [[0.0, 0.3], [3.0, 1.0], [2.0, 1.0]], 'not between'),
    ('law', scene('head', 'ramps'), 'linear', FALSE), ('law', scene('head', 'ramps'), 'steep', 'neither linear nor'),
    ('tail', scene('head', 'lead'), 'head', FALSE),
    ('tail', scene('head', 'speed_m_s'), -1.0, 'after the end of the run'),
    ('mixed', scene('dragon', 'groups'), lambda groups: groups[::-1], FALSE),
    ('mixed', ('scene', 'dragon', 'groups', 1, 'count'), 10, FALSE),
    ('mixed', ('scene', 'dragon', 'groups', 2, 'length_m'), 2.8, FALSE),
    ('turn', scene('track', 'pitch_m'), 0.8001, FALSE), ('turn', scene('track', 'ratio'), 1.99, FALSE),
    ('turn', scene('track', 'diameter_m'), 9.001, FALSE), ('turn', scene('track', 'before_m'), 99.9, FALSE),
    ('joined', (*PIECES, 2, 'radius_m'), 2.01, FALSE), ('joined', (*PIECES, 2, 'angle_deg'), 0, 'an arc must turn'),
    ('joined', (*PIECES, 2, 'angle_deg'), -300.0, FALSE), ('joined', (*PIECES, 1, 'side'), 'right', FALSE),
    ('joined', (*PIECES, 1, 'to_turns'), 5.4, FALSE), ('joined', (*PIECES, 0, 'length_m'), 5.1, FALSE),
    ('joined', (*PIECES, 2, 'at_m'), [0.0, 0.0], 'ends .* from there'),
    ('joined', (*PIECES, 1, 'heading_deg'), 31.0, 'ends .* from there'),
    ('joined', scene('track', 'start_m'), 0.01, FALSE), ('other', scene('track', 'start_m'), 70.0, 'beyond its end'),
    ('other', (*PIECES, 1, 'radius_m'), 1.0, 'links could lock'),
    # Claims that are not checked, and incomplete scenes
    ('contact', ('version',), 3, '0.1 to 0.3'), ('contact', ('version',), 5, 'is not 4'),
    ('contact', ('version',), '4', 'is not 4'), ('contact', ('version',), 4.0, 'is not 4'),
    ('contact', ('intervals',), [], 'is not checked'), ('contact', ('certified',), True, 'is not checked'),
    ('contact', ('contact', 'uncertainty_s'), 1e-12, 'is not checked'),
    ('none', ('end',), {'t_s': 412.4}, 'is not checked'), ('contact', ('scene', 'wind'), 1.0, 'is not checked'),
    ('contact', scene('dragon', 'tail_length_m'), 1.0, 'is not checked'),
    ('contact', scene('dragon', 'width_m'), REMOVED, 'missing'), ('contact', ('scene', 'run'), REMOVED, 'missing'),
    ('contact', scene('track', 'kind'), 'clothoid', 'not one of the kinds'),
    ('contact', scene('track', 'pitch_m'), 0, 'not between'),
    ('contact', scene('dragon', 'hole_inset_m'), 1.2, 'the link of a bench')]


@pytest.mark.parametrize(('kind', 'path', 'change', 'line'), TAMPERINGS,
                         ids=[f'{n} {row[0]} {".".join(map(str, row[1]))}' for n, row in enumerate(TAMPERINGS)])
def test_a_tampered_certificate_is_refused_with_its_line(honest, kind, path, change, line):
    said = refusal(tampered(honest[kind], path, change))
    assert '\n' not in said
    assert re.search(line, said), said


def test_over_forty_kinds_of_tampering_are_tried_on_every_kind_of_certificate():
    assert len(TAMPERINGS) > 100
    assert {kind for kind, *_ in TAMPERINGS} == set(KINDS)


def shifted(values, at=()):
    """Yield (path, opposite) for each nonzero number, side, lead and ramp of a scene."""
    items = values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else ()
    for key, below in items:
        if isinstance(below, dict | list):
            yield from shifted(below, (*at, key))
        elif isinstance(below, float) and below:
            yield (*at, key), -below
        elif below in OPPOSITE:
            yield (*at, key), OPPOSITE[below]


OPPOSITE = {'left': 'right', 'right': 'left', 'head': 'tail', 'tail': 'head', 'smooth': 'linear', 'linear': 'smooth'}


@pytest.mark.parametrize('kind', [kind for kind in KINDS if kind not in ('none', 'lock', 'other')])
def test_no_contact_is_proved_of_a_scene_with_a_sign_a_side_or_a_sense_changed(honest, kind):
    """This excludes a track's start and heading, arcs that are never reached, and the law of a contact at the start."""
    values = honest[kind]
    moves = values['contact']['t_s'] > values['scene']['run']['start_s']
    changes = [(path, change) for path, change in shifted(values['scene'])
               if path[0] in ('dragon', 'track', 'head' if moves else '') and not {'at_m', 'heading_deg', 3} & {*path}]
    assert changes
    for path, change in changes:
        assert refusal(tampered(honest[kind], ('scene', *path), change)), path


def test_a_contact_of_the_last_two_benches_that_can_touch_is_not_passed_over():
    bend = Composite((Line(5.0), Arc(0.8, 300.0)), 4.0)
    scene = Scene(dragon=Dragon(3, 1.2, 1.2, 1.3, 0.1), track=bend, run=Run(0, 4))
    values = written(scene)
    assert values['contact']['benches'] == [0, 2]
    hidden = {**values, 'contact': {'t_s': None}}
    assert 'benches 0 and 2 overlap' in refusal(hidden)
