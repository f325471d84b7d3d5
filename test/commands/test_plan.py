"""``plan`` draws to scale; its swept area and gaps agree with an independent check at every millimetre."""
import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from shapely import LineString, Polygon, box, distance, polygons, prepare, unary_union
from shapely.geometry import shape

import dragon_ros as dr
from dragon_ros.__main__ import main
from dragon_ros.commands.plan_contents import Plan, chalk_marks, geojson
from dragon_ros.commands.plan_pages import Sheet, drawing, pages, said, sheets
from dragon_ros.commands.plan_together import gaps_between
from dragon_ros.core.batches import states
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.search.swept_area import room_needed_m
from dragon_ros.core.search.venue_fit import venue_fit
from dragon_ros.scenes.load import load_scene


@pytest.fixture(scope='module')
def scene():
    return load_scene('street', ['dragon.benches=12', 'run.stop_s=75'])     # until the head is behind both corners


@pytest.fixture(scope='module')
def benches(scene):
    """All benches at 1,200 times during the run, as polygons."""
    times = np.linspace(0, compile_scene(scene).end.t_s, 1200).tolist()
    chain = states(scene, times)
    return polygons(benches_of(chain, scene.dragon, axes_of(chain)).corners.reshape(-1, 4, 2))


@pytest.fixture(scope='module')
def plan(scene):
    return Plan(scene, 'x')


def run(capsys, *arguments):
    try:
        code = main(['plan', *map(str, arguments)])
    except SystemExit as stop:
        code = stop.code
    return code, *capsys.readouterr()


def test_every_bench_at_every_time_lies_in_the_swept_area(plan, benches):
    grown, shrunk = (plan.room.area.whole.buffer(by_m) for by_m in (1e-3, -1e-3))
    prepare([grown, shrunk])
    assert np.all(grown.contains(benches))
    assert not np.all(shrunk.contains(benches))


def test_gaps_are_those_of_benches_placed_densely(scene, benches, plan):
    found = {gap.name: gap.gap_m for gap in plan.gaps}
    for one in scene.venue.obstacles:
        area = Polygon(one.points_m) if hasattr(one, 'holes_m') else LineString(one.points_m)
        assert found[one.name] == pytest.approx(float(np.min(distance(benches, area))), abs=2e-3)


def test_gaps_are_those_of_the_search_with_their_ends_and_the_plan_says_so(scene, plan):
    for gap, one in zip(plan.gaps, venue_fit(scene).gaps, strict=True):
        assert (gap.name, gap.gap_m, gap.gap_m - gap.within_m) == (one.name, one.high_m, pytest.approx(one.low_m))
        assert np.hypot(*np.diff(gap.ends_m, axis=0)[0]) == pytest.approx(one.high_m, abs=1e-9)
    proved, rest = said(plan).split('Not proved')
    assert 'each smallest gap is proved: at most 1 mm below' in proved
    assert 'gap' not in rest


def test_a_scene_without_a_venue_has_a_plan_without_gaps(capsys, tmp_path):
    options = '--scene', 'street', '--set', 'dragon.benches=5', '--set', 'venue=null', '--set', 'run.stop_s=20'
    code, out, _ = run(capsys, *options, '--output', tmp_path / 'a.pdf')
    assert (code, out.splitlines()) == (0, [str(tmp_path / 'a.pdf')])
    assert 'gap' not in said(Plan(load_scene('street', ['venue=null', 'dragon.benches=5', 'run.stop_s=20']), 'x'))


def test_a_dragon_that_stands_still_has_a_plan_of_its_benches():
    plan = Plan(load_scene('winding', ['dragon.benches=40', 'run.stop_s=0']), 'x')
    drawn = [page.draw_without_rendering() for page in pages(plan, sheets(plan, None, None))]
    assert len(drawn) == 2
    assert json.loads(geojson(plan))['features'][0]['geometry']['coordinates']


def test_what_a_venue_file_holds_besides_obstacles_is_said_in_a_line(capsys, tmp_path):
    (tmp_path / 'town.geojson').write_text(json.dumps({'type': 'FeatureCollection', 'units': 'm', 'features': [
        {'type': 'Feature', 'properties': {'building': 'yes'}, 'geometry': {
            'type': 'Polygon', 'coordinates': [[[5, 5], [8, 5], [8, 8], [5, 5]]]}},
        {'type': 'Feature', 'properties': {'highway': 'footway'}, 'geometry': {
            'type': 'LineString', 'coordinates': [[0, 0], [9, 0]]}}]}))
    scene = tmp_path / 'a.yaml'
    scene.write_text('dragon: {benches: 3}\ntrack: {kind: joined, start_m: 5, pieces: [{kind: line, length_m: 9}]}\n'
                     'venue: {file: town.geojson}\n')
    code, _, err = run(capsys, scene, '--output', tmp_path / 'a.geojson')
    assert (code, err) == (0, 'town.geojson: not obstacles: 1 highway\n')


def test_dollars_in_a_title_or_a_name_are_no_formula(capsys, tmp_path):
    """Matplotlib parses text between two dollar signs, and raises an error for this text."""
    scene = tmp_path / '$x^{$.yaml'
    scene.write_text('dragon: {benches: 3}\ntrack: {kind: joined, start_m: 5, pieces: [{kind: line, length_m: 9}]}\n'
                     'venue: {obstacles: [{kind: line, name: "$y^{$", points_m: [[-9, 3], [43, 3]]}]}\n')
    pdf, picture = tmp_path / 'a.pdf', tmp_path / 'a.svg'
    code, out, err = run(capsys, '--scene', scene, '--output', pdf, '--lang', 'en')
    assert (code, out) == (0, f'{pdf}\n$y^{{$: 2.850 m\n'), err
    assert main(['plot', 'dragon', '--scene', str(scene), '--times', '1', '--output', str(picture)]) == 0
    assert '$x^{$' in picture.read_text()


def test_the_room_on_a_line_is_the_width_and_grows_in_bends_as_the_chord_cuts_the_corner(scene, plan):
    track = compile_scene(scene).model.track
    room = room_needed_m(track, plan.room.area, np.array([20.0, 44.7]))
    np.testing.assert_allclose(room[0], 0.15, atol=1e-9)
    inner = 6 - np.sqrt(36 - (0.5 * 2.86) ** 2) + 0.15      # the middle of the head's link on a circle
    assert room[1].max() == pytest.approx(inner, abs=2e-3)


def test_head_and_tail_pass_marks_when_they_have_gone_there(scene, plan):
    head, tail = plan.passes_s(plan.marks_m())
    for mark, t_s in zip(plan.marks_m(), head, strict=True):
        if not np.isnan(t_s):
            assert t_s == pytest.approx(mark - scene.track.start_m, abs=1e-6)
    assert np.nansum(tail > head) == np.sum(~np.isnan(tail) & ~np.isnan(head)) > 0


def test_a_pdf_is_to_scale_and_a_geojson_in_metres(capsys, tmp_path):
    pdf, area = tmp_path / 'plan.pdf', tmp_path / 'area.geojson'
    options = '--scene', 'street', '--set', 'dragon.benches=3', '--set', 'run.stop_s=18'
    assert run(capsys, *options, '--output', pdf, '--scale', '1:100', '--paper', 'A4')[0] == 0
    data = pdf.read_bytes()
    sizes = re.findall(rb'/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]', data)
    assert [tuple(round(float(value) / 72 * 25.4) for value in size) for size in sizes] == [(297, 210)] * len(sizes)
    assert len(sizes) >= 2
    code, out, _ = run(capsys, *options, '--output', area)
    assert (code, 'area.geojson: in metres' in out) == (0, True)
    assert json.loads(area.read_text())['units'] == 'm'
    features = {one['properties']['name']: shape(one['geometry']) for one in json.loads(area.read_text())['features']}
    assert features['swept by the head'].area == pytest.approx(0.3 * (3.41 + 18))
    assert 'gap to lamp post' in features


def test_a_geojson_of_a_scene_with_an_origin_is_in_degrees(capsys, tmp_path):
    pyproj = pytest.importorskip('pyproj')
    area, origin = tmp_path / 'area.geojson', (113.1, 23.0)
    _, out, _ = run(capsys, '--scene', 'street', '--set', 'dragon.benches=12', '--set', 'run.stop_s=5', '--set',
                    f'venue.origin_deg={list(origin)}', '--output', area)
    assert 'area.geojson: in degrees (RFC 7946)' in out
    values = json.loads(area.read_text())
    assert values.keys() == {'type', 'features'}
    features = {one['properties']['name']: shape(one['geometry']) for one in values['features']}
    head = features['swept by the head']
    square_m, _ = pyproj.Geod(ellps='WGS84').geometry_area_perimeter(head)
    plan = Plan(load_scene('street', ['dragon.benches=12', 'run.stop_s=5']), 'x')
    # The area is positive because the outer ring is anticlockwise.
    assert square_m == pytest.approx(plan.room.area.head.area, rel=1e-5)
    for n in (0, -1):
        x, y = plan.line[n]
        lon, lat, _ = pyproj.Geod(ellps='WGS84').fwd(*origin, np.degrees(np.arctan2(x, y)), np.hypot(x, y))
        assert np.array(features['track'].coords)[n] == pytest.approx((lon, lat), abs=1e-8)


def test_a_broken_margin_issaid(capsys, tmp_path):
    code, out, _ = run(capsys, '--scene', 'street', '--set', 'dragon.benches=2', '--set', 'venue.margin_m=1',
                       '--set', 'run.start_s=38', '--set', 'run.stop_s=45', '--output', tmp_path / 'a.geojson')
    assert code == 0
    assert re.search(r'lamp post: 0\.9\d\d m \(too small\)', out)


@pytest.mark.parametrize('paper', ['A4', 'A3'])
def test_the_whole_way_comes_first_and_then_sheets_of_the_places_that_are_tight(paper):
    plan = Plan(load_scene('street'), 'x')
    overview, *others = sheets(plan, paper, None)
    whole = plan.room.area.whole.union(LineString(plan.line))
    assert box(*overview.window.ravel()).contains(whole)
    assert [one.number for one in others] == [*range(2, 2 + len(others))]
    assert all(one.scale == 200 < overview.scale for one in others)
    places = [gap.ends_m.mean(axis=0) for gap in plan.gaps if gap.is_tight]
    assert places
    for at in places:       # in the inner part of a sheet
        assert any(np.all(np.abs(at - one.window.mean(axis=0)) <= 0.4 * np.ptp(one.window, axis=0)) for one in others)
    drawn = list(pages(plan, [overview, *others]))
    texts = [[one.get_text() for one in page.axes[0].texts] for page in drawn[:1 + len(others)]]
    assert {'1', '2', '3'} <= set(texts[0])
    assert any('sheet 2' in one for one in texts[0])
    assert any(one.startswith('1  lamp post: 0.94 m') for page in texts[1:] for one in page)
    assert any('lamp post: 0.94 m, 0:48 after the start, sheet' in one.get_text() for one in drawn[0].texts)


def test_a_small_drawing_is_one_page_at_the_largest_scale(plan):
    (small,) = sheets(Plan(load_scene('street', ['dragon.benches=2', 'run.stop_s=1']), 'x'), None, None)
    assert small.scale < 200
    (fixed,) = sheets(plan, 'A3', '1:1000')
    assert (fixed.scale, fixed.paper) == (1000, 'A3')


def test_labels_cover_neither_each_other_nor_arrows(plan):
    for sheet in sheets(plan, 'A4', None)[1:]:
        page = drawing(plan, sheet)
        axes = page.axes[0]
        page.draw_without_rendering()
        boxes = [Text.get_window_extent(one) for one in axes.texts if one.get_text()]     # without lines to them
        assert len(boxes) > 3
        assert not [1 for n, one in enumerate(boxes) for other in boxes[:n] if one.overlaps(other)]
        shown = [gap for gap in plan.tight if sheet.shows(gap.ends_m.mean(axis=0))]
        for gap in shown:
            line = LineString(axes.transData.transform(gap.ends_m))
            assert not any(box(*one.extents).intersects(line) for one in boxes)


def test_marks_to_chalk_lead_along_the_way_with_distance_bearing_and_time(plan):
    rows = [row.split(',') for row in chalk_marks(plan).splitlines()]
    head, rows = rows[0], rows[1:]
    assert head == ['mark_m', 'head_min_s', 'to_next_m', 'bearing_deg', 'x_m', 'y_m']
    assert [float(row[0]) for row in rows[:3]] == [5, 10, 15]
    for row, after in pairwise(rows):
        x, y, length_m, turn = float(row[4]), float(row[5]), float(row[2]), np.radians(float(row[3]))
        assert (x + length_m * np.sin(turn), y + length_m * np.cos(turn)) == pytest.approx(
            (float(after[4]), float(after[5])), abs=0.02)
    times = {row[0]: row[1] for row in rows}
    start = plan.scene.track.start_m
    assert times['50'] == f'0:{round(50 - start):02d}'
    assert rows[-1][2:4] == ['', '']


def test_a_plan_can_be_read_without_its_colours():
    scene = load_scene('square', ['dragon.benches=5', 'venue.margin_m=1.2', 'run.start_s=50', 'run.stop_s=55'])
    drawn = drawing(Plan(scene, 'x'), Sheet('A3', 500, np.array([[-60.0, -20.0], [80.0, 80.0]]))).axes[0]
    hatches = {one.get_label(): one.get_hatch() for one in drawn.patches if one.get_label()}
    assert len({hatches[name] for name in ('obstacles', 'swept by the head', 'swept by the body')}) == 3
    styles = {one.get_label(): one.get_linestyle() for one in drawn.lines}
    assert styles['track'] != '-'
    assert [one.get_text() for one in drawn.texts if 'too small' in one.get_text()] == [
        '1  market stall: 1.10 m (too small)']


@pytest.mark.parametrize(('arguments', 'says'), [
    (['--output', 'a.png'], 'the suffix must be .pdf, .geojson or .csv'),
    (['--output', 'a.geojson', '--format', 'pdf'], '--format: pdf conflicts with --output a.geojson; give only one'),
    (['--output', 'a.geojson', '--scale', '1:100'], '--scale: a plan in geojson does not accept it; omit it'),
    (['--output', 'a', '--format', 'geojson', '--title', 'x'], '--title: a plan in geojson does not accept it'),
    (['--output', 'a.pdf', '--set', 'dragon.benches=5', '--scale', '1:20'], 'from 1:50 to 1:1000')])
def test_options_are_checked(capsys, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, *arguments)
    assert code == 2
    assert says in err


OSM_CORNERS = ((1.8e-5, 6e-4), (5e-5, 6e-4), (5e-5, 7e-4), (1.8e-5, 6e-4))


def test_the_page_leads_from_a_gpx_file_to_a_printed_plan_in_25_lines(capsys, tmp_path, monkeypatch):
    pytest.importorskip('pyproj')
    page = (Path(__file__).parents[2] / 'docs' / 'venue.md').read_text()
    part = page.split('## From a phone to a printed plan')[1].split('\n## ')[0]
    assert len(part.strip().splitlines()) <= 25
    command = re.search(r'`\./dragon (plan way\.gpx .+)`', part)[1]
    monkeypatch.chdir(tmp_path)
    Path('way.gpx').write_text('<gpx><trk><trkseg>' + ''.join(
        f'<trkpt lat="30.25" lon="{120.15 + n * 1e-4:.4f}"/>' for n in range(16)) + '</trkseg></trk></gpx>')
    Path('town.osm').write_text('<osm>' + ''.join(
        f'<node id="{n}" lat="{30.25 + north}" lon="{120.15 + east}"/>' for n, (north, east) in enumerate(OSM_CORNERS))
        + '<way id="9"><nd ref="0"/><nd ref="1"/><nd ref="2"/><nd ref="0"/><tag k="building" v="kiosk"/>'
          '<tag k="name" v="kiosk"/></way></osm>')
    code, out, err = run(capsys, *command.split()[1:], '--lang', 'en', '--set', 'run.rate_hz=1')
    assert code == 0, err
    assert re.search(r'^It fits; closest: kiosk, 1\.\d\d m, \d+ s after the start$', out, re.MULTILINE)
    named = set(re.findall(r'^- `(way[\w.-]+)`', part, re.MULTILINE))
    assert named == {one.name for one in tmp_path.iterdir()} - {'way.gpx', 'town.osm'}
    assert Path('way.pdf').read_bytes().startswith(b'%PDF')


def test_a_drawing_and_a_town_give_an_answer_a_plan_a_page_and_a_scene(capsys, tmp_path):
    pytest.importorskip('pyproj')
    way, town = tmp_path / 'way.gpx', tmp_path / 'town.geojson'
    way.write_text('<gpx><rte><rtept lat="30.25" lon="120.15"/><rtept lat="30.25" lon="120.151"/></rte></gpx>')
    corners = [[120.1506, 30.25 + north] for north in (1.8e-5, 5e-5)] + [[120.1507, 30.25005], [120.1506, 30.250018]]
    town.write_text(json.dumps({'type': 'Feature', 'properties': {'name': 'kiosk'}, 'geometry': {
        'type': 'Polygon', 'coordinates': [corners]}}))
    options = way, '--obstacles', town, '--benches', 5, '--bench-length', 2.1, '--lang', 'en'
    code, out, err = run(capsys, *options)
    assert code == 0, err
    assert re.search(r'^It fits; closest: kiosk, 1\.8\d m, \d+ s after the start$', out, re.MULTILINE)
    assert {one.name for one in tmp_path.iterdir()} == {
        'way.gpx', 'town.geojson', 'way.pdf', 'way.html', 'way.yaml', 'way-marks.csv'}
    assert load_scene(str(tmp_path / 'way.yaml')).dragon.benches == 5
    code, out, _ = run(capsys, *options, '--set', 'venue.margin_m=3')
    assert (code, 'It does not fit; too close: kiosk, 1.8' in out) == (1, True)
    code, out, _ = run(capsys)
    assert (code, len(out.splitlines())) == (0, 3)


WALK = ('dragon: {benches: 6, head_length_m: 2.1, body_length_m: 2.1}\nrun: {stop_s: 30}\n'
        'track: {kind: joined, start_m: 12, pieces: [{kind: line, at_m: [%g, %g], heading_deg: %g, length_m: 60}]}\n')


@pytest.fixture
def two_walks(tmp_path):
    """Two dragons whose ways cross."""
    files = [tmp_path / 'red.yaml', tmp_path / 'green.yaml']
    for file, place in zip(files, ((0, 0, 0), (37, -45, 90)), strict=True):
        file.write_text(WALK % place)
    return files


def test_the_smallest_gap_of_two_dragons_is_that_of_all_benches_at_every_tenth_of_a_second(capsys, tmp_path, two_walks):
    scenes = [load_scene(str(one)) for one in two_walks]
    (found,) = gaps_between([*map(dr.compile, scenes)])
    sets = []
    for scene in scenes:
        chain = states(scene, np.arange(301) / 10)
        corners = benches_of(chain, scene.dragon, axes_of(chain)).corners.reshape(301, -1, 4, 2)
        sets.append([unary_union(polygons(one)) for one in corners])
    gaps = distance(*sets)
    assert found.gap_m == pytest.approx(gaps.min(), abs=1e-9)
    assert 0 < found.gap_m < 3
    assert found.t_s == pytest.approx(np.argmin(gaps) / 10)
    code, out, _ = run(capsys, *two_walks, '--output', tmp_path / 'both.pdf', '--lang', 'en')
    assert code == 0
    assert f'sampled every 0.1 s, not proved: red and green: {found.gap_m:.2f} m at {found.t_s:.1f} s' in out
    assert (tmp_path / 'both.pdf').read_bytes().startswith(b'%PDF')


def test_dragons_that_touch_or_never_meet_are_said(capsys, tmp_path, two_walks):
    two_walks[1].write_text(WALK % (30, -28, 90))
    _, out, _ = run(capsys, *two_walks, '--output', tmp_path / 'both.pdf', '--lang', 'en')
    assert re.search(r'red and green touch at \d+\.\d s', out)
    two_walks[1].write_text((WALK % (30, -28, 90)).replace('stop_s: 30', 'start_s: 40, stop_s: 45'))
    _, out, _ = run(capsys, *two_walks, '--output', tmp_path / 'both.pdf', '--lang', 'en')
    assert 'red and green are never there at one time' in out


def test_dragons_of_different_origins_or_too_many_files_are_refused(capsys, tmp_path, two_walks):
    with two_walks[1].open('a') as file:
        file.write('origin: {lon_lat_deg: [120.0, 30.0]}\n')
    code, _, err = run(capsys, *two_walks, '--output', tmp_path / 'both.pdf')
    assert (code, 'give all scenes one origin' in err, len(err.splitlines())) == (2, True, 1)
    assert run(capsys, two_walks[0], tmp_path / 'way.gpx')[0] == 2
    code, _, err = run(capsys, *two_walks, '--output', two_walks[0])
    assert (code, 'the plan of several dragons is a .pdf' in err) == (2, True)


def test_an_overview_of_a_long_way_has_dots_that_can_be_told_apart_and_a_sheet_of_the_tightest_place():
    scene = load_scene('street', ['dragon.benches=4', 'venue.obstacles=[{kind: line, name: wall, points_m: [[0, 9], '
                                  '[9, 9]]}]', 'track={kind: joined, start_m: 20, pieces: [{kind: line, length_m: 900},'
                                  '{kind: arc, radius_m: 8, angle_deg: 90}, {kind: line, length_m: 100}]}'])
    plan = Plan(scene, 'x')
    overview, sheet = sheets(plan, 'A4', None)
    assert sheet.shows(plan.gaps[0].ends_m.mean(axis=0))
    axes = drawing(plan, overview, others=[sheet]).axes[0]
    dots = np.sort([one.get_xdata()[0] for one in axes.lines if one.get_marker() == 'o'])
    assert len(dots) > 9
    assert np.diff(dots[dots < 900]).min() * 1000 / overview.scale > 5


@pytest.mark.parametrize(('beyond_m', 'is_near'), [(40, True), (200, False)])
def test_an_overview_shows_the_obstacles_near_the_way(beyond_m, is_near):
    y_m = 8 + 262 + beyond_m        # the way turns left and ends at (108, 270)
    scene = load_scene('street', ['dragon.benches=4', 'track={kind: joined, start_m: 20, pieces: [{kind: line, '
                                  'length_m: 100}, {kind: arc, radius_m: 8, angle_deg: 90}, {kind: line, length_m: '
                                  '262}]}', f'venue.obstacles=[{{kind: line, name: wall, points_m: [[100, {y_m}], '
                                  f'[116, {y_m}]]}}]'])
    plan = Plan(scene, 'x')
    overview, *_ = sheets(plan, 'A4', None)
    assert box(*overview.window.ravel()).contains(LineString(plan.line))
    assert overview.shows(np.array((108.0, y_m + 4.0))) == is_near
