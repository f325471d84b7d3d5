"""Every executable of the package: one list for ``ros2 run dragon_ros NAME`` and ``python -m dragon_ros NAME``."""
from typing import NamedTuple


class Executable(NamedTuple):
    """The module and the function ``f(argv) -> exit code`` of an executable, and what it is for."""

    module: str
    help: str
    function: str = 'main'


NODES = 'dragon_ros.nodes.command_lines'
_COMMANDS = 'dragon_ros.commands.command_lines'
EXECUTABLES = {
    'sim': Executable(NODES, 'simulate a scene and publish it', 'sim'),
    'monitor': Executable(NODES, 'watch a published dragon and report its contacts',
                          'monitor'),
    'record': Executable(NODES, 'record the topics of a dragon as an MCAP bag', 'record'),
    'replay': Executable(NODES, 'publish a bag as it was recorded', 'replay'),
    'table': Executable(_COMMANDS, 'print positions and velocities, without ROS', 'table'),
    'contact': Executable('dragon_ros.commands.contact', 'find the first contact of a scene, without ROS'),
    'inspect': Executable(_COMMANDS, 'show what is in a bag, check or repair it', 'inspect'),
    'export': Executable(_COMMANDS, 'write what is in a bag as CSV, Parquet or NumPy', 'export'),
    'simulate': Executable(_COMMANDS, 'write the bag of a scene, without ROS and faster than real time', 'simulate'),
    'plot': Executable('dragon_ros.commands.plot.command',
                       'draw a scene or a bag: dragon, contact, clearance, speeds, animation'),
    'urdf': Executable('dragon_ros.commands.urdf', 'write the dragon of a scene as a robot, without ROS'),
    'view': Executable('dragon_ros.commands.view.command', 'play a scene or a bag in the browser, without ROS'),
    'design': Executable('dragon_ros.commands.design', 'answer a question about what to build'),
    'plan': Executable(_COMMANDS, 'draw a scene to scale for print: swept area, gaps and times', 'plan'),
    'route': Executable(_COMMANDS, 'make the track of a scene from a drawing', 'route'),
    'study': Executable('dragon_ros.commands.study', 'vary a scene a thousand times or a million, and ask each'),
    'grade': Executable('dragon_ros.commands.grade.command',
                        'grade results of the contest, and say which mistake they look like'),
    'cost': Executable('dragon_ros.cost.command', 'measure what accuracy, effects, contact and bags cost here'),
    'demo': Executable(_COMMANDS, 'run everything once: sim, monitor, bag, replay, picture', 'demo'),
}
