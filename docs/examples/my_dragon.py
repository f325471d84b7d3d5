"""Monitor your own dragon: convert its handles (PoseArray, head to tail) into the benches that the monitor reads.

Publish the handles on /mine/handles, then start this program and `./dragon monitor --ros-args -r __ns:=/mine`.
"""
import signal

import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from visualization_msgs.msg import MarkerArray

from dragon_ros.messages.observation import BenchesFromHandles

stop = list[int]()
signal.signal(signal.SIGINT, lambda number, _: stop.append(number))     # Ctrl-C takes effect between two callbacks
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = Node('my_dragon', namespace='/mine')
builder = BenchesFromHandles(width_m=0.3, hole_inset_m=0.275)
benches = node.create_publisher(MarkerArray, 'benches', QoSProfile(depth=1000))
node.create_subscription(PoseArray, 'handles', lambda data: benches.publish(builder.encode(data)),
                         QoSProfile(depth=1000), raw=True)
while not stop:
    rclpy.spin_once(node, timeout_sec=0.1)
