"""Publish frames on their topics, one by one, as a player shows them."""
from collections.abc import Callable, Iterable

from dragon_ros.core.step import Frame
from dragon_ros.messages.fixed_size import Together
from dragon_ros.nodes import publisher_queue
from dragon_ros.nodes.frames import Frames
from dragon_ros.nodes.led import LedFrames


class Broadcast:
    """The frames of a run; showing a frame publishes it. ``shown`` is the last frame."""

    def __init__(self, frames: Frames | LedFrames, topics: Iterable[publisher_queue.EncodedTopic]) -> None:
        """Start before the first frame; each function in ``also`` is called with a frame before it is published."""
        self.frames = frames
        self.shown: Frame | None = None
        self._topics, self._queue = tuple(topics), publisher_queue.PublisherQueue()
        self.also: list[Callable[[Frame], None]] = []
        self.next_ns, self.last_ns, self.rewind = frames.next_ns, frames.last_ns, frames.rewind
        self.seek, self.place, self.ending = frames.seek, frames.place, frames.ending
        self.stamp_ns, self.seconds = frames.stamp_ns, frames.seconds

    def show(self) -> None:
        """Publish the next frame and advance."""
        self.shown = frame = self.frames.take()
        for observe in self.also:
            observe(frame)
        together = Together((frame, *self.frames.ahead))
        for topic in self._topics:
            topic.put(together, self._queue)
        self.flush()

    def flush(self) -> bool:
        """Publish messages held back by slow readers; return whether none remain."""
        return self._queue.flush()
