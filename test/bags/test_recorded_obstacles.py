"""The obstacles that a monitor received from a file or a map are read back from its bag tick by tick."""
import json
from dataclasses import replace

import numpy as np
import pytest
from properties import thinned

import dragon_ros as dr
from dragon_ros.__main__ import main
from dragon_ros.bags.check.contacts import clearance_in
from dragon_ros.bags.read.frames import RecordedObstacles
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.core.geometry.venue import Surroundings, joined, surroundings_of
from dragon_ros.core.limits import MARKER_RUNS, SHOWN_EDGES
from dragon_ros.core.step import tick
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.latched import latched_messages
from dragon_ros.messages.surroundings import read_venue
from dragon_ros.messages.venue_markers import fits_message, obstacles_message
from dragon_ros.pictures.sources import dragon_in
from dragon_ros.scenes.load import load_scene
from dragon_ros.scenes.provenance import scene_file

SCENE = load_scene('street', ['dragon.benches=5', 'venue=null', 'run.stop_s=0.2'])      # the front is at x = 20.275 m
TICKS = range(11)
VENUE = '/dragon/venue'
SEEN = '/dragon/collision/obstacles'


def wall(name, x):
    return Venue((LineObstacle(name, ((x, -1.0), (x, 1.0))),))


@pytest.fixture
def bag_of(tmp_path):
    """A function that writes the run with obstacle messages at given ticks, and opens the bag."""
    opened = []

    def write(*messages):
        encode = encoders(SCENE)
        with BagWriter(tmp_path / 'a.mcap') as bag:
            for name, row in channels().items():
                bag.add_channel(f'/dragon/{name}', row)
            for k in TICKS:
                frame = tick(SCENE, k)
                for topic, at, data in messages:
                    if at == k:
                        bag.write(topic, data, frame.t_ns, k)
                for name in ('handles', 'benches'):
                    bag.write(f'/dragon/{name}', encode[name](frame), frame.t_ns, k)
        opened.append(BagReader(tmp_path / 'a.mcap'))
        return opened[-1]
    yield write
    for bag in opened:
        bag.close()


def seen(venue, at, frame_id='dragon'):
    around = venue and surroundings_of(venue)
    return SEEN, at, obstacles_message(around, frame_id, SCENE.run.time_ns(at))


def test_obstacles_count_from_the_tick_of_their_stamp_on_and_replace_those_of_the_venue(bag_of):
    invalid = b'\0\1\0\0\7\0\0\0'
    bag = bag_of((VENUE, 0, latched_messages(replace(SCENE, venue=wall('gate', 23.0)), 'dragon')['venue']),
                 seen(wall('near', 20.5), 3), seen(None, 6), seen(wall('post', 20.4), 8), (SEEN, 9, invalid))
    obstacles = RecordedObstacles(bag, '/dragon', 'dragon')
    assert obstacles.some
    around = [obstacles.at(SCENE.run.time_ns(k)) for k in TICKS]
    assert [one and one.names for one in around] == [*[('gate',)] * 3, *[('near',)] * 3, None, None, *[('post',)] * 3]
    gaps = clearance_in(bag, '/dragon', 0).gap_m
    front = [20.275 + 0.02 * k for k in TICKS]
    assert gaps[3:6] == pytest.approx([20.5 - x for x in front[3:6]], abs=1e-9)
    assert gaps[8:] == pytest.approx([20.4 - x for x in front[8:]], abs=1e-9)
    assert min(gaps[:3] + gaps[6:8]) > 1        # the gap between a bench and the next but one
    with dr.read_bag(bag.path) as recorded:
        assert [one.clearance_m for one in recorded] == gaps
    touch = dragon_in(bag).first_touch(iter)
    # From its message on, only the post counts, whatever obstacles came before.
    assert (touch.obstacle, touch.t_s) == ('post', 0.16)


def test_obstacles_in_another_frame_do_not_count(bag_of):
    bag = bag_of(seen(wall('gate', 20.3), 0, 'map'))
    assert RecordedObstacles(bag, '/dragon', 'dragon').at(SCENE.run.time_ns(5)) is None
    assert dragon_in(bag).first_touch(iter) is None


@pytest.mark.parametrize(('x', 't_s', 'says'), [
    (20.4, 0.125, "are not in the bag's scene: in the recorded ticks, bench 0 touches post at 0.125000000 s"),
    (30.0, None, 'in the recorded ticks, no bench touches an obstacle')])
def test_contact_examines_the_obstacles_that_only_the_monitor_knew(bag_of, capsys, x, t_s, says):
    bag = bag_of(('/dragon/scene', 0, string_message(scene_file(SCENE))), seen(wall('post', x), 0))
    assert main(['contact', str(bag.path), '--format', 'json']) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found['t_s'] is None         # the scene has no obstacles
    assert found['recorded_obstacles'] == ({'t_s': None} if t_s is None else {
        't_s': pytest.approx(t_s, abs=1e-9), 'bench': 0, 'obstacle': 'post', 'point_m': pytest.approx([x, 0.15])})
    assert says in err


def test_surroundings_are_read_back_to_the_last_bit():
    court = (((1.3, 0.7), (1.9, 0.7), (1.6, 1.1)),)
    venue = Venue((PolygonObstacle('house', ((0.1, 0.0), (3.0, 0.3), (1.7, 2.9)), court),
                   LineObstacle('wall', ((5.0, 0.0), (5.0, 1.0), (6.0, 1.0)))),
                  inside=((-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)))
    around = joined([surroundings_of(venue), surroundings_of(wall('gate', 7.0)).moved((0.1 + 0.2j, 0.6 + 0.8j))])
    located = read_venue(obstacles_message(around, 'plaza', 5))
    assert (located.frame_id, located.around.names) == ('plaza', around.names)
    for name in ('start', 'stop', 'owner', 'side'):
        assert np.array_equal(getattr(located.around, name), getattr(around, name))


@pytest.mark.parametrize(('edges', 'names', 'fits'), thinned([
    (SHOWN_EDGES, 1, True), (SHOWN_EDGES + 1, 1, False),
    ((MARKER_RUNS - 1) // 2, (MARKER_RUNS - 1) // 2, True), ((MARKER_RUNS + 1) // 2, (MARKER_RUNS + 1) // 2, False)],
    lambda case: case[1] == 1 or not case[2]))
def test_a_message_of_obstacles_has_a_budget_within_which_every_reader_takes_it(edges, names, fits):
    start = np.arange(edges) * (1 + 1j)
    # Names of different lengths change the layout from one marker to the next.
    around = Surroundings(tuple('x' * (1 + 5 * (n % 2)) for n in range(names)), start, start + 1,
                          np.arange(edges) % names, np.zeros(names, int))
    assert fits_message(around) is fits
    if fits:
        assert read_venue(obstacles_message(around, 'dragon', 0)).around.start.size == edges
