"""``route``: make a scene whose track follows a drawing, with a table of its pieces and of all changes."""
import json
import subprocess
import sys
from argparse import Namespace
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dragon_ros.cli import command_line
from dragon_ros.core.checks import number, plane_pose
from dragon_ros.core.errors import FieldError, InputError, MissingError, TrackEndError, shown
from dragon_ros.core.words import counted
from dragon_ros.scenes.drawings import DrawnLine, chosen, csv_line, map_line, metres_a_unit, svg_line

if TYPE_CHECKING:
    from dragon_ros.core.scene import Scene
    from dragon_ros.core.tracks.composite import Track
    from dragon_ros.core.tracks.drawn import Change, Route
    from dragon_ros.core.tracks.spec import Composite
    from dragon_ros.messages.decode import PathMessage

_EASY = 2.0             # default radius of corners, as a multiple of the smallest radius
_FRAME = 'dragon'
_PATH = 'nav_msgs/msg/Path'
_RECEIVER = 'dragon_ros.nodes.one_path'
_TIMEOUT_S, _LONGEST_S = 10.0, 600.0     # how long to wait for a live path: by default, and at most
_MAPS = ('.geojson', '.json', '.wkt')
_FORMATS = '.svg, .geojson, .wkt, .csv, or a bag with a nav_msgs/Path'


@dataclass(frozen=True)
class _Laid:
    """A scene whose track follows a drawing, and the data from which the scene was made."""

    scene: 'Scene'
    line: DrawnLine
    route: 'Route'
    track: 'Track'
    least_m: float
    radius_m: float


def run(arguments: Namespace) -> int:
    """Make a scene from a drawing; return the exit code."""
    command_line.check_keeps('--output', arguments.output, arguments.drawing)
    laid = _laid(arguments, _without_venue(arguments), _line(arguments))
    command_line.write_output(None, _text(laid, arguments.tolerance))
    if arguments.output is not None:
        from dragon_ros.scenes.provenance import differing_scene_file
        about = {'drawing': str(arguments.drawing or arguments.topic), 'path': laid.line.name,
                 **{key: value for key in ('scale', 'unit', 'tolerance', 'reverse', 'frame_pose')
                    if (value := getattr(arguments, key))}, 'radius': laid.radius_m}
        command_line.write_output(arguments.output, differing_scene_file(laid.scene, about).rstrip('\n'))
        command_line.write_output(None, f'written: {arguments.output}')
    return command_line.OK


def _line(arguments: Namespace) -> DrawnLine:
    """Return the drawn line that the options select. Raises InputError or MissingError."""
    path: Path | None = arguments.drawing
    suffix = path.suffix.lower() if path else ''
    given = {f'--{name.replace("_", "-")}': getattr(arguments, name) is not None
             for name in ('path', 'scale', 'unit', 'origin', 'topic', 'timeout', 'frame_pose')}
    kinds = {'.svg': ('an SVG', {'--path', '--scale', '--unit'}), '.csv': ('a CSV file', {'--unit'}),
             '.txt': ('a CSV file', {'--unit'}),
             **dict.fromkeys(_MAPS, ('a GeoJSON or WKT file', {'--path', '--origin'}))}
    what, takes = (('a live path', {'--topic', '--timeout', '--frame-pose'}) if path is None else
                   kinds.get(suffix, ('a nav_msgs/Path', {'--topic', '--frame-pose'})))
    command_line.check_taken(what, given, takes)
    if path is None:
        line = _live(arguments)
    elif suffix == '.svg':
        line = svg_line(path, arguments.path, metres_a_unit(arguments.scale, _unit(arguments)))
    elif suffix in _MAPS:
        line = map_line(path, arguments.path, _origin_deg(arguments.origin))
    elif suffix in ('.csv', '.txt'):
        line = csv_line(path, _unit(arguments) or 1.0)
    elif suffix == '.mcap' or path.is_dir():
        line = _recorded(path, arguments)
    else:
        raise InputError(f'{path}: its format is not supported; give {_FORMATS}')
    return line.turned_round() if arguments.reverse else line


def _origin_deg(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        lon, lat = map(float, text.split(','))
    except ValueError:
        raise FieldError('--origin', text, 'it must be two numbers', 'write LONGITUDE,LATITUDE') from None
    return number('--origin', lon, low=-180, high=180), number('--origin', lat, low=-90, high=90)


def _unit(arguments: Namespace) -> float | None:
    return None if arguments.unit is None else number('--unit', arguments.unit, low=1e-9, high=1e9)


def _recorded(path: Path, arguments: Namespace) -> DrawnLine:
    """Return the last path on a topic of a bag."""
    from dragon_ros.bags.read.reader import BagReader
    from dragon_ros.messages.decode import read_path
    with BagReader(path) as bag:
        topics = [topic.name for topic in bag.topics if topic.type == _PATH and topic.messages]
        topic = topics[chosen(path, 'topic', topics, arguments.topic, '--topic')]
        last = None
        for message in bag.messages([topic]):
            last = message.data
    assert last is not None
    return _moved(topic, read_path(last), arguments)


def _live(arguments: Namespace) -> DrawnLine:
    """Return the first path that a process with ROS receives on a topic."""
    from dragon_ros.messages.decode import read_path
    if arguments.topic is None:
        raise InputError(f'DRAWING: it is missing; give a drawing ({_FORMATS}), or --topic for a live path',
                         field='drawing')
    timeout_s = _TIMEOUT_S if arguments.timeout is None else arguments.timeout
    number('--timeout', timeout_s, above=0.0, high=_LONGEST_S)
    done = subprocess.run([sys.executable, '-m', _RECEIVER, arguments.topic, repr(timeout_s)], capture_output=True,
                          check=False, stdin=subprocess.DEVNULL)
    if done.returncode:
        said = done.stderr.decode(errors='replace').strip().rpartition('\n')[2]
        raise MissingError(f'--topic {arguments.topic}: {said or "the receiving process failed"}')
    return _moved(arguments.topic, read_path(done.stdout), arguments)


def _moved(topic: str, message: 'PathMessage', arguments: Namespace) -> DrawnLine:
    """Return a path in the dragon's frame. Raises InputError if --frame-pose is missing for a path in another frame."""
    points = message.points_m
    if arguments.frame_pose is not None:
        shift, turn = plane_pose('--frame-pose', arguments.frame_pose)
        points = shift + points * turn
    elif message.frame_id != _FRAME:
        raise InputError(f'{topic}: its path is in the frame {shown(message.frame_id)}, and the dragon is in '
                         f'{_FRAME!r}; give the pose of this frame: --frame-pose X,Y,DEGREES (0,0,0 if the two '
                         'frames coincide)',
                         field='frame_pose')
    return DrawnLine(topic, (points,))


def _laid(arguments: Namespace, base: 'Scene', line: DrawnLine) -> _Laid:
    """Return the scene in which a dragon walks along a line. Raises InputError."""
    from dragon_ros.core.tracks.composite import least_radius_m, track_of
    from dragon_ros.core.tracks.drawn import along
    from dragon_ros.core.tracks.spec import Composite
    least_m = least_radius_m(base.dragon.link_lengths_m)
    given = arguments.radius
    radius_m = _EASY * least_m if given is None else number('--radius', given, above=0.0, high=1e6)
    if radius_m < least_m:
        raise FieldError('--radius', radius_m, f'these benches can walk bends with a radius of {least_m:.4g} m or '
                         'more, 1.01 times half the longest link',
                         f'give at least {least_m:.4g}, or use shorter benches')
    tolerance_m = number('--tolerance', arguments.tolerance, low=1e-5, high=1e3)
    route = along(line.parts, radius_m, least_m * (1 + 1e-9), tolerance_m)
    track = track_of(Composite(route.pieces))
    start_m = _start_m(arguments, base, route, track)
    scene = _on(arguments, Composite(route.pieces, start_m))
    return _Laid(scene, line, route, track, least_m, radius_m)


def _without_venue(arguments: Namespace) -> 'Scene':
    """Return the scene that the options describe, but without its venue, which was made for another track."""
    return command_line.scene_from(Namespace(**{**vars(arguments), 'overrides': [*arguments.overrides, 'venue=null']}))


def _on(arguments: Namespace, track: 'Composite') -> 'Scene':
    """Return the scene that the options describe, on the given track.

    Raises InputError if an obstacle is in the way at the start.
    """
    pieces = [{'kind': type(piece).__name__.lower(), **{key: value for key, value in asdict(piece).items()
                                                        if value is not None}} for piece in track.pieces]
    values = json.dumps({'kind': 'joined', 'start_m': track.start_m, 'pieces': pieces})
    return command_line.scene_from(Namespace(**{**vars(arguments), 'overrides': [*arguments.overrides,
                                                                                 f'track={values}']}))


def _start_m(arguments: Namespace, base: 'Scene', route: 'Route', track: 'Track') -> float:
    """Return the distance (m) along the track at which the head starts."""
    drawn_m = track.end_m - route.lead_in_m
    if arguments.start is not None:
        return route.lead_in_m + number('--start', arguments.start, low=0.0, high=drawn_m)
    from dragon_ros.core.chain.leader import head_in_front_m
    try:
        return head_in_front_m(track, base.dragon.link_lengths_m, route.lead_in_m)
    except TrackEndError:
        return route.lead_in_m


def _text(laid: _Laid, tolerance_m: float) -> str:
    """Return the table of pieces, with notes on changes and deviations."""
    route, track = laid.route, laid.track
    rows = [f'{"piece":<10} {"length m":>10} {"radius m":>10} {"turn":>14}   begins at m']
    for number_, (segment, piece) in enumerate(zip(track.segments, route.pieces, strict=True), 1):
        first = segment.after(0.0).hi
        at = complex(segment.at(first))
        length_m = float(segment.metres_between(first, segment.last))
        radius_m, angle = getattr(piece, 'radius_m', None), getattr(piece, 'angle_deg', 0.0)
        turn = f'{abs(angle):.2f}° {"left" if angle > 0 else "right"}' if radius_m else ''
        rows.append(f'{number_:<4} {"arc" if radius_m else "line":<5} {length_m:10.3f} '
                    f'{"" if radius_m is None else f"{radius_m:.3f}":>10} {turn:>14}   ({at.real:.3f}, {at.imag:.3f})')
    return '\n'.join([*rows, '', *_notes(laid, tolerance_m)])


def _notes(laid: _Laid, tolerance_m: float) -> list[str]:
    route, track = laid.route, laid.track
    arcs = sum(hasattr(piece, 'radius_m') for piece in route.pieces)
    notes = [f'{laid.line.name}: {track.end_m - route.lead_in_m:.3f} m, '
             f'{counted(len(route.pieces), "piece")} ({counted(arcs, "arc")})',
             f'apart from the changes, the track deviates from the drawing by at most {1000 * route.strays_m:.2f} mm '
             f'(tolerance {1000 * tolerance_m:g} mm)', _tightest(laid), *map(_changed, route.changes)]
    if route.lead_in_m:
        notes.append(f'changed: the drawing starts with a bend, so a line of {route.lead_in_m:g} m was added before '
                     'the bend')
    return [*notes, _start(laid)]


def _tightest(laid: _Laid) -> str:
    if not laid.track.bend:
        return 'the track has no bends'
    k = max(range(len(laid.track.segments)), key=lambda k: laid.track.segments[k].bend)
    at = complex(laid.track.segments[k].at(laid.track.segments[k].after(0.0).hi))
    return (f'the tightest bend has a radius of {1 / laid.track.bend:.4g} m: piece {k + 1} at ({at.real:.3f}, '
            f'{at.imag:.3f}) m; the smallest radius that these benches can walk is {laid.least_m:.4g} m')


def _changed(change: 'Change') -> str:
    x, y = change.place_m
    what = 'the corner' if change.is_corner else 'the bend'
    return (f'changed: {what} at ({x:.3f}, {y:.3f}) m now has a radius of {change.radius_m:.4g} m and deviates by up '
            f'to {change.off_m:.3g} m from the drawing')


def _start(laid: _Laid) -> str:
    from dragon_ros.core.chain.leader import head_in_front_m
    start_m = laid.scene.track.start_m - laid.route.lead_in_m
    walked_m = laid.track.end_m - laid.route.lead_in_m - start_m
    text = f'the head starts {start_m:.3f} m along the drawing and walks {walked_m:.3f} m'
    try:
        whole_m = head_in_front_m(laid.track, laid.scene.dragon.link_lengths_m, laid.route.lead_in_m)
    except TrackEndError:
        whole_m = float('inf')
    if start_m + laid.route.lead_in_m >= whole_m - 1e-6:
        return f'{text}; the whole dragon is on the drawing'
    return f'{text}; the rest of the dragon is on a straight line before the drawing'
