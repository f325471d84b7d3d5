"""Pair the handles and benches of each tick: print how far the first bench's centre is from its handles' midpoint."""
import signal

import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from visualization_msgs.msg import MarkerArray

KEEP = 100      # maximum number of ticks for which only one message has arrived


class Pairs(Node):
    """A node that pairs two topics by stamp, like message_filters.TimeSynchronizer, which may not be installed."""

    def __init__(self) -> None:
        """Subscribe to both topics."""
        super().__init__('pairs', namespace='/dragon')
        self.waiting: dict[tuple[int, int], dict[str, PoseArray | MarkerArray]] = {}
        for kind, name in ((PoseArray, 'handles'), (MarkerArray, 'benches')):
            self.create_subscription(kind, name, lambda message, name=name: self.take(name, message),
                                     QoSProfile(depth=1000))

    def take(self, name: str, message: PoseArray | MarkerArray) -> None:
        """Keep a message until the other message of the same tick arrives, then use both."""
        stamp = (message if name == 'handles' else message.markers[0]).header.stamp
        pair = self.waiting.setdefault((stamp.sec, stamp.nanosec), {})
        pair[name] = message
        if len(pair) == 2:
            del self.waiting[stamp.sec, stamp.nanosec]
            self.use(pair['handles'], pair['benches'])
        while len(self.waiting) > KEEP:
            del self.waiting[min(self.waiting)]

    def use(self, handles: PoseArray, benches: MarkerArray) -> None:
        """Compare the centre of the first bench with the midpoint between its two handles."""
        one, two, middle = handles.poses[0].position, handles.poses[1].position, benches.markers[0].pose.position
        off = ((one.x + two.x) / 2 - middle.x) ** 2 + ((one.y + two.y) / 2 - middle.y) ** 2
        stamp = handles.header.stamp
        print(f'{stamp.sec + 1e-9 * stamp.nanosec:.2f} s: {off ** 0.5:.1e} m', flush=True)


stop = list[int]()
signal.signal(signal.SIGINT, lambda number, _: stop.append(number))     # Ctrl-C takes effect between two callbacks
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = Pairs()
while not stop:
    rclpy.spin_once(node, timeout_sec=0.1)
