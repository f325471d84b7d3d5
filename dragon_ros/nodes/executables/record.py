"""The command line of ``record``."""
import argparse
import threading
from datetime import datetime
from functools import partial
from pathlib import Path

from dragon_ros.core.checks import number
from dragon_ros.nodes.executables import line


def main(argv: list[str]) -> int:
    """Run the recorder; return the exit code."""
    options = line.parser('record', 'Record every topic of a dragon until its publisher leaves (or SIGINT, SIGTERM).\n'
                          'Exit codes: 0 all is in the bag, 3 ticks or messages are missing in it, 1 the disk failed, '
                          '2 bad input.', 'ros2 run dragon_ros record --output run.mcap')
    options.add_argument('--output', type=Path, metavar='FILE.mcap|FOLDER', help='bag to write: one file, or a rosbag2 '
                         'directory (dragon_DATE_TIME.mcap)')
    options.add_argument('--keep-going', action='store_true', help='go on when the publisher leaves, until a signal')
    options.add_argument('--force', action='store_true', help='replace an existing bag')
    add_bag_options(options)
    options.add_argument('--flush-s', type=float, default=1.0, metavar='S', help='a recorder that is killed loses no '
                         'more than this of wall time (1)')
    options.add_argument('--queue-mb', type=float, default=256.0, metavar='MB',
                         help='largest queue of the writer (256)')
    arguments = line.parse(options, argv)
    from dragon_ros.nodes import shell
    return shell.run('record', argv, partial(_run, arguments), arguments.json)


def add_bag_options(options: argparse.ArgumentParser) -> None:
    """Add how a bag is written."""
    options.add_argument('--compression', choices=('zstd', 'lz4', 'none'), default='zstd', help='of its chunks (zstd)')
    options.add_argument('--split-size-mb', type=float, metavar='MB', help='start another file at this size')
    options.add_argument('--split-duration-s', type=float, metavar='S', help='start another file after so much '
                         'simulation time')
    options.add_argument('--max-size-mb', type=float, metavar='MB', help='stop before the bag is larger than this')
    options.add_argument('--fsync', action='store_true', help='have each chunk on the disk before the next: against '
                         'power cuts, not only killed processes')


def _run(arguments: argparse.Namespace, stop: threading.Event) -> int:
    from dragon_ros.bags.write.writer import BagOptions, LogWriter
    from dragon_ros.nodes import record
    flush_s = number('--flush-s', arguments.flush_s, low=0.01, high=3600)
    queue_mb = number('--queue-mb', arguments.queue_mb, low=1, high=1e5)
    path = arguments.output or Path(f'dragon_{datetime.now().astimezone():%Y%m%d_%H%M%S}.mcap')
    bag = LogWriter(path, arguments.force, BagOptions(
        arguments.compression, arguments.split_size_mb, arguments.split_duration_s, arguments.max_size_mb,
        arguments.fsync))
    return record.run(bag, arguments.keep_going, flush_s, queue_mb, stop)
