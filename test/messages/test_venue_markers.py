"""The venue's markers, decoded again, contain all edges and names of its obstacles; without a venue there are none."""
from dataclasses import replace

import numpy as np
import shapely

from dragon_ros.__main__ import main
from dragon_ros.core.scene import Scene
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue
from dragon_ros.messages.decode import decode
from dragon_ros.messages.latched import latched_messages
from dragon_ros.messages.markers import LINE_LIST, TEXT_VIEW_FACING
from dragon_ros.scenes.load import load_scene

YARD = PolygonObstacle('yard', ((20, 0), (30, 0), (30, 9), (20, 9)), (((22, 2), (24, 2), (24, 4)),))
WALL = LineObstacle('wall', ((-40, -20), (-40, 0), (-35, 5)))
INSIDE = (-60, -60), (60, -60), (60, 60), (-60, 60)


def markers_of(scene, frame_id='sea'):
    return decode('visualization_msgs/msg/MarkerArray', latched_messages(scene, frame_id)['venue'])['markers']


def edges_of(marker):
    return shapely.MultiLineString(list(marker['points'].reshape(-1, 2, 3)[:, :, :2]))


def test_each_obstacle_and_the_inside_have_their_edges_and_their_name():
    scene = replace(Scene(), venue=Venue((YARD, WALL), INSIDE))
    markers = markers_of(scene)
    assert [(one['ns'], one['id'], one['type']) for one in markers] == [
        (ns, n, kind) for ns, kind in (('venue', LINE_LIST), ('venue names', TEXT_VIEW_FACING)) for n in range(3)]
    assert [one['text'] for one in markers] == ['polygon', 'line', 'inside', 'yard', 'wall', 'inside']
    shapes = (shapely.Polygon(YARD.points_m, YARD.holes_m).boundary, shapely.LineString(WALL.points_m),
              shapely.Polygon(INSIDE).boundary)
    for marker, shape in zip(markers[:3], shapes, strict=True):
        assert edges_of(marker).equals(shape)
        assert len(marker['points'].reshape(-1, 2, 3)) == len(shapely.get_coordinates(shape)) - len(
            shapely.get_parts(shape))
    assert {(one['header']['frame_id'], one['header']['stamp']['sec'], one['action']) for one in markers} == {
        ('sea', 0, 0)}
    assert not any(np.any(one['points'].reshape(-1, 3)[:, 2]) for one in markers[:3])
    for name in markers[3:]:        # text is just above the ground
        (*_, z), (*_, size) = name['pose'][:3], name['scale']
        assert 0 < z - 0.5 * size < 0.5 * size


def test_the_inside_is_grey_and_obstacles_are_black():
    *obstacles, inside = markers_of(replace(Scene(), venue=Venue((YARD, WALL), INSIDE)))[:3]
    red, green, blue, alpha = inside['color']
    assert 0 < red == green == blue < alpha == 1
    assert [tuple(one['color']) for one in obstacles] == [(0, 0, 0, 1)] * 2


def test_a_scene_without_a_venue_has_no_such_topic():
    assert 'venue' not in latched_messages(Scene(), 'sea')


def test_a_bag_carries_the_venue_and_is_checked_with_it(tmp_path, capsys):
    path = str(tmp_path / 'a.mcap')
    assert main(['simulate', '--scene', 'street', '--set', 'run.stop_s=0.1', '--output', path]) == 0
    assert main(['inspect', path, '--check']) == 0
    out = capsys.readouterr().out
    assert 'scene and venue and track' in out or '3 messages match the scene' in out, out
    names = load_scene('street').venue.names
    assert [one['text'] for one in markers_of(load_scene('street'))[len(names):]] == list(names)
