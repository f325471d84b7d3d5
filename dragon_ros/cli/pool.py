"""Long work on all cores: processes take jobs; results are returned in the order of the jobs."""
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from multiprocessing import connection, get_context, parent_process
from typing import Any, TypeVar

from dragon_ros.cli.signals import ending
from dragon_ros.core.checks import whole
from dragon_ros.core.errors import DragonError

_MOST = 1024    # largest number of --workers
_AHEAD = 2      # jobs in flight per other process: one in work, one waiting
_WAITING = 4    # results per worker that wait for their turn
J = TypeVar('J')
R = TypeVar('R')
_work: Callable[[Any], Any]


def workers_of(given: int | None) -> int:
    """Return the number of processes: ``--workers``, or one per core that this process may use."""
    if given is not None:
        return whole('--workers', given, low=1, high=_MOST)
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


def in_order(made: Callable[..., Callable[[J], R]], settings: tuple[Any, ...], jobs: Iterable[J],
             workers: int) -> Generator[R, None, None]:
    """Yield the results of jobs in order. Each worker calls ``made(*settings)`` once to obtain its function for jobs.

    This process is one of the workers; it works alone until the others have started. At most ``4 * workers`` results
    wait for their turn, which bounds the memory. The other processes have none of this one's threads, ignore its
    signals, and end when it ends for any reason. Raises DragonError if one of them is killed.
    """
    work, rest = made(*settings), iter(jobs)
    if workers == 1:
        yield from map(work, rest)
        return
    pool = ProcessPoolExecutor(workers - 1, get_context('spawn'), _begin, (made, settings))
    try:
        with _blocked():
            begun = [pool.submit(_nothing) for _ in range(workers - 1)]
        for job in rest:
            yield work(job)
            if any(one.done() for one in begun):
                break
        yield from _shared(pool, work, rest, workers)
    except BrokenProcessPool:
        raise DragonError('one of the worker processes was killed, perhaps for lack of memory; give fewer --workers'
                          ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _shared(pool: ProcessPoolExecutor, work: Callable[[J], R], rest: Iterator[J], workers: int) -> Iterator[R]:
    """Yield results of this process and of a pool, in job order."""
    waiting, far = deque[Future[R]](), deque[Future[R]]()
    while True:
        far = deque(one for one in far if not one.done())
        for job in islice(rest, max(0, _AHEAD * (workers - 1) - len(far))):
            far.append(pool.submit(_take, job))
            waiting.append(far[-1])
        if waiting and (waiting[0].done() or len(waiting) >= _WAITING * workers):
            yield waiting.popleft().result()
            continue
        for job in islice(rest, 1):
            waiting.append(Future())
            waiting[-1].set_result(work(job))
            break
        else:
            break
    while waiting:
        yield waiting.popleft().result()


@contextmanager
def _blocked() -> Iterator[None]:
    """Block the signals that end a command; processes started inside this block never receive them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ending())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(made: Callable[..., Callable[[Any], Any]], settings: tuple[Any, ...]) -> None:
    """Initialise a new process."""
    global _work
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _work = made(*settings)


def _end_with_parent() -> None:
    """Wait until the parent process ends, then end this one."""
    if (parent := parent_process()) is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _take(job: Any) -> Any:
    return _work(job)


def _nothing() -> None:
    """Do nothing; the result shows that a process has started."""
