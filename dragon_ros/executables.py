"""Every executable of the package: one list for ``ros2 run dragon_ros NAME`` and ``python -m dragon_ros NAME``."""
from typing import NamedTuple


class Executable(NamedTuple):
    """Where the ``main(argv)`` of an executable is, and what it is for."""

    module: str
    help: str


EXECUTABLES = {
    'sim': Executable('dragon_ros.nodes.commands.sim', 'simulate a scene and publish it'),
    'monitor': Executable('dragon_ros.nodes.commands.monitor', 'watch a published dragon and report its contacts'),
    'record': Executable('dragon_ros.nodes.record', 'record the topics of a dragon as an MCAP bag'),
    'replay': Executable('dragon_ros.nodes.replay', 'publish a bag as it was recorded'),
    'table': Executable('dragon_ros.tools.table', 'print positions and velocities, without ROS'),
    'contact': Executable('dragon_ros.tools.contact', 'find the first contact of a scene, without ROS'),
    'design': Executable('dragon_ros.tools.design', 'answer a question about what to build'),
    'cost': Executable('dragon_ros.cost.command', 'measure what accuracy and effects cost'),
    'demo': Executable('dragon_ros.tools.demo', 'run everything once: sim, monitor, bag, replay, picture'),
}
