"""Jobs on a thread of their own, one at a time and in order: the caller prepares the next one meanwhile."""
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Lock


class OneBehind:
    """Is at most one job behind its caller, so that what waits is bounded."""

    def __init__(self, name: str) -> None:
        """``name`` is that of the thread, which starts with the first job."""
        self._pool = ThreadPoolExecutor(1, name)
        self._job: Future[None] | None = None

    def start(self, job: Callable[[], None]) -> None:
        """Start a job behind the one before. Raises what that one raised; the new one is not started then.

        Returns when the job first gives the interpreter away. A thread that only asks for it waits until its holder
        has nothing to do, when that one gives it away and takes it back all the time, as numpy does: the job would
        run while the caller waits for its end, and not before.
        """
        self.settle()
        begun = Lock()
        begun.acquire()
        self._job = self._pool.submit(_after, begun, job)
        begun.acquire()

    def settle(self) -> None:
        """Wait until all is done. Raises what the job raised, once."""
        if self._job is None:
            return
        error = self._job.exception()
        self._job = None
        if error is not None:
            raise error

    def close(self) -> None:
        """Wait for the job and end the thread."""
        self._pool.shutdown()


def _after(begun: Lock, job: Callable[[], None]) -> None:
    """Do a job; whoever waits for its begin goes on as soon as this thread gives the interpreter away."""
    begun.release()
    job()
