"""Do long work on all cores: processes take jobs, and results are returned in the order of the jobs."""
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
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from dragon_ros.cli.signals import ending
from dragon_ros.core.checks import whole
from dragon_ros.core.errors import DragonError

if TYPE_CHECKING:       # imported lazily, since most commands start no processes
    from concurrent.futures import ProcessPoolExecutor

_MOST = 1024    # largest number of --workers
_AHEAD = 3      # jobs in flight per other process: one in work, two waiting
_WAITING = 4    # most results per worker that wait for their turn
_SEEN_S = 0.05  # seconds of work from which the remaining work is estimated
_WORTH_S = 1.0  # seconds of remaining work above which other processes pay off
_SLOT_BYTES = 2**22     # shared memory per result: four chunks of a bag, not compressed; unused pages take no memory
_MOST_SLOTS = 256       # 1 GB in total
_LARGE_BYTES = 2**12    # size from which a buffer goes to the shared memory
J = TypeVar('J')
R = TypeVar('R')
_pickled: bytes
_memory: mmap.mmap | None


def workers_of(given: int | None) -> int:
    """Return the number of processes: ``--workers``, or one per core that this process may use."""
    if given is not None:
        return whole('--workers', given, low=1, high=_MOST)
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1


@dataclass(frozen=True)
class Pool:
    """The worker processes: as many as ``--workers`` gives or, if None, one per core if the work is long.

    This process is one of the workers; it works alone until the others have started. Raises InputError for an invalid
    number.
    """

    given: int | None = None

    def __post_init__(self) -> None:
        """Check the number."""
        workers_of(self.given)

    @property
    def workers(self) -> int:
        """The largest number of processes that work at a time."""
        return workers_of(self.given)

    def in_order(self, work: Callable[[J], R], jobs: Iterable[J], count: int | None = None) -> Generator[R, None, None]:
        """Yield ``work(job)`` for each job, in order; ``count`` is the number of jobs if ``jobs`` has no length.

        The other processes receive a pickled copy of ``work``. At most ``4 * workers`` results wait for their turn,
        which bounds the memory. The processes ignore signals, and end when this process ends for any reason. Raises
        DragonError if one of them is killed.
        """
        rest, workers = iter(jobs), self.workers
        if workers > 1 and self.given is None:
            left_s = yield from _seen(work, rest, len(jobs) if isinstance(jobs, Sized) else count or 0)
            workers = workers if left_s > _WORTH_S else 1
        if workers == 1:
            yield from map(work, rest)
            return
        from concurrent.futures.process import BrokenProcessPool
        pool, begun, slots = _started(workers - 1, pickle.dumps(work))
        watch = threading.Thread(target=_end_together, args=(pool,), daemon=True)
        watch.start()
        try:
            for job in rest:
                yield work(job)
                if any(one.done() for one in begun):
                    break
            yield from _shared(pool, work, rest, workers, slots)
        except BrokenProcessPool:
            raise DragonError('one of the worker processes was killed, perhaps for lack of memory; give fewer '
                              '--workers') from None
        finally:
            _end(pool, watch)


ALONE = Pool(1)


def _seen(work: Callable[[J], R], rest: Iterator[J], count: int) -> Generator[R, None, float]:
    """Yield the first results of this process, and return the time in s that the remaining ones would take here.

    The first result is not timed, since it fills caches.
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
    """Memory shared with forked processes, in slots; each slot holds the large buffers of one result.

    A pipe holds 64 KB, so a process that sends a chunk of a bag would wait several times until this process, which is
    busy with its own jobs, has read a part. The memory has no name, so it disappears with the last process.
    """

    def __init__(self, count: int) -> None:
        """Allocate the slots. If the system refuses, there are none, and buffers are sent through the pipe."""
        self.memory: mmap.mmap | None = None
        with suppress(OSError):
            self.memory = mmap.mmap(-1, count * _SLOT_BYTES) if count else None
        self._free = list(range(count if self.memory else 0))

    def take(self) -> int | None:
        """Return a slot that no other job has; None if there is none."""
        return self._free.pop() if self._free else None

    def read(self, slot: int | None, result: _Result) -> Any:
        """Return a result with its own copy of its buffers, and free its slot."""
        buffers = []
        if slot is not None and self.memory is not None:
            start = slot * _SLOT_BYTES
            with memoryview(self.memory) as memory:
                for size in result.sizes:
                    buffers.append(bytearray(memory[start:start + size]))
                    start += size
            self._free.append(slot)
        return pickle.loads(result.pickled, buffers=buffers)    # by a process that this one started


class _Elsewhere(NamedTuple):
    """A job of another process."""

    future: Future[_Result]
    slot: int | None
    slots: _Slots

    def done(self) -> bool:
        """Return whether the job is done."""
        return self.future.done()

    def result(self) -> Any:
        """Return the result, once. Raises the error of the job."""
        return self.slots.read(self.slot, self.future.result())


def _started(others: int, pickled: bytes) -> tuple['ProcessPoolExecutor', list[Future[None]], _Slots]:
    """Return a pool of processes, for each a future that is done when it has started, and the memory that they share.

    They are forked if that is safe, which takes almost no time: this process must have a single Python thread (OpenBLAS
    ends its threads before a fork). Otherwise new interpreters are started, and their imports take a third of a second.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context
    forked = sys.platform == 'linux' and threading.active_count() == 1
    alive = os.pipe() if forked else None
    slots = _Slots(min(_WAITING * (others + 1), _MOST_SLOTS) if forked else 0)
    pool = ProcessPoolExecutor(others, get_context('fork' if forked else 'spawn'), _begin,
                               (alive, pickled, slots.memory))
    with _blocked():
        begun = [pool.submit(_warm) for _ in range(others)]
    if alive is not None:
        os.close(alive[0])
    return pool, begun, slots


def _end_together(pool: Any) -> None:
    """Wait until a process of a pool ends, and end the others.

    A process that is killed while it sends a result keeps the lock of the queue, and the thread that reads the queue
    waits for the rest of the result as long as any process, including this one, can write to it. Only this thread
    closes this process's end: a second close could close a file that was opened in between.
    """
    from multiprocessing import connection
    others, results = list(pool._processes.values()), pool._result_queue
    connection.wait([one.sentinel for one in others])
    with suppress(OSError, ValueError):     # the pool has ended meanwhile
        for one in others:
            one.kill()
        results._writer.close()


def _end(pool: Any, watch: threading.Thread) -> None:
    """Shut a pool down and wait for its threads; ``watch`` runs `_end_together`."""
    manager = pool._executor_manager_thread
    pool.shutdown(wait=False, cancel_futures=True)      # with wait=True, it would close the pipe that ``watch`` closes
    watch.join()
    manager.join()


def _shared(pool: 'ProcessPoolExecutor', work: Callable[[J], R], rest: Iterator[J], workers: int,
            slots: _Slots) -> Iterator[R]:
    """Yield results of this process and of a pool, in job order."""
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
            here: Future[R] = Future()
            here.set_result(work(job))
            waiting.append(here)
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


def _begin(alive: tuple[int, int] | None, pickled: bytes, memory: mmap.mmap | None) -> None:
    """Initialise a new process; ``alive`` is a pipe whose other end is open only in the process that forked it."""
    global _pickled, _memory
    if alive is not None:
        os.close(alive[1])
    threading.Thread(target=_end_with_parent, args=(alive,), daemon=True).start()
    _pickled, _memory = pickled, memory


def _end_with_parent(alive: tuple[int, int] | None) -> None:
    """Wait until the parent process ends, then end this one."""
    from multiprocessing import connection, parent_process
    if alive is not None:
        os.read(alive[0], 1)
    elif (parent := parent_process()) is not None:
        connection.wait([parent.sentinel])
    os._exit(1)


@cache
def _work() -> Callable[[Any], Any]:
    work: Callable[[Any], Any] = pickle.loads(_pickled)     # by the process that started this one
    return work


def _warm() -> None:
    """Unpickle the work, which shows that the process has started; a job raises the errors."""
    with suppress(Exception):
        _work()


def _take(job: Any, slot: int | None) -> _Result:
    """Do a job, and write the large buffers of its result to a slot of the shared memory as far as they fit."""
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
