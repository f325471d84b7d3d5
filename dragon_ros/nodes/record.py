"""``record``: the topics of a dragon, as raw bytes, into an MCAP bag."""
import argparse
import threading
import time
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from dragon_ros.nodes import qos, shell
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.commands import line
from dragon_ros.wire.cdr_read import MessageError, read_stamp_ns
from dragon_ros.wire.channels import Channel, channels
from dragon_ros.wire.log import LogWriter
from dragon_ros.wire.recording import SimulationClock

_QUIET_S = 0.5      # the run has ended when its publisher has gone and nothing came for this long
_STAMP_AT = {'visualization_msgs/msg/MarkerArray': 8, 'std_msgs/msg/Float64MultiArray': None,
             'std_msgs/msg/Float64': None, 'std_msgs/msg/Bool': None}


class Recorder(DragonNode):
    """Subscribes to every topic of topics.yaml and writes what it gets."""

    def __init__(self, path: Path, overwrite: bool) -> None:
        """Create the bag, then subscribe."""
        super().__init__('record')
        self.bag = LogWriter(path, overwrite)
        self._clock = SimulationClock(self.bag.write)
        self._last, self._seen = time.monotonic(), False
        for name, channel in channels().items():
            topic = self.resolve_topic_name(name)
            self.bag.add_channel(topic, channel)
            self.create_subscription(shell.message_type(channel.type), name, self._take(topic, channel),
                                     qos.lossless(qos.of_channel(channel)), raw=True)

    def ended(self) -> bool:
        """Return whether the run was there and has gone."""
        quiet = time.monotonic() - self._last > _QUIET_S
        gone = quiet and self._seen and self.count_publishers('handles') == 0
        if gone:
            self.get_logger().info('the publisher of handles has left')
        return gone

    def close(self) -> None:
        """Write what is held back, and close the bag."""
        self._clock.flush()
        self.bag.close()

    def _take(self, topic: str, channel: Channel) -> Callable[[bytes, Any], None]:
        """Return the callback that writes one topic."""
        shared = channel.name.startswith('/')      # by every node of the graph, and stamped with wall time
        stamp_at = None if shared else _STAMP_AT.get(channel.type, 4)
        handles = channel.name == 'handles'

        def callback(data: bytes, info: dict[str, int]) -> None:
            self._last = self._last if shared else time.monotonic()
            self._seen = self._seen or handles
            source_ns, sequence = info['source_timestamp'], info['publication_sequence_number'] or 0
            try:
                if stamp_at is None:
                    self._clock.unstamped(topic, data, source_ns, sequence)
                    return
                t_ns = read_stamp_ns(data[:4] + data[stamp_at:stamp_at + 8])
                self.bag.write(topic, data, t_ns, sequence)
                if handles:
                    self._clock.mark(source_ns, t_ns)
            except MessageError as error:
                self.get_logger().warning(f'{topic}: message not recorded: {error}', throttle_duration_sec=1.0)
        return callback


def main(argv: list[str]) -> int:
    """Run the recorder; return the exit code."""
    options = line.parser('record', 'Record every topic of a dragon until its publisher leaves (or SIGINT, SIGTERM).',
                         'ros2 run dragon_ros record --output run.mcap')
    options.add_argument('--output', type=Path, metavar='FILE', help='bag to write (dragon_DATE_TIME.mcap)')
    options.add_argument('--keep-going', action='store_true', help='go on when the publisher leaves, until a signal')
    options.add_argument('--force', action='store_true', help='replace an existing file')
    arguments = line.parse(options, argv)
    return shell.run('record', argv, partial(_run, arguments), arguments.json)


def _run(arguments: argparse.Namespace, stop: threading.Event) -> int:
    path = arguments.output or Path(f'dragon_{datetime.now().astimezone():%Y%m%d_%H%M%S}.mcap')
    node = Recorder(path, arguments.force)
    try:
        node.get_logger().info(f'records to {path}')
        return shell.spin(node, stop, node.ended if not arguments.keep_going else lambda: False)
    finally:
        node.close()
        counts = ', '.join(f'{topic} {count}' for topic, count in node.bag.counts.items())
        node.get_logger().info(f'closed {path}: {counts}')
        node.destroy_node()
