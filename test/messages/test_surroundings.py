"""Obstacles from messages: venues from any publisher, occupancy grids with rotated origins, and rejected messages."""
from dataclasses import replace

import numpy as np
import pytest

from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry.venue import LINE, OUTSIDE, WITHIN, joined, surroundings_of
from dragon_ros.core.scene import Scene
from dragon_ros.core.venue import LineObstacle, PolygonObstacle, Venue
from dragon_ros.messages import surroundings
from dragon_ros.messages.cdr import Writer
from dragon_ros.messages.decode import MessageError
from dragon_ros.messages.latched import latched_messages
from dragon_ros.messages.markers import BLACK, CUBE, LINE_LIST, LINE_STRIP, TEXT_VIEW_FACING, MarkerSpec, put_marker
from dragon_ros.messages.surroundings import CellRules, read_grid, read_venue

VENUE = Venue((PolygonObstacle('yard', ((20, 0), (30, 0), (30, 9), (20, 9)), (((22, 2), (24, 2), (24, 4)),)),
               LineObstacle('wall', ((-40, -20), (-40, 0), (-35, 5)))), ((-60, -60), (60, -60), (60, 60), (-60, 60)))
TURN = np.exp(0.5j)


def markers(*specs):
    """Return a MarkerArray of markers given as (spec, points, frame)."""
    writer = Writer()
    writer.put('I', len(specs))
    for spec, points, frame in specs:
        start = put_marker(writer, replace(spec, points=len(points)), frame).points
        np.frombuffer(writer.data, '<f8', 3 * len(points), start).reshape(-1, 3)[:, :2] = np.reshape(points, (-1, 2))
    return bytes(writer.finish())


def line(kind=LINE_LIST, number=0, **more):
    return MarkerSpec('venue', number, kind, (0.1, 0, 0), BLACK, **more)


def grid(cells, resolution_m=0.5, origin=(0, 0, 0, 0, 0, 0, 1), frame='map', size=None):
    """Return a nav_msgs/OccupancyGrid with rows of cells."""
    cells, writer = np.array(cells, np.int8), Writer()
    writer.header(frame, 0)
    writer.put('I', 0, 0)
    writer.put('f', resolution_m)
    writer.put('I', *(size or cells.shape[::-1]))
    writer.put('d', *origin)
    writer.put('I', cells.size)
    writer.put('b', *cells.ravel().tolist())
    return bytes(writer.finish())


def test_the_venue_of_a_sim_is_read_back_to_the_last_bit():
    found, wanted = read_venue(latched_messages(replace(Scene(), venue=VENUE), 'sea')['venue']), surroundings_of(VENUE)
    assert (found.frame_id, found.left_out, found.around.names) == ('sea', '', ('yard', 'wall', 'inside'))
    assert found.around.side.tolist() == wanted.side.tolist() == [OUTSIDE, LINE, WITHIN]
    for name in ('start', 'stop', 'owner'):
        assert np.array_equal(getattr(found.around, name), getattr(wanted, name))


def test_lines_of_other_publishers_are_obstacles_with_their_pose_and_a_name_or_number():
    quarter = float(np.sqrt(0.5))
    found = read_venue(markers(
        (line(LINE_STRIP, 7, place=(10, 0, 3), turn=(quarter, quarter)), [(0, 0), (2, 0), (2, 0), (2, 1)], 'hall'),
        (MarkerSpec('venue names', 7, TEXT_VIEW_FACING, (0, 0, 1), BLACK, text='fence'), [], 'hall'),
        (line(LINE_LIST, 9), [(0, 0), (1, 1), (5, 5), (6, 6), (7, 7)], 'hall'),
        (line(CUBE, 3), [], 'hall'), (MarkerSpec('trees', 1, LINE_LIST, (1, 0, 0), BLACK), [(0, 0), (1, 1)], 'hall')))
    around = found.around
    assert (found.frame_id, around.names, around.side.tolist()) == ('hall', ('fence', 'obstacle 9'), [LINE, LINE])
    assert np.allclose(around.start, [10, 10 + 2j, 0, 5 + 5j], atol=1e-14)
    assert np.allclose(around.stop, [10 + 2j, 9 + 2j, 1 + 1j, 6 + 6j], atol=1e-14)
    assert found.left_out == '1 marker in the namespace venue is neither LINE_LIST nor LINE_STRIP'


def test_a_message_without_edges_empties_the_venue():
    assert read_venue(markers()).around is None
    assert read_venue(markers((line(), [(1, 1), (1, 1)], 'hall'))).around is None
    assert read_venue(markers((line(action=3), [(1, 1), (2, 1)], 'hall'))).around is None


@pytest.mark.parametrize(('data', 'why'), [
    (markers((line(), [(0, 0), (1, 1)], 'a'), (line(number=1), [(0, 0), (1, 1)], 'b')), 'several frames: a, b'),
    (markers((line(number=4), [(0, 0), (np.nan, 1)], 'a')), 'marker 4 has a point that is not finite'),
    (markers((line(place=(np.inf, 0, 0)), [(0, 0), (1, 1)], 'a')), 'is not finite'),
    (b'rubbish', 'not plain CDR')], ids=['frames', 'point', 'pose', 'bytes'])
def test_an_unusable_venue_is_refused_with_the_reason(data, why):
    with pytest.raises(MessageError, match=why):
        read_venue(data)


def test_a_venue_of_too_many_edges_is_refused(monkeypatch):
    monkeypatch.setattr(surroundings, 'MAP_EDGES', 2)
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    assert read_venue(markers((line(LINE_STRIP), square[:3], 'hall'))).around.start.size == 2
    for data in (markers((line(LINE_STRIP), square, 'hall')),
                 markers((line(LINE_STRIP), square[:3], 'hall'), (line(number=1), square[:2], 'hall'))):
        with pytest.raises(MessageError, match='more than 2 edges'):
            read_venue(data)


def test_cells_from_the_threshold_on_are_obstacles_where_the_rotated_origin_puts_them():
    half = float(np.angle(TURN)) / 2
    origin = (3, -1, 9, 0, 0, np.sin(half), np.cos(half))
    cells = [[0, 64, -1, 0], [0, 65, 100, -1]]
    found = read_grid(grid(cells, origin=origin), CellRules())
    assert (found.frame_id, found.around.names, found.around.side.tolist()) == ('map', ('map',), [OUTSIDE])
    corners = {complex(round(z.real, 9), round(z.imag, 9)) for z in
               ((np.append(found.around.start, found.around.stop) - (3 - 1j)) / TURN / 0.5).tolist()}
    assert corners == {1 + 1j, 3 + 1j, 3 + 2j, 1 + 2j}
    with_unknown = read_grid(grid(cells, origin=origin), CellRules(unknown=True)).around
    assert joined([with_unknown, found.around]).names == ('map', 'map')
    assert with_unknown.start.size > found.around.start.size
    assert read_grid(grid(cells), CellRules(101)).around is None
    assert np.sum(read_grid(grid(cells), CellRules(64)).around.half_m) == pytest.approx(0.5 * 8 / 2)
    assert read_grid(grid(np.zeros((0, 0))), CellRules()).around is None


def test_a_resolution_is_the_decimal_number_that_was_meant():
    assert read_grid(grid([[100]], 0.05), CellRules()).around.stop.real.max() == 0.05


@pytest.mark.parametrize(('data', 'why'), [
    (grid([[0, 0]], size=(3, 1)), 'it has 2 cells; its width and height are 3 and 1'),
    (grid([[0, 0]], 0.0), 'resolution: 0 m is outside'), (grid([[0]], np.nan), 'resolution: nan m is outside'),
    (grid([[0]], origin=(0, 0, 0, 0, 0.1, 0, 0.99)), 'origin: it is tilted'),
    (grid([[0]], origin=(np.nan, 0, 0, 0, 0, 0, 1)), 'origin: .* is not finite'), (grid([[0]])[:-4], 'the bytes end')],
    ids=['size', 'zero', 'nan', 'tilt', 'origin', 'short'])
def test_an_unusable_grid_is_refused_with_the_reason(data, why):
    with pytest.raises(InputError, match=why):
        read_grid(data, CellRules())


def test_a_grid_beyond_the_budget_is_refused(monkeypatch):
    from dragon_ros.messages import surroundings
    monkeypatch.setattr(surroundings, 'MAP_BYTES', 50)
    with pytest.raises(MessageError, match='the limit is 50; reduce its resolution'):
        read_grid(grid([[0]]), CellRules())
