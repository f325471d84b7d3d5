"""Write the first nav_msgs/Path on a topic to standard output, as bytes; ``route`` runs this module as a process."""
import sys
import threading
import time
from functools import partial

from nav_msgs.msg import Path
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from dragon_ros.cli.command_line import BAD_INPUT, OK
from dragon_ros.nodes import shell
from dragon_ros.nodes.raw_subscription import subscribe_raw

# Every publisher, even a latched or best-effort one, is compatible with one of these profiles.
_PROFILES = ((ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
             (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL),
             (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE))


def main(argv: list[str]) -> int:
    """Wait for a path on ``TOPIC`` for ``SECONDS``; return the exit code."""
    topic, timeout_s = argv
    return shell.run('route', [], partial(_wait, topic, float(timeout_s)))


def _wait(topic: str, timeout_s: float, stop: threading.Event) -> int:
    node, taken, end = Node('dragon_route'), list[bytes](), time.monotonic() + timeout_s
    try:
        for reliability, durability in _PROFILES:
            subscribe_raw(node, Path, topic, lambda data, _: taken.append(bytes(data)),
                          QoSProfile(depth=1, reliability=reliability, durability=durability))
        wake = node.create_timer(0.1, lambda: None)
        shell.spin(node, stop, lambda: bool(taken) or time.monotonic() > end)
        wake.cancel()
    except NameValidationException as error:
        print(' '.join(str(error).split()), file=sys.stderr)
        return BAD_INPUT
    finally:
        node.destroy_node()
    if not taken:
        print(f'no nav_msgs/Path arrived within {timeout_s:g} s; publish one, or give a larger --timeout',
              file=sys.stderr)
        return BAD_INPUT
    sys.stdout.buffer.write(taken[0])
    return OK


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
