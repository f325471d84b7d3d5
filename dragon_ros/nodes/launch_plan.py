"""Plan the executables that ``dragon.launch.py`` starts and their parameters, without using the launch library."""
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

from dragon_ros.bags.read.frames import FRAME_ID, frame_of_bag, namespace_of
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.errors import DragonError, InputError, did_you_mean
from dragon_ros.core.scene import NS
from dragon_ros.messages.channels import Channel, channels, live
from dragon_ros.nodes.params import DISCOVERY_S
from dragon_ros.scenes.load import load_scene

_WATCHED = ('handles', 'benches')
_VENUE = 'venue'
_MISSPELT = 0.75                # difflib ratio: scen is a misspelt scene (0.89); use_rviz is another name (0.67)
_ARGUMENT_OF = {'rate_hz': 'rate', 'warn_below_m': 'warn_below', 'publish_clock': 'clock'}  # if names differ
YES_NO = ('true', 'false', 'True', 'False')       # launch files in Python write True


class Argument(NamedTuple):
    """One argument of the launch file; ``concerns`` names the executable that uses it, if only one does."""

    name: str
    default: str
    text: str
    choices: tuple[str, ...] = ()
    concerns: str = ''


ARGUMENTS = (
    Argument('scene', 'winding', 'scene: a name, or a .yaml file', concerns='sim'),
    Argument('set', '', 'overrides of scene keys, separated by semicolons: key=value; key=value', concerns='sim'),
    Argument('accuracy', '', 'largest position error allowed, in metres; empty: as in the scene', concerns='sim'),
    Argument('rate', '', 'ticks per second of simulation; empty: as in the scene', concerns='sim'),
    Argument('start_s', '', 'simulation time of the first tick in seconds; empty: as in the scene or bag'),
    Argument('stop_s', '', 'simulation time of the end in seconds; empty: as in the scene or bag'),
    Argument('time_scale', '1.0', 'seconds of simulation per second of wall time; 0: as fast as the readers can '
                                  'follow'),
    Argument('discovery_s', f'{DISCOVERY_S:g}', 'seconds to wait for the discovery of readers before the first tick'),
    Argument('at_end', '', 'at the end of the run: stop (everything), hold (wait for reset, seek or step) or loop; '
             'empty: hold, or stop with on_contact:=stop', ('', 'stop', 'hold', 'loop')),
    Argument('on_contact', 'continue', 'at the first contact: continue, hold or stop there',
             ('continue', 'hold', 'stop'), concerns='sim'),
    Argument('namespace', 'dragon', 'namespace of all nodes and topics; relative to a namespace that another launch '
                                    'file has pushed, unless it starts with /'),
    Argument('frame_id', '', 'frame of all messages; empty: the same as the namespace, or as in the bag'),
    Argument('params_file', '', 'YAML file with parameters of the nodes; launch arguments take precedence if given'),
    Argument('clock', 'true', 'the sim or replay publishes /clock, unless another node does', YES_NO),
    Argument('use_sim_time', 'false', 'all nodes follow /clock', YES_NO),
    Argument('stamp_offset', '', 'seconds by which stamps, /clock and bag times are later than the time of the '
             'simulation, or wall: the first tick has the wall time; empty: as in the scene', concerns='sim'),
    Argument('publish_tf', 'false', 'publish the head and the tail on /tf', YES_NO, concerns='sim'),
    Argument('monitor', 'true', 'report contacts and clearance, if benches are published', YES_NO),
    Argument('warn_below', '0.02', 'clearance in metres below which the monitor warns', concerns='monitor'),
    Argument('clearance_vector', 'false', 'publish the shortest vector between the closest benches', YES_NO,
             concerns='monitor'),
    Argument('venue', '', 'obstacles for the monitor, in addition to those of the scene: a GeoJSON, WKT or scene file',
             concerns='monitor'),
    Argument('map', '/map', 'topic of a map (nav_msgs/OccupancyGrid) with obstacles for the monitor; empty: none',
             concerns='monitor'),
    Argument('map_occupied', '65', 'lowest value, in percent, at which a map cell is an obstacle',
             concerns='monitor'),
    Argument('map_unknown', 'free', 'how to treat unknown cells of the map', ('free', 'occupied'), concerns='monitor'),
    Argument('venue_pose', '', "X,Y,DEGREES: pose of the map's or venue's frame in the dragon's frame; empty: from /tf",
             concerns='monitor'),
    Argument('record', '', 'bag to write (.mcap); empty: none'),
    Argument('replay', '', 'bag to replay instead of running a sim; empty: none'),
    Argument('rviz', 'true', 'show the dragon in RViz', YES_NO),
    Argument('headless', 'false', 'open no windows, even with rviz:=true', YES_NO),
    Argument('respawn', 'false', 'restart the monitor two seconds after it has ended, instead of ending the launch',
             YES_NO, concerns='monitor'),
    Argument('json', 'false', 'write the logs as JSON', YES_NO),
)


@dataclass(frozen=True)
class LaunchedNode:
    """One executable of the package, with its arguments and ROS parameters.

    The user's parameter ``file`` takes precedence over all parameters except those in ``asked``, which the user gave as
    launch arguments.
    """

    executable: str
    arguments: list[str] = field(default_factory=list)
    parameters: dict[str, Any] = field(default_factory=dict)
    file: str = ''
    asked: frozenset[str] = frozenset()


@dataclass(frozen=True)
class LaunchPlan:
    """The readers to start (the recorder last), the source, and the namespace and frame of the dragon.

    ``notes`` tells the user what was omitted and why.
    """

    namespace: str
    frame_id: str
    readers: list[LaunchedNode]
    source: LaunchedNode
    notes: tuple[str, ...] = ()

    @property
    def recorder(self) -> LaunchedNode | None:
        """The recorder, if there is one."""
        return next((one for one in self.readers if one.executable == 'record'), None)


@dataclass(frozen=True)
class _ObservedNode:
    """A sim or replay, the frame of its messages, and whether a monitor can observe it.

    ``seen`` is None if this is unknown; the run then does not wait for its readers.
    """

    start: LaunchedNode
    frame_id: str
    seen: bool | None


def plan(given: Mapping[str, str], pushed: str = '') -> LaunchPlan:
    """Return the plan for the launch arguments, all of them strings. Raises InputError, naming an invalid argument.

    ``pushed`` is the namespace that an including launch file has pushed (PushRosNamespace).
    """
    namespace = _absolute(given['namespace'], pushed)
    watching = on(given, 'monitor')
    source = _replay(given, namespace, watching) if given['replay'] else _sim(given, namespace, watching)
    notes = []
    if watching and source.seen is False:
        watching = False
        notes.append('no monitor is started, because no benches are published: '
                     + ('the bag has none' if given['replay'] else "add benches to the scene's effects"))
    readers = [_monitor(given)] if watching else []
    readers += [_recorder(given, wait=watching and source.seen is True)] if given['record'] else []
    started = [*readers, source.start]
    _refuse_idle(given, [one.executable for one in started], notes)
    finish = [_common(given, one) for one in started]
    return LaunchPlan(namespace, source.frame_id, finish[:-1], finish[-1], tuple(notes))


def _absolute(namespace: str, pushed: str) -> str:
    """Return a namespace as an absolute one; a relative one lies in the pushed namespace."""
    parts = [namespace] if namespace.startswith('/') else [pushed, namespace]
    return '/' + '/'.join(part.strip('/') for part in parts if part.strip('/'))


def misspelt(configured: Iterable[str]) -> list[str]:
    """Return a line for each launch configuration whose name is close to that of an argument, but not equal to it.

    Launch accepts any name, and an including launch file may use other names for itself, so that these are no errors.
    """
    names = [one.name for one in ARGUMENTS]
    return [f'launch argument {name} is not known and is ignored; {hint}' for name in configured
            if name not in names and (hint := did_you_mean(name, names, '', _MISSPELT))]


def _monitor(given: Mapping[str, str]) -> LaunchedNode:
    return LaunchedNode('monitor', [], {
        'clearance_vector': on(given, 'clearance_vector'), 'warn_below_m': _number(given, 'warn_below'),
        'map_occupied': _whole(given, 'map_occupied'),
        **{name: given[name] for name in ('venue', 'map', 'map_unknown', 'venue_pose')}})


def _recorder(given: Mapping[str, str], wait: bool) -> LaunchedNode:
    """Return the recorder; given ``wait``, it first waits for the monitor, and the run waits for both."""
    return LaunchedNode('record', ['--output', given['record'], *(['--wait-monitor'] if wait else [])])


def _is_given(given: Mapping[str, str], name: str) -> bool:
    """Return whether an argument differs from its default."""
    argument = next(one for one in ARGUMENTS if one.name == name)
    value = given[name].lower() if argument.choices == YES_NO else given[name]
    return value != argument.default


def _refuse_idle(given: Mapping[str, str], started: list[str], notes: list[str]) -> None:
    """Raise InputError for an argument that applies only to an executable that is not started."""
    for one in ARGUMENTS:
        if one.concerns and one.concerns not in started and _is_given(given, one.name):
            why = 'replay:= replaces it' if one.concerns == 'sim' else notes[0] if notes else 'monitor:=false'
            raise InputError(f'launch argument {one.name}:={given[one.name]}: applies only to {one.concerns}, which '
                             f'is not started ({why}); omit it', field=one.name)


def _common(given: Mapping[str, str], one: LaunchedNode) -> LaunchedNode:
    """Add the parameters and options that all nodes share."""
    parameters = {'use_sim_time': on(given, 'use_sim_time'), **one.parameters}
    known = {argument.name for argument in ARGUMENTS}
    asked = {name for name in parameters
             if (argument := _ARGUMENT_OF.get(name, name)) in known and _is_given(given, argument)}
    return replace(one, parameters=parameters, file=given['params_file'], asked=frozenset(asked),
                   arguments=[*one.arguments, *(['--json'] if on(given, 'json') else [])])


def on(given: Mapping[str, str], name: str) -> bool:
    """Return whether a boolean argument is true."""
    return given[name].lower() == 'true'


def _number(given: Mapping[str, str], name: str) -> float:
    """Return an argument as a number. Raises InputError."""
    return _parsed(given, name, float, 'a finite number', '1.0')


def _whole(given: Mapping[str, str], name: str) -> int:
    """Return an argument as a whole number. Raises InputError."""
    return int(_parsed(given, name, int, 'a whole number', '65'))


def _parsed(given: Mapping[str, str], name: str, kind: Callable[[str], float], what: str, example: str) -> float:
    with suppress(ValueError):
        value = kind(given[name])
        if isfinite(value):
            return value
    raise InputError(f'launch argument {name}:={given[name]}: it is not {what}; write for example {name}:={example}',
                     field=name)


def _wanted(given: Mapping[str, str], row: Channel, watching: bool) -> int:
    """Return the number of subscribers that a topic will have."""
    return (watching and row.name in (*_WATCHED, _VENUE)) + bool(given['record'])


def _at_end(given: Mapping[str, str]) -> str:
    """Return the action at the end of a run; by default, a run that stops at a contact ends there."""
    return given['at_end'] or ('stop' if given['on_contact'] == 'stop' else 'hold')


def _sim(given: Mapping[str, str], namespace: str, watching: bool) -> _ObservedNode:
    """Return the simulator.

    The run starts when the monitor and the recorder have subscribed and all nodes have had time to discover each other,
    because the recorder also records the monitor, and other recorders may be running.
    """
    optional = {key: _number(given, name) for key, name in (
        ('rate_hz', 'rate'), ('start_s', 'start_s'), ('stop_s', 'stop_s')) if given[name]}
    frame_id = given['frame_id'] or namespace.strip('/').replace('/', '_')
    changes, wait, seen = [text.strip() for text in given['set'].split(';') if text.strip()], [''], None
    try:
        scene = load_scene(given['scene'], changes)
        topics = [*live(scene.effects), *([channels()[_VENUE]] if scene.venue is not None else [])]
    except DragonError:
        pass            # the sim reports errors in the scene
    else:
        if not given['params_file']:        # the file may name another scene
            seen = set(_WATCHED) <= {row.name for row in topics}
            wait = [f'{row.name}={_wanted(given, row, watching and seen)}' for row in topics]
    return _ObservedNode(LaunchedNode('sim', [], {
        'scene': given['scene'], 'set': changes or [''], 'accuracy': given['accuracy'], 'at_end': _at_end(given),
        'time_scale': _number(given, 'time_scale'), 'on_contact': given['on_contact'], 'frame_id': frame_id,
        'stamp_offset': given['stamp_offset'],
        'publish_clock': on(given, 'clock'), 'publish_tf': on(given, 'publish_tf'),
        'wait_subscribers': wait, 'discovery_s': _number(given, 'discovery_s'), **optional}), frame_id, seen)


def _replay(given: Mapping[str, str], namespace: str, watching: bool) -> _ObservedNode:
    """Return the replay of a bag in a namespace.

    If a monitor runs, recorded monitor topics are omitted, so that each topic has only one publisher.
    """
    parameters = {'time_scale': _number(given, 'time_scale'), 'at_end': _at_end(given),
                  'discovery_s': _number(given, 'discovery_s')}
    arguments = [given['replay'], '--into', namespace]
    frame_id, seen = FRAME_ID, None
    try:
        with BagReader(Path(given['replay'])) as bag:
            root, names = namespace_of(bag), [topic.name for topic in bag.topics if topic.messages]
            frame_id, span_ns = frame_of_bag(bag, root), (bag.start_ns, bag.end_ns)
    except DragonError:
        pass                # the replay reports errors in the bag
    else:
        rows = {name if name.startswith('/') else f'{root}/{name}': row for name, row in channels().items()}
        seen = {f'{root}/{name}' for name in _WATCHED} <= set(names)
        watching = watching and seen
        played = [name for name in names if not (watching and name in rows and rows[name].publisher == 'monitor')]
        waited = [f'{name}={_wanted(given, rows[name], watching)}' for name in played if name in rows]
        arguments += ['--topics', ','.join(played), '--wait-subscribers', ','.join(waited), *_part(given, *span_ns)]
    start = LaunchedNode('replay', arguments, {**parameters, 'publish_clock': on(given, 'clock')})
    return _ObservedNode(start, given['frame_id'] or frame_id, seen)


def _part(given: Mapping[str, str], start_ns: int, end_ns: int) -> list[str]:
    """Return the options of ``replay`` for the part to play, in seconds from the bag's start. Raises InputError."""
    options = []
    for name, option in (('start_s', '--start'), ('stop_s', '--end')):
        if given[name]:
            t_ns = round(_number(given, name) * NS)
            if not start_ns <= t_ns <= end_ns:
                raise InputError(f'launch argument {name}:={given[name]}: the bag goes from {start_ns / NS:.9g} s to '
                                 f'{end_ns / NS:.9g} s; give a time in this range', field=name)
            options += [option, repr((t_ns - start_ns) / NS)]
    return options
