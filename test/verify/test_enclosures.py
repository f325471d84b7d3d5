"""Each enclosure of the checker holds what it bounds, and a tight case leaves no room for a lost or a swapped term."""
import pytest
from flint import arb
from motions import BENCHES, STEP, SWAY, around, centred, compiled, corners, interval, made

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.verify.balls import exact
from dragon_ros.verify.motion import spiral_slopes
from dragon_ros.verify.ranges import _image

THIN = Dragon(BENCHES, 1.9, 1.7, 2e-4, 1e-4)
HALVES = 150        # of an interval of a radian, until a turning is known to the last bit


def turning(segment, low, high, link):
    """Where a handle turns back and how far in it then is: the chord's slope changes its sign there."""
    low, high = arb(low), arb(high)
    for _ in range(HALVES):
        middle = ((low + high) / 2).mid()
        ratio = 1 + spiral_slopes(segment, middle, segment.span(middle, link), link).delta_1
        low, high = (middle, high) if ratio < 0 else (low, middle)
    return low, low + segment.span(low, link)


def first_link():
    """The first link of the classic dragon, on its spiral."""
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


@pytest.mark.parametrize(('kind', 'start'), [('to the centre', 30.0), ('sway', 14.0), ('coils', 22.0)])
def test_a_bench_without_overhang_goes_as_far_as_the_handle_that_goes_further(kind, start):
    made_of = made(kind, THIN)
    piece, ends = interval(made_of, start, start + 1e-3)
    for n in range(BENCHES):
        gone = max(float(abs(one - two)) for one, two in zip(*(corners(end.pose(n)) for end in ends), strict=True))
        assert gone <= piece._moved_m(n) * (1 + 1e-12)
        assert piece._moved_m(n) < 1.003 * gone


def nearest_m(posture, n):
    """How near to the centre a link comes."""
    one, two = (complex(posture.point(k)) for k in (n, n + 1))
    share = min(max((one.conjugate() * (one - two)).real / abs(one - two)**2, 0.0), 1.0)
    return abs(one + share * (two - one))


@pytest.mark.parametrize('pitch_m', [0.01, 0.05, 0.3])
@pytest.mark.parametrize('start', [0.0, 3.0, 10.0])
def test_links_that_are_out_of_reach_are_further_out_than_all_of_the_leading_bench(pitch_m, start):
    """With a tiny pitch a link's two handles are equally far out, and its middle is as near as is said."""
    made_of = centred(Dragon(40, 1.0, 1.0, 2e-4, 1e-4), pitch_m, 1.5 / pitch_m)
    piece, ends = interval(made_of, start, start + 1e-6)
    furthest = max(abs(complex(corner)) for corner in corners(ends[0].pose(0)))
    nearest = [nearest_m(ends[0], n) for n in range(40)]
    first = next((n for n in range(2, 40) if piece._out_of_reach(n)), 40)
    assert all(piece._out_of_reach(n) for n in range(first, 40))
    assert all(nearest[n] > furthest for n in range(first, 40))
    assert nearest[first - 2] < furthest + 3e-3


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
