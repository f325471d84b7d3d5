"""All parameters of the nodes: name, default, limits and text. This module imports little, to keep --help fast."""
from typing import Any, NamedTuple

LATEST_S = 2**31 - 1    # a ROS stamp stores seconds as int32
# A test checks that these equal the values in core.domain and core.geometry.tracker, which are slow to import.
LONGEST_RUN_S, MOST_HZ = 1e6, 1e4
NEAR_M = 0.02
DISCOVERY_S = 4.0       # nodes/publisher_queue.py explains this value
_AS_SCENE = -1.0


class Parameter(NamedTuple):
    """One parameter. Its type is that of its default; numbers have limits, and strings may have choices.

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
    or_number: bool = False     # a text that may be a number


# For every node that plays frames; nodes/playback.py reads them.
CONTROLS = (
    Parameter('step_ticks', 1, 'Number of ticks played by the service step', 1, 1000, live=True),
    Parameter('seek_s', -1.0, 'Time in seconds for the service seek, which moves to the last tick at or before it; '
              'negative: the start', -1.0, LATEST_S, live=True),
    Parameter('at_end', 'stop', 'At the end: stop (the node ends); hold (the node waits for reset, seek or step); '
              'loop (the run restarts)', choices=('stop', 'hold', 'loop'), live=True),
    Parameter('publish_clock', False, 'Publish the simulation time on /clock, unless another node does: at each tick, '
              'and every second while time is stopped'),
)
_DISCOVERY = Parameter('discovery_s', -1.0, 'Seconds to wait for the discovery of readers before the first tick; '
                       f'negative: {DISCOVERY_S:g}, or 0 if wait_subscribers lists topics', -1.0, 60.0)
SIM = (
    Parameter('scene', 'winding', 'Scene: a name (see msg_configs/scenes) or the path of a .yaml file'),
    Parameter('set', [''], 'Overrides of scene keys, each as key=value with a dotted key; those of the option --set '
              'are applied afterwards'),
    Parameter('accuracy', '', 'Largest position error allowed, in metres; empty: as in the scene', or_number=True),
    Parameter('start_s', _AS_SCENE, 'Time of the first tick in seconds; negative: as in the scene', -1.0,
              LONGEST_RUN_S),
    Parameter('stop_s', _AS_SCENE, 'Time of the end of the run in seconds; negative: as in the scene', -1.0,
              LONGEST_RUN_S),
    Parameter('rate_hz', _AS_SCENE, 'Ticks per second of simulation; negative: as in the scene', -1.0, MOST_HZ),
    Parameter('stamp_offset', '', 'Seconds by which all stamps, /clock and bag times are later than the time of the '
              'simulation, or wall: the first tick has the wall time; empty: as in the scene', or_number=True),
    Parameter('time_scale', 1.0, 'Seconds of simulation per second of wall time; 0, which can only be set at the '
                                 'start: as fast as the readers can follow', 0.0, 1e6, live=True),
    Parameter('wait_subscribers', [''], 'Start when topics have this many subscribers, for example [handles=2, '
              'velocities=1]'),
    _DISCOVERY,
    Parameter('on_contact', 'continue', 'At the first contact: continue; hold (end with the frame at exactly that '
              'time, and then wait as with at_end hold); stop (end with that frame). For a led dragon, the frame is '
              'that of the first tick in contact', choices=('continue', 'hold', 'stop')),
    *CONTROLS,
    Parameter('cmd_vel_stamped', True, 'Type of the commands on cmd_vel, if the head law is commanded; true: '
              'TwistStamped, false: Twist'),
    Parameter('publish_tf', False, 'Publish the head and the tail as frames on /tf'),
    Parameter('robot_description', False, 'Publish the dragon as a robot in URDF on robot_description'),
    Parameter('frame_id', 'dragon', 'Frame of all messages'),
)
REPLAY = (
    Parameter('time_scale', 1.0, 'Seconds of the bag per second of wall time; 0, which can only be set at the start: '
                                 'as fast as the readers can follow', 0.0, 1e6, live=True),
    _DISCOVERY,
    *CONTROLS,
)
MONITOR = (
    Parameter('warn_below_m', NEAR_M, 'Clearance in metres below which /diagnostics shows a warning', 0.0, 1e3,
              live=True),
    Parameter('clearance_vector', False, 'Publish the shortest vector between the closest benches on '
              'clearance/vector'),
    Parameter('venue', '', 'File with obstacles, in the frame of the dragon: a GeoJSON or WKT file, or a scene (a name '
              'or a .yaml file); added to the obstacles from the topic venue and from the map'),
    Parameter('map', '/map', 'Topic of a nav_msgs/OccupancyGrid whose occupied cells are obstacles; empty: none'),
    Parameter('map_occupied', 65, 'Lowest value, in percent, at which a map cell is an obstacle', 1, 100),
    Parameter('map_unknown', 'free', 'How to treat unknown cells of the map (negative values, usually -1): as free or '
              'as occupied', choices=('free', 'occupied')),
    Parameter('venue_pose', '', "X,Y,DEGREES: pose of the map's or venue's frame in the dragon's frame, if the frames "
              'differ; empty: from /tf and /tf_static'),
)
NAMES = frozenset(parameter.name for table in (SIM, REPLAY, MONITOR) for parameter in table)      # of all nodes


def described(table: tuple[Parameter, ...]) -> str:
    """Return the lines that ``--help`` shows for a table."""
    return '\n'.join(f'  {parameter.name}: {parameter.text}' for parameter in table)
