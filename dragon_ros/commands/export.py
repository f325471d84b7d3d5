"""``export``: write the ticks of a bag as CSV, Parquet or NumPy arrays."""
from argparse import Namespace

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.pool import workers_of
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.ranges import handles_of


def run(arguments: Namespace) -> int:
    """Write the file; return the exit code."""
    if arguments.every < 1:
        raise dr.InputError(f'--every {arguments.every}: give 1 or more', field='every')
    workers_of(arguments.workers)       # checks the option before the bag is read
    with dr.read_bag(arguments.bag, arguments.namespace) as bag:
        total = None if arguments.format == 'npz' else bag.ticks        # arrays need several passes
        with Progress(arguments.format, 'ticks', total) as bar:
            bag.export(arguments.output, arguments.format, handles=handles_of(arguments.handles, bag.handles - 1),
                       every=arguments.every, overwrite=arguments.force, workers=arguments.workers,
                       progress=bar.update)
    return command_line.OK
