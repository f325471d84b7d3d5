"""Every executable of the package, in one list for ``ros2 run dragon_ros NAME`` and ``python -m dragon_ros NAME``."""
from typing import NamedTuple

from dragon_ros.guests import installed


class Executable(NamedTuple):
    """An executable: its module, its function ``f(argv) -> exit code``, and its purpose, which is shown as help."""

    module: str
    help: str
    function: str = 'main'


NODES = 'dragon_ros.nodes.command_lines'
_COMMANDS = 'dragon_ros.commands.command_lines'
EXECUTABLES = {
    'sim': Executable(NODES, 'simulate a scene and publish it', 'sim'),
    'monitor': Executable(NODES, 'monitor a published dragon and report its contacts',
                          'monitor'),
    'record': Executable(NODES, 'record the topics of a dragon as an MCAP bag', 'record'),
    'replay': Executable(NODES, 'publish a bag with its original timing', 'replay'),
    'table': Executable('dragon_ros.commands.table', 'print positions and velocities, without ROS'),
    'contact': Executable('dragon_ros.commands.contact', 'find the first contact of a scene, without ROS'),
    'inspect': Executable('dragon_ros.commands.inspect', 'summarise, check or repair a bag'),
    'export': Executable('dragon_ros.commands.export', 'export a bag as CSV, Parquet or NumPy arrays'),
    'simulate': Executable('dragon_ros.commands.simulate',
                           'write the bag of a scene, without ROS and faster than real time'),
    'plot': Executable('dragon_ros.commands.plot',
                       'draw a scene or a bag: dragon, contact, clearance, speeds, animation'),
    'urdf': Executable('dragon_ros.commands.urdf', 'write the dragon of a scene as a URDF robot, without ROS'),
    'view': Executable('dragon_ros.commands.view.command', 'play a scene or a bag in the browser, without ROS'),
    'design': Executable('dragon_ros.commands.design', 'answer design questions: turn, speed, pitch, room'),
    'plan': Executable(_COMMANDS, 'draw a scene to scale for printing: swept area, gaps and times', 'plan'),
    'route': Executable(_COMMANDS, 'make a scene whose track follows a drawing', 'route'),
    'cost': Executable('dragon_ros.cost.command', 'measure the cost of accuracy, effects, contact and bags'),
    'demo': Executable('dragon_ros.commands.demo', 'run everything once: sim, monitor, bag, replay, picture'),
    **{name: Executable(*guest) for name, guest in installed().items() if ' ' not in name},
}
