"""Files that are written completely or not at all."""
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EBUSY
from pathlib import Path
from secrets import token_hex
from stat import S_ISREG
from typing import IO


@contextmanager
def whole_or_none(path: Path, overwrite: bool) -> Iterator[IO[bytes]]:
    """Create a file, and remove it if writing fails; an old file is replaced only when the new one is complete.

    A replaced file keeps its permissions, and a symbolic link to it stays. Devices, pipes, files with several names or
    another owner, and files in a folder in which no file can be created, are written in place: if writing fails, the
    old content is lost. Raises OSError.
    """
    if not overwrite:
        with path.open('xb') as file:
            try:
                yield file
            except BaseException:
                path.unlink(missing_ok=True)
                raise
        return
    target = Path(os.path.realpath(path))
    part = _part_beside(path, target)
    if part is None:
        with path.open('wb') as file:
            yield file
        return
    try:
        with part.open('wb') as file:
            yield file
        if target.exists():
            shutil.copymode(target, part)
        _replace(target, part)
    finally:
        part.unlink(missing_ok=True)


def _part_beside(path: Path, target: Path) -> Path | None:
    """Create a file that will replace the target of a path; return None if the target must be written in place."""
    part = target.with_name(f'.dragon_ros-{token_hex(4)}.part')
    with suppress(FileNotFoundError):
        now = path.stat()
        if not S_ISREG(now.st_mode) or now.st_nlink > 1 or now.st_uid != os.geteuid() or _is_open_file(path):
            return None
        os.close(os.open(target, os.O_WRONLY))      # raises the error of a read-only file
        try:
            part.touch()
        except PermissionError:
            return None
        return part
    part.touch()
    return part


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
