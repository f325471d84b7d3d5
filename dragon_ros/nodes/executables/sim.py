"""The command line of ``sim``."""
from functools import partial

from dragon_ros.cli import command_line
from dragon_ros.nodes.executables import line
from dragon_ros.nodes.params import SIM, described


def main(argv: list[str]) -> int:
    """Run the simulator with command-line arguments; return the exit code."""
    options = line.parser('sim', f'Simulate a bench dragon and publish it. ROS parameters:\n{described(SIM)}\n'
                          'Services: ~/pause, ~/resume, ~/reset, ~/step, ~/seek (std_srvs/Trigger).',
                          'ros2 run dragon_ros sim --scene first_contact --ros-args -p time_scale:=2.0')
    command_line.add_scene_options(options)
    options.set_defaults(scene=None)
    arguments = line.parse(options, argv)
    from dragon_ros.nodes import shell, sim
    given = {'scene': arguments.scene, 'set': arguments.overrides, 'accuracy': arguments.accuracy}
    return shell.run('sim', argv, partial(sim.run, {name: value for name, value in given.items() if value}),
                     arguments.json)
