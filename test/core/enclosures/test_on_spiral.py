"""The bound on second derivatives, and the bounds from which it is derived, hold on whole intervals."""
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.chain.chain import marched
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.lock import follower, lock_angle, turning_places
from dragon_ros.core.enclosures import on_spiral
from dragon_ros.core.enclosures.ball_arithmetic import Ball, between
from dragon_ros.core.enclosures.on_spiral import (
    BenchSampler,
    _some_pairs,
    _way,
    bend,
    beyond,
    bounds,
    further,
    levers,
)
from dragon_ros.core.errors import ChainLockError
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.tracks.composite import Place, track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Spiral

COUNT = 24


def placed(dragon, theta):
    head = Place(0, DoubleDouble(theta, 0.0))
    return marched(track_of(Spiral(2 * np.pi)), dragon.link_lengths_m, head, BEHIND)


def corners(dragon, theta):
    """Return the corners of benches 2 onwards in bench 0's frame, and vice versa, for a pitch of 2 pi."""
    chain = placed(dragon, theta)
    z = chain.p @ [1, 1j]
    angle = chain.u[:-1]
    along = np.where(chain.links_m > 0, z[:-1] - z[1:], -np.exp(1j * angle) * (1 + 1j * angle))
    axis = along / np.abs(along)
    half, side = 0.5 * dragon.bench_lengths_m, 0.5 * dragon.width_m
    middle = 0.5 * (z[1:] + z[:-1])
    corner = middle[:, None] + axis[:, None] * (half[:, None] * [1, -1, -1, 1] + 1j * side * np.array([1, 1, -1, -1]))
    return np.stack(((corner[2:] - middle[0]) / axis[0], (corner[0] - middle[2:, None]) / axis[2:, None]), axis=1)


def ends(dragon, *places):
    return [placed(dragon, theta) for theta in places]


def bound(dragon, start, stop):
    a, b = ends(dragon, start, stop)
    arm = np.hypot(0.5 * dragon.bench_lengths_m, 0.5 * dragon.width_m)
    chord = dragon.link_lengths_m[None]
    return bend(between(a.u[None], b.u[None]), between(np.diff(a.u)[None], np.diff(b.u)[None]), between(chord, chord),
                arm[None])[0]


def largest(dragon, start, stop, count=7):
    """Return the largest second differences of any corner (shape (benches, 2))."""
    h = 1e-3
    found = []
    for theta in np.linspace(start, stop, count):
        before, here, after = (corners(dragon, theta + k * h) for k in (-1, 0, 1))
        found.append(np.max(np.abs(before - 2 * here + after), axis=-1) / h**2)
    return np.max(found, axis=0)


@examples(50, long=100)
@given(st.just(0.05) | st.floats(0.5, 35), st.floats(3, 30), st.floats(1, 60), st.floats(0, 0.5), st.floats(0, 0.4))
def test_no_corner_bends_more_than_the_bound_anywhere_on_a_stretch(head, body, out, length, inset):
    dragon = Dragon(COUNT, head + 2 * inset, body + 2 * inset, 3.0, inset)
    start = max(lock_angle(dragon.head_link_m), lock_angle(float(dragon.link_lengths_m[-1]))) + out
    assume(not turning_places(dragon.link_lengths_m[:2].tolist(), start, start + length))
    true = largest(dragon, start, start + length)
    assert np.all(true <= bound(dragon, start, start + length) * (1 + 1e-4) + 1e-5)


@pytest.mark.parametrize('start', [20.0, 25.0, 40.0, 90.0])
@pytest.mark.parametrize('length', [0.01, 0.1, 0.3])
def test_the_bound_is_less_than_twice_what_the_classic_dragon_does(start, length):
    b_m = Spiral().b_m
    d = Dragon(40)
    dragon = Dragon(40, d.head_length_m / b_m, d.body_length_m / b_m, d.width_m / b_m, d.hole_inset_m / b_m)
    true = largest(dragon, start, start + length)
    most = bound(dragon, start, start + length)
    assert np.all(true <= most * (1 + 1e-4))
    assert np.all(most <= 2 * true)


def test_the_bound_is_infinite_at_a_lock_and_finite_where_the_second_handle_turns_back():
    dragon = Dragon(COUNT, 33.0, 20.0, 3.0, 0.0)
    lock = lock_angle(33.0)
    (turn,) = turning_places([33.0, 20.0], lock, 60.0)
    assert np.all(np.isinf(bound(dragon, lock * (1 + 1e-12), lock + 1e-3)))
    assert np.all(np.isfinite(bound(dragon, turn, turn + 1e-3)))
    assert np.all(np.isfinite(bound(dragon, turn - 1e-3, turn)))


@pytest.mark.parametrize('chord', thinned(
    [0.0, 1.0, 1.6, 1.9, 3.0, 4.6, 4.8, 5.0, 5.5, 5.75, 5.8, 6.0, 8.0, 10.0, 19.0, 32.7, 300.0],
    (0.0, 1.6, 4.6, 4.8, 5.75, 5.8, 300.0).__contains__))
def test_a_follower_turns_back_at_the_places_that_are_named_and_nowhere_else(chord):
    lock = lock_angle(chord) * (1 + 1e-12)
    turns = turning_places([chord, chord], lock, chord + 5)
    assert len(turns) == (0 if chord < 0.5 * np.pi else 2 if 1.5 * np.pi < chord < 5.78 else 1)
    for low, high in pairwise([lock, *turns, chord + 5]):
        steps = np.diff([follower(theta, chord) for theta in np.linspace(low, high, 400)])
        assert np.all(steps > -1e-12) or np.all(steps < 1e-12)
    assert all(follower(theta, chord) > max(turns, default=0) for theta in np.linspace(lock, chord + 5, 400)[1:])


def test_the_third_handle_turns_back_where_the_second_is_at_its_turning_place():
    (place_,) = turning_places([5.0, 19.0], 5.5, 40.0)
    assert follower(place_, 5.0) == pytest.approx(turning_places([19.0, 19.0], 7.9, 40.0)[0], abs=1e-12)


def sampler(dragon, first=1):
    return BenchSampler(track_of(Spiral()), dragon, (first,), dragon.benches - first, lambda states: None, 0.0)


@given(st.floats(0.6, 4), st.floats(10, 90), st.floats(0, 2))
def test_each_bench_is_further_beyond_the_circle_than_the_one_before_it(body, theta, length):
    watch = sampler(Dragon(COUNT, body, body, 0.3))
    try:
        view = watch.sample(np.array([theta, theta + length]))
    except ChainLockError:
        return
    a, b = view.rows(np.array([0])), view.rows(np.array([1]))
    outside = beyond(a, b, watch.sizes)[0]
    assert np.all(np.diff(outside) > 0)
    for part in np.linspace(0, 1, 5):
        inside = watch.sample(np.array([theta + part * length]))
        assert np.all(beyond(inside, inside, watch.sizes)[0] >= outside - 1e-12)


@pytest.mark.parametrize('stretch_rad', [0.0, 0.05])
@pytest.mark.parametrize('dragon', [Mixed((Group(3.0), Group(1.2, 9), Group(2.2, 6), Group(1.7, 4))),
                                    Mixed((Group(1.2, 3), Group(3.9), Group(1.0, 12)), 0.4)], ids=['a', 'b'])
def test_mixed_benches_and_all_behind_them_are_further_out_than_told_by_less_than_a_bench(dragon, stretch_rad):
    watch = BenchSampler(track_of(Spiral()), dragon, (0,), dragon.benches, lambda states: None, 0.0)
    for theta in (20.0, 45.0, 90.0):
        view = watch.sample(theta + np.linspace(0, stretch_rad, 5))
        a, b = view.rows(np.array([0])), view.rows(np.array([4]))
        told = further(a, b, watch.sizes.of(a.lead), beyond(a, b, watch.sizes.of(a.lead)))[0]
        outlines = [[outline(view, watch.sizes, row, bench) for bench in range(dragon.benches)] for row in range(5)]
        lead = max(np.max(np.abs(row[0])) for row in outlines)
        nearest = [min(np.min(np.abs(row[bench])) for row in outlines) for bench in range(2, dragon.benches)]
        true = np.minimum.accumulate(nearest[::-1])[::-1] - lead
        assert np.all(told <= true + 1e-12)
        assert np.all(true - told < 2.2)


def outline(view, sizes, row, bench):
    """Return points along the outline of a bench as complex numbers, in metres."""
    half, side = sizes.half_length_m[0, bench], sizes.half_width_m
    corner = half * np.array([1, -1, -1, 1]) + 1j * side * np.array([1, 1, -1, -1])
    share = np.linspace(0, 1, 40)[:, None]
    around = (corner + share * (np.roll(corner, -1) - corner)).ravel()
    return view.centre[row, bench] + view.axis[row, bench] * around


@pytest.mark.parametrize('first', [20.0, 40.0])
def test_of_some_pairs_the_bounds_are_those_of_all(first):
    b_m, classic = Spiral().b_m, Dragon(COUNT)
    size = Dragon(COUNT, classic.head_length_m / b_m, classic.body_length_m / b_m, classic.width_m / b_m,
                  classic.hole_inset_m / b_m)
    a, b = ends(size, first, first + 0.1)
    arm, chord = np.hypot(0.5 * size.bench_lengths_m, 0.5 * size.width_m)[None], size.link_lengths_m[None]
    balls = between(a.u[None], b.u[None]), between(np.diff(a.u)[None], np.diff(b.u)[None]), between(chord, chord)
    bench = np.array([2, 5, 17, COUNT - 1])
    some = bend(*balls, arm, _some_pairs(np.zeros(4, dtype=np.int64), bench))
    np.testing.assert_allclose(some, bend(*balls, arm)[0, bench - 2], rtol=1e-12)


def gone(dragon, moved):
    """Return the largest travel of a handle and of a corner of each bench if ``moved`` maps the points of the plane."""
    half, side, link = 0.5 * dragon.bench_lengths_m, 0.5 * dragon.width_m, dragon.link_lengths_m
    handle = 0.5 * link[:, None] * np.array([1, -1])
    corner = half[:, None] * np.array([1, -1, -1, 1]) + 1j * side * np.array([1, 1, -1, -1])
    return [np.max(np.abs(moved(each) - each), axis=1) for each in (handle, corner)]


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3.2, 3.2), st.floats(0.01, 0.5), st.floats(0.01, 0.4))
def test_no_corner_goes_further_than_a_handle_times_the_lever(x, y, turn_rad, width, inset):
    dragon = Dragon(4, 2.0, 1.0, width, inset)
    handle, corner = gone(dragon, lambda z: z * np.exp(1j * turn_rad) + complex(x, y))
    assert np.all(corner <= levers(sampler(dragon, 0).sizes) * handle + 1e-12)


def test_the_lever_is_not_a_hundredth_more_than_a_turn_about_the_middle_of_a_link_needs():
    dragon = Dragon(4, 2.0, 1.0, 1e-3, 0.3)
    handle, corner = gone(dragon, lambda z: 1j * z)
    assert np.all(levers(sampler(dragon, 0).sizes) * handle <= 1.01 * corner)


def test_pairs_that_hardly_move_are_cleared_without_bounds_on_their_second_derivatives(monkeypatch):
    watch = sampler(Dragon(60), 0)      # the benches make more than one turn
    view = watch.sample(np.array([90.0, 90.0 + 1e-6]))
    monkeypatch.setattr(on_spiral, '_bent', lambda *_: pytest.fail('a pair was examined in more detail'))
    low, room = bounds(*(view.rows(np.array([n])) for n in range(2)), watch.sizes, np.array([59]))
    assert 0.1 < low[0] < 0.5
    assert room.tolist() == [1.0]


def test_a_stretch_on_which_a_handle_turns_back_is_never_cleared():
    dragon, b_m = Dragon(COUNT), Spiral().b_m
    (turn,) = turning_places((dragon.link_lengths_m[:2] / b_m).tolist(), 14.75, 60.0)
    watch = sampler(dragon, 0)
    view = watch.sample(np.array([turn - 1e-3, turn, turn + 1e-3]))
    rows = [view.rows(np.array([n])) for n in range(3)]
    behind = np.array([COUNT - 1])
    assert np.isneginf(bounds(rows[0], rows[2], watch.sizes, behind)[0][0])
    assert np.all(np.isfinite([bounds(rows[0], rows[1], watch.sizes, behind)[0][0],
                               bounds(rows[1], rows[2], watch.sizes, behind)[0][0]]))


numbers = st.floats(-3, 3)


@given(numbers, numbers, numbers, numbers, st.floats(0, 1), st.floats(0, 1))
def test_balls_hold_every_result(a, b, c, d, one, two):
    x, y = a + one * (b - a), c + two * (d - c)
    ball, other = between(*np.array([[a], [b]])), between(*np.array([[c], [d]]))
    for mine, value in ((ball * other, x * y), (ball - other, x - y), (ball.squared(), x * x)):
        assert abs(value - mine.mid[0]) <= mine.rad[0] + 1e-12
    angle = Ball(np.abs(ball.mid) + 3.2, ball.rad)
    for mine, function in zip(angle.sin_cos(), (np.sin, np.cos), strict=True):
        assert abs(function(angle.mid + (2 * one - 1) * angle.rad) - mine.mid)[0] <= mine.rad[0] + 1e-12


def test_far_behind_a_leader_benches_move_around_it_by_the_changes_of_all_spans_in_between():
    dragon = Dragon(60, 20.0, 20.0, 1e-3, 0.0)
    watch = BenchSampler(track_of(Spiral(2 * np.pi)), dragon, (0,), 60, lambda states: None, 0.0)
    a, b = (watch.sample(np.array([theta])) for theta in (1000.0, 1001.0))
    way = _way(a, b, watch.sizes.of(a.lead))[0]
    one, two = (each.theta[0] * np.exp(1j * np.concatenate(([0.0], np.cumsum(each.delta[0])))) for each in (a, b))
    moved = np.abs(two - one)       # the travel of each handle, in a frame that turns with the leading handle
    assert np.all(moved[0] + moved[2:-1] <= way)
    assert np.all(way < 1.5 * (moved[0] + moved[3:]))
