"""The command line of ``monitor``."""
from dragon_ros.nodes.executables import line
from dragon_ros.nodes.params import MONITOR, described


def main(argv: list[str]) -> int:
    """Run the monitor; return the exit code."""
    options = line.parser('monitor', 'Watch topics handles and benches, and publish each contact on collision. '
                          f'ROS parameters:\n{described(MONITOR)}',
                          'ros2 run dragon_ros monitor --ros-args -r __ns:=/other_dragon')
    arguments = line.parse(options, argv)
    from dragon_ros.nodes import monitor, shell
    return shell.run('monitor', argv, monitor.run, arguments.json)
