"""The errors of corners that follow from errors of handles, compared with the effect of displaced handles."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.geometry.rectangles import corner_levers

SMALL = 1e-6        # error of a handle relative to the link; the second-order remainder is below this fraction
TURNS = np.exp(1j * np.linspace(0, 2 * np.pi, 121))


def corner_errors(length_m, link_m, width_m, front, rear):
    """Return a bench's largest corner errors, given the errors of its handles at 0 (rear) and ``link_m`` (front)."""
    corners = np.array([1j * width_m + length_m, 1j * width_m - length_m]) / 2
    axis = link_m + front - rear
    moved = 0.5 * (link_m + front + rear)[..., None] + corners * (axis / np.abs(axis))[..., None]
    return np.max(np.abs(moved - (0.5 * link_m + corners)), axis=-1)


@examples(40)
@given(st.floats(1.0, 20.0), st.floats(0.01, 10.0), st.floats(1.0, 10.0))
def test_no_displacement_of_handles_moves_a_corner_further_than_its_lever(ratio, width_m, length_m):
    dragon = Dragon(1, length_m, length_m, width_m, 0.5 * (length_m - length_m / ratio))
    link_m = float(dragon.link_lengths_m[0])
    error_m = SMALL * link_m / ratio
    worst_m = np.max(corner_errors(length_m, link_m, width_m, error_m * TURNS[:, None], error_m * TURNS))
    lever = float(corner_levers(dragon)[0])
    assert 0.65 * lever * error_m < worst_m <= lever * error_m * (1 + 1e-4)


@pytest.mark.parametrize(('ratio', 'lever'), [(1.0, 2 / 3**0.5), (1.2, 1.25), (2**0.5, 2**0.5), (3.0, 3.0)])
def test_the_lever_of_a_narrow_bench_is_attained(ratio, lever):
    dragon = Dragon(1, 2.0, 2.0, 0.01, 0.5 * (2.0 - 2.0 / ratio))
    assert corner_levers(dragon)[0] == pytest.approx(lever, rel=1e-2)
    worst_m = np.max(corner_errors(2.0, 2.0 / ratio, 0.01, SMALL * TURNS[:, None], SMALL * TURNS))
    assert worst_m == pytest.approx(lever * SMALL, rel=1e-2)


def test_the_lever_of_a_wide_bench_is_its_width_over_its_link():
    dragon = Dragon(1, 2.0, 2.0, 100.0, 0.0)
    assert corner_levers(dragon)[0] == pytest.approx(2 / 3**0.5 + 50.0)
    worst_m = np.max(corner_errors(2.0, 2.0, 100.0, SMALL * TURNS[:, None], SMALL * TURNS))
    assert worst_m == pytest.approx(50.0 * SMALL, rel=0.03)
