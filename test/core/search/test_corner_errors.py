"""Bounds on gaps allow for the errors of corners, pair by pair, in both kinds of search."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.enclosures.on_spiral import BenchSampler, bounds
from dragon_ros.core.geometry.rectangles import corner_levers
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.conservative_advancement import _ChainIntervals
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.spec import Arc, Composite, Spiral

MORE_M = 1e-7       # far above rounding, and far below the gaps


def test_a_bound_on_a_spiral_falls_by_the_excess_errors_of_both_benches():
    sampler = BenchSampler(track_of(Spiral()), Dragon(), (0,), 60, lambda states: None, 1e-9)
    sizes, behind = sampler.sizes, np.array([59])
    np.testing.assert_allclose(sizes.excess_m[0], 1e-9 * (corner_levers(Dragon(), 0.0)[:60] - 1))
    a, b = (sampler.sample(np.array([theta])) for theta in (60.0, 59.99))
    none, more = (bounds(a, b, replace(sizes, excess_m=np.full_like(sizes.excess_m, each)), behind)[0]
                  for each in (0.0, MORE_M))
    assert none - more == pytest.approx(2 * MORE_M, rel=1e-4)


@pytest.mark.parametrize('step_m', [0.01, 1.0])      # cleared by the bound on motion, and on curvature
def test_a_bound_of_the_whole_chain_falls_by_the_excess_errors_of_both_benches(step_m):
    scene = Scene(Dragon(12), Composite((Arc(4.0, 300.0),), 6.0), run=Run(stop_s=5.0))
    domain = SearchDomain(scene, RangeOfTravel(scene.head, 0.0, 5.0), 1, lambda states: None)
    space, group = _ChainIntervals(domain, False, {}), np.zeros(1, dtype=np.int64)
    np.testing.assert_allclose(space._excess_m, 2 * domain.error_m * (domain.levers - 1))
    samples, found = space.sample(np.array([1.0, 1.0 + step_m]), group), []
    for each in (0.0, MORE_M):
        space._excess_m = np.full(12, each)
        space.begin(samples, np.array([[0], [1]]), group)
        others_m, space._others_m = space._others_m, np.full(1, np.inf)     # judge only the pairs within reach
        near_m = space.judge(samples.rows(np.array([0])), samples.rows(np.array([1])), group).bound_m
        found.append((float(others_m[0]), float(near_m[0])))
    assert np.subtract(*found) == pytest.approx([2 * MORE_M, 2 * MORE_M], rel=1e-4)
