"""Untrusted certificates are rejected quickly and with one clear error, whatever they contain."""
import copy
import json
import re
from contextlib import nullcontext, suppress
from math import inf, nextafter
from pathlib import Path

import pytest
from certificates import refusal
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.scenes import certificate
from dragon_ros.scenes.load import load_scene
from dragon_ros.verify import reading
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.proof import prove
from dragon_ros.verify.reading import _pose, claims_of, read

STRANGE = [None, True, -1, 0, 2, 1e308, -1e308, 1e-308, 10**400, float('nan'), float('inf'), '', 'x', '1', [], [[]], {},
           {'lead': 'head'}]


@pytest.fixture(scope='module')
def proof():
    scene = load_scene('winding', ['dragon.benches=12', 'run.start_s=395', 'run.stop_s=400'])
    return certificate.as_values(scene, first_contact(scene))


def places(value, at=()):
    """Return the path of every value in a certificate."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at, *(place for key, below in items for place in places(below, (*at, key)))]


def check(text):
    return prove(claims_of(text), 1.0, lambda *told: None)


def test_the_certificate_holds_as_it_is(proof):
    assert check(json.dumps(proof).encode())


@examples(150, long=300)
@given(st.floats(0, 1), st.sampled_from(STRANGE))
def test_a_strange_value_anywhere_is_refused_or_harmless(proof, share, strange):
    changed = copy.deepcopy(proof)
    every = places(changed)[1:]
    *above, last = every[int(share * (len(every) - 1))]
    target = changed
    for key in above:
        target = target[key]
    target[last] = strange
    with suppress(Refused):
        check(json.dumps(changed).encode())


@pytest.mark.parametrize('strange', STRANGE, ids=str)
def test_a_strange_time_of_contact_is_refused(proof, strange):
    with pytest.raises(Refused) if strange is not None else nullcontext():      # no contact is also a valid claim
        check(json.dumps({**proof, 'contact': {'t_s': strange}}).encode())


@examples(100)
@given(st.floats(0, 1), st.floats(0, 1), st.integers(0, 255))
@example(0.0, 0.0, 0)
def test_a_cut_or_changed_certificate_is_refused_or_harmless(proof, keep, at, value):
    data = bytearray(json.dumps(proof).encode())
    data[int(at * (len(data) - 1))] = value
    with suppress(Refused):
        check(bytes(data))
    with pytest.raises(Refused):
        check(bytes(data[:int(keep * (len(data) - 1))]))


@pytest.mark.parametrize('text', [b'', b'{', b'[' * 10**5, b'\xff\xfe', b'null', b'{"scene": ' * 10**4])
def test_what_is_no_json_is_refused(text):
    with pytest.raises(Refused):
        check(text)


def hostile(**sections):
    """Return a claim of no contact in a scene that takes a long time to check."""
    scene = {'dragon': {'kind': 'equal', 'benches': 223, 'head_length_m': 3.41, 'body_length_m': 2.2, 'width_m': 0.01,
                        'hole_inset_m': 0.275},
             'track': {'kind': 'spiral', 'pitch_m': 0.55, 'start_turns': 16.0},
             'head': {'kind': 'constant', 'speed_m_s': 1.0, 'lead': 'head'}, 'run': {'start_s': 0.0, 'stop_s': None}}
    for section, values in sections.items():
        scene[section] = values if 'kind' in values else {**scene[section], **values}
    return {'version': reading.VERSION, 'scene': scene, 'contact': {'t_s': None}}


@pytest.mark.parametrize(('values', 'line'), [
    (hostile(dragon={'benches': 10**6}), 'benches: 1000000.0 is not between'),
    (hostile(dragon={'benches': 10**300}), 'benches: 1e.300 is not between'),
    pytest.param(hostile(dragon={'benches': 20_000}), 'within the budget', marks=pytest.mark.long),
    (hostile(dragon={'kind': 'mixed', 'width_m': 0.01, 'hole_inset_m': 0.0, 'groups': [
        {'length_m': 1.0, 'count': 1}] * 20_001}), 'list of 1 to 20000'),
    (hostile(track={'pitch_m': 0.01}), 'the chain locks'),
    (hostile(head={'speed_m_s': -100.0}, run={'stop_s': 1e6}), 'within the budget of 1500 steps'),
    (hostile(head={'kind': 'profile', 'ramps': 'smooth', 'lead': 'head', 'knots': [[0.0, 1.0]] * 20_000}),
     'list of 1 to 10000'),
    (hostile(head={'kind': 'profile', 'ramps': 'linear', 'lead': 'head', 'knots': [[0.0]]}), 'list of 2'),
    (hostile(track={'kind': 'joined', 'start_m': 0.0, 'pieces': [{'kind': 'line', 'length_m': 1.0}] * 2000}),
     'list of 1 to 1000'),
    (hostile(track={'kind': 'joined', 'start_m': 3.0, 'pieces': [{'kind': 'line', 'length_m': 1e-9}] * 1000}),
     'beyond its end')])
def test_a_scene_that_would_take_forever_is_refused_within_its_budget(values, line):
    assert re.search(line, refusal(values, effort=0.005))


def test_a_file_without_end_is_not_read(tmp_path):
    with pytest.raises(Refused, match='larger than'):
        read(Path('/dev/zero'))
    with pytest.raises(Refused, match='cannot be read'):
        read(tmp_path)


def test_equal_keys_that_readers_could_take_for_one_another_are_refused(proof):
    text = json.dumps(proof).replace('"width_m": 0.3', '"width_m": 0.3, "width_m": 0.1')
    with pytest.raises(Refused, match='occurs twice'):
        check(text.encode())


@pytest.mark.parametrize('most', [1e6, -1e6])
def test_a_heading_is_read_up_to_its_limit_and_refused_beyond(most):
    assert _pose('piece', {'heading_deg': most}).heading_deg == most
    with pytest.raises(Refused, match='heading_deg'):
        _pose('piece', {'heading_deg': most * (1 + 5e-7)})


EQUAL = {'kind': 'equal', 'benches': 1, 'head_length_m': 1.0, 'body_length_m': 1.0, 'width_m': 0.1, 'hole_inset_m': 0.0}
TURN = {'kind': 'turn', 'pitch_m': 1.7, 'diameter_m': 9.0, 'ratio': 2.0, 'before_m': 0.0}
COIL = {'kind': 'spiral', 'pitch_m': 1.0, 'from_turns': 5.0, 'to_turns': 2.0, 'side': 'left'}


@pytest.mark.parametrize(('read_of', 'values', 'name', 'low', 'high'), [
    (reading._dragon, EQUAL, 'width_m', 0.001, 100.0),
    (reading._turn, TURN, 'pitch_m', 0.01, 100.0), (reading._turn, TURN, 'diameter_m', 0.01, 2e4),
    (reading._turn, TURN, 'ratio', 1e-3, 1e3), (reading._turn, TURN, 'before_m', -1e6, 1e6),
    (reading._spiral, {'kind': 'spiral', 'pitch_m': 1.0}, 'start_turns', 0.0, 1e4),
    (reading._spiral, {'kind': 'spiral', 'start_turns': 3.0}, 'pitch_m', 0.01, 100.0),
    (reading._line, {'kind': 'line'}, 'length_m', 1e-12, 1e6),
    (reading._arc, {'kind': 'arc', 'angle_deg': 9.0}, 'radius_m', 0.01, 1e9),
    (reading._arc, {'kind': 'arc', 'radius_m': 9.0}, 'angle_deg', -1e6, 1e6),
    (reading._coil, COIL, 'pitch_m', 0.01, 100.0), (reading._coil, COIL, 'from_turns', 1e-3, 1e4),
    (reading._coil, COIL, 'to_turns', 1e-3, 1e4),
    (reading._constant, {'kind': 'constant', 'lead': 'head'}, 'speed_m_s', -100.0, 100.0)],
    ids=lambda each: each if isinstance(each, str) else '')
def test_a_number_at_its_limit_is_read_and_the_next_one_beyond_is_refused(read_of, values, name, low, high):
    names = () if read_of is reading._dragon else ('scene',)
    for value, beyond in ((low, nextafter(low, -inf)), (high, nextafter(high, inf))):
        read_of(*names, {**values, name: value})
        with pytest.raises(Refused, match=f'{name}: .* is not between'):
            read_of(*names, {**values, name: beyond})


@pytest.mark.parametrize('most', [100.0, -100.0])
def test_a_speed_of_a_profile_is_read_up_to_its_limit_and_refused_beyond(most):
    profile = {'kind': 'profile', 'ramps': 'linear', 'lead': 'head'}
    reading._profile('head', {**profile, 'knots': [[0.0, most]]})
    with pytest.raises(Refused, match='is not between'):
        reading._profile('head', {**profile, 'knots': [[0.0, nextafter(most, 2 * most)]]})


@given(st.one_of(st.integers(-4, 4), st.floats(-4, 4), st.sampled_from([10**400, inf, -inf, float('nan'), True, '1'])),
       st.integers(-3, 3), st.integers(-3, 3), st.booleans())
def test_a_number_is_read_exactly_if_it_is_one_of_its_kind_within_its_limits(value, low, high, whole):
    kind = type(value) is int if whole else type(value) in (int, float)
    try:
        found = reading._number('n', value, low, high, whole)
    except Refused:
        assert not (kind and low <= value <= high)
        return
    assert kind
    assert low <= value <= high
    assert found == value


@given(st.one_of(st.lists(st.integers(), max_size=5), st.none(), st.just((1, 2))), st.integers(0, 4), st.integers(0, 4))
def test_a_list_is_read_exactly_if_it_has_as_many_entries_as_it_may(value, fewest, most):
    try:
        found = reading._list('n', value, fewest, most)
    except Refused:
        assert not (isinstance(value, list) and fewest <= len(value) <= most)
        return
    assert isinstance(value, list)
    assert fewest <= len(value) <= most
    assert found is value


@pytest.mark.parametrize('version', [0, 1.5, 4.0, reading.VERSION + 1, '4', None])
def test_a_certificate_of_an_unknown_version_is_refused(version, proof):
    with pytest.raises(Refused, match='version: .* is not 4'):
        claims_of(json.dumps({**proof, 'version': version}).encode())
