"""Publishing bytes: who listens, and holding back where readers are slower than the publisher."""
import threading
import time
from collections.abc import Iterable, Mapping

from rclpy._rclpy_pybind11 import RCLError
from rclpy.duration import Duration
from rclpy.publisher import Publisher

from dragon_ros.core.errors import InputError

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
