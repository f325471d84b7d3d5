"""``export``: write the ticks of a bag as CSV, Parquet or NumPy arrays."""
from argparse import Namespace
from functools import partial
from pathlib import Path

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.ranges import handles_of


def main(argv: list[str]) -> int:
    """Export a bag to a file; return the exit code."""
    options = command_line.parser('export', 'Export the handles and velocities in a bag as a table with one row per '
                                  'tick and handle (CSV, Parquet), or as arrays that include the benches (npz).',
                                  'export run.mcap --format npz --output run.npz')
    command_line.add_bag(options, 'an .mcap file or a rosbag2 folder', required=True)
    command_line.add_format_option(options, ('csv', 'parquet', 'npz'))
    options.add_argument('--output', type=Path, metavar='FILE', required=True, help='file to write')
    options.add_argument('--force', action='store_true', help='replace an existing file')
    options.add_argument('--every', type=int, default=1, metavar='N', help='export only every Nth tick (%(default)s)')
    command_line.add_handles_option(options)
    command_line.add_namespace_option(options)
    command_line.add_workers_option(options, 'file')
    arguments = options.parse_args(argv)
    return command_line.guarded('export', partial(_run, arguments))


def _run(arguments: Namespace) -> int:
    """Write the file; return the exit code."""
    if arguments.every < 1:
        raise dr.InputError(f'--every {arguments.every}: give 1 or more', field='every')
    with dr.read_bag(arguments.bag, arguments.namespace) as bag, Progress(
            arguments.format, 'ticks', bag.ticks) as bar:
        bag.export(arguments.output, arguments.format, handles=handles_of(arguments.handles, bag.handles - 1),
                   every=arguments.every, overwrite=arguments.force, workers=arguments.workers, progress=bar.update)
    return command_line.OK
