"""TF frames for a dragon's two ends and its head bench; frames for all 224 handles would slow down every listener."""
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile

from dragon_ros.core.step import Frame
from dragon_ros.messages.cdr import half_turns, stamp_of
from dragon_ros.messages.urdf import ROOT
from dragon_ros.nodes import shell

TF = 'tf2_msgs/msg/TFMessage'


class TfPublisher:
    """Publishes FRAME/head, FRAME/tail and FRAME/bench_0 on /tf, as children of FRAME, the frame of all messages."""

    def __init__(self, node: Node, frame_id: str, ends: bool = True, root: bool = False) -> None:
        """Advertise /tf, for the two ends if ``ends`` is true and for the head bench (the robot's root) if ``root`` is.

        Raises MissingError if tf2_msgs is not installed.
        """
        self._message, self._frame_id, self._ends, self._root = shell.message_type(TF), frame_id, ends, root
        self._publisher = node.create_publisher(self._message, '/tf', QoSProfile(depth=100))

    def publish(self, frame: Frame) -> None:
        """Publish the transforms of a frame."""
        out = transforms_of(frame, self._frame_id) if self._ends else []
        self._publisher.publish(self._message(transforms=out + (
            [root_of(frame, self._frame_id)] if self._root else [])))


def transforms_of(frame: Frame, frame_id: str) -> list[TransformStamped]:
    """Return the transforms of the first and the last handle; x points towards the head, as on the topic handles."""
    turns = half_turns(frame.axis[[0, -1]])
    return [_transform(frame, frame_id, name, handle, turn.tolist())
            for name, handle, turn in zip(('head', 'tail'), (0, -1), turns, strict=True)]


def root_of(frame: Frame, frame_id: str) -> TransformStamped:
    """Return the transform of the head bench, the robot's root: at the first handle, with x along the bench."""
    return _transform(frame, frame_id, ROOT, 0, half_turns(frame.axis[:1])[0].tolist())


def _transform(frame: Frame, frame_id: str, name: str, handle: int, turn: list[float]) -> TransformStamped:
    out = TransformStamped(child_frame_id=f'{frame_id}/{name}')
    out.header.frame_id = frame_id
    out.header.stamp.sec, out.header.stamp.nanosec = stamp_of(frame.t_ns)
    out.transform.translation.x, out.transform.translation.y = frame.chain.p[handle].tolist()
    out.transform.rotation.z, out.transform.rotation.w = turn
    return out
