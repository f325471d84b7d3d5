"""Run a study: batches of rows, computed by processes of this host or by a Dask cluster, and written in order.

A batch takes about ``_BATCH_S`` seconds. Its result is a Parquet file, which is written as received. If a worker is
killed, its rows are computed again; a row that kills its workers is marked as failed.
"""
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from threading import Event
from time import perf_counter
from typing import NamedTuple, Protocol

from dragon_ros.cli.inputs import InputError, MissingError, __version__
from dragon_ros.cli.pool import Pool, WorkerKilledError, workers_of
from dragon_studies.dataset import BLOCK, DataSet, part_of
from dragon_studies.rows import FAILED, OK, STATUSES, columns_of, parsed, rows_of
from dragon_studies.sampling import check_libraries

_BATCH_S = 2.0          # work per batch
_MOST_ROWS = 4096       # largest number of rows in a batch; the size of a block is a multiple of it
_SHARES = 2             # batches per worker into which the remaining rows are divided, so that all workers end together
_LATEST = 0.3           # weight of the latest batch in the average time per row
Range = tuple[int, int]     # start <= index < stop


class BatchResult(NamedTuple):
    """The result of a batch: its rows as a Parquet file, the number with each status, and the time spent."""

    rows: Range
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


class Workers(Protocol):
    """What computes batches: a pool of processes of this host, or a cluster."""

    @property
    def workers(self) -> int:
        """The number of batches that are computed at the same time."""

    def in_order(self, work: Callable[[Range], BatchResult], jobs: Iterable[Range]
                 ) -> Generator[BatchResult, None, None]:
        """Yield ``work(job)`` for each job, in order. Raises WorkerKilledError."""


def compute(text: str, rows: Range) -> BatchResult:
    """Compute a range of rows of the study that ``text`` describes."""
    began, study = perf_counter(), parsed(text)
    found = rows_of(study, range(*rows))
    statuses = {status: sum(row['status'] == status for row in found) for status in STATUSES}
    return BatchResult(rows, part_of(study, found), statuses, perf_counter() - began)


def complete(data: DataSet, stop: Event, tell: Callable[[StudyProgress], object], workers: int | None = None,
             scheduler: str | None = None) -> StudyProgress:
    """Compute and write the missing rows of a data set until it is complete or ``stop`` is set.

    The rows are computed by processes of this host or, if ``scheduler`` is its address or file, by a Dask cluster.
    ``tell`` is called after each batch. Raises DiskError if rows cannot be written, and DragonError if the connection
    to the cluster is lost. Written rows are kept, and the next run continues from them.
    """
    check_libraries(data.study)
    if scheduler is None:
        return _Run(data, Pool(workers_of(workers))).until(stop, tell)
    if workers is not None:
        raise InputError('--workers: a running cluster has its own workers; omit this option', field='workers')
    if not data.missing:
        return _Run(data, Pool(1)).until(stop, tell)
    try:
        from dragon_studies.scheduler import joined  # Dask takes a third of a second to import
    except ImportError as error:
        raise MissingError(f"{error.name}: it is not installed, but --scheduler needs it; pip install "
                           "'dragon_ros[cluster]'") from None
    with joined(scheduler) as cluster:
        return _Run(data, cluster).until(stop, tell)


class _Run:
    """One run of a study on some workers."""

    def __init__(self, data: DataSet, workers: Workers) -> None:
        self._data, self._workers = data, workers
        self._work = partial(compute, data.study.text)
        self._row_s: float | None = None        # mean time per row
        self.progress = StudyProgress(data.study.rows, data.count, dict.fromkeys(STATUSES, 0), workers.workers)

    def until(self, stop: Event, tell: Callable[[StudyProgress], object]) -> StudyProgress:
        """Compute and write batches until all rows exist or ``stop`` is set; return the progress."""
        done = None         # the number of rows when a worker was last killed
        tell(self.progress)
        while self._data.missing and not stop.is_set():
            try:
                with closing(self._workers.in_order(self._work, self._batches())) as results:
                    for batch in results:
                        self._keep(batch)
                        tell(self.progress)
                        if stop.is_set():
                            break
            except WorkerKilledError:
                if self.progress.done == done:
                    self._alone(next(self._batches()))
                done = self.progress.done
        if not self._data.missing:
            self._data.join_blocks()
        return self.progress

    def _batches(self) -> Iterator[Range]:
        """Yield the missing rows in batches, whose size follows the time per row. No batch spans two blocks."""
        missing = self._data.missing
        left = sum(stop - start for start, stop in missing)
        for start, stop in missing:
            while start < stop:
                end = min(stop, start + self._size(left), (start // BLOCK + 1) * BLOCK)
                yield start, end
                start, left = end, left - (end - start)

    def _size(self, left: int) -> int:
        """Return the size of the next batch: a single row until one has been timed, and fewer rows towards the end."""
        self.progress.workers = self._workers.workers
        if self._row_s is None:
            return 1
        share = left // (_SHARES * max(1, self.progress.workers))
        return max(1, min(int(_BATCH_S / max(self._row_s, 1e-6)), share, _MOST_ROWS))

    def _keep(self, batch: BatchResult) -> None:
        start, stop = batch.rows
        self._data.write(start, stop, batch.part)
        row_s, self.progress.done = batch.spent_s / (stop - start), self.progress.done + stop - start
        self._row_s = row_s if self._row_s is None else (1 - _LATEST) * self._row_s + _LATEST * row_s
        for status, count in batch.statuses.items():
            self.progress.statuses[status] += count

    def _alone(self, rows: Range) -> None:
        """Compute the first part of rows that kill their worker; a single such row is marked as failed."""
        start, stop = rows
        while True:
            try:
                for batch in self._workers.in_order(self._work, [(start, stop)]):
                    self._keep(batch)
                return
            except WorkerKilledError:
                if stop - start == 1:
                    self._keep(self._failed(start))
                    return
                stop = start + (stop - start) // 2

    def _failed(self, index: int) -> BatchResult:
        row = dict.fromkeys(columns_of(self._data.study)) | {
            'index': index, 'status': FAILED, 'version': __version__,
            'reason': 'every worker that computed it died, possibly because memory ran out'}
        return BatchResult((index, index + 1), part_of(self._data.study, [row]), {FAILED: 1}, 0.0)
