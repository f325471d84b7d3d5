"""``replay``: publishes a bag on its topics with the recorded timing, and offers playback controls."""
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

from rclpy.publisher import Publisher

from dragon_ros.bags.read.frames import namespace_of
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.core.errors import FieldError, InputError
from dragon_ros.core.scene import NS
from dragon_ros.core.words import counted
from dragon_ros.nodes import clock, keys, publisher_queue, qos, shell
from dragon_ros.nodes.base import DragonNode
from dragon_ros.nodes.entities import TOPICS, Bodies, bodies_of_messages
from dragon_ros.nodes.params import REPLAY
from dragon_ros.nodes.playback import STANDARD, Player
from dragon_ros.nodes.replay_source import ReplaySource

_JUMP_S = 5.0


class Choice(NamedTuple):
    """The part of a bag to play: seconds from its start, topics (None for all), and subscribers to wait for.

    ``into`` is the namespace in which the bag's only dragon is published; None means the recorded namespace.
    """

    start_s: float = 0.0
    end_s: float | None = None
    topics: list[str] | None = None
    wait_subscribers: tuple[str, ...] = ()
    into: str | None = None


class Replay(DragonNode):
    """Publishes the bytes of a bag under the recorded names, in any executor; ``player.done`` is true at the end."""

    def __init__(self, bag: BagReader, choice: Choice, **overrides: Any) -> None:
        """Advertise the topics of the bag with their recorded QoS. Raises InputError for an invalid choice."""
        super().__init__('replay', REPLAY, overrides)
        start_ns, end_ns = span_of(bag, choice)
        self._lossless = self.setting['time_scale'] == 0
        self.topic_publishers = self._advertise(bag, choice)
        self.source = ReplaySource(bag, self.topic_publishers, start_ns, end_ns,
                                   self.get_logger().warning)
        self.late_us: Counter[int] = Counter()
        waited = [full_name(text, bag) for text in choice.wait_subscribers]
        gate = publisher_queue.StartGate(self.topic_publishers, waited, self.setting['discovery_s'])
        self.player = Player(self, self.source, self.setting['time_scale'], gate.is_open)
        if shell.is_installed(STANDARD):
            from dragon_ros.nodes.simulation_interfaces import SimulationInterfaces
            SimulationInterfaces(self, self.player, self._watched(bag))
        self.source.also.append(self._note_late)
        if self.setting['publish_clock'] and clock.TOPIC not in self.topic_publishers:      # else the recorded one
            self.source.also.append(clock.ClockPublisher(self, start_ns).publish)

    @property
    def actions(self) -> dict[str, Callable[[], str]]:
        """The action for each key."""
        player = self.player
        return {' ': lambda: player.resume() if player.paused else player.pause(), 's': player.step,
                keys.RIGHT: lambda: self._jump(_JUMP_S), keys.LEFT: lambda: self._jump(-_JUMP_S)}

    def refuse(self, name: str, value: Any) -> None:
        """Raise DragonError if a live parameter must not be set to this value."""
        if name == 'seek_s' and value >= 0:
            self.source.check_time(round(value * NS))
        if name == 'time_scale' and value == 0 and not self._lossless:
            raise FieldError('time_scale', value, 'a lossless replay needs lossless topics from the start',
                             'start the replay with --rate 0, or set a value above 0')

    def changed(self, name: str) -> None:
        """Apply a new speed."""
        if name == 'time_scale':
            self.player.set_speed(self.setting['time_scale'])

    def summary(self) -> str:
        """Return a message about how many messages were published and how late they were."""
        left = self.source.left_out
        done = f'{counted(self.source.published.total() - left, "message")} published'
        done += f', {left} left out' if left else ''
        if not self.late_us:
            return f'{done}, as fast as the readers could follow'
        return (f'{done}; late by {quantile(self.late_us, 0.5)} µs (median), '
                f'{quantile(self.late_us, 0.99)} µs (99th percentile) and {max(self.late_us)} µs (worst)')

    def _advertise(self, bag: BagReader, choice: Choice) -> dict[str, Publisher]:
        """Return the publishers, keyed by the recorded names of their topics."""
        wanted = None if choice.topics is None else {full_name(name, bag) for name in choice.topics}
        rows = [row for row in bag.topics if wanted is None or row.name in wanted]
        profiles = {row.name: qos.of_bag(row.qos) for row in rows}
        root = None if choice.into is None else namespace_of(bag)
        names = {row.name: moved(row.name, root, choice.into or '') for row in rows}
        return {row.name: self.create_publisher(
            shell.message_type(row.type), names[row.name],
            qos.waiting(profiles[row.name]) if self._lossless else profiles[row.name]) for row in rows}

    def _watched(self, bag: BagReader) -> Callable[[], Bodies | None] | None:
        """Return a getter for the last handles and benches shown, or None unless exactly one dragon is played."""
        try:
            root = namespace_of(bag)
        except InputError:
            return None
        if f'{root}/handles' not in self.topic_publishers:
            return None
        watched = {f'{root}/{name}': name for name in TOPICS}
        self.source.watched = dict.fromkeys(watched)
        return lambda: bodies_of_messages({name: message for topic, name in watched.items()
                                           if (message := self.source.watched[topic])})

    def _note_late(self, _: int) -> None:
        if self.player.pacer.scale:
            self.late_us[min(self.player.pacer.late_ns // 1000, 10**6)] += 1

    def _jump(self, by_s: float) -> str:
        """Seek relative to the current position, at most to the start or the end of the played part."""
        t_ns = (self.player.pacer.last_ns or 0) + round(by_s * NS)
        return self.player.seek_to(min(max(t_ns, self.source.first_ns()), self.source.last_ns()))


def moved(topic: str, root: str | None, into: str) -> str:
    """Return the name under which a topic is published; topics below ``root`` move to the namespace ``into``."""
    inside = root is not None and topic.startswith(f'{root}/')
    return f'/{into.strip("/")}/{topic.removeprefix(f"{root}/")}'.replace('//', '/') if inside else topic


def full_name(name: str, bag: BagReader) -> str:
    """Return the recorded name of a topic; a relative name belongs to the bag's only dragon. Raises InputError."""
    return name if not name or name.startswith('/') else f'{namespace_of(bag)}/{name}'


def span_of(bag: BagReader, choice: Choice) -> tuple[int, int]:
    """Return the first and the last log time to play. Raises InputError if the choice is outside the bag."""
    length_s = (bag.end_ns - bag.start_ns) / NS
    if not 0 <= choice.start_s <= length_s:
        raise InputError(f'--start {choice.start_s:g}: the bag is {length_s:g} s long; give 0 to {length_s:g}')
    if choice.end_s is not None and not choice.start_s <= choice.end_s:
        raise InputError(f'--end {choice.end_s:g}: it must not be before --start {choice.start_s:g}')
    known = [row.name for row in bag.topics]
    for name in choice.topics or []:
        if full_name(name, bag) not in known:
            raise InputError(f'--topics {name}: it is not in the bag; choose from {", ".join(known)}')
    end_ns = bag.end_ns if choice.end_s is None else bag.start_ns + round(min(length_s, choice.end_s) * NS)
    return bag.start_ns + round(choice.start_s * NS), end_ns


def quantile(counts: Counter[int], part: float) -> int:
    """Return the smallest value that is at least as large as a fraction ``part`` of the counted values."""
    left = part * counts.total()
    for value in sorted(counts):
        left -= counts[value]
        if left <= 0:
            return value
    return max(counts, default=0)


def run(bag: BagReader, choice: Choice, given: dict[str, Any], stop: threading.Event) -> int:
    """Replay a bag in a new executor; return the exit code."""
    node = Replay(bag, choice, **given)
    try:
        with keys.keys(node, node.actions) as listens:
            if listens:
                node.get_logger().info('keys: space pauses and resumes, s steps, the arrows seek 5 s')
            code = shell.spin(node, stop, lambda: node.player.done)
        node.get_logger().info(node.summary())
        publisher_queue.drain(node.topic_publishers.values(), stop, node.get_logger().warning)
        return code
    finally:
        node.destroy_node()
