"""Publish bytes: wait for subscribers, and queue messages while readers are slower than the publisher."""
import re
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message

from dragon_ros.core.errors import InputError, shown
from dragon_ros.core.limits import SUBSCRIBERS
from dragon_ros.core.step import Frame
from dragon_ros.messages.fixed_size import Encode, Together, each
from dragon_ros.nodes import shell
from dragon_ros.nodes.params import DISCOVERY_S

_COUNT = re.compile('[0-9]{1,9}')
_GIVE_UP = 20       # maximum number of consecutive failures (0.1 s each) while there is no subscriber
_SETTLED_S = 0.5    # quiet time required after a discovery, because a reader's topics are discovered one by one
_ACKED_S = 4.0      # maximum wait for acknowledgements, which follow the middleware's heartbeat (3 s in Fast DDS)
_ALL_ACKED_S = 20.0     # maximum wait at the end of a run, when a reader may not have read any messages yet
_LOOK_S = 0.02


def wanted_readers(texts: Iterable[str], publishers: Mapping[str, Publisher]) -> list[tuple[Publisher, int]]:
    """Return pairs (publisher, number of subscribers to wait for) from strings like handles=2. Raises InputError."""
    wanted = []
    for text in filter(None, texts):
        name, _, count = text.partition('=')
        if name not in publishers or not _COUNT.fullmatch(count) or int(count) > SUBSCRIBERS:
            raise InputError(f'wait_subscribers: {shown(text)} is not TOPIC=NUMBER with a number up to {SUBSCRIBERS}; '
                             f'the topics are {", ".join(publishers)}')
        wanted.append((publishers[name], int(count)))
    return wanted


def discovery_of(discovery_s: float, texts: Iterable[str]) -> float:
    """Return how many seconds to wait for discovery, which a negative value leaves to the names of readers."""
    return discovery_s if discovery_s >= 0 else 0.0 if any(texts) else DISCOVERY_S


class StartGate:
    """Decides when the first message may be sent, so that awaited and discovered readers receive it.

    Existing readers are not discovered immediately. With Fast DDS, a participant announces itself every 3 s and repeats
    its subscriptions every second. A new participant may miss the first of these messages, because an existing
    participant answers before the new participant can identify it. The new participant then discovers the reader 1 s to
    4 s later.
    """

    def __init__(self, publishers: Mapping[str, Publisher], texts: Iterable[str], discovery_s: float) -> None:
        """Wait for the subscribers in ``texts``, such as handles=2, and for discovery. Raises InputError."""
        self._wanted, self._publishers = wanted_readers(texts, publishers), tuple(publishers.values())
        discovery_s = discovery_of(discovery_s, texts)
        self._found, self._changed_s = 0, time.monotonic()
        self._end_s = self._changed_s + discovery_s
        self._settled_s = min(_SETTLED_S, discovery_s)

    def is_open(self) -> bool:
        """Return whether all awaited readers are present and discovery, after enough time, finds nothing new."""
        now, found = time.monotonic(), sum(publisher.get_subscription_count() for publisher in self._publishers)
        if found != self._found:
            self._found, self._changed_s = found, now
        there = all(publisher.get_subscription_count() >= count for publisher, count in self._wanted)
        return there and now >= max(self._end_s, min(self._changed_s, self._end_s) + self._settled_s)


class PublisherQueue:
    """A queue of outgoing messages, which wait while readers are slower than a lossless publisher."""

    def __init__(self, warn: Callable[[str], object] = lambda line: None) -> None:
        """Start empty; ``warn`` is called once per topic with a message that cannot be published."""
        self._waiting: deque[tuple[Publisher, bytes]] = deque()
        self._alone, self._warn = 0, warn
        self.left_out: Counter[str] = Counter()

    def put(self, publisher: Publisher, data: bytes) -> None:
        """Append a message."""
        self._waiting.append((publisher, data))

    def flush(self) -> bool:
        """Publish queued messages; return False if a reader's full queue still blocks some of them after 0.1 s."""
        while self._waiting:
            publisher, data = self._waiting[0]
            try:
                publisher.publish(data)
            except RuntimeError:        # the error of the middleware, whose own class is private
                if not can_hold(publisher.msg_type, len(data)):
                    self._leave_out(publisher, len(data))
                    continue
                self._alone = 0 if publisher.get_subscription_count() else self._alone + 1
                if self._alone > _GIVE_UP:
                    raise
                return False
            self._alone = 0
            self._waiting.popleft()
        return True

    def _leave_out(self, publisher: Publisher, size: int) -> None:
        """Drop and count the first message, which is too long for its type; report its topic once."""
        topic = publisher.topic_name
        if not self.left_out[topic]:
            self._warn(f'{topic}: messages that are too long for their type are left out; the first has {size} bytes')
        self.left_out[topic] += 1
        self._waiting.popleft()


def can_hold(kind: Any, size: int) -> bool:
    """Return whether messages of a type can be ``size`` bytes long.

    The middleware raises the same error for a reader's full queue and for a message that is too long for its type.
    """
    most = _largest(kind)
    return most is None or size <= most


@cache
def _largest(kind: Any) -> int | None:
    """Return the size in bytes of a type with a fixed size, padded as on the wire, or None for any other type."""
    if not all(map(_is_fixed, kind.get_fields_and_field_types().values())):
        return None
    size = len(serialize_message(kind()))
    return size + -size % 4


def _is_fixed(name: str) -> bool:
    """Return whether a field's type has a fixed size, given its name: double, double[36], geometry_msgs/Point."""
    if name.startswith(('sequence<', 'string', 'wstring')):
        return False
    package, _, kind = name.partition('[')[0].partition('/')
    return not kind or _largest(shell.message_type(f'{package}/msg/{kind}')) is not None


class EncodedTopic:
    """One topic of ``sim``, encoded only while it has subscribers."""

    def __init__(self, publisher: Publisher, encode: Encode) -> None:
        """Publish frames on ``publisher``, encoded by ``encode``."""
        self.publisher, self._encode = publisher, encode
        self._latched = publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        self._encoded: deque[tuple[Frame, bytes]] = deque()
        self.published = 0

    def put(self, together: Together, queue: PublisherQueue) -> None:
        """Queue the message of the first of several frames; nothing is encoded if there are no subscribers.

        A late subscriber receives only later frames, as with any volatile topic. A latched topic is always published,
        and keeps its last message for late subscribers. The other frames, which probably follow, are encoded too,
        because encoding frames together takes less time.
        """
        if self._latched or self.publisher.get_subscription_count():
            if not (self._encoded and self._encoded[0][0] is together.frames[0]):
                self._encoded = deque(zip(together.frames, each(self._encode, together), strict=True))
            queue.put(self.publisher, self._encoded.popleft()[1])
            self.published += 1


def drain(publishers: Iterable[Publisher], stop: threading.Event, warn: Callable[[str], object]) -> None:
    """Wait until readers have received all messages, since messages are lost when their publisher is destroyed.

    After a signal, the maximum wait is shorter. ``warn`` is called if some readers do not answer in time.
    """
    begin = time.monotonic()
    for publisher in publishers:
        while publisher.get_subscription_count() and not publisher.wait_for_all_acked(Duration()):
            longest_s = _ACKED_S if stop.is_set() else _ALL_ACKED_S
            if time.monotonic() > begin + longest_s:
                warn(f'{publisher.topic_name}: not all readers acknowledged the last messages within {longest_s:g} s; '
                     'some readers may not have received them')
                return
            time.sleep(_LOOK_S)     # uses the steady clock; a wait in the middleware may follow the system clock
