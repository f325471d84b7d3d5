"""Dips of known functions are bracketed and found, and positions along a track convert to leader travel and back."""
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search import near_misses
from dragon_ros.core.search.near_misses import _bracketed, _dips, _gone_at, _grids, _lowest, _spans
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.search.swept_area import _reaches_m
from dragon_ros.core.tracks.spec import Arc, Composite, Line

SPAN = st.tuples(st.integers(0, 20), st.integers(0, 20))


@given(st.lists(SPAN, max_size=8))
def test_merged_spans_cover_the_same_numbers_and_are_apart(ends):
    found = _spans([(float(a), float(b)) for a, b in ends])
    inside = {n / 2 for a, b in ends for n in range(2 * min(a, b), 2 * max(a, b) + 1)}
    assert {n / 2 for n in range(41) if any(low <= n / 2 <= high for low, high in found)} == inside
    assert all(one[1] < two[0] for one, two in pairwise(found))


@given(st.floats(-5, 5), st.floats(0, 30), st.floats(0.02, 3))
def test_grids_are_fine_enough_and_share_two_positions(low, length, step):
    parts = [*_grids(low, low + length, step)]
    assert all(3 <= part.size <= near_misses._AT_ONCE for part in parts)
    assert all(np.array_equal(one[-2:], two[:2]) for one, two in pairwise(parts))
    whole = np.concatenate([parts[0], *(part[2:] for part in parts[1:])])
    assert (whole[0], whole[-1]) == (low, low + length)
    assert np.max(np.diff(whole)) <= step * (1 + 1e-9) + 1e-12
    assert whole.size <= max(3, 3 + length / step)


@given(st.lists(st.tuples(st.floats(0.3, 1.7), st.floats(0.01, 0.3), st.floats(0.5, 1.9)), min_size=1, max_size=4),
       st.floats(0.05, 0.3))
def test_every_dip_below_the_threshold_is_bracketed_and_found_and_no_other(valleys, below_m):
    """The gaps of pair n are ``least + slope |x - bottom|``, whose minimum is known."""
    bottom, least, slope = (np.array(one) for one in zip(*valleys, strict=True))
    places = np.linspace(0, 2, 64)
    spacing = places[1]
    pairs = np.stack((np.zeros(bottom.size, np.int64), 2 + np.arange(bottom.size)), axis=1)

    def gaps_at(x, own):
        n = own[..., 1] - 2
        return least[n] + slope[n] * np.abs(x[:, None] - bottom[n])
    gap_m = least + slope * np.abs(places[:, None] - bottom)
    found, left, right = _bracketed(places, pairs, gap_m, below_m)
    for n in range(bottom.size):
        mine = found[:, 1] == 2 + n
        if least[n] < below_m - 1e-9:
            assert np.any((left[mine] <= bottom[n]) & (bottom[n] <= right[mine]))
        assert np.all(right[mine] - left[mine] <= 2 * spacing + 1e-12)
    dips = _dips(gaps_at, [(found, left, right)], below_m)
    assert {dip.pair[1] - 2 for dip in dips} == {n for n in range(bottom.size) if least[n] < below_m}
    for dip in dips:
        n = dip.pair[1] - 2
        assert dip.place == pytest.approx(bottom[n], abs=1e-8)
        assert dip.gap_m == pytest.approx(least[n], abs=1e-7)


def test_gaps_that_stay_or_only_fall_have_no_dip():
    places = np.linspace(0, 1, 9)
    pairs = np.stack((np.zeros(3, np.int64), np.arange(2, 5)), axis=1)
    gap_m = np.stack((np.full(9, 0.01), places, 1 - places), axis=1)
    found, _, _ = _bracketed(places, pairs, gap_m, 0.1)
    assert found.size == 0


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(0, 0.04), st.floats(0, 1)), min_size=1, max_size=5))
def test_the_lowest_place_of_a_parabola_is_found_to_what_floats_resolve(rows):
    left, length, share = (np.array(one) for one in zip(*rows, strict=True))
    bottom = left + share * length
    place, value = _lowest(lambda x: 1 + (x - bottom)**2, left, left + length)
    assert place == pytest.approx(bottom, abs=3e-8)
    assert value == pytest.approx(np.ones(bottom.size), abs=1e-15)


@pytest.mark.parametrize('speed', [1.0, -0.7])
@pytest.mark.parametrize('track', [Scene().track, Composite((Line(30.0), Arc(4.0, 200.0), Line(30.0)), start_m=30.0)])
def test_where_a_bench_is_at_a_distance_along_the_track_the_leader_is_found_in_few_steps(monkeypatch, track, speed):
    run = Run(10, 15) if speed > 0 else Run(0, 5)
    scene = Scene(Dragon(9), track, Head(speed), run=run)
    travel = RangeOfTravel(scene.head, scene.run.start_s, compile_scene(scene).end.t_s)
    domain = SearchDomain(scene, travel, travel.senses[0], lambda states: None)
    ends = domain.start_m, domain.stop_m
    gone = np.linspace(*ends, 7)[1:-1]
    bench = np.array([0, 3, 8, 5, 1])
    along = np.array([domain.along_m(one)[number] for one, number in zip(gone.tolist(), bench.tolist(), strict=True)])
    asked, chains = [], domain.chains
    monkeypatch.setattr(domain, 'chains', lambda gone_m: asked.append(gone_m) or chains(gone_m))
    assert _gone_at(domain, bench, along, ends) == pytest.approx(gone, abs=1e-8)
    assert len(asked) <= 5
    assert _gone_at(domain, bench[:0], along[:0], ends).size == 0
    before, after = (np.array([domain.along_m(end)[3]]) for end in ends)
    outside = 2 * before - after, 2 * after - before
    assert [_gone_at(domain, bench[1:2], one, ends)[0] for one in outside] == pytest.approx([*ends], abs=1e-8)


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0, 6.3), st.floats(0.1, 3), st.floats(0.1, 3))
def test_a_polygon_reaches_as_far_along_a_normal_as_its_sides_that_cross_it(x, y, turn, left, right):
    import shapely
    normal = np.exp(1j * turn)
    corners = [(x + 1j * y) + (a + 1j * b) * normal for a, b in ((-right, -1), (left, -1), (left, 1), (-right, 1))]
    polygon = shapely.Polygon([(one.real, one.imag) for one in corners])
    found = _reaches_m([polygon], x + 1j * y, 2.5 * normal)
    assert found == pytest.approx((min(left, 2.5), min(right, 2.5)), abs=1e-9)
    assert _reaches_m([], x + 1j * y, normal) == (0.0, 0.0)
