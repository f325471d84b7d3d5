"""The positions of the checker's benches, compared with results derived by hand."""
from argparse import ArgumentTypeError
from math import asin, hypot, inf

import pytest
from certificates import proved, written
from flint import arb

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.scene import Run, Scene
from dragon_ros.verify.command import _effort
from dragon_ros.verify.posture import Bench
from dragon_ros.verify.segments import Link, furthest_m

BENCH = Bench(Link(arb(2), 2.0), arb(1.25), arb(0.5))
OVERHANG_M = hypot(0.25, 0.5)


@pytest.mark.parametrize(('moved_m', 'bend', 'most_rad'), [
    ((0.5, 0.25), None, 0.75 / 2), ((0.0, 0.25), None, 0.25 / 2), ((0.25, 0.0), None, 0.25 / 2),
    ((0.5, 0.25), 0.5, 0.75 * 0.25), ((0.5, 0.25), 4.0, 0.75 / 2)])
def test_beside_its_link_a_point_goes_as_far_as_the_link_turns_by_both_handles(moved_m, bend, most_rad):
    told = BENCH.turned_m(moved_m, bend)
    assert OVERHANG_M * most_rad <= told <= OVERHANG_M * most_rad * (1 + 1e-9)


def test_arm_and_overhang_are_distances_of_a_corner_from_the_middle_and_from_the_link():
    assert BENCH.overhang_m == pytest.approx(OVERHANG_M, rel=1e-12)
    assert BENCH.arm_m == pytest.approx(hypot(1.25, 0.5), rel=1e-12)
    assert BENCH.sizes == (1.25, 0.5)


@pytest.mark.parametrize(('bend', 'length_m', 'arc_m'), [
    (0.0, 2.0, 2.0), (1e-12, 2.0, 2.0), (0.25, 2.0, 8 * asin(0.25)), (1.0, 2.0, 2 * asin(1.0))])
def test_the_next_handle_is_no_further_on_than_on_a_circle_of_the_largest_curvature(bend, length_m, arc_m):
    assert furthest_m(bend, length_m) == pytest.approx(arc_m, rel=1e-12)


def test_a_certificate_of_a_single_bench_is_accepted():
    assert 'end of the run at 5 s' in proved(written(Scene(Dragon(1), run=Run(0, 5))))


@pytest.mark.parametrize('text', ['0', '-0.5', 'inf', 'nan', 'much'])
def test_an_effort_that_is_not_a_positive_number_is_refused(text):
    with pytest.raises(ArgumentTypeError, match=text):
        _effort(text)
    assert 0 < _effort('1e-3') < inf
