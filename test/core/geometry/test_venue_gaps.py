"""Gaps between benches and the edges of a venue agree with shapely."""
import gc
from weakref import ref

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.venue import surroundings_of
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue

SIDE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
HOLE = ((1.0, 1.0), (3.0, 1.0), (3.0, 3.0))
VENUE = Venue((LineObstacle('wall', ((10.0, 0.0), (10.0, 5.0), (12.0, 7.0))), PolygonObstacle('house', SIDE, (HOLE,))),
              ((-20.0, -20.0), (40.0, -20.0), (40.0, 40.0), (-20.0, 40.0)))
GEOMETRIES = [shapely.LineString(VENUE.obstacles[0].points_m), shapely.LinearRing(SIDE), shapely.LinearRing(HOLE),
              shapely.LinearRing(VENUE.inside)]
OWNERS = [0, 1, 1, 2]


def benches(rows):
    x, y, angle, half_length, half_width = np.array(rows).T
    return Benches(np.stack((x, y), 1), np.stack((np.cos(angle), np.sin(angle)), 1), half_length, half_width)


ROWS = st.lists(st.tuples(*[st.floats(-19, 39)] * 2, st.floats(-7, 7), st.floats(0.1, 3), st.floats(0.05, 0.5)),
                min_size=1, max_size=6)


@examples(60)
@given(ROWS)
def test_the_nearest_edge_is_as_far_as_shapely_says(rows):
    around, some = surroundings_of(VENUE), benches(rows)
    near = around.nearest(some)
    distance = [[shapely.distance(shapely.Polygon(one), other) for other in GEOMETRIES] for one in some.corners]
    assert max(near.gap_m, 0.0) == pytest.approx(np.min(distance), abs=1e-12)
    bench, number, gap_m = around.touching(some)
    met = {(n, owner) for n, row in enumerate(distance) for owner, away in zip(OWNERS, row, strict=True) if away == 0}
    assert set(zip(bench.tolist(), number.tolist(), strict=True)) == met
    assert np.all(np.diff(gap_m) >= 0)
    assert np.all(gap_m <= 0)


@examples(60)
@given(ROWS)
def test_a_bench_moved_by_its_overlap_only_touches(rows):
    """The signed gap of an overlap is minus the length of the shortest move that ends the overlap."""
    around, some = surroundings_of(VENUE), benches(rows[:1])
    near = around.nearest(some)
    if near.gap_m < -1e-9:
        edge = shapely.LineString([(around.start[near.edge].real, around.start[near.edge].imag),
                                   (around.stop[near.edge].real, around.stop[near.edge].imag)])
        ways = np.exp(1j * np.linspace(0, 2 * np.pi, 361))
        less, apart = [], []
        for way in ways:
            for moves, share in ((less, 0.999), (apart, 1.002)):
                move = -share * near.gap_m * way
                moves.append(shapely.distance(shapely.Polygon(some.corners[0] + (move.real, move.imag)), edge))
        assert max(less) == 0 < max(apart)


def test_a_point_in_a_polygon_or_outside_of_the_inside_is_misplaced():
    around = surroundings_of(VENUE)
    assert around.misplaced(0.5, 0.5) == 1
    assert around.misplaced(2.5, 2.0) is None       # in the courtyard
    assert around.misplaced(-21.0, 0.0) == around.inside == 2
    assert around.misplaced(11.0, 2.0) is None


def test_edges_are_kept_as_long_as_their_venue():
    gc.freeze()     # so that only the objects of this test are visited
    venue = Venue((LineObstacle('wall', ((10.0, 0.0), (10.0, 5.0))),))
    around = surroundings_of(venue)
    assert surroundings_of(venue) is around
    kept = ref(around)
    del venue, around
    gc.collect()
    gc.unfreeze()
    assert kept() is None


@pytest.mark.parametrize('name', ['a', 'inside the wall', 'zaun'])
def test_a_venue_has_an_inside_only_if_it_says_so_whatever_its_obstacles_are_called(name):
    wall = LineObstacle(name, ((10.0, 0.0), (10.0, 5.0)))
    assert surroundings_of(Venue((wall,))).inside is None
    assert surroundings_of(Venue((wall,), VENUE.inside)).inside == 1
