"""What is claimed about a touch follows from the rate at which the gap closes."""
from dataclasses import replace

import pytest

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.driver import Bracket
from dragon_ros.core.search.first_contact import first_contact, gap_at, slack_at_m, slope_of, touch_in
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.spec import Spiral


def domain_of(scene):
    travel = RangeOfTravel.of(compile_scene(scene))
    return SearchDomain(compile_scene(scene), travel, 1, lambda states: None)


@pytest.fixture(scope='module')
def met():
    """Return the domain of the classic run and the touch of its contact."""
    domain = domain_of(Scene(run=Run(412.0, 413.0)))
    return domain, touch_in(domain, Bracket(412.4735, 412.474))


@pytest.mark.parametrize('scene', [Scene(run=Run(400)), Scene(Dragon(40), Spiral(0.55, 7.0))], ids=['classic', 'small'])
def test_the_gap_closes_at_the_contact_as_its_differences_say(scene):
    found, domain = first_contact(scene), domain_of(scene)
    travel_m, step_m = domain.travel_m(found.t_s), 1e-4
    early, late = (gap_at(domain, found.benches, travel_m + sense * step_m) for sense in (-1, 1))
    slope = (early - late) / (2 * step_m)
    assert slope_of(domain, found.benches, travel_m) == pytest.approx(slope, rel=1e-3)
    assert found.approach_m_s == pytest.approx(slope, rel=1e-3)


def test_the_slack_is_a_nanometre_and_wider_for_late_times_and_slow_approaches_up_to_a_micrometre(met):
    domain, _ = met
    assert domain.slack_m == 1e-9
    assert slack_at_m(domain, 412.0, 1.0) == 1e-9
    assert slack_at_m(domain, 2.0**24, 1.0) == 2.0**-26          # four ulps at 1 m/s
    assert slack_at_m(domain, 412.0, 1e-3) == pytest.approx(2e3 * domain.tolerance_m)
    assert slack_at_m(domain, 412.0, 1e-9) == pytest.approx(1e-6)


def test_a_contact_is_claimed_where_benches_overlap_a_slack_further_on_and_all_is_clear_a_slack_before(met):
    domain, touch = met
    assert (touch.pair, touch.grazing_m, touch.holds) == ((0, 8), None, True)
    before, after = (gap_at(domain, touch.pair, touch.travel_m + sense * touch.slack_m) for sense in (-1, 1))
    assert after < 0 < before
    here_m = domain.travel_m(touch.t_s)
    for back, proved in ((0.999, True), (1.001, False)):
        assert touch.holds_if_clear(domain, here_m - back * touch.slack_m) == proved
    assert not replace(touch, holds=False).holds_if_clear(domain, here_m)


def test_a_pair_further_apart_than_a_grazing_is_none():
    domain = domain_of(Scene(run=Run(409.0, 410.0)))
    passed = touch_in(domain, Bracket(409.83198, 409.83199))       # the gap is 0.87 mm
    assert passed.pair == (0, 11)
    assert passed.grazing_m == pytest.approx((0.865e-3, 0.865e-3), abs=1e-6)
    assert not passed.holds
    assert passed.slack_m == pytest.approx(1e-7)
