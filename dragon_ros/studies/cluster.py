"""Run a study with Dask, on new processes on this host or on a running cluster.

A batch takes about ``_BATCH_S`` seconds, so that the overhead of Dask stays small. A few batches per worker are
submitted in advance. The result of a batch is a Parquet file, which is written as received. If a worker dies, Dask
computes its batch again; if a batch kills several workers in a row, its rows are computed one by one.
"""
import asyncio
import logging
import os
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from queue import Empty, Queue
from tempfile import TemporaryDirectory
from threading import Event, Thread
from time import monotonic, perf_counter
from typing import Any, NamedTuple

import dask
import distributed
import numpy as np
import pyarrow
from distributed import Client, Future, KilledWorker, LocalCluster
from tornado.ioloop import IOLoop

from dragon_ros.cli.signals import interrupts_blocked
from dragon_ros.core.errors import DragonError, InputError, MissingError
from dragon_ros.studies.dataset import BLOCK, DataSet, part_of
from dragon_ros.studies.rows import FAILED, OK, STATUSES, columns_of, parsed, rows_of
from dragon_ros.studies.sampling import check_libraries
from dragon_ros.version import __version__

_BATCH_S = 2.0          # work per batch; each batch costs Dask a few milliseconds
_MOST_ROWS = 4096       # largest number of rows in a batch; the size of a block is a multiple of it
_AHEAD = 2              # batches per worker: one is computed while the next one waits
_LATEST = 0.3           # weight of the latest batch in the average time per row
_WAIT_S = 0.5           # longest wait for a batch before signals are checked again
_LOOK_S = 2.0           # time between two counts of the workers
_CONNECT_S = 30.0
_START_S = 120.0        # longest wait for a thread of this process to start
_NO_WORKERS_S = 60.0    # time without workers after which the study ends with an error
# Dask's dashboard and the HTTP routes that serve it are disabled. Dask's profiler is also disabled, because sampling a
# hundred times per second took a tenth of a worker's time. By default, a worker returns freed blocks of 64 KB or more
# to the system, and allocating them again takes as long as the arithmetic.
_ALONE: dict[str, Any] = {'distributed.scheduler.http.routes': [], 'distributed.worker.http.routes': [],
                          'distributed.worker.profile.enabled': False, 'distributed.admin.tick.interval': '1s',
                          'distributed.admin.system-monitor.interval': '5s',
                          'distributed.worker.memory.monitor-interval': '500ms',
                          'distributed.nanny.pre-spawn-environ': {
                              'MALLOC_TRIM_THRESHOLD_': 2**28, 'MALLOC_MMAP_THRESHOLD_': 2**25,
                              'OMP_NUM_THREADS': 1, 'OPENBLAS_NUM_THREADS': 1}}


class BatchResult(NamedTuple):
    """The result of a batch: rows as a Parquet file, the number of rows with each status, and the time spent."""

    part: bytes
    statuses: dict[str, int]
    spent_s: float


@dataclass
class StudyProgress:
    """The progress of a study: the number of existing rows, and the number of rows computed by this run, by status."""

    total: int
    done: int
    statuses: dict[str, int]
    workers: int = 0

    @property
    def refused(self) -> int:
        """The number of rows computed by this run that lack an answer."""
        return sum(count for status, count in self.statuses.items() if status != OK)


def versions() -> dict[str, str]:
    """Return the versions that must agree on all workers for rows to have the same values."""
    return {'dragon_ros': __version__, 'python': python_version(), 'numpy': np.__version__, 'scipy': _scipy(),
            'pyarrow': pyarrow.__version__, 'dask': dask.__version__, 'distributed': distributed.__version__}


def _scipy() -> str:
    """Return the version of scipy, or 'none' if it is not installed; only some studies need it."""
    try:
        return version('scipy')
    except PackageNotFoundError:
        return 'none'


def compute(text: str, start: int, stop: int, wanted: dict[str, str]) -> BatchResult:
    """Compute the rows start <= index < stop on a worker. Raises InputError if the worker's versions differ."""
    _check_same('worker', versions(), wanted)       # a worker may have joined after the first check
    began, study = perf_counter(), parsed(text)
    rows = rows_of(study, range(start, stop))
    statuses = {status: sum(row['status'] == status for row in rows) for status in STATUSES}
    return BatchResult(part_of(study, rows), statuses, perf_counter() - began)


def _check_same(who: str, found: dict[str, str], wanted: dict[str, str]) -> None:
    for name, mine in wanted.items():
        if found.get(name) != mine:
            raise InputError(f'scheduler: {who} has {name} {found.get(name)}, but this process has {mine}, so rows '
                             'would differ; install the same versions everywhere (docs/studies.md)', field=name)


@contextmanager
def local_client(workers: int | None) -> Iterator[Client]:
    """Yield a client of private worker processes on this host; by default, there is one process per core.

    The processes listen on the loopback address, without a dashboard, and use TLS with keys that exist only in memory,
    so other users of this host can neither read the traffic nor join. Raises DragonError if they cannot be started.
    """
    with TemporaryDirectory(prefix='dragon-study-') as scratch, dask.config.set(_ALONE), \
            ExitStack() as opened:
        loop, end = _running_loop()
        opened.callback(end)
        with interrupts_blocked():
            try:
                cluster = LocalCluster(n_workers=workers or os.cpu_count(), threads_per_worker=1, processes=True,
                                       host='127.0.0.1', security=True, dashboard_address=None,
                                       local_directory=scratch, silence_logs=logging.CRITICAL, loop=loop,
                                       scheduler_kwargs={'dashboard_address': '127.0.0.1:0'})
            except (OSError, RuntimeError) as error:
                raise DragonError(f'the worker processes cannot be started: {error}; free some space or memory, or '
                                  'give fewer --workers') from None
        with cluster, Client(cluster, timeout=_CONNECT_S) as client:
            yield client


def _running_loop() -> tuple[IOLoop, Callable[[], None]]:
    """Return an event loop that runs in its own thread, and a function that ends it.

    Raises DragonError if the loop does not start.

    Dask could start a loop itself, but allows only ten seconds, which is too short if the machine stalls briefly.
    """
    ready: Queue[tuple[IOLoop, asyncio.Event]] = Queue()

    async def serve() -> None:
        over = asyncio.Event()
        ready.put((IOLoop.current(), over))
        await over.wait()

    thread = Thread(target=lambda: asyncio.run(serve()), name='dask', daemon=True)
    with interrupts_blocked():
        thread.start()
    try:
        loop, over = ready.get(timeout=_START_S)
    except Empty:
        raise DragonError(f'a thread of this process did not start within {_START_S:g} s, perhaps because the machine '
                          'is overloaded; start the study again') from None

    def end() -> None:
        loop.add_callback(over.set)
        thread.join(_CONNECT_S)
    return loop, end


@contextmanager
def joined_client(scheduler: str) -> Iterator[Client]:
    """Yield a client of the running cluster with the given address or scheduler file; Dask's TLS settings apply.

    Raises MissingError if the cluster cannot be reached, and InputError if versions differ.
    """
    where = {'scheduler_file': scheduler} if Path(scheduler).is_file() else {'address': scheduler}
    loop, end = _running_loop()
    try:
        with warnings.catch_warnings():         # ``check_versions`` below reports all differences in one error
            warnings.simplefilter('ignore', distributed.versions.VersionMismatchWarning)
            client = Client(**where, timeout=_CONNECT_S, set_as_default=False, loop=loop)
    except (OSError, ValueError, TypeError, RuntimeError) as error:     # the client closes itself later, in its loop
        why = ' '.join(str(error).split())[:200] or type(error).__name__
        raise MissingError(f'--scheduler {scheduler}: cannot be reached ({why}); give an address such as '
                           'tcp://host:8786, or a scheduler file', field='scheduler') from None
    with ExitStack() as opened:
        opened.callback(end)
        opened.enter_context(client)
        check_versions(client)
        yield client


def check_versions(client: Client) -> None:
    """Raise InputError if the scheduler or a worker lacks dragon_ros or has different versions of the software."""
    wanted = versions()
    found = {'the scheduler': _asked(lambda: client.run_on_scheduler(versions)),
             **{f'worker {address}': one for address, one in client.run(versions, on_error='return').items()}}
    for who, one in found.items():
        if isinstance(one, Exception):
            raise InputError(f'scheduler: {who} cannot import dragon_ros.studies ({type(one).__name__}: {one}); '
                             'install dragon_ros[study] there (docs/studies.md)', field='dragon_ros')
        _check_same(who, one, wanted)


def _asked(call: Callable[[], Any]) -> Any:
    try:
        return call()
    except Exception as error:  # noqa: BLE001 - report whatever a process without dragon_ros raises
        return error


def run(data: DataSet, client: Client, stop: Event, tell: Callable[[StudyProgress], object]) -> StudyProgress:
    """Compute and write the missing rows of a data set until it is complete or ``stop`` is set.

    ``tell`` is called after each batch. Raises DiskError if rows cannot be written, and DragonError if the connection
    to the cluster is lost. Written rows are kept, and the next run continues from them.
    """
    work = _StudyRun(data, client)
    tell(work.progress)
    try:
        while not work.is_done and not stop.is_set():
            work.fill()
            work.take()
            tell(work.progress)
    finally:
        with suppress(Exception):       # the cluster may no longer exist
            client.cancel(list(work.ahead))
    if work.is_done:
        data.join_blocks()
    return work.progress


class _StudyRun:
    """One run of a study: ranges to compute, batches in flight, and the mean time per row."""

    def __init__(self, data: DataSet, client: Client) -> None:
        self._data, self._client, self._wanted = data, client, versions()
        self._ranges = deque(_in_blocks(data.missing))
        self.ahead: dict[Future, tuple[int, int]] = {}
        self._came: Queue[Future] = Queue()
        self._row_s: float | None = None
        self.progress = StudyProgress(data.study.rows, data.study.rows - sum(b - a for a, b in data.missing),
                                      dict.fromkeys(STATUSES, 0))
        self._seen, self._look_again = monotonic(), 0.0

    @property
    def is_done(self) -> bool:
        """Whether all rows exist."""
        return not self._ranges and not self.ahead

    def fill(self) -> None:
        """Submit batches until every worker has enough work."""
        if monotonic() >= self._look_again:
            self._count_workers()
            self._look_again = monotonic() + _LOOK_S
        while self._ranges and len(self.ahead) < _AHEAD * max(1, self.progress.workers):
            size = self._size()
            start, stop = self._ranges.popleft()
            end = min(stop, start + size)
            if end < stop:
                self._ranges.appendleft((end, stop))
            self._submit(start, end)

    def _submit(self, start: int, stop: int) -> None:
        future = self._client.submit(compute, self._data.study.text, start, stop, self._wanted, pure=False,
                                     key=f'rows-{start}-{stop}-{monotonic()}')
        self.ahead[future] = start, stop
        future.add_done_callback(self._came.put)

    def _size(self) -> int:
        """Return the size of the next batch: a single row until one has been timed, and fewer rows towards the end."""
        if self._row_s is None:
            return 1
        left = sum(stop - start for start, stop in self._ranges)
        share = left // (_AHEAD * max(1, self.progress.workers))
        return max(1, min(int(_BATCH_S / max(self._row_s, 1e-6)), share, _MOST_ROWS))

    def _count_workers(self) -> None:
        """Count the workers. Raises DragonError if the scheduler is lost or no worker joins."""
        if self._client.status not in ('running', 'connecting'):
            raise DragonError(f'the connection to the scheduler is lost; {self.progress.done} rows are kept; start the '
                              'study again to continue')
        try:
            self.progress.workers = sum(self._client.nthreads().values())
        except (OSError, TimeoutError) as error:
            raise DragonError(f'the scheduler does not answer ({error}); {self.progress.done} rows are kept; start '
                              'the study again to continue') from None
        self._seen = monotonic() if self.progress.workers else self._seen
        if monotonic() - self._seen > _NO_WORKERS_S:
            raise DragonError(f'there has been no worker for {_NO_WORKERS_S:g} s; {self.progress.done} rows are kept; '
                              'start workers, and then the study again')

    def take(self) -> None:
        """Write the batches that have arrived; if there are none, wait briefly."""
        with suppress(Empty):
            self._keep(self._came.get(timeout=_WAIT_S))
            while True:
                self._keep(self._came.get_nowait())

    def _keep(self, future: Future) -> None:
        start, stop = self.ahead.pop(future)
        if future.cancelled() or future.status == 'lost':
            self._ranges.appendleft((start, stop))
            return
        error = future.exception()
        if isinstance(error, KilledWorker):
            self._after_deaths(start, stop)
        elif error is not None:
            raise error if isinstance(error, DragonError) else DragonError(
                f'rows {start} to {stop - 1} cannot be computed: {type(error).__name__}: {error}')
        else:
            self._written(start, stop, future.result())
        future.release()

    def _written(self, start: int, stop: int, batch: BatchResult) -> None:
        self._data.write(start, stop, batch.part)
        row_s, self.progress.done = batch.spent_s / (stop - start), self.progress.done + stop - start
        self._row_s = row_s if self._row_s is None else (1 - _LATEST) * self._row_s + _LATEST * row_s
        for status, count in batch.statuses.items():
            self.progress.statuses[status] += count

    def _after_deaths(self, start: int, stop: int) -> None:
        """Split a batch that killed workers into single rows; a single row that kills workers is marked as failed."""
        if stop - start > 1:
            for index in range(start, stop):
                self._submit(index, index + 1)
            return
        row = dict.fromkeys(columns_of(self._data.study)) | {
            'index': start, 'status': FAILED, 'version': __version__,
            'reason': 'every worker that computed it died, possibly because memory ran out'}
        self._written(start, stop, BatchResult(part_of(self._data.study, [row]), {FAILED: 1}, 0.0))


def _in_blocks(ranges: list[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Yield the ranges, split at the boundaries of blocks, so that no part spans two blocks."""
    for start, stop in ranges:
        while start < stop:
            end = min(stop, (start // BLOCK + 1) * BLOCK)
            yield start, end
            start = end


def complete(data: DataSet, stop: Event, tell: Callable[[StudyProgress], object], workers: int | None = None,
             scheduler: str | None = None) -> StudyProgress:
    """Compute the missing rows of a data set as ``run`` does, in local processes or on a running cluster.

    If nothing is missing, no process is started.
    """
    check_libraries(data.study)
    if not data.missing:
        data.join_blocks()
        return StudyProgress(data.study.rows, data.study.rows, dict.fromkeys(STATUSES, 0))
    if scheduler is not None and workers is not None:
        raise InputError('--workers: a running cluster has its own workers; omit this option', field='workers')
    with joined_client(scheduler) if scheduler is not None else local_client(workers) as client:
        return run(data, client, stop, tell)
