"""The command lines of the larger commands. Nothing they work with is imported before arguments are read."""
from functools import partial
from pathlib import Path

from dragon_ros.bags.write import COMPRESSIONS
from dragon_ros.cli import command_line

EXPORT_FORMATS = ('csv', 'parquet', 'npz')


def table(argv: list[str]) -> int:
    """Print a table; return the exit code."""
    options = command_line.parser('table', 'Print positions and velocities of the handles (0 is the head, the last '
                                  'the tail).',
                                  'table --times 0,60,300 --handles 0,1,51,223')
    command_line.add_bag(options, 'take them from a bag, each time the first tick at or after it (no scene options)')
    command_line.add_scene_options(options)
    command_line.add_namespace_option(options)
    command_line.add_times_option(options, 'seconds (0, or where the bag begins)')
    command_line.add_handles_option(options)
    options.add_argument('--paper', action='store_true',
                         help="the paper's three tables: printed, reproduced, true, error (no other scene options)")
    options.add_argument('--contest', type=Path, metavar='FOLDER',
                         help="write the contest's result1, result2 and, from the scene turning, result4 (no times)")
    command_line.add_output_options(options, ('text', 'csv', 'json', 'xlsx'))
    arguments = options.parse_args(argv)
    from dragon_ros.commands.table import run
    return command_line.guarded('table', partial(run, arguments))


def inspect(argv: list[str]) -> int:
    """Inspect, check or repair a bag; return the exit code (1 where something is wrong with it)."""
    options = command_line.parser('inspect', 'Show what is in a bag: topics, rates, missing ticks, scene, first '
                                  'contact, clearance, integrity.', 'inspect run.mcap --check')
    command_line.add_bag(options, 'an .mcap file or a rosbag2 folder', required=True)
    options.add_argument('--check', action='store_true', help='recompute every tick from the scene in the bag and '
                         'compare bit for bit, or to the promise of its tier where bits differ')
    options.add_argument('--trust', action='store_true', help='compute with the scene in the bag however large it is '
                         '(budgets: docs/limits.md)')
    options.add_argument('--repair', type=Path, metavar='OUT', help='write what is readable to a complete bag')
    options.add_argument('--looks', type=int, metavar='N', help='number of evenly spaced ticks that the clearance is '
                         'computed at; 0: all (200)')
    command_line.add_namespace_option(options)
    command_line.add_output_options(options, ('text', 'json'))
    arguments = options.parse_args(argv)
    from dragon_ros.commands.inspect import run
    return command_line.guarded('inspect', partial(run, arguments))


def export(argv: list[str]) -> int:
    """Write what is in a bag to a file; return the exit code."""
    options = command_line.parser('export', 'Write handles and velocities of a bag as a table (CSV, Parquet: a row for '
                                  'each tick and handle) or as arrays (npz: also the benches).',
                                  'export run.mcap --format npz --output run.npz')
    command_line.add_bag(options, 'an .mcap file or a rosbag2 folder', required=True)
    command_line.add_format_option(options, EXPORT_FORMATS)
    options.add_argument('--output', type=Path, metavar='FILE', required=True, help='file to write')
    options.add_argument('--force', action='store_true', help='replace an existing file')
    options.add_argument('--every', type=int, default=1, metavar='N', help='every Nth tick only (%(default)s)')
    command_line.add_handles_option(options)
    command_line.add_namespace_option(options)
    arguments = options.parse_args(argv)
    from dragon_ros.commands.export import run
    return command_line.guarded('export', partial(run, arguments))


def simulate(argv: list[str]) -> int:
    """Write a bag; return the exit code (1 where a signal ended it early; the bag is complete then, too)."""
    options = command_line.parser('simulate', 'Write the bag that `sim` and `record` would, without ROS and without '
                                  'waiting: the same messages, bit for bit.',
                                  'simulate --scene winding --output run.mcap')
    command_line.add_scene_options(options)
    options.add_argument('--output', type=Path, metavar='BAG', required=True,
                         help='bag to write: a file if it ends in .mcap, else a rosbag2 folder')
    options.add_argument('--force', action='store_true', help='replace an existing bag')
    options.add_argument('--rate', type=float, metavar='HZ', help='ticks for each second (as the scene says)')
    options.add_argument('--compression', choices=COMPRESSIONS, default='zstd', help='of the bag (%(default)s)')
    options.add_argument('--namespace', default='/dragon', help='of the topics (%(default)s)')
    options.add_argument('--workers', type=int, metavar='N',
                         help='processes that compute (one for each core); the bag is the same with any number')
    arguments = options.parse_args(argv)
    from dragon_ros.commands.simulate import run
    return command_line.guarded('simulate', partial(run, arguments))


def demo(argv: list[str]) -> int:
    """Run the demonstration; return the exit code."""
    options = command_line.parser('demo', 'Run sim, monitor and recorder over DDS on this host until the first '
                                  'contact; replay the bag, check it against the model, draw the dragon.',
                                  'demo --pace 4')
    options.add_argument('--output', type=Path, default=Path('dragon_demo'), metavar='FOLDER',
                         help='where the bag and the picture go; files of an earlier demo are replaced (%(default)s)')
    options.add_argument('--pace', type=float, default=2.0, help='seconds of simulation for each second (%(default)g)')
    arguments = options.parse_args(argv)
    from dragon_ros.commands.demo import run
    return command_line.guarded('demo', partial(run, arguments))


def route(argv: list[str]) -> int:
    """Make a scene of a drawing; return the exit code."""
    options = command_line.parser(
        'route', 'Make a track of lines and arcs that follows a drawing: a path of an SVG, a line of a GeoJSON or CSV '
        'file,\nor a nav_msgs/Path. Corners are rounded, curves fitted; what cannot be walked is refused, with the '
        'place.', 'route street.svg --path way --scale 1:200 --output street.yaml')
    options.add_argument('drawing', nargs='?', type=Path, metavar='DRAWING', help='.svg, .geojson, .wkt, .csv, or a '
                         'bag with a nav_msgs/Path')
    options.add_argument('--output', type=Path, metavar='SCENE.yaml', help='scene to write; without it only the table '
                         'is printed')
    options.add_argument('--path', metavar='NAME', help='which line: the id or label of a path in SVG, the name of a '
                         'feature in GeoJSON')
    options.add_argument('--scale', metavar='1:N', help='of an SVG on paper, such as 1:200')
    options.add_argument('--unit', type=float, metavar='METRES', help='metres for each unit of an SVG or CSV file')
    options.add_argument('--origin', metavar='LON,LAT', help='where (0, 0) of a GeoJSON in degrees lies (the middle of '
                         'the file)')
    options.add_argument('--radius', type=float, metavar='METRES', help='of rounded corners (twice the least that '
                         'these benches can take)')
    options.add_argument('--tolerance', type=float, metavar='METRES', default=0.02,
                         help='how far the track may stray from a drawn curve (%(default)g)')
    options.add_argument('--start', type=float, metavar='METRES', help='how far along the drawing the head starts '
                         '(where the whole dragon stands on it, if it is long enough, else 0)')
    options.add_argument('--reverse', action='store_true', help='walk the drawing the other way')
    options.add_argument('--topic', metavar='NAME', help='of the nav_msgs/Path in a bag; without a DRAWING, live')
    options.add_argument('--timeout', type=float, metavar='S', default=10.0,
                         help='how long to wait for a live path (%(default)g)')
    options.add_argument('--frame-pose', metavar='X,Y,DEG', help="where the path's frame lies in the frame dragon: "
                         'metres, and degrees to the left')
    command_line.add_scene_options(options)
    arguments = options.parse_args(argv)
    from dragon_ros.commands.route import run
    return command_line.guarded('route', partial(run, arguments))


def plan(argv: list[str]) -> int:
    """Write the plan of a scene; return the exit code."""
    options = command_line.parser('plan', 'Draw a scene to scale, for print: track, swept area, gaps, times.\nAs '
                                  'GeoJSON the swept area alone, in metres.', 'plan --scene street --output plan.pdf')
    command_line.add_scene_options(options, 'street')
    options.add_argument('--output', type=Path, required=True, metavar='PLAN.pdf|AREA.geojson', help='file to write')
    options.add_argument('--scale', metavar='1:N', help='from 1:50 to 1:1000 (the largest that fits)')
    options.add_argument('--paper', choices=('A4', 'A3'), help='paper (A4 where it fits, else A3)')
    options.add_argument('--format', choices=('pdf', 'geojson'), help='format (as the suffix of --output says)')
    options.add_argument('--title', metavar='TEXT', help='of the plan (the name of the scene)')
    arguments = options.parse_args(argv)
    from dragon_ros.commands.plan import run
    return command_line.guarded('plan', partial(run, arguments))
