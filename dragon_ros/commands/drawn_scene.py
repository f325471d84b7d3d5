"""Make a scene whose track follows a drawing, and whose venue comes from maps, all about one origin."""
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from math import log, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dragon_ros.cli import command_line
from dragon_ros.core.checks import number, plane_pose
from dragon_ros.core.errors import FieldError, InputError, MissingError, TrackEndError, shown
from dragon_ros.core.venue import Origin
from dragon_ros.core.words import counted, length
from dragon_ros.scenes.drawings import DrawnLine, MapLine, chosen, csv_line, map_line, metres_a_unit, svg_line
from dragon_ros.scenes.georeference import own_origin, read_origin
from dragon_ros.scenes.load import load_drawn_scene, venue_file
from dragon_ros.scenes.maps import READERS, Drawing, read_drawing

if TYPE_CHECKING:
    from dragon_ros.core.scene import Scene
    from dragon_ros.core.tracks.composite import Track
    from dragon_ros.core.tracks.drawn import Route
    from dragon_ros.messages.decode import PathMessage

TOLERANCE_M = 0.02      # within which a drawing is followed
_TOLERANCES_M = (TOLERANCE_M, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0, 25.0)     # of recordings
_NOISIER = 1.15         # factor between the tolerances that are tried for a noisy recording
_RECORDED = 50          # a line with more points may be a recording
_SHARED = 4             # each tolerance may take a fourth of the work
_EASY = 2.0             # default radius of corners, as a multiple of the smallest radius
_FRAME = 'dragon'
_PATH = 'nav_msgs/msg/Path'
_RECEIVER = 'dragon_ros.nodes.read_path'
_TIMEOUT_S, _LONGEST_S = 10.0, 600.0     # how long to wait for a live path: by default, and at most
_TABLES = ('.csv', '.txt')
FORMATS = '.svg, .gpx, .kml, .kmz, .geojson, .osm, .wkt, .csv, or a bag with a nav_msgs/Path'
_NEAR_M = 100.0         # obstacles farther from the track than this, plus a bench, are left out of a plan
AnyLine = DrawnLine | MapLine


@dataclass(frozen=True)
class DrawnScene:
    """A scene whose track follows a drawing, the data from which it was made, and notes for the user."""

    scene: 'Scene'
    line: DrawnLine
    route: 'Route'
    track: 'Track'
    least_m: float
    radius_m: float
    tolerance_m: float
    noise_m: float
    notes: tuple[str, ...]

    @property
    def deviation(self) -> str:
        """A sentence that states how far the track is from the drawing, and the noise of a recording."""
        noise = f' of points that scatter by about {self.noise_m:.1g} m' if self.noise_m else ''
        return (f'apart from changed corners and bends, the track deviates from the drawing{noise} by at most '
                f'{length(self.route.strays_m)} (tolerance {length(self.tolerance_m)}; --tolerance gives another)')


def drawn_scene(arguments: Namespace) -> DrawnScene:
    """Return the scene that the options describe, on the drawn line. Raises InputError or MissingError."""
    line, drawing = _line(arguments)
    venue_path, stated, has_own = venue_file(arguments.scene, arguments.overrides)
    obstacles = None if getattr(arguments, 'obstacles', None) is None else read_drawing(arguments.obstacles)
    maps = [one for one in (obstacles, None if venue_path is None else read_drawing(venue_path)) if one]
    origin, note = _origin(arguments.origin, stated, line, maps, has_own)
    base = _base(arguments)
    placed = line if isinstance(line, DrawnLine) else line.placed(origin)
    placed = placed.turned_round() if arguments.reverse else placed
    notes = [note] if note else []
    if isinstance(line, MapLine):
        notes += [f'{line.path.name}: {line.name}: {text}' for text in line.notes]
    noise_m = _noise_m(placed)
    route, least_m, radius_m, tolerance_m = _route(arguments, base, placed, noise_m)
    from dragon_ros.core.tracks.composite import track_of
    from dragon_ros.core.tracks.spec import Composite
    track = track_of(Composite(route.pieces))
    venue, more = _venue(drawing, obstacles, origin, _near(track, sum(base.dragon.link_lengths_m)))
    start_m = _start_m(arguments, base, route, track)
    values = {'kind': 'joined', 'start_m': start_m, 'pieces': [
        {'kind': type(piece).__name__.lower(), **{key: [*one] if isinstance(one, tuple) else one
                                                 for key, one in asdict(piece).items() if one is not None}}
        for piece in route.pieces]}
    scene = load_drawn_scene(arguments.scene, command_line.overrides_from(arguments), origin, values, venue)
    return DrawnScene(scene, placed, route, track, least_m, radius_m, tolerance_m, noise_m, (*notes, *more))


def _line(arguments: Namespace) -> tuple[AnyLine, Drawing | None]:
    """Return the drawn line that the options select, and its map, if it comes from one."""
    path: Path | None = arguments.drawing
    suffix = path.suffix.lower() if path else ''
    names = ('path', 'scale', 'unit', 'topic', 'timeout', 'frame_pose')
    given = {f'--{name.replace("_", "-")}': getattr(arguments, name, None) is not None for name in names}
    kinds = {'.svg': ('an SVG', {'--path', '--scale', '--unit'}),
             **dict.fromkeys(_TABLES, ('a CSV file', {'--unit'})), **dict.fromkeys(READERS, ('a map', {'--path'}))}
    what, takes = (('a live path', {'--topic', '--timeout', '--frame-pose'}) if path is None else
                   kinds.get(suffix, ('a nav_msgs/Path', {'--topic', '--frame-pose'})))
    command_line.check_taken(what, given, takes)
    if path is None:
        return _live(arguments), None
    if suffix in READERS:
        drawing = read_drawing(path)
        return map_line(drawing, arguments.path), drawing
    if suffix == '.svg':
        return svg_line(path, arguments.path, metres_a_unit(arguments.scale, _metres(arguments))), None
    if suffix in _TABLES:
        return csv_line(path, _unit(arguments)), None
    if suffix == '.mcap' or path.is_dir():
        return _recorded(path, arguments), None
    from dragon_ros.scenes.maps import CONVERT
    cure = CONVERT.get(suffix, f'give {FORMATS}')
    raise InputError(f'{path}: its format is not supported; {cure}')


def _unit(arguments: Namespace) -> float | str | None:
    text = getattr(arguments, 'unit', None)
    if text is None or text == 'deg':
        return text
    try:
        value = float(text)
    except ValueError:
        raise FieldError('--unit', text, 'it is not a number', 'give the metres per unit, or deg') from None
    return number('--unit', value, low=1e-9, high=1e9)


def _metres(arguments: Namespace) -> float | None:
    unit = _unit(arguments)
    if isinstance(unit, str):
        raise FieldError('--unit', unit, 'an SVG is not in degrees', 'give the metres per unit')
    return unit


def _recorded(path: Path, arguments: Namespace) -> MapLine:
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


def _live(arguments: Namespace) -> MapLine:
    """Return the first path that a process with ROS receives on a topic."""
    from dragon_ros.messages.decode import read_path
    if arguments.topic is None:
        raise InputError(f'DRAWING: it is missing; give a drawing ({FORMATS}), or --topic for a live path',
                         field='drawing')
    timeout_s = _TIMEOUT_S if arguments.timeout is None else arguments.timeout
    number('--timeout', timeout_s, above=0.0, high=_LONGEST_S)
    done = subprocess.run([sys.executable, '-m', _RECEIVER, arguments.topic, repr(timeout_s)], capture_output=True,
                          check=False, stdin=subprocess.DEVNULL)
    if done.returncode:
        said = done.stderr.decode(errors='replace').strip().rpartition('\n')[2]
        raise MissingError(f'--topic {arguments.topic}: {said or "the receiving process failed"}')
    return _moved(arguments.topic, read_path(done.stdout), arguments)


def _moved(topic: str, message: 'PathMessage', arguments: Namespace) -> MapLine:
    """Return a path in the dragon's frame. Raises InputError if --frame-pose is missing for a path in another frame."""
    import numpy as np
    from shapely import LineString
    points = message.points_m
    if arguments.frame_pose is not None:
        shift, turn = plane_pose('--frame-pose', arguments.frame_pose)
        points = shift + points * turn
    elif message.frame_id != _FRAME:
        raise InputError(f'{topic}: its path is in the frame {shown(message.frame_id)}, and the dragon is in '
                         f'{_FRAME!r}; give the pose of this frame: --frame-pose X,Y,DEGREES (0,0,0 if the two '
                         'frames coincide)',
                         field='frame_pose')
    if len(points) < 2:
        raise InputError(f'{topic}: its path has {counted(len(points), "point")}; a line needs at least 2')
    return MapLine(Path(topic), topic, LineString(np.stack((points.real, points.imag), axis=1)), None)


def _origin(asked: str | None, stated: Origin | None, line: AnyLine, maps: list[Drawing],
            has_own: bool) -> tuple[Origin | None, str]:
    """Return the origin of the scene, and a note that states it.

    The origin is the one that is given, or the middle of the first file that needs one. In the latter case, all other
    parts of the scene must need one, too, because metres about an unknown origin cannot be placed beside a map.
    """
    given = None if asked is None else read_origin(asked)
    if given and stated and given != stated:
        raise InputError(f'--origin {given}: the origin of the scene is {stated}, and a scene has one; omit --origin',
                         field='origin')
    if given or stated:
        return given or stated, f'origin: {given or stated}'
    parts = [(line.name, None) if isinstance(line, DrawnLine) else (line.path.name, line.own_origin())]
    parts += [(one.path.name, own_origin(str(one.path), [each.geometry for each in one.features], one.crs))
              for one in maps]
    first = next(((name, own) for name, own in parts if own), None)
    if first is None:
        return None, ''
    local = [name for name, own in parts if own is None] + (['the venue of the scene'] if has_own else [])
    if local:
        raise InputError(f'{local[0]}: it is in metres about its own (0, 0), and {first[0]} lies on a map; say where '
                         f'(0, 0) is: --origin LONGITUDE,LATITUDE, or EASTm,NORTHm', field='origin')
    return first[1], f'origin: {first[1]} (the middle of {first[0]})'


def _base(arguments: Namespace) -> 'Scene':
    """Return the scene that the options describe, but without its venue, which was made for another track."""
    others = [one for one in arguments.overrides if one.partition('=')[0].partition('.')[0] != 'venue']
    return command_line.scene_from(Namespace(**{**vars(arguments), 'overrides': [*others, 'venue=null']}))


def _noise_m(line: DrawnLine) -> float:
    """Return the noise (m, one standard deviation) of a recording, or 0 for a drawn line."""
    import numpy as np

    from dragon_ros.core.tracks.drawn import noise_m
    return max((noise_m(part) for part in line.parts if isinstance(part, np.ndarray)), default=0.0)


def _tolerances_m(noise_m: float, points: int) -> Iterator[float]:
    """Yield the tolerances (m) at which to follow a recording, in the order to try them.

    Of n points with normal noise, the one farthest from the line is about sqrt(2 ln n) times the noise away from it. A
    track that deviates much less follows the noise, and one that deviates much more leaves the way.
    """
    largest_m = _TOLERANCES_M[-1]
    if not noise_m:
        yield from _TOLERANCES_M
        return
    tolerance_m = 1.1 * noise_m * sqrt(2 * log(points))
    while tolerance_m < largest_m:
        yield float(f'{tolerance_m:.2g}')
        tolerance_m *= _NOISIER
    yield largest_m


def _route(arguments: Namespace, base: 'Scene', line: DrawnLine,
           noise_m: float) -> tuple['Route', float, float, float]:
    """Return the track along a line, the smallest radius of the links, the radius of corners and the tolerance.

    Without --tolerance, a recording is followed within the first tolerance at which this succeeds.
    """
    import numpy as np

    from dragon_ros.core.limits import DRAWING_WORK
    from dragon_ros.core.tracks.composite import least_radius_m
    from dragon_ros.core.tracks.drawn import along
    least_m = least_radius_m(base.dragon.link_lengths_m)
    given = arguments.radius
    radius_m = _EASY * least_m if given is None else number('--radius', given, above=0.0, high=1e6)
    if radius_m < least_m:
        raise FieldError('--radius', radius_m, f'these benches can walk bends with a radius of {least_m:.4g} m or '
                         'more, 1.01 times half the longest link',
                         f'give at least {least_m:.4g}, or use shorter benches')
    least = least_m * (1 + 1e-9)
    if arguments.tolerance is not None:
        tolerance_m = number('--tolerance', arguments.tolerance, low=1e-5, high=1e3)
        return along(line.parts, radius_m, least, tolerance_m), least_m, radius_m, tolerance_m
    points = max((len(part) for part in line.parts if isinstance(part, np.ndarray)), default=0)
    is_recording = points >= _RECORDED
    limit = DRAWING_WORK // _SHARED if is_recording else DRAWING_WORK
    for tolerance_m in _tolerances_m(noise_m, points) if is_recording else _TOLERANCES_M[:1]:
        try:
            return along(line.parts, radius_m, least, tolerance_m, limit), least_m, radius_m, (
                tolerance_m)
        except InputError as error:
            refused = error
    raise refused


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


def _venue(drawing: Drawing | None, obstacles: Drawing | None, origin: Origin | None,
           near: Any) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """Return the obstacles near the line in a map of obstacles and in the map of the line, and notes."""
    from dragon_ros.scenes.venue_files import has_obstacles, venue_of, without_lines
    found = [] if obstacles is None else [venue_of(obstacles, origin, near)]
    if drawing and has_obstacles(drawing):
        found.append(venue_of(without_lines(drawing), origin, near, has_track=True))
    notes = tuple(note for one in found for note in one.notes)
    if not found:
        return {}, ()
    inside = {key: one.values[key] for one in found for key in ('inside',) if key in one.values}
    listed = [each for one in found for each in one.values['obstacles']]
    return ({**inside, 'obstacles': listed} if listed or inside else {}), notes


def _near(track: 'Track', length_m: float) -> Any:
    """Return the surroundings of a track, and of the dragon behind it, as a shapely geometry."""
    import numpy as np
    from shapely import LineString
    points = track.polyline(0.0, track.end_m, 0.1)
    first = points[1] - points[0]
    behind = points[0] - length_m * first / np.hypot(*first)
    return LineString(np.concatenate((behind[None], points))).buffer(_NEAR_M, quad_segs=4)
