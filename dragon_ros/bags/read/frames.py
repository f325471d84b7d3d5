"""The frames of a recorded dragon: handles, benches and velocities as arrays, read lazily, tick by tick."""
from collections import OrderedDict
from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np

from dragon_ros.bags.read.reader import END_OF_TIME_NS, BagReader, Message
from dragon_ros.core.chain.commanded import Commanded, Walked, profile_of, walked_from
from dragon_ros.core.errors import InputError
from dragon_ros.core.flags import Effect
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.venue import Surroundings
from dragon_ros.core.limits import COORDINATE_M, LED_TICKS, SCENE_CHARACTERS, WAITING_TICKS
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import NS, Scene
from dragon_ros.messages.bench_reader import BenchReader
from dragon_ros.messages.decode import (
    MessageError,
    Poses,
    is_empty_array,
    read_multi_array,
    read_odometry,
    read_stamp_ns,
    read_string,
    stamp_of_message,
)
from dragon_ros.messages.observation import ShownBenches, observation_of, read_handles
from dragon_ros.scenes.load import ABOUT, strangers_scene
from dragon_ros.scenes.provenance import ATTACHMENT, CLAIM, RECORD
from dragon_ros.scenes.yaml import parse_document

_TOPICS = ('handles', 'benches', 'velocities')
FRAME_ID = 'dragon'


@dataclass(frozen=True)
class BagFrame:
    """One tick of a bag; ``benches`` and ``velocity_m_s`` are None if they were not recorded.

    ``handles_m`` and ``velocity_m_s`` are of shape (N+1, 2). ``around`` holds the recorded obstacles.
    """

    t_ns: int
    handles_m: Floats
    benches: Benches | None
    velocity_m_s: Floats | None
    frame_id: str
    around: Surroundings | None = None

    @cached_property
    def clearance_m(self) -> float | None:
        """The smallest signed gap (m) between non-adjacent benches or to an obstacle; None if no benches were recorded.

        If all benches are adjacent and there are no obstacles, the gap is inf.
        """
        if self.benches is None:
            return None
        from dragon_ros.core.geometry.near_obstacles import with_obstacles  # imported lazily: few readers need it
        from dragon_ros.core.geometry.near_pairs import closeness
        found = closeness(self.handles_m, self.benches)
        return (with_obstacles(self.around, found, self.benches) if self.around else found).clearance_m


@dataclass
class _FrameParts:
    log_ns: int
    poses: Poses
    shown: ShownBenches | None = None
    velocity_m_s: Floats | None = None


def namespace_of(bag: BagReader, asked: str | None = None) -> str:
    """Return the namespace of the requested dragon, or of the only dragon with messages (failing that, with topics).

    Raises InputError if the namespace is missing or ambiguous.
    """
    topics = [topic for topic in bag.topics
              if topic.name.endswith('/handles') and topic.type == 'geometry_msgs/msg/PoseArray']
    found = sorted(topic.name.removesuffix('/handles')
                   for topic in [topic for topic in topics if topic.messages] or topics)
    named = found if asked is None else [name for name in found if name == f'/{asked.strip("/")}'.rstrip('/')]
    if len(named) == 1:
        return named[0]
    what = f'{len(found)} dragon{"s" * (len(found) > 1)} ({", ".join(found)})' if found else 'no dragon'
    which = 'give --namespace' if asked is None else f'none in --namespace {asked}'
    raise InputError(f'{bag.path}: contains {what}{"; " + which if found else ""} (a dragon has a topic '
                     'NAMESPACE/handles of type geometry_msgs/msg/PoseArray)')


def scene_of_bag(bag: BagReader, namespace: str | None = None, trust: bool = False) -> Scene | None:
    """Return the scene in a bag's metadata or messages, or None if the bag has no scene.

    Raises InputError for an invalid scene, or one that exceeds the budgets.
    """
    text = _scene_text(bag, namespace)
    return None if text is None else strangers_scene(f'{bag.path}: scene', text, trust)


def frame_of_bag(bag: BagReader, namespace: str | None = None) -> str:
    """Return the coordinate frame that a bag's scene names, or the default frame if it has no scene."""
    return str(about_of(bag, namespace).get('frame_id', FRAME_ID))


class RecordedObstacles:
    """The obstacles in a bag at successive ticks; obstacles in another coordinate frame are ignored.

    Obstacles come from the last message on the topic ``venue`` until the first stamp on the topic
    ``collision/obstacles``; from then on, they come from that topic, on which a monitor publishes all obstacles that it
    checks.
    """

    def __init__(self, bag: BagReader, namespace: str, frame_id: str) -> None:
        """Read the topic ``venue``; messages on the other topic are read as time advances."""
        self._frame_id = frame_id
        self._now: Surroundings | None = None
        for message in bag.messages([f'{namespace}/venue']):
            self._take(message)
        self._left = bag.messages([f'{namespace}/collision/obstacles'])
        self._next = next(self._left, None)

    @property
    def some(self) -> bool:
        """Whether there are obstacles at the current tick or a later one."""
        return self._now is not None or self._next is not None

    def at(self, t_ns: int) -> Surroundings | None:
        """Return the obstacles at a tick; calls must be in chronological order."""
        while self._next is not None and _marker_stamp_ns(self._next) <= t_ns:
            self._take(self._next)
            self._next = next(self._left, None)
        return self._now

    def _take(self, message: Message) -> None:
        from dragon_ros.messages.surroundings import read_venue  # imported lazily, because few bags have obstacles
        with suppress(MessageError):        # the message may be invalid, since a recorder stores whatever it receives
            located = read_venue(message.data)
            self._now = located.around if located.frame_id == self._frame_id else None


def _marker_stamp_ns(message: Message) -> int:
    """Return the stamp of a message's first marker, or the message's log time if it has no marker."""
    t_ns = None
    with suppress(MessageError):
        t_ns = stamp_of_message('visualization_msgs/msg/MarkerArray', message.data)
    return message.t_ns if t_ns is None else t_ns


def ends_in_contact(bag: BagReader, namespace: str | None = None) -> bool:
    """Return whether the scene in a bag ends the run at its first contact."""
    return about_of(bag, namespace).get('on_contact') in ('hold', 'stop')


def claimed_contact(bag: BagReader, namespace: str | None = None) -> Any:
    """Return the unverified claim about the first contact from a bag's scene, or None if there is no claim."""
    return about_of(bag, namespace).get(CLAIM)


def about_of(bag: BagReader, namespace: str | None) -> dict[str, Any]:
    """Return the ``about`` section of the scene file in a bag, or {} if the file is too long to read."""
    text = _scene_text(bag, namespace)
    if text is None or len(text) > SCENE_CHARACTERS:
        return {}
    return parse_document(f'{bag.path}: scene', text).section(ABOUT)


def _scene_text(bag: BagReader, namespace: str | None) -> str | None:
    """Return the scene file in a bag: from its metadata, its attachment or the latched topic ``scene``."""
    text = bag.metadata(RECORD).get('scene')
    if text is None:
        attached = bag.attachment(ATTACHMENT)
        text = _published_scene(bag, namespace) if attached is None else attached.decode(errors='replace')
    return text


def _published_scene(bag: BagReader, namespace: str | None) -> str | None:
    """Return the first message on a dragon's topic ``scene``, which bags from other recorders also contain."""
    try:
        topic = f'{namespace_of(bag) if namespace is None else namespace}/scene'
    except InputError:
        return None
    if not any(row.name == topic and row.type == 'std_msgs/msg/String' for row in bag.topics):
        return None
    first = next(bag.messages([topic]), None)
    return None if first is None else read_string(first.data)


def law_on(scene: Scene, law: Walked | None, t_ns: int, speed_m_s: float) -> Walked:
    """Return the head law of a led scene, extended by the next tick's speed; ``law`` is None before the first tick.

    Raises InputError for a speed that the scene does not allow.
    """
    settings, t_s = scene.head, scene.run.seconds(t_ns)
    assert isinstance(settings, Commanded)
    if not abs(speed_m_s) <= (settings.max_speed_m_s if law else 0.0):
        raise InputError(f'leader at {t_s:.9f} s: a speed of {speed_m_s!r} m/s; the scene allows '
                         f'{settings.max_speed_m_s:g} m/s, and 0 at the start')
    return law.walked_on(t_s, speed_m_s, keep_s(scene)) if law else walked_from(settings, t_s)


def keep_s(scene: Scene) -> float:
    """Return how many seconds of past speeds a tick of a led scene depends on: the duration of its trails."""
    return scene.trails.seconds if Effect.TRAILS in scene.effects else 0.0


@dataclass(frozen=True)
class Walk:
    """The scene of a bag; that of a led dragon has the recorded speeds as its profile, up to the first missing one.

    ``examined_s`` is the time up to which a led scene is known, and ``recorded_s`` that of the last recorded tick.
    """

    scene: Scene
    examined_s: float = inf
    recorded_s: float = inf

    @property
    def lack(self) -> str:
        """What keeps recorded ticks from being examined; empty if nothing does."""
        if self.examined_s >= self.recorded_s:
            return ''
        return (f'examined only to {self.examined_s:.9f} of {self.recorded_s:.9f} s, because the speed of the leader '
                'at the next tick is not in the bag')


def walk_in(bag: BagReader, scene: Scene, namespace: str) -> Walk:
    """Return the scene of a bag with the walk of its leader.

    Raises InputError if a led bag has several runs or too many ticks, or too many speed changes for a profile.
    """
    if not scene.is_led:
        return Walk(scene)
    assert isinstance(scene.head, Commanded)
    walked, law = [], None
    for k, message in enumerate(_without_copies(bag, f'{namespace}/leader')):
        t_ns, speed_m_s = read_odometry(message.data)
        if t_ns != scene.run.time_ns(k):
            break
        if k >= LED_TICKS:
            raise InputError(f'{bag.path}: its dragon was led for more than {LED_TICKS} ticks, the limit for '
                             'reading a run back')
        law = law_on(scene, law, t_ns, speed_m_s)
        walked.append((scene.run.seconds(t_ns), speed_m_s))
    if not walked:
        raise InputError(f'{bag.path}: its dragon was led from outside, but the speeds on topic leader do not begin '
                         'with the first tick; record a run from its beginning')
    last_s = walked[-1][0]
    led = replace(scene, head=profile_of(scene.head, walked), run=replace(scene.run, stop_s=last_s))
    return Walk(led, last_s, max(last_s, scene.run.seconds(_last_stamp_ns(bag, namespace))))


def _last_stamp_ns(bag: BagReader, namespace: str) -> int:
    """Return the latest stamp of handles."""
    return max((read_stamp_ns(message.data) for message in bag.messages([f'{namespace}/handles'])), default=0)


def _without_copies(bag: BagReader, topic: str) -> Iterator[Message]:
    """Yield the stamped messages of a topic once each. Raises InputError if their stamps go back to other messages."""
    last_ns, last = -1, b''
    for message in bag.messages([topic]):
        t_ns = read_stamp_ns(message.data)
        if t_ns > last_ns:
            last_ns, last = t_ns, message.data
            yield message
        elif (t_ns, message.data) != (last_ns, last):
            raise several_runs(bag, topic, t_ns)


def several_runs(bag: BagReader, topic: str, t_ns: int) -> InputError:
    """Return the error about a bag whose simulated time goes back to a time that it already has."""
    return InputError(f'{bag.path}: {topic} has several messages at {t_ns / NS:.9f} s, because the run was reset or '
                      'sought back while it was recorded: the bag holds several runs; record each to a bag of its own',
                      topic=topic, t_ns=t_ns)


def check_single_run(bag: BagReader, namespace: str) -> None:
    """Raise InputError if the handles in a bag belong to several runs; a message that occurs twice is no second run."""
    for _ in _without_copies(bag, f'{namespace}/handles'):
        pass


def log_times_are_ticks(bag: BagReader, namespace: str) -> bool:
    """Return whether log times are simulation times, as in this package's bags, rather than wall times.

    One message whose log time is its stamp suffices, because a wall time never is.
    """
    stamped = [f'{namespace}/handles']
    return all(not topic.messages for topic in bag.topics if topic.name in stamped) or any(
        read_stamp_ns(message.data) == message.t_ns for message in bag.messages(stamped))


def frames(bag: BagReader, namespace: str | None = None, start_ns: int | None = None,
           end_ns: int | None = None) -> Iterator[BagFrame]:
    """Yield the ticks of a bag with log times in start_ns <= t < end_ns, in order.

    Handles and benches are paired by their stamps. Velocities have no stamp; they belong to the handles with the same
    log time. Handles without benches are yielded alone. Raises InputError, which gives the topic and the time.
    """
    root = namespace_of(bag) if namespace is None else namespace
    yield from frames_of_part(bag, root, start_ns, end_ns, True)


def surrounded_frames(bag: BagReader, namespace: str, start_ns: int | None = None,
                      end_ns: int | None = None) -> Iterator[BagFrame]:
    """Yield the ticks of a bag, or of a range of its log times, in order, with the recorded obstacles."""
    recorded: RecordedObstacles | None = None
    for frame in frames(bag, namespace, start_ns, end_ns):
        recorded = recorded or RecordedObstacles(bag, namespace, frame.frame_id)
        yield replace(frame, around=recorded.at(frame.t_ns)) if recorded.some else frame


def frames_of_part(bag: BagReader, root: str, start_ns: int | None, end_ns: int | None,
                   is_last: bool) -> Generator[BagFrame, None, bool]:
    """Yield the ticks of a part of a bag, as ``frames`` does; return whether the whole bag would yield the same ticks.

    Returns False if, at the end of any part but the last, some handles have no benches or some benches have no handles;
    such incomplete ticks are not yielded.
    """
    names = {topic.name: name for name in _TOPICS for topic in bag.topics if topic.name == f'{root}/{name}'}
    ticks = _Ticks('benches' not in names.values())
    for message in bag.messages(list(names), start_ns, end_ns):
        yield from _frames(bag, root, ticks.ready(message.t_ns))
        try:
            is_new = ticks.add(names[message.topic], message)
        except MessageError as error:
            raise MessageError(f'{bag.path}: {message.topic} at {message.t_ns} ns: {error}') from None
        if not is_new:
            raise several_runs(bag, message.topic, read_stamp_ns(message.data))
    if not (is_last or ticks.are_complete):
        return False
    yield from _frames(bag, root, ticks.ready(END_OF_TIME_NS))
    return True


def _frames(bag: BagReader, root: str, ticks: Iterator[_FrameParts]) -> Iterator[BagFrame]:
    for parts in ticks:
        try:
            yield _frame(parts)
        except MessageError as error:
            raise MessageError(f'{bag.path}: {root} at {parts.poses.t_ns} ns: {error}') from None


class _Ticks:
    """Groups messages by tick, in bounded memory."""

    def __init__(self, alone: bool) -> None:
        """Set ``alone`` if the bag has no benches, so that handles need not wait for them."""
        self._alone = alone
        self._waiting: OrderedDict[int, _FrameParts] = OrderedDict()
        self._early: OrderedDict[int, ShownBenches] = OrderedDict()
        self._benches = BenchReader()
        self._speeds: tuple[int, Floats] | None = None
        self._last = -1, b''

    def add(self, name: str, message: Message) -> bool:
        """Add one message; return False for other handles at a time that was read before. Raises MessageError."""
        if name == 'handles':
            poses = read_handles(message.data)
            if poses.t_ns <= self._last[0]:
                return (poses.t_ns, message.data) == self._last     # a message that was recorded twice
            self._last = poses.t_ns, message.data
            speeds = self._speeds[1] if self._speeds and self._speeds[0] == message.t_ns else None
            self._waiting[poses.t_ns] = _FrameParts(message.t_ns, poses, self._early.pop(poses.t_ns, None), speeds)
        elif name == 'benches':
            if not is_empty_array(message.data):
                self._add_benches(self._benches.read(message.data))
        else:
            self._add_speeds(message.t_ns, _velocities(message.data))
        return True

    @property
    def are_complete(self) -> bool:
        """Whether no message is missing: all handles have benches, and all benches have handles."""
        return not self._early and (self._alone or all(parts.shown for parts in self._waiting.values()))

    def _add_benches(self, shown: ShownBenches) -> None:
        if shown.t_ns in self._waiting:
            self._waiting[shown.t_ns].shown = shown
            return
        self._early[shown.t_ns] = shown
        if len(self._early) > WAITING_TICKS:
            self._early.popitem(last=False)

    def _add_speeds(self, log_ns: int, velocity: Floats) -> None:
        self._speeds = log_ns, velocity
        for parts in self._waiting.values():
            if parts.log_ns == log_ns:
                parts.velocity_m_s = velocity

    def ready(self, now_ns: int) -> Iterator[_FrameParts]:
        """Yield, in order, the ticks that are complete at log time ``now_ns``."""
        while self._waiting:
            first = next(iter(self._waiting.values()))
            hopeless = now_ns == END_OF_TIME_NS or len(self._waiting) > WAITING_TICKS
            if first.log_ns >= now_ns or not (first.shown or self._alone or hopeless or self._overtaken()):
                return
            yield self._waiting.popitem(last=False)[1]

    def _overtaken(self) -> bool:
        """Return whether the benches of a later tick have been read."""
        return any(parts.shown for parts in self._waiting.values())


def _velocities(data: bytes) -> Floats:
    labels, values = read_multi_array(data)
    if values.ndim != 2 or values.shape[1] < 2:
        raise MessageError(f'velocities: {labels} of shape {values.shape}; expected rows of vx, vy, speed')
    if np.any(np.abs(values) > COORDINATE_M):
        raise MessageError(f'velocities: a speed of more than {COORDINATE_M:g} m/s')
    return np.ascontiguousarray(values[:, :2], dtype=np.float64)


def _frame(parts: _FrameParts) -> BagFrame:
    poses, velocity = parts.poses, parts.velocity_m_s
    if velocity is not None and len(velocity) != len(poses.poses):
        raise MessageError(f'velocities: {len(velocity)} for {len(poses.poses)} handles')
    if parts.shown is None:
        handles = np.ascontiguousarray(poses.poses[:, :2], dtype=np.float64)
        return BagFrame(poses.t_ns, handles, None, velocity, poses.frame_id)
    observation = observation_of(poses, parts.shown)
    return BagFrame(observation.t_ns, observation.p, observation.benches, velocity, observation.frame_id)
