"""Files that are either complete or absent."""
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO


@contextmanager
def whole_or_none(path: Path, overwrite: bool) -> Iterator[IO[bytes]]:
    """Create a file, and remove it if writing fails. Raises OSError."""
    with path.open('wb' if overwrite else 'xb') as file:
        try:
            yield file
        except BaseException:
            path.unlink(missing_ok=True)
            raise
