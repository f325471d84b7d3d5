"""The source of a replay: the messages of a bag as frames, one per log time, with a current position."""
from collections import Counter
from collections.abc import Callable, Iterator, Mapping

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy

from dragon_ros.bags.read.reader import BagReader, Message
from dragon_ros.core.errors import FieldError
from dragon_ros.core.limits import REPLAYED_BYTES
from dragon_ros.core.scene import NS
from dragon_ros.messages.channels import channels
from dragon_ros.nodes import publisher_queue

_EACH_BYTES = 256       # memory, in bytes, that a message uses in addition to its data


class ReplaySource:
    """Publishes the messages from ``start_ns`` to ``end_ns`` (both included) on the publishers of their topics.

    At the start and after a seek, each latched topic publishes its message for that time: before the other messages or,
    for the reports of a monitor, after them. A report without a stamp belongs to the tick before it.
    """

    def __init__(self, bag: BagReader, publishers: Mapping[str, Publisher], start_ns: int, end_ns: int,
                 warn: Callable[[str], object]) -> None:
        """Start before the first message.

        The functions in ``also`` are called with each log time before its messages are published. ``warn`` is called
        once per topic with a message that cannot be published.
        """
        self.also: list[Callable[[int], None]] = []
        self.published: Counter[str] = Counter()
        self.watched: dict[str, Message | None] = {}        # the last message shown, by topic
        self._bag, self._publishers, self._start_ns, self._end_ns = bag, publishers, start_ns, end_ns
        self._latched = {topic for topic, publisher in publishers.items()
                         if publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL}
        reports = tuple(f'/{name}' for name, row in channels().items() if row.publisher == 'monitor')
        self._ranks = {topic: 2 if topic.endswith(reports) else 0 for topic in self._latched}
        self._queue, self._last_ns = publisher_queue.PublisherQueue(warn), start_ns
        self._messages: Iterator[Message]
        self._next: Message | None
        self._starts: bool
        self._go_to(start_ns)

    def next_ns(self) -> int | None:
        """Return the log time of the next messages, or None at the end."""
        return self._next.t_ns if self._next and self._next.t_ns <= self._end_ns else None

    def first_ns(self) -> int:
        """Return the start time."""
        return self._start_ns

    def last_ns(self) -> int:
        """Return the end time."""
        return self._end_ns

    def show(self) -> None:
        """Publish the messages with the next log time and advance."""
        assert self._next is not None
        self._last_ns = self._next.t_ns
        for observe in self.also:
            observe(self._last_ns)
        frame = self._take()
        if self._starts:
            frame = sorted((*self._before(), *frame), key=lambda message: self._ranks.get(message.topic, 1))
            self._starts = False
        for message in frame:
            self._queue.put(self._publishers[message.topic], message.data)
            self.published[message.topic] += 1
            if message.topic in self.watched:
                self.watched[message.topic] = message
        self.flush()

    @property
    def left_out(self) -> int:
        """The number of messages that could not be published because they are too long for their type."""
        return self._queue.left_out.total()

    def flush(self) -> bool:
        """Publish messages held back by slow readers; return whether none remain."""
        return self._queue.flush()

    def rewind(self) -> None:
        """Move to the first message."""
        self._go_to(self._start_ns)

    def seek(self, t_ns: int | None) -> None:
        """Move to the last messages at or before ``t_ns`` (None: the first). Raises FieldError (see ``check_time``)."""
        if t_ns is None:
            self.rewind()
            return
        self.check_time(t_ns)
        last = self._start_ns
        for message in self._bag.messages(list(self._publishers), max(self._start_ns, t_ns - NS)):
            if message.t_ns > t_ns:
                break
            last = message.t_ns
        self._go_to(last if last > self._start_ns else self._last_before(t_ns))

    def stamp_ns(self, t_s: float) -> int:
        """Return a log time in nanoseconds."""
        return round(t_s * NS)

    def seconds(self, t_ns: int) -> float:
        """Return a log time in seconds."""
        return t_ns / NS

    def check_time(self, t_ns: int) -> None:
        """Raise FieldError if ``t_ns`` is outside the played part."""
        if not self._start_ns <= t_ns <= self._end_ns:
            raise FieldError('seek_s', t_ns / NS, f'the played part goes from {self._start_ns / NS:.9g} s to '
                             f'{self._end_ns / NS:.9g} s', 'give a time in this range')

    def place(self) -> str:
        """Describe the position of the last messages shown."""
        return f'at {self._last_ns / NS:.3f} s of {self._end_ns / NS:.3f} s'

    def ending(self) -> str:
        """Return why there is no next message."""
        return f'the bag ends at {self._end_ns / NS:.6f} s'

    def _go_to(self, t_ns: int) -> None:
        self._from_ns, self._starts = t_ns, True
        self._messages = iter(self._bag.messages(list(self._publishers), t_ns))
        self._next = next(self._messages, None)

    def _take(self) -> list[Message]:
        """Return the messages with the next log time, up to the budget for messages in memory."""
        assert self._next is not None
        frame, t_ns, size = [], self._next.t_ns, 0
        while self._next is not None and self._next.t_ns == t_ns and size <= REPLAYED_BYTES:
            frame.append(self._next)
            size += len(self._next.data) + _EACH_BYTES
            self._next = next(self._messages, None)
        return frame

    def _last_before(self, t_ns: int) -> int:
        """Return the log time of the last message at or before ``t_ns``, found in a pass over all messages."""
        last = self._start_ns
        for message in self._bag.messages(list(self._publishers), self._start_ns):
            if message.t_ns > t_ns:
                break
            last = message.t_ns
        return last

    def _before(self) -> list[Message]:
        """Return the last message of each latched topic before the start time."""
        found: dict[str, Message] = {}
        if self._latched and self._from_ns > self._bag.start_ns:
            for message in self._bag.messages(sorted(self._latched)):
                if message.t_ns >= self._from_ns:
                    break
                found[message.topic] = message
        return list(found.values())
