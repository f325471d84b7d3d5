"""``simulate``: write the bag of a scene, without ROS and as fast as the machine allows."""
import time
from argparse import Namespace
from dataclasses import replace

import dragon_ros as dr
from dragon_ros.cli import command_line
from dragon_ros.cli.inputs import counted
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.signals import stopped_by_signals


def run(arguments: Namespace) -> int:
    """Write the bag; return the exit code."""
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
