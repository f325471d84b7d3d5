"""``replay``: a bag back onto its topics, at the recorded spacing."""
import argparse
import threading
import time
from functools import partial
from pathlib import Path

from rclpy.publisher import Publisher

from dragon_ros.core.errors import InputError
from dragon_ros.core.watch import NS
from dragon_ros.nodes import outlet, qos, shell
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.commands import line
from dragon_ros.nodes.pacer import Pacer
from dragon_ros.wire import cli
from dragon_ros.wire.log import LogReader


class Replay(DragonNode):
    """Publishes the bytes of a bag under the recorded names."""

    def __init__(self, bag: LogReader, topics: list[str] | None, lossless: bool) -> None:
        """Advertise the topics of the bag."""
        super().__init__('replay')
        self._bag = bag
        rows = [row for row in bag.topics if topics is None or row.name in topics]
        profiles = {row.name: qos.of_bag(row.qos) for row in rows}
        self._out: dict[str, Publisher] = {
            row.name: self.create_publisher(shell.message_type(row.type), row.name, qos.lossless(profiles[row.name])
                                            if lossless else profiles[row.name]) for row in rows}

    def run(self, arguments: argparse.Namespace, stop: threading.Event) -> int:
        """Publish once, or for ever; return the exit code."""
        wanted = outlet.wanted_readers(arguments.wait_subscribers, self._out)
        if not outlet.wait_for_readers(wanted, stop):
            return cli.OK
        published = 0
        while True:
            published += self._once(arguments, stop)
            if not arguments.loop or stop.is_set():
                break
        self.get_logger().info(f'{published} messages of {self._bag.path} published')
        outlet.drain(self._out.values())
        return cli.OK

    def _once(self, arguments: argparse.Namespace, stop: threading.Event) -> int:
        pacer, told, count = Pacer(arguments.rate), time.monotonic(), 0
        start_ns = self._bag.start_ns + round(arguments.start * NS)
        for message in self._bag.messages(list(self._out), start_ns):
            if not pacer.wait(message.t_ns, stop):
                break
            outlet.publish(self._out[message.topic], message.data, stop)
            count += 1
            if time.monotonic() - told >= 1:
                told = time.monotonic()
                self.get_logger().info(f'at {message.t_ns / NS:.3f} s of {self._bag.end_ns / NS:.3f} s')
        return count


def main(argv: list[str]) -> int:
    """Replay a bag; return the exit code."""
    options = line.parser('replay', 'Publish the messages of a bag on their topics again, byte for byte.',
                         'ros2 run dragon_ros replay run.mcap --rate 2 --start 5')
    options.add_argument('bag', type=Path, metavar='BAG', help='MCAP file')
    options.add_argument('--rate', type=float, default=1.0, help='speed factor; 0 is as fast as possible (1)')
    options.add_argument('--start', type=float, default=0.0, metavar='S', help='seconds of the bag to leave out (0)')
    options.add_argument('--loop', action='store_true', help='start again at the end')
    options.add_argument('--topics', type=lambda text: text.split(','), metavar='NAME,...',
                         help='publish only these topics (full names)')
    options.add_argument('--wait-subscribers', type=lambda text: text.split(','), default=[], metavar='NAME=N,...',
                         help='start when topics have so many subscribers')
    arguments = line.parse(options, argv)
    return shell.run('replay', argv, partial(_run, arguments), arguments.json)


def _run(arguments: argparse.Namespace, stop: threading.Event) -> int:
    with LogReader(arguments.bag) as bag:
        _check(arguments, bag)
        node = Replay(bag, arguments.topics, arguments.rate == 0)
        try:
            return node.run(arguments, stop)
        finally:
            node.destroy_node()


def _check(arguments: argparse.Namespace, bag: LogReader) -> None:
    """Refuse options that do not fit the bag."""
    length_s = (bag.end_ns - bag.start_ns) / NS
    if not 0 <= arguments.rate <= 1e6:
        raise InputError(f'--rate {arguments.rate:g}: must lie between 0 (as fast as possible) and 1e6')
    if not 0 <= arguments.start <= length_s:
        raise InputError(f'--start {arguments.start:g}: the bag is {length_s:g} s long; give 0 to {length_s:g}')
    known = [row.name for row in bag.topics]
    for name in arguments.topics or []:
        if name not in known:
            raise InputError(f'--topics {name}: is not in the bag; it has {", ".join(known)}')
