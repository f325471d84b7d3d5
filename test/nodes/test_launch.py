"""``dragon.launch.py`` works with the ROS 2 launch package, which has no wheel: these tests need a ROS 2 install."""
import os
import sys
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('launch_ros', reason='launch_ros comes with ROS 2, not from PyPI')

from geometry_msgs.msg import PoseArray
from processes import Process, Started
from rcl_interfaces.srv import GetParameters

from dragon_ros.bags.read.reader import BagReader

ROOT = Path(__file__).parents[2]
LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
service = LaunchService()
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(
    PythonLaunchDescriptionSource(sys.argv[1]), launch_arguments=[one.split(':=', 1) for one in sys.argv[2:]])]))
sys.exit(service.run())
"""
PUSHED = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import PushRosNamespace
service = LaunchService()
service.include_launch_description(LaunchDescription([GroupAction([PushRosNamespace(robot), IncludeLaunchDescription(
    PythonLaunchDescriptionSource(sys.argv[1]), launch_arguments=[one.split(':=', 1) for one in sys.argv[2:]])])
    for robot in ('one', 'two')]))
sys.exit(service.run())
"""
STAND_IN = '#!/bin/sh\necho "rviz2 runs with $*"\ncat "$2"\nexec sleep 1000\n'


@pytest.fixture
def prefix(tmp_path):
    """An install prefix with the package, as colcon or pip would create it."""
    index, share, lib = 'share/ament_index/resource_index/packages', 'share/dragon_ros', 'lib'
    for folder in (index, share, lib):
        (tmp_path / 'prefix' / folder).mkdir(parents=True)
    (tmp_path / 'prefix' / index / 'dragon_ros').touch()
    (tmp_path / 'prefix' / lib / 'dragon_ros').symlink_to(ROOT / 'scripts')
    for name in ('launch', 'msg_configs'):
        (tmp_path / 'prefix' / share / name).symlink_to(ROOT / name)
    return tmp_path / 'prefix'


@pytest.fixture
def launch(domain, prefix, tmp_path):
    """A function that launches the nodes with arguments; everything that it launches ends with the test."""
    running = []
    search = os.pathsep.join([str(prefix), *filter(None, [os.environ.get('AMENT_PREFIX_PATH')])])
    environment = {**os.environ, 'AMENT_PREFIX_PATH': search, 'ROS_LOG_DIR': str(tmp_path / 'log'),
                   'PYTHONUNBUFFERED': '1', 'OVERRIDE_LAUNCH_PROCESS_OUTPUT': 'screen',
                   'PYTHONPATH': os.pathsep.join([str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])]),
                   'PATH': os.pathsep.join([str(Path(sys.executable).parent), os.environ['PATH']])}

    def run(*arguments, program=LAUNCH, file=ROOT / 'launch' / 'dragon.launch.py'):
        command = [sys.executable, '-c', program, str(file), *arguments]
        running.append(Process(Started(command, environment, tmp_path)))
        return running[-1]
    yield run
    for process in running:
        if process.running:
            process.stop()
        process.kill()


def parameter(node, name, key):
    client = node.create_client(GetParameters, f'{name}/get_parameters')
    node.until(client.service_is_ready)
    future = client.call_async(GetParameters.Request(names=[key]))
    node.until(future.done)
    return future.result().values[0]


def heard(node, topic):
    frames = []
    node.create_subscription(PoseArray, topic, lambda message: frames.append(message.header.frame_id), 1000)
    return frames


def test_a_recorded_run_ends_by_itself_when_all_is_written(launch, tmp_path):
    run = launch('scene:=first_contact', 'time_scale:=10', 'at_end:=stop', 'record:=run.mcap', 'headless:=true')
    assert run.end() == 0, run.text
    assert 'contact of benches 0 and 8 at 412.47383' in run.text
    with BagReader(tmp_path / 'run.mcap') as bag:
        counts = {topic.name: topic.messages for topic in bag.topics}
    assert [counts[f'/dragon/{name}'] for name in ('handles', 'benches', 'velocities', 'collision')] == [651] * 3 + [1]


def test_dragons_stand_side_by_side_by_namespace(launch, node):
    launch('namespace:=red', 'headless:=true')
    launch('namespace:=far/blue', 'headless:=true', 'frame_id:=sea')
    red, blue = heard(node, '/red/handles'), heard(node, '/far/blue/handles')
    node.until(lambda: red and blue)
    assert (red[0], blue[0]) == ('red', 'sea')
    names = {f'{space}/{name}' for name, space in node.get_node_names_and_namespaces()}
    assert {'/red/sim', '/red/monitor', '/far/blue/sim', '/far/blue/monitor'} <= names


def test_each_argument_of_the_run_reaches_the_node_that_it_is_for(launch, node):
    launch('scene:=first_contact', 'rate:=10', 'time_scale:=2', 'accuracy:=fine', 'use_sim_time:=true',
           'on_contact:=stop', 'warn_below:=0.1', 'headless:=true')
    values = {'scene': 'first_contact', 'accuracy': 'fine', 'at_end': 'stop', 'on_contact': 'stop',
              'frame_id': 'dragon'}
    assert {key: parameter(node, '/dragon/sim', key).string_value for key in values} == values
    assert parameter(node, '/dragon/sim', 'rate_hz').double_value == 10
    assert parameter(node, '/dragon/sim', 'time_scale').double_value == 2
    assert parameter(node, '/dragon/monitor', 'warn_below_m').double_value == 0.1
    assert parameter(node, '/dragon/monitor', 'use_sim_time').bool_value
    assert parameter(node, '/dragon/sim', 'publish_clock').bool_value


@pytest.mark.parametrize('whose', ['/**', '/dragon/sim', '/**/sim'])
def test_a_file_of_parameters_yields_to_arguments_alone(launch, node, tmp_path, whose):
    (tmp_path / 'mine.yaml').write_text(f'{whose}: {{ros__parameters: {{rate_hz: 5.0, time_scale: 3.0}}}}\n')
    launch('params_file:=mine.yaml', 'rate:=10', 'headless:=true', 'monitor:=false', 'discovery_s:=0')
    assert parameter(node, '/dragon/sim', 'rate_hz').double_value == 10
    assert parameter(node, '/dragon/sim', 'time_scale').double_value == 3
    assert parameter(node, '/dragon/sim', 'at_end').string_value == 'hold'


def test_a_run_that_stops_at_its_contact_ends_the_launch_with_0(launch):
    run = launch('scene:=first_contact', 'start_s:=412.3', 'on_contact:=stop', 'headless:=true', 'discovery_s:=0')
    assert run.end() == 0, run.text
    assert 'saw 10 ticks' in run.text


def test_without_benches_no_monitor_is_started_and_that_is_said(launch):
    run = launch('scene:=minimal', 'stop_s:=0.1', 'at_end:=stop', 'headless:=true', 'discovery_s:=0')
    assert run.end() == 0, run.text
    assert 'no monitor is started' in run.text
    assert 'WARN' not in run.text


def test_a_launch_fails_where_a_node_does(launch, node):
    run = launch('headless:=true', 'discovery_s:=0')
    run.wait_for('starting at 0.000 s')
    (process,) = [one for one in psutil.Process(run.pid).children(recursive=True) if 'monitor' in one.cmdline()[1]]
    process.kill()
    assert run.end() == 1, run.text
    assert 'ended with exit code -9' in run.text
    assert 'saw' not in run.text


def test_a_bag_is_replayed_in_place_of_a_sim(launch, tmp_path):
    assert launch('scene:=first_contact', 'time_scale:=10', 'at_end:=stop', 'record:=run.mcap', 'headless:=true',
                  'monitor:=false').end() == 0
    again = launch('replay:=run.mcap', 'time_scale:=10', 'at_end:=stop', 'headless:=true', 'json:=true')
    assert again.end() == 0, again.text
    assert '"message": "contact of benches 0 and 8 at 412.47383' in again.text
    assert 'sim-' not in again.text


def test_a_recording_with_its_monitor_is_replayed_whole_in_another_namespace(launch, node, tmp_path):
    assert launch('scene:=first_contact', 'time_scale:=10', 'at_end:=stop', 'record:=run.mcap',
                  'headless:=true').end() == 0
    again = launch('replay:=run.mcap', 'namespace:=red', 'time_scale:=10', 'use_sim_time:=true', 'headless:=true')
    again.wait_for('contact of benches 0 and 8 at 412.47383')
    assert node.count_publishers('/red/clearance') == node.count_publishers('/red/collision') == 1
    assert node.count_publishers('/dragon/handles') == 0
    assert parameter(node, '/red/replay', 'publish_clock').bool_value
    again.stop()
    assert 'saw 651 ticks' in again.text


@pytest.mark.parametrize(('arguments', 'shown'), [
    ([], True), (['rviz:=false'], False), (['headless:=true'], False), (['headless:=true', 'rviz:=true'], False)])
def test_rviz_shows_the_topics_of_the_namespace_unless_headless(launch, prefix, arguments, shown):
    (prefix / 'share/ament_index/resource_index/packages/rviz2').touch()
    (prefix / 'lib/rviz2').mkdir()
    (prefix / 'lib/rviz2/rviz2').write_text(STAND_IN)
    (prefix / 'lib/rviz2/rviz2').chmod(0o755)
    run = launch('namespace:=red', *arguments)
    if shown:
        run.wait_for('Fixed Frame: red')
        run.wait_for('Value: /red/collision/markers')
    run.wait_for('starting at 0.000 s')
    assert ('rviz2 runs' in run.text) == shown
    assert '/dragon/' not in run.text.replace(str(prefix), '')


def test_without_rviz_it_says_so_and_runs(launch):
    run = launch()
    run.wait_for('rviz2 is not installed')
    run.wait_for('starting at 0.000 s')


@pytest.mark.parametrize(('argument', 'says'), [('scene:=windin', 'the scenes are first_contact'),
                                                ('rate:=0', 'run.rate_hz'),
                                                ('time_scale:=abc', 'launch argument time_scale:=abc'),
                                                ('at_end:=never', '"never" is not valid')])
def test_what_cannot_be_ends_everything_with_the_reason(launch, argument, says):
    run = launch(argument, 'headless:=true')
    assert run.end() == 1
    assert says in run.text


def test_two_robots_push_namespaces_around_the_launch_file(launch, node):
    launched = launch('headless:=True', 'scen:=minimal', program=PUSHED)
    for robot in ('one', 'two'):
        node.until(lambda robot=robot: node.count_publishers(f'/{robot}/dragon/handles') == 1)
        node.until(lambda robot=robot: node.count_publishers(f'/{robot}/dragon/clearance') == 1)
    assert node.count_publishers('/dragon/handles') == 0
    launched.wait_for('launch argument scen is not known and is ignored; did you mean scene?')
    launched.stop()


def test_the_example_of_two_dragons_has_a_monitor_and_a_layout_each_and_one_clock(launch, node, prefix):
    (prefix / 'share/ament_index/resource_index/packages/rviz2').touch()
    (prefix / 'lib/rviz2').mkdir()
    (prefix / 'lib/rviz2/rviz2').write_text(STAND_IN)
    (prefix / 'lib/rviz2/rviz2').chmod(0o755)
    has_tf = find_spec('tf2_msgs') is not None
    launched = launch(f'publish_tf:={str(has_tf).lower()}', file=ROOT / 'docs' / 'examples' / 'two_dragons.launch.py')
    for robot in ('red', 'blue'):
        for topic in ('handles', 'clearance/stamped', *(['tf'] if has_tf else [])):
            node.until(lambda topic=topic, robot=robot: node.count_publishers(f'/{robot}/dragon/{topic}') == 1)
        launched.wait_for(f'Fixed Frame: {robot}_dragon')
        launched.wait_for(f'Value: /{robot}/dragon/collision/markers')
    node.until(lambda: node.count_publishers('/clock') == 1)
    assert [one.node_namespace for one in node.get_publishers_info_by_topic('/clock')] == ['/red/dragon']
    assert node.count_publishers('/tf') == 0
    launched.stop()


INCLUDED = """
launch:
- include:
    file: "$(find-pkg-share dragon_ros)/launch/dragon.launch.py"
    arg: [{name: namespace, value: yellow}, {name: headless, value: "true"}, {name: params_file, value: nav.yaml}]
"""
YAML = """
import sys
import launch_ros.actions, launch_ros.substitutions
from launch import LaunchService
from launch_yaml import Parser
entity, parser = Parser.load(sys.argv[1])
service = LaunchService()
service.include_launch_description(parser.parse_description(entity))
sys.exit(service.run())
"""


def test_a_launch_file_in_yaml_includes_a_dragon_with_a_file_of_parameters_in_the_style_of_nav2(launch, node, tmp_path):
    pytest.importorskip('launch_yaml', reason='launch_yaml comes with ROS 2, not from PyPI')
    (tmp_path / 'nav.yaml').write_text(
        '/**:\n  ros__parameters: {use_sim_time: true}\n/**/sim:\n  ros__parameters: {rate_hz: 20.0}\n')
    (tmp_path / 'one.launch.yaml').write_text(INCLUDED)
    run = launch(file=tmp_path / 'one.launch.yaml', program=YAML)
    run.wait_for('starting at 0.000 s')
    assert parameter(node, '/yellow/sim', 'rate_hz').double_value == 20
    assert parameter(node, '/yellow/sim', 'use_sim_time').bool_value
    assert parameter(node, '/yellow/monitor', 'use_sim_time').bool_value


def test_a_monitor_respawns_if_asked_to(launch, node):
    run = launch('headless:=true', 'discovery_s:=0', 'respawn:=True')
    run.wait_for('starting at 0.000 s')
    node.until(lambda: node.count_publishers('/dragon/clearance') == 1)

    def monitors():
        return [one for one in psutil.Process(run.pid).children(recursive=True)
                if ''.join(one.cmdline()[1:2]).endswith('/monitor')]
    (process,) = monitors()
    process.kill()
    run.wait_for('process has died')
    node.until(lambda: monitors() and monitors()[0].pid != process.pid)
    assert run.running
    run.stop()
