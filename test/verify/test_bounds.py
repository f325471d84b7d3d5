"""On whole intervals, no corner deviates or moves further than the checker's bounds allow."""
from contextlib import suppress

import pytest
from flint import arb
from hypothesis import assume, given
from hypothesis import strategies as st
from motions import BENCHES, STEP, SWAY, around, centred, compiled, corners, dragons
from properties import examples

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.interval import Interval, Overlap
from dragon_ros.verify.posture import Posture, overlap


def seen(posture, n):
    """Return the corners of bench n in the frame of the leading bench, and vice versa."""
    lead, other = posture.pose(0), posture.pose(n)
    return ([(corner - lead.middle) * lead.axis.conjugate() for corner in corners(other)],
            [(corner - other.middle) * other.axis.conjugate() for corner in corners(lead)])


def bends(postures, n):
    """Return the largest second difference of a corner in each of the two frames."""
    before, here, after = (seen(posture, n) for posture in postures)
    return [max(float(abs(a - 2 * b + c)) / STEP**2 for a, b, c in zip(*frames, strict=True))
            for frames in zip(before, here, after, strict=True)]


def check(track, benches, bend, start, stop, count=3):
    """Compare all bounds of an interval with samples inside the interval."""
    ends = tuple(Posture(track, benches, 0, track.place_at(arb(place))) for place in (start, stop))
    interval = Interval(track, benches, 0, ends, bend)
    inside = [start + (stop - start) * (k + 0.37) / count for k in range(count)]
    postures = [around(track, benches, place, interval._handle(0).segment is None) for place in inside]
    for n in range(2, BENCHES):
        moved = interval._moved_m(n)
        limits = [interval._sag(n, other) * 8 / interval._length**2 for other in (False, True)]
        for three in postures:
            assert all(float(abs(one - two)) <= moved * (1 + 1e-12) for end in ends
                       for one, two in zip(corners(three[1].pose(n)), corners(end.pose(n)), strict=True))
            assert all(one <= limit * (1 + 1e-4) + 1e-6
                       for one, limit in zip(bends(three, n), limits, strict=True))
    with suppress(Overlap):
        if interval.clear(2, BENCHES - 1) is None:
            assert not any(overlap(three[1].pose(0), three[1].pose(n)) for three in postures for n in range(2, BENCHES))


@examples(30)
@given(dragons, st.floats(0, 30), st.floats(1e-3, 1.5))
def test_bounds_hold_on_a_spiral_to_its_centre(dragon, way, length):
    track, benches, bend = compiled(dragon, Spiral(0.9, 3.4))
    try:
        check(track, benches, bend, way, way + length)
    except Refused:     # the chain is locked
        assume(False)


@examples(30)
@given(dragons, st.floats(0, 20), st.floats(1e-3, 1.5))
def test_bounds_hold_across_joints(dragon, way, length):
    track, benches, bend = compiled(dragon, SWAY)
    assume(bend * max(benches.longest_links) < 1.98)
    check(track, benches, bend, way, min(way + length, float(track.end)))


@examples(25)
@given(dragons, st.floats(-10, 35), st.floats(1e-3, 1.5))
def test_bounds_hold_in_and_out_of_an_s_turn(dragon, way, length):
    track, benches, bend = compiled(dragon, STurn(1.7, 5.0, 1.5))
    assume(bend * max(benches.longest_links) < 1.98)
    check(track, benches, bend, way, way + length)


@pytest.mark.parametrize('length', [0.01, 0.1, 0.5])
@pytest.mark.parametrize(('way', 'side'), [(0.0, 1), (100.0, 1), (300.0, 1), (400.0, 1), (100.0, -1), (400.0, -1)])
def test_the_second_order_bound_is_less_than_twice_what_the_classic_dragon_does(way, side, length):
    track, benches, bend = centred(Dragon(BENCHES), 0.55, 16.0, side)
    ends = tuple(Posture(track, benches, 0, track.place_at(arb(place))) for place in (way, way + length))
    interval = Interval(track, benches, 0, ends, bend)
    postures = [around(track, benches, way + k * length, False) for k in (0.01, 0.5, 0.99)]
    for n in range(2, BENCHES):
        true = [max(pair) for pair in zip(*(bends(three, n) for three in postures), strict=True)]
        for other in (False, True):
            assert interval._sag(n, other) * 8 / interval._length**2 < 2 * true[other]


@pytest.mark.parametrize('track', [
    Composite((Arc(4.0, 359.0),), 8.0), Composite((Arc(4.0, -359.0),), 8.0), Composite((Line(30.0),), 8.0)],
    ids=['arc', 'arc to the right', 'line'])
def test_benches_on_one_arc_or_line_go_alike_and_do_not_bend_at_all(track):
    placed, benches, bend = compiled(Dragon(BENCHES, 1.5, 1.5, 0.3, 0.2), track)
    ends = tuple(Posture(placed, benches, 0, placed.place_at(arb(place))) for place in (8.0, 25.0))
    interval = Interval(placed, benches, 0, ends, bend)
    assert all(interval._sag(n, other) < 1e-25 for n in range(2, BENCHES) for other in (False, True))


def test_close_to_a_lock_where_nothing_bounds_bending_gaps_are_cleared_by_how_far_benches_go():
    track, benches, bend = compiled(Dragon(BENCHES, width_m=0.05), Spiral())
    lock = 432.917924228
    ends = tuple(Posture(track, benches, 0, track.place_at(arb(place))) for place in (lock - 1e-4, lock - 1e-8))
    interval = Interval(track, benches, 0, ends, bend)
    assert interval._sag(3, False) > 1
    assert interval.clear(2, BENCHES - 1) is None


def test_on_a_line_middles_are_known_to_half_of_the_way_and_no_better():
    track, benches, bend = compiled(Dragon(4, 1.5, 1.5, 0.3, 0.2), Composite((Line(30.0),), 8.0))
    ends = tuple(Posture(track, benches, 0, track.place_at(arb(place))) for place in (8.0, 8.5))
    middle = Interval(track, benches, 0, ends, bend)._middle(1)
    assert all(middle.real.contains(end.pose(1).middle.real.mid()) for end in ends)
    assert float(middle.real.rad()) < 0.2501


@pytest.mark.parametrize('ways', [0.01, 0.1])
def test_on_an_arc_arms_go_as_far_as_bends_say_and_no_further(ways):
    track, benches, bend = compiled(Dragon(4, 1.5, 1.5, 0.3, 0.2), Composite((Arc(4.0, 359.0),), 8.0))
    bench, (one, two) = benches.benches[0], (
        Posture(track, benches, 0, track.place_at(arb(place))).pose(0) for place in (8.0, 8.0 + ways))
    gone = bench.overhang_m * float(abs(two.axis - one.axis))
    assert gone <= bench.turned_m((ways, ways), bend) < 1.001 * gone
