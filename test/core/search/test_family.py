"""The proof for a family holds for its dragons, is nearly as strong as possible, and states its limits."""
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.chain.chain import marched
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.enclosures.sliding_pair import AHEAD, LINK, OTHER, SCALE, THETA
from dragon_ros.core.errors import DragonError, FieldError, InputError
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.family import _BODY, _HEAD, Family, _FamilySearch, family_of, first_contact_within
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.tracks.composite import Place, track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Spiral, STurn
from dragon_ros.core.venue import LineObstacle, Venue

SMALL = Scene(dragon=Dragon(15), track=Spiral(0.55, 7.0))
LATE = replace(SMALL, run=Run(40.0))
BOX = {'dragon.width_m': 0.002, 'dragon.body_length_m': 0.002, 'dragon.head_length_m': 0.003,
       'dragon.hole_inset_m': 0.0005, 'track.pitch_m': 0.001}


@cache
def proof_of(scene, *within):
    return first_contact_within(scene, dict(within))


def contact_s(scene):
    found = first_contact(scene)
    return found.t_s if isinstance(found, Contact) else found.end.t_s


def drawn(scene, within, draw, corner):
    """Draw a dragon of a family, with a common width and inset, from the whole box or from its corners."""
    def off(key, count=1):
        share = draw.uniform(-1, 1, count)
        return within.get(key, 0.0) * (np.sign(share) if corner else share)

    dragon = scene.dragon
    lengths = [dragon.head_length_m + off('dragon.head_length_m')[0],
               *(dragon.body_length_m + off('dragon.body_length_m', dragon.benches - 1))]
    mixed = Mixed(tuple(Group(float(one)) for one in lengths), dragon.width_m + abs(off('dragon.width_m')[0]),
                  dragon.hole_inset_m + off('dragon.hole_inset_m')[0])
    return replace(scene, dragon=mixed, track=replace(scene.track, pitch_m=scene.track.pitch_m
                                                      - abs(off('track.pitch_m')[0])))


def test_without_tolerances_the_proof_ends_centimetres_before_the_contact():
    proof = proof_of(SMALL)
    assert proof.nominal.t_s - 0.03 < proof.proved_s < proof.nominal.t_s
    assert proof.proved_s < proof.limit_s <= proof.nominal.t_s + 1e-6
    assert (proof.why, proof.benches) == ('contact', proof.nominal.benches)


def test_no_dragon_of_a_family_touches_before_the_time_that_is_proved(request):
    proof, draw = proof_of(SMALL, *BOX.items()), np.random.default_rng(1)
    assert proof.proved_s < proof.nominal.t_s
    for n in range(40 if request.config.getoption('--long') else 2):
        assert contact_s(drawn(SMALL, BOX, draw, n % 2)) > proof.proved_s


@pytest.mark.parametrize(('key', 'change'), thinned([
    ('dragon.width_m', {'dragon': replace(SMALL.dragon, width_m=0.305)}),
    ('track.pitch_m', {'track': replace(SMALL.track, pitch_m=0.545)}),
], lambda case: case[0] == 'dragon.width_m'))
def test_the_worst_dragon_of_a_family_touches_within_centimetres_of_what_is_proved(key, change):
    proof = proof_of(SMALL, (key, 0.005))
    worst_s = contact_s(replace(SMALL, **change))
    assert worst_s - 0.03 < proof.proved_s < worst_s
    assert proof.limit_s == pytest.approx(worst_s, abs=0.02)


def test_a_wider_family_is_proved_no_further():
    within = (), (('dragon.width_m', 0.005),), (('dragon.width_m', 0.02), ('dragon.body_length_m', 0.002))
    times = [proof_of(SMALL, *one).proved_s for one in within]
    assert times == sorted(times, reverse=True)
    assert times[-1] < times[0] - 1


def test_a_run_that_stops_before_any_dragon_touches_is_proved_to_its_end():
    scene = replace(SMALL, run=Run(stop_s=20.0))
    proof = first_contact_within(scene, BOX)
    assert (proof.proved_s, proof.why, proof.limit_s, proof.benches) == (20.0, 'run', None, None)
    assert isinstance(proof.nominal, NoContact)


def test_where_links_might_lock_the_proof_ends_and_says_so():
    thin = replace(SMALL, dragon=Dragon(12, width_m=0.01, hole_inset_m=0.01), track=Spiral(2.0, 2.0))
    proof = first_contact_within(thin, {'track.pitch_m': 0.001})
    assert proof.why == 'bend'
    assert proof.proved_s < contact_s(thin)


def test_a_profile_of_speeds_is_proved_at_its_own_times():
    steady = proof_of(SMALL)
    slow = first_contact_within(replace(SMALL, head=Profile(((0.0, 0.0), (4.0, 0.5)))), {})
    assert slow.proved_s == pytest.approx(2 + 2 * steady.proved_s, abs=1e-6)


def test_a_run_that_starts_late_is_proved_from_there():
    whole, late = proof_of(SMALL, *BOX.items()), first_contact_within(LATE, BOX)
    assert late.proved_s == pytest.approx(whole.proved_s, abs=0.03)
    assert late.states < whole.states < 3000


def test_what_is_too_wide_to_prove_anything_names_the_tolerance_to_blame_and_the_time_that_is_proved_without_it():
    scene = replace(SMALL, dragon=Dragon(10), run=Run(54.0))
    with pytest.raises(DragonError, match=r'tolerance of dragon.width_m, 0.1 m, is too wide') as caught:
        first_contact_within(scene, {'dragon.width_m': 0.1, 'dragon.body_length_m': 0.001})
    without = proof_of(scene, ('dragon.body_length_m', 0.001))
    assert without.why == 'contact'
    assert str(caught.value).endswith(f'up to {without.proved_s:.6g} s')


@pytest.mark.parametrize(('scene', 'within', 'said'), [
    (SMALL, {'dragon.widht_m': 0.01}, 'did you mean dragon.width_m'),
    (SMALL, {'dragon.benches': 1.0}, 'tolerances are supported for'),
    (SMALL, {'dragon.width_m': -0.01}, 'the smallest is 0'),
    (SMALL, {'dragon.width_m': float('nan')}, 'finite'),
    (SMALL, {'track.pitch_m': 0.55}, 'smaller tolerance'),
    (SMALL, {'dragon.hole_inset_m': 0.3}, 'smaller tolerance'),
    (SMALL, {'dragon.body_length_m': 1.7}, 'may have zero length'),
    (replace(SMALL, track=STurn()), {}, 'single spiral'),
    (replace(SMALL, dragon=Mixed((Group(3.0), Group(2.0, 5)))), {}, 'equal benches behind the head'),
    (replace(SMALL, dragon=Dragon(2)), {}, 'at least 3'),
    (replace(SMALL, track=Spiral(0.55, 4_000.0)), {}, 'start closer to the centre'),
    (replace(SMALL, head=Head(lead='tail')), {}, 'head leads'),
    (replace(SMALL, venue=Venue((LineObstacle('wall', ((20.0, 20.0), (21.0, 20.0))),))), {}, 'omit the venue'),
    (replace(SMALL, head=Profile(((0.0, 1.0), (3.0, -1.0)))), {}, 'never moves it back'),
])
def test_what_is_not_covered_is_refused_with_its_reason(scene, within, said):
    with pytest.raises(FieldError, match=said):
        first_contact_within(scene, within)


def test_a_run_that_starts_where_links_might_lock_is_refused():
    with pytest.raises(InputError, match='starts where links may lock'):
        first_contact_within(replace(SMALL, track=Spiral(0.55, 2.6), run=Run(stop_s=0.1)), {})


def test_the_last_bench_of_any_dragon_of_a_family_is_within_what_a_box_says_which_is_little_more():
    family = family_of(replace(SMALL, dragon=Dragon(12)), BOX)
    search, unit = _FamilySearch(family, 0.0, 60.0, lambda states: None), track_of(Spiral(2 * np.pi))
    theta = 30.0, 30.001
    low, high = (np.array([[theta[end]], [(5.5, 8.0)[end]], [family.scale[end]], [family.head_link_m[end]],
                           [family.body_link_m[end]]]) for end in (0, 1))
    _, last, _ = search._strips(low, high, np.array([_HEAD]))
    seen = []
    for scale in family.scale:
        for head_m, body_m in product(family.head_link_m, family.body_link_m):
            links = scale * np.array([head_m, *(body_m,) * 11])
            chains = [marched(unit, links, Place(0, DoubleDouble(start, 0.0)), BEHIND) for start in theta]
            seen += [chain.u[11] - chain.u[0] for chain in chains]
    assert 5.5 < min(seen) < max(seen) <= last[0] <= max(seen) + 1e-3


@pytest.mark.parametrize(('head_m', 'body_m'), [((2.0, 2.9), (1.0, 1.7)), ((1.0, 1.1), (1.5, 1.7))])
def test_beyond_the_innermost_angle_of_a_family_the_curvature_times_its_longest_link_is_below_two(head_m, body_m):
    family = Family(20, 16.0, (0.5, 0.6), head_m, body_m, 0.15, 0.275)
    longest = max(*head_m, *body_m) * family.scale[1]

    def bend(theta):
        return (2 + theta * theta) / (1 + theta * theta) ** 1.5
    assert 0.8 * 2 < bend(family.innermost_rad) * longest < 2


@pytest.mark.parametrize(('head_m', 'body_m', 'within_m'), [
    ((0.7, 0.8), (0.3, 0.4), 0.004), ((0.3, 0.4), (0.7, 0.8), 0.004), ((1.1, 1.2), (1.5, 1.7), 0.01)])
def test_a_proof_omits_a_hundredth_of_the_shorter_link_or_of_a_metre(head_m, body_m, within_m):
    assert Family(20, 16.0, (0.5, 0.6), head_m, body_m, 0.15, 0.275).within_m == pytest.approx(within_m, rel=1e-12)


def test_the_first_boxes_hold_all_scales_and_links_of_a_family_and_places_without_a_hole():
    family = family_of(LATE, BOX)
    boxes = _FamilySearch(family, 0.0, 20.0, lambda boxes: None)._first()
    for inner, link_m in ((_HEAD, family.head_link_m), (_BODY, family.body_link_m)):
        mine = boxes.some(boxes.inner == inner)
        ranges = {SCALE: family.scale, LINK: link_m, OTHER: family.body_link_m, AHEAD: (0.0, np.inf)}
        for row, (low, high) in ranges.items():
            assert low < high
            assert {*mine.low[row]} == {low}
            assert {*mine.high[row]} == {high}
        assert np.array_equal(mine.low[THETA, 1:], mine.high[THETA, :-1])
    head, body = (boxes.some(boxes.inner == inner) for inner in (_HEAD, _BODY))
    start = 2 * np.pi * LATE.track.start_turns
    assert head.low[THETA, 0] < start - 20.0 * family.scale[0] / start
    assert start <= head.high[THETA, -1] < start + 1e-9
    # All links lie on the arc behind the head, whose length is about half the difference of the squared polar angles.
    lengths_m = family.head_link_m[1] + family.benches * family.body_link_m[1]
    assert body.high[THETA, -1] >= np.sqrt(start**2 + 2 * family.scale[0] * lengths_m)


def test_the_first_boxes_hold_the_last_bench_of_a_dragon_with_the_longest_head():
    family = Family(5, 60.0, (0.5, 0.6), (0.5, 40.0), (0.1, 0.12), 0.15, 0.0)
    boxes = _FamilySearch(family, 0.0, 1.0, lambda boxes: None)._first()
    links = family.scale[1] * np.array([family.head_link_m[1], *(family.body_link_m[1],) * 4])
    chain = marched(track_of(Spiral(2 * np.pi)), links, Place(0, DoubleDouble(family.start_rad, 0.0)), BEHIND)
    assert chain.u[4] > family.start_rad + 1
    assert chain.u[4] <= np.max(boxes.high[THETA, boxes.inner == _BODY])
