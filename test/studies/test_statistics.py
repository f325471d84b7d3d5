"""The statistics of a data set agree with known true values, and are omitted if there are too few rows."""
import subprocess
import sys
from math import inf

import numpy as np
import pytest
from scipy.stats import norm

from dragon_ros.core.errors import FieldError
from dragon_studies import statistics
from dragon_studies.sampling import values_of

SALTELLI = """
vary:
  track.pitch_m: {uniform: [0, 1]}
  track.start_turns: {uniform: [0, 1]}
  dragon.width_m: {uniform: [0, 1]}
design: saltelli
samples: 512
ask: [lock]
"""


def test_intervals_of_the_median_hold_as_often_as_they_say():
    draw, held = np.random.default_rng(1), 0
    for _ in range(400):
        found = statistics.quantile(draw.normal(size=61), 0.5)
        held += found.low <= 0 <= found.high
    assert held / 400 >= 0.94


def test_a_bound_of_one_in_a_thousand_takes_2995_rows():
    assert statistics.safe_rows(0.999) == 2995
    values = np.random.default_rng(2).normal(size=2995)
    assert statistics.upper_bound(values, 0.999) == values.max()
    assert statistics.upper_bound(values[:-1], 0.999) == inf
    assert statistics.quantile(values[:100], 0.999).high == inf


def test_the_bound_of_a_normal_distribution_holds_as_often_as_it_says():
    draw, truth = np.random.default_rng(3), norm.ppf(0.999)
    held = sum(statistics.normal_upper_bound(draw.normal(size=40), 0.999) >= truth for _ in range(400))
    assert 0.92 <= held / 400 <= 0.98


def test_shares_have_the_interval_of_clopper_and_pearson():
    assert statistics.proportion(0, 300) == statistics.Estimate(0.0, 0.0, pytest.approx(0.0122209747))
    assert statistics.proportion(300, 300) == statistics.Estimate(1.0, pytest.approx(1 - 0.0122209747), 1.0)
    half = statistics.proportion(5, 10)
    assert (half.low, half.high) == (pytest.approx(0.187086, abs=1e-6), pytest.approx(0.812914, abs=1e-6))


def test_the_band_of_a_distribution_is_that_of_massart():
    ordered, steps, half = statistics.distribution(np.array([3.0, 1.0, 2.0]))
    assert ordered.tolist() == [1, 2, 3]
    assert steps.tolist() == pytest.approx([1 / 3, 2 / 3, 1])
    assert half == pytest.approx(0.784, abs=1e-3)


def test_indices_are_those_of_a_function_whose_indices_are_known(study):
    one = study(SALTELLI)
    points = np.array([[*values_of(one, index).values()] for index in range(one.rows)])
    a, b, c = points.T
    found = statistics.indices(one, a + 2 * b + a * c)
    whole = (2.25 + 4 + 0.25) / 12 + 1 / 144
    first = np.array([2.25, 4, 0.25]) / 12 / whole
    total = first + np.array([1, 0, 1]) / 144 / whole
    for index, alone, with_others in zip(found, first, total, strict=True):
        assert index.first.low <= alone <= index.first.high
        assert index.total.low <= with_others <= index.total.high
        assert index.first.value == pytest.approx(alone, abs=0.03)
        assert index.total.value == pytest.approx(with_others, abs=0.03)
    assert found == statistics.indices(one, a + 2 * b + a * c), 'the bootstrap is repeatable'


def test_indices_take_every_row_and_their_own_design(study):
    one = study(SALTELLI)
    with pytest.raises(FieldError, match='each row must have the answer'):
        statistics.indices(one, np.full(one.rows, np.nan))
    with pytest.raises(FieldError, match='write design: saltelli'):
        statistics.indices(study(), np.zeros(12))
    assert statistics.indices(one, np.ones(one.rows))[0].first.value == 0
    few = one.with_samples(8)
    with pytest.raises(FieldError, match='samples: 8 is not valid: .* at least 16 base points; give more --samples'):
        statistics.indices(few, np.arange(few.rows, dtype=np.float64))


@pytest.mark.parametrize(('values', 'may_be'), [
    (np.random.default_rng(3).normal(size=200), True), (np.random.default_rng(3).exponential(size=200), False),
    (np.repeat((409.5, 412.5), 100), False), (np.random.default_rng(3).normal(size=19), False)],
    ids=['normal', 'skewed', 'two values', 'too few'])
def test_only_rows_that_do_not_contradict_a_normal_distribution_get_its_bound(values, may_be):
    assert statistics.may_be_normal(values) is may_be


def test_a_random_study_of_uniform_laws_computes_its_rows_without_scipy():
    code = ('import sys\nsys.modules["scipy"] = None\nfrom pathlib import Path\n'
            'from dragon_ros.scenes.yaml import parse_document\nfrom dragon_studies.rows import rows_of\n'
            'from dragon_studies.definition import study_of\n'
            'study = study_of(parse_document("f", sys.stdin.read()), Path())\n'
            'print(*(row["status"] for row in rows_of(study, range(2))))')
    text = ('set: {dragon: {benches: 3}}\nvary: {track.pitch_m: {uniform: [0.5, 0.6]}, dragon.width_m: [0.2, 0.3]}\n'
            'design: random\nsamples: 2\nask: [lock]\n')
    done = subprocess.run([sys.executable, '-c', code], input=text, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ['ok', 'ok']
