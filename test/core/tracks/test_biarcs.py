"""Biarcs join the given points and directions, and return the distances of points from the curve."""
import cmath
from math import pi

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.tracks.biarcs import Bow, biarc, fitted, strays_m

COORDINATE = st.floats(-100, 100)
POINT = st.builds(complex, COORDINATE, COORDINATE)
ANGLE = st.floats(-pi, pi)


@given(start=POINT, end=POINT, first=ANGLE, last=ANGLE)
@example(1.192092896e-07j, -3 + 0j, 0.0, pi)        # the first arc is very short
@example(1.192092896e-07j, 3 + 0j, 0.0, pi)         # the second arc is
@example(-1 + 0j, -1 - 1j, 0.0, -5.960464477539063e-08)     # the legs are very long
@examples(200)
def test_a_biarc_goes_from_pose_to_pose_without_a_kink(start, end, first, last):
    assume(abs(end - start) > 1e-3)
    heading, leaving = cmath.rect(1.0, first), cmath.rect(1.0, last)
    found = biarc(start, heading, end, leaving)
    assume(found is not None)
    one, two = found
    scale = abs(start) + abs(end) + one.length_m + two.length_m
    assert one.start == start
    assert one.heading == heading
    assert abs(one.end - two.start) < 1e-11 * scale
    assert abs(one.leaving - two.heading) < 1e-11
    assert abs(two.end - end) < 1e-9 * scale
    assert abs(two.leaving - leaving) < 1e-9


def test_the_biarc_of_two_places_on_a_circle_is_that_circle():
    one, two = biarc(5 + 0j, 1j, 5 * cmath.rect(1, 1.2), cmath.rect(1, 1.2 + pi / 2))
    assert one.radius_m == pytest.approx(5, rel=1e-14)
    assert two.radius_m == pytest.approx(5, rel=1e-14)
    assert one.angle_rad + two.angle_rad == pytest.approx(1.2, rel=1e-14)


def test_a_biarc_that_would_start_backwards_is_none():
    assert biarc(0j, -1 + 0j, 10 + 0j, -1 + 0j) is None


@given(start=POINT, first=ANGLE, length=st.floats(0.1, 50), angle=st.floats(-6.2, 6.2), point=POINT)
@examples(100)
def test_the_distance_from_an_arc_is_that_of_its_nearest_point(start, first, length, angle, point):
    bow = Bow(start, cmath.rect(1.0, first), length, angle)
    dense = bow.points(1e-7)
    gap = length / (len(dense) - 1) if len(dense) > 2 else length
    nearest = float(np.min(np.abs(point - dense)))
    said = float(bow.distances_m(np.array([point]))[0])
    assert said <= nearest + 1e-9
    assert said >= nearest - gap


def test_points_of_an_arc_begin_and_end_with_it_and_stray_no_further_than_asked():
    bow = Bow(1 + 2j, cmath.rect(1.0, 0.3), 12.0, -4.0)
    points = bow.points(1e-3)
    assert abs(points[0] - bow.start) < 1e-12
    assert abs(points[-1] - bow.end) < 1e-12
    assert 5e-5 < float(np.max(bow.distances_m(0.5 * (points[1:] + points[:-1])))) < 1e-3


def test_a_curve_is_fitted_with_few_arcs_within_the_tolerance():
    u = np.linspace(0, 6, 500)
    points, rates = u + 2j * np.sin(u), 1 + 2j * np.cos(u)
    counts = []
    for tolerance_m in (1e-2, 1e-3, 1e-4):
        found = fitted(points, rates / np.abs(rates), tolerance_m, 0.1, lambda points: None)
        bows = [bow for pair in found.biarcs for bow in pair]
        assert strays_m(tuple(bows), points) <= tolerance_m
        counts.append(len(bows))
    assert counts[0] < counts[1] < counts[2] < 120        # the error is proportional to the cube of the length
    assert counts[2] / counts[1] == pytest.approx(10 ** (1 / 3), rel=0.3)


def test_where_arcs_would_bend_too_tightly_there_are_none():
    u = np.linspace(0, 2 * pi, 200)
    found = fitted(3 * np.exp(1j * u), 1j * np.exp(1j * u), 1e-2, 3.1, lambda points: None)
    assert all(one is None for one in found.biarcs)
    assert [first for first, _ in found.spans] == list(range(199))
