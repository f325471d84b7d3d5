"""TF of the two ends of a dragon; frames of all 224 handles would slow down every listener."""
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile

from dragon_ros.core.frame import Frame
from dragon_ros.messages.cdr import half_turns, stamp_of
from dragon_ros.nodes import shell


class TfPublisher:
    """Publishes FRAME/head and FRAME/tail, children of the frame of all messages, on /tf."""

    def __init__(self, node: Node, frame_id: str) -> None:
        """Advertise /tf. Raises MissingError where tf2_msgs is not installed."""
        self._message, self._frame_id = shell.message_type('tf2_msgs/msg/TFMessage'), frame_id
        self._publisher = node.create_publisher(self._message, '/tf', QoSProfile(depth=100))

    def publish(self, frame: Frame) -> None:
        """Publish both ends of a frame."""
        self._publisher.publish(self._message(transforms=transforms_of(frame, self._frame_id)))


def transforms_of(frame: Frame, frame_id: str) -> list[TransformStamped]:
    """Return where the first and the last handle are; x points towards the head, as the yaw of the handles."""
    turns = half_turns(frame.axis[[0, -1]])
    return [_transform(frame, frame_id, name, handle, turn.tolist())
            for name, handle, turn in zip(('head', 'tail'), (0, -1), turns, strict=True)]


def _transform(frame: Frame, frame_id: str, name: str, handle: int, turn: list[float]) -> TransformStamped:
    out = TransformStamped(child_frame_id=f'{frame_id}/{name}')
    out.header.frame_id = frame_id
    out.header.stamp.sec, out.header.stamp.nanosec = stamp_of(frame.t_ns)
    out.transform.translation.x, out.transform.translation.y = frame.chain.p[handle].tolist()
    out.transform.rotation.z, out.transform.rotation.w = turn
    return out
