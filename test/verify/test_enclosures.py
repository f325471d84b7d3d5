"""Each enclosure of the checker holds; in tight cases, a missing or swapped term would make a test fail."""
from fractions import Fraction
from functools import partial, reduce
from itertools import pairwise
from math import asin, cos, hypot, pi, sin
from types import SimpleNamespace

import pytest
from flint import acb, arb
from hypothesis import assume, example, given
from hypothesis import strategies as st
from motions import (
    BENCHES,
    BENT,
    CENTRED,
    STEP,
    SWAY,
    around,
    at,
    centred,
    compiled,
    corners,
    dragons,
    interval,
    made,
    made_with_reach,
)
from properties import examples

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.tracks.spec import Arc, Composite, Line, SpiralArc, STurn
from dragon_ros.verify import segments
from dragon_ros.verify.balls import above, below, direction, exact, hypot_above, size, up
from dragon_ros.verify.cover import Way, _middle, repeated, ways
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.interval import Interval, _exceeds, _unsure_m
from dragon_ros.verify.law import Law
from dragon_ros.verify.motion import Turning, furthest, spiral_slopes
from dragon_ros.verify.posture import AXES, Bench, Pose, about, overlap, separation
from dragon_ros.verify.proof import _Proof
from dragon_ros.verify.ranges import _image, _ratio, ranges
from dragon_ros.verify.roots import certified
from dragon_ros.verify.run import Limit, _passage, _up_to, _within, never_reaches
from dragon_ros.verify.segments import HALF, Link, SpiralSegment, rises
from dragon_ros.verify.track import Place

THIN = Dragon(BENCHES, 1.9, 1.7, 1e-3, 1e-4)
HALVES = 150        # bisections of an interval of 1 rad; enough to find a turning point to the last bit


def turning(segment, low, high, link):
    """Return the positions of a handle and the next one when the latter turns back (the chord's slope is 0)."""
    low, high = arb(low), arb(high)
    for _ in range(HALVES):
        middle = ((low + high) / 2).mid()
        ratio = 1 + spiral_slopes(segment, middle, segment.span(middle, link), link).delta_1
        low, high = (middle, high) if ratio < 0 else (low, middle)
    return low, low + segment.span(low, link)


def first_link():
    """Return the spiral of the classic dragon and its first link."""
    track, benches, _ = centred(Dragon(BENCHES), 0.55, 16.0)
    return track.segments[0], benches.benches[0].link


# The bounds of an interval


@pytest.mark.parametrize('share', [0.2, 0.35, 0.5, 0.65, 0.8])
def test_middles_bend_in_the_plane_as_they_do_seen_from_either_bench(share):
    track, benches, _ = made_of = compiled(THIN, SWAY)
    start = 13.0 + share * (float(track.end) - 13.0)
    piece, _ = interval(made_of, start, start + 1e-6)
    postures = around(track, benches, start + 5e-7, piece._handle(0).segment is None)
    for n in range(2, BENCHES):
        for frame, turned in ((0, 0), (n, n)):
            before, here, after = ((one.pose(n).middle - one.pose(0).middle) * one.pose(frame).axis.conjugate()
                                   for one in postures)
            true = float(abs(before - 2 * here + after)) / STEP**2
            bound = piece._in_plane(n, piece._turning(turned))
            assert true - 1e-6 < bound < true + 1e-3 * (1 + true)


def test_middles_of_two_benches_bend_by_half_the_sum_of_what_their_four_handles_do():
    seen = SimpleNamespace(
        _handle=lambda k: SimpleNamespace(pole='centre'), _turning=lambda k: Turning(arb(0), arb(0)),
        _motion=lambda k: SimpleNamespace(radial=(arb(1), arb(0), arb(10**k), arb(0), arb(0))), _in_lead=[])
    seen._in_lead_frame = partial(Interval._in_lead_frame, seen)
    for other in (False, True):
        assert Interval._middles(seen, 3, other) == pytest.approx(0.5 * (1 + 10 + 1e3 + 1e4), rel=1e-12)


@pytest.mark.parametrize(('other', 'arm_m'), [(False, 5.0), (True, 2.0)])
def test_corners_sag_by_the_arm_of_the_bench_that_turns_in_the_frame_of_the_other(other, arm_m):
    benches = [SimpleNamespace(arm_m=arm_m) for arm_m in (7.0, 2.0, 3.0, 11.0, 5.0, 13.0)]
    seen = SimpleNamespace(_benches=benches, _lead=1, _length=2.0, _middles=lambda n, other: 0.25,
                           _turning=lambda n: Turning(arb(0.5 * n), arb(4.0 * n)))
    bend = 0.25 + arm_m * hypot(1.5**2, 12.0)
    assert Interval._sag(seen, 3, other) == pytest.approx(bend * 2.0**2 / 8, rel=1e-12)


def test_a_handle_is_wide_from_where_twice_the_radius_of_its_bend_exceeds_its_link():
    segment, link = first_link()
    wide = segment.chord(link).wide
    assert segment.is_wide(wide * 1.001, link)
    assert not any(segment.is_wide(wide * share, link) for share in (1, 0.999, 0.5, 0))
    ratios = [float(abs(segment.curvature(u)) * link.length) for u in (wide, (wide - 0.25) / 1.125)]
    assert ratios[0] < 2 <= ratios[1]


@pytest.mark.parametrize(('kind', 'start'), [('to the centre', 30.0), ('sway', 14.0), ('coils', 22.0)])
def test_a_bench_without_overhang_goes_as_far_as_the_handle_that_goes_further(kind, start):
    made_of = made(kind, THIN)
    piece, ends = interval(made_of, start, start + 1e-3)
    for n in range(BENCHES):
        gone = max(float(abs(one - two)) for one, two in zip(*(corners(end.pose(n)) for end in ends), strict=True))
        assert gone <= piece._moved_m(n) * (1 + 1e-12)
        assert piece._moved_m(n) < 1.003 * gone


@pytest.mark.parametrize(('kind', 'start'), [('to the centre', 30.0), ('sway', 14.0), ('coils', 22.0)])
def test_the_ball_of_a_middle_is_a_quarter_of_the_travel_of_both_handles_wide(kind, start):
    piece, ends = interval(made(kind, THIN), start, start + 1e-3)
    for n in range(BENCHES):
        one, two = (end.pose(n) for end in ends)
        half, middle = float(one.shape.link.length) / 2, piece._middle(n)
        travel = sum(float(abs((one.middle + side * one.axis) - (two.middle + side * two.axis)))
                     for side in (half, -half))
        for radius in (float(middle.real.rad()), float(middle.imag.rad())):
            assert 0.25 * travel <= radius < 0.2501 * travel
        for pose in (one, two):
            assert middle.real.contains(pose.middle.real)
            assert middle.imag.contains(pose.middle.imag)


def nearest_m(posture, n, centre=0):
    """Return the distance of a link from the centre."""
    one, two = (complex(posture.point(k) - centre) for k in (n, n + 1))
    share = min(max((one.conjugate() * (one - two)).real / abs(one - two)**2, 0.0), 1.0)
    return abs(one + share * (two - one))


@pytest.mark.parametrize('pitch_m', [0.01, 0.05, 0.3])
@pytest.mark.parametrize('start', [0.0, 3.0, 10.0])
def test_links_that_are_out_of_reach_are_further_out_than_all_of_the_leading_bench(pitch_m, start):
    """With a tiny pitch, both handles of a link are equally far out, so the bound on the link's middle is tight."""
    made_of = centred(Dragon(40, 1.0, 1.0, 1e-3, 1e-4), pitch_m, 1.5 / pitch_m)
    piece, ends = interval(made_of, start, start + 1e-6)
    furthest = max(abs(complex(corner)) for corner in corners(ends[0].pose(0)))
    nearest = [nearest_m(ends[0], n) for n in range(40)]
    first = next((n for n in range(2, 40) if piece._out_of_reach(n)), 40)
    assert all(piece._out_of_reach(n) for n in range(first, 40))
    assert all(nearest[n] > furthest for n in range(first, 40))
    assert nearest[first - 2] < furthest + 3e-3


@pytest.mark.parametrize(('kind', 'start', 'length'), [
    ('to the centre', 2.0, 4.0), ('to the centre', 14.0, 3.0), ('turn', 12.0, 1.5), ('turn', 12.5, 1.0)])
def test_benches_that_are_out_of_reach_are_so_while_the_leading_bench_goes_in_or_out(kind, start, length):
    """This includes handles beyond the end of the spiral."""
    dragon = Dragon(60, 0.8, 0.8, 1e-3, 1e-4)
    made_of = centred(dragon, 0.9, 3.4) if kind == 'to the centre' else compiled(dragon, STurn(1.7, 5.0, 1.5))
    track, benches, _ = made_of
    piece, _ = interval(made_of, start, start + length)
    spiral, inside = track.segments[0], [at(track, benches, start + length * k / 8) for k in range(9)]
    furthest = max(abs(complex(corner - spiral.centre)) for posture in inside for corner in corners(posture.pose(0)))
    away = [n for n in range(2, 59) if piece._out_of_reach(n)]
    nearest = [min(nearest_m(posture, n, spiral.centre) for posture in inside) for n in away]
    assert min(nearest) > furthest
    assert min(nearest) < furthest + (0.1 if kind == 'to the centre' else 0.1 + 1.5 * length)
    if kind == 'turn':
        assert piece._handle(0).segment != 0


@pytest.mark.parametrize('kind', [*CENTRED, *BENT])
@examples(15)
@given(dragons, st.floats(0, 1), st.floats(0.1, 9))
def test_benches_are_apart_wherever_the_track_bends_so_little_that_links_lead_away(kind, dragon, begin, length):
    made_of, low, high = made_with_reach(kind, dragon)
    track, benches, _ = made_of
    try:
        start = low + begin * (high - low)
        stop = min(start + length, high - 1e-9 * max(high, 1.0))
        piece, ends = interval(made_of, start, stop)
        inside = [*ends, *(at(track, benches, start + (stop - start) * share) for share in (0.3, 0.7))]
        for n in filter(piece._straight, range(2, BENCHES)):
            assert all(separation(posture.pose(0), posture.pose(n), AXES[1]) > 0 for posture in inside)
    except Refused:     # the chain is locked or off the track
        assume(False)


@pytest.mark.parametrize('n', [2, 3, 5])
@pytest.mark.parametrize(('track', 'radius_m'), [
    (Composite((Arc(40.0, 300.0),), 60.0), 40.0), (Composite((Arc(40.0, -300.0),), 60.0), 40.0),
    (Composite((SpiralArc(0.3, 40.0, 20.0, 'left'), Arc(0.9, 5.0)), 0.0), None)], ids=['left', 'right', 'spiral'])
def test_links_lead_away_by_their_lengths_but_for_what_the_tightest_bend_turns_them_by(track, radius_m, n):
    """On a circle, links turn by exactly the bound; on a spiral, the innermost leading position sets the bound."""
    def piece(width_m):
        dragon = Mixed((Group(0.9), *(Group(0.5 + 0.1 * k) for k in range(8))), width_m, 0.2)
        return interval(compiled(dragon, track), start, start + 1.0)[0]
    start = 60.0 if radius_m else 0.0
    if radius_m is None:
        place = piece(0.1)._ends[1].place(0)
        radius_m = 1 / abs(float(piece(0.1)._track.segments[0].curvature(place.u)))
    links = [0.5, *(0.1 + 0.1 * k for k in range(8))]
    turned = sum(2 * asin(link / (2 * radius_m)) for link in links[:n + 1])
    half_m = (sum(links[1:n]) * (1 - 0.5 * turned**2) - 0.4) / turned
    if half_m <= 0:
        assert not piece(1e-3)._straight(n)
        return
    assert piece(2 * half_m * (1 - 1e-6))._straight(n)
    assert not piece(2 * half_m * (1 + 1e-6))._straight(n)


@pytest.mark.parametrize(('track', 'start', 'inner_m'), [
    (Composite((SpiralArc(1.3, 4.0, 1.4, 'right'), Arc(1.7, 120.0)), 0.0), 58.5, 1.7),
    (Composite((SpiralArc(1.2, 1.5, 3.0, 'left'),), 14.0), 14.0, 1.8)],
    ids=['beyond a spiral', 'on a spiral that winds out'])
def test_the_tightest_bend_is_that_of_the_whole_track_where_benches_behind_bend_more(track, start, inner_m):
    piece, _ = interval(compiled(Dragon(4, 0.9, 0.9, 0.1, 0.1), track), start, start + 0.1)
    assert piece._tightest == piece._track.bend > 0.95 / inner_m
    assert piece._handle(0).segment == len(piece._track.segments) - 1


@pytest.mark.parametrize('places', [(4.0, 4.1), (4.1, 4.0)])
def test_an_edge_parts_benches_if_it_does_at_both_ends(places):
    lead = posed((0.0, 0.0), 0.0, 1.0, 1.0)
    ends = [(lead, posed((place, 0.0), 0.0, 1.0, 1.0)) for place in places]      # 2 m apart, and 2.1 m
    front = AXES.index(next(axis for axis in AXES if (axis.other, axis.across, axis.side) == (False, False, 1)))
    assert _exceeds(ends, front, 0.0, 1.9)
    assert not _exceeds(ends, front, 0.0, 2.05)
    assert not _exceeds(ends, front, 0.0, 2.2)


@pytest.mark.parametrize(('moved', 'is_clear'), [((2.0, 2.05), True), ((2.05, 2.0), True), ((2.0, 2.15), False),
                                                 ((2.15, 2.0), False), ((0.0, 8.0), False)])
def test_gaps_at_both_ends_together_exceed_what_two_benches_move_in_between(moved, is_clear):
    lead = posed((0.0, 0.0), 0.0, 1.0, 1.0)
    ends = [SimpleNamespace(pose=[lead, posed((place, 0.0), 0.0, 1.0, 1.0)].__getitem__) for place in (4.0, 4.1)]
    assert Interval._by_going(SimpleNamespace(_ends=ends, _moved_m=moved.__getitem__), 1) == is_clear


@pytest.mark.parametrize(('moved', 'is_far'), [((2.0, 2.9), True), ((2.1, 2.95), False), ((2.9, 2.0), True),
                                               ((3.0, 2.1), False), ((0.0, 5.1), False), ((5.1, 0.0), False)])
def test_benches_are_far_apart_if_they_are_though_both_come_as_near_as_they_go(moved, is_far):
    poses = [posed((0.0, 0.0), 0.3, 1.2, 1.6), posed((10.0, 0.0), 0.3, 1.8, 2.4)]      # arms of 2 m and 3 m
    end = SimpleNamespace(pose=poses.__getitem__)
    assert Interval._far(SimpleNamespace(_ends=(end, end), _moved_m=moved.__getitem__), 1) == is_far


# The slack


@pytest.mark.parametrize(('slope', 'slack_m'), [(1.0, 1e-9), (0.01, 1.2e-9), (1e-4, 1.2e-7), (1e-6, 1e-6), (0.0, 1e-9)])
def test_the_slack_of_a_slow_contact_is_what_errors_of_corners_are_of_the_way_and_a_micrometre_at_most(slope, slack_m):
    lead = posed((0.0, 0.0), 0.0, 1.0, 1.0)
    dragon = SimpleNamespace(benches=[Bench(Link(arb(link), link), arb(0.5), arb(0.1)) for link in (0.9, 0.4)])
    law = SimpleNamespace(speed_m_s=lambda t_s: Fraction(1))
    proof = SimpleNamespace(_promise_m=2e-12, _slack_m=1e-9, _scene=SimpleNamespace(law=law), _dragon=dragon,
                            _poses=lambda contact, gone: (
                                lead, posed((2.0 - slope * float(gone), 0.0), 0.0, 1.0, 1.0)))
    contact = SimpleNamespace(t_s=5.0, benches=(0, 1))      # the second lever is the larger: 1 / 0.4 + 0.2 / 0.4 = 3
    assert _Proof._slack_at_m(proof, contact, arb(0)) == pytest.approx(slack_m, rel=1e-3)


@pytest.mark.parametrize(('length', 'width', 'link', 'lever'), [
    (1.0, 0.2, 0.4, 3.0), (1.2, 0.3, 1.0, 1.55), (2.0, 1e-9, 2.0, 2 / 3**0.5)])
def test_the_lever_of_a_corner_is_the_one_of_docs_contact(length, width, link, lever):
    bench = Bench(Link(arb(link), link), HALF * arb(length), HALF * arb(width))
    assert bench.lever == pytest.approx(lever, rel=1e-8)


# Ranges


@pytest.mark.parametrize('share', [0.05, 0.5, 0.95])
def test_the_range_of_a_handle_holds_where_it_turns_back_and_hardly_more(share):
    segment, link = first_link()
    front, least = turning(segment, 14.5, 15.5, link)
    low, high = (front - share * exact(1e-9)).mid(), (front + (1 - share) * exact(1e-9)).mid()
    begin, end = _image(segment, low, high, link)
    places = [low + segment.span(low, link), high + segment.span(high, link), least]
    assert all(begin <= place.upper() and place.lower() <= end for place in places)
    assert min(float(place - begin) for place in places) < 3e-9
    assert min(float(end - place) for place in places) < 3e-9


@pytest.mark.parametrize('ends', [(14.76, 14.84), (14.9, 15.5)])
def test_the_range_of_a_handle_that_moves_one_way_is_that_between_its_places_at_the_ends(ends):
    """Inside its turning point, towards the lock, a handle moves against the handle in front; further out, with it."""
    segment, link = first_link()
    low, high = map(arb, ends)
    begin, end = _image(segment, low, high, link)
    places = sorted((low + segment.span(low, link), high + segment.span(high, link)), key=float)
    assert begin.lower() <= places[0].upper() < places[1].lower() <= end.upper()
    assert float(end - begin) == pytest.approx(float(places[1] - places[0]), abs=1e-9)


def test_the_chain_stands_only_if_the_chord_rises_up_to_the_longest_span():
    segment = centred(THIN, 2 * pi, 16.0)[0].segments[0]
    link = Link(exact(6.0), 6.0)
    left, right = arb(1.99), arb(2.0)

    def stands(longest):
        return _ratio(segment, left, right, left + arb(longest), right + arb(pi + 0.1), link)[1]
    assert stands(peak(2.0) - 0.05)
    assert not stands(peak(2.0) + 0.05)


@pytest.mark.parametrize('ends', [(14.8, 15.5), (14.8, 15.0), (14.8, 16.0)])
def test_a_range_that_is_put_together_from_parts_reaches_from_the_least_place_to_the_greatest(ends):
    """A part in which a handle turns back is at most a billionth of the handle's coordinate wide."""
    segment, link = first_link()
    low, high = map(arb, ends)
    begin, end = _image(segment, low, high, link)
    most = (low + segment.span(low, link)).max(high + segment.span(high, link))
    least = turning(segment, 14.5, 15.5, link)[1]
    assert 0 <= float(least - begin) < 2e-8
    assert 0 <= float(end - most) < 3e-9


@pytest.mark.parametrize(('kind', 'low', 'high'), [('to the centre', 3.0, 4.0), ('sway', 15.0, 17.0)])
def test_ranges_are_those_that_handles_go_through(kind, low, high):
    track, benches, _ = made(kind, THIN)
    wide = 1e-12
    found = ranges(track, benches, arb(low, wide), arb(high, wide))
    ends = [at(track, benches, place.mid()) for place in (arb(low) - 0.9 * wide, arb(high) + 0.9 * wide)]
    assert len(found) == BENCHES
    for n, (begin, end) in enumerate(found):
        one, two = (track.distance(posture.place(n)) for posture in ends)
        assert begin <= one.upper()
        assert two.lower() <= end
        assert float(one - begin) < 4 * wide
        assert float(end - two) < 4 * wide


# Positions next to joints


@pytest.mark.parametrize('share', [-0.3, 0.0, 0.3])
def test_a_place_that_may_be_on_either_side_of_a_joint_holds_the_points_of_both(share):
    """In the direction across the line, only the widened ball contains the arc."""
    track, _, _ = compiled(THIN, Composite((Line(30.0), Arc(2.0, 90.0)), 8.0))
    joint, wide = track.joints[0], exact(1e-16)
    place = track.place_at(joint + wide * exact(share) + arb(0, 1) * wide)
    point, heading = track.point(place), track.heading(place)
    for k in range(-10, 11):
        true = track.place_at((joint + wide * exact(share) + wide * exact(0.099 * k)).mid())
        assert not true.loose
        assert point.contains(track.point(true))
        assert heading.contains(track.heading(true))
    assert max(float(part.rad()) for part in (point.real, point.imag)) < 8.5e-16
    assert float(place.loose) < 3e-16


def test_beyond_a_joint_points_and_directions_stray_from_the_curve_continued_as_far_as_is_said_and_no_further():
    """A handle 1 mm beyond a joint deviates most if the curvature jumps from one end of its range to the other."""
    track, _, _ = compiled(THIN, Composite((Arc(2.0, 90.0), Arc(2.0, -90.0)), 1.0))
    way, first = exact(1e-3), track.segments[0]
    place, beyond = Place(0, first.last + way / first.radius, 1e-3), Place(1, way / first.radius)
    for bound, true, most in ((track.point(place), track.point(beyond), 0.5 * 1e-6),
                              (track.heading(place), track.heading(beyond), 2 * 0.5 * 1e-3)):
        middle = bound.mid()
        assert float(abs(true - middle)) == pytest.approx(most, rel=1e-6)
        assert bound.contains(true)
        assert most <= float(bound.real.rad()) < most * 1.000001
        assert most <= float(bound.imag.rad()) < most * 1.000001


@pytest.mark.parametrize('scale', [1.0, 0.1])
@pytest.mark.parametrize(('turns', 'inwards'), [((2.0, 1.0), True), ((1.0, 2.0), False)])
def test_curvatures_next_to_a_joint_hold_that_of_a_spiral_just_beyond_it(turns, inwards, scale):
    """The spiral follows an arc whose radius is, to the last bit, the radius of curvature at the spiral's beginning."""
    u, b = 2 * pi * turns[0], 1.2 * scale / (2 * pi)
    radius = b * (1 + u * u)**1.5 / (2 + u * u) * (1 + (4e-16 if inwards else -4e-16))
    track, _, _ = compiled(THIN, Composite((Arc(radius, 90.0), SpiralArc(1.2 * scale, *turns, 'left')), 0.0))
    wide, share = exact(1e-16 * scale * scale), exact(0.2)
    near = track.place_at(track.joints[0] - wide * share + arb(0, 1) * wide)
    there = track.place_at((track.joints[0] + wide * exact(0.79)).mid())
    assert near.loose
    assert (near.segment, there.segment) == (0, 1)
    spiral = track.segments[1].curvature(there.u).mid()
    assert abs(float(spiral - track.segments[0].curvature(near.u))) < 1e-15 / scale
    for one, two in ((near, near), (near, track.place_at(track.joints[0] - wide * 9))):
        bound = track.curvatures(one, two)
        assert bound.contains(spiral)
        assert not bound.contains(track.segments[1].curvature(there.u + (there.u - track.segments[1].first)).mid())


@pytest.mark.parametrize(('track', 'place', 'far'), [
    (Composite((SpiralArc(1.0, 1.0, 3.0, 'left'),), 0.0), 2.9, 1.2),
    (Composite((Line(2.0), Arc(2.0, 350.0)), 0.0), 1.9, 2.9)], ids=['on a spiral', 'beyond a joint'])
def test_a_place_that_is_not_the_nearest_one_is_refused_though_it_is_a_link_away(monkeypatch, track, place, far):
    """The float solver is made to find a root over half a turn of the tightest bend away, where the chord shrinks."""
    placed, _, _ = compiled(THIN, track)
    segment = placed.segments[-1]
    if isinstance(segment, SpiralSegment):
        here, way = Place(0, 2 * arb.pi() * exact(place)), -1
        turned = 2 * pi * 0.85
        away = segment.point(here.u) - segment.point(here.u - arb(turned))
    else:
        here, way, turned = placed.place_at(arb(place)), 1, far * 2
        away = placed.point(here) - segment.point(arb(turned))
    length_m = float(abs(away))
    monkeypatch.setattr(segments, 'bracketed', lambda *_: turned)
    monkeypatch.setattr('dragon_ros.verify.track.bracketed', lambda *_: turned)
    with pytest.raises(Refused, match='have two positions'):
        placed.next(here, Link(exact(length_m), length_m), way)


@pytest.mark.parametrize('way', [1, -1])
@pytest.mark.parametrize('share', [0.15, 0.5, 0.85])
def test_the_next_handle_across_a_joint_is_where_it_is_from_all_places_of_the_one_before(share, way):
    track, benches, _ = compiled(THIN, SWAY)
    link, wide = benches.benches[1].link, exact(1e-13)
    for joint in track.joints[1:-1]:
        here = (joint - exact(way * share) * link.length).mid()
        behind = track.next(track.place_at(here + arb(0, 1) * wide), link, way)
        fronts = [track.place_at((here + wide * exact(0.1 * k)).mid()) for k in range(-9, 10)]
        samples = [track.next(front, link, way) for front in fronts]
        for front, one in zip(fronts, samples, strict=True):
            assert abs(float(abs(track.point(front) - track.point(one)) - link.length)) < 1e-22
        assert all(behind.u.contains(one.u) for one in samples)
        gone = max(abs(float(one.u - two.u)) for one in samples for two in samples)
        assert float(behind.u.rad()) < 2 * gone


@pytest.mark.parametrize('kind', ['sway', 'coils', 'coils, mirrored', 'turn'])
@examples(20)
@given(st.floats(0, 1), st.floats(1e-9, 8))
def test_all_curvatures_between_two_places_are_bounded_and_no_others(kind, share, length):
    """The tracks are lines, arcs and spirals that turn either way, with at least one joint between the positions."""
    track, _, _ = made(kind, THIN)
    low, high = -5.0 if track.begin is None else float(track.begin), 40.0 if track.end is None else float(track.end)
    first = low + share * (high - low - 1e-6)
    last = min(first + length, high)
    places = [track.place_at(arb(first + (last - first) * k / 40)) for k in range(41)]
    seen = [track.segments[place.segment].curvature(place.u) for place in places]
    for one, two in ((0, -1), (-1, 0)):
        bound = track.curvatures(places[one], places[two])
        assert all(bound.contains(curvature.mid()) for curvature in seen)
    joints = [joint for joint in track.joints if first < joint < last]
    seen += [track.segments[k].curvature(u) for k, segment in enumerate(track.segments)
             for u, joint in ((segment.first, k - 1), (segment.last, k))
             if u is not None and 0 <= joint < len(track.joints) and track.joints[joint] in joints]
    least, most = min(map(below, seen)), max(map(above, seen))
    assert float(bound.rad()) < 0.500001 * (most - least) + 1e-8


@pytest.mark.parametrize('share', [-0.3, 0.0, 0.3])
@pytest.mark.parametrize('joint', range(6))
def test_curvatures_next_to_a_joint_are_those_of_both_sides(joint, share):
    track, _, _ = compiled(THIN, SWAY)
    here, wide = track.joints[joint], exact(1e-16)
    near, far = track.place_at(here + wide * exact(share) + arb(0, 1) * wide), track.place_at((here - 1e-3).mid())
    assert near.loose
    for bound in (track.curvatures(near, near), track.curvatures(far, near), track.curvatures(near, far)):
        for k in range(-9, 10):
            true = track.place_at((here + wide * exact(share) + wide * exact(0.1 * k)).mid())
            assert bound.contains(track.segments[true.segment].curvature(true.u).mid())


# Roots


@pytest.mark.parametrize('error', [0.0, 5e-14, -5e-14, 1e-9, -1e-6])
def test_a_root_lies_in_its_ball_which_is_hardly_wider_than_the_function(error):
    found = certified(lambda x: x * x - 2, lambda x: 2 * x, 2**0.5 * (1 + error))
    assert found.contains(arb(2).sqrt().mid())
    assert found.overlaps(arb(2).sqrt())
    assert float(found.rad()) < 1e-24
    wide = certified(lambda x: x * x - arb(2, 1e-16), lambda x: 2 * x, 2**0.5 * (1 + error))
    assert wide.contains(arb(2 - 1e-16).sqrt().mid())
    assert wide.contains((arb(2) + arb(0.99e-16)).sqrt().mid())
    assert float(wide.rad()) < 1e-16


def test_where_there_is_no_root_none_is_found():
    with pytest.raises(Refused):
        certified(lambda x: x * x + arb(2.0)**-80, lambda x: 2 * x, 1e-12)


def peak(theta):
    """Return the span beyond half a turn at which the chord from a handle begins to shrink."""
    low, high = pi, 1.5 * pi
    for _ in range(80):
        middle = 0.5 * (low + high)
        sine, cosine = sin(0.5 * middle), cos(0.5 * middle)
        low, high = (middle, high) if middle + 2 * theta * sine * (sine + (theta + middle) * cosine) > 0 else (
            low, middle)
    return low


@pytest.mark.parametrize('theta', [1.2, 2.0, 9.0])
def test_a_chord_is_said_to_rise_up_to_its_peak_and_no_further(theta):
    last, low = peak(theta), arb.pi().lower()
    assert rises(arb(theta), low, arb(last - 1e-6))
    assert not rises(arb(theta), low, arb(last + 1e-6))
    assert not rises(arb(theta) + arb(0, 1e-2), low, arb(last - 1e-6))


def test_a_span_beyond_the_peak_of_its_chord_is_none(monkeypatch):
    """The float solver is made to find a later root, at which the chord grows again."""
    segment = centred(THIN, 2 * pi, 16.0)[0].segments[0]
    theta, later = 2.0, 2 * pi + 1.0

    def chord(delta):
        return float(abs(segment.point(arb(theta + delta)) - segment.point(arb(theta))))
    link = Link(exact(chord(later)), chord(later))
    assert chord(peak(theta)) < link.near
    monkeypatch.setattr(segments, 'about_span', lambda *_: later)
    with pytest.raises(Refused, match='beyond the first peak'):
        segment.span(arb(theta), link)


# Benches and their separations


angles, coordinates, halves = st.floats(-4, 4), st.floats(-5, 5), st.floats(0.01, 3)


def posed(at_m, angle, half_length, half_width):
    """Return a bench at a position."""
    axis, middle = direction(exact(angle)), acb(*map(exact, at_m))
    shape = Bench(Link(exact(half_length), half_length), exact(half_length), exact(half_width))
    return Pose(shape, middle, axis, complex(middle), complex(axis), 0.0, 0.0)


poses = st.builds(posed, st.tuples(coordinates, coordinates), angles, halves, halves)


@examples(60)
@given(poses, poses)
@example(posed((0.1, 0.0), 1.0, 3.0, 2.0), posed((0.0, 0.1), 0.3, 0.1, 0.1))
@example(posed((0.0, 0.1), 0.3, 0.1, 0.1), posed((0.1, 0.0), 1.0, 3.0, 2.0))
def test_a_separation_is_how_far_the_nearest_corner_is_beyond_the_edge_line(one, two):
    rough = about(one, two)
    for k, axis in enumerate(AXES):
        own, other = (two, one) if axis.other else (one, two)
        half = own.shape.half_width if axis.across else own.shape.half_length
        seen = [(corner - own.middle) * own.axis.conjugate() for corner in corners(other)]
        beyond = [(corner.imag if axis.across else corner.real) * axis.side - half for corner in seen]
        nearest = reduce(arb.min, beyond)
        assert abs(float(separation(one, two, axis) - nearest)) < 1e-30
        assert abs(rough[k] - float(nearest)) < 1e-13
        assert abs(rough[k] - float(nearest)) <= _unsure_m(one, two, 0.0) < 3e-11
    if min(map(abs, rough)) > 1e-12:
        assert overlap(one, two) == (max(rough) < 0)


@examples(30)
@given(poses, st.floats(0.01, 1))
def test_no_corner_is_further_from_the_middle_or_from_the_link_than_is_said(pose, share):
    length, width = float(pose.shape.half_length), float(pose.shape.half_width)
    bench = Bench(Link(exact(2 * length * share), 2 * length * share), pose.shape.half_length, pose.shape.half_width)
    assert hypot(length, width) <= bench.arm_m < hypot(length, width) * (1 + 1e-12)
    corner = hypot(length - length * share, width)
    assert corner * (1 - 1e-12) <= bench.overhang_m < corner * (1 + 1e-12) + 1e-12


# The cover


@examples(60)
@given(st.lists(st.sampled_from([1.0, 2.0]), min_size=1, max_size=12))
def test_repeated_lengths_are_those_that_stand_there(lengths):
    text = lengths[::-1]
    for n, count in enumerate(repeated(lengths)):
        assert text[:count] == text[n:n + count]
        assert n + count == len(text) or text[count] != text[n + count]


@pytest.mark.parametrize('bodies', [[1.0] * 400, [1.0, 2.0] * 200, ([1.0] * 19 + [2.0]) * 20],
                         ids=['equal', 'alternating', 'blocks'])
def test_repeated_lengths_are_found_by_at_most_two_comparisons_each(bodies):
    compared = []

    class Length(float):
        def __eq__(self, other):
            compared.append(1)
            return float(self) == float(other)

        __hash__ = float.__hash__
    repeated([Length(one) for one in bodies])
    assert len(compared) <= 2 * len(bodies)


@pytest.mark.parametrize(('low', 'high', 'bench'), [
    (1, 1, 0), (2, 2, 0), (0, 1, None), (2, 3, None), (0, 2, 0), (3, 3, None)])
def test_a_bench_is_at_the_ends_of_its_range_but_in_no_interval_that_only_touches_them(low, high, bench):
    assert Way(0, ((0, (arb(1), arb(2))),)).most(arb(low), arb(high)) == bench


@examples(80)
@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=5), st.integers(-2, 34),
       st.integers(0, 9))
def test_the_bench_with_most_behind_it_is_the_first_that_goes_there(steps, low, length):
    """Both ends of the benches' ranges decrease from the first bench to the last."""
    ends = [(30, 33)]
    for first, last in steps:
        ends.append((ends[-1][0] - first, max(ends[-1][1] - last, ends[-1][0] - first)))
    way = Way(0, tuple((bench, (arb(first), arb(last))) for bench, (first, last) in enumerate(ends)))
    high = low + length
    there = [bench for bench, (first, last) in enumerate(ends)
             if (first < high and last > low if low < high else first <= high and last >= low)]
    assert way.most(arb(low), arb(high)) == (there[0] if there else None)
    covered = [(float(first), float(last)) for first, last in way.parts]
    for place in range(-10, 40):
        assert any(a <= place <= b for a, b in covered) == any(a <= place <= b for a, b in ends)


@examples(80)
@given(st.floats(-9, 9), st.floats(1e-6, 9), st.lists(st.floats(-12, 12), max_size=6), st.lists(st.floats(0.01, 0.99),
                                                                                              max_size=3))
def test_an_interval_is_cut_inside_of_it_where_ways_end_or_hints_say(low, length, cuts, shares):
    ends = [arb(low + length * share) for share in sorted(shares)]
    begin, end = arb(low), arb(low) + arb(length)
    cut = _middle(begin, end, sorted(cuts), ends)
    assert begin < cut < end
    inside = [one for one in cuts if begin < one < end and low < one]
    assert float(cut) in ([float(one) for one in ends] or inside or [float((begin + end) / 2)])
    assert cut.is_exact()


# The end of a run


@examples(60)
@given(st.lists(st.tuples(st.floats(0.1, 5), st.floats(-2, 2)), min_size=1, max_size=4), st.booleans(), st.floats(0, 1))
def test_a_place_is_passed_when_the_leader_is_there_on_its_way(rows, smooth, share):
    t_s, knots = Fraction(0), [(Fraction(0), Fraction(1, 2))]
    for gap, speed in rows:
        t_s += Fraction(gap)
        knots.append((t_s, Fraction(speed)))
    law = Law(tuple(knots), smooth)
    for before, after in pairwise(law.marks):
        way = after.travel_m - before.travel_m
        if not before.sense:
            continue
        travel_m = before.travel_m + Fraction(share) * way
        passed = _passage(law, before, after, travel_m, before.sense)
        assert before.t_s <= passed <= after.t_s
        assert abs(law.travel_m(passed) - travel_m) < Fraction(1, 10**15) + after.more_m
        assert _passage(law, before, after, before.travel_m - before.sense, before.sense) == before.t_s
    last, speed = law.last
    if speed:
        passed = _passage(law, last, None, last.travel_m + 7 * speed, last.sense)
        assert passed == last.t_s + 7


def test_a_link_is_said_to_lock_a_billionth_beyond_the_lock_and_not_before():
    segment, link = first_link()
    low, high = 5.0, 16.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        try:
            segment.span(arb(middle), link)
            high = middle
        except Refused:
            low = middle
    assert never_reaches(segment, arb(low - 1e-9), link)
    assert never_reaches(segment, arb(low - 1.0), link)
    assert not any(never_reaches(segment, arb(high + by), link) for by in (1e-9, 1e-3, 1.0))


def test_a_leader_goes_to_the_limits_of_the_model_and_no_further():
    limits = Limit(arb(-1), 0.0, ''), Limit(arb(3), 0.0, '')
    inside, outside = (Fraction(0), Fraction(2)), (Fraction(-5), Fraction(7))
    assert [float(end) for end in _within(inside, limits)] == [0, 2]
    assert [float(end) for end in _within(outside, limits)] == [-1, 3]
    assert [float(end) for end in _within(outside, (None, None))] == [-5, 7]
    assert [float(end) for end in _up_to(inside, arb(3), 1)] == [0, 3]
    assert [float(end) for end in _up_to(inside, arb(1), 1)] == [0, 2]
    assert [float(end) for end in _up_to(inside, arb(-1), -1)] == [-1, 2]
    assert [float(end) for end in _up_to(inside, arb(1), -1)] == [0, 2]
    assert Fraction(1, 3) < Fraction(above(_within((Fraction(0), Fraction(1, 3)), (None, None))[1]))


# Balls


@examples(80)
@given(st.fractions(-1000, 1000), st.fractions(0, 5))
def test_floats_beside_a_ball_are_on_the_right_side_of_it_and_next_to_it(middle, half):
    low, high = middle - half, middle + half
    ball = exact(low).union(exact(high))
    near = Fraction(1, 10**14) * abs(middle) + Fraction(1, 10**8) * half + Fraction(1, 10**300)   # a radius has 30 bits
    most = max(abs(low), abs(high))
    assert high <= Fraction(above(ball)) <= high + near
    assert low - near <= Fraction(below(ball)) <= low
    assert most <= Fraction(size(ball)) <= most + near


@examples(40)
@given(st.floats(1e-9, 1e9), st.floats(1e-9, 1e9))
def test_sums_of_floats_are_raised_beyond_their_rounding_and_hardly_more(x, y):
    squares = Fraction(x)**2 + Fraction(y)**2
    assert squares <= Fraction(hypot_above(x, y))**2 <= squares * (1 + Fraction(1, 10**12))
    assert Fraction(x) + Fraction(y) < Fraction(up(x + y)) < (Fraction(x) + Fraction(y)) * (1 + Fraction(1, 10**12))


@examples(60)
@given(st.floats(-5, 5), st.floats(0.1, 4), st.floats(0, 1), st.floats(0, 1))
def test_no_position_is_further_from_two_others_than_is_said_and_one_is_as_far(low, wide, one, other):
    here, there = low + wide * one, low + wide * other
    said = furthest(exact(low), exact(low + wide), exact(here) + exact(there))
    gone = [abs(at - here) + abs(at - there) for at in (low + wide * k / 20 for k in range(21))]
    assert max(gone) <= said * (1 + 1e-12)
    assert said <= max(gone) * (1 + 1e-9) + 1e-12


@pytest.mark.parametrize('lengths', [(3.0,) * 9, (3.0, 2.0, 2.0, 2.0), (3.0, 2.0, 1.0, 2.0, 1.0, 2.0, 1.0)])
def test_every_bench_with_two_behind_it_is_in_one_class_and_no_other_is(lengths):
    found = ways(SimpleNamespace(lengths_m=lengths), [(n, n) for n in range(len(lengths))])
    assert sorted(bench for way in found for bench, _ in way.members) == list(range(len(lengths) - 2))
    for way in found:
        for bench, place in way.members:
            assert place == (bench, bench)
            assert lengths[bench:] == lengths[way.lead:][:len(lengths) - bench]
