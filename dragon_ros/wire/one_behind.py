"""Jobs on a thread of their own, one at a time and in order: the caller prepares the next one meanwhile."""
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait


class OneBehind:
    """Is at most one job behind its caller, so that what waits is bounded."""

    def __init__(self, name: str) -> None:
        """``name`` is that of the thread, which starts with the first job."""
        self._pool = ThreadPoolExecutor(1, name)
        self._job: Future[None] | None = None

    def start(self, job: Callable[[], None]) -> None:
        """Start a job behind the one before. Raises what that one raised; the new one is not started then."""
        self.settle()
        self._job = self._pool.submit(job)

    def settle(self) -> None:
        """Wait until all is done. Raises what the job raised, once."""
        if self._job is None:
            return
        wait((self._job,))
        job, self._job = self._job, None
        job.result()

    def close(self) -> None:
        """Wait for the job and end the thread."""
        self._pool.shutdown()
