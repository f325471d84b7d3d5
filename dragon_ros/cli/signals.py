"""Signals that end long work at a point where its output is complete."""
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event
from typing import Any


@contextmanager
def stopped_by_signals() -> Iterator[Event]:
    """Yield an event that SIGINT, SIGTERM and SIGHUP set; a second signal has its usual effect."""
    stop = Event()
    before: dict[int, Any] = {}

    def take(number: int, _: object) -> None:
        stop.set()
        signal.signal(number, before[number])
    for which in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        before[int(which)] = signal.signal(which, take)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
