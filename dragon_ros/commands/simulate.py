"""``simulate``: write the bag of a scene, without ROS and as fast as the machine allows."""
import time
from argparse import Namespace
from functools import partial
from pathlib import Path

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.inputs import COMPRESSIONS, counted
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.signals import stopped_by_signals


def main(argv: list[str]) -> int:
    """Write a bag; return the exit code, which is 1 if a signal ended the command early. The bag is always complete."""
    options = command_line.parser('simulate', 'Write the same bag as `sim` and `record`, bit for bit, without ROS and '
                                  'as fast as possible.',
                                  'simulate --scene winding --output run.mcap')
    command_line.add_scene_options(options)
    options.add_argument('--output', type=Path, metavar='BAG', required=True,
                         help='bag to write: a file if its name ends in .mcap, otherwise a rosbag2 folder')
    options.add_argument('--force', action='store_true', help='replace an existing bag')
    options.add_argument('--rate', type=float, metavar='HZ', help='ticks per second (as in the scene)')
    options.add_argument('--compression', choices=COMPRESSIONS, default='zstd', help='compression of the bag '
                                                                                     '(%(default)s)')
    options.add_argument('--namespace', default='/dragon', help='namespace of the topics (%(default)s)')
    command_line.add_workers_option(options, 'bag')
    arguments = options.parse_args(argv)
    return command_line.guarded('simulate', partial(_run, arguments))


def _run(arguments: Namespace) -> int:
    """Write the bag; return the exit code."""
    from dataclasses import replace
    scene, began = command_line.scene_from(arguments), time.perf_counter()
    if arguments.rate is not None:
        scene = replace(scene, run=replace(scene.run, rate_hz=arguments.rate))
    count = dr.compile(scene).ticks
    with stopped_by_signals() as stop, Progress('simulate', 'ticks', count) as bar:
        done = dr.write_bag(scene, arguments.output, overwrite=arguments.force, namespace=arguments.namespace,
                            compression=arguments.compression, workers=arguments.workers, stop=stop,
                            progress=bar.update)
    simulated_s = (scene.run.time_ns(max(0, done - 1)) - scene.run.start_ns) / 1e9
    elapsed_s = time.perf_counter() - began
    command_line.note(f'{arguments.output}: {done} of {counted(count, "tick")}, {simulated_s:g} s in {elapsed_s:.1f} s '
                      f'({simulated_s / elapsed_s:.0f} times real time)')
    return command_line.OK if done == count else command_line.FAILED
