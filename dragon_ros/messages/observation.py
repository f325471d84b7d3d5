"""Convert the bytes of a PoseArray and a MarkerArray into a checked observation for the contact tracker.

If a dragon is published by another program, this module also computes the MarkerArray of its benches from its handles,
so that a monitor can observe that dragon.
"""
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.limits import COORDINATE_M
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.words import counted
from dragon_ros.messages.cdr import NS
from dragon_ros.messages.decode import Markers, MessageError, Poses, read_marker_array, read_pose_array
from dragon_ros.messages.markers import BENCH, CUBE, TRIANGLE_LIST, CubesTemplate

_ADD = 0
_SAME_LENGTH_M = 1e-9
_SKEW = 1e-6        # largest relative deviation of a bench's two triangles from a rectangle


@dataclass(frozen=True)
class BenchMarkers:
    """The benches in one message: stamp, frame, markers, and the indices of the bench markers."""

    t_ns: int
    frame_id: str
    markers: Markers
    order: Ints

    def rectangles(self, handles_m: Floats) -> Benches:
        """Return the benches; ``handles_m`` (shape (N+1, 2)) determines the direction of benches made of triangles."""
        if self.markers.type[self.order[0]] == CUBE:
            return _cubes(self.markers, self.order)
        return _facing(*_triangles(self.markers, int(self.order[0]), len(handles_m)), handles_m)

    @property
    def size_bytes(self) -> int:
        """The memory, in bytes, of the part of the message that is kept."""
        return self.markers.size_bytes

    def to_wait(self) -> 'BenchMarkers | WaitingBenches':
        """Return the part to keep until handles arrive: the rectangles, which take 20 to 25 % of the message's bytes.

        An invalid message is kept unchanged and is rejected together with its handles.
        """
        kept: tuple[Floats, ...]
        try:
            if is_cubes := self.markers.type[self.order[0]] == CUBE:
                benches = _cubes(self.markers, self.order)
                kept = benches.centre, benches.axis, benches.half_length, benches.half_width
            else:
                kept = _triangles(self.markers, int(self.order[0]))
        except MessageError:
            return self
        return WaitingBenches(self.t_ns, self.frame_id, bool(is_cubes), tuple(each.copy() for each in kept))


@dataclass(frozen=True)
class BenchCubes:
    """The benches in a message with cubes: stamp, frame, unchecked poses (shape (N, 7)), and checked sizes."""

    t_ns: int
    frame_id: str
    poses: Floats
    half_length: Floats
    half_width: Floats
    size_bytes: int

    def rectangles(self, handles_m: Floats) -> Benches:
        """Return the benches. Raises MessageError if a pose is invalid."""
        return Benches(*placed(self.poses), self.half_length, self.half_width)

    def to_wait(self) -> 'BenchCubes | WaitingBenches':
        """Return the part to keep until handles arrive (see ``BenchMarkers``)."""
        try:
            centre, axis = placed(self.poses)
        except MessageError:
            return self
        return WaitingBenches(self.t_ns, self.frame_id, True, (centre.copy(), axis, self.half_length, self.half_width))


@dataclass(frozen=True)
class WaitingBenches:
    """The benches from a message that is no longer kept: arrays for ``Benches`` or, for triangles, for ``_facing``."""

    t_ns: int
    frame_id: str
    is_cubes: bool
    arrays: tuple[Floats, ...]

    def rectangles(self, handles_m: Floats) -> Benches:
        """Return the benches (see ``BenchMarkers``)."""
        if self.is_cubes:
            return Benches(*self.arrays)
        _counted(len(self.arrays[0]), len(handles_m))
        centre, sides, half = self.arrays
        return _facing(centre, sides, half, handles_m)

    @property
    def size_bytes(self) -> int:
        """The memory of the arrays in bytes."""
        return sum(each.nbytes for each in self.arrays)


ShownBenches = BenchMarkers | BenchCubes | WaitingBenches


def observation_of(poses: Poses, shown: ShownBenches) -> Observation:
    """Return the observation from the two messages of a tick. Raises MessageError, naming the message and the field."""
    handles_m = np.ascontiguousarray(poses.poses[:, :2], dtype=np.float64)
    rectangles = shown.rectangles(handles_m)
    _counted(len(rectangles.centre), len(handles_m))
    if poses.frame_id != shown.frame_id:
        raise MessageError(f'benches: frame {shown.frame_id!r} is not the frame of the handles, {poses.frame_id!r}')
    return Observation(poses.t_ns, handles_m, rectangles, poses.frame_id)


def observations_of(pairs: Sequence[tuple[Poses, ShownBenches]]) -> list[Observation | MessageError]:
    """Return for each tick what ``observation_of`` returns or raises; ticks of one layout are computed together."""
    out: list[Observation | MessageError | None] = [None] * len(pairs)
    like: dict[tuple[int, int, str, str], list[int]] = defaultdict(list)
    for n, (poses, shown) in enumerate(pairs):
        if isinstance(shown, BenchCubes):
            like[id(shown.half_length), len(poses.poses), poses.frame_id, shown.frame_id].append(n)
    for rows in like.values():
        for n, observation in zip(rows, _together([pairs[n] for n in rows]), strict=False):
            out[n] = observation
    return [_tried(*pair) if known is None else known for pair, known in zip(pairs, out, strict=True)]


def _tried(poses: Poses, shown: ShownBenches) -> Observation | MessageError:
    try:
        return observation_of(poses, shown)
    except MessageError as error:
        return error


def _together(pairs: Sequence[tuple[Poses, ShownBenches]]) -> list[Observation]:
    """Return the observations of ticks that differ only in stamps and poses, or nothing if each must be checked."""
    handles, shown = zip(*pairs, strict=True)
    count, benches = len(pairs), len(shown[0].poses)
    if count == 1 or len(handles[0].poses) != benches + 1 or handles[0].frame_id != shown[0].frame_id:
        return []
    handles_m, poses = np.empty((count, benches + 1, 2)), np.empty((count, benches, 7))
    for n in range(count):
        handles_m[n], poses[n] = handles[n].poses[:, :2], shown[n].poses
    if poses[..., 3:5].any():       # tilted benches are computed by another formula, which may return another zero
        return []
    try:
        centre, axis = placed(poses.reshape(-1, 7))
    except MessageError:
        return []
    centre, axis = (np.ascontiguousarray(each).reshape(count, benches, 2) for each in (centre, axis))
    return [Observation(handles[n].t_ns, handles_m[n],
                        Benches(centre[n], axis[n], shown[n].half_length, shown[n].half_width), handles[n].frame_id)
            for n in range(count)]


def read_benches(data: bytes) -> BenchMarkers:
    """Return the benches in a MarkerArray, ignoring other markers. Raises MessageError."""
    markers = read_marker_array(data)
    order = _bench_markers(markers)
    t_ns = checked_stamp(int(markers.t_ns[order[0]]))
    return BenchMarkers(t_ns, markers.runs[markers.run_of[order[0]]].frame_id, markers, order)


def checked_stamp(t_ns: int) -> int:
    """Return the stamp of a message with benches. Raises MessageError if the stamp is invalid."""
    if not 0 <= t_ns < 2**31 * NS:
        raise MessageError(f'benches: stamp: {t_ns} ns; expected a non-negative time below 2**31 s')
    return t_ns


def read_handles(data: bytes, below_m: float = COORDINATE_M, most: float = inf) -> Poses:
    """Return the poses of a PoseArray.

    Raises MessageError if the poses cannot be the handles of a dragon with at most ``most`` handles, whose coordinates
    are smaller than ``below_m``.
    """
    poses = read_pose_array(data)
    if not 2 <= len(poses.poses) <= most:
        span = 'at least two' if most == inf else f'2 to {most:.0f}'
        raise MessageError(f'handles: the number of poses is {len(poses.poses)}; a dragon has {span} handles')
    _finite('handles: position', poses.poses[:, :2], below_m)
    return poses


class BenchesFromHandles:
    """Computes the benches of any dragon, as CUBEs that the monitor can read, from the handles of a PoseArray.

    Bench i is ``width_m`` wide and extends from handle i + 1 to handle i, and by ``hole_inset_m`` beyond both
    handles. The pose of a bench follows from the positions of the handles, not from their orientations.
    """

    def __init__(self, width_m: float = 0.3, hole_inset_m: float = 0.275) -> None:
        """Start with the common hole inset and width of all benches, in metres."""
        self._width_m, self._hole_inset_m = width_m, hole_inset_m
        self._frame_id, self._lengths_m = '', np.empty(0)       # lengths for which the template was built
        self._template: CubesTemplate | None = None

    def encode(self, handles: bytes) -> bytes:
        """Return a MarkerArray, with the same stamp and frame, for the bytes of a geometry_msgs/PoseArray.

        Raises MessageError if handles are invalid or two consecutive handles coincide.
        """
        poses = read_handles(handles)
        p = poses.poses[:, :2].astype(np.float64)
        link, lengths = p[:-1] - p[1:], np.hypot(*(p[:-1] - p[1:]).T)
        if not np.all(lengths):
            raise MessageError(f'handles: {int(np.argmin(lengths))} and the next handle are at the same point')
        whole = lengths + 2 * self._hole_inset_m
        if self._template is None or poses.frame_id != self._frame_id or whole.shape != self._lengths_m.shape or (
                np.any(np.abs(whole - self._lengths_m) > _SAME_LENGTH_M)):
            self._frame_id, self._lengths_m = poses.frame_id, whole
            self._template = CubesTemplate(whole, self._width_m, poses.frame_id)
        return self._template.encode(poses.t_ns, 0.5 * (p[:-1] + p[1:]), link / lengths[:, None])


def _bench_markers(markers: Markers) -> Ints:
    """Return the indices of the markers in namespace ``bench``: one TRIANGLE_LIST, or CUBEs with ids from 0 to N-1."""
    named = np.array([run.ns == BENCH for run in markers.runs], dtype=bool)
    mine = np.flatnonzero(named[markers.run_of] & (markers.action == _ADD))
    kind = markers.type[mine]
    cubes, lists = mine[kind == CUBE], mine[kind == TRIANGLE_LIST]
    if lists.size > 1 or (lists.size and cubes.size):
        raise MessageError('benches: namespace bench must hold CUBEs or one TRIANGLE_LIST, not several or both')
    if not lists.size and not cubes.size:
        raise MessageError('benches: namespace bench has neither CUBEs nor a TRIANGLE_LIST')
    order: Ints = lists if lists.size else cubes[np.argsort(markers.id[cubes], kind='stable')]
    if cubes.size and not np.array_equal(markers.id[order], np.arange(order.size)):
        raise MessageError('benches: the ids of the cubes in namespace bench must be 0, 1, 2, ..., each once')
    return order


def _counted(benches: int, handles: int) -> None:
    if benches != handles - 1:
        raise MessageError(f'benches: {counted(benches, "bench")} for {handles} handles; expected {handles - 1}')


def _cubes(markers: Markers, order: Ints) -> Benches:
    return Benches(*placed(markers.poses[order]), *half_sizes(markers.scale[order]))


def half_sizes(scale: Floats) -> tuple[Floats, Floats]:
    """Return the half lengths and half widths (m) of cubes, given their scales (shape (N, 3)). Raises MessageError."""
    scale = _finite('benches: scale', scale)
    if np.any(scale[:, :2] <= 0):
        raise MessageError('benches: scale: lengths and widths must be positive')
    return 0.5 * scale[:, 0], 0.5 * scale[:, 1]


def placed(poses: Floats) -> tuple[Floats, Floats]:
    """Return the centres and axes (shape (N, 2)) of cubes, given their poses (shape (N, 7)). Raises MessageError."""
    poses = _finite('benches: pose', poses)
    return poses[:, :2], _axes(poses[:, 3:])


def _axes(quaternion: Floats) -> Floats:
    """Rotate the x axis by quaternions (shape (N, 4)); return unit vectors in the plane (shape (N, 2))."""
    x, y, z, w = quaternion.T
    axis = np.empty((len(quaternion), 2))
    if quaternion[:, :2].any():
        axis[:, 0], axis[:, 1] = w * w + x * x - y * y - z * z, 2 * (w * z + x * y)
    else:
        axis[:, 0], axis[:, 1] = w * w - z * z, 2 * (w * z)
    length = np.hypot(axis[:, 0], axis[:, 1])
    if length.size and length.min() < 1e-6:
        raise MessageError('benches: pose: a bench stands upright or has no orientation')
    axis /= length[:, None]
    return axis


def _triangles(markers: Markers, marker: int, handles: int | None = None) -> tuple[Floats, Floats, Floats]:
    """Return the centres, sides and half sizes of rectangles made of two triangles with any diagonal and winding."""
    points = _placed(_finite('benches: point', markers.points_of(marker)), markers, marker)
    if len(points) % 6:
        raise MessageError(f'benches: {len(points)} points; expected six points (two triangles) per bench')
    if handles is not None:
        _counted(len(points) // 6, handles)
    first, second = np.moveaxis(points.reshape(-1, 2, 3, 2), 1, 0)
    if np.array_equal(first[:, 0], second[:, 0]) and np.array_equal(first[:, 2], second[:, 1]):
        # Messages from this package have this diagonal and this winding.
        start, corner, end, far = first[:, 0], first[:, 1], first[:, 2], second[:, 2]
    else:
        start, corner, end, far = _around(first, second)
    sides = np.stack((start - corner, end - corner), axis=1)
    length = _norm(sides)
    size = length[:, 0] + length[:, 1]
    skew = np.abs(sides[:, 0, 0] * sides[:, 1, 0] + sides[:, 0, 1] * sides[:, 1, 1])
    bent = _norm(start + end - corner - far) > _SKEW * size
    bad = bent | (skew > _SKEW * size * size) | (length[:, 0] <= 0) | (length[:, 1] <= 0)
    if bad.any():
        raise MessageError(f'benches: points: the two triangles of bench {int(np.argmax(bad))} do not form a rectangle')
    return 0.5 * (start + end), sides / length[..., None], 0.5 * length


def _norm(vectors: Floats) -> Floats:
    out: Floats = np.hypot(vectors[..., 0], vectors[..., 1])
    return out


def _around(first: Floats, second: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the corners, in order, of N quadrilaterals made of two triangles that share their longest side.

    The triangles have the shape (N, 3, 2). If their longest sides differ, the last corner is moved by the distance
    between these sides.
    """
    (corner, start, end), (far, one, other) = _from_right_angle(first), _from_right_angle(second)
    apart = np.minimum(_norm(start - one) + _norm(end - other), _norm(start - other) + _norm(end - one))
    return start, corner, end, far + apart[:, None]


def _from_right_angle(triangles: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the corner opposite the longest side of each triangle (shape (N, 3, 2)), and the ends of that side."""
    opposite = _norm(np.roll(triangles, -1, axis=1) - np.roll(triangles, 1, axis=1))
    turn = (np.argmax(opposite, axis=1)[:, None] + np.arange(3)) % 3
    corner, start, end = np.moveaxis(np.take_along_axis(triangles, turn[..., None], axis=1), 1, 0)
    return corner, start, end


def _facing(centre: Floats, sides: Floats, half: Floats, handles_m: Floats) -> Benches:
    """Return benches, each with that axis of its two ``sides`` which aligns best with its link, from rear to front.

    ``sides`` has the shape (N, 2, 2). If the two handles of a bench coincide, its longer side is used.
    """
    link = handles_m[:-1] - handles_m[1:]
    along = sides[..., 0] * link[:, :1] + sides[..., 1] * link[:, 1:]
    joined = ~link.any(axis=1, keepdims=True)
    second = np.greater(*np.where(joined, half, np.abs(along)).T[::-1])[:, None]
    axis = np.where(second, sides[:, 1], sides[:, 0])
    axis = np.where(np.where(second, along[:, 1:], along[:, :1]) < 0, -axis, axis)
    half_length, half_width = np.where(second, half[:, ::-1], half).T
    return Benches(centre, axis, half_length, half_width)


def _placed(points: Floats, markers: Markers, marker: int) -> Floats:
    """Apply a marker's scale and pose to its points (shape (K, 3)); return the points in the plane."""
    pose = _finite('benches: pose', markers.poses[marker:marker + 1])[0]
    scale = _finite('benches: scale', markers.scale[marker:marker + 1])[0]
    x, y, z, w = pose[3:] / max(float(np.linalg.norm(pose[3:])), 1e-150)
    if abs(x * x + y * y + z * z + w * w - 1) > 1e-6 or np.any(scale == 0):
        raise MessageError('benches: pose or scale: the list of triangles has no orientation or no size')
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)]])
    plain = w == 1 and bool(np.all(scale == 1))
    out: Floats = pose[:2] + (points[:, :2] if plain else (points * scale) @ turn.T)
    return out


def _finite(what: str, values: Floats, below: float = COORDINATE_M) -> Floats:
    """Return values as native floats. Raises MessageError unless all of them are finite and below the limit."""
    values = np.ascontiguousarray(values, dtype=np.float64)
    size = np.abs(values)
    if not np.maximum.reduce(size, axis=None, initial=0.0) < below:
        row = int(np.argwhere(~(size < below))[0][0])
        raise MessageError(f'{what} {row} is {values[row].tolist()}; expected finite numbers below {below:g}')
    return values
