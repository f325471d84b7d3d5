"""The signed gap and its witnesses agree with shapely and with results derived by hand."""
import tracemalloc

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import (
    CORNERS,
    gap_of,
    gaps,
    parted_pairs,
    shortest_vector,
    witness,
    witnesses,
)

A, B = np.array([0]), np.array([1])
EPS = np.finfo(float).eps


def rectangles(*rows):
    """Return benches from rows of x, y, yaw, length and width."""
    x, y, yaw, length, width = np.array(rows, dtype=float).T
    return Benches(np.stack((x, y), 1), np.stack((np.cos(yaw), np.sin(yaw)), 1), length / 2, width / 2)


def by_shapely(benches, i=0, j=1):
    """Return the signed gap as the distance of the origin from the boundary of the corners' Minkowski difference.

    The difference is computed relative to bench i, so that large coordinates are not rounded twice; rectangles of zero
    size yield lines and points.
    """
    own = benches.centre[i]
    one, two = ((Benches(benches.centre[[n]] - own, benches.axis[[n]], benches.half_length[[n]],
                         benches.half_width[[n]])).corners[0] for n in (i, j))
    size = np.max(np.abs(np.concatenate((one, two))), initial=1e-300)
    hull = shapely.MultiPoint((two[:, None] - one).reshape(-1, 2) / size).convex_hull
    origin = shapely.Point(0, 0)
    outside = hull.distance(origin)
    flat = hull.geom_type != 'Polygon'
    return size * (outside if outside > 0 or flat else -hull.exterior.distance(origin))


def ulps(benches):
    """Return a few ulps of the coordinates and sizes."""
    return 16 * EPS * float(np.max(np.abs(benches.corners)))


size = st.one_of(st.just(0.0), st.floats(1e-3, 4))
bench = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-4, 4), size, size)


@given(bench, bench)
@example((0, 0, 0, 4, 0.1), (0, 0, np.pi / 2, 4, 0.1))
@example((0, 0, 0, 2, 1), (2, 1, 0, 2, 1))                  # corner on corner
@examples(200, long=400)
def test_the_gap_of_one_pair_has_the_bits_of_many(one, two):
    benches = rectangles(one, two)
    for i, j in ((0, 1), (1, 0)):
        assert gap_of(benches, i, j) == gaps(benches, np.array([i]), np.array([j]))[0]


@given(bench, bench)
@example((0, 0, 0, 2, 1), (0, 2, 0.3, 2, 1))
@example((0, 0, 0, 4, 0.1), (0, 0, np.pi / 2, 4, 0.1))      # crossing
@example((0, 0, 0.3, 4, 1), (0.1, 0, 0.3, 1, 0.5))          # nested
def test_the_shortest_vector_is_as_long_as_the_gap_and_brings_or_parts_the_benches(one, two):
    benches = rectangles(one, two)
    gap = gaps(benches, A, B)[0]
    for i, j in ((0, 1), (1, 0)):
        vector = np.array(shortest_vector(benches, i, j))
        assert np.hypot(*vector) == pytest.approx(abs(gap), rel=1e-9, abs=1e-12)
        moved = benches.centre.copy()
        moved[j] += -vector if gap > 0 else vector
        touching = Benches(moved, benches.axis, benches.half_length, benches.half_width)
        assert gaps(touching, A, B)[0] == pytest.approx(0, abs=1e-11)


@given(bench, bench, st.sampled_from([1e-6, 1.0, 1e3]), st.sampled_from([0.0, 1e4, 1e8]))
@example((0, 0, 0, 2, 1), (0, 1.0000001, 1e-9, 2, 1), 1.0, 0.0)         # near-parallel edges
@example((0, 0, 0.3, 4, 0.05), (0.1, 0, 0.3, 4, 0.05), 1.0, 1e8)        # parallel, nested
@example((0, 0, 0, 4, 0.1), (0, 0, np.pi / 2, 4, 0.1), 1e-6, 0.0)       # rectangles that cross, no corner inside
@example((0, 0, 0, 4, 0), (1, 0, 0, 4, 0), 1.0, 0.0)                    # coinciding lines
@example((0, 0, 0, 4, 0), (0, 0, 1.0, 4, 0), 1.0, 0.0)                  # lines that cross
@example((0, 0, 0, 0, 0), (3, 4, 1.0, 0, 0), 1.0, 1e8)                  # points
@example((0, 0, 0, 2, 2), (0.5, 0, 1.0, 0, 0), 1.0, 0.0)                # a point inside
@example((0, 0, 0, 2, 2), (0, 0, 0, 2, 2), 1.0, 0.0)                    # the same
@examples(200, long=400)
def test_gap_and_depth_agree_with_shapely(one, two, scale, far):
    rows = [(x * scale + far, y * scale - far, yaw, length * scale, width * scale)
            for x, y, yaw, length, width in (one, two)]
    benches = rectangles(*rows)
    expected = by_shapely(benches)
    tolerance = ulps(benches) + 1e-14 * scale
    for order in ((A, B), (B, A)):
        gap = gaps(benches, *order)[0]
        assert gap == pytest.approx(expected, abs=tolerance)
        if abs(expected) > tolerance:
            assert np.sign(gap) == np.sign(expected)


@given(st.floats(-4, 4), st.floats(-4, 4), st.sampled_from(range(4)), st.floats(-0.99, 0.99), st.sampled_from(range(4)),
       st.sampled_from([-1e-9, -1e-12, 0.0, 1e-12, 1e-9]), st.floats(0.01, 0.99))
def test_a_corner_close_to_an_edge_has_that_gap_and_is_the_witness(yaw, turn, corner, along, edge, off, lean):
    plate = rectangles((0.3, -0.2, yaw, 2.2, 1.6))
    outward = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])[edge]
    half = np.array([1.1, 0.8])
    touch = outward * half + along * half * (1 - np.abs(outward)) + off * outward
    # The second bench leans by 0.01 to 0.99 of a right angle, so that one of its corners is foremost.
    facing = (0, np.pi / 2, np.pi, -np.pi / 2)[corner]
    second_yaw = yaw + np.arctan2(-outward[1], -outward[0]) - lean * np.pi / 2 - facing
    second = rectangles((0, 0, second_yaw, 3.0, 0.4))
    world = np.array([plate.axis[0], [-plate.axis[0, 1], plate.axis[0, 0]]])
    foremost = int(np.argmin(second.corners[0] @ (outward @ world)))
    offset = plate.centre[0] + touch @ world - second.corners[0, foremost]
    both = rectangles((0.3, -0.2, yaw, 2.2, 1.6), (*offset, second_yaw, 3.0, 0.4))
    if abs(along) < 0.9:
        found = witness(both, 0, 1)
        assert found.gap_m == pytest.approx(off, abs=4e-15)
        assert (found.owner, found.other) == (1, 0)
        assert found.corner == CORNERS[foremost]
        assert found.edge == ('front', 'rear', 'left', 'right')[edge]
        middle = plate.centre[0] + (touch - 0.5 * off * outward) @ world
        assert found.point_m == pytest.approx(tuple(middle), abs=1e-14)


@pytest.mark.parametrize(('other', 'expected'), [
    ((0.3, 0.5 + np.sqrt(0.5), np.pi / 4, 1, 1), ((0.3, 0.5), 0.0, 1, 'rear right', 0, 'left')),
    ((3, 0, np.pi, 2, 0.2), ((1.5, -0.1), 1.0, 1, 'front left', 0, 'front')),
    ((0, 0.7, np.pi / 2, 2, 0.2), ((-0.1, 0.1), -0.8, 1, 'rear left', 0, 'left')),
    ((5, 5, 0, 2, 1), ((2.5, 2.5), 5.0, 0, 'front left', 1, 'right')),
])
def test_witness_of_known_rectangles(other, expected):
    found = witness(rectangles((0, 0, 0, 2, 1), other), 0, 1)
    point, gap, *features = expected
    assert [found.owner, found.corner, found.other, found.edge] == features
    assert found.gap_m == pytest.approx(gap, abs=1e-15)
    assert np.abs(found.point_m) == pytest.approx(np.abs(point), abs=1e-15)


@given(bench, bench)
def test_the_point_lies_half_the_gap_from_both_benches_when_apart(one, two):
    benches = rectangles(one, two)
    found = witness(benches, 0, 1)
    if found.gap_m > 1e-9:
        point = shapely.Point(found.point_m)
        for corners in benches.corners:
            assert shapely.MultiPoint(corners).convex_hull.distance(point) == pytest.approx(0.5 * found.gap_m, abs=1e-9)


@given(bench, bench)
def test_moving_the_owner_out_through_the_edge_parts_overlapping_benches(one, two):
    benches = rectangles(one, two)
    found = witness(benches, 0, 1)
    if found.gap_m >= -1e-9:
        return
    axis = benches.axis[found.other]
    normal = {'front': axis, 'rear': -axis, 'left': [-axis[1], axis[0]], 'right': [axis[1], -axis[0]]}[found.edge]
    centre = benches.centre.copy()
    centre[found.owner] -= found.gap_m * np.asarray(normal)
    moved = Benches(centre, benches.axis, benches.half_length, benches.half_width)
    assert gaps(moved, A, B)[0] == pytest.approx(0, abs=1e-13)
    corner = benches.corners[found.owner, CORNERS.index(found.corner)]
    edge = shapely.MultiPoint(benches.corners[found.other]).convex_hull
    assert shapely.Point(found.point_m).distance(edge) < 1e-9
    depth = (corner - benches.centre[found.other]) @ normal
    half = (benches.half_length if found.edge in ('front', 'rear') else benches.half_width)[found.other]
    assert depth - half == pytest.approx(found.gap_m, abs=1e-13)


def test_many_pairs_at_once_are_the_pairs_one_by_one():
    rng = np.random.default_rng(7)
    benches = rectangles(*rng.uniform((-3, -3, -4, 0, 0), (3, 3, 4, 2, 1), (60, 5)))
    i, j = np.triu_indices(60, 1)
    found = witnesses(benches, i, j)
    np.testing.assert_array_equal(found.gap_m, gaps(benches, i, j))
    for n in range(0, i.size, 37):
        assert found[n] == witness(benches, int(i[n]), int(j[n]))
    assert {*found.corner.tolist()} == {*found.edge.tolist()} == {0, 1, 2, 3}


@examples(50)
@given(st.integers(0, 2**32 - 1))
def test_the_axis_that_is_kept_of_a_pair_is_the_one_of_four_that_parts_it_best(seed):
    dice = np.random.default_rng(seed)
    benches = rectangles(*np.column_stack((dice.uniform(-4, 4, (12, 2)), dice.uniform(-4, 4, 12),
                                           dice.uniform(0.1, 3, (12, 2)))))
    i, j = np.triu_indices(12, 1)
    centre, axis = (value @ [1, 1j] for value in (benches.centre, benches.axis))
    kept, apart = parted_pairs(centre, axis, benches, i, j)
    corners = benches.corners
    best = np.full(i.size, -np.inf)
    for owner, other in ((i, j), (j, i)):
        for half, normal in ((benches.half_length, benches.axis),
                             (benches.half_width, benches.axis[:, ::-1] * [-1.0, 1.0])):
            seen = np.einsum('pcd,pd->pc', corners[other] - benches.centre[owner][:, None], normal[owner])
            best = np.maximum(best, np.maximum(np.min(seen, axis=1), -np.max(seen, axis=1)) - half[owner])
    np.testing.assert_allclose(apart, best, rtol=0, atol=1e-12)
    np.testing.assert_allclose(kept.separations(centre, axis, axis.conj()), best, rtol=0, atol=1e-12)
    assert np.array_equal(np.stack(kept.pairs), np.stack((i, j)))


def test_gaps_of_many_pairs_take_little_more_memory_than_their_result():
    count = 100_000
    rng, half = np.random.default_rng(1), np.full(1000, 0.5)
    benches = Benches(rng.uniform(-9, 9, (1000, 2)), np.tile([1.0, 0.0], (1000, 1)), half, half)
    i, j = rng.integers(0, 1000, (2, count))
    tracemalloc.start()
    try:
        gaps(benches, i, j)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 8 * count * 8         # a dozen arrays of all pairs would take more memory
