"""The tree of coordinate frames described by /tf and /tf_static, and the pose of one frame in another."""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.geometry.venue import PlanePose
from dragon_ros.core.limits import KNOWN_FRAMES
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.venue import FARTHEST_M
from dragon_ros.messages.decode import MessageError, Reader

_FLAT = 1e-6            # limit on the sine of the angle between two planes
_UNIT = 1e-3            # limit on the deviation of a quaternion's squared norm from 1


@dataclass(frozen=True)
class _Parent:
    """The parent of a frame, and the frame's pose in it: rotation matrix (shape (3, 3)) and origin (shape (3,))."""

    frame_id: str
    turn: Floats
    shift: Floats


class FrameTree:
    """The newest transforms, by child frame."""

    def __init__(self) -> None:
        """Start without frames."""
        self._parents: dict[str, _Parent] = {}

    def take(self, data: bytes) -> bool:
        """Read a tf2_msgs/TFMessage; return whether any pose is new. Raises MessageError."""
        reader, new = Reader(data), False
        for _ in range(reader.take('I')):
            _, frame_id, child = reader.stamp_ns(), _bare(reader.text()), _bare(reader.text())
            values = reader.array('d', 7).astype(np.float64)
            known = self._parents.get(child)
            if known is None and len(self._parents) >= KNOWN_FRAMES:
                continue
            if not np.max(np.abs(values)) < FARTHEST_M:
                raise MessageError(f'/tf: the pose of the frame {child!r} is not finite or is beyond {FARTHEST_M:g} m')
            parent = _Parent(frame_id, _matrix(values[3:], child), values[:3])
            if known is None or known.frame_id != frame_id or not (
                    np.array_equal(known.turn, parent.turn) and np.array_equal(known.shift, parent.shift)):
                self._parents[child], new = parent, True
        return new

    def pose(self, frame: str, into: str) -> PlanePose | None:
        """Return the pose of a frame in another frame, or None if the frames are not connected.

        Raises MessageError if one frame is tilted in the other.
        """
        up, base = self._ancestors(_bare(frame)), self._ancestors(_bare(into))
        common = next((one for one in up if one in base), None)
        if common is None:
            return None
        (turn, shift), (back, origin) = up[common], base[common]
        turn, shift = back.T @ turn, back.T @ (shift - origin)
        if turn[2, 2] < 0 or np.hypot(turn[2, 0], turn[2, 1]) > _FLAT:
            raise MessageError(f'/tf: the frame {frame!r} is tilted in {into!r}; only poses in the plane are supported')
        along = complex(turn[0, 0], turn[1, 0])
        return complex(shift[0], shift[1]), along / abs(along)

    def _ancestors(self, frame: str) -> dict[str, tuple[Floats, Floats]]:
        """Return the rotation and origin of a frame in itself and in each of its ancestors, nearest first."""
        turn, shift = np.eye(3), np.zeros(3)
        out = {frame: (turn, shift)}
        while (parent := self._parents.get(frame)) and parent.frame_id not in out:
            turn, shift, frame = parent.turn @ turn, parent.turn @ shift + parent.shift, parent.frame_id
            out[frame] = turn, shift
        return out


def _bare(frame_id: str) -> str:
    """Return a frame's name without the leading slash that older programs write."""
    return frame_id.lstrip('/')


def _matrix(quaternion: Floats, child: str) -> Floats:
    """Return the rotation matrix of a quaternion. Raises MessageError unless the quaternion has unit length."""
    x, y, z, w = quaternion.tolist()
    if not abs(x * x + y * y + z * z + w * w - 1) < _UNIT:
        raise MessageError(f'/tf: the rotation of the frame {child!r} is not a unit quaternion')
    s = 2 / (x * x + y * y + z * z + w * w)
    return np.array([[1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
                     [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
                     [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)]])
