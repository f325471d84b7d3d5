"""The command lines of the nodes. They import ROS only after parsing the arguments, so that ``--help`` is fast."""
import argparse
import threading
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from dragon_ros.bags.write import COMPRESSIONS
from dragon_ros.cli import command_line
from dragon_ros.core.checks import number
from dragon_ros.core.errors import InputError
from dragon_ros.nodes.params import MONITOR, REPLAY, SIM, described


def sim(argv: list[str]) -> int:
    """Run the simulator; return the exit code."""
    options = _parser('sim', f'Simulate a bench dragon and publish it.\nROS parameters:\n{described(SIM)}\n'
                      'Services: ~/pause, ~/resume, ~/reset, ~/step, ~/seek (std_srvs/Trigger).',
                      'sim --scene first_contact --ros-args -p time_scale:=2.0')
    command_line.add_scene_options(options, None)
    arguments = _parse(options, argv)
    from dragon_ros.nodes import shell
    from dragon_ros.nodes.sim import run
    given = {'scene': arguments.scene, 'set': arguments.overrides, 'accuracy': arguments.accuracy}
    return shell.run('sim', argv, partial(run, {name: value for name, value in given.items() if value}),
                     arguments.json)


def monitor(argv: list[str]) -> int:
    """Run the monitor; return the exit code."""
    options = _parser('monitor', 'Watch the topics handles and benches, and publish each contact on the topic '
                      f'collision.\nROS parameters:\n{described(MONITOR)}',
                      'monitor --ros-args -r __ns:=/other_dragon')
    arguments = _parse(options, argv)
    from dragon_ros.nodes import shell
    from dragon_ros.nodes.monitor import run
    return shell.run('monitor', argv, run, arguments.json)


def record(argv: list[str]) -> int:
    """Run the recorder; return the exit code."""
    options = _parser('record', 'Record every topic of a dragon until its publisher leaves, or until SIGINT or '
                      'SIGTERM.\nExit codes: 0 the bag is complete, 3 ticks or messages are missing, 1 the disk '
                      'failed, 2 the input is invalid.', 'record --output run.mcap')
    options.add_argument('--output', type=Path, metavar='FILE.mcap|FOLDER', help='bag to write: one file, or a rosbag2 '
                         'directory (default: dragon_DATE_TIME.mcap)')
    options.add_argument('--keep-going', action='store_true', help='continue after the publisher leaves, until a '
                         'signal arrives')
    options.add_argument('--wait-monitor', action='store_true', help='subscribe to the topics of sim only after a '
                         'monitor has been found, so that a run that waits for this recorder (wait_subscribers) is '
                         'recorded with all its reports')
    options.add_argument('--force', action='store_true', help='replace an existing bag')
    _add_bag_options(options)
    options.add_argument('--trust', action='store_true', help='read scenes from the topic even if they exceed the '
                         'budgets for untrusted input (docs/limits.md)')
    options.add_argument('--flush-s', type=float, default=1.0, metavar='S', help='seconds of messages that may be lost '
                                                                                 'if the recorder is killed '
                                                                                 '(%(default)g)')
    options.add_argument('--queue-mb', type=float, default=256.0, metavar='MB',
                         help='maximum size of the write queue (%(default)g)')
    arguments = _parse(options, argv)
    from dragon_ros.nodes import shell
    return shell.run('record', argv, partial(_record, arguments), arguments.json)


def replay(argv: list[str]) -> int:
    """Replay a bag; return the exit code."""
    options = _parser('replay', 'Publish the messages of a bag on their topics, byte for byte, with the recorded '
                      f'timing.\nROS parameters:\n{described(REPLAY)}\n'
                      'Services: ~/pause, ~/resume, ~/reset, ~/step, ~/seek (std_srvs/Trigger). Keys: space pauses '
                      'and resumes,\ns steps, the arrows seek 5 s.',
                      'replay run.mcap --rate 2 --start 5')
    command_line.add_bag(options, 'MCAP file, or rosbag2 directory', required=True)
    options.add_argument('--rate', type=float, metavar='FACTOR',
                         help='speed factor (1); 0: as fast as the readers can follow')
    options.add_argument('--start', type=float, default=0.0, metavar='S',
                         help='seconds to skip at the start of the bag (%(default)g)')
    options.add_argument('--end', type=float, metavar='S', help='seconds from the start of the bag at which to stop '
                         '(default: its end)')
    options.add_argument('--loop', action='store_true', help='restart at the end')
    options.add_argument('--clock', action='store_true', help="publish the bag's time on /clock, unless the bag "
                         'contains /clock or another node publishes it')
    options.add_argument('--topics', type=_names, metavar='NAME,...', help='publish only these topics: full names or, '
                         'if the bag has only one dragon, names in its namespace, such as handles')
    options.add_argument('--into', metavar='NAMESPACE', help="publish the bag's dragon in this namespace (default: "
                         'as recorded)')
    options.add_argument('--wait-subscribers', type=_names, default=[], metavar='NAME=N,...',
                         help='start when each of these topics, named as for --topics, has N subscribers')
    arguments = _parse(options, argv)
    from dragon_ros.nodes import shell
    return shell.run('replay', argv, partial(_replay, arguments), arguments.json)


def _parser(name: str, text: str, example: str) -> argparse.ArgumentParser:
    """Return a parser with the option --json."""
    options = command_line.parser(name, text, example)
    options.add_argument('--json', action='store_true', help='write the log as JSON, one object per line')
    return options


def _parse(options: argparse.ArgumentParser, argv: list[str]) -> argparse.Namespace:
    """Parse all arguments except ROS's own (``--ros-args ...``); exit with code 2 if any is invalid."""
    if '--help' in argv or '-h' in argv:
        _help(options)
    from rclpy.utilities import remove_ros_args
    try:
        rest: list[str] = remove_ros_args([options.prog, *argv])[1:]
    except Exception as error:  # noqa: BLE001 - rcl raises its own types for invalid --ros-args
        options.exit(command_line.BAD_INPUT, f'{options.prog.removeprefix(command_line.program()).strip()}: '
                     f'{" ".join(str(error).split())}\n')
    return options.parse_args(rest)


def _help(options: argparse.ArgumentParser) -> NoReturn:
    options.print_help()
    options.exit(command_line.OK)


def _add_bag_options(options: argparse.ArgumentParser) -> None:
    """Add the options for writing a bag."""
    options.add_argument('--compression', choices=COMPRESSIONS, default='zstd',
                         help='compression of the chunks (%(default)s)')
    options.add_argument('--split-size-mb', type=float, metavar='MB', help='start a new file at this size')
    options.add_argument('--split-duration-s', type=float, metavar='S', help='start a new file after this much '
                         'simulation time')
    options.add_argument('--max-size-mb', type=float, metavar='MB', help='stop before the bag exceeds this size')
    options.add_argument('--fsync', action='store_true', help='sync each chunk to the disk before writing the next '
                         'one; this also protects against power cuts')


def _names(text: str) -> list[str]:
    return text.split(',')


def _record(arguments: argparse.Namespace, stop: threading.Event) -> int:
    from dragon_ros.bags.write.writer import BagOptions, BagWriter
    from dragon_ros.nodes.record import run
    flush_s = number('--flush-s', arguments.flush_s, low=0.01, high=3600)
    queue_mb = number('--queue-mb', arguments.queue_mb, low=1, high=1e5)
    path = arguments.output or Path(f'dragon_{datetime.now().astimezone():%Y%m%d_%H%M%S}.mcap')
    bag = BagWriter(path, arguments.force, BagOptions(
        arguments.compression, arguments.split_size_mb, arguments.split_duration_s, arguments.max_size_mb,
        arguments.fsync), threaded=False)        # because the recorder has its own writer thread
    return run(bag, arguments.keep_going, flush_s, queue_mb, arguments.trust, arguments.wait_monitor, stop)


def _replay(arguments: argparse.Namespace, stop: threading.Event) -> int:
    from dragon_ros.bags.read.reader import BagReader
    from dragon_ros.nodes.replay import Choice, run
    given: dict[str, Any] = {}
    if arguments.rate is not None:
        if not 0 <= arguments.rate <= 1e6:
            raise InputError(f'--rate {arguments.rate:g}: it must be between 0 (as fast as the readers can follow) '
                             'and 1e6')
        given['time_scale'] = arguments.rate
    if arguments.loop:
        given['at_end'] = 'loop'
    if arguments.clock:
        given['publish_clock'] = True
    with BagReader(arguments.bag) as bag:
        choice = Choice(arguments.start, arguments.end, arguments.topics, tuple(arguments.wait_subscribers),
                        arguments.into)
        return run(bag, choice, given, stop)
