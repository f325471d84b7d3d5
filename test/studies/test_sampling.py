"""The inputs of a row depend only on the study and the row's index, and have the requested distribution."""
import numpy as np
import pytest
from scipy.stats import kstest, qmc, truncnorm

from dragon_ros.scenes.load import scene_of
from dragon_ros.scenes.yaml import Document
from dragon_studies.sampling import scene_values_of, values_of

NORMAL = """
set: {dragon: {kind: mixed, groups: [{length_m: 3.41}, {count: 4, length_m: 2.2}, {length_m: 3}]}}
vary:
  track.pitch_m: {uniform: [0.5, 0.6]}
  dragon.groups.2.length_m: {normal: [2.2, 0.01], within: [2.19, 2.23], per: bench}
  dragon.groups.3.length_m: [2, 3]
design: DESIGN
samples: 256
seed: 5
ask: [lock]
"""


@pytest.mark.parametrize('design', ['random', 'sobol', 'saltelli'])
def test_rows_have_the_same_inputs_in_any_order(study, design):
    one = study(NORMAL.replace('DESIGN', design))
    indices = [*range(8), 100, 255]
    in_order = [values_of(one, index) for index in indices]
    assert [values_of(one, index) for index in reversed(indices)] == in_order[::-1]
    assert len({values['track.pitch_m'] for values in in_order}) >= (3 if design == 'saltelli' else 10)


def test_another_seed_gives_other_inputs(study):
    text = NORMAL.replace('DESIGN', 'random')
    assert values_of(study(text), 0) != values_of(study(text.replace('seed: 5', 'seed: 6')), 0)


@pytest.mark.parametrize('design', ['random', 'sobol'])
def test_inputs_have_the_distributions_of_the_study(study, design):
    one = study(NORMAL.replace('DESIGN', design))
    rows = [values_of(one, index) for index in range(256)]
    pitch = np.array([row['track.pitch_m'] for row in rows])
    lengths = np.ravel([row['dragon.groups.2.length_m'] for row in rows])
    assert kstest(pitch, 'uniform', args=(0.5, 0.1)).pvalue > 0.01
    assert kstest(lengths, truncnorm(-1, 3, loc=2.2, scale=0.01).cdf).pvalue > 0.01
    assert lengths.min() >= 2.19
    assert lengths.max() <= 2.23
    assert 90 < sum(row['dragon.groups.3.length_m'] == 2 for row in rows) < 166


def test_a_sobol_design_is_the_scrambled_sequence_of_scipy(study):
    one = study(NORMAL.replace('DESIGN', 'sobol'))
    points = qmc.Sobol(6, scramble=True, seed=np.random.default_rng(5)).random(16)
    found = [values_of(one, index)['track.pitch_m'] for index in range(16)]
    assert found == (0.5 + points[:, 0] * (0.6 - 0.5)).tolist()


def test_saltelli_changes_one_key_at_a_time_and_benches_together(study):
    one = study(NORMAL.replace('DESIGN', 'saltelli'))
    a, b, *mixed = [values_of(one, 5 * 3 + n) for n in range(5)]
    assert one.rows == 256 * 5
    for n, (key, _) in enumerate(one.vary):
        assert mixed[n] == {**a, key: b[key]}


def test_each_bench_of_a_group_gets_its_own_length(study):
    one = study(NORMAL.replace('DESIGN', 'random'))
    values = values_of(one, 0)
    scene = scene_of(Document('row', scene_values_of(one, values)))
    assert scene.dragon.bench_lengths_m.tolist() == [
        3.41, *values['dragon.groups.2.length_m'], values['dragon.groups.3.length_m']]
    assert one.base['dragon']['groups'][1] == {'length_m': 2.2, 'count': 4}, 'the base scene has changed'


def test_the_last_key_of_a_grid_changes_fastest_and_whole_numbers_stay_whole(study):
    one = study('vary: {dragon.benches: {from: 3, to: 5, steps: 3}, head.lead: [head, tail]}\nask: [lock]')
    found = [tuple(values_of(one, index).values()) for index in range(one.rows)]
    assert found == [(3, 'head'), (3, 'tail'), (4, 'head'), (4, 'tail'), (5, 'head'), (5, 'tail')]
    assert all(isinstance(benches, int) for benches, _ in found)
