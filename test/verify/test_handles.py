"""The positions of handles on an interval, and the distances they travel, stay within the checker's bounds."""
from types import SimpleNamespace

import pytest
from flint import arb
from hypothesis import assume, given
from hypothesis import strategies as st
from motions import BENCHES, BENT, CENTRED, at, centred, dragons, interval, made, made_with_reach, reach_m
from properties import examples

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.motion import _turning, furthest
from dragon_ros.verify.track import Place

TURN_M = 432.7581345      # travel of the head at which handle 1 of the classic dragon turns back
NEVER_LESS = 1 - 1e-12      # allows for the rounding of balls and floats if a value equals its bound


def travel_m(track, one, two):
    """Return the distance along the track between two positions."""
    return float(abs(track.distance(one) - track.distance(two)))


def hold(made_of, start, stop, shares):
    """Compare the bounds of all handles with their positions in an interval and their distances from both ends."""
    track, benches, _ = made_of
    piece, ends = interval(made_of, start, stop)
    inside = [at(track, benches, start + (stop - start) * share) for share in shares]
    for n in range(BENCHES + 1):
        handle = piece._handle(n)
        for number, known in enumerate(handle.ends):
            if known is not None:
                assert (handle.low, handle.high)[number].overlaps(ends[known].place(n).u)
        for posture in (*inside, *ends):
            place = posture.place(n)
            if handle.segment is not None:
                assert place.segment == handle.segment
                assert not place.u < handle.low
                assert not place.u > handle.high
            ways = [travel_m(track, place, end.place(n)) for end in ends]
            assert NEVER_LESS * sum(ways) <= handle.moved_m + 1e-25


def held(kind, dragon, begin, length, shares):
    """Check an interval of a track; the interval begins at a share of the head's range."""
    made_of, low, high = made_with_reach(kind, dragon)
    try:
        start = low + begin * (high - low)
        hold(made_of, start, min(start + length, high - 1e-9 * max(high, 1.0)), shares)
    except Refused:     # the chain is locked or off the track
        assume(False)


shares = st.lists(st.floats(0, 1), min_size=2, max_size=5)


@pytest.mark.parametrize('kind', [*CENTRED, *BENT])
@examples(15, long=25)
@given(dragons, st.floats(0, 1), st.floats(1e-6, 2), shares)
def test_handles_stay_where_they_are_said_to_be_and_go_no_further(kind, dragon, begin, length, shares):
    held(kind, dragon, begin, length, shares)


@pytest.mark.parametrize('kind', CENTRED)
@examples(25)
@given(dragons, st.floats(0, 9), st.floats(-9, 0.5), shares)
def test_so_do_handles_that_turn_back_up_to_a_nanometre_before_a_lock(kind, dragon, before, length, shares):
    made_of = made(kind, dragon)
    stop = reach_m(*made_of[:2])[1] - 10**-before
    try:
        hold(made_of, max(stop - 10**length, 0.0), stop, [*shares, *(1 - share * 10**-before for share in shares)])
    except Refused:
        assume(False)


@pytest.mark.parametrize('side', [1, -1])
def test_the_first_links_of_the_classic_dragon_turn_back_and_what_follows_them_does_too(side):
    """While the head moves from 16.5 to 14.735 rad, handle 1 turns back at 17.876 rad and travels 1.750 m in all."""
    track, benches, bend = centred(Dragon(BENCHES), 0.55, 16.0, side)
    ends = [float(track.distance(Place(0, arb(theta)))) for theta in (16.5, 14.735)]
    piece, _ = interval((track, benches, bend), *ends)
    inside = [at(track, benches, arb(ends[0] + (ends[1] - ends[0]) * k / 400)) for k in range(401)]
    for n in range(1, 5):
        handle, places = piece._handle(n), [posture.place(n) for posture in inside]
        least, most = (chosen(float(place.u) for place in places) for chosen in (min, max))
        turning = min(places, key=lambda place: float(place.u))
        gone = travel_m(track, places[0], turning) + travel_m(track, turning, places[-1])
        assert float(handle.low) <= least
        assert float(handle.high) >= most * NEVER_LESS
        assert handle.moved_m >= gone
        if n == 1:
            assert (least, most, gone) == pytest.approx((17.876, 18.856, 1.750), abs=1e-3)


@pytest.mark.parametrize('half', [0.003, 0.03])
@pytest.mark.parametrize('share', [0.05, 0.3, 0.7, 0.95])
def test_a_handle_that_turns_back_anywhere_in_an_interval_stays_within_its_bounds(share, half):
    track, benches, bend = centred(Dragon(BENCHES), 0.55, 16.0)
    start = TURN_M - 2 * half * share
    piece, ends = interval((track, benches, bend), start, start + 2 * half)
    inside = [at(track, benches, arb(start + 2 * half * k / 100)) for k in range(101)]
    for n in range(1, BENCHES + 1):
        handle, places = piece._handle(n), [posture.place(n) for posture in inside]
        assert handle.ends == (None, None)
        least, most = (chosen(float(place.u) for place in places) for chosen in (min, max))
        assert float(handle.low) <= least
        assert most * NEVER_LESS <= float(handle.high)
        both = [end.place(n) for end in ends]
        furthest = max(sum(travel_m(track, Place(0, u), end) for end in both) for u in (handle.low, handle.high))
        assert furthest * NEVER_LESS <= handle.moved_m < 1.001 * furthest


@examples(60)
@given(st.floats(0.1, 9), st.floats(0.1, 9), st.floats(0, 1), st.booleans())
def test_the_mean_value_theorem_bounds_what_turns_once_and_no_less(down, up, share, first_up):
    """A function on [0, 1] has the slopes -down and up, and changes direction at a share of the interval."""
    slopes = (up, -down) if first_up else (-down, up)
    turn = 5 + slopes[0] * share
    last = turn + slopes[1] * (1 - share)
    front, ratio = SimpleNamespace(low=arb(0), high=arb(1)), arb(-down).union(arb(up))
    low, high = _turning(front, (arb(5), arb(last)), (arb(100), arb(-100)), ratio)
    assert float(low) <= min(5, turn, last) + 1e-7       # a radius has 30 bits
    assert float(high) >= max(5, turn, last) - 1e-7
    less, more = -max(down, (down + up) / 2), max(up, (down + up) / 2)      # the product of a ball and [0, 1]
    assert float(low) == pytest.approx(max(5 + less, last - more), abs=1e-6)
    assert float(high) == pytest.approx(min(5 + more, last - less), abs=1e-6)


@pytest.mark.parametrize(('low', 'one', 'two', 'high'), [(0, 3, 4, 5), (0, 1, 2, 5), (-2, -1, -1, -1), (0, 0, 4, 4)])
def test_a_place_is_as_far_from_two_others_as_at_the_bound_that_is_further_from_both(low, one, two, high):
    inside = [low + (high - low) * k / 20 for k in range(21)]
    most = max(abs(place - one) + abs(place - two) for place in inside)
    assert most <= furthest(arb(low), arb(high), arb(one + two)) < most + 1e-12


@pytest.mark.parametrize('half', [0.01, 0.03])
def test_how_far_handles_go_that_turn_back_is_bounded_tightly(half):
    """The bound is at most five times too large: the mean value theorem uses the steepest slope of the interval."""
    track, benches, bend = centred(Dragon(BENCHES), 0.55, 16.0)
    middle = float(track.distance(Place(0, arb(14.863))))
    piece, ends = interval((track, benches, bend), middle - half, middle + half)
    inside = [at(track, benches, arb(middle + half * k / 100)) for k in range(-100, 101)]
    for n in range(1, BENCHES + 1):
        handle, places = piece._handle(n), [posture.place(n) for posture in inside]
        ways = max(sum(travel_m(track, place, end.place(n)) for end in ends) for place in places)
        assert handle.ends == (None, None)
        assert ways <= handle.moved_m < 5 * ways
        furthest = max(sum(travel_m(track, Place(0, u), end.place(n)) for end in ends)
                       for u in (handle.low, handle.high))
        assert furthest * NEVER_LESS <= handle.moved_m < 1.001 * furthest
