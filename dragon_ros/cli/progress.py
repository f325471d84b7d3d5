"""Show the progress of long work on a terminal. If the work takes less than a second, nothing is shown or imported."""
import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

_FIRST_S = 1.0
T = TypeVar('T')


class Progress:
    """Count completed work; after the first second, show the count on standard error if that is a terminal.

    Use the object in a ``with`` block and call ``update``, or call the object with an iterable.
    """

    def __init__(self, what: str, unit: str, total: float | None = None, **options: Any) -> None:
        """Set the name of the work, its unit and its total; ``options`` are passed to tqdm."""
        self.done: float = 0
        self._options = {'desc': what, 'unit': unit if unit == 'B' else f' {unit}', 'total': total, **options}
        self._began_s = time.monotonic()
        self._bar: Any = None
        self._note = ''
        self._is_seen = sys.stderr is not None and sys.stderr.isatty()

    def update(self, more: float = 1) -> None:
        """Increase the count."""
        self.done += more
        if self._bar is not None:
            self._bar.update(more)
        elif self._is_seen and time.monotonic() - self._began_s >= _FIRST_S:
            self._show()

    def reach(self, done: float) -> None:
        """Increase the count to ``done``."""
        self.update(done - self.done)

    def note(self, text: str) -> None:
        """Show a note beside the count."""
        self._note = text
        if self._bar is not None:
            self._bar.set_postfix_str(text, refresh=False)

    def __call__(self, rows: Iterable[T]) -> Iterator[T]:
        """Yield the items of an iterable and count them from zero."""
        self.done, self._began_s = 0, time.monotonic()
        with self:
            for row in rows:
                yield row
                self.update()

    def __enter__(self) -> 'Progress':
        """Return this object."""
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the progress bar from the terminal."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def _show(self) -> None:
        from tqdm import tqdm
        tqdm.monitor_interval = 0       # tqdm must not start a thread, because this process may fork
        self._bar = tqdm(leave=False, **self._options)
        self._bar.start_t = self._began_s - time.monotonic() + self._bar.start_t
        self._bar.set_postfix_str(self._note, refresh=False)
        self._bar.update(self.done)
