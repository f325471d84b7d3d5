"""The checker confirms the solver's proof for a family and rejects every other claim."""
import json
import random
from dataclasses import replace

import pytest
import shapely
from certificates import proved, refusal
from flint import arb

from dragon_ros.commands import contact
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.family import first_contact_within
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes.certificate import family_values
from dragon_ros.verify.family import _Pair

SMALL = Scene(dragon=Dragon(12), track=Spiral(0.55, 7.0), run=Run(start_s=40.0))
BOX = {'dragon.width_m': 0.003, 'dragon.body_length_m': 0.002, 'track.pitch_m': 0.001}


@pytest.fixture(scope='module')
def honest():
    """Return the certificate for a family, and the proof from which it was written."""
    proof = first_contact_within(SMALL, BOX)
    return family_values(SMALL, proof), proof


def test_it_proves_what_the_solver_proves(honest):
    values, proof = honest
    assert proved(values) == (
        'no dragon within dragon.body_length_m 0.002, dragon.width_m 0.003, track.pitch_m 0.001 of the scene '
        f'touches itself from 40.0 s to {proof.proved_s!r} s')


def test_it_proves_a_run_without_contact_to_its_end():
    scene = replace(SMALL, run=Run(40.0, 41.0))
    assert 'from 40.0 s to 41.0 s' in proved(family_values(scene, first_contact_within(scene, BOX)))


def test_boxes_that_are_too_wide_for_derivatives_are_cut_along_the_track():
    scene = Scene(dragon=Dragon(4, 0.99, 1.27, 0.22, 0.247), track=Spiral(0.4866, 5.0), run=Run(start_s=36.0))
    proof = first_contact_within(scene, {'dragon.hole_inset_m': 0.02})
    assert proof.why == 'bend'
    assert proof.proved_s > 37
    assert proved(family_values(scene, proof)).endswith(f'{proof.proved_s!r} s')


def test_it_refuses_a_time_at_which_some_dragon_touches(honest):
    values, proof = honest
    assert 'benches may touch' in refusal({**values, 'proved_s': proof.limit_s + 0.01})


@pytest.mark.parametrize(('key', 'value'), [
    ('dragon.width_m', 0.0034), pytest.param('dragon.hole_inset_m', 0.01, marks=pytest.mark.long),
    ('track.pitch_m', 0.0016)])
def test_it_refuses_tolerances_within_which_some_dragon_touches(honest, key, value):
    values, _ = honest
    assert 'benches may touch' in refusal({**values, 'within': {**BOX, key: value}})


@pytest.mark.parametrize(('change', 'said'), [
    ({'family': 2}, 'family'),
    ({'within': {'dragon.benches': 1}}, 'within.dragon.benches'),
    ({'within': {'dragon.width_m': -0.1}}, 'within.dragon.width_m'),
    ({'within': {'track.pitch_m': 0.6}}, 'may be zero'),
    ({'within': {'dragon.body_length_m': 1.8}}, 'may be zero'),
    ({'proved_s': 30.0}, 'proved_s'),
    ({'proved_s': 200.0}, 'links might lock'),
    ({'contact': {'t_s': None}}, 'is not checked'),
])
def test_it_refuses_claims_that_it_does_not_know_or_that_lead_nowhere(honest, change, said):
    assert said in refusal({**honest[0], **change})


@pytest.mark.parametrize(('part', 'value', 'said'), [
    ('head', {'kind': 'constant', 'speed_m_s': 1.0, 'lead': 'tail'}, 'with the head as leader'),
    ('head', {'kind': 'profile', 'knots': [[0, 1], [41, 1], [44, -1]], 'ramps': 'linear', 'lead': 'head'}, 'backwards'),
    ('dragon', {'kind': 'mixed', 'groups': [{'length_m': 2.0, 'count': 3}, {'length_m': 2.5, 'count': 1}],
                'width_m': 0.3, 'hole_inset_m': 0.2}, 'equal behind the head'),
    ('track', {'kind': 'turn', 'pitch_m': 1.7, 'diameter_m': 9, 'ratio': 2, 'before_m': 0}, 'single spiral'),
])
def test_it_refuses_scenes_that_such_proofs_do_not_cover(honest, part, value, said):
    values = {**honest[0], 'scene': {**honest[0]['scene'], part: value}}
    assert said in refusal({**values, 'proved_s': 80.0})


def test_an_effort_that_is_too_small_says_so(honest):
    values, _ = honest
    assert '--effort' in refusal(values, effort=1e-4)


@pytest.mark.parametrize(('dragon', 'track'), [
    pytest.param({'benches': 100_000}, {'start_turns': 1e6}, marks=pytest.mark.long),
    pytest.param({'benches': 100_000, 'body_length_m': 1e-3, 'hole_inset_m': 0.0, 'width_m': 1e-4}, {},
                 marks=pytest.mark.long),
    ({'benches': 100_000, 'body_length_m': 1e9}, {}),
])
def test_a_scene_that_takes_too_long_is_refused_within_the_budget(honest, dragon, track):
    scene = honest[0]['scene']
    large = {**scene, 'dragon': {**scene['dragon'], **dragon}, 'track': {**scene['track'], **track}}
    assert refusal({**honest[0], 'scene': large, 'within': {}, 'proved_s': 41.0}, effort=0.02)


def test_its_distances_are_those_of_rectangles_and_its_slopes_those_of_differences():
    draw = random.Random(5)
    for _ in range(20):
        point = [draw.uniform(25, 60), draw.uniform(5.9, 6.7), 11.42, draw.uniform(2.8, 2.9), draw.uniform(1.6, 1.7)]
        pair = _at(point)
        best = max(min(float(one) for one in pair.distances(edge, 0.15, 0.275)[0]) for edge in range(8))
        one, other = (_rectangle(pair, which, point[2]) for which in (0, 1))
        assert best <= one.distance(other) + 1e-9
        assert (best < 0) == one.intersects(other)
        edge = draw.randrange(8)
        slopes = pair.distances(edge, 0.15, 0.275, True)[1]
        for row in range(5):
            near, far = (_at([value + sign * 1e-6 * (n == row) for n, value in enumerate(point)]).distances(
                edge, 0.15, 0.275)[0] for sign in (-1, 1))
            for corner in range(4):
                assert float(slopes[corner][row]) == pytest.approx(
                    float(far[corner] - near[corner]) / 2e-6, abs=2e-4)


def _at(point):
    return _Pair([arb(value) for value in point], [(value, value) for value in point])


def _rectangle(pair, which, scale):
    front, rear = (complex(float(handle.real), float(handle.imag)) for handle in pair._handles[which])
    u = (front - rear) / abs(front - rear)
    return shapely.Polygon([(z.real, z.imag) for z in (
        front + u * scale * complex(0.275, 0.15), front + u * scale * complex(0.275, -0.15),
        rear - u * scale * complex(0.275, 0.15), rear - u * scale * complex(0.275, -0.15))])


def test_the_command_writes_and_verifies_it(tmp_path, capfd):
    scene = ['--set', 'dragon.benches=10', '--set', 'track.start_turns=6', '--set', 'run.stop_s=2']
    file, wide = tmp_path / 'family.json', ['--within', 'dragon.width_m=0.01']
    assert contact.main([*scene, *wide, '--certificate', str(file), '--format', 'json']) == 0
    values = json.loads(capfd.readouterr().out)
    assert (values['proved_s'], values['why'], values['within']) == (2.0, 'run', {'dragon.width_m': 0.01})
    assert contact.main(['--verify', str(file)]) == 0
    assert 'touches itself from 0.0 s to 2.0 s' in capfd.readouterr().out
    assert contact.main([*scene, *wide, '--within', 'track.pitch_m=0.001']) == 0
    said = capfd.readouterr().out
    assert 'no dragon touches itself before 2.000000 s' in said
    assert 'the run ends at that time' in said
    assert contact.main([*scene, *wide, '--format', 'csv']) == 0
    assert capfd.readouterr().out.splitlines()[1].startswith('2.0,run,')


@pytest.mark.parametrize(('options', 'said'), [
    (['--within', 'dragon.width_m'], 'KEY=METRES'),
    (['--within', 'dragon.width_m=wide'], 'KEY=METRES'),
    (['--within', 'dragon.width_m=0.1', '--within', 'dragon.width_m=0.1'], 'given twice'),
    (['--within', 'dragon.width_m=-0.1'], 'the smallest is 0'),
    (['--within', 'dragon.width_m=0.1', '--near-misses', '0.1'], '--near-misses'),
    (['--within', 'dragon.width_m=0.1', '--verify', 'file'], '--within'),
])
def test_the_command_refuses_what_makes_no_family(options, said, capfd):
    assert contact.main(options) == 2
    err = capfd.readouterr().err
    assert said in err
    assert len(err.splitlines()) == 1
