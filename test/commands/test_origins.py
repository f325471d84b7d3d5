"""A scene has one origin: a line and obstacles from any two maps are placed about it, in either order, or refused."""
import json
import struct

import numpy as np
import pytest
from mcap.writer import Writer

from dragon_ros.__main__ import main
from dragon_ros.core.search.venue_fit import venue_fit
from dragon_ros.core.venue import Origin
from dragon_ros.scenes.load import changed_scene, load_scene, scene_of
from dragon_ros.scenes.provenance import scene_file
from dragon_ros.scenes.yaml import parse_document

pyproj = pytest.importorskip('pyproj')
EAST_M, NORTH_M, CRS = 500_000.0, 3_400_000.0, 'EPSG:32650'
WAY = [(0.0, 0.0), (200.0, 0.0)]
KIOSK = [(149.0, 4.0), (151.0, 4.0), (151.0, 6.0), (149.0, 6.0), (149.0, 4.0)]
GAP_M = 4.0 - 0.15      # from the side of a bench to the kiosk
DRAGON = 'dragon: {benches: 20, head_length_m: 2.1, body_length_m: 2.1}\n'


def on_map(points):
    return [(EAST_M + x, NORTH_M + y) for x, y in points]


def degrees(points):
    x, y = np.array(on_map(points)).T.tolist()
    return [*zip(*pyproj.Transformer.from_crs(CRS, 'OGC:CRS84', always_xy=True).transform(x, y), strict=True)]


def wkt(kind, points):
    text = ', '.join(f'{x!r} {y!r}' for x, y in points)
    return f'POLYGON (({text}))' if kind == 'Polygon' else f'LINESTRING ({text})'


def geojson(kind, points, **more):
    values = [points] if kind == 'Polygon' else points
    return json.dumps({'type': 'Feature', 'properties': {'name': 'kiosk' if kind == 'Polygon' else 'way'},
                       'geometry': {'type': kind, 'coordinates': values}, **more})


def crs(name):
    return {'type': 'name', 'properties': {'name': name}}


def path_message(points):
    """Return a nav_msgs/Path in the frame utm, in CDR."""
    data = bytearray(b'\0\1\0\0')

    def put(kind, *values):
        size = struct.calcsize(kind[0])
        data.extend(bytes(-(len(data) - 4) % size) + struct.pack(f'<{kind}', *values))

    def header():
        put('i', 0), put('I', 0), put('I', 4)
        data.extend(b'utm\0')
    header()
    put('I', len(points))
    for x, y in points:
        header()
        for value in (x, y, 0, 0, 0, 0, 1):
            put('d', value)
    return bytes(data)


def bag(path, points):
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema('nav_msgs/msg/Path', 'ros2msg', b'')
        writer.add_message(writer.register_channel('/plan', 'cdr', schema), 0, path_message(points), 0)
        writer.finish()


# The suffix and the text of a map with one shape, by the way in which it is placed. On earth, or on a map in metres.
EARTH = {
    'geojson in degrees': ('.geojson', lambda kind, at: geojson(kind, degrees(at))),
    'geojson with a crs': ('.geojson', lambda kind, at: geojson(kind, on_map(at), crs=crs(CRS))),
    'wkt with an srid': ('.wkt', lambda kind, at: f'SRID=32650;{wkt(kind, on_map(at))}'),
    'wkt in degrees': ('.wkt', lambda kind, at: f'units: degrees\n{wkt(kind, degrees(at))}')}
MAP = {'geojson in map metres': ('.geojson', lambda kind, at: geojson(kind, on_map(at), units='m')),
       'wkt in map metres': ('.wkt', lambda kind, at: wkt(kind, on_map(at)))}
LOCAL = {'geojson in metres': ('.geojson', lambda kind, at: geojson(kind, at, units='m')),
         'wkt in metres': ('.wkt', lambda kind, at: wkt(kind, at))}
LINES = {'csv in degrees': ('.csv', lambda kind, at: 'lon,lat\n' + ''.join(f'{x!r},{y!r}\n' for x, y in degrees(at))),
         'csv in map metres': ('.csv', lambda kind, at: ''.join(f'{x!r},{y!r}\n' for x, y in on_map(at))),
         'csv in metres': ('.csv', lambda kind, at: ''.join(f'{x!r},{y!r}\n' for x, y in at)),
         'path in map metres': ('.mcap', None), 'path shifted by its pose': ('.mcap', None),
         'svg': ('.svg', lambda kind, at: '<svg xmlns="http://www.w3.org/2000/svg" width="200" height="0.5" '
                                          'viewBox="0 0 200 0.5"><path id="way" d="M 0,0.5 H 200"/></svg>')}
PLACED = {**dict.fromkeys(EARTH, 'earth'), **dict.fromkeys(MAP, 'map'), **dict.fromkeys(LOCAL, 'local'),
          'csv in degrees': 'earth', 'csv in map metres': 'map', 'path in map metres': 'map', 'csv in metres': 'local',
          'path shifted by its pose': 'local', 'svg': 'local'}
EVERY = {**EARTH, **MAP, **LOCAL}


def written(folder, what):
    """Write the line in a form; return its path and the options that it needs."""
    suffix, text = {**EVERY, **LINES}[what]
    path = folder / f'way{suffix}'
    if text is None:
        bag(path, on_map(WAY))
        pose = '0,0,0' if what == 'path in map metres' else f'{-EAST_M},{-NORTH_M},0'
        return path, (f'--frame-pose={pose}',)
    path.write_text(text('LineString', WAY))
    return path, (('--unit', '1') if suffix == '.svg' else ())


def run(capsys, command, *arguments):
    try:
        code = main([command, *map(str, arguments)])
    except SystemExit as stop:
        code = stop.code
    return code, *capsys.readouterr()


@pytest.mark.parametrize('order', ['the venue in the scene', 'obstacles as an option', 'the line first'])
@pytest.mark.parametrize('venue', EVERY)
@pytest.mark.parametrize('line', [*EVERY, *LINES])
def test_a_line_and_obstacles_of_any_two_maps_are_about_one_origin_or_refused(capsys, tmp_path, line, venue, order):
    way, options = written(tmp_path, line)
    suffix, text = EVERY[venue]
    kiosk = tmp_path / f'kiosk{suffix}'
    kiosk.write_text(text('Polygon', KIOSK))
    scene, out = tmp_path / 'scene.yaml', tmp_path / 'out.yaml'
    of_scene = f'venue: {{file: {kiosk.name}}}\n' if order == 'the venue in the scene' else ''
    scene.write_text(DRAGON + of_scene)
    given = ('--obstacles', kiosk) if order == 'obstacles as an option' else ()
    code, _, err = run(capsys, 'route', way, *options, '--scene', scene, *given, '--output', out)
    changes = []
    if order == 'the line first' and code == 0:
        changes = [f'venue.file={kiosk}']
        code, _, err = run(capsys, 'contact', '--scene', out, '--set', changes[0])
    if order == 'the line first' and (PLACED[line], PLACED[venue]) == ('earth', 'local'):
        origin = load_scene(str(out)).origin        # stated in the scene, so metres are about it
        assert load_scene(str(out), changes).venue.obstacles[0].points_m[0] == KIOSK[0]
        assert load_scene(str(out), changes).origin == origin
    elif PLACED[line] == PLACED[venue]:
        assert (code, err) == (0, '')
        (gap,) = venue_fit(load_scene(str(out), changes)).gaps
        assert gap.high_m == pytest.approx(GAP_M, abs=5e-3)
    else:
        assert code == 2
        assert err.count('\n') == 1
        assert 'origin' in err


@pytest.mark.parametrize(('origin', 'forms'), [
    (f'{EAST_M}m,{NORTH_M}m,{CRS}', [name for name, kind in PLACED.items() if kind != 'local' or 'pose' in name]),
    ('lonlat', [name for name, kind in PLACED.items() if kind != 'map'])])
def test_an_origin_that_is_given_places_metres_beside_degrees(capsys, tmp_path, origin, forms):
    """With the place of (0, 0) given, every form that states or shares it gives the same scene."""
    (lonlat,) = degrees([(0.0, 0.0)])
    origin = origin if origin != 'lonlat' else f'{lonlat[0]!r},{lonlat[1]!r}'
    for line in forms:
        if line in ('path shifted by its pose',) and CRS in origin:
            continue
        for venue in [name for name in EVERY if name in forms]:
            folder = tmp_path / f'{line} {venue}'
            folder.mkdir()
            way, options = written(folder, line)
            suffix, text = EVERY[venue]
            kiosk, out = folder / f'kiosk{suffix}', folder / 'out.yaml'
            kiosk.write_text(text('Polygon', KIOSK))
            (folder / 'scene.yaml').write_text(DRAGON)
            code, said, err = run(capsys, 'route', way, *options, '--scene', folder / 'scene.yaml', '--obstacles',
                                  kiosk, '--origin', origin, '--output', out)
            assert (code, err) == (0, ''), (line, venue)
            assert f'origin: {load_scene(str(out)).origin}' in said
            (gap,) = venue_fit(load_scene(str(out))).gaps
            assert gap.high_m == pytest.approx(GAP_M, abs=0.08), (line, venue)    # UTM scales lengths by 0.9996


def test_two_origins_are_an_error_wherever_the_second_is_given(capsys, tmp_path):
    way, _ = written(tmp_path, 'geojson in degrees')
    (tmp_path / 'kiosk.geojson').write_text(geojson('Polygon', degrees(KIOSK)))
    first, second = 'origin: {lon_lat_deg: [117.0, 30.7]}\n', '117.001,30.7'
    scene, out = tmp_path / 'scene.yaml', tmp_path / 'out.yaml'
    for text in (first, 'venue: {file: kiosk.geojson, origin_deg: [117.0, 30.7]}\n'):
        scene.write_text(DRAGON + text)
        code, _, err = run(capsys, 'route', way, '--scene', scene, '--origin', second)
        assert (code, 'a scene has one' in err) == (2, True)
    scene.write_text(DRAGON + first)
    assert run(capsys, 'route', way, '--scene', scene, '--output', out)[::2] == (0, '')
    for change in ('origin.lon_lat_deg=[117.001, 30.7]', 'venue={file: %s, origin_deg: [117.001, 30.7]}' % (
            tmp_path / 'kiosk.geojson'), 'origin={map_m: [1, 2]}'):
        code, _, err = run(capsys, 'contact', '--scene', out, '--set', change)
        assert (code, 'a scene has one origin' in err) == (2, True), change
    with pytest.raises(Exception, match='a scene has one origin'):
        changed_scene(str(out), {'origin': {'lon_lat_deg': [117.001, 30.7]}})
    assert changed_scene(str(out), {'origin': {'lon_lat_deg': [117.0, 30.7]}}).origin == Origin((117.0, 30.7))


@pytest.mark.parametrize('origin', [Origin((117.0, 30.7)), Origin(map_m=(EAST_M, NORTH_M), crs=CRS),
                                    Origin(map_m=(EAST_M, NORTH_M))])
def test_the_origin_stays_with_the_scene_in_its_file_and_in_a_bag(origin):
    scene = changed_scene('winding', {'origin': {key: value for key, value in vars(origin).items() if value}})
    assert scene.origin == origin
    assert scene_of(parse_document('again', scene_file(scene))) == scene


@pytest.mark.parametrize('text', ['', '1', '1,2,3', '1m,2', 'a,b', '1m,2m,', '181,0', '0,91', 'nan,0'])
def test_an_origin_without_a_unit_or_a_place_is_refused(capsys, tmp_path, text):
    way, _ = written(tmp_path, 'geojson in degrees')
    code, out, err = run(capsys, 'route', way, '--origin', text)
    if text == '1m,2m,':
        assert code == 2
        return
    assert (code, out) == (2, '')
    assert err.count('\n') == 1
