"""The claim that a search makes about a contact contains the rate at which the gap closes."""
from dataclasses import dataclass
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import _Claim, first_contact
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.spec import Spiral


@pytest.mark.parametrize('scene', [Scene(run=Run(400)), Scene(Dragon(40), Spiral(0.55, 7.0))], ids=['classic', 'small'])
def test_the_gap_closes_at_the_contact_as_its_differences_say(scene):
    found = first_contact(scene)
    travel = RangeOfTravel(scene.head, scene.run.start_s, compile_scene(scene).end.t_s)
    domain = SearchDomain(scene, travel, 1, lambda states: None)
    here = _Claim(domain, found.benches, domain.gone_m(found.t_s))
    step_m = 1e-4
    early, late = (domain.gap(found.benches, here.gone_m + sense * step_m) for sense in (-1, 1))
    assert here.slope == pytest.approx((early - late) / (2 * step_m), rel=1e-3)
    assert here._steepest == pytest.approx(here.slope, rel=1e-2)
    assert 0 < here.slack_m < 1e-6


THREE = Dragon(3)


@dataclass(frozen=True)
class Straight:
    """A stand-in for a domain whose gap is ``-rate y - bend y^2`` after a travel of ``y`` in the search's sense."""

    rate: float = 0.5
    bend: float = 0.0
    rounding_m: float = 0.0
    ends_m: tuple = (-1.0, 1.0)
    sense: int = 1
    unit: float = 1.0
    wide_m: float = 1e-9
    onwards: float = inf
    dragon: Dragon = THREE
    levers: tuple = (1.0, 1.0, 1.0)

    def step_m(self, pair):
        return self.wide_m

    def gap(self, pair, gone_m):
        y = self.sense * gone_m
        return -self.rate * y - self.bend * y * y

    def slope(self, pair, gone_m):
        return self.rate

    def left_m(self, gone_m, sense):
        return sense * (self.ends_m[sense > 0] - gone_m)

    def gone_m(self, t_s):
        return t_s

    time_s = gone_m

    def speed_m_s(self, t_s):
        return 1.0

    def onwards_m(self, t_s):
        return self.onwards

    def rounding_of(self, pair):
        return self.rounding_m

    def coarse(self, pair, gone_m):
        return 1.0


def claim(**known):
    return _Claim(Straight(**known), (0, 2), 0.0)


@pytest.mark.parametrize('sense', [1, -1])
def test_the_closing_rate_is_that_of_the_gap_and_what_rounding_adds(sense):
    assert claim(sense=sense)._closing(1e-3) == pytest.approx(0.5)
    assert claim(sense=sense, rate=-0.25)._closing(1e-3) == pytest.approx(0.25)
    assert claim(sense=sense, bend=9.0)._closing(1e-3) == pytest.approx(0.5)
    assert claim(sense=sense, rounding_m=1e-5)._closing(1e-3) == pytest.approx(0.5 + 1e-2)


@pytest.mark.parametrize('ends_m', [(-1e-3, 1.0), (-1.0, 1e-3), (-1e-4, 1e-4)])
def test_within_a_step_of_either_end_of_the_model_the_closing_rate_is_unknown(ends_m):
    assert claim(ends_m=ends_m)._closing(1e-3) == inf
    assert claim(ends_m=ends_m)._closing(0.9e-4) == pytest.approx(0.5)


def test_where_the_step_is_small_against_errors_a_wider_one_tells_the_closing_rate():
    assert claim(rounding_m=1e-8)._steepest == pytest.approx(0.5 + 1e-8 / 1e-6)
    wide = claim(rounding_m=1e-8, wide_m=1e-3)._steepest
    assert wide == pytest.approx(0.5 + 1e-5 + 0.75e-5)
    assert claim(rounding_m=1e-8, wide_m=1e-3, ends_m=(-2e-3, 1.0))._steepest == pytest.approx(0.51)
    assert claim(wide_m=1e-3, ends_m=(-1e-7, 1.0))._steepest == inf


@given(st.floats(0.01, 2), st.floats(0, 1e-10), st.floats(1e-10, 1e-7), st.sampled_from([1, -1]))
def test_a_contact_is_proved_if_benches_overlap_a_slack_further_on_and_all_is_clear_up_to_a_slack_before(
        rate, rounding_m, onwards, sense):
    one = claim(rate=rate, rounding_m=rounding_m, onwards=onwards, sense=sense)
    after_m = min(one.slack_m, onwards)
    assert one.overlaps == (rate * after_m > rounding_m)
    assert 1e-9 <= one.slack_m <= 1e-6
    for back, proved in ((0.999, True), (1.001, False)):
        assert one.touches(-sense * back * one.slack_m, False) == (proved and one.overlaps)
        assert one.touches(-sense * back * one.slack_m, True) == one.overlaps
        assert one.grazes(-sense * back * one.near_m) == proved


def test_the_slack_of_a_slow_contact_grows_with_the_lever_of_either_bench_of_the_pair_only():
    plain = claim(rate=0.005).slack_m
    assert plain > 1e-9
    for levers, times in (((2.0, 9.0, 1.0), 2), ((1.0, 9.0, 3.0), 3), ((1.0, 9.0, 1.0), 1)):
        assert claim(rate=0.005, levers=levers).slack_m == pytest.approx(times * plain)


def test_a_pair_further_apart_than_a_grazing_is_none():
    far = _Claim(Straight(rate=1.0), (0, 2), -1.5e-7)
    assert not far.grazes(far.gone_m)
    assert _Claim(Straight(rate=1.0), (0, 2), -0.5e-7).grazes(-0.5e-7)
