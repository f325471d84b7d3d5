"""Launch a dragon: a sim or the replay of a bag, a monitor, and optionally a recorder and RViz.

Several dragons can run side by side, each with its own namespace and frame_id. The launch fails if a node fails.
"""
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.events.process import ProcessExited
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from dragon_ros.core.errors import DragonError
from dragon_ros.nodes.launch_plan import ARGUMENTS, LaunchedNode, LaunchPlan, misspelt, on, plan


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, and the actions that depend on them."""
    return LaunchDescription([
        *(DeclareLaunchArgument(one.name, default_value=one.default, description=one.text, choices=one.choices or None)
          for one in ARGUMENTS), OpaqueFunction(function=actions)])


def actions(context: LaunchContext) -> list[Any]:
    """Return the actions for the given arguments."""
    given = {one.name: context.launch_configurations[one.name] for one in ARGUMENTS}
    what = plan(given, context.launch_configurations.get('ros_namespace', ''))
    ignored = misspelt(context.launch_configurations)
    again = {'monitor'} if on(given, 'respawn') else set()
    nodes = {start.executable: node(what.namespace, start, start.executable in again)
             for start in (*what.readers, what.source)}
    # A recorder exits by itself once the source is gone and everything has been written.
    last = RegisterEventHandler(OnProcessExit(target_action=nodes[(what.recorder or what.source).executable], on_exit=[
        EmitEvent(event=Shutdown(reason='the run has ended'))]))
    faults = [RegisterEventHandler(OnProcessExit(target_action=one, on_exit=fail)) for name, one in nodes.items()
              if name not in again]
    notes = [LogInfo(msg=note) for note in (*ignored, *what.notes)]
    return [*notes, *faults, last, *nodes.values(), *view(given, what)]


def fail(event: ProcessExited, _: LaunchContext) -> None:
    """Raise an exception if a node ended with an error, so that the launch ends and returns 1."""
    if event.returncode:
        raise DragonError(f'{event.process_name} ended with exit code {event.returncode}; see its output')


def node(namespace: str, start: LaunchedNode, respawn: bool) -> Node:
    """Return one executable of the package as a node."""
    # Launch would read a text such as 0.001 as a number.
    parameters: list[Any] = [{name: ParameterValue(value, value_type=str) if isinstance(value, str) else value
                              for name, value in start.parameters.items()}]
    if start.file:
        parameters += [start.file, *([written(start)] if start.asked else [])]
    return Node(package='dragon_ros', executable=start.executable, name=start.executable, namespace=namespace,
                output='screen', arguments=start.arguments, parameters=parameters, respawn=respawn, respawn_delay=2.0)


def written(start: LaunchedNode) -> str:
    """Write the parameters given as launch arguments to a file, under /**, and return its name.

    This file takes precedence over all others.
    """
    handle, name = tempfile.mkstemp(prefix='dragon_', suffix='.yaml')
    with os.fdopen(handle, 'w', encoding='utf-8') as file:
        yaml.safe_dump({'/**': {'ros__parameters': {key: start.parameters[key] for key in sorted(start.asked)}}}, file)
    return name


def view(given: dict[str, str], what: LaunchPlan) -> Iterator[Any]:
    """Yield RViz, or a message if it is not installed."""
    if not on(given, 'rviz') or on(given, 'headless'):
        return
    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError:
        yield LogInfo(msg='rviz2 is not installed, so nothing is shown; install it, or give headless:=true')
        return
    yield Node(package='rviz2', executable='rviz2', namespace=what.namespace, arguments=['-d', view_file(what)],
               parameters=[{'use_sim_time': on(given, 'use_sim_time')}])


def view_file(what: LaunchPlan) -> str:
    """Return the RViz configuration, or a modified copy if the namespace is not /dragon or the frame is not dragon."""
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
