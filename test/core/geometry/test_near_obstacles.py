"""Stored near edges affect only the time that an evaluation takes, and the results agree with shapely."""
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from properties import examples

from dragon_ros.core.geometry import near_obstacles
from dragon_ros.core.geometry.near_obstacles import NearObstacles, with_obstacles
from dragon_ros.core.geometry.near_pairs import closeness
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.venue import surroundings_of
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue


def told(found):
    return found.clearance_m, found.closest, found.i.tolist(), found.j.tolist(), found.gap_m.tolist()


def benches_at(centre, yaw, half_length, half_width):
    return Benches(centre, np.stack((np.cos(yaw), np.sin(yaw)), 1), half_length, half_width)


def square(x, y, half):
    return (x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)


def random_venue(rng):
    """Return a yard with a large house around a courtyard, small houses, bent walls, and sometimes a boundary."""
    obstacles = [PolygonObstacle('large', square(0, 0, 9.0), (square(0, 0, 6.0),))]
    for n in range(int(rng.integers(0, 6))):
        x, y, half = *rng.uniform(-30, 30, 2).tolist(), float(rng.uniform(0.1, 5))
        obstacles.append(PolygonObstacle(f'house {n}', square(x, y, half)))
    for n in range(int(rng.integers(1, 5))):
        points = np.cumsum(rng.normal(0, 4, (int(rng.integers(2, 9)), 2)), axis=0)
        obstacles.append(LineObstacle(f'wall {n}', tuple(map(tuple, points.tolist()))))
    return Venue(tuple(obstacles), square(0, 0, 25.0) if rng.integers(2) else None)


@st.composite
def walks(draw):
    """Draw a venue, and layouts of benches that walk, drift, turn on the spot, rest or jump in it."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    count = int(rng.integers(1, 14))
    centre, yaw = rng.uniform(-28, 28, (count, 2)), rng.uniform(-4, 4, count)
    sizes = rng.uniform(0.2, 1.7, count), rng.uniform(0.05, 0.3, count)
    pace, spin = draw(st.sampled_from([(0.02, 0.0), (0.3, 0.05), (0.0, 0.3), (2.0, 0.0)]))
    velocity, looks = rng.normal(0, pace, (count, 2)), []
    for _ in range(20):
        looks.append(benches_at(centre, yaw, *sizes))
        centre, yaw = centre + velocity, yaw + spin * rng.normal(0, 1, count)
        if rng.random() < 0.05:
            centre = rng.uniform(-28, 28, (count, 2))
    return random_venue(rng), looks


def with_handles(benches):
    return closeness(np.concatenate((benches.centre, benches.centre[:1])), benches)


@examples(15, long=25)
@given(walks())
def test_looks_at_any_walk_equal_a_search_from_scratch_to_the_last_bit(walk):
    venue, looks = walk
    around = surroundings_of(venue)
    near = NearObstacles(around)
    for benches in looks:
        found = with_handles(benches)
        assert told(near.look(found, benches)) == told(with_obstacles(around, found, benches))


def areas_of(venue):
    return [(n, shapely.Polygon(one.points_m, one.holes_m)) for n, one in enumerate(venue.obstacles)
            if isinstance(one, PolygonObstacle)]


@examples(25)
@given(walks())
def test_a_bench_touches_what_shapely_says_and_is_as_far_from_the_rest(walk):
    venue, looks = walk
    around, count = surroundings_of(venue), len(looks[0].half_length)
    shapes = dict(areas_of(venue)) | {n: shapely.LineString(one.points_m) for n, one in enumerate(venue.obstacles)
                                      if isinstance(one, LineObstacle)}
    for benches in looks[::7]:
        rectangles = [shapely.Polygon(corners) for corners in benches.corners]
        met = {(b, n) for b, one in enumerate(rectangles) for n, shape in shapes.items() if one.intersects(shape)}
        if venue.inside:
            inside = shapely.Polygon(venue.inside)
            met |= {(b, len(shapes)) for b, one in enumerate(rectangles) if not inside.contains(one)}
        alone = with_handles(benches)
        found = with_obstacles(around, alone, benches)
        assert {(i, j - count) for i, j in zip(found.i.tolist(), found.j.tolist(), strict=True) if j >= count} == met
        if not met:
            boundary = [*shapes.values(), *([shapely.LinearRing(venue.inside)] if venue.inside else [])]
            least = min(one.distance(other) for one in rectangles for other in boundary)
            assert found.clearance_m == pytest.approx(min(least, alone.clearance_m), abs=1e-9)


def test_a_bench_that_is_wholly_inside_an_obstacle_or_outside_the_inside_is_in_contact():
    venue = Venue((PolygonObstacle('hall', square(0, 0, 9.0)),), square(0, 0, 20.0))
    around = surroundings_of(venue)
    some = benches_at(np.array([[0.0, 0.0], [15.0, 0.0], [30.0, 0.0]]), np.zeros(3), np.full(3, 1.0), np.full(3, 0.2))
    found = with_obstacles(around, with_handles(some), some)
    assert told(found) == (-9.0, (2, 4), [2, 0], [4, 3], [-9.0, -8.0])


def test_few_pairs_are_computed_while_a_dragon_walks_along_a_wall(monkeypatch):
    """Distances to a wall are not computed pair by pair while they do not change."""
    wall = LineObstacle('wall', tuple((float(x), 1.0) for x in range(400)))
    around, computed = surroundings_of(Venue((wall,))), []
    near, real = NearObstacles(around), near_obstacles.gap_of
    monkeypatch.setattr(near_obstacles, 'gap_of', lambda *a: computed.append(1) or real(*a))
    x = np.arange(10.0, 110.0, 2.0)
    for k in range(100):
        some = benches_at(np.stack((x + 0.02 * k, np.where(x == 50, 0.3, 0.0)), 1), np.zeros(x.size),
                          np.full(x.size, 0.9), np.full(x.size, 0.2))
        found = near.look(with_handles(some), some)
        assert found.closest[1] >= x.size or found.clearance_m < 0.5
    assert len(computed) < 100 * 6


def test_a_bench_that_walks_into_an_obstacle_and_out_of_it_stays_in_contact_while_it_is_inside():
    """One list of near edges is valid for all samples, since the other bench is long."""
    around = surroundings_of(Venue((PolygonObstacle('house', square(0, 0, 0.5)),)))
    near, touched = NearObstacles(around), []
    for k in range(32):
        some = benches_at(np.array([[-1.6 + 0.1 * k, 0.0], [0.0, 30.0]]), np.zeros(2), np.array([0.1, 9.0]),
                          np.array([0.05, 0.2]))
        found = with_handles(some)
        seen = near.look(found, some)
        assert told(seen) == told(with_obstacles(around, found, some))
        touched.append(seen.i.size)
    assert touched == [0] * 10 + [1] * 13 + [0] * 9
