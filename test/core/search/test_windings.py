"""Windings of any pitch agree with the march, and bounds derived from a cell's corners hold inside the cell."""
from types import SimpleNamespace

import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.chain.chain import marched
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.enclosures.ball_arithmetic import between
from dragon_ros.core.enclosures.by_scale import bend_by_scale
from dragon_ros.core.enclosures.layers import Layers
from dragon_ros.core.enclosures.on_spiral import bend
from dragon_ros.core.errors import DragonError, FieldError
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.search.driver import Boxes
from dragon_ros.core.search.min_pitch import (
    _body_is_apart,
    _Descending,
    _PitchTask,
    _task,
    min_pitch,
    separations,
    windings,
)
from dragon_ros.core.tracks.composite import Place, track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Spiral

COUNT = 40
DRAGONS = [Dragon(), Dragon(benches=60, width_m=0.4, head_length_m=1.0), Dragon(head_length_m=6.0)]
MIXED = Mixed((Group(3.4), *(Group(length) for length in np.random.default_rng(5).uniform(0.7, 3.0, 60).tolist())))


def winding(radius_m, scale, dragon=DRAGONS[0], first=0):
    return windings(dragon, first, COUNT, np.asarray(radius_m), np.asarray(scale))


def descending(first, dragon=DRAGONS[0]):
    return _Descending(_PitchTask(dragon, 4.5, 16.0, 1.0, 1e-9), first, 0.3, lambda states: None)


def bounds(radii, scales, dragon, first):
    """Return bounds on the second derivatives with respect to radius and to scale in a cell, in units of b."""
    (low, high), (small, large) = radii, scales
    ends = winding([low, low, high, high], [small, large, small, large], dragon, first)
    theta, delta = between(ends.theta[:1], ends.theta[3:]), between(ends.delta[1:2], ends.delta[2:3])
    link = dragon.link_lengths_m[None, first:first + COUNT]
    chord = between(small * link, large * link)
    arm = large * 0.5 * np.hypot(dragon.bench_lengths_m[None, first:first + COUNT], dragon.width_m)
    return bend(theta, delta, chord, arm)[0] * large**2, bend_by_scale(theta, delta, chord, arm)[0] / small**2


def corners(radius_m, scale, dragon, first):
    """Return the corners of benches 2 onwards in the leading bench's frame, and of that bench in their frames."""
    chain, scale = winding(radius_m, scale, dragon, first), np.broadcast_to(scale, np.shape(radius_m))
    middle, axis = chain.centre, chain.axis
    half = 0.5 * dragon.bench_lengths_m[first:first + COUNT] * scale[:, None]
    side = 0.5 * dragon.width_m * scale[:, None, None] * [1j, 1j, -1j, -1j]
    corner = middle[..., None] + axis[..., None] * (half[..., None] * [1, -1, -1, 1] + side)
    return np.stack(((corner[:, 2:] - middle[:, :1, None]) / axis[:, :1, None],
                     (corner[:, :1] - middle[:, 2:, None]) / axis[:, 2:, None]), axis=2)


def second_differences(radius_m, scale, dragon, first):
    """Return the largest second derivatives of corners with respect to radius and to scale at one position."""
    h, k = 3e-3, 3e-4 * scale
    found = corners(radius_m + h * np.array([-1, 0, 1, 0, 0]), scale + k * np.array([0.0, 0, 0, -1, 1]), dragon, first)
    return (np.max(np.abs(found[0] - 2 * found[1] + found[2]), axis=-1) / h**2,
            np.max(np.abs(found[3] - 2 * found[1] + found[4]), axis=-1) / k**2)


def test_a_winding_is_the_chain_that_the_march_places():
    radius_m, scale = np.array([4.6, 9.0]), 2 * np.pi / np.array([0.451, 0.7])
    found = winding(radius_m, scale)
    for r, s, middle in zip(radius_m, scale, found.centre, strict=True):
        spiral = Spiral(2 * np.pi / s)
        head = Place(0, DoubleDouble(s * r, 0.0))
        chain = marched(track_of(spiral), Dragon().link_lengths_m[:COUNT], head, BEHIND)
        assert middle / s == pytest.approx(0.5 * (chain.p[1:] + chain.p[:-1]) @ [1, 1j], abs=1e-11)


@pytest.mark.parametrize('dragon', thinned([*DRAGONS, MIXED], (DRAGONS[0], MIXED).__contains__))
@pytest.mark.parametrize('first', [0, 1])
@pytest.mark.parametrize(('wide', 'tall'), thinned([(1e-4, 1e-4), (0.1, 0.01), (0.4, 0.05)],
                                                   lambda case: case[0] == 0.4))
def test_no_corner_bends_more_than_the_bounds_anywhere_in_a_cell(dragon, first, wide, tall):
    rng = np.random.default_rng(6)
    for pitch, radius in zip(rng.uniform(0.3, 1.0, 8), rng.uniform(3.5, 12.0, 8), strict=True):
        scale = 2 * np.pi / pitch
        by_radius, by_scale = bounds((radius, radius + wide), (scale, scale * (1 + tall)), dragon, first)
        for u, v in rng.uniform(0, 1, (6, 2)):
            true = second_differences(radius + u * wide, scale * (1 + v * tall), dragon, first)
            assert np.all(true[0] <= by_radius * (1 + 1e-3) + 1e-3)
            assert np.all(true[1] <= by_scale * (1 + 1e-3) + 1e-3)


@pytest.mark.parametrize(('pitch', 'radius', 'factor'), [(0.451, 4.6, 2.0), (0.9, 4.5, 1.5)])
def test_in_a_small_cell_the_largest_bounds_are_within_a_stated_factor_of_the_true_ones(pitch, radius, factor):
    scale = 2 * np.pi / pitch
    most = bounds((radius, radius + 1e-4), (scale, scale * (1 + 1e-4)), Dragon(), 0)
    true = second_differences(radius, scale, Dragon(), 0)
    assert np.max(most[0]) < 1.2 * np.max(true[0])
    assert np.max(most[1]) < factor * np.max(true[1])


@pytest.mark.parametrize('first', [0, 1])
@pytest.mark.parametrize(('pitch', 'radius'), [(0.451, 4.6), (0.9, 4.5)])
def test_of_benches_so_wide_that_their_turning_is_all_the_bounds_are_within_a_twentieth(pitch, radius, first):
    scale, wide = 2 * np.pi / pitch, Dragon(60, 3.0, 2.2, 50.0)
    most = bounds((radius, radius + 1e-4), (scale, scale * (1 + 1e-4)), wide, first)
    for bound, true in zip(most, second_differences(radius, scale, wide, first), strict=True):
        assert np.all(true <= bound)
        assert np.median(bound / true) < 1.05


@pytest.mark.parametrize(('dragon', 'first'), thinned(
    [(dragon, first) for dragon in (DRAGONS[0], MIXED) for first in (0, 1)],
    [(DRAGONS[0], 0), (MIXED, 1)].__contains__))
def test_in_a_cell_angles_lie_in_their_enclosures_and_reach_both_ends(first, dragon):
    rng, search = np.random.default_rng(7), descending(first, dragon)
    for pitch, radius in zip(rng.uniform(0.3, 1.0, 40), rng.uniform(3.0, 12.0, 40), strict=True):
        scale = 2 * np.pi / pitch
        u, v = (np.append(row, rng.uniform(0, 1, 30)) for row in ([0.0, 0, 1, 1], [0.0, 1, 0, 1]))
        seen = winding(radius + 0.4 * u, scale * (1 + 0.05 * v), dragon, first)
        for ball, values in zip(search._angles(seen, np.arange(4)[:, None], np.array([[1.05 * scale]])),
                                (seen.theta, seen.delta), strict=True):
            assert np.all(np.abs(values - ball.mid) <= ball.rad)
            assert np.all(2 * ball.rad <= 1.001 * np.ptp(values, axis=0))


@pytest.mark.parametrize(('dragon', 'first'), thinned(
    [(dragon, first) for dragon in (DRAGONS[0], MIXED) for first in (0, 1)],
    [(DRAGONS[0], 0), (MIXED, 1)].__contains__))
def test_inside_a_cell_no_separation_sags_below_what_its_corners_say(first, dragon):
    rng = np.random.default_rng(6)
    for pitch, radius in zip(rng.uniform(0.3, 1.0, 40), rng.uniform(3.0, 12.0, 40), strict=True):
        scale = 2 * np.pi / pitch
        wide, tall = 0.3, 0.03 * scale
        u, v = (np.append(row, rng.uniform(0, 1, 30)) for row in ([0.0, 0, 1, 1], [0.0, 1, 0, 1]))
        scales = scale + v * tall
        apart = separations(dragon, first, winding(radius + u * wide, scales, dragon, first), scales)
        by_radius, by_scale = bounds((radius, radius + wide), (scale, scale + tall), dragon, first)
        sag = (by_radius * wide**2 + by_scale * tall**2) / 8
        low = np.min(apart[:4], axis=0) - sag[:, [0, 0, 0, 0, 1, 1, 1, 1]]
        assert np.min(apart[4:] - low) > -1e-12


@pytest.mark.parametrize('dragon', [*DRAGONS, Dragon(benches=12), Dragon(30, 1.2, 2.2)])
@pytest.mark.parametrize('first', [0, 1])
def test_front_handles_are_between_the_least_and_the_greatest_radius_which_are_within_a_fiftieth(dragon, first):
    for pitch_m in (0.43, 0.7, 1.0):
        task = _PitchTask(dragon, 4.5, 16.0, 1.0, 1e-9)
        b_m, placed = pitch_m / (2 * np.pi), []
        for radius_m in (4.5, 16.0 * pitch_m):
            head = Place(0, DoubleDouble(radius_m / b_m, 0.0))
            chain = marched(track_of(Spiral(pitch_m, 16.0)), dragon.link_lengths_m, head, BEHIND)
            placed.append(chain.u * b_m)
        inner, outer = placed[0][first], placed[1][-2 if first else 0]
        assert task.innermost_m(pitch_m, first) - 1e-12 <= inner <= 1.02 * task.innermost_m(pitch_m, first)
        assert outer <= task.widest_m(pitch_m, first) + 1e-12 <= 1.02 * outer


@pytest.mark.parametrize('dragon', [Dragon(3), Dragon(20), Dragon(3, 3.41, 3.41)])
@pytest.mark.parametrize('radius_m', [1.6, 2.0, 4.5])
def test_where_the_head_starts_on_the_circle_no_handle_is_further_out_than_told_and_one_nearly_so_far(dragon, radius_m):
    pitch_m = radius_m / 4.0
    head = Place(0, DoubleDouble(8 * np.pi, 0.0))
    chain = marched(track_of(Spiral(pitch_m, 4.0)), dragon.link_lengths_m, head, BEHIND)
    grown = (chain.u[-1] * pitch_m / (2 * np.pi)) ** 2 - radius_m**2
    told = _PitchTask(dragon, radius_m, 4.0, 1.0, 1e-9).widest_m(pitch_m, 1) ** 2 - radius_m**2
    assert grown <= told <= 1.2 * grown


@pytest.mark.parametrize('first', [0, 1])
@pytest.mark.parametrize('pitch', [0.451, 0.7])
def test_the_sag_of_a_cell_is_that_of_second_derivatives_by_radius_and_by_scale(first, pitch):
    search = descending(first)
    scale, wide, tall = 2 * np.pi / pitch, 2e-3, 2e-4
    cell = np.array([[4.6], [4.6 + wide], [scale], [scale * (1 + tall)]])
    corner_cells = [cell[[i, j]] for i in (0, 1) for j in (2, 3)]
    placed = windings(Dragon(), first, COUNT, *np.concatenate(corner_cells, axis=1))
    sag = search._sags(cell, placed, np.arange(4)[:, None])[0]
    by_radius, by_scale = second_differences(4.6 + 0.5 * wide, scale * (1 + 0.5 * tall), Dragon(), first)
    for found, true, most in ((sag[..., 0], by_radius * wide**2 / 8, 1.3),
                              (sag[..., 1], by_scale * (scale * tall)**2 / 8, 2.4)):
        for part, side in ((found[:, :4], 0), (found[:, 4:], 1)):
            assert np.all(true[:, side, None] <= part * (1 + 1e-3) + 1e-12)
            assert np.max(part) <= most * np.max(true[:, side])


@pytest.mark.parametrize(('share', 'noted'), [(0.999, True), (1.001, False)])
def test_a_touch_of_the_head_counts_up_to_where_it_starts_and_not_beyond(share, noted):
    search, pitch_m = descending(0), 0.5
    search._note(np.array([[share * 16.0 * pitch_m], [2 * np.pi / pitch_m]]), np.full((1, 3, 8), -1.0))
    assert bool(search.touch) == noted


def test_a_search_that_is_given_up_names_the_largest_pitch_that_is_not_proved():
    search = descending(0)
    search._done = 1_000_000
    scales = 2 * np.pi / np.array([0.5, 0.75, 0.6])
    with pytest.raises(DragonError, match='below a pitch of 0.75 m'):
        search.judge(Boxes(np.stack((np.full(3, 5.0), scales)), np.stack((np.full(3, 6.0), 1.01 * scales))))


def test_a_box_whose_scales_are_two_adjacent_floats_is_cut_along_the_radius():
    search, scale = descending(0, Dragon(60, 3.41, 1.15)), 16.00752770419973
    low, high = np.array([[4.552372317759982], [scale]]), np.array([[4.552372324006788], [np.nextafter(scale, 17)]])
    parts = search.judge(Boxes(low, high))      # the gap of its closest pair hardly varies with the radius
    assert parts.size == 2
    assert np.all(parts.high[0] - parts.low[0] < 0.51 * (high - low)[0])


def test_long_windings_are_judged_in_smaller_numbers_until_shorter_ones_suffice():
    search = descending(1, Dragon(benches=20_000))
    assert search.at_once < 10
    search._windings(np.array([5.0]), np.array([2 * np.pi / 0.55]))
    assert search.at_once == 256
    short = descending(1, Dragon(20_000, 0.19, 0.19, 0.05, 0.02))
    short._windings(np.array([20.0]), np.array([2 * np.pi]))
    count = short._windings(np.array([20.0]), np.array([2 * np.pi])).delta.shape[1]
    assert 2**15 < short.at_once * count <= 2**16


def test_the_smallest_pitch_is_found_although_scales_come_down_to_two_adjacent_floats():
    found = min_pitch(Dragon(60, 3.41, 1.15))
    assert found.states < 40_000
    assert found.low_m == pytest.approx(0.392514410901, abs=1e-10)


@pytest.mark.parametrize(('longest_m', 'pitch_m'), thinned(
    [(2.2, 1.0), (5.0, 1.0), (2.2, 5.0)], lambda case: case[0] == 5))
@pytest.mark.parametrize('first', [0, 1])
def test_benches_further_behind_are_left_unexamined_only_if_they_keep_the_tolerance_and_hardly_more(first, longest_m,
                                                                                                    pitch_m):
    """The first bench that is not placed has the length ``longest_m``."""
    cell = np.array([[5.0], [5.1], [2 * np.pi / pitch_m], [2.02 * np.pi / pitch_m]])

    def spare(width_m):
        """Return how far these benches stay outside the leading bench, in tolerances, and whether it is accepted."""
        dragon = Mixed((Group(3.41), Group(2.2, 19 + first), Group(longest_m), Group(2.2, 40)), width_m)
        search, corners = descending(first, dragon), np.concatenate([cell[[i, j]] for i in (0, 1) for j in (2, 3)], 1)
        radii_m = windings(dragon, first, 20, *corners).theta / corners[1][:, None]
        reach_m = np.max(radii_m[:, 1]) + np.hypot(dragon.hole_inset_m, 0.5 * width_m)
        front_m, link_m = np.min(radii_m[:, -1]) - 2 * search._error_m, longest_m - 2 * dragon.hole_inset_m
        axis_m = np.sqrt(front_m**2 - max(link_m / 2, pitch_m / 4) ** 2)
        left = (axis_m - 0.5 * width_m - reach_m) / search._tolerance_m
        try:
            search._check_rest(cell, windings(dragon, first, 20, *corners), np.arange(4)[:, None])
        except DragonError:
            return left, False
        return left, True

    low, high = 0.01, 9.0
    while high - low > 1e-13:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if spare(middle)[1] else (low, middle)
    assert 0.99 <= spare(low)[0] <= 1.1


@pytest.mark.parametrize('dragon', thinned([Dragon(), MIXED], lambda dragon: dragon is MIXED))
@pytest.mark.parametrize('first', [0, 1])
def test_no_bench_that_is_not_placed_comes_near_the_leading_bench_anywhere_in_an_accepted_cell(first, dragon):
    rng, search, accepted = np.random.default_rng(8), descending(first, dragon), 0
    for pitch_m, radius_m in zip(rng.uniform(0.4, 1.0, 60), rng.uniform(3.5, 6.0, 60), strict=True):
        cell = np.array([[radius_m], [radius_m + 0.3], [2 * np.pi / pitch_m], [2.2 * np.pi / pitch_m]])
        corner_cells = np.concatenate([cell[[i, j]] for i in (0, 1) for j in (2, 3)], axis=1)
        count = int(rng.integers(20, 44))
        try:
            search._check_rest(cell, windings(dragon, first, count, *corner_cells), np.arange(4)[:, None])
        except DragonError:
            continue
        scales, inside = rng.uniform(*cell[2:, 0], 20), rng.uniform(*cell[:2, 0], 20)
        seen = separations(dragon, first, windings(dragon, first, count + 15, inside, scales), scales)
        assert np.all(np.max(seen, axis=-1)[:, count - 2:] > 0)
        accepted += 1
    assert accepted > 10


@pytest.mark.parametrize(('lengths_m', 'apart'), [
    ([2.2], True), ([4.6], False),              # bench 1 is longer than all benches behind it
    ([2.2] * 20 + [0.8, 2.2], False), ([2.2] * 20 + [0.8], True)])      # a short bench before the last, or as the last
def test_body_benches_are_apart_only_if_the_layers_of_each_of_them_are(lengths_m, apart):
    last = () if len(lengths_m) > 1 else (Group(2.2, 20),)
    dragon = Mixed((Group(3.41), *map(Group, lengths_m), *last))
    assert _body_is_apart(_task(dragon, 9.0, 20.0, 0.5, 1e-9), 0.45) == apart


def test_body_benches_are_apart_up_to_the_largest_pitch_at_which_their_layers_are_and_from_the_smallest_on():
    def apart(low_m, high_m):
        return _body_is_apart(_task(Dragon(30), 9.0, 1e4, high_m, 1e-9), low_m)

    def layers_are_apart(pitch_m):
        radius_m = _task(Dragon(30), 9.0, 1e4, 1.0, 1e-9).innermost_m(0.5, 1)
        return Layers(pitch_m / (2 * np.pi), Dragon(30)).gaps_from_m(np.array([radius_m]), np.array([1]))[0] > 0

    low, high = 0.5, 100.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if layers_are_apart(middle) else (low, middle)
    assert apart(0.5, 0.9 * low)
    assert not apart(0.5, 1.01 * low)
    smallest, large = 0.2, 0.5
    for _ in range(50):
        middle = 0.5 * (smallest + large)
        smallest, large = (smallest, middle) if apart(middle, 1.0) else (middle, large)
    assert layers_are_apart(large)
    assert not layers_are_apart(0.985 * large)      # a range of pitches gives away hardly more than one pitch


@pytest.mark.parametrize(('name', 'low', 'high'), [
    ('diameter_m', None, 1e6), ('start_turns', None, 1e4), ('largest_m', None, 1e6), ('within_m', 2e-11, 1.0)])
def test_a_setting_at_its_limit_is_accepted_and_the_next_one_beyond_is_refused(name, low, high):
    usual = {'diameter_m': 1e4, 'start_turns': 16.0, 'largest_m': 9e5, 'within_m': 1e-9}
    for value, beyond in ((low, -np.inf), (high, np.inf)):
        if value is not None:
            _task(Dragon(), **{**usual, name: value})
            with pytest.raises(FieldError, match=name):
                _task(Dragon(), **{**usual, name: float(np.nextafter(value, beyond))})


def test_the_error_of_an_angle_is_that_of_a_position_by_the_way_of_a_handle_for_a_radian():
    """A handle moves sqrt(1 + theta^2) / scale metres per radian; the root is replaced by the larger of theta and 1."""
    theta = np.linspace(0.0, 60.0, 241)
    error = _Descending._angle_errors(SimpleNamespace(_error_m=0.5e-9), theta, 3.0)
    exact = 3.0 * 1e-9 / np.hypot(1.0, theta)
    assert np.all(exact <= error)
    assert np.all(error <= 1.5 * exact)
