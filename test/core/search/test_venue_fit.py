"""The smallest gaps between a run and the obstacles of a venue agree with shapely at many instants."""
from dataclasses import replace

import numpy as np
import pytest
import shapely
from properties import thinned
from venues import SCENES, corners_at, edges_of, random_venue

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.enclosures.ball_arithmetic import Ball
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.rectangles import corner_levers
from dragon_ros.core.geometry.signed_distance import rounding_m
from dragon_ros.core.geometry.venue import surroundings_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.bounding_box import HandleRanges, SweptBench, by_length, intervals_of
from dragon_ros.core.search.obstacle_bounds import ObstacleBounds, least_along
from dragon_ros.core.search.venue_fit import venue_fit
from dragon_ros.core.tracks.spec import Composite, Line
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue
from dragon_ros.scenes.load import load_scene

STEP_S = 0.02


def sampled(scene, step_s):
    """Return the corners of all benches at many instants (shape (T, N, 4, 2))."""
    end_s = compile_scene(scene).end.t_s
    return corners_at(scene, np.linspace(scene.run.start_s, end_s, 2 + int((end_s - scene.run.start_s) / step_s)))


def checked(scene, seed, step_s=STEP_S):
    scene = replace(scene, venue=random_venue(scene, seed))
    found = venue_fit(scene)
    polygons = shapely.polygons(sampled(scene, step_s).reshape(-1, 4, 2))
    lines = edges_of(scene.venue)
    assert {one.name for one in found.gaps} == set(lines)
    for one in found.gaps:
        brute = float(np.min(shapely.distance(polygons, lines[one.name])))
        assert one.low_m <= brute + 1e-12, (one, brute)
        assert max(one.high_m, 0.0) >= brute - 3 * step_s, (one, brute)
        assert one.high_m <= brute + 1.1e-6 if brute > 0 else one.high_m <= 0.0, (one, brute)
        assert one.high_m - one.low_m < 1.1e-6
    return found


@pytest.mark.parametrize('name', thinned(SCENES, ('street', 'mixed street led by the tail').__contains__))
def test_gaps_are_those_of_shapely(name):
    checked(SCENES[name], 1)


@pytest.mark.long
def test_gaps_are_those_of_shapely_in_many_venues():
    for seed in range(2, 12):
        for scene in SCENES.values():
            checked(scene, seed, 0.05)


def test_bounds_hold_between_the_ends_of_cells():
    """Each bound is below all sampled gaps in between, but would not be if it used only half of the corners' travel."""
    for name, scene in SCENES.items():
        around, ranges = surroundings_of(random_venue(scene, 3)), HandleRanges(scene)
        for benches in by_length(scene.dragon.bench_lengths_m):
            bounds = ObstacleBounds(SweptBench.of(ranges.track, ranges.scene.dragon, int(benches[0])), around)
            low, high = intervals_of(ranges, benches)[:, 0]
            places = np.linspace(low, high, 13)
            edge = np.repeat(np.arange(around.owner.size), 12)
            index = np.tile(np.arange(12), around.owner.size)
            at = bounds.bench.states(places)
            ends = [at.rows(index), at.rows(index + 1)]
            bound = bounds.bounds(*ends, (bounds.gaps(ends[0], edge), bounds.gaps(ends[1], edge)), edge)
            least = np.full(edge.size, np.inf)
            for share in np.linspace(0, 1, 9):
                between = bounds.bench.states(places[:-1] + share * np.diff(places))
                least = np.minimum(least, bounds.gaps(between.rows(index), edge))
            assert np.all(bound <= least + 1e-11), name


def least_of(d, start, stop, middle, radius, h, moved_m=np.inf):
    """Return the bound for four corners with equal motion; ``middle`` and ``radius`` are complex (x as real part)."""
    slope = Ball(*(np.tile([one.real, 0.0, one.imag], (1, 4, 1)) for one in (complex(middle), complex(radius))))
    ends = np.full((1, 4), complex(start)), np.full((1, 4), complex(stop))
    found = least_along(np.array([complex(d)]), ends, slope, 0.0, np.full((1, 1), h), np.full((1, 4), moved_m))
    assert found.shape == (1, 4)
    return float(np.max(found))


@pytest.mark.parametrize('d', [1, 1j, -1, -1j])
def test_a_corner_that_turns_back_as_sharply_as_its_slopes_allow_is_at_its_least_coordinate(d):
    """The corner moves against the direction at full speed, then along it; the bound is exact for a ball around 0."""
    start, radius, h = 2.0 - 1.0j, 1.5, 0.3
    for middle in (0.0, 0.4, -0.7, -2.5):
        met = start + d * (middle - radius) * h / 2
        stop = met + d * (middle + radius) * h / 2
        least = min((np.conj(d) * one).real for one in (start, met, stop))
        bound = least_of(d, start, stop, middle * d, radius * (1 if d in (1, -1) else 1j), h)
        assert bound <= least + 1e-12
        assert bound == pytest.approx(least, abs=abs(middle) * h)


def test_a_corner_whose_slopes_reach_the_corner_of_their_box_is_not_below_the_bound():
    d, radius, h = np.exp(0.25j * np.pi), 1.5 + 1.5j, 0.3
    met = -radius * h / 2
    assert least_of(d, 0.0, 0.0, 0.0, radius, h) <= (np.conj(d) * met).real + 1e-12


def test_a_corner_that_goes_out_and_back_is_at_its_least_coordinate():
    d, start, moved_m = np.exp(2j), 1.0 + 3.0j, 0.7
    found = least_of(d, start, start, 9.0, 9.0 + 9.0j, 1.0, moved_m)
    assert found == pytest.approx((np.conj(d) * start).real - moved_m / 2, abs=1e-12)


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


def test_the_error_of_a_gap_covers_the_rounding_of_a_bench_that_is_wider_than_long():
    wide = Dragon(3, 2.2, 2.2, 60.0)
    scene = Scene(wide, Composite((Line(200.0),), 20.0), run=Run(stop_s=1.0),
                  venue=Venue((LineObstacle('wall', ((-50.0, 1e3), (250.0, 1e3))),)))
    simulation = compile_scene(scene)
    levers = corner_levers(wide)
    promise_m = float(levers[0]) * simulation.promise_m
    assert venue_fit(scene).gaps[0].error_m - promise_m > 0.999 * rounding_m(1e3, 0.5 * (2.2 + 60.0))


def test_the_shipped_scenes_fit_and_a_scene_without_a_venue_has_no_gaps():
    assert venue_fit(load_scene('street')).fits is True
    assert venue_fit(load_scene('square')).fits is True
    tent = Venue((PolygonObstacle('tent', ((-99.0, -99.0), (99.0, -99.0), (99.0, 99.0), (-99.0, 99.0))),))
    with pytest.raises(FieldError, match='tent.*covers the dragon'):
        venue_fit(replace(SCENES['street'], venue=tent))
    with pytest.raises(FieldError, match='venue: None is not valid: the scene has no venue'):
        venue_fit(Scene())
