"""On joined tracks every step of the search is cleared by a bound that holds, and the checker lets no forgery pass."""
import copy
import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from apart import smallest
from dragon_ros.commands.certificate_checkers.curve import Curve
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed, goes_on_alike
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.chain.rectangles import axes_of, benches_of
from dragon_ros.core.contact import certificate, conservative_advancement
from dragon_ros.core.contact.certificate import ALL, Contact, NoContact
from dragon_ros.core.contact.first_contact import first_contact
from dragon_ros.core.errors import DragonError, InputError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Arc, Composite, Line, SpiralArc, STurn

LOOP = Composite((Line(5.0), Arc(3.0, 720.0)))
BENT = Composite((Line(50.0), Arc(3.0, -200.0), Line(1.0), SpiralArc(1.2, 2, 4.0)), start_m=70.0)
BACK_AND_FORTH = Profile(((0.0, 0.0), (5.0, 1.0), (10.0, -1.0), (20.0, -1.0), (30.0, 1.0)))
TIGHT = Scene(dragon=Dragon(40), track=STurn(0.8, before_m=100.0), run=Run(80, 200))
SCENES = {
    'turn': Scene(dragon=Dragon(60), track=STurn(before_m=100.0), run=Run(95, 140)),
    'a tight turn': TIGHT,
    'loop': Scene(dragon=Dragon(20), track=LOOP, run=Run(0, 30)),
    'back and forth': Scene(dragon=Dragon(20), track=LOOP, head=BACK_AND_FORTH, run=Run(3, 100)),
    'tail': Scene(dragon=Dragon(10), track=BENT, head=Head(1.0, 'tail'), run=Run(0, 30)),
    'two benches': Scene(dragon=Dragon(2, 3.41, 0.55), track=LOOP, run=Run(0, 20)),
    'rest': Scene(dragon=Dragon(20), track=LOOP, head=Head(0.0), run=Run(0, 10)),
    'the end of the track': Scene(dragon=Dragon(20), track=Composite((Line(5.0), Arc(6.0, 120.0)))),
    'out from a spiral': Scene(dragon=Dragon(3), track=Composite((SpiralArc(3.0, 0.6, 3.0, 'left'), Line(9.0)), start_m=9.0),
                               run=Run(0, 30))}
MEETING = {'a tight turn': (113.28625812330225, (0, 15)), 'loop': (22.16017797019889, (0, 10)),
           'back and forth': (59.66017797019889, (0, 10))}


def checked(folder, values):
    path = folder / 'c.json'
    path.write_text(json.dumps(values))
    return certificate.check(path)


@pytest.mark.parametrize('name', SCENES)
def test_every_joined_track_has_a_certificate_that_holds(tmp_path, name):
    found = first_contact(SCENES[name])
    assert found.certificate.complete
    values = certificate.as_values(SCENES[name], found)
    assert checked(tmp_path, values) == len(values['intervals'])
    assert isinstance(found, Contact if name in MEETING else NoContact)
    if name in MEETING:
        assert found.t_s == pytest.approx(MEETING[name][0], abs=1e-9)
        assert found.benches == MEETING[name][1]
        assert smallest(SCENES[name], found.t_s + 1e-8) == 0 < smallest(SCENES[name], found.t_s - 1e-8)


def test_the_turn_of_the_contest_takes_few_looks():
    found = first_contact(Scene(track=STurn(before_m=100.0), run=Run(0, 200)))
    assert isinstance(found, NoContact)
    assert found.states < 600


def test_steps_join_up_to_the_contact():
    found = first_contact(TIGHT)
    steps = found.certificate.led_by(ALL)
    assert all(one.stop_m == other.start_m for one, other in pairwise(steps))
    assert steps[0].start_m == pytest.approx(0.0, abs=1e-12)
    assert found.certificate.led_by(0)[0].start_m == pytest.approx(-20.0, abs=1e-12)
    assert found.t_s - 100.0 - steps[-1].stop_m == pytest.approx(1e-9, rel=0.01)


links = st.floats(0.3, 2.5)
tracks = st.builds(lambda radius, turned, line, other, back: Composite(
    (Line(60.0), Arc(radius, turned), Line(line), Arc(other, back)), start_m=55.0),
    st.floats(1.6, 5), st.floats(60, 500) | st.floats(-500, -60), st.floats(0.1, 5), st.floats(1.6, 5),
    st.floats(60, 500) | st.floats(-500, -60)) | st.builds(STurn, st.floats(0.6, 2), st.floats(7, 10), st.floats(0.6, 2))


@settings(max_examples=30, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(3, 14), links, links, st.floats(0.05, 0.5), tracks, st.sampled_from([
    Head(1.0), Head(1.0, 'tail'), BACK_AND_FORTH]), st.floats(0, 1))
def test_no_gap_between_two_looks_is_below_the_bound(tmp_path_factory, benches, head, body, width, track, law, share):
    try:
        scene = Scene(Dragon(benches, 0.4 + head, 0.4 + body, width, 0.2), track, law, Run(0, 25))
        end_s = compile_scene(scene).end.t_s
    except DragonError:     # does not fit the track
        assume(False)
    found = first_contact(scene)
    last_s = found.t_s - 1e-6 if isinstance(found, Contact) else end_s
    for t_s in np.linspace(0, max(last_s, 0.0), 40):
        for gap_m, bounds_m in spoken_for(scene, found.certificate.intervals, t_s):
            assert bounds_m or found.t_s == 0.0 or t_s in (0.0, last_s)
            assert all(bound_m <= gap_m + 1e-11 for bound_m in bounds_m)
    values = certificate.as_values(scene, found)
    checked(tmp_path_factory.mktemp('proof'), values)


def spoken_for(scene, intervals, t_s):
    """Each pair's gap at a time, by shapely, and the bounds of all intervals that speak for it then."""
    chain = state(replace(scene, solver='march'), t_s)
    along_m = chain.walk.distances(chain.segment, chain.u)
    shapes = shapely.polygons(benches_of(chain, scene.dragon, axes_of(chain)).corners)
    joint_m = chain.walk.joints_m[0] if chain.track.from_afar else -np.inf
    lengths_m = scene.dragon.bench_lengths_m
    for i, j in zip(*np.triu_indices(scene.dragon.benches, 2), strict=True):
        own = [each for each in intervals if along_m[i] <= joint_m and each.behind >= j - i and (
            each.lead == i or (0 < each.lead < i and goes_on_alike(lengths_m, each.lead, int(i))))]
        every = [each for each in intervals if along_m[i] >= joint_m and each.lead == ALL]
        yield shapely.distance(shapes[i], shapes[j]), [
            each.bound_m for each, place_m in [*((each, along_m[i]) for each in own),
                                               *((each, along_m[0]) for each in every)]
            if min(each.start_m, each.stop_m) <= place_m <= max(each.start_m, each.stop_m)]


@pytest.mark.parametrize('name', SCENES)
def test_the_checkers_track_is_the_same_curve(name):
    scene = SCENES[name]
    curve = Curve(scene)
    for t_s in np.linspace(scene.run.start_s, compile_scene(scene).end.t_s, 7).tolist():
        chain = state(replace(scene, solver='march'), t_s)
        points, tangents = curve.at(chain.walk.distances(chain.segment, chain.u))
        np.testing.assert_allclose(np.stack((points.real, points.imag), axis=-1), chain.p, rtol=0, atol=2e-12)
        np.testing.assert_allclose(np.stack((tangents.real, tangents.imag), axis=-1), chain.headings, atol=1e-12)


@pytest.fixture(scope='module')
def written():
    return certificate.as_values(TIGHT, first_contact(TIGHT))


@pytest.mark.parametrize('share', [0.0, 0.3, 0.6, 0.9])
@pytest.mark.parametrize('forgery', ['removed', 'widened', 'begun early', 'shifted', 'raised', 'lowered below zero'])
def test_the_checker_rejects_a_forged_step(tmp_path, written, forgery, share):
    values = copy.deepcopy(written)
    # The checker halves the intervals of a leading bench, which raises their bounds.
    rows = [row for row in values['intervals'] if forgery != 'raised' or row['lead'] == 'all']
    row = rows[int(share * len(rows))]
    changes = {'widened': {'stop_m': 0.5}, 'begun early': {'start_m': -0.5}, 'raised': {'bound_m': 1e-6},
               'shifted': {'start_m': 0.3, 'stop_m': 0.3}, 'lowered below zero': {'bound_m': -10.0}}
    if forgery == 'removed':
        values['intervals'].remove(row)
    for key, change in changes.get(forgery, {}).items():
        row[key] += change
    with pytest.raises(InputError):
        checked(tmp_path, values)


@pytest.mark.parametrize('change', [{'t_s': 113.2}, {'t_s': 113.29}, {'t_s': 150.0}, {'benches': [0, 14]},
                                    {'benches': [3, 3]}, {'t_s': None}])
def test_the_checker_rejects_a_contact_that_is_none_or_not_the_first(tmp_path, written, change):
    values = copy.deepcopy(written)
    values['contact'].update(change)
    with pytest.raises(InputError):
        checked(tmp_path, values)


@pytest.mark.parametrize(('section', 'key', 'value'), [
    ('track', 'pitch_m', 0.81), ('track', 'ratio', 1.9), ('track', 'diameter_m', 9.01), ('track', 'before_m', 99.0),
    ('head', 'speed_m_s', 0.99), ('dragon', 'width_m', 0.31), ('dragon', 'body_length_m', 2.21),
    ('run', 'start_s', 79)])
def test_the_checker_rejects_a_proof_of_another_scene(tmp_path, written, section, key, value):
    values = copy.deepcopy(written)
    values['scene'][section][key] = value
    with pytest.raises(InputError):
        checked(tmp_path, values)


@pytest.mark.parametrize('key', ['start_m', 'stop_m', 'bound_m'])
@pytest.mark.parametrize('strange', [None, 'x', float('nan'), float('inf'), 1e300, [], True])
def test_a_strange_number_in_a_step_is_refused(tmp_path, written, key, strange):
    values = copy.deepcopy(written)
    values['intervals'][0][key] = strange
    with pytest.raises(DragonError):
        checked(tmp_path, values)


def test_benches_that_touch_from_the_start_need_no_steps_and_a_false_claim_of_none_is_refused(tmp_path):
    scene = replace(SCENES['loop'], track=replace(LOOP, start_m=25.0), run=Run(0, 1))
    found = first_contact(scene)
    assert found.t_s == 0
    values = certificate.as_values(scene, found)
    assert values['intervals'] == []
    checked(tmp_path, values)
    still = replace(scene, head=Head(0.0))
    values = {**certificate.as_values(still, first_contact(still)), 'contact': {'t_s': None}}
    with pytest.raises(InputError, match='touch at the start'):
        checked(tmp_path, values)


@pytest.mark.parametrize('knots', [((0.0, 0.0), (2.0, 0.0), (4.0, 1.0)), ((0.0, 0.0), (4.0, 1.0))])
@pytest.mark.parametrize('start_s', [0.0, 1.0])
def test_benches_that_touch_while_the_leader_still_rests_touch_from_the_start(knots, start_s):
    scene = replace(SCENES['loop'], track=replace(LOOP, start_m=25.0), run=Run(start_s, 4), head=Profile(knots))
    assert first_contact(scene).t_s == start_s


def passing(width, t_s=np.linspace(112.0, 118.0, 241)):
    """The smallest gap while the head passes through a turn, and when."""
    scene = Scene(dragon=Dragon(24, width_m=width), track=STurn(1.2, before_m=100.0), run=Run(112, 118))
    least = [(smallest(scene, t), float(t)) for t in t_s]
    gap, at_s = min(least)
    return (gap, at_s, scene) if len(t_s) < 200 else passing(width, np.linspace(at_s - 0.05, at_s + 0.05, 101))


def test_what_cannot_be_told_from_a_contact_is_grazing_with_bounds(monkeypatch):
    """With a coarse finest step, so that a gap of some micrometres is as hard as one of nanometres."""
    monkeypatch.setattr(conservative_advancement, '_FINEST', (1e-3, 1e-5))
    width = 0.3
    for _ in range(8):
        gap, at_s, scene = passing(width)
        width += 1.3 * (gap - 3e-6)
    found = first_contact(scene)
    assert isinstance(found, Contact)
    assert found.grazing_m[0] < gap < found.grazing_m[1] < 3e-5
    assert found.t_s == pytest.approx(at_s, abs=0.02)
    assert found.certificate.complete
    for t_s in np.linspace(112, found.t_s, 30):
        assert smallest(scene, t_s) > 0


def test_looks_that_round_to_one_place_are_no_division_by_zero():
    dragon = Mixed((Group(2.323), Group(1.9, 9), Group(2.2), Group(1.9, 10)), 0.6)
    law = Profile(((0.0, 0.0), (10.0, -1.0), (19.0, 0.0), (57.0, 0.0)), 'smooth', 'tail')
    first_contact(Scene(dragon=dragon, track=STurn(diameter_m=13.76, ratio=1.14), head=law, run=Run(0, 30)))
