"""Untrusted certificates: whatever they contain, the checker rejects it with one clear error, and quickly."""
import copy
import json
from contextlib import suppress

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dragon_ros.core.contact import certificate
from dragon_ros.core.contact.first_contact import first_contact
from dragon_ros.core.errors import DragonError, InputError
from dragon_ros.scenes.load import load_scene

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


def check(folder, text):
    path = folder / 'proof.json'
    path.write_bytes(text)
    return certificate.check(path)


def test_the_certificate_holds_as_it_is(tmp_path, proof):
    assert check(tmp_path, json.dumps(proof).encode()) == len(proof['intervals'])


@settings(max_examples=300)
@given(st.floats(0, 1), st.sampled_from(STRANGE))
def test_a_strange_value_anywhere_is_refused_or_harmless(tmp_path_factory, proof, share, strange):
    changed = copy.deepcopy(proof)
    every = places(changed)[1:]
    *above, last = every[int(share * (len(every) - 1))]
    target = changed
    for key in above:
        target = target[key]
    target[last] = strange
    with suppress(DragonError):
        check(tmp_path_factory.mktemp('strange'), json.dumps(changed).encode())


@pytest.mark.parametrize('key', ['t_s', 'start_m', 'stop_m', 'bound_m', 'lead'])
@pytest.mark.parametrize('strange', STRANGE, ids=str)
def test_a_strange_number_of_the_proof_is_refused(tmp_path, proof, key, strange):
    changed = copy.deepcopy(proof)
    (changed['contact'] if key == 't_s' else changed['intervals'][0])[key] = strange
    if (key, strange) in (('t_s', None), ('bound_m', 1e-308)):
        return      # no contact, and a bound that is lower than it need be, are claims like others
    with pytest.raises(DragonError):
        check(tmp_path, json.dumps(changed).encode())


@settings(max_examples=100)
@given(st.floats(0, 1), st.floats(0, 1), st.integers(0, 255))
@example(0.0, 0.0, 0)
def test_a_cut_or_changed_certificate_is_refused_or_harmless(tmp_path_factory, proof, keep, at, value):
    data = bytearray(json.dumps(proof).encode())
    data[int(at * (len(data) - 1))] = value
    folder = tmp_path_factory.mktemp('cut')
    with suppress(DragonError):
        check(folder, bytes(data))
    with pytest.raises(InputError):
        check(folder, bytes(data[:int(keep * (len(data) - 1))]))


@pytest.mark.parametrize('text', [b'', b'{', b'[' * 10**5, b'\xff\xfe', b'null', b'{"scene": ' * 10**4])
def test_what_is_no_json_is_refused(tmp_path, text):
    with pytest.raises(InputError):
        check(tmp_path, text)
