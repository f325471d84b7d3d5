"""In a venue, the tracker begins, ends and names contacts with obstacles like those between benches."""
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.effects.proximity import closeness
from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.tracker import ContactTracker
from dragon_ros.core.geometry.venue import surroundings_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import tick
from dragon_ros.core.tracks.spec import Arc, Composite, Line
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue

POST = PolygonObstacle('post', ((30.0, 0.05), (30.4, 0.05), (30.4, 0.4), (30.0, 0.4)))
WALL = LineObstacle('wall', ((0.0, 0.7), (60.0, 0.7)))
SCENE = Scene(Dragon(5), Composite((Line(40.0), Arc(6.0, -90.0), Line(10.0)), 25.0), run=Run(stop_s=20.0),
              venue=Venue((WALL, POST)))


@cache
def frame_at(k):
    return tick(SCENE, k)


def reports(tracker, ticks):
    for k in ticks:
        frame = frame_at(k)
        yield from tracker.add(Observation(frame.t_ns, frame.chain.p, frame.benches, 'dragon'))


def told(rows):
    return [line for r in rows for line in [*((e.cause, e.obstacle, e.benches) for e in r.ends),
                                            *(('begin', e.obstacle, e.benches) for e in r.begins)]]


def tracked(venue=SCENE.venue):
    tracker = ContactTracker()
    tracker.surround(surroundings_of(venue))
    return tracker


def test_the_event_of_an_obstacle_is_the_first_contact_within_what_a_tick_allows():
    found, (first, *_) = first_contact(SCENE), [e for r in reports(tracked(), range(200, 400)) for e in r.begins]
    assert (first.obstacle, first.benches) == (found.obstacle.name, (0, 5 + 1)) == ('post', (0, 6))
    assert first.before_ns < found.t_s * 1e9 <= first.after_ns
    assert first.t_contact_s == pytest.approx(found.t_s, abs=1e-9)       # the gap shrinks at a constant rate here
    assert first.point_m == pytest.approx(found.point_m, abs=1e-6)
    assert first.approach_m_s == pytest.approx(1.0, abs=1e-9)


def test_each_look_has_the_clearance_and_the_pairs_of_the_effects():
    seen = set()
    for k, report in zip(range(0, 900, 9), reports(tracked(), range(0, 900, 9)), strict=True):
        frame = frame_at(k)
        found = closeness(compile_scene(SCENE), frame.chain, frame.benches)
        assert (report.clearance_m, report.closest, report.count) == (found.clearance_m, found.closest, found.i.size)
        seen.add(report.obstacle(report.closest))
    assert seen == {'wall', 'post'}


def test_the_names_follow_every_bench_and_the_witness_lies_at_the_obstacle():
    rows = list(reports(tracked(), range(200, 400)))
    assert told(rows)[:2] == [('begin', 'post', (0, 6)), ('begin', 'post', (1, 6))]
    touching = next(r for r in rows if r.count)
    two, i, j = touching.two(touching.touching[0])
    assert (i, j, two.half_width.tolist()) == (0, 1, [0.15, 0.0])
    assert np.hypot(*(two.centre[1] - (30.0, 0.2))) < 0.5


def test_a_venue_that_comes_late_shows_whether_the_contact_was_there_before():
    tracker, rows = ContactTracker(), []
    hit = int(first_contact(SCENE).t_s * 50) + 1
    rows += reports(tracker, range(hit))
    tracker.surround(surroundings_of(SCENE.venue))
    rows += reports(tracker, [hit])
    (event,) = [e for r in rows for e in r.begins]
    assert (event.before_ns, event.after_ns) == (tick(SCENE, hit - 1).t_ns, tick(SCENE, hit).t_ns)
    tracker = ContactTracker()
    list(reports(tracker, range(hit + 2)))
    tracker.surround(surroundings_of(SCENE.venue))
    (event,) = [e for r in reports(tracker, [hit + 2]) for e in r.begins]
    assert (event.before_ns, event.t_contact_s) == (None, tick(SCENE, hit + 2).t_ns / 1e9)
    assert np.isnan(event.approach_m_s)


def test_another_venue_ends_the_contacts_with_the_old_one_and_one_that_moved_does_not():
    tracker, hit = tracked(), int(first_contact(SCENE).t_s * 50) + 1
    rows = list(reports(tracker, range(hit + 1)))
    tracker.surround(surroundings_of(SCENE.venue).moved((0.001 + 0j, 1 + 0j)))
    assert told(reports(tracker, [hit + 1])) == []
    tracker.surround(surroundings_of(Venue((replace(POST, name='column'),))))
    assert told(reports(tracker, [hit + 2])) == [('venue', 'post', (0, 6)), ('begin', 'column', (0, 5))]
    tracker.surround(None)
    rows = list(reports(tracker, [hit + 3]))
    assert told(rows) == [('venue', 'column', (0, 5))]
    assert (rows[0].count, rows[0].around) == (0, None)


def test_a_restart_names_the_obstacle_too():
    tracker, hit = tracked(), int(first_contact(SCENE).t_s * 50) + 1
    list(reports(tracker, range(hit + 2)))
    assert told(reports(tracker, [0])) == [('restart', 'post', (0, 6))]


def test_contacts_with_an_old_venue_end_at_the_last_observation():
    tracker, hit = tracked(), int(first_contact(SCENE).t_s * 50) + 1
    list(reports(tracker, range(hit - 3, hit + 2)))
    tracker.surround(None)
    (end,) = [e for r in reports(tracker, [hit + 2]) for e in r.ends]
    assert end.t_end_s == tick(SCENE, hit + 1).t_ns / 1e9
