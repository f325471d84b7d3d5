"""Declare each parameter of the nodes once: name, default, limits and text. To keep --help fast, it imports little."""
from typing import Any, NamedTuple

# A test checks that these equal the values in core.scene and core.geometry.tracker, whose imports are slow.
LATEST_S = 2**31 - 1
NEAR_M = 0.02
DISCOVERY_S = 4.0       # nodes/publisher_queue.py explains this value
_AS_SCENE = -1.0


class Parameter(NamedTuple):
    """One parameter. Its type is that of its default; numbers have limits, and texts may have choices.

    A ``live`` parameter can be set while the node runs; other parameters are read at the start and are read-only
    afterwards.
    """

    name: str
    default: Any
    text: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False


# For every node that plays frames; nodes/controls.py reads them.
CONTROLS = (
    Parameter('step_ticks', 1, 'Number of ticks that the service step plays', 1, 1000, live=True),
    Parameter('seek_s', -1.0, 'Time in seconds to which the service seek moves: to the last tick at or before it; '
              'negative: to the start', -1.0, LATEST_S, live=True),
    Parameter('at_end', 'stop', 'At the end: stop (the node ends); hold (it stays for reset, seek and step); '
              'loop (it starts again)', choices=('stop', 'hold', 'loop'), live=True),
    Parameter('publish_clock', False, 'Publish the simulation time on /clock: at each tick, and every second while '
              'time stands still'),
)
_DISCOVERY = Parameter('discovery_s', -1.0, 'Seconds that the first tick waits for readers to be discovered; '
                       f'negative: {DISCOVERY_S:g}, or 0 if wait_subscribers names topics', -1.0, 60.0)
SIM = (
    Parameter('scene', 'winding', 'Scene: a name (see msg_configs/scenes) or the path of a .yaml file'),
    Parameter('set', [''], 'Overrides of scene keys, each key=value with a dotted key; options --set are applied after '
              'them'),
    Parameter('accuracy', '', 'Largest position error: metres or a tier; empty: as in the scene'),
    Parameter('start_s', _AS_SCENE, 'First tick in seconds of the scene; negative: as in the scene', -1.0, LATEST_S),
    Parameter('stop_s', _AS_SCENE, 'End of the run in seconds of the scene; negative: as in the scene', -1.0, LATEST_S),
    Parameter('rate_hz', _AS_SCENE, 'Ticks per second of simulation; negative: as in the scene', -1.0, 1e6),
    Parameter('time_scale', 1.0, 'Seconds of simulation per second; 0 (at the start only): as fast as the readers can '
                                 'follow', 0.0, 1e6, live=True),
    Parameter('wait_subscribers', [''], 'Start as soon as topics have this many subscribers, e.g. [handles=2, '
              'velocities=1]'),
    _DISCOVERY,
    Parameter('on_contact', 'continue', 'At the first contact: continue; hold (end with the frame at exactly that time '
              'and stay, as with at_end hold); stop (end with that frame). A led dragon: the first tick in contact',
              choices=('continue', 'hold', 'stop')),
    *CONTROLS,
    Parameter('cmd_vel_stamped', True, 'Type of the commands on cmd_vel, if the head law is commanded: TwistStamped; '
              'false: Twist'),
    Parameter('publish_tf', False, 'Publish the head and the tail as frames on /tf'),
    Parameter('robot_description', False, 'Publish the dragon as a robot in URDF on robot_description'),
    Parameter('frame_id', 'dragon', 'Frame of all messages'),
)
REPLAY = (
    Parameter('time_scale', 1.0, 'Seconds of the bag per second; 0 (at the start only): as fast as the readers can '
                                 'follow', 0.0, 1e6, live=True),
    _DISCOVERY,
    *CONTROLS,
)
MONITOR = (
    Parameter('warn_below_m', NEAR_M, 'A clearance below this many metres is a warning on /diagnostics', 0.0, 1e3,
              live=True),
    Parameter('clearance_vector', False, 'Publish the shortest vector between the closest benches on '
              'clearance/vector'),
    Parameter('venue', '', 'Obstacles from a file, in the frame of the dragon: a GeoJSON or WKT file, or a scene (a '
              'name or a .yaml file). They are added to those of the topic venue and of the map'),
    Parameter('map', '/map', 'Topic of a nav_msgs/OccupancyGrid whose occupied cells are obstacles; empty: none'),
    Parameter('map_occupied', 65, 'Cells of the map with this value (percent) or more are obstacles', 1, 100),
    Parameter('map_unknown', 'free', 'Unknown cells of the map (negative values, usually -1): free, or obstacles like '
              'occupied ones', choices=('free', 'occupied')),
    Parameter('venue_pose', '', 'X,Y,DEGREES: the pose, in the frame of the dragon, of the frame of a map or venue '
              'that is in another frame; empty: that of /tf and /tf_static'),
)
NAMES = frozenset(parameter.name for table in (SIM, REPLAY, MONITOR) for parameter in table)      # of all nodes


def described(table: tuple[Parameter, ...]) -> str:
    """Return the lines that ``--help`` shows for a table."""
    return '\n'.join(f'  {parameter.name}: {parameter.text}' for parameter in table)
