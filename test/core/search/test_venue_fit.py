"""The smallest gaps of a run to the obstacles of a venue, against shapely at many instants."""
from dataclasses import replace

import numpy as np
import pytest
import shapely

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.venue import surroundings_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.bounding_box import HandleRanges, bench_of, by_length, intervals_of
from dragon_ros.core.search.venue_fit import _Nearing, venue_fit
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, STurn
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue
from dragon_ros.scenes.load import load_scene

STREET = Composite((Line(12.0), Arc(4.0, 90.0), Line(6.0), Arc(4.0, -90.0), Line(12.0)), 4.0)
MIXED = Mixed((Group(3.41), Group(2.2, 3), Group(1.5, 2)))
SCENES = {
    'street': Scene(Dragon(8), STREET, run=Run(stop_s=20.0)),
    'mixed street by the tail': Scene(MIXED, STREET, Head(1.0, 'tail'), Run(stop_s=9.0)),
    'back and forth': Scene(Dragon(6), STREET, Profile(((0.0, 2.0), (8.0, -1.0), (16.0, 1.0))), Run(2.0, 18.0)),
    'turn': Scene(Dragon(10), STurn(before_m=3.0), run=Run(stop_s=18.0)),
    'spiral': Scene(Dragon(12), Spiral(0.55, 5.0), run=Run(stop_s=60.0)),
    'mixed spiral': Scene(MIXED, Spiral(0.7, 4.0), Profile(((0.0, 1.0), (30.0, -0.5))), Run(stop_s=40.0)),
    'links of no length': Scene(Dragon(4, 0.6, 0.5, 0.2, 0.25), STREET, run=Run(stop_s=16.0))}
STEP_S = 0.02


def venue(scene, seed):
    """Return obstacles near where the dragon goes, some in its way."""
    rng = np.random.default_rng(seed)
    run = compile_scene(scene)
    line, obstacles, start = run.track_line(0.05), [], shapely.Point(sampled(scene, 9.0)[0, 0].mean(axis=0))
    for n in range(7):
        x, y = line[rng.integers(len(line))] + rng.normal(0, 2.5, 2)
        angle, size = np.sort(rng.uniform(0, 2 * np.pi, 5)), rng.uniform(0.1, 2.0)
        points = tuple((float(x + size * np.cos(one)), float(y + size * np.sin(one))) for one in angle)
        if n % 3 == 0 or shapely.Polygon(points).covers(start):
            obstacles.append(LineObstacle(f'{n}', points))
        else:
            obstacles.append(PolygonObstacle(f'{n}', points))
    return Venue(tuple(obstacles), ((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)))


def sampled(scene, step_s):
    """Return the corners of all benches (T, N, 4, 2) at many instants."""
    end_s = compile_scene(scene).end.t_s
    times = np.linspace(scene.run.start_s, end_s, 2 + int((end_s - scene.run.start_s) / step_s)).tolist()
    chain = states(scene, times)
    return benches_of(chain, scene.dragon, axes_of(chain)).corners


def checked(scene, seed, step_s=STEP_S):
    scene = replace(scene, venue=venue(scene, seed))
    found = venue_fit(scene)
    polygons = shapely.polygons(sampled(scene, step_s).reshape(-1, 4, 2))
    lines = {one.name: shapely.LineString([*one.points_m, *one.points_m[:isinstance(one, PolygonObstacle)]])
             for one in scene.venue.obstacles} | {'inside': shapely.LinearRing(scene.venue.inside)}
    assert {one.name for one in found.gaps} == set(lines)
    for one in found.gaps:
        brute = float(np.min(shapely.distance(polygons, lines[one.name])))
        assert one.low_m <= brute + 1e-12, (one, brute)
        assert max(one.high_m, 0.0) >= brute - 3 * step_s, (one, brute)
        assert one.high_m <= brute + 1.1e-6 if brute > 0 else one.high_m <= 0.0, (one, brute)
        assert one.high_m - one.low_m < 1.1e-6
    return found


@pytest.mark.parametrize('name', SCENES)
def test_gaps_are_those_of_shapely(name):
    checked(SCENES[name], 1)


def test_gaps_are_those_of_shapely_in_many_venues(request):
    for seed in range(2, 32 if request.config.getoption('--long', default=False) else 3):
        for scene in SCENES.values():
            checked(scene, seed, 0.05)


def test_bounds_hold_between_the_ends_of_cells():
    """Each is below all sampled gaps in between; without half of what corners go it would not be."""
    for name, scene in SCENES.items():
        around, ranges = surroundings_of(venue(scene, 3)), HandleRanges(scene)
        for benches in by_length(scene.dragon.bench_lengths_m):
            search = _Nearing(around, 1e-6, lambda looks: None)
            search._bench = bench_of(ranges, int(benches[0]))
            low, high = intervals_of(ranges, benches)[:, 0]
            places = np.linspace(low, high, 25)
            edge = np.repeat(np.arange(around.owner.size), 24)
            index = np.tile(np.arange(24), around.owner.size)
            at = search._bench.states(places)
            ends = [at.rows(index), at.rows(index + 1)]
            bound = search._bounds(ends, [search._gaps(one, edge) for one in ends], edge)
            least = np.full(edge.size, np.inf)
            for share in np.linspace(0, 1, 15):
                between = search._bench.states(places[:-1] + share * np.diff(places))
                least = np.minimum(least, search._gaps(between.rows(index), edge))
            assert np.all(bound <= least + 1e-11), name


def test_a_parallel_wall_takes_few_looks_and_its_gap_is_exact():
    scene = Scene(Dragon(5), Composite((Line(200.0),), 20.0), run=Run(stop_s=150.0),
                  venue=Venue((LineObstacle('wall', ((-50.0, 1.0), (250.0, 1.0))),), margin_m=0.85))
    found = venue_fit(scene)
    assert found.gaps[0].high_m == pytest.approx(0.85, abs=1e-12)
    assert found.looks < 2000
    assert found.fits is None       # the margin lies between the bounds
    assert venue_fit(replace(scene, venue=replace(scene.venue, margin_m=0.84))).fits is True
    lacking = venue_fit(replace(scene, venue=replace(scene.venue, margin_m=0.86)))
    assert lacking.fits is False
    assert [one.name for one in lacking.lacking] == ['wall']


def test_the_shipped_scenes_fit_and_a_scene_without_a_venue_has_no_gaps():
    assert venue_fit(load_scene('street')).fits is True
    assert venue_fit(load_scene('square')).fits is True
    tent = Venue((PolygonObstacle('tent', ((-99.0, -99.0), (99.0, -99.0), (99.0, 99.0), (-99.0, 99.0))),))
    with pytest.raises(FieldError, match='tent.*covers the dragon'):
        venue_fit(replace(SCENES['street'], venue=tent))
    with pytest.raises(FieldError, match='venue: None is not possible, the scene has none'):
        venue_fit(Scene())
