"""Run long work on all cores: several processes run the jobs, and the results are returned in job order."""
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from dragon_ros.cli.signals import interrupts_blocked
from dragon_ros.core.checks import whole
from dragon_ros.core.errors import DragonError, MissingError

_MOST = 1024    # largest value of --workers
_WAITING = 4    # largest number of results per worker that wait for the results of earlier jobs
_ALONE_S = 0.3  # duration (s) of work after which starting other processes is worthwhile
J = TypeVar('J')
R = TypeVar('R')
_pickled: bytes


class WorkerKilledError(DragonError):
    """A worker process was killed, so the results of its jobs are lost."""


def workers_of(given: int | None) -> int:
    """Return the number of processes: ``--workers`` or, if that is None, one per core available to this process."""
    if given is not None:
        return whole('--workers', given, low=1, high=_MOST)
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


@dataclass(frozen=True)
class Pool:
    """Worker processes: as many as ``--workers`` specifies or, if that is None, one per core for long work.

    Raises InputError for an invalid number of workers.
    """

    given: int | None = None

    def __post_init__(self) -> None:
        """Check the number of workers."""
        workers_of(self.given)

    @property
    def workers(self) -> int:
        """The largest number of processes that work at the same time."""
        return workers_of(self.given)

    def in_order(self, work: Callable[[J], R], jobs: Iterable[J]) -> Generator[R, None, None]:
        """Yield ``work(job)`` for each job, in order.

        The workers receive a pickled copy of ``work``. At most ``4 * workers`` results wait for the results of earlier
        jobs, which bounds the memory use. Raises WorkerKilledError.
        """
        rest, began_s = iter(jobs), time.monotonic()
        if self.workers == 1 or self.given is None:
            for job in rest:
                yield work(job)
                if self.workers > 1 and time.monotonic() - began_s > _ALONE_S:
                    break
            else:
                return
        yield from _shared(work, rest, self.workers)


ALONE = Pool(1)


def _shared(work: Callable[[J], R], rest: Iterable[J], workers: int) -> Generator[R, None, None]:
    """Yield the results of worker processes in job order.

    If this process has a single thread, the workers are forked, which takes almost no time. Results pass through files,
    because an executor waits forever for the rest of a large result if its worker is killed while sending it.
    """
    from concurrent.futures import Future, ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool
    forked = sys.platform == 'linux' and threading.active_count() == 1
    start = multiprocessing.get_context('fork' if forked else 'spawn')
    pool, waiting = ProcessPoolExecutor(workers, start, _begin, (pickle.dumps(work),)), deque[Future[Path]]()
    with _folder() as folder:
        try:
            for n, job in enumerate(rest):
                with interrupts_blocked(forked):        # in the processes that are started for this job
                    waiting.append(pool.submit(_work_on, job, folder / str(n)))
                if len(waiting) == _WAITING * workers:
                    yield _read(waiting.popleft().result())
            while waiting:
                yield _read(waiting.popleft().result())
        except BrokenProcessPool:
            raise WorkerKilledError('one of the worker processes was killed, perhaps because memory ran out; reduce '
                                    '--workers') from None
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _folder() -> Iterator[Path]:
    """Create a folder for results, and remove it at the end. Raises MissingError."""
    try:
        folder = TemporaryDirectory(prefix='dragon_ros-')
    except OSError as error:
        raise _no_space(error) from None
    with folder as name:
        yield Path(name)


def _no_space(error: OSError) -> MissingError:
    return MissingError(f'a temporary file cannot be written: {error.strerror}; free some space, or set TMPDIR')


def _read(path: Path) -> Any:
    data = path.read_bytes()
    path.unlink()
    return pickle.loads(data)       # pickled by a process that this process started


def _begin(pickled: bytes) -> None:
    """Prepare a worker: signals to its parent's process group do not reach it, and it ends with its parent."""
    global _pickled
    _pickled = pickled
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, 'pthread_sigmask'):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    if hasattr(os, 'setpgrp'):
        os.setpgrp()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _work_on(job: Any, path: Path) -> Path:
    """Run a job in a worker, write its result to a file, and return the file. Raises MissingError."""
    result = pickle.dumps(_work()(job), pickle.HIGHEST_PROTOCOL)
    try:
        path.write_bytes(result)
    except OSError as error:
        raise _no_space(error) from None
    return path


@cache
def _work() -> Any:
    return pickle.loads(_pickled)       # pickled by the parent process
