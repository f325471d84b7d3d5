"""A thread that writes a bag from a queue of bounded size."""
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial

from dragon_ros.bags.write.writer import MB, BagWriter

_AT_ONCE_BYTES = 500_000        # queued bytes that wake the thread, since a wake-up costs as much as several writes
_Job = tuple[int, Callable[[], object]]      # size in bytes, and the write


class WriterThread:
    """Accepts messages immediately and writes them in order; the file is flushed every ``flush_s`` seconds.

    All messages come from one thread. If the queue is full, a ``patient`` write waits, and the wait is counted; nothing
    is dropped here. After an error, which is stored in ``error``, nothing more is written.
    """

    def __init__(self, bag: BagWriter, flush_s: float = 1.0, queue_mb: float = 256.0) -> None:
        """Start the thread."""
        self._bag, self._flush_s, self._room = bag, flush_s, int(queue_mb * MB)
        self._jobs: deque[_Job] = deque()
        # The bytes queued and written so far. Only one thread changes each of these numbers, and a deque may be shared,
        # so queueing a message takes no lock.
        self._put_bytes = self._done_bytes = 0
        self._enough = min(_AT_ONCE_BYTES, self._room // 2)
        self._due = False       # whether to write before the next flush
        self._changed = threading.Condition()
        self._closing = False
        self.error: Exception | None = None
        self.fullest_bytes = self.waits = 0
        self.waited_s = self.slowest_write_s = 0.0
        self._thread = threading.Thread(target=self._work, name='bag')
        self._thread.start()

    def write(self, topic: str, data: bytes, t_ns: int, sequence: int, publish_ns: int, patient: bool = True) -> None:
        """Queue one message. If ``patient``, wait while the queue is full; otherwise the caller must check ``fill``."""
        self._put(len(data), partial(self._bag.write, topic, data, t_ns, sequence, publish_ns), False, patient)

    def describe(self, name: str, values: dict[str, str]) -> None:
        """Queue a metadata record."""
        self._put(0, partial(self._bag.describe, name, values))

    def attach(self, name: str, media_type: str, content: bytes) -> None:
        """Queue an attachment."""
        self._put(len(content), partial(self._bag.attach, name, media_type, content))

    def _put(self, size: int, write: Callable[[], object], at_once: bool = True, patient: bool = True) -> None:
        if patient and self._waiting > self._room:
            self._wait()
        self._put_bytes += size
        self._jobs.append((size, write))
        waiting = self._waiting
        if waiting > self.fullest_bytes:
            self.fullest_bytes = waiting
        if not self._due and (at_once or waiting >= self._enough):
            with self._changed:
                self._due = True
                self._changed.notify_all()

    @property
    def _waiting(self) -> int:
        """The number of queued bytes."""
        return self._put_bytes - self._done_bytes

    @property
    def fill(self) -> float:
        """The fill level of the queue; 1 is full."""
        return self._waiting / self._room

    @property
    def fullest(self) -> float:
        """The largest fill level of the queue; 1 is full."""
        return self.fullest_bytes / self._room

    def stop(self) -> None:
        """Write the queued messages and end the thread; the bag stays open. Repeated calls are harmless."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _wait(self) -> None:
        start = time.monotonic()
        self.waits += 1
        with self._changed:
            self._changed.wait_for(lambda: self._waiting <= self._room)
        self.waited_s += time.monotonic() - start

    def _work(self) -> None:
        due = time.monotonic() + self._flush_s
        while not (self._closing and not self._jobs):
            with self._changed:
                self._changed.wait_for(lambda: self._due or self._closing, max(0.0, due - time.monotonic()))
                self._due = False
            for _ in range(len(self._jobs)):
                size, write = self._jobs.popleft()      # each message is released once it is written
                self._do(write)
                self._done_bytes += size
                if self.waits:
                    with self._changed:
                        self._changed.notify_all()
            if time.monotonic() >= due:
                self._do(self._bag.flush)
                due = time.monotonic() + self._flush_s

    def _do(self, write: Callable[[], object]) -> None:
        """Execute one write; after an error, nothing more is written."""
        if self.error is not None:
            return
        start = time.monotonic()
        try:
            write()
        except Exception as error:  # noqa: BLE001 - any error must end the recording, and not this thread alone
            self.error = error
        self.slowest_write_s = max(self.slowest_write_s, time.monotonic() - start)
