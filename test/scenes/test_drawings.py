"""Drawings in SVG (with groups, transforms and units), CSV and GeoJSON are read, or rejected with a clear error."""
import json
from math import radians

import numpy as np
import pytest

from dragon_ros.core.errors import DragonError
from dragon_ros.core.limits import XML_DEPTH
from dragon_ros.core.tracks.drawn import Cubic, EllipseArc
from dragon_ros.scenes.drawings import csv_line, map_line, metres_a_unit, svg_line
from dragon_ros.scenes.maps import read_drawing

HEAD = ('<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
        'width="200mm" height="100mm" viewBox="0 0 400 200">')


def svg(tmp_path, body, head=HEAD):
    path = tmp_path / 'a.svg'
    path.write_text(f'{head}{body}</svg>')
    return path


def on_paper(x, y):
    """Convert a point from viewBox units (0.5 mm, drawn at 1:200) to metres from the lower left corner."""
    return 200 * 0.0005 * complex(x, 200 - y)


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)


def test_lines_in_a_group_are_moved_scaled_and_turned_upwards(tmp_path):
    path = svg(tmp_path, '<g transform="translate(10,20)"><g transform="scale(2)">'
                         '<path id="way" d="m 5,5 h 10 v 20 l -3,4"/></g></g>')
    (part,) = svg_line(path, None, (200.0, True)).parts
    close(part, [on_paper(10 + 2 * x, 20 + 2 * y) for x, y in ((5, 5), (15, 5), (15, 25), (12, 29))])
    (units,) = svg_line(path, 'way', (0.1, False)).parts
    close(units, part)


@pytest.mark.parametrize(('width', 'height'), [('20cm', '10.cm'), (' 7.874015748031496 in', '3.937007874015748in'),
                                               ('566.929133858268pt', '283.464566929134pt'),
                                               ('47.244094488189pc', '23.6220472440945 pc')])
def test_a_page_of_the_same_size_in_other_units_gives_the_same_line(tmp_path, width, height):
    head = HEAD.replace('200mm', width).replace('100mm', height)
    (part,) = svg_line(svg(tmp_path, '<path d="m 5,5 h 300"/>', head), None, (200.0, True)).parts
    close(part, [on_paper(5, 5), on_paper(305, 5)])


def test_curves_are_those_of_their_control_points(tmp_path):
    path = svg(tmp_path, '<path id="way" d="M 0,0 c 10,0 20,10 30,10 s 10,5 20,20 q 5,5 0,20 t 10,10"/>')
    parts = svg_line(path, None, (200.0, True)).parts
    assert all(isinstance(part, Cubic) for part in parts)
    close(parts[0].controls, [on_paper(*p) for p in ((0, 0), (10, 0), (20, 10), (30, 10))])
    close(parts[1].controls, [on_paper(*p) for p in ((30, 10), (40, 10), (40, 15), (50, 30))])
    half = parts[2].stretch(1e-4).points
    close(half[len(half) // 2], on_paper(0.25 * 50 + 0.5 * 55 + 0.25 * 50, 0.25 * 30 + 0.5 * 35 + 0.25 * 50))


@pytest.mark.parametrize('flags', ['0 0', '0 1', '1 0', '1 1'])
@pytest.mark.parametrize('transform', ['', 'rotate(30)', 'scale(-1,1)', 'skewX(25)', 'matrix(1 2 -0.5 1.5 3 4)'])
def test_an_arc_keeps_its_ends_and_its_side_under_any_transform(tmp_path, flags, transform):
    way = f'<path id="way" d="M 20,30 A 40 25 20 {flags} 60,50 L 70,70"/>'
    arc, line = svg_line(svg(tmp_path, f'<g transform="{transform}">{way}</g>'), None, (0.1, False)).parts
    assert isinstance(arc, EllipseArc)
    points = arc.stretch(1e-4).points
    close(points[-1], line[0])
    # The ellipse's semi-axes in the drawing's coordinates, whether the arc is the longer one, and the arc's side.
    move = {'': np.eye(2), 'rotate(30)': _turn(30), 'scale(-1,1)': np.diag((-1.0, 1.0)),
            'skewX(25)': np.array(((1, np.tan(radians(25))), (0, 1)))}.get(transform, np.array(((1, -0.5), (2, 1.5))))
    moved = points / 0.1 - 200j - (3 - 4j) * transform.startswith('matrix')
    x, y = np.linalg.solve(move, np.stack((moved.real, -moved.imag)))
    close((x[0], y[0], x[-1], y[-1]), (20, 30, 60, 50))
    u, v = _turn(-20) @ np.stack((x, y)) / np.array(((40,), (25,)))
    about = np.linalg.lstsq(np.stack((2 * u, 2 * v, np.ones_like(u)), axis=1), u * u + v * v, rcond=None)[0]
    angle = np.unwrap(np.angle((u - about[0]) + 1j * (v - about[1])))
    np.testing.assert_allclose(np.hypot(u - about[0], v - about[1]), 1.0, atol=1e-5)
    assert (abs(angle[-1] - angle[0]) > np.pi) == (flags[0] == '1')
    assert (angle[-1] > angle[0]) == (flags[2] == '1')


def _turn(degrees):
    c, s = np.cos(radians(degrees)), np.sin(radians(degrees))
    return np.array(((c, -s), (s, c)))


def test_a_path_is_found_by_id_label_or_the_group_that_holds_it_alone(tmp_path):
    path = svg(tmp_path, '<defs><path d="M0 0h9"/></defs><path id="p1" inkscape:label="wall" d="M 0,0 h 9"/>'
                         '<g id="track"><path d="M 0,0 h 5"/></g><circle id="fountain" r="3"/>')
    for asked, name in (('p1', 'p1'), ('wall', 'p1'), ('track', 'track')):
        assert svg_line(path, asked, (1.0, False)).name == name
    with pytest.raises(DragonError, match=r'contains 3 paths .p1, track, fountain.; choose one, for example --path p1'):
        svg_line(path, None, (1.0, False))
    with pytest.raises(DragonError, match=r'did you mean track\?'):
        svg_line(path, 'trak', (1.0, False))


@pytest.mark.parametrize(('text', 'says'), [
    ('<svg><path d="M0 0 h', 'is not SVG'), ('', 'is not SVG'),
    ('<!DOCTYPE s [<!ENTITY a "b">]><svg>&a;</svg>', 'entities'),
    ('<svg>' + '<g>' * XML_DEPTH + '</g>' * XML_DEPTH + '</svg>', 'nested'), ('<svg/>', 'contains no path'),
    ('<svg><path id="a" d="M0 0 h 5 M 1 1 h 5"/></svg>', 'several parts'),
    ('<svg><path id="a" d="M0 0"/></svg>', 'no length'),
    ('<svg><path id="a" d="M0 0 L 1e300 5"/></svg>', 'too far away; the limit'),
    ('<svg><path id="a" d="M0 0 C 1 1e400 5 5 9 9"/></svg>', 'not finite; draw'),
    ('<svg width="9mm" viewBox="0 0 1e400 9"><path id="a" d="M0 0 h 5"/></svg>', 'viewBox is zero'),
    ('<svg><path id="a" d="M0 0 L nan 5"/></svg>', 'check its numbers'),
    ('<svg><path id="a" d="M0 0 A 1 1 0 0"/></svg>', 'check its numbers')])
def test_what_is_no_drawing_is_refused_in_words(tmp_path, text, says):
    path = tmp_path / 'a.svg'
    path.write_text(text)
    with pytest.raises(DragonError, match=says):
        svg_line(path, None, (1.0, False))


def test_an_svg_without_metres_asks_for_them(tmp_path):
    with pytest.raises(DragonError, match='--scale 1:200'):
        svg_line(svg(tmp_path, '<path d="M 0,0 h 9"/>'), None, None)


@pytest.mark.parametrize('text', ['x,y\n0,0\n1.5,2\n', '0;0\n1.5;2\n', '0 0\n1.5 2',
                                  '# a note\nname\tx\ty\na\t0\t0\nb\t1.5\t2\n'])
def test_csv_is_read_with_or_without_a_header(tmp_path, text):
    path = tmp_path / 'a.csv'
    path.write_text(text)
    (part,) = csv_line(path, 2.0).placed(None).parts
    assert part.tolist() == [0, 3 + 4j]


def test_a_point_that_is_not_finite_is_not_called_far_away(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('0,0\n1,nan\n')
    with pytest.raises(DragonError, match=r'a\.csv: a point at \(1, nan\) is not finite; draw that point again'):
        csv_line(path, 1.0)


def test_csv_names_the_line_that_holds_no_numbers(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('x,y\n0,0\n1,b\n')
    with pytest.raises(DragonError, match=r'a\.csv:3: 1,b is not two numbers'):
        csv_line(path, 1.0)


def test_a_line_of_geojson_is_found_by_its_name(tmp_path):
    path = tmp_path / 'a.geojson'
    features = [{'type': 'Feature', 'properties': {'name': name}, 'geometry': {'type': 'LineString', 'coordinates': at}}
                for name, at in (('wall', [[0, 0], [9, 0]]), ('way', [[0, 1], [9, 1], [9, 7]]))]
    path.write_text(json.dumps({'type': 'FeatureCollection', 'units': 'm', 'features': features}))
    (part,) = map_line(read_drawing(path), 'way').placed(None).parts
    assert part.tolist() == [1j, 9 + 1j, 9 + 7j]
    with pytest.raises(DragonError, match='contains 2 lines .wall, way.'):
        map_line(read_drawing(path), None)


@pytest.mark.parametrize('scale', ['200', '2:1', '1:0', 'x', '1:-5'])
def test_a_scale_is_one_to_so_many(scale):
    with pytest.raises(DragonError, match='write for example 1:200'):
        metres_a_unit(scale, None)


def test_a_line_is_walked_the_other_way_when_turned_round(tmp_path):
    path = svg(tmp_path, '<path d="M 20,30 A 40 25 20 0 1 60,50 c 10,0 20,10 30,10 h 9"/>')
    line = svg_line(path, None, (1.0, False))
    back = line.turned_round()
    for part, reverse in zip(line.parts, back.parts[::-1], strict=True):
        one, other = (p if isinstance(p, np.ndarray) else p.stretch(1e-3).points for p in (part, reverse))
        np.testing.assert_allclose(one, other[::-1], atol=1e-9)


def lines_file(tmp_path, *lines, suffix='.geojson', names=None):
    """Write lines of one name, or of the given names, in metres."""
    path = tmp_path / f'a{suffix}'
    path.write_text(json.dumps({'type': 'FeatureCollection', 'units': 'm', 'features': [
        {'type': 'Feature', 'properties': {'name': name}, 'geometry': {
            'type': 'MultiLineString' if isinstance(line[0][0], list) else 'LineString', 'coordinates': line}}
        for name, line in zip(names or ['Market Street'] * len(lines), lines, strict=True)]}))
    return read_drawing(path)


A, B, C = [[0, 0], [60, 0]], [[60, 0], [100, 0]], [[100, 0], [180, 30]]


@pytest.mark.parametrize('ways', [(A, B, C), (A, C, B), (A, B[::-1], C), (A, B, C[::-1]), ([A, B, C],), (A, [C, B])])
def test_ways_of_one_name_that_meet_are_one_line_in_the_direction_of_the_first(tmp_path, ways):
    line = map_line(lines_file(tmp_path, *ways), 'Market Street')
    assert [*line.geometry.coords] == [(0, 0), (60, 0), (100, 0), (180, 30)]
    assert line.notes == ('joined from 3 lines that meet',)


def test_a_way_that_is_listed_twice_is_walked_once(tmp_path):
    line = map_line(lines_file(tmp_path, A, B, A[::-1]), None)
    assert [*line.geometry.coords] == [(0, 0), (60, 0), (100, 0)]
    assert line.notes[0] == '1 repeated line was left out'


def test_a_ring_of_ways_begins_where_its_first_way_begins(tmp_path):
    ring = [[100, 0], [50, 50]], [[50, 50], [0, 0]], [[0, 0], [100, 0]]
    assert [*map_line(lines_file(tmp_path, *ring), None).geometry.coords] == [(100, 0), (50, 50), (0, 0), (100, 0)]


@pytest.mark.parametrize('ways', [(A, C), (A, B, [[60, 0], [60, 40]]), ([A, C],)])
def test_ways_of_one_name_that_do_not_meet_are_listed_with_their_lengths_and_a_choice(tmp_path, ways):
    drawing = lines_file(tmp_path, *ways)
    with pytest.raises(DragonError, match=r"'Market Street' consists of \d lines that do not meet end to end: Market "
                                          r"Street#1 \(60 m\), .*; choose one, for example --path 'Market Street#1'"):
        map_line(drawing, 'Market Street')
    assert [*map_line(drawing, 'Market Street#1').geometry.coords] == [(0, 0), (60, 0)]
    with pytest.raises(DragonError, match='contains no --path'):
        map_line(drawing, 'Market Street#9')


def test_a_line_is_chosen_by_its_number(tmp_path):
    drawing = lines_file(tmp_path, A, C, names=['a', 'b'])
    assert map_line(drawing, '#2').geometry.coords[0] == (100, 0)


def test_only_the_line_that_is_chosen_has_to_be_near(tmp_path):
    pytest.importorskip('pyproj')
    path = tmp_path / 'a.geojson'
    path.write_text(json.dumps({'type': 'FeatureCollection', 'features': [
        {'type': 'Feature', 'properties': {'name': name}, 'geometry': {'type': kind, 'coordinates': at}}
        for name, kind, at in (('far', 'LineString', [[-70.0, 10.0], [-70.0, 11.0]]), ('pole', 'Point', [0, 90]),
                               ('way', 'LineString', [[120.0, 30.0], [120.001, 30.0]]))]}))
    line = map_line(read_drawing(path), 'way')
    (part,) = line.placed(line.own_origin()).parts
    assert abs(part[1] - part[0]) == pytest.approx(96.49, abs=0.01)


def test_repeated_ids_in_an_svg_are_numbered_and_refused_without_a_number(tmp_path):
    path = svg(tmp_path, '<path id="way" d="M 0,0 h 9"/><path id="way" d="M 0,0 h 5"/><path id="b" d="M 0,0 h 5"/>')
    with pytest.raises(DragonError, match="2 paths have the id 'way'; choose one, for example --path 'way#1'"):
        svg_line(path, 'way', (1.0, False))
    (part,) = svg_line(path, 'way#2', (1.0, False)).parts
    assert abs(part[1] - part[0]) == pytest.approx(5)


@pytest.mark.parametrize('page', ['', 'width="200" height="100"', 'width="200px" height="100px"',
                                  'width="100%" height="100%"', 'width="200mm"'])
def test_a_scale_needs_a_page_with_a_size_on_paper(tmp_path, page):
    path = svg(tmp_path, '<path d="M 0,0 h 9"/>', f'<svg xmlns="http://www.w3.org/2000/svg" {page} '
                                                  'viewBox="0 0 400 200">')
    with pytest.raises(DragonError, match='does not state the size of its page .*give --unit'):
        svg_line(path, None, (200.0, True))


@pytest.mark.parametrize('value', [
    'scale(nan)', 'scale(0)', 'scale(1,0)', 'scale(inf)', 'matrix(1 2 2 4 0 0)', 'matrix(1 2 3)', 'skewX(90)',
    'spin(3)', 'scale(2', 'translate(3,x)', 'scale(2) foo', 'perspective(3)', 'rotate(1,2)', 'scale()',
    'translate3d(1,2,3)'])
@pytest.mark.parametrize('where', ['path', 'group'])
def test_transforms_that_are_unknown_or_flatten_the_drawing_are_refused(tmp_path, value, where):
    group, path = (f'transform="{value}"' if where == one else '' for one in ('group', 'path'))
    with pytest.raises(DragonError, match=r'its transform .*(is not valid|has the arguments|flattens)'):
        svg_line(svg(tmp_path, f'<g {group}><path id="a" {path} d="M 0,0 h 9"/></g>'), None, (1.0, False))


@pytest.mark.parametrize('body', ['<rect id="a" width="-9" height="5"/>', '<circle id="a" r="-3"/>',
                                  '<ellipse id="a" rx="3" ry="-2"/>', '<path id="a" style="transform: scale(2)" '
                                  'd="M 0,0 h 9"/>', '<svg viewBox="0 0 -9 5"><path id="a" d="M 0,0 h 9"/></svg>'])
def test_negative_sizes_and_transforms_in_styles_are_refused(tmp_path, body):
    with pytest.raises(DragonError, match=r'a size is negative|transforms in styles'):
        svg_line(svg(tmp_path, body), None, (1.0, False))


@pytest.mark.parametrize('page', ['width="-200mm" height="100mm"', 'width="200mm" height="-100mm"'])
def test_a_page_of_negative_size_is_refused(tmp_path, page):
    path = svg(tmp_path, '<path d="M 0,0 h 9"/>', f'<svg xmlns="http://www.w3.org/2000/svg" {page} '
                                                  'viewBox="0 0 400 200">')
    for scale in ((1.0, False), (200.0, True)):
        with pytest.raises(DragonError, match='a size is negative|does not state the size'):
            svg_line(path, None, scale)


TINY = '8.9481 48.3364,8.9481 48.3374'


@pytest.mark.parametrize(('name', 'text'), [('a.wkt', f'way: LINESTRING ({TINY})'), ('a.wkt', f'LINESTRING ({TINY})'),
                                            ('a.csv', TINY.replace(' ', ';').replace(',', '\n')),
                                            ('a.csv', 'x;y\n' + TINY.replace(' ', ';').replace(',', '\n'))])
def test_a_line_that_could_be_in_degrees_has_to_state_its_unit(tmp_path, name, text):
    pytest.importorskip('pyproj')
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(DragonError, match=r'does not state whether they are .*; (write units|give --unit)'):
        csv_line(path, None) if name == 'a.csv' else map_line(read_drawing(path), None)
    if name == 'a.csv':
        line = csv_line(path, 'deg')
    else:
        path.write_text(f'units: degrees\n{text}')
        line = map_line(read_drawing(path), None)
    (part,) = line.placed(line.own_origin()).parts
    assert abs(part[1] - part[0]) == pytest.approx(111.2, abs=0.1)


def test_a_csv_names_its_unit_in_its_columns(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('x_m,y_m\n0,0\n0.1,0\n')
    assert csv_line(path, None).geometry.length == pytest.approx(0.1)
    with pytest.raises(DragonError, match='its columns are metres; omit --unit'):
        csv_line(path, 'deg')
    path.write_text('lat,lon\n30,120\n30.001,120\n')
    assert csv_line(path, None).crs == 'OGC:CRS84'


@pytest.mark.parametrize('suffix', ['.geojson', '.wkt', '.csv'])
def test_a_byte_order_mark_is_skipped(tmp_path, suffix):
    text = {'.geojson': '{"type": "LineString", "units": "m", "coordinates": [[0, 0], [9, 0]]}',
            '.wkt': 'LINESTRING (0 0, 9 0)', '.csv': 'x,y\n0,0\n9,0\n'}[suffix]
    path = tmp_path / f'a{suffix}'
    path.write_text('\ufeff' + text, encoding='utf-8')
    line = csv_line(path, None) if suffix == '.csv' else map_line(read_drawing(path), None)
    assert line.geometry.length == 9
