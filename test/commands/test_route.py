"""``route`` on the command line: scenes from drawings, round trips, paths from bags, and rejected input."""
import json
import re
import struct

import numpy as np
import pytest
from mcap.writer import Writer
from shapely import LineString, distance, points

from dragon_ros.__main__ import main
from dragon_ros.core.model import compile_scene
from dragon_ros.scenes.load import load_scene

TOLERANCE_M = 0.02


def run(capsys, *arguments):
    try:
        code = main(['route', *map(str, arguments)])
    except SystemExit as stop:
        code = stop.code
    return code, *capsys.readouterr()


@pytest.fixture
def corner(tmp_path):
    path = tmp_path / 'corner.csv'
    path.write_text('x,y\n0,0\n60,0\n60,50\n')
    return path


def test_a_corner_becomes_a_scene_whose_dragon_stands_on_the_drawing(capsys, tmp_path, corner):
    scene_file = tmp_path / 'scene.yaml'
    code, out, err = run(capsys, corner, '--radius', 4, '--set', 'dragon.benches=30', '--output', scene_file)
    assert (code, err) == (0, '')
    assert 'the tightest bend has a radius of 4 m: piece 2 at (56.000, 0.000) m; the smallest radius' in out
    assert 'the corner at (60.000, 0.000) m now has a radius of 4 m and deviates by up to 1.66 m from' in out
    scene = load_scene(str(scene_file))
    assert scene.dragon.benches == 30
    assert [getattr(piece, 'radius_m', None) for piece in scene.track.pieces] == [None, 4.0, None]
    at_start = compile_scene(scene).chain(0.0).p
    np.testing.assert_allclose(at_start[-1], (0, 0), atol=1e-9)
    assert scene.track.start_m == pytest.approx(compile_scene(scene).model.length_m)


def test_a_track_that_plot_drew_is_read_again_within_the_tolerance(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['plot', 'dragon', '--scene', 'turning', '--set', 'dragon.benches=9', '--output', 'turn.svg']) == 0
    code, out, _ = run(capsys, 'turn.svg', '--path', 'track', '--set', 'dragon.benches=9', '--output', 'again.yaml')
    assert code == 0, out
    drawn, again = (compile_scene(load_scene(name, ['dragon.benches=9'])).track_line(1e-4) for name in (
        'turning', 'again.yaml'))
    again = again[np.hypot(*(again - drawn[-1]).T) > 1.5]       # without the lead-in line
    assert np.max(distance(points(drawn[::20]), LineString(again))) < 1.6
    assert LineString(drawn).buffer(TOLERANCE_M * 1.01).contains(LineString(again))


def path_message(frame, points):
    """Return a nav_msgs/Path in CDR."""
    data = bytearray(b'\0\1\0\0')

    def put(kind, *values):
        size = struct.calcsize(kind[0])
        data.extend(bytes(-(len(data) - 4) % size) + struct.pack(f'<{kind}', *values))

    def header():
        put('i', 0), put('I', 0), put('I', len(frame) + 1)
        data.extend(frame.encode() + b'\0')
    header()
    put('I', len(points))
    for x, y in points:
        header()
        put('d', x), put('d', y), put('d', 0.0), put('dddd', 0, 0, 0, 1)
    return bytes(data)


@pytest.fixture
def planned(tmp_path):
    """A bag that contains a path in the frame ``map``."""
    path = tmp_path / 'plan.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema('nav_msgs/msg/Path', 'ros2msg', b'')
        channel = writer.register_channel('/plan', 'cdr', schema)
        for n, end in enumerate((20.0, 60.0)):
            writer.add_message(channel, n, path_message('map', [(0, 0), (60, 0), (60, end)]), n)
        writer.finish()
    return path


def test_the_last_plan_in_a_bag_is_moved_by_the_pose_of_its_frame(capsys, planned):
    code, out, _ = run(capsys, planned, '--frame-pose', '1,2,90', '--radius', 4)
    assert code == 0
    assert '/plan: 118.283 m' in out
    assert '2    arc        6.283      4.000    90.00° left   (1.000, 58.000)' in out


@pytest.mark.parametrize(('arguments', 'says'), [
    ([], "its path is in the frame 'map', and the dragon is in 'dragon'; give the pose"),
    (['--frame-pose', '1,2'], 'it must be X,Y,DEGREES'), (['--topic', '/pan'], 'did you mean /plan?'),
    (['--scale', '1:200'], 'a nav_msgs/Path does not accept it')])
def test_a_plan_in_another_frame_is_refused_and_so_is_what_it_does_not_take(capsys, planned, arguments, says):
    code, out, err = run(capsys, planned, *arguments)
    assert (code, out) == (2, '')
    assert says in err


def test_files_that_are_read_are_not_overwritten(capsys, tmp_path, corner):
    text = corner.read_bytes()
    code, out, err = run(capsys, corner, '--output', corner)
    assert (code, out, err) == (2, '', f'route: --output {corner}: this is the file that is read; give another file\n')
    assert corner.read_bytes() == text
    scene, link = tmp_path / 'scene.yaml', tmp_path / 'link.json'
    scene.write_text('dragon: {benches: 3}\n')
    link.symlink_to(scene)
    assert main(['contact', '--scene', str(scene), '--certificate', str(link)]) == 2
    assert 'this is the file that is read' in capsys.readouterr().err
    assert scene.read_text() == 'dragon: {benches: 3}\n'


@pytest.mark.parametrize(('arguments', 'says'), [
    (['--radius', 1], 'give at least 1.444, or use shorter benches'), (['--path', 'a'], 'CSV file does not accept it'),
    (['--timeout', 3], '--timeout: a CSV file does not accept it; omit it'),
    (['--start', 200], 'give at most 1'), (['--tolerance', 0], '--tolerance'), (['--unit', -1], '--unit')])
def test_options_are_checked(capsys, corner, arguments, says):
    code, out, err = run(capsys, corner, *arguments)
    assert (code, out) == (2, '')
    assert says in err


def test_a_venue_is_checked_against_the_drawn_track_and_not_against_the_one_before(capsys, tmp_path, corner):
    scene_file = tmp_path / 'scene.yaml'
    wall = 'venue.obstacles=[{kind: line, name: wall, points_m: [[%g, %g], [9, 9]]}]'
    options = corner, '--set', 'dragon.benches=20', '--output', scene_file
    code, _, err = run(capsys, *options, '--set', wall % (9, -9))       # a wall across the first leg
    assert (code, 'wall' in err) == (2, True)
    assert not scene_file.exists()
    code, _, err = run(capsys, *options, '--set', wall % (8, 5))
    assert (code, err) == (0, '')
    assert load_scene(str(scene_file)).venue.names == ('wall',)
    inside = 'venue.inside=[[-5, -5], [65, -5], [65, 55], [55, 55], [55, 5], [-5, 5]]'
    code, _, err = run(capsys, *options, '--set', inside, '--set', 'track.start_turns=99')
    assert (code, err) == (0, '')


def test_a_recording_with_noise_becomes_a_track_near_the_way_that_was_walked(capsys, tmp_path):
    rng = np.random.default_rng(1)
    way = np.stack((np.linspace(0, 600, 600), 40 * np.sin(np.linspace(0, 600, 600) / 90)), axis=1)
    np.savetxt(tmp_path / 'way.csv', way + 3 * rng.normal(size=way.shape), delimiter=',', header='x,y', comments='')
    code, out, err = run(capsys, tmp_path / 'way.csv', '--set', 'dragon.benches=5', '--output', tmp_path / 'a.yaml')
    assert code == 0, err
    said = re.search(r'points that scatter by about 3 m by at most (\S+) m \(tolerance (\S+) m; --tolerance gives', out)
    assert float(said[1]) <= float(said[2]) <= 13
    track = LineString(compile_scene(load_scene(str(tmp_path / 'a.yaml'))).track_line(1e-3))
    assert np.max(distance(points(way[20:-20]), track)) < 3


def test_obstacles_beside_the_chosen_line_are_left_out_however_far_away_they_are(capsys, tmp_path):
    pytest.importorskip('pyproj')
    places = {'near': (120.1502, 30.25002), 'far': (-70, 40)}
    features = [{'type': 'Feature', 'properties': {'name': 'way'}, 'geometry': {
        'type': 'LineString', 'coordinates': [[120.15, 30.25], [120.151, 30.25]]}}]
    for name, (lon, lat) in places.items():
        corners = [[lon, lat], [lon + 1e-5, lat], [lon, lat + 1e-5], [lon, lat]]
        features.append({'type': 'Feature', 'properties': {'name': name}, 'geometry': {
            'type': 'Polygon', 'coordinates': [corners]}})
    for kept, names in ((features, ['near']), (features[::2], [])):
        (tmp_path / 'way.geojson').write_text(json.dumps({'type': 'FeatureCollection', 'features': kept}))
        code, out, err = run(capsys, tmp_path / 'way.geojson', '--set', 'dragon.benches=5', '--output',
                             tmp_path / 'a.yaml')
        assert code == 0, err
        assert 'way.geojson: left out: 1 obstacle far from the track\n' in out
        venue = load_scene(str(tmp_path / 'a.yaml')).venue
        assert [one.name for one in (venue.obstacles if venue else ())] == names
