"""The reference of ``cost --scene`` agrees to 25 digits with the independent references of all hard cases."""
import sys

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.scene import Scene
from dragon_ros.cost import accuracy, costs
from hard_cases.cases import hard_cases
from hard_cases.truth import truth

mpmath = pytest.importorskip('mpmath')
DIGITS = 1e-24      # relative to the coordinates; the files have 25 significant digits
FEW = {case.name: case for case in hard_cases() if case.scene.dragon.benches < 1000}
VARIED = ('turn-10', 'wiggle', 'spirals', 'mixed-by-the-tail', 'turn-by-the-tail', 'far-corner', 'longest-track')


@pytest.mark.parametrize('name', thinned(list(FEW), lambda name: name in VARIED))
def test_the_reference_agrees_with_25_digits_computed_independently(name):
    from dragon_ros.cost.reference import reference
    case, known = FEW[name], truth(FEW[name])
    handles = list(case.handles)
    for n, t_s in enumerate(case.times_s):
        found = reference(case.scene, t_s)
        off = (found.high[handles] - known.high[n, :, :2]) + (found.low[handles] - known.low[n, :, :2])
        assert np.max(np.abs(off)) <= DIGITS * max(1.0, np.max(np.abs(known.high[n, :, :2])))
        size_m_s = max(1.0, np.max(np.abs(known.high[n, :, 2:])))
        assert found.velocity_m_s[handles] == pytest.approx(known.high[n, :, 2:], abs=1e-15 * size_m_s, rel=0)


def test_the_first_handles_of_a_long_dragon_suffice():
    from dragon_ros.cost.reference import reference
    some, known = reference(FEW['wiggle'].scene, 3.0, 4), reference(FEW['wiggle'].scene, 3.0)
    assert some.high.tolist() == known.high[:4].tolist()
    assert some.error_m(known.high) < 1e-15


def test_without_mpmath_the_errors_are_left_out_with_a_line_that_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mpmath', None)
    found = accuracy.measure(Scene(), 0.01, lambda what: None)
    assert all(np.isnan(row.error_m) for row in found.solvers)
    assert found.solvers[-1].positions.median_s > 0
    assert 'no errors: mpmath is not installed; pip install mpmath' in costs._accuracy_text(found)
