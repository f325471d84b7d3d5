"""A Dask cluster that the user has started: its workers compute the batches of a study."""
import json
import os
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from time import monotonic
from typing import Any

from distributed import Client, KilledWorker
from distributed.versions import VersionMismatchWarning

from dragon_ros.cli.inputs import DragonError, InputError, MissingError, __version__
from dragon_ros.cli.pool import WorkerKilledError
from dragon_studies.run import BatchResult, Range

_AHEAD = 4              # batches per worker that are computed, wait, or wait for the results of earlier ones
_WAIT_S = 0.5           # longest wait for a batch before the connection is checked again
_CONNECT_S = 30.0
_NO_WORKERS_S = 60.0    # time without workers after which the study ends with an error
_KEPT = 'computed rows are kept; start the study again to continue'


def versions() -> dict[str, str]:
    """Return the versions that must agree on all workers for rows to have the same values."""
    return {'dragon_ros': __version__, 'python': python_version(),
            **{name: _version(name) for name in ('numpy', 'scipy', 'pyarrow', 'dask', 'distributed')}}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return 'none'


def checked(work: Callable[[Range], BatchResult], wanted: dict[str, str], job: Range) -> BatchResult:
    """Do the work on a worker, which may have joined after the first check. Raises InputError if versions differ."""
    _check_same('worker', versions(), wanted)
    return work(job)


def _check_same(who: str, found: dict[str, str], wanted: dict[str, str]) -> None:
    for name, mine in wanted.items():
        if found.get(name) != mine:
            raise InputError(f'scheduler: {who} has {name} {found.get(name)}, but this process has {mine}, so rows '
                             'would differ; install the same versions everywhere (docs/studies.md)', field=name)


def _address(file: Path) -> str:
    """Return the address in a scheduler file. Raises InputError."""
    try:
        address = json.loads(file.read_bytes())['address']
    except (OSError, ValueError, LookupError, TypeError):
        address = None
    if not isinstance(address, str):
        raise InputError(f'--scheduler {file}: it contains no address of a scheduler; give the file that `dask '
                         'scheduler --scheduler-file FILE` has written', field='scheduler')
    return address


@contextmanager
def joined(scheduler: str) -> Iterator['Cluster']:
    """Yield the running cluster with the given address or scheduler file; Dask's TLS settings apply.

    Raises MissingError if the cluster cannot be reached, and InputError if versions differ.
    """
    where = {'address': _address(Path(scheduler)) if os.path.isfile(scheduler) else scheduler}
    try:
        with warnings.catch_warnings():         # ``_check_versions`` reports all differences in one error
            warnings.simplefilter('ignore', VersionMismatchWarning)
            client = Client(**where, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        why = ' '.join(str(error).split())[:200] or type(error).__name__
        raise MissingError(f'--scheduler {scheduler}: cannot be reached ({why}); give an address such as '
                           'tcp://host:8786, or a scheduler file', field='scheduler') from None
    with client:
        _check_versions(client)
        yield Cluster(client)


def _check_versions(client: Client) -> None:
    """Raise InputError if the scheduler or a worker lacks dragon_ros or has different versions of the software."""
    try:
        of_scheduler = client.run_on_scheduler(versions)
    except Exception as error:  # noqa: BLE001 - report whatever a process without dragon_ros raises
        of_scheduler = error
    found = {'the scheduler': of_scheduler,
             **{f'worker {address}': one for address, one in client.run(versions, on_error='return').items()}}
    for who, one in found.items():
        if isinstance(one, Exception):
            raise InputError(f'scheduler: {who} cannot import dragon_studies ({type(one).__name__}: {one}); '
                             'install dragon_ros[cluster] there (docs/studies.md)', field='dragon_ros')
        _check_same(who, one, versions())


@dataclass
class Cluster:
    """The workers of a cluster."""

    client: Client

    @property
    def workers(self) -> int:
        """The number of batches that the workers compute at the same time. Raises DragonError."""
        try:
            return sum(self.client.nthreads().values())
        except (OSError, TimeoutError) as error:
            raise DragonError(f'the scheduler does not answer ({error}); {_KEPT}') from None

    def in_order(self, work: Callable[[Range], BatchResult], jobs: Iterable[Range]
                 ) -> Generator[BatchResult, None, None]:
        """Yield ``work(job)`` for each job, in order.

        Raises WorkerKilledError if a job kills several workers, and DragonError if the cluster is lost.
        """
        executor = self.client.get_executor(pure=False)
        on_worker, waiting = partial(checked, work, versions()), deque[Future[Any]]()
        try:
            for job in jobs:
                waiting.append(executor.submit(on_worker, job))
                if len(waiting) >= _AHEAD * max(1, self.workers):
                    yield self._result(waiting.popleft())
            while waiting:
                yield self._result(waiting.popleft())
        finally:
            executor.shutdown(wait=False)

    def _result(self, future: 'Future[Any]') -> BatchResult:
        seen = monotonic()
        while True:
            try:
                result: BatchResult = future.result(_WAIT_S)
                return result
            except TimeoutError:
                if self.client.status not in ('running', 'connecting'):
                    raise DragonError(f'the connection to the scheduler is lost; {_KEPT}') from None
                seen = monotonic() if self.workers else seen
                if monotonic() - seen > _NO_WORKERS_S:
                    raise DragonError(f'there has been no worker for {_NO_WORKERS_S:g} s; {_KEPT}') from None
            except KilledWorker:
                raise WorkerKilledError('several workers died while they computed the same rows') from None
            except CancelledError:
                raise DragonError(f'the connection to the scheduler is lost; {_KEPT}') from None
            except DragonError:
                raise
            except Exception as error:
                raise DragonError(f'rows cannot be computed: {type(error).__name__}: {error}') from error
