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

from dragon_ros.nodes.launch_plan import Plan, Start, plan

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
    DeclareLaunchArgument('frame_id', default_value='', description='frame of all messages; empty: as the namespace, '
                          'or that of the bag'),
    DeclareLaunchArgument('use_sim_time', default_value='false', choices=YES_NO, description='the sim or replay '
                          'publishes /clock, which the other nodes follow'),
    DeclareLaunchArgument('publish_tf', default_value='false', choices=YES_NO, description='head and tail on /tf'),
    DeclareLaunchArgument('monitor', default_value='true', choices=YES_NO, description='report contacts and clearance'),
    DeclareLaunchArgument('warn_below', default_value='0.02', description='clearance in m below which the monitor '
                          'warns'),
    DeclareLaunchArgument('clearance_vector', default_value='false', choices=YES_NO, description='publish the shortest '
                          'vector between the closest benches'),
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
    what = plan(given)
    nodes = {start.executable: node(what.namespace, start) for start in (*what.readers, what.source)}
    # A recorder ends by itself once the source has left and everything has been written.
    last = RegisterEventHandler(OnProcessExit(target_action=nodes[(what.recorder or what.source).executable], on_exit=[
        EmitEvent(event=Shutdown(reason='the run has ended'))]))
    return [*nodes.values(), last, *view(given, what)]


def node(namespace: str, start: Start) -> Node:
    """Return one executable of the package as a node."""
    return Node(package='dragon_ros', executable=start.executable, name=start.executable, namespace=namespace,
                output='screen', arguments=start.arguments, parameters=[start.parameters])


def view(given: dict[str, str], what: Plan) -> Iterator[Any]:
    """Yield RViz, or the reason why it is missing."""
    if given['rviz'] != 'true' or given['headless'] == 'true':
        return
    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError:
        yield LogInfo(msg='rviz2 is not installed, so nothing is shown; install it, or give headless:=true')
        return
    yield Node(package='rviz2', executable='rviz2', namespace=what.namespace, arguments=['-d', view_file(what)],
               parameters=[{'use_sim_time': given['use_sim_time'] == 'true'}])


def view_file(what: Plan) -> str:
    """Return the RViz configuration, a modified copy where namespace or frame are not /dragon and dragon."""
    share = Path(get_package_share_directory('dragon_ros'))
    path = share / 'msg_configs' / 'rviz' / 'dragon.rviz'
    text = path.read_text(encoding='utf-8')
    mine = text.replace('Value: /dragon/', f'Value: {what.namespace}/').replace(
        'Fixed Frame: dragon\n', f'Fixed Frame: {what.frame_id}\n')
    if mine == text:
        return str(path)
    handle, name = tempfile.mkstemp(prefix='dragon_', suffix='.rviz')
    with os.fdopen(handle, 'w', encoding='utf-8') as copy:
        copy.write(mine)
    return name
