"""Files that are written completely or not at all."""
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from errno import EBUSY, EEXIST
from pathlib import Path
from secrets import token_hex
from stat import S_ISREG
from typing import IO


@contextmanager
def whole_or_none(path: Path, overwrite: bool) -> Iterator[IO[bytes]]:
    """Write a file beside its place, and move it there when it is complete, so that it is never incomplete.

    A replaced file keeps its permissions, and a symbolic link to it stays. Devices, pipes, files with several names or
    another owner, and files in a folder in which no file can be created, are written in place: if writing fails, the
    old content is lost. Raises OSError, and FileExistsError for an existing file that may not be replaced.
    """
    target = Path(os.path.realpath(path))
    if not overwrite:
        if os.path.lexists(path):
            raise FileExistsError(EEXIST, os.strerror(EEXIST), str(path))
        with _part_of(target) as part:
            with part.open('wb') as file:
                yield file
            _place_new(target, part)
        return
    if _in_place(path, target):
        with path.open('wb') as file:
            yield file
        return
    with _part_of(target) as part:
        with part.open('wb') as file:
            yield file
        if target.exists():
            shutil.copymode(target, part)
        _replace(target, part)


@contextmanager
def _part_of(target: Path) -> Iterator[Path]:
    """Create an empty file beside a target, and remove it at the end if it has not been moved."""
    part = target.with_name(f'.dragon_ros-{token_hex(4)}.part')
    try:
        part.touch()
        yield part
    finally:
        part.unlink(missing_ok=True)


def _place_new(target: Path, part: Path) -> None:
    """Move a complete file to a place where there must be none."""
    try:
        os.link(part, target)
    except FileExistsError:
        raise
    except OSError:         # a file system without hard links
        if target.exists():
            raise FileExistsError(EEXIST, os.strerror(EEXIST), str(target)) from None
        part.replace(target)


def _in_place(path: Path, target: Path) -> bool:
    """Return whether an existing target cannot be replaced by another file. Raises OSError for a read-only file."""
    try:
        now = path.stat()
    except FileNotFoundError:
        return False
    if not S_ISREG(now.st_mode) or now.st_nlink > 1 or _is_foreign(now) or _is_open_file(path):
        return True
    os.close(os.open(target, os.O_WRONLY))
    return not os.access(target.parent, os.W_OK)


def _is_foreign(now: os.stat_result) -> bool:
    return hasattr(os, 'geteuid') and now.st_uid != os.geteuid()        # Windows has no such owners


def _is_open_file(path: Path) -> bool:
    """Return whether a path such as /dev/stdout names a file that a process has open."""
    folder = Path(os.path.abspath(path)).parent
    return folder in (Path('/dev'), Path('/dev/fd')) or folder.is_relative_to('/proc')


def _replace(target: Path, part: Path) -> None:
    """Replace a file by another one or, if it is a mount point as in a container, replace its content."""
    try:
        part.replace(target)
    except OSError as error:
        if error.errno != EBUSY:
            raise
        shutil.copyfile(part, target)
