"""Launch two dragons with a monitor and a layout each: /red/dragon and /blue/dragon, each with its own /tf."""
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import PushRosNamespace, SetRemap

DRAGON = Path(get_package_share_directory('dragon_ros')) / 'launch' / 'dragon.launch.py'


def dragon(robot: str, clock: str) -> GroupAction:
    """Return a dragon in the namespace of a robot; one of them publishes the clock."""
    return GroupAction([
        PushRosNamespace(robot), SetRemap('/tf', 'tf'), SetRemap('/tf_static', 'tf_static'),
        IncludeLaunchDescription(PythonLaunchDescriptionSource(str(DRAGON)), launch_arguments={
            'clock': clock, 'publish_tf': LaunchConfiguration('publish_tf')}.items())])


def generate_launch_description() -> LaunchDescription:
    """Return both dragons."""
    return LaunchDescription([DeclareLaunchArgument('publish_tf', default_value='true'),
                              dragon('red', 'true'), dragon('blue', 'false')])
