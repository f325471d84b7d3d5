"""An example subscriber that prints the speed of the tail once per second of simulation."""
import signal
import threading

import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions


class TailSpeed(Node):
    """A node that divides the distance between two positions of the tail by the time between their stamps."""

    def __init__(self) -> None:
        """Subscribe to the handles."""
        super().__init__('tail_speed', namespace='/dragon')
        self.before: tuple[float, float, float] | None = None
        self.printed_s = -1
        # Reliable, like sim's publisher; the depth is sufficient for a subscriber that is sometimes busy.
        self.create_subscription(PoseArray, 'handles', self.on_handles, QoSProfile(depth=1000))

    def on_handles(self, message: PoseArray) -> None:
        """Print the speed whenever a new second has begun."""
        stamp, tail = message.header.stamp, message.poses[-1].position
        now = stamp.sec + 1e-9 * stamp.nanosec, tail.x, tail.y
        if self.before and now[0] > self.before[0] and stamp.sec != self.printed_s:
            t_s, x, y = self.before
            speed = ((tail.x - x) ** 2 + (tail.y - y) ** 2) ** 0.5 / (now[0] - t_s)
            print(f'{now[0]:8.2f} s: the tail is at {speed:.4f} m/s', flush=True)
            self.printed_s = stamp.sec
        self.before = now


if __name__ == '__main__':
    # Ctrl-C is handled between two callbacks; rclpy's own handler would raise in the middle of one.
    interrupted = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: interrupted.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = TailSpeed()
    while not interrupted.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
    rclpy.shutdown()
