"""The command lines of route and plan, whose modules are imported only after the arguments are parsed."""
from argparse import ArgumentParser
from functools import partial
from pathlib import Path

from dragon_ros.cli import command_line
from dragon_ros.cli.language import add_lang_option

_EXAMPLE = """draw the way of the head in Google Earth, or record it with a phone, and save it as way.gpx or way.kml
save the town around it from openstreetmap.org (Export) as town.osm
{program} plan way.gpx --obstacles town.osm --benches 60 --bench-length 2.1"""

def route(argv: list[str]) -> int:
    """Make a scene from a drawing; return the exit code."""
    options = command_line.parser(
        'route', 'Make a track of lines and arcs that follows a drawing: an SVG path, a line of a map (GPX, KML, '
        'GeoJSON,\nOpenStreetMap), a CSV file, or a nav_msgs/Path. Corners are rounded, and curves are fitted. If the '
        'dragon cannot follow\na line, the error names the position.',
        'route street.svg --path way --scale 1:200 --output street.yaml')
    options.add_argument('drawing', nargs='?', type=Path, metavar='DRAWING', help='.svg, .gpx, .kml, .kmz, .geojson, '
                         '.osm, .wkt, .csv, or a bag with a nav_msgs/Path')
    options.add_argument('--output', type=Path, metavar='SCENE.yaml', help='scene file to write; if omitted, only '
                         'the summary is printed')
    options.add_argument('--table', type=Path, metavar='FILE', help='file for the table of all pieces and changes')
    add_drawing_options(options)
    options.add_argument('--topic', metavar='NAME', help='topic of the nav_msgs/Path in a bag or, without '
                                                         'DRAWING, of a live path')
    options.add_argument('--timeout', type=float, metavar='S',
                         help='seconds to wait for a live path (10)')
    options.add_argument('--frame-pose', metavar='X,Y,DEG', help="pose of the path's frame in the frame dragon: "
                         'position in metres, and angle in degrees anticlockwise')
    command_line.add_scene_options(options)
    arguments = options.parse_args(argv)
    from dragon_ros.commands.route import run
    return command_line.guarded('route', partial(run, arguments))


def add_drawing_options(options: ArgumentParser, scale: str = '--scale') -> None:
    """Add the options that select a line in a drawing and turn it into a track."""
    options.add_argument('--obstacles', type=Path, metavar='MAP', help='map with obstacles; those within 100 m of the '
                         'line are used')
    options.add_argument('--path', metavar='NAME', help='the line to walk: id or label of an SVG path, or name of a '
                         'line of a map; #2 is the second line, and NAME#2 the second of that name')
    options.add_argument(scale, dest='scale', metavar='1:N', help='scale of an SVG drawing on paper, such as 1:200')
    options.add_argument('--unit', metavar='METRES|deg', help='metres per unit of an SVG or CSV file, or deg for '
                         'longitude and latitude in a CSV file')
    options.add_argument('--origin', metavar='LON,LAT|EASTm,NORTHm[,EPSG:N]', help='place of (0, 0), in degrees or in '
                         'metres of a map (the middle of the first drawing that lies on a map)')
    options.add_argument('--radius', type=float, metavar='METRES', help='radius of rounded corners (twice the smallest '
                         'radius that these benches can walk)')
    options.add_argument('--tolerance', type=float, metavar='METRES',
                         help='largest distance between the track and a drawn curve (0.02; for a recording, what its '
                         'noise requires)')
    options.add_argument('--start', type=float, metavar='METRES', help='distance along the drawing at which the head '
                         'starts (by default, the first at which the whole dragon is on the drawing, or 0 if the '
                         'drawing is too short)')
    options.add_argument('--reverse', action='store_true', help='walk the drawing in the opposite direction')


def plan(argv: list[str]) -> int:
    """Write the plan of a scene or of a drawing; return the exit code."""
    options = command_line.parser('plan', 'Draw a scene to scale for printing: track, swept area, gaps and times.\nA '
                                  'GeoJSON file contains the swept area, the track and the gaps; a CSV file, marks to '
                                  'chalk on the\nground. Of a drawing, also write a page to share and the scene, and '
                                  'say whether the dragon fits.',
                                  'plan way.gpx --obstacles town.osm --benches 60 --bench-length 2.1')
    options.add_argument('drawings', nargs='*', type=Path, metavar='DRAWING|SCENE.yaml', help='drawing or map with '
                         'the way of the head (as for route), or a scene, or several scenes of one place')
    options.add_argument('--benches', type=int, metavar='N', help='number of benches (of a drawing)')
    options.add_argument('--bench-length', type=float, metavar='METRES', help='length of the benches (of a drawing)')
    options.add_argument('--bench-width', type=float, metavar='METRES', help='width of the benches (of a drawing)')
    add_drawing_options(options, '--way-scale')
    command_line.add_scene_options(options, None)
    options.add_argument('--output', type=Path, metavar='PLAN.pdf|AREA.geojson|MARKS.csv', help='file to write (of a '
                         'drawing: beside it; the page and the scene have the same name)')
    options.add_argument('--scale', dest='plan_scale', metavar='1:N', help='scale of the plan, from 1:50 to 1:1000 '
                         '(one page at 1:200 or larger if the way fits, otherwise an overview, and sheets at 1:200)')
    options.add_argument('--paper', choices=('A4', 'A3'), help='paper size (A4, or A3 if that saves pages)')
    options.add_argument('--format', choices=('pdf', 'geojson', 'csv'), help='format (by the suffix of --output)')
    add_lang_option(options, 'the PDF and of the printed gaps')
    options.add_argument('--title', metavar='TEXT', help='title of the plan (the name of the scene)')
    arguments = options.parse_args(argv)
    if not argv:
        print(_EXAMPLE.format(program=command_line.program()))
        return command_line.OK
    files: list[Path] = arguments.drawings
    arguments.drawing = files[0] if files else None
    is_scene = [file.suffix.lower() in ('.yaml', '.yml') for file in files]
    if files and arguments.scene is not None and any(is_scene):
        options.error('give either SCENE.yaml or --scene')
    if len(files) > 1 and not all(is_scene):
        options.error('give one drawing, or several scenes')
    if all(is_scene) and arguments.output is None:
        options.error('the following arguments are required: --output')
    if len(files) > 1:
        from dragon_ros.commands.plan_together import run
    elif all(is_scene):
        arguments.scene = str(arguments.drawing or arguments.scene or 'street')
        from dragon_ros.commands.plan import run
    else:
        arguments.scene = arguments.scene or 'winding'
        from dragon_ros.commands.plan import run_drawing as run
    return command_line.guarded('plan', partial(run, arguments))
