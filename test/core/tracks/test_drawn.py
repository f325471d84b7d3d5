"""Drawn lines become tracks with rounded corners and fitted curves, without kinks or bends too tight to pass."""
import cmath
from math import cos, pi, radians, sqrt, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples, thinned
from shapely import LineString, STRtree, linestrings, segmentize
from shapely import points as as_points

from dragon_ros.core.errors import InputError
from dragon_ros.core.tracks.biarcs import Bow
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.drawn import (
    LEAD_IN_M,
    Cubic,
    EllipseArc,
    WorkError,
    _joined,
    _shift_m,
    along,
    noise_m,
)
from dragon_ros.core.tracks.spec import Arc, Composite, Line

RADIUS_M, LEAST_M, TOLERANCE_M = 3.0, 1.5, 0.02


def points(*pairs):
    return np.array([complex(*pair) for pair in pairs])


def routed(*parts, radius_m=RADIUS_M, tolerance_m=TOLERANCE_M):
    return along(parts, radius_m, LEAST_M, tolerance_m)


def laid(route, sag_m=1e-5):
    """Return the track of a route, from the start of the drawing, as a line of closely spaced points."""
    track = track_of(Composite(route.pieces))
    return LineString(track.polyline(route.lead_in_m, track.end_m, sag_m))


def apart_m(route, drawn):
    """Return the Hausdorff distance between a track and a drawing, both divided into short parts."""
    lines = laid(route), LineString(np.stack((drawn.real, drawn.imag), axis=1))
    one, other = (np.array(segmentize(line, 0.02).coords) for line in lines)
    return max(largest_m(one, other), largest_m(other, one))


def largest_m(points_m, line_m):
    """Return the largest distance of points from a line; a tree of its parts takes a tenth of shapely's time."""
    parts = STRtree(linestrings(np.stack((line_m[:-1], line_m[1:]), axis=1)))
    return float(np.max(parts.query_nearest(as_points(points_m), return_distance=True, all_matches=False)[1]))


def radii(route):
    return [piece.radius_m for piece in route.pieces if isinstance(piece, Arc)]


def test_a_corner_between_lines_is_one_arc_whose_lines_are_shorter_by_its_tangents():
    route = routed(points((0, 0), (40, 0), (40, 30)), radius_m=4.0)
    assert route.pieces == (Line(36.0, (0.0, 0.0), 0.0), Arc(4.0, 90.0), Line(26.0))
    (change,) = route.changes
    assert change.is_corner
    assert change.place_m == (40.0, 0.0)
    assert 0 <= change.off_m - 4 * (sqrt(2) - 1) <= 1e-5 * 4 + 1e-12      # never too small
    assert route.strays_m < 1e-12


@pytest.mark.parametrize('turn_deg', [5, 45, 120, -90, -150])
def test_the_tangents_of_a_corner_are_the_radius_times_the_tangent_of_half_its_angle(turn_deg):
    route = routed(points((0, 0), (30, 0), (30 + 30 * cos(radians(turn_deg)), 30 * np.sin(radians(turn_deg)))))
    first, arc, _ = route.pieces
    assert first.length_m == pytest.approx(30 - RADIUS_M * tan(radians(abs(turn_deg)) / 2), rel=1e-9)
    assert arc.angle_deg == pytest.approx(turn_deg, rel=1e-9)
    assert arc.radius_m == pytest.approx(RADIUS_M, rel=1e-9)


def test_legs_too_short_for_the_radius_get_the_largest_that_fits():
    route = routed(points((0, 0), (40, 0), (40, 5), (80, 5)))
    assert radii(route) == pytest.approx([2.5, 2.5])
    assert [change.radius_m for change in route.changes] == pytest.approx([2.5, 2.5])


def test_corners_too_close_for_the_least_radius_become_one_bend_that_says_how_far_it_strays():
    drawn = points((0, 0), (40, 0), (40, 2), (80, 2))
    route = routed(drawn)
    (change,) = route.changes
    assert not change.is_corner
    assert min(radii(route)) >= LEAST_M
    assert apart_m(route, drawn) == pytest.approx(change.off_m, abs=0.02)


@pytest.mark.parametrize(('drawn', 'x', 'y'), [
    (points((0, 0), (40, 0), (40, 2), (0, 2)), 40, 1), (points((0, 0), (40, 0), (10, 0)), 40, 0)],
    ids=['a U of 2 m', 'straight back'])
def test_what_cannot_be_walked_is_refused_with_the_place_and_both_cures(drawn, x, y):
    with pytest.raises(InputError, match=r'larger radius or longer legs, or use shorter benches') as caught:
        routed(drawn)
    assert caught.value.fields['place_m'] == pytest.approx((x, y))
    assert f'({x}.000, {y}.000) m' in str(caught.value)
    assert f'bend of radius {LEAST_M:g} m, the tightest' in str(caught.value)


def test_a_bend_that_would_stray_from_corners_by_more_than_its_radius_is_refused():
    corners = points((0, 0), (13, 0), (8, 0.17), (9.6, 2.7))
    with pytest.raises(InputError, match='larger radius or longer legs') as caught:
        routed(corners)
    x, y = caught.value.fields['place_m']
    assert min(abs(complex(x, y) - corners)) < 2 * RADIUS_M


def test_a_bend_that_is_too_tight_is_widened_to_the_radius_and_says_so():
    route = routed(points((-20, 0), (0, 0)), Cubic((0j, 1 + 0j, 1 + 1j, 1 + 1j)), points((1, 1), (1, 20)))
    (change,) = route.changes
    assert not change.is_corner
    assert min(radii(route)) == pytest.approx(RADIUS_M, rel=1e-5)
    assert 0.1 < change.off_m < RADIUS_M


def test_a_circle_is_one_arc_behind_a_line_that_lets_the_body_in():
    route = routed(EllipseArc(1 + 2j, (5 + 0j, 5j), 0.5, 5.0))
    first, arc = route.pieces
    assert (first.length_m, route.lead_in_m) == (LEAD_IN_M, LEAD_IN_M)
    assert (arc.radius_m, arc.angle_deg) == pytest.approx((5.0, np.degrees(5.0)), rel=1e-7)
    begin = 1 + 2j + 5 * cmath.rect(1, 0.5) - LEAD_IN_M * cmath.rect(1, 0.5 + pi / 2)
    assert complex(*first.at_m) == pytest.approx(begin, abs=1e-9)


@pytest.mark.parametrize(('part', 'at'), [
    pytest.param(Cubic((0j, 30 + 0j, 5 + 20j, 40 + 25j)),
                 lambda u: 3 * (1 - u)**2 * u * 30 + 3 * (1 - u) * u**2 * (5 + 20j) + u**3 * (40 + 25j),
                 marks=pytest.mark.long),
    (EllipseArc(3j, (9 + 2j, -1 + 6j), 1.0, -4.0),
     lambda u: 3j + (9 + 2j) * np.cos(1 - 4 * u) + (6j - 1) * np.sin(1 - 4 * u))], ids=['Bézier', 'ellipse'])
def test_a_curve_is_met_within_the_tolerance_and_the_largest_distance_is_said(part, at):
    drawn = at(np.linspace(0, 1, 5000))
    for tolerance_m in (0.1, 0.01, 0.001):
        route = routed(part, tolerance_m=tolerance_m)
        assert not route.changes
        assert 0.3 * tolerance_m < route.strays_m <= 1.01 * tolerance_m
        assert apart_m(route, drawn) == pytest.approx(route.strays_m, rel=0.1, abs=2e-5)


def test_points_along_a_curve_become_arcs_and_points_along_lines_become_lines():
    u = np.linspace(0, pi / 2, 60)[1:]
    drawn = np.concatenate((np.linspace(0, 20, 100) + 0j, 20 + 8j + 8 * np.exp(1j * (u - pi / 2)),
                            28 + 8j + 1j * np.linspace(0.1, 20, 50)))
    route = routed(drawn)
    assert not route.changes
    assert len(route.pieces) <= 6
    assert isinstance(route.pieces[0], Line)
    assert isinstance(route.pieces[-1], Line)
    assert apart_m(route, drawn) <= route.strays_m + 1e-5 <= TOLERANCE_M


def test_noise_below_the_tolerance_is_smoothed_away():
    rng = np.random.default_rng(3)
    x = np.arange(0, 40, 0.05)
    true = x + 6j * np.sin(x / 6)
    drawn = true + 0.004 * (rng.standard_normal(x.size) + 1j * rng.standard_normal(x.size))
    route = routed(drawn, tolerance_m=0.05)
    assert not route.changes
    assert len(route.pieces) < 25
    assert min(radii(route)) > 2 * LEAST_M
    assert apart_m(route, drawn) <= route.strays_m + 1e-3 <= 0.052


@pytest.mark.parametrize('seed', [1, 2])
def test_noise_of_half_the_tolerance_is_smoothed_to_few_pieces_within_the_tolerance(seed):
    rng = np.random.default_rng(seed)
    x = np.arange(0, 15, 0.05)
    drawn = x + 6j * np.sin(x / 6) + 0.018 * (rng.uniform(-1, 1, x.size) + 1j * rng.uniform(-1, 1, x.size))
    route = along([drawn], 5.0, 1.0, 0.05)
    assert not route.off_m
    assert len(route.pieces) < 18
    assert apart_m(route, drawn) <= 0.05


TURN = st.floats(-140, 140)
LEG = st.floats(0.3, 30)


@given(legs=st.lists(st.tuples(LEG, TURN), min_size=2, max_size=8))
@examples(10)
def test_any_line_is_either_walked_within_what_is_said_or_refused(legs):
    at, heading, corners = 0j, 0.0, [0j]
    for length_m, turn_deg in legs:
        heading += radians(turn_deg)
        at += length_m * cmath.rect(1.0, heading)
        corners.append(at)
    drawn = np.array(corners)
    try:
        route = routed(drawn)
    except InputError:
        return
    assert min(radii(route), default=LEAST_M) >= LEAST_M * (1 - 1e-9)
    assert all(change.is_corner or change.off_m <= RADIUS_M for change in route.changes)
    said = max([route.strays_m, *(change.off_m for change in route.changes)])
    assert apart_m(route, drawn) <= said * (1 + 1e-6) + 0.011
    ends = np.array(laid(route).coords)[[0, -1]]
    np.testing.assert_allclose(ends @ (1, 1j), drawn[[0, -1]], atol=1e-7)


def test_arcs_follow_several_curves_that_are_tangent():
    x = np.linspace(0, 60, 301)
    at, rate = x + 6j * np.sin(x / 6), 1 + 1j * np.cos(x / 6)
    step = x[1] / 3
    curves = [Cubic((a, a + step * v, b - step * w, b)) for a, b, v, w in zip(at, at[1:], rate, rate[1:], strict=False)]
    route = routed(*curves)
    assert not route.changes
    assert len(route.pieces) < 30
    fine = np.linspace(0, 60, 5001)
    assert apart_m(route, fine + 6j * np.sin(fine / 6)) <= route.strays_m + 1e-4
    assert route.strays_m <= TOLERANCE_M


def test_more_pieces_than_a_track_has_are_refused_with_a_cure():
    line = 20 * np.arange(510) + 20j * (np.arange(510) % 2)
    with pytest.raises(InputError, match='give a larger --tolerance'):
        routed(*(line[n:n + 2] for n in range(509)))    # legs of two points are not smoothed


@pytest.mark.parametrize('parts', [[], [points((1, 1))], [points((1, 1), (1, 1))]])
def test_a_drawing_without_length_is_refused(parts):
    with pytest.raises(InputError, match='draw a line'):
        routed(*parts)


def test_pieces_shift_by_how_far_each_starts_from_the_end_of_the_one_before():
    line, beside, bend = Bow(0j, 1 + 0j, 5.0, 0.0), Bow(5 + 0.1j, 1 + 0j, 5.0, 0.0), Bow(10.0 + 0.1j, 1 + 0j, 3.0, 1.0)
    assert _shift_m([line], [line]) == 0
    assert _shift_m([line, beside], [line, beside]) == pytest.approx(0.1)
    assert _shift_m([line, beside, bend], [line, beside, bend]) == pytest.approx(0.1)
    turned = Bow(5 + 0j, cmath.rect(1, 0.02), 5.0, 0.0)
    assert _shift_m([line, turned], [line, turned]) == pytest.approx(0.1, rel=1e-3)
    assert _shift_m([line, line._replace(start=5 + 0j)], [line._replace(length_m=10.0)]) == 0


def test_corners_that_touch_or_overlap_share_one_place():
    places = [(7.0, 7.5), (0.0, 1.0), (1.0, 2.0), (2.5, 5.0), (3.0, 4.0), (5.5, 6.0)]
    assert _joined(places) == [(0.0, 2.0), (2.5, 5.0), (5.5, 6.0), (7.0, 7.5)]


@pytest.mark.parametrize(('back', 'lead_in_m'), [(False, 0.0), (True, LEAD_IN_M)])
def test_a_line_lets_the_body_in_only_where_the_drawing_begins_with_a_bend(back, lead_in_m):
    line, bend = np.array([0j, 20 + 0j]), EllipseArc(20 + 8j, (8 + 0j, 8j), -pi / 2, pi / 2)
    bent_back = EllipseArc(20 + 8j, (8 + 0j, 8j), 0.0, -pi / 2)
    assert routed(*((bent_back, line[::-1]) if back else (line, bend))).lead_in_m == lead_in_m


@pytest.mark.parametrize('radius_m', [9.0, 10.5, 100.0])
def test_a_corner_has_the_largest_radius_that_fits_its_legs(radius_m):
    (change,) = routed(points((0, 0), (10, 0), (10, 10)), radius_m=radius_m).changes
    assert change.radius_m == pytest.approx(min(radius_m, 10.0), abs=1e-4)


def random_line(seed):
    """Return a winding line with noise, steps of any length, sometimes a stop and a repeated start, and a tolerance."""
    rng = np.random.default_rng(seed)
    n, step = int(rng.integers(3, 60)), float(rng.choice([0.3, 1.0, 3.0, 10.0]))
    turns = np.cumsum(rng.normal(0, rng.choice([0.02, 0.1, 0.4]), n))
    line = np.cumsum(step * np.exp(1j * turns) * rng.uniform(0.3, 1.5, n))
    if seed % 5 == 0:
        line = np.concatenate((line[:2], line[:n // 2], np.repeat(line[n // 2], 5), line[n // 2:]))
    noise = step * (0.0, 0.003, 0.05, 1.0)[seed % 4]
    line = line + noise * (rng.normal(size=len(line)) + 1j * rng.normal(size=len(line)))
    return line, float(rng.choice([0.02, 0.1, 0.5])) if seed % 4 < 3 else 10 * step


@pytest.mark.parametrize('first', thinned(range(0, 1000, 50), lambda first: first < 50))
def test_no_point_of_a_random_line_or_its_track_strays_further_than_is_said(first):
    """The tolerance holds where no change is reported."""
    walked = 0
    for seed in range(first, first + 50):
        drawn, tolerance_m = random_line(seed)
        try:
            route = along((drawn,), RADIUS_M, LEAST_M, tolerance_m, 400_000)
        except InputError:
            continue
        walked += 1
        said_m = max([route.strays_m, *(change.off_m for change in route.changes)])
        assert apart_m(route, drawn) <= said_m + 1e-5, seed
        assert route.strays_m <= tolerance_m, seed
        assert min(radii(route), default=LEAST_M) >= LEAST_M * (1 - 1e-9), seed
    assert walked > 25


@pytest.mark.parametrize('count', [400, 3000])
def test_a_recording_with_noise_is_smoothed_to_few_pieces_within_what_is_said(count):
    rng = np.random.default_rng(count)
    way = np.linspace(0, 600, count) + 40j * np.sin(np.linspace(0, 9, count))
    drawn = way + 3 * (rng.normal(size=count) + 1j * rng.normal(size=count))
    assert noise_m(drawn) == pytest.approx(3, rel=0.15)
    assert noise_m(way) == 0
    route = routed(drawn, tolerance_m=15.0)
    assert len(route.pieces) < 60
    assert route.off_m == 0
    assert largest_m(np.stack((drawn.real, drawn.imag), axis=1), np.array(laid(route).coords)) <= route.strays_m + 1e-5
    assert route.strays_m <= 15
    assert largest_m(np.stack((way.real, way.imag), axis=1), np.array(laid(route).coords)) < 10


def test_no_bend_is_tighter_than_the_links_can_walk_though_a_longer_one_would_be():
    """On this line, the largest blend of a bend has a smaller radius than the shortest one."""
    drawn, _ = random_line(70)
    route = along((drawn,), 1.57, 0.785, 0.05)
    assert min(radii(route)) >= 0.785 * (1 - 1e-9)
    with pytest.raises(InputError):
        along((drawn,), 1.57, 0.785, 0.02, 2_000_000)


@pytest.mark.parametrize('seed', [115, 255, 259])
def test_a_deviation_between_the_points_of_a_drawing_is_measured(seed):
    drawn, tolerance_m = random_line(seed)
    route = along((drawn,), RADIUS_M, LEAST_M, tolerance_m, 400_000)
    assert apart_m(route, drawn) <= route.strays_m + 1e-5 <= 1.01 * apart_m(route, drawn)


def test_a_recording_whose_noise_wanders_is_followed_though_it_looks_like_a_drawn_line():
    rng = np.random.default_rng(3)
    noise, smooth = rng.normal(size=3100) + 1j * rng.normal(size=3100), np.hanning(40) / np.linalg.norm(np.hanning(40))
    drawn = np.linspace(0, 300, 3000) + 3 * np.convolve(noise, smooth, 'valid')[:3000]
    assert noise_m(drawn) == 0
    route = along((drawn,), RADIUS_M, LEAST_M, 12.0)
    assert len(route.pieces) < 60
    assert route.strays_m <= 12


def test_work_on_a_drawing_ends_at_a_limit_with_a_cure():
    rng = np.random.default_rng(1)
    drawn = np.arange(300) + 3 * (rng.normal(size=300) + 1j * rng.normal(size=300))
    with pytest.raises(WorkError, match='more than 100000 steps of work; give a larger --tolerance'):
        along((drawn,), RADIUS_M, LEAST_M, TOLERANCE_M, 100_000)
