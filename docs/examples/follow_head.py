"""A robot that follows a dragon's head at a distance of 2 m and publishes its pose (PoseStamped) on `follower`."""
import signal
from math import atan2, cos, hypot, sin

import rclpy
from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

DISTANCE_M, TOP_SPEED_M_S = 2.0, 1.5


class Follower(Node):
    """A robot that moves towards the head, in simulation time, while the head is more than DISTANCE_M away."""

    def __init__(self) -> None:
        """Start at the first received position of the head."""
        super().__init__('follower', namespace='/dragon')
        self.place: tuple[float, float] | None = None
        self.before_s = 0.0
        self.out = self.create_publisher(PoseStamped, 'follower', 10)
        self.create_subscription(PoseArray, 'handles', self.on_handles, QoSProfile(depth=1000))

    def on_handles(self, message: PoseArray) -> None:
        """Take one step; its length follows from the time between stamps."""
        head, now_s = message.poses[0].position, message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        x, y = self.place or (head.x, head.y)
        step_s, self.before_s = max(0.0, now_s - self.before_s) if self.place else 0.0, now_s
        away, heading = hypot(head.x - x, head.y - y), atan2(head.y - y, head.x - x)
        step = max(0.0, min(away - DISTANCE_M, TOP_SPEED_M_S * step_s))
        self.place = x + step * cos(heading), y + step * sin(heading)
        pose = PoseStamped(header=message.header)
        pose.pose.position.x, pose.pose.position.y = self.place
        pose.pose.orientation.z, pose.pose.orientation.w = sin(heading / 2), cos(heading / 2)
        self.out.publish(pose)


stop = list[int]()
signal.signal(signal.SIGINT, lambda number, _: stop.append(number))     # Ctrl-C takes effect between two callbacks
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = Follower()
while not stop:
    rclpy.spin_once(node, timeout_sec=0.1)
