"""The tolerance of a search allows for the errors of corners, which exceed those of handles."""
import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.conservative_advancement import ChainIntervals
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.spec import Arc, Composite

MORE = 1e4      # errors of handles that are this many times larger still count as small


def domain_of(dragon):
    scene = Scene(dragon, Composite((Arc(4.0, 300.0),), 9.0), run=Run(stop_s=5.0))
    return SearchDomain(compile_scene(scene), RangeOfTravel(scene.head, 0.0, 5.0), 1, lambda states: None)


def placed(p, dragon):
    axis = p[:-1] - p[1:]
    return Benches(0.5 * (p[:-1] + p[1:]), axis / np.hypot(*axis.T)[:, None], *dragon.half_sizes_m)


@pytest.mark.parametrize('dragon', [Dragon(8), Dragon(8, 2.2, 2.2, 0.3, 0.8),
                                    Mixed((Group(3.0), Group(0.9, 6)), 1.5, 0.2)],
                         ids=['classic', 'long overhangs', 'wide'])
def test_no_gap_errs_by_more_than_its_error_if_no_handle_errs_by_more_than_its_own(dragon):
    domain, dice = domain_of(dragon), np.random.default_rng(3)
    p, (i, j) = domain.chain(1.0).p, np.triu_indices(dragon.benches, 2)
    true_m, most_m = gaps(placed(p, dragon), i, j), 0.0
    for _ in range(400):
        turn = dice.uniform(0, 2 * np.pi, len(p))
        off = MORE * domain.error_m * np.stack((np.cos(turn), np.sin(turn)), axis=1)
        most_m = max(most_m, float(np.max(np.abs(gaps(placed(p + off, dragon), i, j) - true_m))))
    assert 0.2 < most_m / (MORE * domain.gap_error_m) <= 1 + 1e-3


@pytest.mark.parametrize('step_m', [0.01, 1.0])      # cleared by the bound on motion, and on acceleration
def test_an_interval_counts_as_clear_only_above_the_error_of_a_gap_at_both_its_ends(step_m):
    domain, group = domain_of(Dragon(12, 1.2, 1.2)), np.zeros(1, dtype=np.int64)
    space = ChainIntervals(domain)
    assert space.tolerance_m == domain.tolerance_m == 2 * domain.gap_error_m
    samples = space.sample(np.array([1.0, 1.0 + step_m]))
    space.begin(samples, np.array([[0], [1]]))
    bound_m = space.judge(samples.rows([0]), samples.rows([1]), group).bound_m[0]
    assert bound_m > space.tolerance_m
    space.tolerance_m = bound_m         # pairs are examined further as long as their bounds are below the tolerance
    space.begin(samples, np.array([[0], [1]]))
    assert space.judge(samples.rows([0]), samples.rows([1]), group).bound_m[0] >= bound_m
