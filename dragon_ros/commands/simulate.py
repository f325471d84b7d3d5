"""``simulate``: writes the bag of a scene, without ROS and as fast as the machine allows."""
import sys
import time
from argparse import Namespace
from dataclasses import replace
from threading import Event

from dragon_ros.bags.write.writer import BagOptions, BagWriter, prompt_switches
from dragon_ros.cli import command_line
from dragon_ros.cli.progress import Progress
from dragon_ros.cli.signals import stopped_by_signals
from dragon_ros.core.batches import ticks
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import string_message
from dragon_ros.messages.channels import channels, live
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.once import once
from dragon_ros.scenes import provenance

_FRAME_ID = 'dragon'
_SHOW = 100                 # ticks between two updates of the progress bar


def run(arguments: Namespace) -> int:
    """Write the bag; return the exit code."""
    scene = command_line.scene_from(arguments)
    if arguments.rate is not None:
        scene = replace(scene, run=replace(scene.run, rate_hz=arguments.rate))
    count, began = compile_scene(scene).last_tick + 1, time.perf_counter()
    tick(scene, 0)      # what cannot be simulated is refused before another bag is replaced
    writer = BagWriter(arguments.output, arguments.force, BagOptions(arguments.compression))
    with prompt_switches(), stopped_by_signals() as stop, writer as bag:
        _introduce(scene, bag, arguments.namespace)
        done = simulate(scene, bag, arguments.namespace, stop)
    simulated_s = (scene.run.time_ns(max(0, done - 1)) - scene.run.start_ns) / NS
    elapsed_s = time.perf_counter() - began
    print(f'{arguments.output}: {done} of {count} ticks, {simulated_s:g} s in {elapsed_s:.1f} s '
          f'({simulated_s / elapsed_s:.0f} times real time)', file=sys.stderr)
    return command_line.OK if done == count else command_line.FAILED


def _introduce(scene: Scene, bag: BagWriter, namespace: str) -> None:
    """Write the provenance of the run, as `sim` and `record` do: metadata, attachment, and the latched topics."""
    text = provenance.scene_file(scene, {'frame_id': _FRAME_ID})
    settings = {key: str(value) for key, value in vars(bag.options).items()}
    bag.describe(provenance.RECORD, provenance.run_metadata(text, scene, settings | provenance.versions()))
    bag.attach(provenance.ATTACHMENT, 'application/yaml', text.encode())
    latched = {**once(scene, _FRAME_ID), 'scene': string_message(text)}
    for name in (*latched, *(row.name for row in live(scene.effects))):
        bag.add_channel(f'{namespace}/{name}', channels()[name])
    for name, data in latched.items():
        bag.write(f'{namespace}/{name}', data, scene.run.start_ns, 1)


def simulate(scene: Scene, bag: BagWriter, namespace: str, stop: Event) -> int:
    """Write the messages of every tick of the run until ``stop`` is set; return how many ticks were written."""
    topics = [(f'{namespace}/{name}', encode) for name, encode in encoders(scene, _FRAME_ID).items()]
    count = compile_scene(scene).last_tick + 1
    with Progress('simulate', 'ticks', count) as bar:
        for k, frame in enumerate(ticks(scene, 0, count)):
            if stop.is_set():
                return k
            for topic, encode in topics:
                bag.write(topic, encode(frame), frame.t_ns, k + 1)
            if not k % _SHOW:
                bar.reach(k)
    return count
