"""If layers are provably apart, intervals are cleared without samples, adjoin each other, and have valid bounds."""
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from certificates import proved
from properties import thinned

from dragon_ros.core.chain.chain import marched_many
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.enclosures.layers import Layers
from dragon_ros.core.geometry.rectangles import Benches, axes_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.leading_benches import LeadingBenches
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes import certificate

DICE = np.random.default_rng(5)
UNLIKE = Mixed((Group(3.41), *map(Group, DICE.uniform(2.19, 2.21, 40).tolist())))
STRANGE = Mixed((Group(2.0), Group(3.9), Group(1.3, 9), *map(Group, DICE.uniform(1.5, 2.5, 25).tolist())), 0.2)
OUT = Profile(((0.0, 0.0), (10.0, -2.0), (40.0, -2.0)))


def domain_of(scene, sense):
    travel = RangeOfTravel(scene.head, scene.run.start_s, scene.run.stop_s)
    return SearchDomain(scene, travel, sense, lambda states: None)


def least_gap(scene, interval):
    """Return the smallest sampled gap between an interval's bench and those that it covers."""
    track, lead, count = track_of(scene.track, BEHIND), interval.lead, interval.behind + 1
    along_m = np.linspace(interval.start_m, interval.stop_m, 9)
    theta = np.array([track.place_at(each).u.hi for each in along_m])
    leaders = np.zeros(theta.size, dtype=np.int64), theta, np.zeros_like(theta)
    chain = marched_many(track, scene.dragon.link_lengths_m[lead:lead + count], leaders, BEHIND)
    centre = 0.5 * (chain.p[:, :-1] + chain.p[:, 1:])
    half_m = [np.broadcast_to(each[lead:lead + count], centre.shape[:2]) for each in scene.dragon.half_sizes_m]
    row, other = np.arange(theta.size)[:, None], np.arange(2, count)[None]
    return float(np.min(gaps(Benches(centre, axes_of(chain), *half_m), (row, np.zeros_like(other)), (row, other))))


SCENES = [Scene(UNLIKE, Spiral(0.55, 14.0), Head(), Run(0, 300)),
          Scene(STRANGE, Spiral(0.6, 12.0), Head(), Run(0, 200)),
          Scene(UNLIKE, Spiral(0.55, 5.0), OUT, Run(0, 40)),
          Scene(STRANGE, Spiral(0.6, 6.0), OUT, Run(0, 40))]
found_in = cache(first_contact)


@pytest.mark.parametrize('scene', thinned(SCENES, lambda scene: scene in SCENES[1::2]),
                         ids=['in', 'strange, in', 'out', 'strange, out'])
def test_intervals_join_from_end_to_end_of_the_way_of_each_bench_and_no_gap_in_them_is_below_their_bounds(scene):
    found = found_in(scene)
    assert isinstance(found, NoContact)
    assert found.certificate.complete
    domain = domain_of(scene, -1 if scene.head is OUT else 1)
    ends = [domain.along_m(end) for end in (domain.start_m, domain.stop_m)]
    for part in scene.dragon.classes:
        lead, rows = part[0], found.certificate.led_by(part[0])
        assert all(before.stop_m == after.start_m for before, after in pairwise(rows))
        passed = [end[bench] for end in ends for bench in (lead, part[-1])]
        assert min(rows[0].start_m, rows[-1].stop_m) == pytest.approx(min(passed), abs=1e-9)
        assert max(rows[0].start_m, rows[-1].stop_m) == pytest.approx(max(passed), abs=1e-9)
    for interval in found.certificate.intervals[::11]:
        assert 0 < interval.bound_m <= least_gap(scene, interval)


def test_only_places_near_the_centre_are_sampled_whichever_way_the_head_moves():
    for scene in (SCENES[0], SCENES[2]):
        found = found_in(scene)
        assert 0 < found.states < 30 < len(found.certificate.intervals)


def test_a_head_that_moves_out_ten_times_as_far_is_sampled_hardly_more():
    law = Profile(((0.0, 0.0), (10.0, -2.0), (310.0, -2.0)))
    near, far = (first_contact(Scene(UNLIKE, Spiral(0.55, 5.0), law, Run(0, stop_s))) for stop_s in (35, 300))
    assert 0 < far.states <= near.states + 3


@pytest.mark.parametrize('turns', [14.0, 9.0])
@pytest.mark.parametrize('law', [Head(), OUT], ids=['in', 'out'])
def test_the_bound_of_an_interval_without_samples_is_that_at_its_inner_end(turns, law):
    scene = Scene(UNLIKE, Spiral(0.55, turns), law, Run(0, 40))
    found, track = first_contact(scene), track_of(scene.track, BEHIND)
    assert found.states == 0
    inner = np.array([min(track.place_at(each.start_m).u.hi, track.place_at(each.stop_m).u.hi)
                      for each in found.certificate.intervals])
    lead = np.array([each.lead for each in found.certificate.intervals])
    bounds_m = [each.bound_m for each in found.certificate.intervals]
    assert bounds_m == pytest.approx(Layers(scene.track.b_m, UNLIKE).gaps_m(inner, lead).tolist(), rel=1e-9)


@pytest.mark.parametrize(('dragon', 'turns'), thinned([(UNLIKE, 14.0), (Dragon(), 16.0)], lambda case: case[1] == 16))
def test_the_checker_proves_what_is_cleared_without_samples(dragon, turns):
    scene = Scene(dragon, Spiral(0.55, turns), Head(), Run(0, 60))
    found = first_contact(scene)
    assert found.states == 0
    assert proved(certificate.as_values(scene, found)).startswith('no two benches touch from 0.0 s to the end')


def test_a_head_that_moves_out_from_a_place_that_is_not_clear_keeps_no_interval_beyond_it():
    scene = Scene(Dragon(60, 3.41, 2.2), Spiral(0.55, 4.0), OUT, Run(0, 40))
    domain = domain_of(scene, -1)
    head = LeadingBenches(domain, (0,))
    hit = head.clear(domain.stop_m)
    assert hit
    along_m = domain.along_m(hit.clear_m)[0]
    assert all(max(-each.start_m, -each.stop_m) <= -along_m + 1e-6 for each in head.intervals())


def test_dragons_with_the_same_benches_are_equal_and_have_one_hash():
    twin = Mixed(tuple(Group(each.length_m, each.count) for each in UNLIKE.groups))
    assert twin == UNLIKE
    assert hash(twin) == hash(UNLIKE)
    assert len({UNLIKE, twin, STRANGE, Mixed(UNLIKE.groups, 0.31), Mixed(UNLIKE.groups, 0.3, 0.27)}) == 4
