"""Maps in the formats that people have are read as lines and obstacles, and what is neither is counted."""
import json
import zipfile
from contextlib import suppress

import pytest

from dragon_ros.core.errors import DragonError
from dragon_ros.core.limits import KMZ_FILES
from dragon_ros.scenes.drawings import map_line
from dragon_ros.scenes.maps import read_drawing
from dragon_ros.scenes.venue_files import has_obstacles, venue_of, without_lines

pytest.importorskip('pyproj')
GPX = ('<?xml version="1.0"?><gpx xmlns="http://www.topografix.com/GPX/1/1"><wpt lat="30.1" lon="120">'
       '<name>start</name>'
       '</wpt><trk><name>walk</name><trkseg><trkpt lat="30" lon="120"><time>2026-01-01T00:00:00Z</time></trkpt>'
       '<trkpt lat="30.001" lon="120"/></trkseg></trk><rte><name>plan</name><rtept lat="30" lon="120"/>'
       '<rtept lat="30" lon="120.001"/></rte></gpx>')
KML = ('<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><Folder>'
       '<Placemark><name>way</name><LineString><coordinates> 120,30,0 120.001,30,0\n120.001,30.001,0</coordinates>'
       '</LineString></Placemark><Placemark><name>kiosk</name><Polygon><outerBoundaryIs><LinearRing><coordinates>'
       '120,30.0005 120.0001,30.0005 120.0001,30.0006 120,30.0005</coordinates></LinearRing></outerBoundaryIs>'
       '</Polygon>'
       '</Placemark><Placemark><name>pole</name><Point><coordinates>120,30</coordinates></Point></Placemark></Folder>'
       '</Document></kml>')
OSM = ('<osm version="0.6"><node id="1" lat="30" lon="120"/><node id="2" lat="30" lon="120.001"/>'
       '<node id="3" lat="30.001"'
       ' lon="120.001"/><node id="4" lat="30.001" lon="120"/><node id="5" lat="30.0002" lon="120.0002">'
       '<tag k="highway" '
       'v="crossing"/></node><way id="10"><nd ref="1"/><nd ref="2"/><tag k="highway" v="pedestrian"/><tag k="name" '
       'v="Market Street"/></way><way id="11"><nd ref="2"/><nd ref="3"/><tag k="highway" v="pedestrian"/><tag k="name" '
       'v="Market Street"/></way><way id="12"><nd ref="1"/><nd ref="3"/><nd ref="4"/><nd ref="1"/><tag k="building" '
       'v="yes"/></way><way id="13"><nd ref="3"/><nd ref="4"/><tag k="barrier" v="wall"/></way><way id="14">'
       '<nd ref="1"/>'
       '<nd ref="2"/><nd ref="3"/><nd ref="1"/><tag k="landuse" v="grass"/></way></osm>')


def read(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    return read_drawing(path)


def obstacles(drawing):
    line = map_line(drawing, None if len({one.name for one in drawing.features}) == 1 else 'way')
    return venue_of(without_lines(drawing), line.own_origin())


def test_a_gpx_file_has_tracks_and_routes(tmp_path):
    drawing = read(tmp_path, 'a.gpx', GPX)
    assert [*map_line(drawing, 'walk').geometry.coords] == [(120, 30), (120, 30.001)]
    assert [*map_line(drawing, 'plan').geometry.coords] == [(120, 30), (120.001, 30)]
    with pytest.raises(DragonError, match=r'2 lines .walk, plan.'):
        map_line(drawing, None)


@pytest.mark.parametrize('name', ['a.kml', 'a.kmz'])
def test_a_file_with_a_path_and_polygons_holds_a_track_and_obstacles(tmp_path, name):
    path = tmp_path / name
    if name == 'a.kml':
        path.write_text(KML)
    else:
        with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
            archive.writestr('doc.kml', KML)
    drawing = read_drawing(path)
    assert has_obstacles(drawing)
    assert len(map_line(drawing, None).geometry.coords) == 3
    found = obstacles(drawing)
    assert [one['name'] for one in found.values['obstacles']] == ['kiosk']
    assert found.notes == (f'{name}: not obstacles: 1 points',)


def test_an_openstreetmap_export_is_read_as_a_whole_and_counts_what_is_no_obstacle(tmp_path):
    drawing = read(tmp_path, 'a.osm', OSM)
    line = map_line(drawing, 'Market Street')
    assert len(line.geometry.coords) == 3
    found = venue_of(drawing, line.own_origin())
    assert [(one['kind'], one['name']) for one in found.values['obstacles']] == [('polygon', 'way/12'), (
        'line', 'way/13')]
    assert found.notes == ('a.osm: not obstacles: 2 highway, 1 points, 1 landuse',)


def test_repeated_names_are_numbered_and_outlines_that_cross_themselves_repaired(tmp_path):
    square = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]]
    features = [{'type': 'Feature', 'properties': {'name': name}, 'geometry': geometry} for name, geometry in (
        ('house', {'type': 'Polygon', 'coordinates': [square]}),
        ('house', {'type': 'Polygon', 'coordinates': [[[x + 9, y] for x, y in square]]}),
        ('bow', {'type': 'Polygon', 'coordinates': [[[0, 9], [4, 13], [4, 9], [0, 13], [0, 9]]]}),
        ('none', None), ('pole', {'type': 'Point', 'coordinates': [3, 3]}))]
    drawing = read(tmp_path, 'a.geojson', json.dumps({'type': 'FeatureCollection', 'units': 'm', 'features': features}))
    found = venue_of(drawing, None)
    assert [one['name'] for one in found.values['obstacles']] == ['house', 'house 2', 'bow 1', 'bow 2']
    assert 'not obstacles: 1 without geometry, 1 points' in found.notes[0]
    assert 'repaired: 1 outlines' in found.notes[1]


@pytest.mark.parametrize(('name', 'text', 'says'), [
    ('a.dxf', '', 'open it in QGIS'), ('a.fit', '', 'export it as GPX'), ('a.png', '', 'Inkscape'),
    ('a.xyz', '', 'convert it to one of these: .geojson'), ('a.gpx', '<gpx><trk>', 'is not GPX'),
    ('a.gpx', '<!DOCTYPE g [<!ENTITY a "b">]><gpx>&a;</gpx>', 'entities'),
    ('a.gpx', '<gpx><wpt lat="x" lon="1"/></gpx>', 'not two numbers'), ('a.kmz', 'PK', 'is not KMZ'),
    ('a.osm', '<osm/>', 'is empty')])
def test_other_formats_and_broken_files_are_refused_with_a_cure(tmp_path, name, text, says):
    with pytest.raises(DragonError, match=says):
        read(tmp_path, name, text)


def test_an_archive_is_unpacked_within_budgets(tmp_path):
    path = tmp_path / 'a.kmz'
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        archive.writestr('doc.kml', b' ' * (17 * 2**20))
    with pytest.raises(DragonError, match='unpacked, it is too large'):
        read_drawing(path)
    with zipfile.ZipFile(path, 'w') as archive:
        for n in range(KMZ_FILES + 1):
            archive.writestr(f'{n}.png', b'')
    with pytest.raises(DragonError, match='holds 1001 files'):
        read_drawing(path)


@pytest.mark.parametrize('how', [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_an_archive_that_cannot_be_unpacked_is_refused(tmp_path, how):
    path = tmp_path / 'a.kmz'
    with zipfile.ZipFile(path, 'w', how) as archive:
        archive.writestr('doc.kml', KML)
    whole = path.read_bytes()
    for at in range(30, whole.index(b'PK\1\2')):
        path.write_bytes(whole[:at] + b'\xff' + whole[at + 1:])
        with suppress(DragonError):
            read_drawing(path)


def test_a_polygon_that_was_added_to_an_openstreetmap_export_is_an_obstacle(tmp_path):
    square = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]]
    features = [{'type': 'Feature', 'properties': properties, 'geometry': {
        'type': 'Polygon', 'coordinates': [[[x + 9 * n, y] for x, y in square]]}} for n, properties in enumerate((
            {'building': True, '@id': 'way/1'}, {'landuse': 'grass', '@id': 'way/2'}, {'osm_id': 3, 'layer': '1'},
            {'name': 'stall', 'fill': '#f00'}))]
    drawing = read(tmp_path, 'a.geojson', json.dumps({'type': 'FeatureCollection', 'units': 'm', 'features': features}))
    found = venue_of(drawing, None)
    assert [one['name'] for one in found.values['obstacles']] == ['obstacle 1', 'stall']
    assert found.notes == ('a.geojson: not obstacles: 1 landuse, 1 features without a kind',)
