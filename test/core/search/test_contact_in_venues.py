"""The first contact in a venue and its time agree with shapely at many positions of the leader."""
import json
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from properties import thinned
from venues import MORE, SCENES, corners_at, edges_of, times_of, touched_at, with_venue

from dragon_ros.commands.contact import main, values_of
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Profile
from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.contacts import OBSTACLE
from dragon_ros.core.geometry.venue import surroundings_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.bounding_box import SweptBench, by_length
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.driver import Bracket
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.obstacle_bounds import ObstacleBounds
from dragon_ros.core.search.obstacle_contact import Obstacles, _SweptIntervals, windows_of
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.spec import Composite, Line
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue

TELL = 1e-9         # in s: shapely may report a touch this long before the contact
ALONG = Scene(Dragon(5), Composite((Line(200.0),), 20.0), run=Run(stop_s=60.0))
TENT = PolygonObstacle('tent', ((-9.0, -9.0), (99.0, -9.0), (99.0, 9.0), (-9.0, 9.0)))
TRACK = 'track={kind: joined, pieces: [{kind: line, length_m: 200}], start_m: 20}'
WALL = LineObstacle('wall', ((60.0, -2.0), (60.0, 2.0)))


def compare(scene, step_m):
    """Compare the first contact with shapely's results at positions of the leader ``step_m`` apart."""
    found = first_contact(scene)
    touched_s = found.t_s if isinstance(found, Contact) else compile_scene(scene).end.t_s
    times = times_of(scene, step_m, touched_s - TELL) if touched_s - TELL > scene.run.start_s else []
    assert not np.any(touched_at(scene, times)) if len(times) else True
    if isinstance(found, NoContact) or found.grazing_m:
        return found
    at = shapely.polygons(corners_at(scene, [found.t_s])[0])
    other = edges_of(scene.venue)[found.obstacle.name] if found.obstacle else at[found.benches[1]]
    if touched_s > scene.run.start_s:
        assert shapely.distance(at[found.benches[0]], other) < 1e-10
        assert shapely.distance(shapely.Point(found.point_m), at[found.benches[0]]) < 1e-10
        assert shapely.distance(shapely.Point(found.point_m), other) < 1e-10
    return found


@pytest.mark.parametrize('name', thinned(SCENES | MORE, (
    'street', 'mixed street led by the tail', 'back and forth', 'links of no length').__contains__))
def test_the_first_contact_is_the_one_that_shapely_sees(name):
    kinds = {str(type(compare(with_venue((SCENES | MORE)[name], seed), 0.05))) for seed in (1, 2)}
    assert kinds


def test_the_first_contact_is_the_one_that_shapely_sees_every_millimetre(request):
    """With --long there are six venues for each of eleven scenes."""
    every = SCENES | MORE if request.config.getoption('--long', default=False) else {'street': SCENES['street']}
    found = [compare(with_venue(scene, seed), 1e-3 if len(every) > 1 else 0.01)
             for scene in every.values() for seed in range(10, 16 if len(every) > 1 else 12)]
    assert any(isinstance(one, Contact) and one.obstacle and one.t_s > 0 for one in found)
    assert any(isinstance(one, NoContact) for one in found) or len(every) == 1


def test_a_wall_across_the_track_is_met_by_the_head_where_it_is():
    found = first_contact(replace(ALONG, venue=Venue((WALL,))))
    front_m = 20.0 + 0.275      # the front end of the head, beyond the front handle
    assert found.t_s == pytest.approx(60.0 - front_m, abs=1e-11)
    assert (found.benches, found.obstacle.name, found.obstacle.corner_m) == ((0,), 'wall', None)
    assert found.obstacle.edge_m == WALL.points_m
    assert (found.witness.owner, found.witness.corner[:5], found.witness.other) == (0, 'front', OBSTACLE)
    assert found.certificate.complete
    assert found.between == "bench 0 and obstacle 'wall'"


def test_a_corner_that_pokes_at_a_bench_is_named_as_the_obstacle_s():
    post = PolygonObstacle('post', ((60.0, 0.0), (62.0, -1.0), (62.0, 1.0)))
    found = first_contact(replace(ALONG, venue=Venue((post,))))
    assert found.obstacle.corner_m == (60.0, 0.0)
    assert (found.witness.owner, found.witness.other, found.witness.edge) == (OBSTACLE, 0, 'front')
    assert [name for _, name in found.simultaneous] == []       # both edges at the corner belong to the same obstacle


def test_the_tail_meets_first_what_lies_behind_it_when_the_dragon_goes_back():
    back = replace(ALONG, head=Profile(((0.0, -1.0),)), run=Run(stop_s=10.0))
    found = first_contact(replace(back, venue=Venue((LineObstacle('behind', ((5.0, -1.0), (5.0, 1.0))),))))
    links_m = 2.86 + 4 * 1.65
    assert found.benches == (4,)
    assert found.t_s == pytest.approx(20.0 - links_m - 0.275 - 5.0, abs=1e-11)


def test_leaving_the_inside_is_a_contact_and_so_is_one_at_the_start():
    inside = ((-5.0, -1.0), (50.0, -1.0), (50.0, 1.0), (-5.0, 1.0))
    found = first_contact(replace(ALONG, venue=Venue(inside=inside)))
    assert (found.benches, found.obstacle.name) == ((0,), 'inside')
    assert found.t_s == pytest.approx(50.0 - 20.275, abs=1e-11)
    nailed = Venue((LineObstacle('nail', ((15.0, 0.0), (15.0, 1.0))),))
    found = first_contact(replace(ALONG, venue=nailed))
    assert (found.t_s, found.obstacle.name) == (0.0, 'nail')
    with pytest.raises(FieldError, match='tent.*covers the dragon'):
        first_contact(replace(ALONG, venue=Venue((TENT,))))


@pytest.mark.parametrize(('away_m', 'touches'), [(1e-9, False), (-1e-9, True)])
def test_a_wall_alongside_a_nanometre_away_is_not_touched(away_m, touches):
    """The wall is parallel to the track; half the width of a bench is 0.15 m."""
    wall = LineObstacle('wall', ((40.0, 0.15 + away_m), (45.0, 0.15 + away_m)))
    found = first_contact(replace(ALONG, venue=Venue((wall,))))
    assert isinstance(found, Contact if touches else NoContact)
    assert found.certificate.complete


def test_a_slow_kiss_of_an_arc_and_a_wall_grazes_or_touches_as_its_gap_says():
    """On the outside of a bend, the head's corner is furthest out at one position and touches a wall tangentially."""
    scene = SCENES['street']
    corners = corners_at(scene, times_of(scene, 0.001))
    far = float(np.max(corners[..., 0]))
    for off_m, kind in ((1e-4, NoContact), (-1e-4, Contact)):
        wall = LineObstacle('wall', ((far + off_m, -20.0), (far + off_m, 20.0)))
        compared = compare(replace(scene, venue=Venue((wall,))), 0.01)
        assert isinstance(compared, kind)
        assert compared.certificate.complete


@pytest.mark.parametrize('name', SCENES)
def test_windows_hold_every_place_of_every_bench_once(name):
    """In each phase, the windows for a bench length contain exactly the positions that their front handles pass."""
    scene = with_venue(SCENES[name], 1)
    travel = RangeOfTravel.of(compile_scene(scene))
    for sense in travel.senses:
        domain = SearchDomain(compile_scene(scene), travel, sense, lambda states: None)
        for phase in domain.phases(domain.start_m, domain.stop_m):
            for benches in by_length(scene.dragon.bench_lengths_m):
                windows = windows_of(domain, benches, phase, 0.8)
                for travel_m in np.linspace(*phase, 7):
                    for along_m in domain.along_m(float(travel_m))[benches].tolist():
                        assert any(window.places.min() - 1e-9 <= along_m <= window.places.max() + 1e-9
                                   for window in windows) or not windows
                lengths = sum(np.ptp(window.places) for window in windows)
                places = np.concatenate([window.places for window in windows])
                assert lengths <= np.ptp(places) + 1e-9 or len(windows) > 1


def test_bounds_leave_room_for_what_positions_and_roundings_may_err():
    """Allowing for displaced benches raises no bound, and lowers one bound by more than a tenth of the error."""
    scene = with_venue(SCENES['street'], 3)
    domain = SearchDomain(compile_scene(scene), RangeOfTravel(scene.head, 0.0, 20.0), 1, lambda states: None)
    bench, edge = SweptBench.of(domain.track, domain.dragon, 1), np.arange(domain.around.owner.size)
    states = bench.states(np.array([10.0, 10.4]))
    ends = states.rows(np.zeros(edge.size, dtype=int)), states.rows(np.ones(edge.size, dtype=int))
    exact, unsure = (ObstacleBounds(bench, domain.around, error) for error in (0.0, 1e-6))
    gaps = exact.gaps(ends[0], edge), exact.gaps(ends[1], edge)
    fell = exact.bounds(*ends, gaps, edge) - unsure.bounds(*ends, gaps, edge)
    assert np.all(fell >= 0.0)
    assert np.max(fell) > 1e-7


def test_the_bound_at_one_place_is_the_gap_less_what_it_may_be_rounded_by():
    far_m = 1e5
    around = surroundings_of(Venue((LineObstacle('long', ((-far_m, 30.0), (far_m, 30.0))),)))
    scene, edge = SCENES['street'], np.zeros(1, dtype=np.int64)
    domain = SearchDomain(compile_scene(scene), RangeOfTravel(scene.head, 0.0, 20.0), 1, lambda states: None)
    bounds = ObstacleBounds(SweptBench.of(domain.track, domain.dragon, 1), around)
    state = bounds.bench.states(np.array([10.0]))
    gap_m = bounds.gaps(state, edge)
    lost_m = float((gap_m - bounds.bounds(state, state, (gap_m, gap_m), edge))[0])
    assert lost_m == pytest.approx(2 * far_m * 2.0**-46, rel=0.1)


@pytest.mark.parametrize(('longest', 'is_bounded'), [(5.97, True), (6.03, False)])
def test_a_move_of_corners_of_up_to_six_benches_is_bounded_and_a_longer_one_is_cut(longest, is_bounded):
    simulation = compile_scene(replace(ALONG, venue=Venue((WALL,))))
    domain = SearchDomain(simulation, RangeOfTravel(ALONG.head, 0.0, 1.0), 1, lambda _: None)
    longest_m = float(np.max(ALONG.dragon.bench_lengths_m))
    bounds = ObstacleBounds(SweptBench.of(domain.track, domain.dragon, 1), domain.around)
    space = _SweptIntervals(bounds, 1e-9, longest_m, lambda _: None)

    def moved(further_m):
        samples = space.sample(np.array([10.0, 10.0 + further_m]))
        return [samples.rows(np.array([n])) for n in (0, 1)]

    lever = float(np.max(bounds.motions_m(*(each.states for each in moved(1.0)))))
    a, b = moved(longest * longest_m / lever)
    assert np.max(bounds.motions_m(a.states, b.states)) == pytest.approx(longest * longest_m)
    assert bool(np.isfinite(space.judge(a, b, np.zeros(1, dtype=np.int64)).bound_m[0])) == is_bounded


@pytest.mark.parametrize(('errors', 'is_clear'), [(17.0, False), (19.0, True)])
def test_a_bench_along_a_wall_is_clear_only_if_errors_of_its_handles_cannot_turn_a_corner_into_it(errors, is_clear):
    link_m = 2.2 / 3.9      # the error of a corner is that of a handle times (length + width) / link: 4.43
    scene = replace(ALONG, dragon=Dragon(2, 2.2, 2.2, 0.3, 0.5 * (2.2 - link_m)), run=Run(0.0, 1.0))
    wall = LineObstacle('wall', ((14.0, 0.15 + errors * 2e-12), (23.0, 0.15 + errors * 2e-12)))
    simulation = compile_scene(replace(scene, venue=Venue((wall,))))
    domain = SearchDomain(simulation, RangeOfTravel(scene.head, 0.0, 1.0), 1, lambda _: None)
    assert domain.error_m == pytest.approx(2e-12, rel=0.5)
    assert (Obstacles(domain).clear(1.0) is None) == is_clear


def test_without_a_venue_nothing_of_venues_is_imported():
    code = ('import sys; from dragon_ros.core.scene import Run, Scene; '
            'from dragon_ros.core.search.first_contact import first_contact; first_contact(Scene(run=Run(409, 410))); '
            'print([name for name in sys.modules if "obstacle" in name or name.endswith("geometry.venue")])')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'


def test_the_command_names_the_obstacle_in_every_format(capsys):
    scene = ['--set', 'dragon.benches=5', '--set', TRACK,
             '--set', 'venue={obstacles: [{kind: line, name: "wall, old", points_m: [[60, -2], [60, 2]]}]}']
    assert main(scene) == 0
    assert "first contact at 39.725 s: bench 0 and obstacle 'wall, old', at (60" in capsys.readouterr().out
    assert main([*scene, '--format', 'csv']) == 0
    head, row = capsys.readouterr().out.splitlines()
    assert head == 't_s,inner,outer,x_m,y_m,end,t_end_s,obstacle'
    assert row.endswith(',,,"wall, old"')
    assert row.split(',')[1:3] == ['0', '']
    assert main([*scene, '--format', 'json']) == 0
    values = json.loads(capsys.readouterr().out)
    assert values['obstacle'] == {'name': 'wall, old', 'edge_m': [[60.0, -2.0], [60.0, 2.0]], 'corner_m': None}
    assert (values['benches'], values['features']['other'], values['certified']) == ([0], None, True)


def test_of_two_benches_there_is_no_obstacle():
    assert values_of(first_contact(Scene(run=Run(405, 413))))['obstacle'] is None


@pytest.mark.parametrize('sense', [1, -1])
def test_of_the_hits_of_benches_the_one_that_the_leader_reaches_first_counts_and_later_ones_are_not_solved_for(sense):
    """A stand-in: bench n is at 10 n and moves ``speeds[n]`` m per metre of leader travel; its hits are known."""
    speeds, solved = np.array([1.0, 0.5, 2.0, 1.0]), []

    def along_m(travel_m):
        return 10.0 * np.arange(4) + speeds * travel_m

    def travel_at(bench, place_m, phase):
        solved.append(bench)
        return (place_m - 10.0 * bench) / speeds[bench]
    domain = SimpleNamespace(sense=sense, along_m=along_m, travel_at=travel_at)
    gone = {0: (2.0, 2.1), 1: (1.0, 1.1), 2: (1.05, 1.3), 3: (0.5, 1.2)}       # leader positions of each hit
    hits = [(n, Bracket(*(10.0 * n + sense * speeds[n] * one for one in ends), -0.1 * n)) for n, ends in gone.items()]
    found = Obstacles._earliest(SimpleNamespace(_domain=domain), hits, (0.0, sense * 5.0))
    assert (found.clear_m, found.other_m, found.bound_m) == pytest.approx((sense * 1.0, sense * 1.1, -0.1))
    assert solved == [0, 0, 1, 1]
    assert Obstacles._earliest(SimpleNamespace(_domain=domain), [], (0.0, sense * 5.0)) is None
