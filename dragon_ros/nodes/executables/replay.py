"""The command line of ``replay``."""
import argparse
import threading
from functools import partial
from pathlib import Path
from typing import Any

from dragon_ros.core.errors import InputError
from dragon_ros.nodes.executables import line
from dragon_ros.nodes.params import REPLAY, described


def main(argv: list[str]) -> int:
    """Replay a bag; return the exit code."""
    options = line.parser('replay', 'Publish the messages of a bag on their topics again, byte for byte, at the '
                          f'recorded spacing.\nROS parameters:\n{described(REPLAY)}\n'
                          'Services: ~/pause, ~/resume, ~/reset, ~/step, ~/seek (std_srvs/Trigger). Keys: space pauses '
                          'and goes on,\ns steps, the arrows seek 5 s.',
                          'ros2 run dragon_ros replay run.mcap --rate 2 --start 5')
    options.add_argument('bag', type=Path, metavar='BAG', help='MCAP file, or rosbag2 directory')
    options.add_argument('--rate', type=float, metavar='FACTOR',
                         help='speed factor; 0 is as fast as the readers follow (1)')
    options.add_argument('--start', type=float, default=0.0, metavar='S', help='seconds of the bag to leave out (0)')
    options.add_argument('--end', type=float, metavar='S', help='second of the bag to end at (its end)')
    options.add_argument('--loop', action='store_true', help='start again at the end')
    options.add_argument('--clock', action='store_true', help='publish the time of the bag on /clock')
    options.add_argument('--topics', type=_names, metavar='NAME,...', help='publish only these topics (full names)')
    options.add_argument('--wait-subscribers', type=_names, default=[], metavar='NAME=N,...',
                         help='start when topics have so many subscribers')
    arguments = line.parse(options, argv)
    from dragon_ros.nodes import shell
    return shell.run('replay', argv, partial(_run, arguments), arguments.json)


def _names(text: str) -> list[str]:
    return text.split(',')


def _run(arguments: argparse.Namespace, stop: threading.Event) -> int:
    from dragon_ros.bags.read.reader import LogReader
    from dragon_ros.nodes import replay
    given: dict[str, Any] = {}
    if arguments.rate is not None:
        if not 0 <= arguments.rate <= 1e6:
            raise InputError(f'--rate {arguments.rate:g}: must lie between 0 (as fast as possible) and 1e6')
        given['time_scale'] = arguments.rate
    if arguments.loop:
        given['at_end'] = 'loop'
    if arguments.clock:
        given['publish_clock'] = True
    with LogReader(arguments.bag) as bag:
        choice = replay.Choice(arguments.start, arguments.end, arguments.topics, tuple(arguments.wait_subscribers))
        return replay.run(bag, choice, given, stop)
