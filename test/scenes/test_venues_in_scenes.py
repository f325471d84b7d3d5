"""Venues in scene files, inline or from GeoJSON and WKT, and in the scene of a bag."""
import json
import re

import numpy as np
import pytest

from dragon_ros.core.errors import DragonError, InputError
from dragon_ros.core.limits import SCENE_CHARACTERS, VENUE_BYTES
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.venue import LineObstacle, Origin, PolygonObstacle, Venue
from dragon_ros.scenes.georeference import degrees_of, own_origin, placed
from dragon_ros.scenes.load import changed_scene, load_scene, load_venue, scene_of, scene_values, strangers_scene
from dragon_ros.scenes.maps import read_drawing
from dragon_ros.scenes.provenance import scene_file
from dragon_ros.scenes.venue_files import venue_values
from dragon_ros.scenes.yaml import parse_document

TRACK = 'track: {kind: joined, pieces: [{kind: line, length_m: 50}], start_m: 20}\ndragon: {benches: 5}\n'
WALL = '{kind: line, name: wall, points_m: [[0, 3], [50, 3]]}'
BOX = [[30, 5], [34, 5], [34, 9], [30, 9], [30, 5]]
COLLECTION = {'type': 'FeatureCollection', 'features': [
    {'type': 'Feature', 'properties': {'name': 'Inside'}, 'geometry': {'type': 'Polygon', 'coordinates': [
        [[-50, -9], [60, -9], [60, 9], [-50, 9], [-50, -9]], [[50, 5], [51, 5], [51, 6], [50, 5]]]}},
    {'type': 'Feature', 'properties': {'name': 'house'}, 'geometry': {'type': 'Polygon', 'coordinates': [
        BOX, [[31, 6], [32, 6], [32, 7], [31, 6]]]}},
    {'type': 'Feature', 'properties': None, 'id': 7, 'geometry': {
        'type': 'MultiLineString', 'coordinates': [[[0, -4, 2.5], [9, -4, 2.5]], [[20, -4, 0], [29, -4, 0]]]}}]}


def scene_with(venue):
    return scene_of(parse_document('f', f'{TRACK}venue: {venue}'))


def test_points_are_pairs_or_text():
    pairs = scene_with(f'{{margin_m: 0.5, obstacles: [{WALL}], inside: [[-50, -9], [60, -9], [60, 9], [-50, 9]]}}')
    text = scene_with("{margin_m: 0.5, obstacles: [{kind: line, name: wall, points_m: '0 3, 50 3'}], "
                      "inside: '-50 -9, 60 -9, 60 9, -50 9'}")
    assert pairs == text
    wall = LineObstacle('wall', ((0, 3), (50, 3)))
    assert pairs.venue == Venue((wall,), ((-50, -9), (60, -9), (60, 9), (-50, 9)), 0.5)


def test_a_scene_without_a_venue_says_nothing_of_one():
    assert 'venue' not in scene_values(Scene())
    assert 'venue' not in scene_file(Scene())
    assert scene_of(parse_document('f', 'venue: null')) == Scene()


@pytest.mark.parametrize('name', ['street', 'square'])
def test_a_bag_carries_the_whole_venue(name):
    scene = load_scene(name)
    text = scene_file(scene)
    assert strangers_scene('bag', text) == scene
    assert scene_of(parse_document('again', json.dumps(scene_values(scene)))) == scene


def test_corners_of_a_venue_have_a_budget_of_their_own():
    """The budget for the text of an untrusted scene still applies to everything except the corners."""
    points = tuple((n / 7, 1e3 + n / 3) for n in range(5_000))
    scene = Scene(venue=Venue((LineObstacle('far', points), PolygonObstacle('box', tuple(map(tuple, BOX[:-1]))))))
    text = scene_file(scene)
    assert len(text) > 2 * SCENE_CHARACTERS
    assert strangers_scene('bag', text) == scene
    with pytest.raises(InputError, match=r'bag: it has \d+ characters'):
        strangers_scene('bag', f'{text}\n# {"-" * SCENE_CHARACTERS}\n')
    with pytest.raises(InputError, match=r'bag: it has \d+ characters'):
        strangers_scene('bag', f'{text}\n{"  - 1 1, 2 2" * (VENUE_BYTES // 10)}\n')


def test_a_bag_cannot_have_a_file_read():
    with pytest.raises(InputError, match=r'venue\.file: venue files are read only for scene files'):
        strangers_scene('bag', f'{TRACK}venue: {{file: /etc/passwd}}')


@pytest.mark.parametrize(('venue', 'says'), [
    ('{obstacles: [{kind: line, name: wall, points_m: [[0, 3], [9]]}]}', r'f:3: venue\.obstacles\.1\.points_m: '),
    ("{obstacles: [{kind: line, name: wall, points_m: '0 3, x 1'}]}", r"f:3: .*points_m: '0 3, x 1' contains no "
                                                                      r"points"),
    ('{obstacles: [{kind: line, name: wall}]}', r'f:3: venue\.obstacles\.1\.points_m: it is missing'),
    ('{obstacles: [{kind: disc, name: wall}]}', r'f:3: venue\.obstacles\.1\.kind: .disc. is not known; the kinds are'),
    ('{obstacles: [{name: wall}]}', r'f:3: venue\.obstacles\.1: its value is .*write for example {kind: line'),
    ('{obstacles: [{kind: polygon, name: a, points_m: [[9, 9], [8, 9], [8, 8]], holes_m: 3}]}', r'f:3: .*holes_m: 3 '),
    ('{}', r'f:3: venue\.obstacles: 0 '),
    ('{obstacle: []}', r'f:3: venue\.obstacle: unknown key; did you mean obstacles\?'),
    ('{obstacles: [{kind: line, name: rope, points_m: [[12, -1], [12, 1]]}]}',
     r"f:3: venue\.obstacles\.1: 'rope' .* bench \d touches it when the run starts; move it, or start the run"),
    ('{obstacles: [{kind: polygon, name: tent, points_m: [[-99, -9], [99, -9], [0, 99]]}]}',
     r"f:3: venue\.obstacles\.1: 'tent' .* this obstacle covers the dragon when the run starts"),
    ('{inside: [[12, -9], [30, -9], [30, 9], [12, 9]]}', r"f:3: venue\.inside: 'inside' .* bench \d touches it"),
    ('{inside: [[70, -9], [99, -9], [99, 9]]}', r"f:3: venue\.inside: 'inside' .* is outside this polygon when")])
def test_bad_venues_name_file_line_and_obstacle(venue, says):
    with pytest.raises(InputError) as error:
        scene_with(venue)
    assert re.match(says, str(error.value)), str(error.value)
    assert '\n' not in str(error.value)


def written(folder, values, name='v.geojson'):
    path = folder / name
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return path


def test_geojson_in_metres_has_names_holes_parts_and_the_inside(tmp_path):
    path = written(tmp_path, {**COLLECTION, 'units': 'm'})
    (tmp_path / 'scene.yaml').write_text(f'{TRACK}venue: {{file: v.geojson, margin_m: 0.25}}')
    venue = load_scene(str(tmp_path / 'scene.yaml')).venue
    assert venue == changed_scene('winding', {
        'track': {'kind': 'joined', 'pieces': [{'kind': 'line', 'length_m': 50}], 'start_m': 20},
        'dragon': {'benches': 5}, 'venue': {'file': str(path), 'margin_m': 0.25}}).venue
    assert venue.names == ('hole 1 of inside', 'house', '7 1', '7 2', 'inside')
    assert venue.obstacles[1] == PolygonObstacle('house', tuple(map(tuple, BOX[:-1])), (((31, 6), (32, 6), (32, 7)),))
    assert venue.obstacles[2] == LineObstacle('7 1', ((0, -4), (9, -4)))
    assert len(venue.inside) == 4
    assert load_scene(str(tmp_path / 'scene.yaml'), ['venue.margin_m=1']).venue.margin_m == 1.0


@pytest.mark.parametrize(('lon', 'origin'), [(113.1, (0.0, 0.0)), (113.1, (113.3, 23.0)), (180.0, None)])
def test_degrees_far_from_their_origin_are_rejected(tmp_path, lon, origin):
    pytest.importorskip('pyproj')
    east = lon + 0.001 if lon < 180 else -179.999
    drawing = read_drawing(written(tmp_path, {'type': 'LineString', 'coordinates': [[lon, 23.0], [east, 23.0],
                                                                                    [east, 23.001]]}))
    lines = [drawing.features[0].geometry]
    about = Origin(origin) if origin else own_origin('v', lines, drawing.crs)
    with pytest.raises(InputError, match=r'it reaches \S+ km from the origin .* the limit is 10 km; give an origin'):
        placed('v', lines, drawing.crs, about)


def test_wkt_has_a_geometry_a_line_with_its_name(tmp_path):
    text = '# a street\nwall: LINESTRING (0 3, 50 3)\n\nPOLYGON ((30 5, 34 5, 34 9, 30 5))\n'
    path = written(tmp_path, text, 'v.wkt')
    assert venue_values(path)['obstacles'] == [
        {'kind': 'line', 'name': 'wall', 'points_m': [[0, 3], [50, 3]]},
        {'kind': 'polygon', 'name': 'obstacle 2', 'points_m': [[30, 5], [34, 5], [34, 9], [30, 5]]}]


def test_degrees_become_metres_about_their_middle(tmp_path):
    pyproj = pytest.importorskip('pyproj')
    lonlat = [[113.1, 23.0], [113.102, 23.0], [113.102, 23.001], [113.1, 23.001], [113.1, 23.0]]
    geometry = {'type': 'Polygon', 'coordinates': [lonlat]}
    values = {'type': 'Feature', 'properties': {'name': 'block'}, 'geometry': geometry}
    points, origin = placed_ring(written(tmp_path, values))
    assert origin == Origin((113.101, 23.0005))
    _, _, along = pyproj.Geod(ellps='WGS84').inv(*np.array(lonlat[:-1]).T, *np.array(lonlat[1:]).T)
    assert np.hypot(*np.diff(points, axis=0).T) == pytest.approx(along, abs=1e-5)
    assert np.abs(points[:4].mean(axis=0)).max() < 1e-3
    assert points[1, 0] > 0 > points[1, 1]      # east is x, north is y
    moved, _ = placed_ring(tmp_path / 'v.geojson', Origin((113.1, 23.0)))
    assert moved[0] == pytest.approx((0, 0), abs=1e-9)
    to_utm = pyproj.Transformer.from_crs('OGC:CRS84', 'EPSG:32649', always_xy=True)
    utm = np.stack(to_utm.transform(*np.array(lonlat).T), 1)
    crs = {'type': 'name', 'properties': {'name': 'urn:ogc:def:crs:EPSG::32649'}}
    geometry = {'type': 'Polygon', 'coordinates': [utm.tolist()]}
    again, origin = placed_ring(written(tmp_path, {**values, 'crs': crs, 'geometry': geometry}))
    assert origin == Origin((113.101, 23.0005))
    assert again == pytest.approx(points, abs=1e-5)


def placed_ring(path, origin=None):
    """Return the corners of the only polygon of a map in metres, and the origin, by default the map's own."""
    drawing = read_drawing(path)
    shapes = [drawing.features[0].geometry]
    origin = origin or own_origin('v', shapes, drawing.crs)
    return np.array(placed('v', shapes, drawing.crs, origin)[0].exterior.coords), origin


@pytest.mark.parametrize(('name', 'text', 'says'), [
    ('a.geojson', '{', 'is not GeoJSON'), ('a.geojson', '[]', 'not an object'),
    ('a.geojson', '{"type": "FeatureCollection"}', 'not a list'),
    ('a.geojson', '{"type": "FeatureCollection", "features": [3]}', 'a feature is not an object'),
    ('a.geojson', '{"type": "FeatureCollection", "features": []}', 'is empty; draw lines and obstacles'),
    ('a.geojson', '{"type": "Feature", "properties": {"name": "post"}, "geometry": null}',
     r'is empty .1 without geometry.; draw'),
    ('a.geojson', '{"type": "Point", "coordinates": [1, 2], "units": "m"}', r'no obstacle .not obstacles: 1 points.'),
    ('a.geojson', '{"type": "Polygon", "coordinates": [], "units": "m"}', 'is empty .1 without geometry'),
    ('a.geojson', '{"type": "Polygon", "coordinates": 3, "units": "m"}', 'is not GeoJSON'),
    ('a.geojson', '{"type": "LineString", "coordinates": [[1, 2], [300, 2]]}', 'not degrees .*write "units": "m"'),
    ('a.geojson', '{"type": "LineString", "coordinates": [[1, 2], [NaN, 2]]}', 'not a finite number'),
    ('a.geojson', '{"type": "LineString", "coordinates": [[1, 2], [3, 2]], "units": "feet"}', "'feet' is neither"),
    ('a.geojson', '{"type": "LineString", "coordinates": [[1, 2], [3, 2]], "crs": 3}', 'crs: it names no reference'),
    ('a.wkt', 'wall: LINE (0 0)', r'a\.wkt:1: it is not WKT: '), ('a.wkt', 'POINT (1 2)', 'does not state whether'),
    ('a.wkt', 'units: m\nPOINT (1 2)', 'no obstacle'),
    ('a.wkt', 'CIRCULARSTRING (0 1, 1 1, 2 2)', r'a\.wkt:1: it is not WKT: .*(Nonlinear|CIRCULARSTRING)'),
    ('a.svg', '', 'the suffix .svg is not'), ('b.wkt', None, 'b.wkt: cannot be read'),
    ('a.geojson', '{"type": "FeatureCollection", "units": "m", "features": [' + ', '.join(
        ['{"type": "Feature", "properties": {"name": "inside"}, "geometry": {"type": "LineString", "coordinates": '
         '[[0, 0], [1, 1]]}}'] * 2) + ']}', 'inside: it is a LineString')])
def test_bad_files_are_refused_in_one_line(tmp_path, name, text, says):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(DragonError, match=says) as error:
        venue_values(tmp_path / name)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(('venue', 'says'), [
    ('{file: 3}', 'venue.file: 3 is not a file name'),
    ('{file: v.wkt, origin_deg: 3}', 'lon_lat_deg: 3 is not a position'),
    ('{origin_deg: [1, 2]}', 'needs obstacles or an inside'),
    ('{inside: "0 0, 1 0, 1 1", origin_deg: [1, 91]}', 'lon_lat_deg: 91 is not valid: the largest is 90'),
    ('{file: v.wkt, obstacles: []}', r'venue.obstacles: v.wkt defines it too; remove one of them'),
    ('{file: none.wkt}', 'none.wkt: cannot be read')])
def test_a_file_is_named_as_a_whole(tmp_path, venue, says):
    written(tmp_path, 'wall: LINESTRING (0 3, 50 3)', 'v.wkt')
    (tmp_path / 'scene.yaml').write_text(f'{TRACK}venue: {venue}')
    with pytest.raises(DragonError, match=says):
        load_scene(str(tmp_path / 'scene.yaml'))


@pytest.mark.parametrize(('name', 'content'), [
    ('v.wkt', 'wall: LINESTRING (0 3, 50 3)'),
    ('v.geojson', {'type': 'LineString', 'units': 'm', 'coordinates': [[0, 3], [50, 3]]})])
def test_a_file_in_metres_stays_as_it_is_where_its_origin_is_given(tmp_path, name, content):
    written(tmp_path, content, name)
    for given, origin in (('', None), (', origin_deg: [113.1, 23]', Origin((113.1, 23.0)))):
        (tmp_path / 'scene.yaml').write_text(f'{TRACK}venue: {{file: {name}{given}}}')
        scene = load_scene(str(tmp_path / 'scene.yaml'))
        assert scene.origin == origin
        assert [tuple(point) for point in scene.venue.obstacles[0].points_m] == [(0, 3), (50, 3)]


def test_a_file_in_degrees_is_placed_about_the_origin_of_the_scene_and_refused_without_one(tmp_path):
    pytest.importorskip('pyproj')
    written(tmp_path, {'type': 'LineString', 'coordinates': [[113.1, 23.0], [113.102, 23.001]]})
    path = tmp_path / 'scene.yaml'
    path.write_text(f'{TRACK}venue: {{file: v.geojson}}')
    with pytest.raises(InputError, match=r'v.geojson lies on a map, .* origin: {lon_lat_deg: \[113.101, 23.0005\]}'):
        load_scene(str(path))
    with pytest.raises(InputError, match='lies on a map'):
        load_venue(str(tmp_path / 'v.geojson'))
    given = load_scene(str(path), ['venue.origin_deg=[113.1, 23.0]'])
    assert given == load_scene(str(path), ['origin.lon_lat_deg=[113.1, 23.0]'])
    assert given.origin == Origin((113.1, 23.0))
    assert given.venue.obstacles[0].points_m[0] == pytest.approx((0, 0), abs=1e-9)
    path.write_text(f'{TRACK}origin: {{lon_lat_deg: [113.101, 23.0005]}}\nvenue: {{file: v.geojson}}')
    scene = load_scene(str(path))
    assert strangers_scene('bag', scene_file(scene)) == scene
    for key in ('venue.origin_deg', 'origin'):
        assert load_scene(str(path), [f'{key}=null']).origin is None
        assert load_scene(str(path), [f'{key}=null']).venue == scene.venue


def test_metres_become_the_degrees_that_they_came_from(tmp_path):
    pytest.importorskip('pyproj')
    lonlat = [[113.1, 23.0], [113.102, 23.0], [113.102, 23.001]]
    drawing = read_drawing(written(tmp_path, {'type': 'LineString', 'coordinates': lonlat}))
    lines = [drawing.features[0].geometry]
    for origin in (own_origin('v', lines, drawing.crs), Origin(map_m=(715e3, 2545e3), crs='EPSG:32649')):
        back = degrees_of(placed('v', lines, drawing.crs, origin)[0], origin)
        assert np.array(back.coords) == pytest.approx(np.array(lonlat), abs=1e-9)
    with pytest.raises(InputError, match='origin.crs'):
        degrees_of(lines[0], Origin(map_m=(715e3, 2545e3)))


@pytest.mark.parametrize('name', ['street', 'square'])
def test_nothing_is_touched_in_the_venues_of_the_package(name):
    found = first_contact(load_scene(name))
    assert isinstance(found, NoContact)
    assert found.certificate.complete
