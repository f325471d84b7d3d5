"""Dips of known functions are bracketed and found."""
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dragon_ros.core.search import near_misses
from dragon_ros.core.search.near_misses import _bracketed, _dips, _grids, lowest
from dragon_ros.core.search.swept_area import _reaches_m


@given(st.floats(-5, 5), st.floats(0, 300))
def test_grids_are_fine_enough_and_share_two_positions(low, length):
    parts, step = [part for group in _grids(low, low + length) for part in group], near_misses._SPACING_M
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
    low, high = ({n for n in range(bottom.size) if least[n] < below_m + error_m} for error_m in (-1e-12, 1e-12))
    assert low <= {dip.pair[1] - 2 for dip in dips} <= high
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
    place, value = lowest(lambda x: 1 + (x - bottom)**2, left, left + length)
    assert place == pytest.approx(bottom, abs=3e-8)
    assert value == pytest.approx(np.ones(bottom.size), abs=1e-15)


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0, 6.3), st.floats(0.1, 3), st.floats(0.1, 3))
def test_a_polygon_reaches_as_far_along_a_normal_as_its_sides_that_cross_it(x, y, turn, left, right):
    import shapely
    normal = np.exp(1j * turn)
    corners = [(x + 1j * y) + (a + 1j * b) * normal for a, b in ((-right, -1), (left, -1), (left, 1), (-right, 1))]
    polygon = shapely.Polygon([(one.real, one.imag) for one in corners])
    found = _reaches_m([polygon], x + 1j * y, 2.5 * normal)
    assert found == pytest.approx((min(left, 2.5), min(right, 2.5)), abs=1e-9)
    assert _reaches_m([], x + 1j * y, normal) == (0.0, 0.0)
