"""Scenes with random venues and shapely's results for them at many instants; shared by the tests of several rooms."""
from dataclasses import replace

import numpy as np
import shapely

from dragon_ros.core.batches import states
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue

STREET = Composite((Line(12.0), Arc(4.0, 90.0), Line(6.0), Arc(4.0, -90.0), Line(12.0)), 4.0)
MIXED = Mixed((Group(3.41), Group(2.2, 3), Group(1.5, 2)))
SCENES = {
    'street': Scene(Dragon(8), STREET, run=Run(stop_s=20.0)),
    'mixed street led by the tail': Scene(MIXED, STREET, Head(1.0, 'tail'), Run(stop_s=9.0)),
    'back and forth': Scene(Dragon(6), STREET, Profile(((0.0, 2.0), (8.0, -1.0), (16.0, 1.0))), Run(2.0, 18.0)),
    'turn': Scene(Dragon(10), STurn(before_m=3.0), run=Run(stop_s=18.0)),
    'spiral': Scene(Dragon(12), Spiral(0.55, 5.0), run=Run(stop_s=60.0)),
    'mixed spiral': Scene(MIXED, Spiral(0.7, 4.0), Profile(((0.0, 1.0), (30.0, -0.5))), Run(stop_s=40.0)),
    'the smallest links': Scene(Dragon(4, 0.6, 0.55, 0.2, 0.25), STREET, run=Run(stop_s=16.0))}
MORE = {
    'coils': Scene(Dragon(7), Composite((Line(6.0), SpiralArc(1.5, 3.0, 2.0, 'left'), Line(4.0)), 3.0),
                   run=Run(stop_s=25.0)),
    'the smallest link': Scene(Dragon(2, 0.6, 0.55, 0.2, 0.25), STREET, run=Run(stop_s=16.0)),
    'spiral led by the tail, back and on': Scene(Dragon(9), Spiral(1.2, 4.0), Profile(
        ((0.0, 1.0), (8.0, 1.0), (10.0, -1.0), (13.0, -1.0), (15.0, 1.0), (30.0, 1.0)), lead='tail'), Run(stop_s=30.0)),
    'turn led by the tail': Scene(Dragon(8), STurn(before_m=12.0), Head(1.0, 'tail'), Run(stop_s=10.0))}
AROUND = ((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0))


def random_venue(scene, seed, largest_m=2.0):
    """Return a venue with obstacles near or on the dragon's path; none covers the middle of the head at the start."""
    rng = np.random.default_rng(seed)
    line, obstacles = compile_scene(scene).track_line(0.05), []
    start = shapely.Point(corners_at(scene, [scene.run.start_s])[0, 0].mean(axis=0))
    for n in range(7):
        x, y = line[rng.integers(len(line))] + rng.normal(0, 2.5, 2)
        angle, size = np.sort(rng.uniform(0, 2 * np.pi, 5)), rng.uniform(0.1, largest_m)
        points = tuple((float(x + size * np.cos(one)), float(y + size * np.sin(one))) for one in angle)
        if n % 3 == 0 or shapely.Polygon(points).covers(start):
            obstacles.append(LineObstacle(f'{n}', points))
        else:
            obstacles.append(PolygonObstacle(f'{n}', points))
    return Venue(tuple(obstacles), AROUND)


def corners_at(scene, times_s):
    """Return the corners of all benches at the given times (shape (T, N, 4, 2))."""
    chain = states(scene, list(times_s))
    return benches_of(chain, scene.dragon, axes_of(chain)).corners


def times_of(scene, step_m, until_s=None):
    """Return times of the run up to a given time; between neighbouring times the leader moves at most one step."""
    end_s = compile_scene(scene).end.t_s if until_s is None else until_s
    knots = [speed for _, speed in scene.head.knots] if isinstance(scene.head, Profile) else [scene.head.speed_m_s]
    start_s, fastest = scene.run.start_s, max(map(abs, knots))
    return np.linspace(start_s, end_s, 2 + int((end_s - start_s) * fastest / step_m))


def edges_of(venue):
    """Return the edges that benches must not touch, by name, as shapely lines."""
    lines = {one.name: shapely.LineString([*one.points_m, *one.points_m[:isinstance(one, PolygonObstacle)]])
             for one in venue.obstacles}
    return lines | ({'inside': shapely.LinearRing(venue.inside)} if venue.inside else {})


def touched_at(scene, times_s, at_once=2000):
    """Return for each time whether any bench touches another bench or an edge of the venue."""
    lines = shapely.union_all([*edges_of(scene.venue).values()])
    shapely.prepare(lines)
    i, j = np.triu_indices(scene.dragon.benches, 2)
    out = []
    for n in range(0, len(times_s), at_once):
        boxes = shapely.polygons(corners_at(scene, times_s[n:n + at_once]))
        met = np.any(shapely.intersects(lines, boxes), axis=1)
        out.append(met | np.any(shapely.intersects(boxes[:, i], boxes[:, j]), axis=1))
    return np.concatenate(out)


def with_venue(scene, seed, largest_m=0.7):
    """Return a scene in a random venue whose obstacles do not touch its dragon at the start."""
    venue = random_venue(scene, seed, largest_m)
    lines, boxes = edges_of(venue), shapely.polygons(corners_at(scene, [scene.run.start_s])[0])
    kept = tuple(one for one in venue.obstacles if not np.any(shapely.intersects(lines[one.name], boxes)))
    return replace(scene, venue=replace(venue, obstacles=kept))
