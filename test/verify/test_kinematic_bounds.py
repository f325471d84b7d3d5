"""Derivatives of handles and links stay within their bounds, which are tight on short intervals."""
from math import inf, sin

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from motions import BENCHES, BENT, CENTRED, STEP, around, compiled, dragons, interval, made, made_with_reach, reach_m
from properties import examples, thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.tracks.spec import Arc, Composite
from dragon_ros.verify import motion
from dragon_ros.verify.balls import size
from dragon_ros.verify.errors import Refused

SLACK = 1e-7        # error of derivatives by finite differences
DRAGON = Dragon(BENCHES, 1.9, 1.7, 0.2, 0.2)


def derivatives(values):
    """Return the first and second derivatives from three values one step apart."""
    before, here, after = values
    return float((after - before) / (2 * STEP)), float((after - 2 * here + before) / STEP**2)


def turned(postures, n):
    """Return the angles of a link, relative to its angle in the middle posture."""
    axes = [posture.pose(n).axis for posture in postures]
    return [(axis * axes[1].conjugate()).arg() for axis in axes]


def truths(track, postures, piece, n):
    """Yield pairs of a derivative and its bounds for the n-th handle and the link behind it."""
    moving, turning = piece._motion(n), piece._turning(n)
    places = [posture.place(n) for posture in postures]
    if len({place.segment for place in places}) == 1:
        first, second = derivatives([track.distance(place) for place in places])
        yield first, moving.speeds.v
        yield second, moving.speeds.rate
        if moving.handle.segment is not None:
            first, second = derivatives([place.u for place in places])
            yield first, moving.p
            yield second, moving.a
        yield from ((float(getattr(track.heading(places[1]), part)), getattr(moving.speeds.tangent, part))
                    for part in ('real', 'imag'))
        yield float(track.segments[places[1].segment].curvature(places[1].u)), moving.speeds.curvature
    first, second = derivatives(turned(postures, n))
    yield first, turning.w
    yield second, turning.rate


def hold(made_of, start, stop, shares, wide=inf):
    """Compare derivatives inside an interval with their bounds, and the widths of these bounds with a limit."""
    track, benches, _ = made_of
    piece, _ = interval(made_of, start, stop)
    for share in shares:
        postures = around(track, benches, start + (stop - start) * share, piece._handle(0).segment is None)
        segments = [[posture.place(n).segment for n in range(BENCHES + 1)] for posture in postures]
        if segments[0] != segments[-1]:
            continue
        for n in range(BENCHES):
            for true, bound in truths(track, postures, piece, n):
                unsure = SLACK * (1 + abs(true))
                assert not bound.is_finite() or abs(float(bound.mid()) - true) < float(bound.rad()) + unsure
                assert bound.is_finite() or wide == inf
                assert float(bound.rad()) <= wide * (1 + abs(true)) or wide == inf


@pytest.mark.parametrize('kind', [*CENTRED, *BENT])
@examples(15)
@given(dragons, st.floats(0, 1), st.floats(1e-3, 1.5), st.lists(st.floats(0.01, 0.99), min_size=1, max_size=3))
def test_derivatives_stay_within_their_bounds(kind, dragon, begin, length, shares):
    made_of, low, high = made_with_reach(kind, dragon)
    try:
        start = low + begin * 0.97 * (high - low)
        hold(made_of, start, min(start + length, low + 0.98 * (high - low)), shares)
    except Refused:     # the chain is locked or off the track
        assume(False)


@pytest.mark.parametrize('share', thinned([0.05, 0.21, 0.37, 0.52, 0.66, 0.83, 0.93],
                                          lambda share: share == 0.52))
@pytest.mark.parametrize('kind', [*CENTRED, *BENT])
def test_on_short_intervals_bounds_are_hardly_wider_than_what_happens(kind, share):
    made_of = made(kind, DRAGON)
    low, high = reach_m(*made_of[:2])
    start = low + share * (high - low)
    hold(made_of, start, start + 1e-5, [0.3, 0.8], 0.01)


@pytest.mark.parametrize('length', [0.3, 0.8])
def test_across_a_joint_of_two_equal_arcs_directions_are_those_that_are_taken_and_no_others(length):
    """The link and the tangents turn by as much as the bends allow them to."""
    bent = Composite((Arc(2.0, 180.0), Arc(2.0, 150.0)), 8.0)
    track, benches, bend = made_of = compiled(Dragon(4, 1.6, 1.6, 0.2, 0.2), bent)
    joint = float(track.joints[0])
    piece, ends = interval(made_of, joint - 0.5 * length, joint + 0.5 * length)
    assert piece._handle(0).segment is None
    tangent, curvature = motion._joint(piece._handle(0), ends, 0)
    axis = motion._axis(piece._handle(0), piece._handle(1), ends, 0, benches.benches[0].link.inverse)
    assert float(curvature.rad()) < 1e-9
    turned = length * bend
    for bound, (one, two) in ((tangent, [track.heading(end.place(0)) for end in ends]),
                              (axis, [end.pose(0).axis for end in ends])):
        assert abs(float((one * two.conjugate()).arg())) == pytest.approx(turned, rel=1e-6)
        middle = (one + two) / abs(one + two)
        seen = [(direction * middle.conjugate()).imag for direction in (bound, one, two)]
        assert seen[0].contains(seen[1].mid())
        assert seen[0].contains(seen[2].mid())
        assert size(seen[0]) < 1.2 * sin(0.5 * turned)
