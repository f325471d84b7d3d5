"""Publishing bytes: who listens, and holding back where readers are slower than the publisher."""
import threading
import time
from collections.abc import Iterable, Mapping

from rclpy._rclpy_pybind11 import RCLError
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy

from dragon_ros.core.errors import InputError
from dragon_ros.core.step import Frame
from dragon_ros.wire.encode import Encode

_GIVE_UP = 20       # failures of 0.1 s in a row with nobody to wait for
_ACKED_S = 4.0      # acknowledgements come with the heartbeat of the middleware, every 3 s with Fast DDS


def wanted_readers(texts: Iterable[str], publishers: Mapping[str, Publisher]) -> list[tuple[Publisher, int]]:
    """Return (publisher, subscribers to wait for) from texts such as handles=2. Raises InputError."""
    wanted = []
    for text in filter(None, texts):
        name, _, count = text.partition('=')
        if name not in publishers or not count.isdecimal():
            raise InputError(f'wait_subscribers: {text!r} is not TOPIC=NUMBER; the topics are {", ".join(publishers)}')
        wanted.append((publishers[name], int(count)))
    return wanted


def wait_for_readers(wanted: Iterable[tuple[Publisher, int]], stop: threading.Event) -> bool:
    """Wait until every topic has its wanted subscribers; False if told to stop."""
    while any(publisher.get_subscription_count() < count for publisher, count in wanted):
        if stop.wait(0.02):
            return False
    return not stop.is_set()


class Feed:
    """One topic of ``sim``: encodes and publishes, but only what somebody hears."""

    def __init__(self, publisher: Publisher, encode: Encode) -> None:
        """Publish on ``publisher`` what ``encode`` makes of a frame."""
        self.publisher, self._encode = publisher, encode
        self._latched = publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        self.published = 0

    def publish(self, frame: Frame, stop: threading.Event) -> None:
        """Publish a frame; without a subscriber nothing is encoded.

        Who subscribes later hears from the next frame on, as ever: a volatile topic keeps nothing for late joiners.
        A latched one does, and is always published.
        """
        if self._latched or self.publisher.get_subscription_count():
            publish(self.publisher, self._encode(frame), stop)
            self.published += 1


def publish(publisher: Publisher, data: bytes, stop: threading.Event) -> None:
    """Publish; where the queue of a lossless publisher is full, wait for its readers."""
    alone = 0
    while True:
        try:
            publisher.publish(data)
            return
        except RCLError:
            if stop.is_set():
                return
            if not publisher.get_subscription_count() and (alone := alone + 1) > _GIVE_UP:
                raise


def drain(publishers: Iterable[Publisher]) -> None:
    """Wait, for a few seconds at most, until readers have everything: what is not sent dies with its publisher."""
    end = time.monotonic() + _ACKED_S
    for publisher in publishers:
        if publisher.get_subscription_count():
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
