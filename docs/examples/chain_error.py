"""Print once per second of simulation how far the links are from their length, at most: 2.86 m, and then 1.65 m."""
import signal

import numpy as np
import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions


class ChainError(Node):
    """A node that compares the distances between consecutive handles with the lengths of the links."""

    def __init__(self) -> None:
        """Subscribe to the handles."""
        super().__init__('chain_error', namespace='/dragon')
        self.printed_s = -1
        self.create_subscription(PoseArray, 'handles', self.on_handles, QoSProfile(depth=1000))

    def on_handles(self, message: PoseArray) -> None:
        """Print the largest error whenever a new second has begun."""
        stamp = message.header.stamp
        if stamp.sec != self.printed_s:
            self.printed_s = stamp.sec
            places = np.array([(pose.position.x, pose.position.y) for pose in message.poses])
            lengths_m = np.hypot(*np.diff(places, axis=0).T)
            wanted_m = np.where(np.arange(len(lengths_m)) == 0, 2.86, 1.65)
            print(f'{stamp.sec} s: {np.max(np.abs(lengths_m - wanted_m)):.1e} m', flush=True)


stop = list[int]()
signal.signal(signal.SIGINT, lambda number, _: stop.append(number))     # Ctrl-C takes effect between two callbacks
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = ChainError()
while not stop:
    rclpy.spin_once(node, timeout_sec=0.1)
