"""What ``dragon.launch.py`` starts for its arguments, without the launch library: executables and their parameters."""
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dragon_ros.bags.read.frames import FRAME_ID, frame_of_bag, namespace_of
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.errors import DragonError, InputError
from dragon_ros.messages.channels import Channel, channels, live
from dragon_ros.nodes.params import DISCOVERY_S
from dragon_ros.scenes.load import load_scene

_WATCHED = ('handles', 'benches')


@dataclass(frozen=True)
class Start:
    """One executable of the package, with its arguments and ROS parameters."""

    executable: str
    arguments: list[str] = field(default_factory=list)
    parameters: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """What is started: the readers (the recorder last), then the source; and namespace and frame of the dragon."""

    namespace: str
    frame_id: str
    readers: list[Start]
    source: Start

    @property
    def recorder(self) -> Start | None:
        """The recorder, if there is one."""
        return next((one for one in self.readers if one.executable == 'record'), None)


def plan(given: Mapping[str, str]) -> Plan:
    """Return what to start for the arguments of the launch file, all as text. Raises InputError that names one."""
    namespace = '/' + given['namespace'].strip('/')
    frame_id = given['frame_id'] or namespace.strip('/').replace('/', '_')
    watch = {'clearance_vector': _on(given, 'clearance_vector'), 'warn_below_m': _number(given, 'warn_below')}
    readers = [Start('monitor', [], watch)] if _on(given, 'monitor') else []
    readers += [Start('record', ['--output', given['record']])] if given['record'] else []
    if given['replay']:
        found = _replay(given, namespace)
        source, frame_id = found[0], given['frame_id'] or found[1]
    else:
        source = _sim(given, frame_id)
    finish = [_common(given, one) for one in (*readers, source)]
    return Plan(namespace, frame_id, finish[:-1], finish[-1])


def _common(given: Mapping[str, str], one: Start) -> Start:
    """Add what all nodes have."""
    return replace(one, arguments=[*one.arguments, *(['--json'] if _on(given, 'json') else [])],
                   parameters={'use_sim_time': _on(given, 'use_sim_time'), **one.parameters})


def _on(given: Mapping[str, str], name: str) -> bool:
    """Return whether a yes-or-no argument is on."""
    return given[name] == 'true'


def _number(given: Mapping[str, str], name: str) -> float:
    """Return an argument as a number. Raises InputError."""
    try:
        return float(given[name])
    except ValueError:
        raise InputError(f'launch argument {name}:={given[name]}: is not a number; write for example {name}:=1.0',
                         field=name) from None


def _wanted(given: Mapping[str, str], row: Channel) -> int:
    """Return how many subscribers a topic will have."""
    return (_on(given, 'monitor') and row.name in _WATCHED) + bool(given['record'])


def _sim(given: Mapping[str, str], frame_id: str) -> Start:
    """Return the simulator.

    It starts when the monitor and the recorder have subscribed, and all had time to find each other: a recorder takes
    what the monitor says, and somebody else may record too.
    """
    optional = {'rate_hz': _number(given, 'rate')} if given['rate'] else {}
    try:
        topics = live(load_scene(given['scene']).effects)
    except DragonError:
        topics = []     # the sim says what is wrong with the scene
    return Start('sim', [], {
        'scene': given['scene'], 'accuracy': given['accuracy'], 'at_end': given['at_end'],
        'time_scale': _number(given, 'time_scale'), 'on_contact': given['on_contact'], 'frame_id': frame_id,
        'publish_clock': _on(given, 'use_sim_time'), 'publish_tf': _on(given, 'publish_tf'),
        'wait_subscribers': [f'{row.name}={_wanted(given, row)}' for row in topics] or [''],
        'discovery_s': DISCOVERY_S, **optional})


def _replay(given: Mapping[str, str], namespace: str) -> tuple[Start, str]:
    """Return the replay of a bag in a namespace, and the frame of its messages.

    What a monitor reported is left out where a monitor runs: each topic has one publisher.
    """
    parameters = {'time_scale': _number(given, 'time_scale'), 'at_end': given['at_end'],
                  'discovery_s': DISCOVERY_S}
    arguments, clock, frame_id = [given['replay'], '--into', namespace], _on(given, 'use_sim_time'), FRAME_ID
    try:
        with BagReader(Path(given['replay'])) as bag:
            root, names = namespace_of(bag), [topic.name for topic in bag.topics if topic.messages]
            frame_id = frame_of_bag(bag, root)
    except DragonError:
        pass                # the replay says what is wrong with the bag
    else:
        rows = {name if name.startswith('/') else f'{root}/{name}': row for name, row in channels().items()}
        played = [name for name in names if not (_on(given, 'monitor') and name in rows
                                                 and rows[name].publisher == 'monitor')]
        waited = [f'{name}={_wanted(given, rows[name])}' for name in played if name in rows]
        arguments += ['--topics', ','.join(played), '--wait-subscribers', ','.join(waited)]
        clock = clock and '/clock' not in names
    return Start('replay', arguments, {**parameters, 'publish_clock': clock}), frame_id
