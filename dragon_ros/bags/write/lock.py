"""Lock files and folders against other processes; on systems other than Linux and macOS, nothing is locked."""
from typing import IO


def lock(file: int | IO[bytes] | IO[str]) -> None:
    """Lock an open file or folder until it is closed. Raises BlockingIOError if another process has locked it."""
    try:
        from fcntl import LOCK_EX, LOCK_NB, flock
    except ImportError:
        return
    flock(file, LOCK_EX | LOCK_NB)
