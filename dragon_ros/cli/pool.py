"""Run long work on all cores: several processes run the jobs, and the results are returned in job order."""
import mmap
import os
import pickle
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sized
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from dragon_ros.cli.signals import ending
from dragon_ros.core.checks import whole
from dragon_ros.core.errors import DragonError

if TYPE_CHECKING:       # imported lazily, because most commands start no processes
    from concurrent.futures import ProcessPoolExecutor

_MOST = 1024    # largest value of --workers
_AHEAD = 3      # jobs submitted per other process: one running and two waiting
_WAITING = 4    # largest number of finished results per worker that wait for the results of earlier jobs
_SEEN_S = 0.05  # duration (s) of the first jobs, which are timed to estimate the remaining work
_WORTH_S = 1.0  # duration (s) of the remaining work above which starting other processes is worthwhile
# Shared memory per result, enough for four uncompressed chunks of a bag. Unused pages take no memory.
_SLOT_BYTES = 2**22
_MOST_SLOTS = 256       # 1 GB in total
_LARGE_BYTES = 2**12    # minimum size of a buffer that is sent through shared memory
J = TypeVar('J')
R = TypeVar('R')
_pickled: bytes
_memory: mmap.mmap | None


def workers_of(given: int | None) -> int:
    """Return the number of processes: ``--workers`` or, if that is None, one per core available to this process."""
    if given is not None:
        return whole('--workers', given, low=1, high=_MOST)
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


@dataclass(frozen=True)
class Pool:
    """A pool of worker processes: as many as ``--workers`` specifies or, if that is None, one per core for long work.

    This process is one of the workers; it works alone until the others have started. Raises InputError for an invalid
    number of workers.
    """

    given: int | None = None

    def __post_init__(self) -> None:
        """Check the number of workers."""
        workers_of(self.given)

    @property
    def workers(self) -> int:
        """The largest number of processes that work at the same time."""
        return workers_of(self.given)

    def in_order(self, work: Callable[[J], R], jobs: Iterable[J], count: int | None = None) -> Generator[R, None, None]:
        """Yield ``work(job)`` for each job, in order; ``count`` is the number of jobs if ``jobs`` has no length.

        The other processes receive a pickled copy of ``work``. At most ``4 * workers`` results wait for the results of
        earlier jobs, which bounds the memory use. The other processes ignore signals, and end when this process ends
        for any reason. Raises DragonError if one of these processes is killed.
        """
        rest, workers = iter(jobs), self.workers
        if workers > 1 and self.given is None:
            left_s = yield from _seen(work, rest, len(jobs) if isinstance(jobs, Sized) else count or 0)
            workers = workers if left_s > _WORTH_S else 1
        if workers == 1:
            yield from map(work, rest)
            return
        from concurrent.futures.process import BrokenProcessPool
        with ExitStack() as last:
            with _blocked():        # a signal during the start takes effect at the end of this block
                pool, begun, slots = _started(workers - 1, pickle.dumps(work))
                watch = threading.Thread(target=_end_together, args=(pool,), daemon=True)
                watch.start()
                last.callback(_end, pool, watch)
            try:
                for job in rest:
                    yield work(job)
                    if any(one.done() for one in begun):
                        break
                yield from _shared(pool, work, rest, workers, slots)
            except BrokenProcessPool:
                raise DragonError('one of the worker processes was killed, perhaps because memory ran out; reduce '
                                  '--workers') from None


ALONE = Pool(1)


def _seen(work: Callable[[J], R], rest: Iterator[J], count: int) -> Generator[R, None, float]:
    """Run the first jobs in this process, yield their results, and return the estimated time (s) for the other jobs.

    The first job is not timed, because it fills caches.
    """
    began_s, done, taken_s = time.monotonic(), 0, 0.0
    for job in islice(rest, count):
        yield work(job)
        done += 1
        if done == 1:
            began_s = time.monotonic()
        elif (taken_s := time.monotonic() - began_s) > _SEEN_S:
            break
    return taken_s / max(1, done - 1) * (count - done)


class _Result(NamedTuple):
    """A pickled result without its large buffers, and the sizes of these buffers, which are in the job's slot."""

    pickled: bytes
    sizes: list[int]


class _Slots:
    """Memory shared with forked processes and divided into slots; each slot holds the large buffers of one result.

    A pipe holds only 64 KB. A process that sent a chunk of a bag through a pipe would have to wait several times until
    this process, which is busy with its own jobs, reads a part of the chunk. The memory has no name, so it is released
    when the last process ends.
    """

    def __init__(self, count: int) -> None:
        """Allocate the slots; if that fails, there are no slots, and all buffers are sent through the pipe."""
        self.memory: mmap.mmap | None = None
        with suppress(OSError):
            self.memory = mmap.mmap(-1, count * _SLOT_BYTES) if count else None
        self._free = list(range(count if self.memory else 0))

    def take(self) -> int | None:
        """Return a slot that no other job uses, or None if all slots are in use."""
        return self._free.pop() if self._free else None

    def read(self, slot: int | None, result: _Result) -> Any:
        """Return a result with copies of its buffers, and free its slot."""
        buffers = []
        if slot is not None and self.memory is not None:
            start = slot * _SLOT_BYTES
            with memoryview(self.memory) as memory:
                for size in result.sizes:
                    buffers.append(bytearray(memory[start:start + size]))
                    start += size
            self._free.append(slot)
        return pickle.loads(result.pickled, buffers=buffers)    # pickled by a process that this process started


class _Elsewhere(NamedTuple):
    """A job that runs in another process."""

    future: Future[_Result]
    slot: int | None
    slots: _Slots

    def done(self) -> bool:
        """Return whether the job is done."""
        return self.future.done()

    def result(self) -> Any:
        """Return the result; this method can be called only once. Raises the job's exception."""
        return self.slots.read(self.slot, self.future.result())


def _started(others: int, pickled: bytes) -> tuple['ProcessPoolExecutor', list[Future[None]], _Slots]:
    """Return a process pool, one future per process that is done once the process has started, and shared memory.

    If this process has a single Python thread, the processes are forked, which takes almost no time. OpenBLAS ends its
    own threads before a fork. Otherwise, new interpreters are started, and their imports take a third of a second.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context
    forked = sys.platform == 'linux' and threading.active_count() == 1
    alive = os.pipe() if forked else None
    slots = _Slots(min(_WAITING * (others + 1), _MOST_SLOTS) if forked else 0)
    pool = ProcessPoolExecutor(others, get_context('fork' if forked else 'spawn'), _begin,
                               (alive, pickled, slots.memory))
    begun = [pool.submit(_warm) for _ in range(others)]
    if alive is not None:
        os.close(alive[0])
    return pool, begun, slots


def _end_together(pool: Any) -> None:
    """Wait until one process of a pool ends, and then end the others.

    If a process is killed while it sends a result, the queue remains locked, and the thread that reads the queue waits
    for the rest of the result as long as any process, including this one, can write to the queue. Only this thread
    closes this process's end of the queue, because a second close could close a file that has been opened since.
    """
    from multiprocessing import connection
    others, results = list(pool._processes.values()), pool._result_queue
    connection.wait([one.sentinel for one in others])
    with suppress(OSError, ValueError):     # the pool may have ended in the meantime
        for one in others:
            one.kill()
        results._writer.close()


def _end(pool: Any, watch: threading.Thread) -> None:
    """End a pool's processes and wait for its threads; ``watch`` runs ``_end_together``.

    No more results are needed, so no process may first complete its imports or its job.
    """
    manager = pool._executor_manager_thread
    for one in pool._processes.values():
        one.kill()
    pool.shutdown(wait=False, cancel_futures=True)      # wait=True would close the pipe that ``watch`` closes
    watch.join()
    manager.join()


def _shared(pool: 'ProcessPoolExecutor', work: Callable[[J], R], rest: Iterator[J], workers: int,
            slots: _Slots) -> Iterator[R]:
    """Yield the results of this process and of a pool in job order."""
    waiting, far = deque[Future[R] | _Elsewhere](), deque[_Elsewhere]()
    while True:
        far = deque(one for one in far if not one.done())
        for job in islice(rest, max(0, _AHEAD * (workers - 1) - len(far))):
            slot = slots.take()
            far.append(_Elsewhere(pool.submit(_take, job, slot), slot, slots))
            waiting.append(far[-1])
        if waiting and (waiting[0].done() or len(waiting) >= _WAITING * workers):
            yield waiting.popleft().result()
            continue
        for job in islice(rest, 1):
            waiting.append(_done(work, job))
            break
        else:
            break
    while waiting:
        yield waiting.popleft().result()


def _done(work: Callable[[J], R], job: J) -> Future[R]:
    """Run a job in this process; ``result`` raises its error, so that the results of earlier jobs come first."""
    done: Future[R] = Future()
    try:
        done.set_result(work(job))
    except Exception as error:  # noqa: BLE001 - a job may raise anything
        done.set_exception(error)
    return done


@contextmanager
def _blocked() -> Iterator[None]:
    """Block the signals that end a command, so that processes started inside this block never receive these signals."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ending())
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(alive: tuple[int, int] | None, pickled: bytes, memory: mmap.mmap | None) -> None:
    """Initialise a new process; if it was forked, the pipe ``alive`` is closed when the parent process ends."""
    global _pickled, _memory
    if alive is not None:
        os.close(alive[1])
    threading.Thread(target=_end_with_parent, args=(alive,), daemon=True).start()
    _pickled, _memory = pickled, memory


def _end_with_parent(alive: tuple[int, int] | None) -> None:
    """Wait until the parent process ends, and then end this process."""
    from multiprocessing import connection, parent_process
    if alive is not None:
        os.read(alive[0], 1)
    elif (parent := parent_process()) is not None:
        connection.wait([parent.sentinel])
    os._exit(1)


@cache
def _work() -> Callable[[Any], Any]:
    work: Callable[[Any], Any] = pickle.loads(_pickled)     # pickled by the process that started this process
    return work


def _warm() -> None:
    """Unpickle the work to show that the process has started; an error is raised later, by the first job."""
    with suppress(Exception):
        _work()


def _take(job: Any, slot: int | None) -> _Result:
    """Run a job, and write the large buffers of its result to a slot of the shared memory if they fit."""
    sizes: list[int] = []
    start = 0 if slot is None else slot * _SLOT_BYTES

    def stays(buffer: pickle.PickleBuffer) -> bool:
        with buffer.raw() as raw:
            done = sum(sizes)
            if _memory is None or slot is None or not _LARGE_BYTES <= raw.nbytes <= _SLOT_BYTES - done:
                return True
            _memory[start + done:start + done + raw.nbytes] = raw
            sizes.append(raw.nbytes)
            return False
    return _Result(pickle.dumps(_work()(job), 5, buffer_callback=stays), sizes)
