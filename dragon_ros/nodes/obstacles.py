"""The obstacles known to a monitor, in the dragon's frame: from a file, from the topic ``venue``, and from a map.

The obstacles from all sources are combined. If the frame of a source is not the dragon's frame, its obstacles are
transformed using the declared pose, or using the transforms on /tf and /tf_static. If neither connects the frames, the
obstacles are not used, and the log and /diagnostics report this.

Obstacles from a file or a map are published so that bags contain them. The message has the stamp of the first tick at
which these obstacles are used.
"""
import time
from cmath import phase
from collections.abc import Callable
from functools import partial
from math import degrees
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.qos import DurabilityPolicy, QoSProfile

from dragon_ros.core.checks import plane_pose
from dragon_ros.core.errors import InputError
from dragon_ros.core.geometry.venue import PlanePose, Surroundings, joined, surroundings_of
from dragon_ros.core.limits import SHOWN_EDGES
from dragon_ros.core.venue import Venue
from dragon_ros.core.words import counted
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import MessageError
from dragon_ros.messages.surroundings import CellRules, Located, read_grid, read_venue
from dragon_ros.messages.transforms import FrameTree
from dragon_ros.messages.venue_markers import fits_message, obstacles_message
from dragon_ros.nodes import publishers, qos, shell
from dragon_ros.nodes.base import STEADY, DragonNode
from dragon_ros.nodes.logs import Seldom
from dragon_ros.nodes.raw_subscription import subscribe_raw
from dragon_ros.nodes.tf_publisher import TF
from dragon_ros.scenes.load import load_venue

_VENUE = 'venue'
_GRID = 'nav_msgs/msg/OccupancyGrid'
_PATIENCE_S = 5.0       # maximum time that the first tick waits for a known publisher's latched message
_ASKED_S = 0.05         # interval between checks of whether that message has arrived
_SAME = 1e-9            # metres and radians; smaller changes in a pose are ignored
_FRAMES_DEPTH = 100
_HERE: PlanePose = (0j, 1 + 0j)


class Obstacles:
    """Reads obstacles from their sources; ``changed`` is called with all obstacles when any of them change.

    If any obstacles come from a file or a map, ``publish`` is called with a message that contains the obstacles in use.
    """

    def __init__(self, node: DragonNode, changed: Callable[[Surroundings | None], None],
                 resume: Callable[[], None], publish: Callable[[bytes], None]) -> None:
        """Read the file and subscribe; ``resume`` is called when ``awaited`` becomes false.

        Raises InputError for an invalid file or pose.
        """
        value, row = node.setting, channels()[_VENUE]
        self._node, self._changed, self._resume, self._publish = node, changed, resume, publish
        self._pose = plane_pose('parameter venue_pose', value['venue_pose']) if value['venue_pose'] else None
        self._rules = CellRules(value['map_occupied'], value['map_unknown'] == 'occupied')
        self._file: Venue | None = load_venue(value['venue']) if value['venue'] else None
        self._located: dict[str, Located] = {}
        self._unused, self._faults = dict[str, str](), dict[str, str]()
        self._frame_id: str | None = None
        self._placed: list[tuple[str, int, PlanePose]] = []
        self._parts: list[tuple[str, Surroundings]] = []
        self._is_published = self._is_new = False
        self._tree: FrameTree | None = None
        self._has_frames = False
        self._seldom = Seldom(1.0)
        if self._file:
            self._located[f'file {value["venue"]}'] = Located(None, surroundings_of(self._file))
        topics = {_VENUE: (row.type, qos.of_channel(row), read_venue)}
        if value['map']:
            latched = qos.profile('reliable', 'transient_local', 1)
            topics[value['map']] = _GRID, latched, partial(read_grid, rules=self._rules)
        self._waiting = {node.resolve_topic_name(topic) for topic in topics}
        self._until_s: float | None = None
        self._timer = node.create_timer(_ASKED_S, self._ask, clock=STEADY)
        self._timer.cancel()
        self.venue = publishers.Publishers(node, node.resolve_topic_name(_VENUE))
        self._takers = [subscribe_raw(node, shell.message_type(kind), topic, partial(self._take, topic, read), profile)
                        for topic, (kind, profile, read) in topics.items()]

    def awaited(self) -> bool:
        """Return whether the first tick must wait because the message of a known publisher has not arrived yet."""
        if not self._waiting:
            return False
        late = [topic for topic in sorted(self._waiting) if self._node.count_publishers(topic)]
        now = time.monotonic()
        if self._until_s is None:
            self._until_s = now + _PATIENCE_S
        if late and now < self._until_s:
            self._timer.reset()
            return True
        if late:
            self._node.get_logger().warning(f'no obstacles arrived on {" and ".join(late)} within {_PATIENCE_S:g} s')
        self._waiting.clear()
        return False

    def wait(self) -> None:
        """Take messages in the calling callback, until the first tick need not wait any longer."""
        while self.awaited():
            time.sleep(_ASKED_S)
            for take in self._takers:
                take()

    def _ask(self) -> None:
        if not self.awaited():
            self._timer.cancel()
            self._resume()

    def see(self, frame_id: str, t_ns: int) -> None:
        """Record the frame of a tick, and publish the obstacles if this is the first tick at which they are used."""
        if frame_id != self._frame_id:
            self._frame_id = frame_id
            self._is_new = self._is_published
            self._place()
        if self._is_new:
            self._is_new = False
            self._publish(obstacles_message(self._published(), frame_id, t_ns))

    def _published(self) -> Surroundings | None:
        """Return the obstacles in use or, if there are too many, only those from the topic ``venue``."""
        around = _all([part for _, part in self._parts])
        if around is None or fits_message(around):
            return around
        self._node.get_logger().warning(
            f'obstacles from files and maps are not published, because they have more than {SHOWN_EDGES} edges or '
            'too many parts; a bag of this run will not contain them')
        return _all([part for source, part in self._parts if source == _VENUE])

    def look(self) -> None:
        """Apply the newest transforms to obstacles in other frames."""
        if self._tree:
            self._place()

    def _take(self, topic: str, read: Callable[[bytes], Located], data: bytes, _: Any) -> None:
        """Read a message; if it is invalid, keep the last valid one."""
        began_s = time.monotonic()
        try:
            located = read(data)
        except InputError as error:
            before = self._text(topic)
            self._fault(topic, f'{error}' + (f'; the last valid message stays in use: {before}' if before else ''))
        else:
            self._faults.pop(topic, None)
            if located.left_out:
                self._fault(topic, located.left_out)
            self._located[topic] = located
            self._node.get_logger().info(f'{topic}: {_counted(located.around)} in frame {located.frame_id!r}, '
                                         f'read in {time.monotonic() - began_s:.3f} s')
            if self._frame_id is not None:
                self._place()
        self._waiting.discard(self._node.resolve_topic_name(topic))

    def _fault(self, topic: str, why: str) -> None:
        """Note why a message, or a part of it, is not used."""
        self._faults[topic] = why
        self._node.get_logger().warning(f'{topic}: not used: {why}')

    def _place(self) -> None:
        """Transform all sources to the dragon's frame, and pass them on if anything changed."""
        before, self._unused = self._unused, {}
        placed = []
        for source, located in self._located.items():
            if located.around is None:
                continue
            try:
                placed.append((source, located, self._pose_of(located.frame_id)))
            except InputError as error:
                self._unused[source] = str(error)
        for source, why in self._unused.items():
            if before.get(source) != why:
                self._node.get_logger().warning(f'{source}: not used: {why}')
        key = [(source, id(located), pose) for source, located, pose in placed]
        if _alike(key, self._placed):
            return
        self._placed = key
        self._parts = [(source, located.around if pose == _HERE else located.around.moved(pose))
                       for source, located, pose in placed if located.around]
        self._changed(_all([part for _, part in self._parts]))
        self._is_published = self._is_new = self._is_published or any(source != _VENUE for source, _ in self._parts)
        self._node.get_logger().info(f"obstacles: {self._text() or 'none'}")

    def _pose_of(self, frame_id: str | None) -> PlanePose:
        """Return the pose of a frame in the dragon's frame. Raises MessageError if the pose is unknown."""
        if frame_id is None or frame_id.lstrip('/') == (self._frame_id or '').lstrip('/'):
            return _HERE
        if self._pose:
            return self._pose
        pose = self._frames().pose(frame_id, self._frame_id or '')
        if pose is None:
            where = 'and /tf and /tf_static do not connect them' if self._has_frames else (
                'and /tf cannot be read, because tf2_msgs is not installed')
            raise MessageError(f'its frame is {frame_id!r}, the frame of the dragon is {self._frame_id!r}, {where}; '
                               'give venue_pose:=X,Y,DEGREES (0,0,0 if the frames coincide)')
        return pose

    def _frames(self) -> FrameTree:
        """Return the known frames; on first use, subscribe to /tf and /tf_static."""
        if self._tree is None:
            self._tree = FrameTree()
            self._has_frames = shell.is_installed('tf2_msgs')
            if self._has_frames:
                static = QoSProfile(depth=_FRAMES_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
                for topic, profile in (('/tf', QoSProfile(depth=_FRAMES_DEPTH)), ('/tf_static', static)):
                    subscribe_raw(self._node, shell.message_type(TF), topic, self._take_frames, profile)
        return self._tree

    def _take_frames(self, data: bytes, _: Any) -> None:
        try:
            new = self._frames().take(data)
        except MessageError as error:
            if self._seldom():
                self._node.get_logger().warning(f'{error}')
            return
        if new and self._unused:
            self._place()

    def _text(self, only: str = '') -> str:
        """Return the obstacles in use, of all sources or of one."""
        return ', '.join(f'{_counted(self._located[source].around)} from {source}{_at(pose)}'
                         for source, _, pose in self._placed if only in ('', source))

    def statuses(self, dragon: str) -> list[DiagnosticStatus]:
        """Return a status for all obstacles (WARN, with the reasons, if any are unused), or [] if there are none."""
        unused = {**self._unused, **self._faults}
        if not self._located and not unused:
            return []
        values = {**{source: f'{_counted(self._located[source].around)}{_at(pose)}'
                     for source, _, pose in self._placed},
                  **{f'not used from {source}': why for source, why in unused.items()}}
        level = DiagnosticStatus.WARN if unused else DiagnosticStatus.OK
        message = '; '.join([self._text() or 'none', *(f'{source}: not used: {why}' for source, why in unused.items())])
        return [DiagnosticStatus(level=level, name=f'{dragon}: monitor: obstacles', hardware_id=dragon, message=message,
                                 values=[KeyValue(key=key, value=value) for key, value in values.items()])]


def _all(parts: list[Surroundings]) -> Surroundings | None:
    return None if not parts else parts[0] if len(parts) == 1 else joined(parts)


def _counted(around: Surroundings | None) -> str:
    return f'{counted(len(around.names), "obstacle")} with {counted(around.start.size, "edge")}' if around else (
        'no obstacles')


def _at(pose: PlanePose) -> str:
    shift, turn = pose
    return '' if pose == _HERE else f', moved to ({shift.real:.6g}, {shift.imag:.6g}) m, {degrees(phase(turn)):.6g} deg'


def _alike(one: list[tuple[str, int, PlanePose]], two: list[tuple[str, int, PlanePose]]) -> bool:
    """Return whether two lists of placed sources are equal except for tiny changes in the poses."""
    return len(one) == len(two) and all(a[:2] == b[:2] and all(abs(x - y) <= _SAME for x, y in zip(
        a[2], b[2], strict=True)) for a, b in zip(one, two, strict=True))
