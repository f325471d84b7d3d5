"""Place the benches by joint_states and the URDF; print how far they are from the benches that sim publishes."""
import signal
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

stop, urdf, ticks = list[int](), list[String](), dict[tuple[int, int], dict[str, Any]]()
signal.signal(signal.SIGINT, lambda number, _: stop.append(number))     # Ctrl-C takes effect between two callbacks
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node('joint_check', namespace='/dragon')


def take(name: str, message: Any) -> None:
    """Compare the benches of a tick when both messages have arrived."""
    stamp = (message.markers[0] if name == 'benches' else message).header.stamp
    (tick := ticks.setdefault((stamp.sec, stamp.nanosec), {}))[name] = message
    if len(tick) == 2 and urdf:
        joints, poses = fromstring(urdf[0].data).findall('joint/origin'), [one.pose for one in tick['benches'].markers]
        links_m = [-float(one.get('xyz', '').split()[0]) for one in joints]
        shown = np.array([complex(pose.position.x, pose.position.y) for pose in poses])
        yaw = 2 * np.arctan2(poses[0].orientation.z, poses[0].orientation.w) + np.cumsum([0, *tick['joints'].position])
        ahead = np.array([*links_m, links_m[-1]]) * np.exp(1j * yaw)
        placed = shown[0] + ahead[0] / 2 - np.cumsum(ahead) + ahead / 2
        print(f'{stamp.sec} s: {np.max(np.abs(placed - shown)):.1e} m', flush=True)
        del ticks[stamp.sec, stamp.nanosec]


latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(String, 'robot_description', urdf.append, latched)
node.create_subscription(MarkerArray, 'benches', lambda message: take('benches', message), 1000)
node.create_subscription(JointState, 'joint_states', lambda message: take('joints', message), 1000)
while not stop:
    rclpy.spin_once(node, timeout_sec=0.1)
