"""The signals that end a command or, during long work, stop it at a point at which its output is complete."""
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event
from typing import Any


def ending() -> list[signal.Signals]:
    """Return the signals that end a command: SIGINT, SIGTERM and, unless ignored, SIGHUP (a closed terminal).

    ``nohup`` makes a command ignore SIGHUP, and Windows does not have it.
    """
    hang_up = getattr(signal, 'SIGHUP', None)
    both = [signal.SIGINT, signal.SIGTERM]
    return both if hang_up is None or signal.getsignal(hang_up) is signal.SIG_IGN else [*both, hang_up]


@contextmanager
def stopped_by_signals() -> Iterator[Event]:
    """Yield an event that is set by any signal of ``ending``; a second signal has its usual effect."""
    stop = Event()
    before: dict[int, Any] = {}

    def take(number: int, _: object) -> None:
        stop.set()
        signal.signal(number, before[number])
    for which in ending():
        before[int(which)] = signal.signal(which, take)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interrupts_blocked(forked: bool = False) -> Iterator[None]:
    """Block SIGINT and SIGTERM in threads and processes started inside this block; here, they stay pending.

    A terminal sends SIGINT to all processes, but only this process should react, by stopping the workers; otherwise,
    every worker would print a traceback, as would a forked one that receives SIGTERM while it still has the handler of
    this process: it must unblock SIGTERM itself. If processes are not forked, the resource tracker of multiprocessing
    is started beforehand, because starting it would unblock SIGINT.
    """
    if not hasattr(signal, 'pthread_sigmask'):
        yield
        return
    if not forked:
        from multiprocessing import resource_tracker  # only commands with workers need it
        resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGTERM])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
