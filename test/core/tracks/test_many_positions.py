"""Positions on a track of many segments have the same bits as on single segments; curvature ranges are complete."""
import numpy as np
import pytest

from dragon_ros.core.numerics.types import complex_of
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc

MANY = track_of(Composite((Line(4.0), Arc(2.0, 70.0), SpiralArc(1.0, 4.0, 6.0, 'left'),
                           *(Line(1.0), Arc(3.0, -40.0)) * 9)))
ONE = track_of(Spiral(0.55, 16.0))


def positions(track, shape, more=(), occurring=None):
    """Return an array of random segments, and coordinates on them with the additional axes ``more``."""
    rng = np.random.default_rng(3)
    segment = rng.choice(occurring or range(len(track.segments)), shape)
    first, last = (np.array([getattr(one, end) for one in track.segments]) for end in ('first', 'last'))
    first, last = np.where(np.isfinite(first), first, last + np.where(first > 0, 9.0, -9.0)), last
    low, high = (ends[segment].reshape(*shape, *(1 for _ in more)) for ends in (first, last))
    share = rng.random((*shape, *more))
    return segment, low + share * (high - low)


CASES = {'a row': (MANY, (40,)), 'a table': (MANY, (9, 12)), 'parts with nodes': (MANY, (9, 12), (24,)),
         'on one of many': (MANY, (5, 4), (3,), [2]), 'none': (MANY, (0, 4), (3,)), 'one segment': (ONE, (6, 5))}


@pytest.mark.parametrize('strided', [False, True])
@pytest.mark.parametrize('case', CASES)
def test_many_positions_are_evaluated_as_on_each_segment_alone(case, strided):
    track, *rest = CASES[case]
    segment, u = positions(track, *rest)
    if strided:
        segment, u = segment[::2], u[::2]

    def alone(name):
        out = np.empty(u.shape, complex)
        for k, one in enumerate(track.segments):
            on = segment == k
            out[on] = getattr(one, name)(u[on])
        return out

    points, headings = track.poses(segment, u)
    both = [np.empty(u.shape, complex) for _ in range(2)]
    for k, one in enumerate(track.segments):
        on = segment == k
        both[0][on], both[1][on] = one.poses(u[on])
    for found, expected in zip((points, headings), both, strict=True):
        np.testing.assert_array_equal(complex_of(found), expected)
    np.testing.assert_array_equal(complex_of(track.points(segment, u)), alone('at'))
    np.testing.assert_array_equal(complex_of(track.headings(segment, u)), alone('heading'))
    np.testing.assert_array_equal(track.curvatures(segment, u), alone('curvature').real)
    origins = np.array(track.origins_m)[segment].reshape(*segment.shape, *(1 for _ in u.shape[segment.ndim:]))
    np.testing.assert_array_equal(track.distances(segment, u), origins + alone('metres').real)


def test_the_range_of_curvatures_between_two_segments_covers_all_segments_between_them():
    ends = [one.curvature(np.array([one.first, one.last])) for one in MANY.segments]
    low, high = MANY.bends
    for i in range(len(ends)):
        for j in range(len(ends)):
            between = np.array(ends[min(i, j):max(i, j) + 1])
            assert (low[i, j], high[i, j]) == (np.min(between), np.max(between))
