"""Progress of long work on a terminal. What takes less than a second shows nothing, and imports nothing to show it."""
import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

_FIRST_S = 1.0
T = TypeVar('T')


class Progress:
    """Counts what is done, and shows it on standard error from the first second on, if that is a terminal.

    Use it in a ``with`` block and call ``update``, or call it with what is gone through.
    """

    def __init__(self, what: str, unit: str, total: float | None = None, **options: Any) -> None:
        """Name the work and the unit that is counted; ``options`` are tqdm's."""
        self.done = 0.0
        self._options = {'desc': what, 'unit': unit if unit == 'B' else f' {unit}', 'total': total, **options}
        self._began_s = time.monotonic()
        self._bar: Any = None
        self._is_seen = sys.stderr is not None and sys.stderr.isatty()

    def update(self, more: float = 1) -> None:
        """Count some more."""
        self.done += more
        if self._bar is not None:
            self._bar.update(more)
        elif self._is_seen and time.monotonic() - self._began_s >= _FIRST_S:
            self._show()

    def reach(self, done: float) -> None:
        """Count up to a number."""
        self.update(done - self.done)

    def __call__(self, rows: Iterable[T]) -> Iterator[T]:
        """Yield what is gone through, and count it, from nothing."""
        self.done, self._began_s = 0.0, time.monotonic()
        with self:
            for row in rows:
                yield row
                self.update()

    def __enter__(self) -> 'Progress':
        """Return the progress."""
        return self

    def __exit__(self, *_: object) -> None:
        """Clear the line."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def _show(self) -> None:
        from tqdm import tqdm
        self._bar = tqdm(leave=False, **self._options)
        self._bar.start_t = self._began_s - time.monotonic() + self._bar.start_t
        self._bar.update(self.done)
