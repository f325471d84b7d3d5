"""A run that ends at its contact is checked without a search if its bag contains a certificate that can be proved."""
import json
from dataclasses import replace
from functools import cache

import pytest
from properties import thinned
from recorded import introduce

from dragon_ros.__main__ import main
from dragon_ros.bags.check import contacts
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Certificate
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import contact_frame, tick, ticks_before
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.scenes.certificate import claim_of
from dragon_ros.scenes.provenance import CLAIM

pytest.importorskip('flint', reason='the checker needs python-flint')

MEETING = Scene(dragon=Dragon(12), run=Run(412.3, 413.0))
PARTED = replace(MEETING, run=Run(412.0, 412.2))


@cache
def found_in(scene):
    return first_contact(scene)


@pytest.fixture(autouse=True)
def unsearched(monkeypatch):
    """Prohibit the search for contacts in scenes with twelve benches."""
    monkeypatch.setattr(contacts, 'SEARCHED_BENCHES', 11)


def bag_of(path, scene, claim):
    """Write the bag of a run that ends at its contact, as `sim` and `record` do; include a claim unless it is None."""
    found = found_in(scene)
    if found:
        frames = [*(tick(scene, k) for k in range(ticks_before(scene, found.t_s))), contact_frame(scene, found.t_s)]
    else:
        frames = [tick(scene, k) for k in range(compile_scene(scene).last_tick + 1)]
    about = {'on_contact': 'stop'} | ({} if claim is None else {CLAIM: claim})
    encode = encoders(scene)
    with BagWriter(path) as bag:
        introduce(bag, scene, about)
        for name in encode:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        for k, frame in enumerate(frames):
            for name in encode:
                bag.write(f'/dragon/{name}', bytes(encode[name](frame)), frame.t_ns, k + 1)
    return path


def checked(capsys, bag, *options):
    code = main(['inspect', str(bag), '--check', *options])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.mark.parametrize(('scene', 'said'), [
    (MEETING, 'no two benches touch from 412.3 s to the contact at 412.47383768211 s, less 1 nm'),
    (PARTED, 'no two benches touch from 412.0 s to the end of the run at 412.2 s')], ids=['contact', 'none'])
def test_a_certificate_in_the_bag_stands_in_for_a_search(capsys, tmp_path, scene, said):
    bag = bag_of(tmp_path / 'a.mcap', scene, claim_of(found_in(scene)))
    code, out, _ = checked(capsys, bag)
    assert code == 0
    assert f'the certificate in the bag proves the end of the run: {said[:60]}' in out
    values = json.loads(checked(capsys, bag, '--format', 'json')[1])
    assert values['end_proved'].startswith(said[:60])
    assert (values['missing_count'], values['fault_count']) == (0, 0)


def test_with_trust_and_within_the_budgets_of_a_search_the_scene_alone_decides(capsys, tmp_path, monkeypatch):
    bag = bag_of(tmp_path / 'a.mcap', MEETING, {'t_s': 412.4, 'benches': [0, 8]})
    assert checked(capsys, bag, '--trust')[0] == 0
    monkeypatch.setattr(contacts, 'SEARCHED_BENCHES', 12)
    code, out, _ = checked(capsys, bag, '--format', 'json')
    assert (code, json.loads(out)['end_proved']) == (0, None)


def test_without_a_certificate_the_scene_has_to_be_trusted(capsys, tmp_path):
    code, _, err = checked(capsys, bag_of(tmp_path / 'a.mcap', MEETING, None))
    assert code == 2
    assert 'has 12 benches, but only scenes with up to 11 are searched for contacts; give --trust' in err


@pytest.mark.parametrize(('claim', 'why'), thinned([
    ({'t_s': 412.5, 'benches': [0, 8]}, 'refused: benches 0 and 8 overlap'),
    ({'t_s': 412.4, 'benches': [0, 8]}, 'do not overlap'), ({'t_s': None}, 'benches 0 and 8 overlap'),
    ({'t_s': 412.5}, 'list of 2'), ({'t_s': float('nan'), 'benches': [0, 8]}, 'NaN'), ({}, 't_s: it is missing'),
    ({'t_s': 412.5, 'benches': [0, 8], 'certified': True}, 'is not checked'), ('soon', 'not a mapping'),
    ([[]], 'not a mapping')], lambda case: 'overlap' in case[1] or case[1] in ('NaN', 'is not checked')), ids=str)
def test_a_claim_that_is_not_proved_is_refused_in_one_line(capsys, tmp_path, claim, why):
    code, out, err = checked(capsys, bag_of(tmp_path / 'a.mcap', MEETING, claim))
    assert (code, out) == (2, '')
    assert len(err.splitlines()) == 1
    assert 'a.mcap: its certificate is refused: ' in err
    assert why in err
    assert err.endswith('give --trust\n')


def test_a_proof_ends_after_its_time(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(contacts, 'PROOF_S', 0.01)
    code, _, err = checked(capsys, bag_of(tmp_path / 'a.mcap', MEETING, claim_of(found_in(MEETING))))
    assert code == 2
    assert 'its certificate was not proved within 0.01 s' in err


def test_a_result_that_is_not_complete_claims_nothing():
    assert claim_of(found_in(MEETING)) == {'t_s': found_in(MEETING).t_s, 'benches': [0, 8]}
    assert claim_of(found_in(PARTED)) == {'t_s': None}
    assert claim_of(replace(found_in(MEETING), certificate=Certificate(complete=False))) is None
