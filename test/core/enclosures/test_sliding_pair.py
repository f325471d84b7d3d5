"""The gap between two benches that slide along a spiral is enclosed: no sample in a box contradicts the bounds."""
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.enclosures.sliding_pair import (
    AHEAD,
    LINK,
    OTHER,
    SCALE,
    THETA,
    largest_span,
    least_span,
    separations,
)
from dragon_ros.core.tracks.spiral import chord_of, first_guess, step

HALF_WIDTH_M, OVERHANG_M = 0.15, 0.275
shares = st.floats(0, 1)
sizes = st.sampled_from([1e-3, 1e-2, 0.1])


def box_of(theta, ahead, size, width):
    """Return the lower and upper limits of a box around a pair of classic benches (both of shape (5, 1))."""
    middle = np.array([theta, ahead, 11.42, 2.86, 1.65])
    wide = np.array([size * width[0], 0.1 * size * width[1], 0.02 * width[2], 0.005 * width[3], 0.005 * width[4]])
    return (middle - wide)[:, None], (middle + wide)[:, None]


def bench(theta, angle, chord, scale):
    """Return the rectangle of a bench in units of b, computed directly."""
    delta = step(theta, chord, first_guess(theta, chord))[0]
    front, rear = theta * np.exp(1j * angle), (theta + delta) * np.exp(1j * (angle + delta))
    u = (front - rear) / abs(front - rear)
    half, over = HALF_WIDTH_M * scale, OVERHANG_M * scale
    corners = [front + u * (over + 1j * half), front + u * (over - 1j * half), rear - u * (over + 1j * half),
               rear - u * (over - 1j * half)]
    return shapely.Polygon([(one.real, one.imag) for one in corners])


def distance(point):
    theta, ahead, scale, link, other = point
    return bench(theta, 0.0, scale * link, scale).distance(bench(theta + ahead, ahead, scale * other, scale))


@given(theta=st.floats(25, 100), ahead=st.floats(5.8, 6.8), size=sizes, width=st.tuples(*[shares] * 5),
       seed=st.integers(0, 2**32 - 1))
@examples(50, long=100)
def test_no_pair_in_a_box_is_nearer_than_its_bound(theta, ahead, size, width, seed):
    low, high = box_of(theta, ahead, size, width)
    found = separations(low, high, HALF_WIDTH_M, OVERHANG_M)
    draw = np.random.default_rng(seed)
    for share in (*draw.random((5, 5)), *draw.integers(0, 2, (5, 5))):
        assert distance(low[:, 0] + share * (high - low)[:, 0]) >= found.low[0] - 1e-9


@given(theta=st.floats(25, 100), ahead=st.floats(5.8, 6.8))
@examples(50)
def test_the_bound_of_a_point_is_the_separation_by_its_best_edge(theta, ahead):
    low, high = box_of(theta, ahead, 0.0, np.zeros(5))
    found = separations(low, high, HALF_WIDTH_M, OVERHANG_M)
    assert 0 <= found.middle[0] - found.low[0] < 1e-6
    away = distance(low[:, 0])
    assert found.middle[0] <= away + 1e-9
    if found.middle[0] < 0:
        assert away < 1e-9


@pytest.mark.parametrize('ahead', [6.05, 6.15, 6.25])
@pytest.mark.parametrize('theta', [26.0, 45.0, 99.0])
def test_where_a_corner_faces_an_edge_the_bound_of_a_point_is_the_distance(theta, ahead):
    low, high = box_of(theta, ahead, 0.0, np.zeros(5))
    found = separations(low, high, HALF_WIDTH_M, OVERHANG_M)
    assert found.middle[0] == pytest.approx(distance(low[:, 0]), abs=1e-9)
    assert found.low[0] == pytest.approx(found.middle[0], abs=1e-6)


@pytest.mark.parametrize(('width', 'factor'), [(np.array([1.0, 1.0, 0.05, 0.05, 0.05]), 1.15), (np.ones(5), 1.5)])
def test_in_a_small_box_half_of_the_bounds_are_within_a_stated_factor_of_what_the_slopes_say(width, factor):
    draw = np.random.default_rng(1)
    boxes = [box_of(*place, 1e-3, width) for place in draw.uniform((25, 6.1), (100, 6.5), (200, 2))]
    low, high = (np.hstack(ends) for ends in zip(*boxes, strict=True))
    found = separations(low, high, HALF_WIDTH_M, OVERHANG_M)
    linear = np.abs(found.slope) * (high - low) / 2
    assert np.all(np.median(found.spread / linear, axis=1) <= factor)
    assert np.median((found.middle - found.low) / np.sum(linear, axis=0)) <= factor


@given(theta=st.floats(25, 100), ahead=st.floats(5.9, 6.6), row=st.sampled_from([THETA, AHEAD, SCALE, LINK, OTHER]))
@examples(50)
def test_slopes_are_those_of_differences_and_spreads_hold_them(theta, ahead, row):
    low, high = box_of(theta, ahead, 1e-3, np.ones(5))
    found = separations(low, high, HALF_WIDTH_M, OVERHANG_M)
    middle, small = 0.5 * (low + high), 1e-7 * np.eye(5)[row][:, None]
    one, other = (separations(place, place, HALF_WIDTH_M, OVERHANG_M) for place in (middle - small, middle + small))
    if abs(one.middle[0] - other.middle[0]) < 1e-3:     # the best edge does not change
        slope = (other.middle[0] - one.middle[0]) / 2e-7
        reach = (high - low)[row, 0] / 2
        assert abs(slope) * reach <= found.spread[row, 0] * (1 + 1e-3) + 1e-7
        assert abs(slope - found.slope[row, 0]) * reach <= found.spread[row, 0] * 0.5 + 1e-6


@given(theta=st.floats(18, 300), chord=st.floats(1, 30))
@examples(100)
def test_spans_are_between_their_bounds_which_are_near(theta, chord):
    one, length = np.array([theta]), np.array([chord])
    low, high = least_span(one, length)[0], largest_span(one, length)[0]
    assert chord_of(theta, low) < chord < chord_of(theta, high)
    assert high - low < 1e-8 * high
