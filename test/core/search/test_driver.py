"""For gaps that are known functions of position, the loop of all searches clears valid rows and stops correctly."""
from dataclasses import dataclass
from math import ceil, inf, log2

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.search import driver
from dragon_ros.core.search.driver import Boxes, InOrder, Judgement, clear, divisible, parts_for, run

TOLERANCE_M = 0.01


@dataclass(frozen=True)
class Places:
    """Samples that consist of positions and gaps."""

    places: np.ndarray
    gap_m: np.ndarray

    def rows(self, index):
        return Places(self.places[index], self.gap_m[index])


APART_M = 128.0     # distance between windows


class Valleys:
    """A space in which the gap of window n is the smallest of a few valleys ``depth + slope |x - bottom|``.

    The positions of window n are within half of ``APART_M`` of n ``APART_M``.
    """

    tolerance_m = TOLERANCE_M

    def __init__(self, valleys, steepest=3.0):
        self.valleys, self.steepest, self.seen, self.roots = valleys, steepest, [], None

    def gap_m(self, places):
        return np.array([min(depth + slope * abs(x - bottom) for bottom, depth, slope in self.valleys[
            round(x / APART_M)]) for x in np.ravel(places).tolist()])

    def sample(self, places):
        self.seen += places.tolist()
        return Places(places, self.gap_m(places))

    def joined(self, parts):
        rows = [(part.places, part.gap_m) for part in parts]
        return Places(*(np.concatenate(one) for one in zip(*rows, strict=True)))

    def begin(self, samples, pairs):
        self.roots = [samples.places[row] for row in pairs]

    def judge(self, a, b, group):
        """Bound the gap by the steepest slope, rounded downwards.

        Check that each interval is part of the root interval of its group.
        """
        low, high = self.roots
        for one in (a.places, b.places):
            assert np.all((one - low[group]) * (one - high[group]) <= 0)
        length = np.abs(b.places - a.places)
        bound = 0.5 * (a.gap_m + b.gap_m - self.steepest * length) - 1e-13
        room = np.minimum(a.gap_m, b.gap_m) / (self.steepest * np.maximum(length, 1e-300))
        return Judgement(bound, np.stack((a.gap_m <= 0, b.gap_m <= 0)), parts_for(room), group)


def first_stop(space, window, n):
    """Return the progress to the first position whose gap does not exceed the tolerance, or inf if there is none."""
    sign = 1.0 if window[-1] >= window[0] else -1.0
    begin, end = sign * window[0], sign * window[-1]
    found = [inf]
    for bottom, depth, slope in space.valleys[n]:
        if depth <= TOLERANCE_M:
            reach = (TOLERANCE_M - depth) / slope
            if sign * bottom + reach >= begin and sign * bottom - reach <= end:
                found.append(max(begin, sign * bottom - reach))
    return min(found)


VALLEY = st.tuples(st.floats(-5, 15), st.one_of(st.floats(-1, 1), st.sampled_from([0.0, TOLERANCE_M])),
                   st.floats(0.1, 3))
ENDS = st.lists(st.floats(0, 10).map(lambda x: round(x, 3)), min_size=2, max_size=5, unique=True).map(sorted)
WINDOW = st.tuples(ENDS, st.booleans(), st.lists(VALLEY, min_size=1, max_size=3))


def cleared(drawn, finest):
    windows = [n * APART_M + np.array(places[::-1] if back else places) for n, (places, back, _) in enumerate(drawn)]
    space = Valleys([[(n * APART_M + bottom, depth, slope) for bottom, depth, slope in valleys]
                     for n, (_, _, valleys) in enumerate(drawn)])
    return space, windows, clear(space, windows, finest)


def check_rows(space, windows, found):
    """Check that a window's rows adjoin, have valid bounds, and end at a bracket that starts no later than the stop."""
    for n, (window, one) in enumerate(zip(windows, found, strict=True)):
        sign, at = (1.0 if window[-1] >= window[0] else -1.0), window[0]
        for start, stop, bound in one.rows:
            assert start == at
            x = np.linspace(start, stop, 9)
            assert TOLERANCE_M < bound <= np.min(space.gap_m(x)) + 1e-12
            at = stop
        assert at == (one.hit[0] if one.hit else window[-1])
        if one.hit:
            assert sign * one.hit[0] <= min(first_stop(space, window, n), sign * one.hit[1])
            assert one.hit[2] <= TOLERANCE_M
            assert one.touching == (space.gap_m([one.hit[1]])[0] <= 0)
        else:
            assert not one.touching


@examples(50, long=100)
@example([([0.0, 1.0], False, [(0.0, TOLERANCE_M, 3.0)])])      # the gap at the start equals the tolerance
@given(st.lists(WINDOW, min_size=1, max_size=4))
def test_windows_are_cleared_without_holes_up_to_the_first_gap_below_the_tolerance(drawn):
    space, windows, found = cleared(drawn, (1e-3,))
    for one in found:
        assert not one.hit or one.touching or abs(one.hit[1] - one.hit[0]) <= 1e-3
    for n, (window, one) in enumerate(zip(windows, found, strict=True)):
        if not one.hit:
            assert first_stop(space, window, n) == inf
    check_rows(space, windows, found)


@examples(50, long=100)
@given(st.lists(WINDOW, min_size=1, max_size=3))
def test_with_a_finer_length_a_window_that_does_not_touch_is_cleared_further(drawn):
    space, windows, coarse = cleared(drawn, (0.5,))
    again = Valleys(space.valleys)
    fine = clear(again, windows, (0.5, 1e-4))
    check_rows(again, windows, fine)
    for window, one, other in zip(windows, coarse, fine, strict=True):
        sign = 1.0 if window[-1] >= window[0] else -1.0
        if one.hit is None or one.touching:
            assert (one.hit, one.rows) == (other.hit, other.rows)
        else:
            assert other.rows[:len(one.rows)] == one.rows
            if other.hit:
                assert sign * other.hit[0] >= sign * one.hit[0]
                assert other.touching or abs(other.hit[1] - other.hit[0]) <= 1e-4


@examples(50, long=100)
@given(st.lists(WINDOW, min_size=1, max_size=4), st.integers(1, 3))
def test_what_is_cleared_does_not_depend_on_how_many_intervals_are_judged_together(drawn, at_once):
    _, _, expected = cleared(drawn, (1e-3,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver._Clearing, 'at_once', at_once)
        space, windows, found = cleared(drawn, (1e-3,))
    check_rows(space, windows, found)
    for one, other in zip(expected, found, strict=True):
        assert (one.rows, one.hit, one.touching) == (other.rows, other.hit, other.touching)


@pytest.mark.parametrize('back', [False, True])
@pytest.mark.parametrize('finest', [1e-2, 1e-6])
def test_a_touch_takes_no_more_rounds_than_halvings_and_no_position_is_sampled_twice(finest, back):
    space, window = Valleys([[(4.7, -0.1, 3.0)]]), np.array([0.0, 10.0])
    space.tolerance_m = 1e-12
    (found,) = clear(space, [window[::-1] if back else window], (finest,))
    assert len(space.seen) == len({*space.seen})
    assert len(space.seen) <= 2 + 2 * ceil(log2(10 / finest))
    assert found.hit
    assert found.rows


def test_an_interval_that_touches_at_its_start_has_a_hit_without_length():
    (found,) = clear(Valleys([[(0.0, -0.2, 1.0)]]), [np.array([0.0, 1.0, 2.0])], (1e-3,))
    assert (found.rows, found.touching) == ([], True)
    assert found.hit[:2] == (0.0, 0.0)


def test_floats_without_another_between_them_are_not_cut():
    low = 1.0
    high = np.nextafter(low, 2)
    (found,) = clear(Valleys([[(low, 0.005, 1.0)]]), [np.array([low, high])], (0.0,))
    assert found.hit[:2] == (low, high)
    two = np.nextafter(high, 2)
    (found,) = clear(Valleys([[(low, 0.005, 1.0)]]), [np.array([low, two])], (0.0,))
    assert found.hit[:2] == (low, high)


@given(st.floats(0, 2))
def test_the_number_of_parts_is_such_that_each_fits_nine_tenths_of_the_room(room):
    (parts,) = parts_for(np.array([room])).tolist()
    assert 2 <= parts <= 3
    assert parts == 3 or 1 / parts <= 0.9 * room + 1e-12
    assert parts == 2 or 1 / (parts - 1) > 0.9 * room - 1e-12


@pytest.mark.parametrize('scale', [1e-9, 1.0, 1e6])
def test_intervals_are_divisible_down_to_rounding_of_their_ends(scale):
    length = 1e-14 * (1 + scale)
    starts = np.array([-scale, scale, 0.0])
    for factor, expected in ((1.2, True), (0.8, False)):
        ends = starts[:2] + np.array([-1.0, 1.0]) * factor * length
        step = np.spacing(scale)
        if length > 8 * step:
            assert divisible(starts[:2], ends).tolist() == [expected] * 2
            assert divisible(ends, starts[:2]).tolist() == [expected] * 2
    assert divisible(np.array([0.0]), np.array([1.1e-14])).tolist() == [True]
    assert divisible(np.array([0.0]), np.array([0.9e-14])).tolist() == [False]


class Highest(InOrder):
    """A search that looks for the largest value of a known function and records the cells that it judges."""

    def __init__(self, at_once):
        self.at_once, self.judged, self.best = at_once, [], -inf

    def judge(self, cells):
        assert 0 < cells.size <= self.at_once
        assert np.all(np.diff(cells.low[0]) >= 0)
        self.judged += cells.low[0].tolist()
        self.best = max(self.best, float(np.max(cells.low)))
        return cells.some(cells.high[0] - cells.low[0] > 0.3).cut(2)


@pytest.mark.parametrize('at_once', [1, 2, 3, 100])
def test_every_cell_is_judged_once_in_batches_in_the_order_of_the_search(at_once):
    search = Highest(at_once)
    ends = np.linspace(0, 4, 5)
    run(search, Boxes(ends[None, :-1], ends[None, 1:]))
    assert sorted(search.judged) == sorted([*np.arange(4.0), *np.arange(0, 4, 0.5), *np.arange(0, 4, 0.25)])
    assert search.best == 3.75
