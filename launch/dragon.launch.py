"""Launch a dragon: a sim or the replay of a bag, a monitor, and optionally a recorder and RViz.

Several dragons can run side by side, each with its own namespace and frame_id.
"""
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch_ros.actions import Node

from dragon_ros.core.errors import DragonError
from dragon_ros.messages.channels import live
from dragon_ros.scenes.load import load_scene

YES_NO = ['true', 'false']
ARGUMENTS = (
    DeclareLaunchArgument('scene', default_value='winding', description='scene: a name, or a .yaml file'),
    DeclareLaunchArgument('accuracy', default_value='', description='largest position error: metres or a tier; empty: '
                          'that of the scene'),
    DeclareLaunchArgument('rate', default_value='', description='ticks per second of simulation; empty: that '
                          'of the scene'),
    DeclareLaunchArgument('time_scale', default_value='1.0', description='seconds of simulation per second, also '
                          'of a replay; 0: as fast as the readers follow'),
    DeclareLaunchArgument('at_end', default_value='hold', choices=['stop', 'hold', 'loop'], description='at the end of '
                          'the run: stop (everything), hold (the sim stays for control) or loop'),
    DeclareLaunchArgument('on_contact', default_value='continue', choices=['continue', 'hold', 'stop'],
                          description='at the first contact: continue, hold or stop there'),
    DeclareLaunchArgument('namespace', default_value='dragon', description='namespace of all nodes and topics'),
    DeclareLaunchArgument('frame_id', default_value='', description='frame of all messages; empty: as the namespace'),
    DeclareLaunchArgument('use_sim_time', default_value='false', choices=YES_NO, description='the sim publishes '
                          '/clock, which the other nodes follow'),
    DeclareLaunchArgument('publish_tf', default_value='false', choices=YES_NO, description='head and tail on /tf'),
    DeclareLaunchArgument('monitor', default_value='true', choices=YES_NO, description='report contacts and clearance'),
    DeclareLaunchArgument('warn_below', default_value='0.02', description='clearance in m below which the monitor '
                          'warns'),
    DeclareLaunchArgument('record', default_value='', description='bag to write (.mcap); empty: none'),
    DeclareLaunchArgument('replay', default_value='', description='bag to replay in place of a sim; empty: none'),
    DeclareLaunchArgument('rviz', default_value='true', choices=YES_NO, description='show it in RViz'),
    DeclareLaunchArgument('headless', default_value='false', choices=YES_NO, description='open no window, even '
                          'with rviz:=true'),
    DeclareLaunchArgument('json', default_value='false', choices=YES_NO, description='log as JSON, for machines'),
)


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the actions that follow from them."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=actions)])


def actions(context: LaunchContext) -> list[Any]:
    """Return the actions for the given arguments."""
    given = {argument.name: context.launch_configurations[argument.name] for argument in ARGUMENTS}
    given['namespace'] = '/' + given['namespace'].strip('/')
    given['frame_id'] = given['frame_id'] or given['namespace'].strip('/').replace('/', '_')
    source = replay(given) if given['replay'] else sim(given)
    recorder = [node(given, 'record', ['--output', given['record']])] if given['record'] else []
    watch = [node(given, 'monitor', [], warn_below_m=float(given['warn_below']))] if on(given, 'monitor') else []
    # A recorder ends by itself once the source has left and everything has been written.
    last = RegisterEventHandler(OnProcessExit(target_action=[*recorder, source][0], on_exit=[EmitEvent(
        event=Shutdown(reason='the run has ended'))]))
    return [*watch, *recorder, source, last, *view(given)]


def on(given: dict[str, str], name: str) -> bool:
    """Return whether a yes-or-no argument is on."""
    return given[name] == 'true'


def node(given: dict[str, str], name: str, arguments: list[str], **parameters: Any) -> Node:
    """Return one executable of the package as a node."""
    return Node(package='dragon_ros', executable=name, name=name, namespace=given['namespace'], output='screen',
                arguments=[*arguments, *(['--json'] if on(given, 'json') else [])],
                parameters=[{'use_sim_time': on(given, 'use_sim_time'), **parameters}])


def sim(given: dict[str, str]) -> Node:
    """Return the simulator; it starts when the monitor and the recorder have subscribed."""
    optional: dict[str, Any] = {'rate_hz': float(given['rate'])} if given['rate'] else {}
    return node(given, 'sim', [], scene=given['scene'], accuracy=given['accuracy'], at_end=given['at_end'],
                time_scale=float(given['time_scale']), on_contact=given['on_contact'], frame_id=given['frame_id'],
                publish_clock=on(given, 'use_sim_time'), publish_tf=on(given, 'publish_tf'),
                wait_subscribers=readers(given), **optional)


def readers(given: dict[str, str]) -> list[str]:
    """Return how many subscribers each topic of the scene will have."""
    try:
        topics = [channel.name for channel in live(load_scene(given['scene']).effects)]
    except DragonError:
        return ['']     # the sim reports what is wrong with the scene
    watched = {'handles', 'benches'} if on(given, 'monitor') else set()
    return [f'{name}={(name in watched) + bool(given["record"])}' for name in topics]


def replay(given: dict[str, str]) -> Node:
    """Return the replay of a bag."""
    again = ['--loop'] if given['at_end'] == 'loop' else []
    return node(given, 'replay', [given['replay'], '--rate', given['time_scale'], *again])


def view(given: dict[str, str]) -> Iterator[Any]:
    """Yield RViz, or the reason why it is missing."""
    if not on(given, 'rviz') or on(given, 'headless'):
        return
    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError:
        yield LogInfo(msg='rviz2 is not installed, so nothing is shown; install it, or give headless:=true')
        return
    yield Node(package='rviz2', executable='rviz2', namespace=given['namespace'], arguments=['-d', view_file(given)],
               parameters=[{'use_sim_time': on(given, 'use_sim_time')}])


def view_file(given: dict[str, str]) -> str:
    """Return the RViz configuration, a modified copy where namespace or frame are not /dragon and dragon."""
    share = Path(get_package_share_directory('dragon_ros'))
    path = share / 'msg_configs' / 'rviz' / 'dragon.rviz'
    text = path.read_text(encoding='utf-8')
    mine = text.replace('Value: /dragon/', f'Value: {given["namespace"]}/').replace(
        'Fixed Frame: dragon\n', f'Fixed Frame: {given["frame_id"]}\n')
    if mine == text:
        return str(path)
    handle, name = tempfile.mkstemp(prefix='dragon_', suffix='.rviz')
    with os.fdopen(handle, 'w', encoding='utf-8') as copy:
        copy.write(mine)
    return name
