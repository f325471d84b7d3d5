"""From the bytes of a PoseArray and a MarkerArray to what the watcher looks at, with every check that it needs."""
import numpy as np

from dragon_ros.core.benches import Benches
from dragon_ros.core.types import Floats, Ints
from dragon_ros.core.watch import Sight
from dragon_ros.wire.cdr import CUBE
from dragon_ros.wire.cdr_read import Markers, MessageError, Poses, read_marker_array, read_pose_array

_ADD = 0
_NAMESPACE = 'bench'


def sight_of(poses: Poses, markers: Markers) -> Sight:
    """Return the sight of two messages of one tick. Raises MessageError, naming message and field."""
    order = bench_markers(markers)
    rectangles = _rectangles(markers, order)
    if len(rectangles.centre) != len(poses.poses) - 1:
        raise MessageError(f'benches: {len(rectangles.centre)} for {len(poses.poses)} handles; expected one less')
    frame_id = markers.frame_id[order[0]]
    if poses.frame_id != frame_id:
        raise MessageError(f'benches: frame {frame_id!r} is not the frame of the handles, {poses.frame_id!r}')
    handles_m = np.ascontiguousarray(poses.poses[:, :2], dtype=np.float64)
    return Sight(poses.t_ns, handles_m, rectangles, poses.frame_id)


def read_benches(data: bytes) -> tuple[int, Markers]:
    """Return (stamp in ns, markers) of a MarkerArray with benches; what others put beside them does not disturb."""
    markers = read_marker_array(data)
    return markers.t_ns[bench_markers(markers)[0]], markers


def bench_markers(markers: Markers) -> Ints:
    """Return where the cubes in namespace ``bench`` are, in the order of their ids, 0 to N-1."""
    mine = np.array([n for n, name in enumerate(markers.ns) if name == _NAMESPACE], dtype=int)
    mine = mine[(markers.type[mine] == CUBE) & (markers.action[mine] == _ADD)]
    order: Ints = mine[np.argsort(markers.id[mine], kind='stable')]
    if not order.size:
        raise MessageError('benches: there is no CUBE in namespace bench')
    if not np.array_equal(markers.id[order], np.arange(order.size)):
        raise MessageError('benches: the ids of the cubes in namespace bench must be 0, 1, 2, ..., each once')
    return order


def check_handles(data: bytes) -> Poses:
    """Return the poses of a PoseArray if they can belong to a dragon, else raise MessageError."""
    poses = read_pose_array(data)
    if len(poses.poses) < 2:
        raise MessageError(f'handles: {len(poses.poses)} poses; a dragon has at least two handles')
    _finite('handles: position', poses.poses[:, :2])
    return poses


def _rectangles(markers: Markers, order: Ints) -> Benches:
    poses = _finite('benches: pose', markers.poses[order])
    scale = _finite('benches: scale', markers.scale[order])
    if np.any(scale[:, :2] <= 0):
        raise MessageError('benches: scale: lengths and widths must be positive')
    return Benches(poses[:, :2], _axes(poses[:, 3:]), 0.5 * scale[:, 0], 0.5 * scale[:, 1])


def _axes(quaternion: Floats) -> Floats:
    """Return where quaternions (N, 4) turn the x axis, in the plane."""
    x, y, z, w = np.moveaxis(quaternion, -1, 0)
    axis = np.stack((w * w + x * x - y * y - z * z, 2 * (w * z + x * y)), axis=1)
    length = np.hypot(axis[:, 0], axis[:, 1])
    if np.any(length < 1e-6):
        raise MessageError('benches: pose: a bench stands upright or has no orientation')
    out: Floats = axis / length[:, None]
    return out


def _finite(what: str, values: Floats) -> Floats:
    """Return values as native floats if all are finite and of a size that can be squared."""
    bad = ~(np.abs(values) < 1e150)
    if np.any(bad):
        row = int(np.argwhere(bad)[0][0])
        raise MessageError(f'{what} {row} is {values[row].tolist()}; expected finite numbers')
    return np.ascontiguousarray(values, dtype=np.float64)
