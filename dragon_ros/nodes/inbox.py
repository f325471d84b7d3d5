"""Hold messages that have arrived at a node until they are read, within a budget."""
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from dragon_ros.core.limits import INBOX_BYTES, INBOX_MESSAGES
from dragon_ros.messages.decode import MessageError, stamp_of_message
from dragon_ros.messages.skipping import FROM_FILL, TickSkipper
from dragon_ros.nodes import raw_subscription
from dragon_ros.nodes.base import STEADY, DragonNode
from dragon_ros.nodes.publishers import Publishers

_SLICE_S = 0.01     # maximum time spent reading before new messages are taken


class Inbox:
    """Takes messages as they arrive, so that the middleware drops none, and passes them on in order.

    A node that falls behind skips whole ticks, evenly spaced. If the publisher waits for its readers, however, the node
    reads all waiting messages instead of skipping any.
    """

    def __init__(self, node: DragonNode, sources: dict[str, Publishers], read: Callable[[str, bytes, Any], None],
                 rest: Callable[[], None], tell: Callable[[], None], held: Callable[[], bool],
                 wait: Callable[[], None]) -> None:
        """``sources`` maps topics to publishers; ``rest`` is called after some messages have been read.

        ``tell`` is called when a tick is skipped. Messages wait while ``held()`` is true; call ``work`` afterwards.
        ``wait()`` returns when ``held()`` is false; a publisher that waits for its readers waits for this, too.
        """
        self._sources, self._read, self._rest, self._tell = sources, read, rest, tell
        self._held, self._wait = held, wait
        self._waiting: deque[tuple[str, bytes, Any]] = deque()
        self._bytes, self._skips = 0, TickSkipper()
        self._timer = node.create_timer(0.0, self.work, clock=STEADY)
        self._timer.cancel()

    @property
    def skipped(self) -> int:
        """The number of ticks skipped so far."""
        return self._skips.skipped

    @property
    def waiting(self) -> int:
        """The number of messages that have not been read yet."""
        return len(self._waiting)

    @property
    def fill(self) -> float:
        """The fraction of the budget in use."""
        return max(self._bytes / INBOX_BYTES, len(self._waiting) / INBOX_MESSAGES)

    def put(self, topic: str, kind: str, data: bytes, info: Any) -> None:
        """Add a message of type ``kind``, unless its tick is skipped."""
        source, before = self._sources[topic], self.skipped
        source.arrived(raw_subscription.number(info))
        if self.fill > FROM_FILL and source.waits():
            self._wait()
            self._work_until(float('inf'))
        if self._keeps(topic, kind, data):
            self._waiting.append((topic, data, info))
            self._bytes += len(data)
            self._stay_within_budget()
        if self.skipped > before:
            self._tell()

    def _stay_within_budget(self) -> None:
        """Read the first messages if the inbox is too full: a kept tick is whole, and some parts of it arrive late."""
        while self.fill > 1 and not self._held():
            self._read_one()

    def _keeps(self, topic: str, kind: str, data: bytes) -> bool:
        try:
            t_ns = stamp_of_message(kind, data)
        except MessageError:
            return True     # an invalid message is rejected when it is read
        return t_ns is None or self._skips.keeps(topic, t_ns, self.fill)

    def work(self) -> None:
        """Read waiting messages for a few milliseconds, and schedule another call if some remain."""
        held = bool(self._waiting) and self._held()
        if not held:
            self._work_until(time.monotonic() + _SLICE_S)
        if held or not self._waiting:
            self._timer.cancel()
        elif self._timer.is_canceled():
            self._timer.reset()

    def _work_until(self, end_s: float) -> None:
        while self._waiting and time.monotonic() < end_s:
            self._read_one()
        self._rest()

    def _read_one(self) -> None:
        message = self._waiting.popleft()
        self._bytes -= len(message[1])
        self._read(*message)
