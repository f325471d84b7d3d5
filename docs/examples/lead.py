"""Lead the dragon of `./dragon sim --scene led`: forwards for ten seconds, backwards for five, repeatedly."""
import signal
import time

import rclpy
from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

stop = list[int]()
signal.signal(signal.SIGINT, lambda number, _: stop.append(number))     # Ctrl-C takes effect between two callbacks
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = Node('lead', namespace='/dragon')
commands = node.create_publisher(TwistStamped, 'cmd_vel', 10)
began = time.monotonic()


def command() -> None:
    """Publish the current speed; the dragon stops if no command arrives for half a second."""
    message = TwistStamped()
    message.header.stamp = node.get_clock().now().to_msg()
    message.twist.linear.x = 1.0 if (time.monotonic() - began) % 15 < 10 else -0.5
    commands.publish(message)


node.create_timer(0.1, command)
while not stop:
    rclpy.spin_once(node, timeout_sec=0.1)
