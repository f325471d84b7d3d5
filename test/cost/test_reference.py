"""The reference of ``cost --scene`` with 40 digits agrees with the stored reference of all hard cases to 25 digits."""
import sys

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.cost import accuracy, costs
from hard_cases.cases import hard_cases
from hard_cases.truth import truth

mpmath = pytest.importorskip('mpmath')
DIGITS = 1e-24      # relative to the coordinates; the files have 25 significant digits
FEW = {case.name: case for case in hard_cases() if case.scene.dragon.benches < 1000}
VARIED = ('turn-10', 'wiggle', 'spirals', 'mixed-by-the-tail', 'turn-by-the-tail', 'far-corner', 'longest-track')


@pytest.mark.parametrize('name', thinned(list(FEW), lambda name: name in VARIED))
def test_the_reference_agrees_with_the_stored_digits(name):
    from dragon_ros.cost.reference import reference
    case, known = FEW[name], truth(FEW[name])
    for n, t_s in enumerate(case.times_s):
        states = reference(case.scene, t_s).states
        found = [vector for k in case.handles for vector in states[k]]
        with mpmath.workdps(40):
            true = [mpmath.mpc(*pair) for pair in known.high[n].reshape(-1, 2).tolist()]
            rest = [mpmath.mpc(*pair) for pair in known.low[n].reshape(-1, 2).tolist()]
            off = [abs(one - high - low) / max(1, abs(high)) for one, high, low in zip(found, true, rest, strict=True)]
        assert max(off) <= DIGITS


def test_the_first_handles_of_a_long_dragon_suffice():
    from dragon_ros.cost.reference import reference
    some, known = reference(FEW['wiggle'].scene, 3.0, 4), reference(FEW['wiggle'].scene, 3.0)
    assert some.states == known.states[:4]
    assert some.error_m(state(FEW['wiggle'].scene, 3.0).p) < 1e-12


def test_without_mpmath_the_errors_are_left_out_with_a_line_that_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mpmath', None)
    found = accuracy.measure(Scene(), 0.01, lambda what: None)
    assert all(np.isnan(row.error_m) for row in found.solvers)
    assert found.solvers[-1].positions.median_s > 0
    assert 'no errors: mpmath is not installed: pip install' in costs._accuracy_text(found)
