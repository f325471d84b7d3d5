"""If layers are provably apart, intervals are cleared without samples, adjoin each other, and have valid bounds."""
from itertools import pairwise

import numpy as np
import pytest
from certificates import proved
from properties import thinned

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import state
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes import certificate

DICE = np.random.default_rng(5)
UNLIKE = Mixed((Group(3.41), *map(Group, DICE.uniform(2.19, 2.21, 40).tolist())))
STRANGE = Mixed((Group(2.0), Group(3.9), Group(1.3, 9), *map(Group, DICE.uniform(1.5, 2.5, 25).tolist())), 0.2)
OUT = Profile(((0.0, 0.0), (10.0, -2.0), (40.0, -2.0)))


SCENES = [Scene(UNLIKE, Spiral(0.55, 14.0), Head(), Run(0, 300)),
          Scene(STRANGE, Spiral(0.6, 12.0), Head(), Run(0, 200)),
          Scene(UNLIKE, Spiral(0.55, 5.0), OUT, Run(0, 40)),
          Scene(STRANGE, Spiral(0.6, 6.0), OUT, Run(0, 40))]


@pytest.mark.parametrize('scene', thinned(SCENES, lambda scene: scene in SCENES[1::2]),
                         ids=['in', 'strange, in', 'out', 'strange, out'])
def test_only_places_near_the_centre_are_searched_and_no_gap_is_below_the_lowest_bound(scene):
    found = first_contact(scene)
    assert isinstance(found, NoContact)
    assert found.certificate.complete
    rows = found.certificate.intervals
    assert all(before.stop_m == after.start_m for before, after in pairwise(rows))
    least_m, (i, j) = min(row.bound_m for row in rows), np.triu_indices(scene.dragon.benches, 2)
    assert least_m > 0
    for t_s in np.linspace(0, scene.run.stop_s, 25):
        chain = state(scene, t_s)
        assert np.min(gaps(benches_of(chain, scene.dragon, axes_of(chain)), i, j)) >= least_m
    longest_m = max(abs(row.stop_m - row.start_m) for row in rows)
    assert longest_m > 8 * np.max(scene.dragon.bench_lengths_m)
    assert found.states < 150


def test_a_head_that_moves_out_ten_times_as_far_is_sampled_hardly_more():
    law = Profile(((0.0, 0.0), (10.0, -2.0), (310.0, -2.0)))
    near, far = (first_contact(Scene(UNLIKE, Spiral(0.55, 5.0), law, Run(0, stop_s))) for stop_s in (35, 300))
    assert 0 < far.states <= near.states + 20


@pytest.mark.parametrize(('dragon', 'turns'), thinned([(UNLIKE, 14.0), (Dragon(), 16.0)], lambda case: case[1] == 16))
def test_the_checker_proves_what_is_cleared_without_samples(dragon, turns):
    scene = Scene(dragon, Spiral(0.55, turns), Head(), Run(0, 60))
    found = first_contact(scene)
    assert found.states == 2        # both ends of the run
    assert proved(certificate.as_values(scene, found)).startswith('no two benches touch from 0.0 s to the end')


def test_dragons_with_the_same_benches_are_equal_and_have_one_hash():
    twin = Mixed(tuple(Group(each.length_m, each.count) for each in UNLIKE.groups))
    assert twin == UNLIKE
    assert hash(twin) == hash(UNLIKE)
    assert len({UNLIKE, twin, STRANGE, Mixed(UNLIKE.groups, 0.31), Mixed(UNLIKE.groups, 0.3, 0.27)}) == 4
