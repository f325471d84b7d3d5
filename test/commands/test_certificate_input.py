"""Certificates from strangers: whatever stands in them, the checker refuses it in one clear error, and soon."""
import copy
import json
from contextlib import suppress

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dragon_ros.commands import certificate
from dragon_ros.core.contact.first_contact import first_contact
from dragon_ros.scenes.load import load_scene
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.proof import prove
from dragon_ros.verify.reading import claims_of

STRANGE = [None, True, -1, 0, 2, 1e308, -1e308, 1e-308, 10**400, float('nan'), float('inf'), '', 'x', '1', [], [[]], {},
           {'lead': 'head'}]


@pytest.fixture(scope='module')
def proof():
    scene = load_scene('winding', ['dragon.benches=12', 'run.start_s=395', 'run.stop_s=400'])
    return certificate.as_values(scene, first_contact(scene))


def places(value, at=()):
    """Return the path of every value of a certificate."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at, *(place for key, below in items for place in places(below, (*at, key)))]


def check(text):
    return prove(claims_of(text), 1.0, lambda done_m, whole_m: None)


def test_the_certificate_holds_as_it_is(proof):
    assert check(json.dumps(proof).encode())


@settings(max_examples=300)
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


@pytest.mark.parametrize('key', ['t_s', 'start_m', 'stop_m', 'lead'])
@pytest.mark.parametrize('strange', STRANGE, ids=str)
def test_a_strange_number_of_the_proof_is_refused(proof, key, strange):
    changed = copy.deepcopy(proof)
    (changed['contact'] if key == 't_s' else changed['intervals'][0])[key] = strange
    if (key, strange) == ('t_s', None) or (key.endswith('_m') and type(strange) in (int, float) and abs(strange) < 3):
        return      # no contact is a claim like others, and a place is a hint where to cut
    with pytest.raises(Refused):
        check(json.dumps(changed).encode())


@settings(max_examples=100)
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
