"""Near misses are local minima of the gap of any pair, for any track, law, leader and mix of benches."""
from functools import lru_cache

import numpy as np
import pytest
import shapely
import venues
from properties import thinned

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search import near_misses as module
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.near_misses import near_misses
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.core.venue import LineObstacle, Venue

IN_AND_OUT = Profile(((0.0, 1.0), (3.0, 1.0), (5.0, -1.0), (9.0, -1.0), (12.0, 1.0)))
SCENES = {
    'classic': (Scene(run=Run(400, 412.4)), 0.03),
    'tail': (Scene(dragon=Dragon(40), track=Spiral(0.6, 4.0), head=Head(1.0, 'tail'), run=Run(0, 12)), 0.12),
    'in and out': (Scene(dragon=Dragon(40), track=Spiral(0.55, 4.5), head=IN_AND_OUT, run=Run(0, 16)), 0.07),
    'body': (Scene(dragon=Dragon(30, 2.2, 2.2), track=Spiral(0.6, 4.0), run=Run(0, 10)), 0.09),
    'turn': (Scene(dragon=Dragon(60), track=STurn(1.2, before_m=100.0), run=Run(100, 120)), 0.4),
    'spiral and arc': (Scene(dragon=Dragon(40),
                             track=Composite((SpiralArc(0.5, 8.0, 5.0), Arc(2.5, -90.0), Line(30.0))),
                             run=Run(30, 70)), 0.1),
    'tail on a loop': (Scene(dragon=Dragon(10), head=Head(1.0, 'tail'), run=Run(0, 30), track=Composite(
        (Line(50.0), Arc(3.0, -200.0), Line(1.0), Arc(2.8, -200.0)), start_m=68.0)), 1.05),
    'mixed': (Scene(dragon=Mixed((Group(3.41), *(Group(one) for _ in range(8) for one in (2.2, 1.7)))),
                    track=Spiral(0.6, 4.0), run=Run(0, 10)), 0.09)}


def pairs_near(benches, below_m):
    """Return the pairs of benches whose circumscribed circles come closer than ``below_m`` at any of the times."""
    i, j = np.triu_indices(benches.centre.shape[1], 2)
    reach_m = np.hypot(benches.half_length, benches.half_width)
    near = np.zeros(i.size, dtype=bool)
    for centre in benches.centre:
        near |= np.hypot(*(centre[i] - centre[j]).T) < reach_m[i] + reach_m[j] + below_m
    return i[near], j[near]


def gaps_at(benches, times, i, j):
    """Return the gaps of pairs of benches at the times with these indices (shape (times, pairs))."""
    count = benches.centre.shape[1]
    every = type(benches)(benches.centre[times].reshape(-1, 2), benches.axis[times].reshape(-1, 2),
                          np.tile(benches.half_length, times.size), np.tile(benches.half_width, times.size))
    first = count * np.arange(times.size)[:, None]
    return gaps(every, (first + i).ravel(), (first + j).ravel()).reshape(times.size, -1)


def scanned(scene, below_m, end_s, per_s=100):
    """Return the local minima of all gaps in a scan over time, as (pair, time, gap)."""
    times = np.arange(scene.run.start_s, end_s, 1 / per_s)
    chain = states(scene, times.tolist())
    benches = benches_of(chain, scene.dragon, axes_of(chain))
    i, j = pairs_near(benches, below_m)
    gap = np.vstack([gaps_at(benches, part, i, j) for part in np.array_split(np.arange(times.size), times.size // 50)])
    low = (gap[1:-1] < gap[:-2]) & (gap[1:-1] <= gap[2:]) & (gap[1:-1] < below_m)
    deep = np.maximum(gap[:-2], gap[2:]) - gap[1:-1] > 1e-8
    return [((int(i[column]), int(j[column])), times[row + 1], gap[row + 1, column])
            for row, column in np.argwhere(low & deep)]


@lru_cache
def answers(name):
    """Return the first contact of a scene and its near misses."""
    scene, below_m = SCENES[name]
    found = first_contact(scene)
    return found, near_misses(scene, found, below_m)


@pytest.mark.parametrize('name', thinned(SCENES, lambda name: name == 'mixed'))
def test_near_misses_are_the_local_minima_of_a_dense_scan(name):
    scene, below_m = SCENES[name]
    found, told = answers(name)
    end_s = getattr(found, 't_s', compile_scene(scene).end.t_s)
    assert told.count == len(told.nearest)
    assert [miss.gap_m for miss in told.nearest] == sorted(miss.gap_m for miss in told.nearest)
    wanted = [row for row in scanned(scene, below_m - 1e-5, end_s) if row[1] < end_s - 0.02]
    assert wanted
    for pair, t_s, gap_m in wanted:
        near = [miss for miss in told.nearest if miss.benches == pair and abs(miss.t_s - t_s) < 0.012]
        assert near, (pair, t_s, gap_m)
        assert min(miss.gap_m for miss in near) <= gap_m + 1e-9
    for miss in told.nearest:
        times = [max(scene.run.start_s, miss.t_s - 0.005), miss.t_s, min(end_s, miss.t_s + 0.005)]
        chain = states(scene, times)
        benches = benches_of(chain, scene.dragon, axes_of(chain))
        here = [float(gaps(type(benches)(benches.centre[n], benches.axis[n], benches.half_length, benches.half_width),
                           *(np.array([bench]) for bench in miss.benches))[0]) for n in range(3)]
        assert here[1] == pytest.approx(miss.gap_m, abs=1e-7)
        assert here[1] <= min(here) + 1e-7


def test_a_place_that_is_passed_twice_gives_two():
    told = answers('in and out')[1].nearest
    times = [miss.t_s for miss in told if miss.benches == told[0].benches and miss.gap_m == told[0].gap_m]
    assert len(times) >= 2
    law = SCENES['in and out'][0].head
    assert np.ptp([law.travelled_m(t_s) for t_s in times]) < 1e-6


def test_a_long_list_is_cut_to_the_nearest_and_says_so(monkeypatch):
    scene, below_m = SCENES['in and out']
    found, every = answers('in and out')
    monkeypatch.setattr(module, 'MOST', 5)
    few = near_misses(scene, found, below_m)
    assert every.count > 5 == len(few.nearest)
    assert few.count > 5
    assert few.nearest[0] == every.nearest[0]


@pytest.mark.parametrize('name', thinned(['spiral', 'mixed spiral', 'spiral led by the tail, back and on'],
                                         lambda name: name == 'mixed spiral'))
def test_near_misses_of_obstacles_are_the_local_minima_that_shapely_sees(name):
    below_m, step_m = 0.2, 0.01
    scene = venues.with_venue((venues.SCENES | venues.MORE)[name], 12 if name == 'spiral' else 11)
    found = first_contact(scene)
    times = venues.times_of(scene, step_m, found.t_s if found else compile_scene(scene).end.t_s)
    boxes, wanted = shapely.polygons(venues.corners_at(scene, times)), []
    for obstacle, line in venues.edges_of(scene.venue).items():
        away = shapely.distance(boxes, line)
        low = (away[1:-1] < away[:-2]) & (away[1:-1] <= away[2:]) & (away[1:-1] < below_m - 1e-3)
        wanted += [(bench, obstacle, times[n + 1], away[n + 1, bench]) for n, bench in np.argwhere(low)]
    told = [(*one.benches, one.obstacle, one.t_s, one.gap_m) for one in near_misses(scene, found, below_m).nearest
            if one.obstacle]
    assert len(wanted) >= 3
    assert {one[:2] for one in told if one[3] < below_m - 1e-3} <= {one[:2] for one in wanted}
    for bench, obstacle, t_s, gap_m in wanted:
        assert any(one[:2] == (bench, obstacle) and abs(one[2] - t_s) < 2 * step_m
                   and gap_m - 1e-3 < one[3] <= gap_m + 1e-12 for one in told), (bench, obstacle, t_s, gap_m)


def test_a_bench_that_turns_back_before_a_wall_misses_it_there():
    law = Profile(((0.0, 1.0), (9.0, 1.0), (11.0, -1.0)))
    scene = Scene(Dragon(3), Composite((Line(60.0),), 20.0), law, Run(stop_s=15.0),
                  venue=Venue((LineObstacle('wall', ((29.875, -1.0), (29.875, 1.0))),)))
    (miss,) = near_misses(scene, first_contact(scene), 0.2).nearest     # the front of the head reaches x = 29.775 m
    assert (miss.benches, miss.obstacle, miss.bench) == ((0,), 'wall', 0)
    assert (miss.t_s, miss.gap_m) == (pytest.approx(10.0), pytest.approx(0.1))
