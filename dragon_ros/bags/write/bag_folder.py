"""The folder of a bag being written: locked against other writers, with space reserved for its metadata.yaml."""
import os
from contextlib import suppress
from pathlib import Path

from dragon_ros.bags.write.empty_bag import holds_no_message
from dragon_ros.bags.write.lock import lock
from dragon_ros.core.errors import DiskError, MissingError

_METADATA = 'metadata.yaml'


class BagFolder:
    """A folder with the parts of one bag.

    While a part is being written, ``metadata.yaml.new`` already has the final size of the metadata, so that the parts
    can be listed even if the disk fills up.
    """

    def __init__(self, path: Path, replace: bool) -> None:
        """Create and lock the folder; replacing a folder removes only its bag files. Raises MissingError."""
        self.path, self._new, self._is_new = path, path / f'{_METADATA}.new', not path.exists()
        parts = sorted(path.glob(f'{Path(os.path.realpath(path)).name}_*.mcap'))
        replace = replace or (bool(parts) and all(map(holds_no_message, parts)))
        try:
            path.mkdir(exist_ok=replace)
            self._lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        except FileExistsError:
            raise MissingError(f'{path}: it already exists; give another --output, or --force to replace it') from None
        except OSError as error:
            raise MissingError(f'{path}: cannot be written: {error.strerror}; give another --output') from None
        try:
            lock(self._lock)
            for old in (*parts, path / _METADATA):
                old.unlink(missing_ok=True)
        except BlockingIOError:
            self.close()
            raise MissingError(f'{path}: another recorder is writing it; give another --output') from None
        except OSError as error:
            self.close()
            raise MissingError(f'{path}: cannot be written: {error.strerror}; give another --output') from None

    def reserve(self, size: int) -> None:
        """Reserve space for metadata of ``size`` bytes before a part begins. Raises DiskError."""
        try:
            self._new.write_bytes(bytes(size))
        except OSError as error:
            raise self._fault(f'{self.path}: no further part can begin: {error.strerror}; earlier data are kept'
                              ) from None

    def write_metadata(self, text: str) -> None:
        """Replace metadata.yaml atomically. Raises DiskError."""
        try:
            with self._new.open('r+b' if self._new.exists() else 'wb') as file:
                file.write(text.encode())
                file.truncate()
            self._new.replace(self.path / _METADATA)
        except OSError as error:
            with suppress(OSError):
                self._new.unlink(missing_ok=True)
            raise self._fault(f'{self.path / _METADATA}: cannot be written: {error.strerror}; `inspect` can read '
                              'the .mcap files without it') from None

    def abandon(self) -> None:
        """Remove a folder that was created in vain, so that nothing prevents another attempt."""
        with suppress(OSError):
            self._new.unlink(missing_ok=True)
            if self._is_new:
                self.path.rmdir()
        self.close()

    def close(self) -> None:
        """Unlock the folder."""
        os.close(self._lock)

    def _fault(self, what: str) -> DiskError:
        gone = f'{self.path}: no longer exists; it was moved or removed during recording'
        return DiskError(what if self.path.is_dir() else gone)
