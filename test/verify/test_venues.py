"""The checker accepts true claims about obstacles and rejects false ones, and its bounds hold inside intervals."""
import copy
import json
import re
from functools import cache
from math import pi

import numpy as np
import pytest
import shapely
from certificates import proved, refusal, written
from flint import acb, arb
from hypothesis import assume, given
from hypothesis import strategies as st
from properties import examples, thinned
from venues import MORE, SCENES, with_venue

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Profile
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search import obstacle_contact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.tracks.spec import Arc, Composite, Line
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue
from dragon_ros.scenes.certificate import as_values
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.posture import Bench, Pose, Posture
from dragon_ros.verify.posture import Dragon as Checked
from dragon_ros.verify.reading import Obstacle, claims_of
from dragon_ros.verify.reading import Venue as Told
from dragon_ros.verify.segments import Link
from dragon_ros.verify.track import Place, track_of
from dragon_ros.verify.venue import _INSIDE_HEAD, Edge, Edges, SweptBench, _covers, check_sides

ALONG = Scene(Dragon(5), Composite((Line(200.0),), 20.0), run=Run(stop_s=60.0))
WALL = LineObstacle('wall', ((60.0, -2.0), (60.0, 2.0)))
TENT = PolygonObstacle('tent', ((40.0, 0.5), (44.0, 0.5), (44.0, 3.0), (40.0, 3.0)))
HALL = ((-5.0, -4.0), (90.0, -4.0), (90.0, 4.0), (-5.0, 4.0))
AHEAD, CLEAR = (Scene(ALONG.dragon, ALONG.track, run=run, venue=Venue(obstacles, HALL, margin_m=0.2))
                for obstacles, run in (((WALL, TENT), ALONG.run), ((TENT,), Run(stop_s=30.0))))


@pytest.mark.parametrize('name', thinned(SCENES | MORE, (
    'street', 'mixed street led by the tail', 'links of no length').__contains__))
def test_what_the_solver_finds_in_a_venue_is_proved(name):
    said = proved(written(with_venue((SCENES | MORE)[name], 12)))
    assert said.startswith(('no two benches touch, and none touches an obstacle or leaves the inside polygon, from',
                            'the run starts with its contact'))


def test_what_is_proved_says_which_bench_and_obstacle_overlap():
    assert proved(written(AHEAD)) == (
        'no two benches touch, and none touches an obstacle or leaves the inside polygon, from 0.0 s to the contact at '
        "39.725 s, less 1 nm of leader travel, and bench 0 and 'wall' overlap 1 nm after it")
    assert proved(written(CLEAR)).endswith('from 0.0 s to the end of the run at 30 s (it stops)')
    alone = Scene(ALONG.dragon, ALONG.track, run=Run(stop_s=9.0), venue=Venue((WALL,)))
    assert proved(written(alone)).startswith('no two benches touch, and none touches an obstacle, from')


def test_no_margin_stands_in_a_certificate():
    assert set(written(AHEAD)['scene']['venue']) == {'obstacles', 'inside'}


def changed(values, change):
    out = copy.deepcopy(values)
    change(out, out['scene']['venue'])
    return out


def claim(**contact):
    return lambda values, venue: values['contact'].update(contact)


def corner(n, to_m, ring=0):
    def change(values, venue):
        venue['obstacles'][ring]['points_m'][n] = to_m
    return change


def put(**keys):
    return lambda values, venue: venue.update(keys)


def listed(**keys):
    return lambda values, venue: venue['obstacles'][0].update(keys)


TAMPERED = {
    'another obstacle': (AHEAD, claim(obstacle='tent'), 'contact: .*far from|do not overlap'),
    'an unknown obstacle': (AHEAD, claim(obstacle='door'), "contact.obstacle: 'door' is not in the venue"),
    'another bench': (AHEAD, claim(benches=[1]), 'far from each other'),
    'two benches and an obstacle': (AHEAD, claim(benches=[0, 2]), 'contact.benches: .* a list of 1'),
    'a bench alone': (AHEAD, claim(obstacle=None), 'contact.benches: .* a list of 2'),
    'later': (AHEAD, claim(t_s=39.725 + 3e-9), "overlaps 'wall'"),
    'much later': (AHEAD, claim(t_s=41.0), 'do not overlap|far from|overlaps'),
    'earlier': (AHEAD, claim(t_s=39.725 - 3e-9), 'do not overlap'),
    'none': (AHEAD, lambda values, venue: values.update(contact={'t_s': None}), "overlaps 'wall'"),
    'none, with an obstacle': (AHEAD, lambda values, venue: values.update(contact={'t_s': None, 'obstacle': 'wall'}),
                               'if there is no contact'),
    'a corner in the way': (CLEAR, corner(0, [40.0, -1.0]), "overlaps 'tent'|'tent' could not be proved to be apart"),
    'a corner that is barely in the way': (CLEAR, corner(0, [40.0, 0.149999]), "'tent'"),
    'the wall moved': (AHEAD, corner(0, [60.5, -2.0]), 'do not overlap'),
    'the wall away': (AHEAD, lambda values, venue: venue['obstacles'].pop(0), "'wall' is not in the venue"),
    'the wall renamed': (AHEAD, listed(name='door'), "'wall' is not in the venue"),
    'two with the same name': (AHEAD, listed(name='tent'), 'two obstacles with the same name'),
    'no name': (AHEAD, listed(name=''), 'is not a valid name for an obstacle'),
    'a name that is taken': (AHEAD, listed(name='inside'), 'is not a valid name for an obstacle'),
    'an outline that is crossed': (CLEAR, put(inside=[[-5, -4], [48.0, -4.0], [48.0, 4.0], [-5.0, 4.0]]), "'inside'"),
    'an outline elsewhere': (CLEAR, put(inside=[[-5, 4], [90, 4], [90, 9], [-5, 9]]), "starts outside 'inside'"),
    'a tent over all': (CLEAR, lambda values, venue: venue['obstacles'][0].update(
        points_m=[[-50, -50], [150, -50], [150, 50], [-50, 50]]), "starts within 'tent'"),
    'a margin': (CLEAR, put(margin_m=0.2), 'margin_m: this key is not checked'),
    'a place on earth': (CLEAR, put(origin_deg=[0, 0]), 'origin_deg: this key is not checked'),
    'no obstacle at all': (CLEAR, lambda values, venue: venue.clear(), 'has no obstacle'),
    'a point twice': (CLEAR, corner(1, [40.0, 0.5]), 'two successive points coincide'),
    'no number': (CLEAR, corner(1, [40.0, 'x']), 'is not a number'),
    'far beyond': (CLEAR, corner(1, [1e10, 0.5]), 'is not between'),
    'too few corners': (CLEAR, listed(points_m=[[40, 1], [41, 1]]), 'a list'),
    'another kind': (CLEAR, listed(kind='circle'), 'not one of the kinds polygon, line'),
    'a key': (CLEAR, listed(height_m=2.0), 'this key is not checked')}


certificate_of = cache(written)


@pytest.mark.parametrize('name', TAMPERED)
def test_a_certificate_that_is_changed_is_refused(name):
    scene, change, why = TAMPERED[name]
    assert re.search(why, refusal(changed(certificate_of(scene), change)))


def test_a_run_without_a_venue_touches_no_obstacle():
    values = written(Scene(ALONG.dragon, ALONG.track, run=Run(stop_s=9.0)))
    values['contact'] = {'t_s': 5.0, 'benches': [0], 'obstacle': 'wall'}
    assert "'wall' is not in the venue" in refusal(values)


def test_an_obstacle_that_the_last_bench_alone_comes_to_is_not_missed():
    """The dragon moves backwards, so the first bench of this length never reaches the position of the last one."""
    behind = LineObstacle('behind', ((5.0, -1.0), (5.0, 1.0)))
    back = Profile(((0.0, -1.0),))
    values = written(Scene(ALONG.dragon, ALONG.track, back, Run(stop_s=10.0), venue=Venue((behind,))))
    assert values['contact']['benches'] == [4]
    assert "bench 4 and 'behind' overlap" in proved(values)
    values['contact'] = {'t_s': None}
    assert "overlaps 'behind'" in refusal(values)


def test_a_solver_that_misses_the_wall_is_refused(monkeypatch):
    monkeypatch.setattr(obstacle_contact.Obstacles, 'clear', lambda self, stop_m: None)
    assert "overlaps 'wall'" in refusal(as_values(AHEAD, first_contact(AHEAD)))


# Bounds


def swept(scene, lead, low, high):
    """Return an interval of the checker, and a function that maps a share of the leader's travel in it to the pose."""
    told = claims_of(json.dumps(written(scene)).encode()).scene
    track, dragon = track_of(told), Checked(told)
    ends = [Posture(track, dragon, lead, track.place_at(arb(place))) for place in (low, high)]
    bend = None if track.to_centre else track.bend

    def between(share):
        one, two = (end.place(0) for end in ends)
        if one.segment == two.segment and not one.loose and not two.loose:
            return Posture(track, dragon, lead, Place(one.segment, one.u + (two.u - one.u) * share)).pose(0)
        return Posture(track, dragon, lead, track.place_at(arb(low) + (arb(high) - arb(low)) * share)).pose(0)
    return SweptBench(track, dragon, lead, ends, bend), between


def corners(pose):
    """Return the corners of a bench, or the ends of an edge."""
    along, aside = pose.shape.sizes
    return np.array([pose.near + pose.heading * complex(i * along, j * aside) for i in (1, -1) for j in (1, -1)])


@pytest.mark.parametrize(('low', 'high', 'tight'), [
    (16.0, 16.2, 0.52), (14.0, 14.05, 0.52), (13.5, 14.1, 0.1), (11.0, 12.5, 0.01), (5.0, 6.0, 0)])
def test_corners_leave_straight_lines_by_no_more_than_the_sag(low, high, tight):
    """The bound is tested before the first bend of the street, at its beginning and inside it, in both frames."""
    scene = Scene(SCENES['street'].dragon, SCENES['street'].track, run=Run(stop_s=1.0))
    interval, between = swept(scene, 0, low, high)
    poses = [between(share) for share in np.linspace(0, 1, 21).tolist()]
    part = Edge('post', poses[10].near + 1.0 + 1j, poses[10].near + 1.5 + 2j).near(poses[10].near, 9.0)
    shares = np.linspace(0, 1, 21)[:, None]
    wall = Edge('wall', poses[10].near - 5.0 + 0.3j, poses[10].near + 5.0 + 0.3j).near(poses[10].near, 9.0)
    for edge, other in ((part, False), (wall, False), (part, True)):        # the wall's ends are far from its middle
        seen = np.array([corners(pose) if other else (corners(edge) - pose.near) / pose.heading for pose in poses])
        off = np.abs(seen - seen[0] - shares * (seen[-1] - seen[0]))
        sag = interval._sag_at(edge, other)
        assert np.max(off) <= sag + 1e-12
        assert np.max(off) >= (0.9 * tight if edge is wall else tight) * sag


@pytest.mark.parametrize('name', thinned(['street', 'turn', 'spiral', 'mixed spiral', 'coils', 'the smallest link'],
                                         lambda name: name == 'the smallest link'))
def test_what_is_proved_clear_of_an_edge_is_clear_of_it_in_between(name):
    """If ``meets`` finds no overlap of an interval and a random edge, shapely finds none at any position inside."""
    scene, rng = (SCENES | MORE)[name], np.random.default_rng(5)
    scene = Scene(scene.dragon, scene.track, scene.head, Run(scene.run.start_s, scene.run.start_s + 0.5))
    start_m = float(track_of(claims_of(json.dumps(written(scene)).encode()).scene).start)
    proved_ones = 0
    for n in range(40):
        low = start_m + rng.uniform(-1.0, 1.0)
        interval, between = swept(scene, 0, low, low + float(rng.choice([0.003, 0.1, 0.6])))
        poses = [between(share) for share in np.linspace(0, 1, 9).tolist()]
        at = poses[4].near + rng.normal(0, 1.2) + 1j * rng.normal(0, 1.2)
        stop = at + rng.choice([0.05, 1.0, 80.0]) * np.exp(2j * pi * rng.random())
        edges = Edges(Told((Obstacle('post', (((at.real, at.imag), (stop.real, stop.imag)),), False),), None), 3.41)
        line = shapely.LineString([(at.real, at.imag), (stop.real, stop.imag)])
        try:
            met = interval.meets(edges, 2.0)
        except Refused:
            met = 'post'
        boxes = [shapely.MultiPoint([(z.real, z.imag) for z in corners(pose)]).convex_hull for pose in poses]
        if met is None:
            proved_ones += 1
            assert not any(shapely.intersects(box, line) for box in boxes), n
        else:
            assert min(shapely.distance(box, line) for box in boxes) < 0.4, n
    assert proved_ones >= 5


PLANE = st.builds(complex, st.floats(-9, 9), st.floats(-9, 9))


@examples(60)
@given(PLANE, PLANE, PLANE, st.floats(0.01, 6))
def test_the_part_of_an_edge_holds_all_of_it_within_reach(start, stop, point, reach_m):
    if abs(stop - start) < 1e-6:
        return
    part = Edge('wall', start, stop).near(point, reach_m)
    whole = start + np.linspace(0, 1, 201) * (stop - start)
    within = whole[np.abs(whole - point) <= reach_m]
    if part is None:
        assert not within.size
        return
    along = ((within - part.near) * np.conj(part.heading)).real
    assert np.all(np.abs(along) <= part.shape.sizes[0] + 1e-9)
    assert abs(part.shape.sizes[0]) <= reach_m + 1e-6


@examples(30)
@given(st.lists(st.tuples(PLANE, st.floats(-4, 3), st.floats(0, 6)), min_size=1, max_size=9), PLANE, st.floats(0.01, 5))
def test_the_index_finds_every_edge_within_reach(edges, point, reach_m):
    lines = [((z.real, z.imag), ((z + 10**size * np.exp(1j * angle)).real, (z + 10**size * np.exp(1j * angle)).imag))
             for z, size, angle in edges]
    index = Edges(Told(tuple(Obstacle(f'{n}', (line,), False) for n, line in enumerate(lines)), None), 0.3)
    found = {edge.name for edge in index.near(point, reach_m)}
    spot = shapely.Point(point.real, point.imag)
    away = [shapely.distance(shapely.LineString(line), spot) for line in lines]
    assert {f'{n}' for n, away_m in enumerate(away) if away_m <= reach_m} <= found


@examples(60)
@given(st.lists(PLANE, min_size=3, max_size=7, unique=True), PLANE)
def test_sides_are_those_of_shapely(ring, point):
    assume(min(abs(a - b) for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)) > 1e-100)   # shapely squares them
    points = [(z.real, z.imag) for z in ring]
    outline = shapely.Polygon(points)
    bench = Bench(Link(arb(0), 0.0), arb(1e-6), arb(1e-6))
    head = Pose(bench, _ball(point), _ball(1), point, 1 + 0j, 0.0, 0.0)
    spot = shapely.Point(point.real, point.imag)
    if not outline.is_valid or shapely.distance(outline.exterior, spot) < 1e-5:
        return
    area = Obstacle('tent', ((*points, points[0]),), True)
    covered = shapely.contains_xy(outline, point.real, point.imag)
    for venue, wrong in ((Told((area,), None), covered), (Told((), Obstacle('inside', area.lines, True)), not covered)):
        if wrong:
            with pytest.raises(Refused, match='the run starts'):
                check_sides(venue, head)
        else:
            check_sides(venue, head)


@pytest.mark.parametrize('turned', [False, True])
def test_a_point_is_inside_a_winding_outline_wherever_shapely_says_so(turned):
    ring = [(0, 0), (9, 0), (9, 7), (2, 7), (2, 3), (6, 3), (6, 5), (4, 5), (4, 4), (3, 4), (3, 6), (7, 6), (7, 1),
            (0, 2)]
    corners = [complex(x, y + 1e-3 * x) for x, y in (ring[::-1] if turned else ring)]
    outline = shapely.Polygon([(z.real, z.imag) for z in corners])
    area = Obstacle('maze', (tuple((z.real, z.imag) for z in [*corners, corners[0]]),), True)
    points = [complex(0.37 * k - 1, 0.53 * n - 1) for k in range(30) for n in range(17)]
    assert [_covers(area, _ball(point)) for point in points] == [
        bool(shapely.contains_xy(outline, point.real, point.imag)) for point in points]


@pytest.mark.parametrize(('x', 'y', 'covered'), [
    (1.0, 0.5, None), (0.0, 0.5, None), (0.5, 1.0, None), (0.5, 0.5, True), (0.98, 0.5, True), (1.02, 0.5, False)])
def test_a_point_whose_ball_meets_an_edge_is_neither_inside_nor_outside(x, y, covered):
    area = Obstacle('square', (((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)),), True)
    assert _covers(area, acb(arb(x, 0.01), arb(y, 0.01))) is covered


def _ball(z):
    return acb(arb(complex(z).real), arb(complex(z).imag))


def test_a_courtyard_is_outside_of_its_house():
    """The obstacle is a polygon with a hole, in which the dragon starts."""
    house = PolygonObstacle('house', ((-50.0, -50.0), (250.0, -50.0), (250.0, 50.0), (-50.0, 50.0)),
                            (((-30.0, -9.0), (230.0, -9.0), (230.0, 9.0), (-30.0, 9.0)),))
    assert proved(written(Scene(ALONG.dragon, ALONG.track, run=Run(stop_s=9.0), venue=Venue((house,)))))


def test_long_walls_beside_the_track_are_proved_clear_in_few_intervals():
    walls = tuple(LineObstacle(f'{side}', ((-far, side), (far, side))) for side, far in ((0.16, 1e5), (-0.16, 500.0)))
    bend = Composite((Line(100.0), Arc(30.0, 20.0)), 20.0)
    assert proved(written(Scene(ALONG.dragon, bend, run=Run(stop_s=60.0), venue=Venue(walls))))


def test_checked_points_of_the_head_are_inside_it_and_not_level_with_each_other():
    for numbers in ([point.real for point in _INSIDE_HEAD], [point.imag for point in _INSIDE_HEAD]):
        assert max(map(abs, numbers)) < 0.9
        assert len({abs(one) for one in numbers}) == 6
