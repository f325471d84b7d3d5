"""A pair of benches repeats another pair only if that pair stood exactly so earlier in the search."""
import numpy as np
import pytest
from apart import smallest
from certificates import proved
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.repeats import Repeats, _period
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral
from dragon_ros.scenes import certificate

BENT = Composite((Line(60.0), Arc(4.0, 200.0), Line(3.0), Arc(3.0, -150.0), Line(40.0)), start_m=62.0)
ALTERNATING = Mixed((Group(3.0), *(Group(length) for _ in range(9) for length in (2.2, 1.7))))


def domain_of(scene):
    travel = RangeOfTravel.of(compile_scene(scene))
    return SearchDomain(compile_scene(scene), travel, travel.senses[0], lambda states: None)


def gap_of(domain, travel_m, i, j):
    chain = domain.chain(travel_m)
    benches = benches_of(chain, domain.dragon, axes_of(chain))
    return float(gaps(benches, np.array([i]), np.array([j]))[0])


@examples(20)
@given(st.sampled_from([Dragon(14), Dragon(14, 2.2, 2.2), ALTERNATING, Mixed((Group(1.5, 6), Group(2.2, 8)))]),
       st.sampled_from([('head', 1.0, 0.0), ('tail', 1.0, 0.0), ('head', -1.0, 1.0)]), st.floats(0, 1),
       st.randoms(use_true_random=False))
def test_a_pair_that_repeats_stands_as_the_pair_one_period_ahead_stood_earlier(dragon, how, share, dice):
    lead, speed, from_end = how
    scene = Scene(dragon, Composite(BENT.pieces, 62.0 + 30.0 * from_end), Head(speed, lead), Run(0, 12))
    domain = domain_of(scene)
    repeats, period = Repeats(domain), _period(dragon.link_lengths_m)
    travel_m = domain.start_m + share * (domain.stop_m - domain.start_m)
    here = domain.along_m(travel_m)
    i, j = np.triu_indices(dragon.benches, 2)
    again = repeats.repeated(here, here, i, j)
    forwards = repeats._forwards
    for n in dice.sample(np.flatnonzero(again).tolist(), min(6, int(again.sum()))):
        shift = -period if forwards else period
        handle = i[n] if lead == 'head' else j[n] + 1
        earlier_m = domain.travel_at(int(handle + shift), float(here[handle]), (domain.start_m, travel_m))
        assert domain.sense * (travel_m - earlier_m) > 0
        assert domain.along_m(earlier_m)[handle + shift] == pytest.approx(here[handle], abs=1e-9)
        assert gap_of(domain, earlier_m, i[n] + shift, j[n] + shift) == pytest.approx(
            gap_of(domain, travel_m, i[n], j[n]), abs=1e-9)


def test_pairs_of_equal_benches_repeat_once_the_bench_ahead_has_passed_their_place_and_not_before():
    domain = domain_of(Scene(Dragon(20), Spiral(0.55, 9.0), run=Run(0, 30)))
    repeats, (i, j) = Repeats(domain), np.triu_indices(20, 2)
    link_m = domain.along_m(0.0)[2] - domain.along_m(0.0)[3]
    for travel_m, often in ((0.0, False), (0.9 * abs(link_m), False), (1.2 * abs(link_m), True)):
        here = domain.along_m(travel_m)
        again = repeats.repeated(here, here, i, j)
        assert not np.any(again[i < 2])        # the head is longer, so bench 1 has no bench of its kind ahead
        assert np.all(again[i >= 2] == often)


def test_benches_that_alternate_repeat_after_two():
    periods = [_period(each.link_lengths_m) for each in (Dragon(), ALTERNATING, Mixed((Group(2.2), Group(1.7))))]
    assert periods == [1, 2, 1]
    domain = domain_of(Scene(ALTERNATING, Spiral(0.55, 9.0), run=Run(0, 30)))
    here, (i, j) = domain.along_m(8.0), np.triu_indices(ALTERNATING.benches, 2)
    again = Repeats(domain).repeated(here, here, i, j)
    assert np.all(again == (i >= 3))


@pytest.mark.parametrize(('dragon', 'track', 'speed', 't_s', 'pair'), [
    (Dragon(24, 2.822, 2.822, 0.289), Spiral(0.6943, 2.4369), 1.0, 0.4591, (1, 6)),
    (Dragon(24, 0.9, 2.725, 0.277), Spiral(0.5334, 5.7610), 1.0, 0.2039, (2, 11)),
    (Dragon(24, 1.899, 1.899, 0.236), Spiral(0.4561, 3.4580), -1.0, 0.4219, (1, 9))])
def test_a_contact_of_body_benches_within_the_first_link_is_not_taken_for_a_repeat(dragon, track, speed, t_s, pair):
    """No bench ahead has passed the places at which benches of a tightly wound spiral touch soon after the start."""
    scene = Scene(dragon, track, Head(speed), Run(0, 2.5))
    found = first_contact(scene)
    assert (found.benches, found.t_s) == (pair, pytest.approx(t_s, abs=1e-3))
    assert speed * found.t_s < dragon.link_lengths_m[1]
    assert smallest(scene, found.t_s - 1e-8) > 0 == smallest(scene, found.t_s + 1e-8)
    assert proved(certificate.as_values(scene, found))
