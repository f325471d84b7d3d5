"""The files of a bag: a single .mcap file, or a rosbag2 folder with metadata.yaml and its parts."""
import re
from pathlib import Path

from dragon_ros.bags.read.mcap import BagError
from dragon_ros.core.errors import MissingError
from dragon_ros.scenes.yaml import read_document

METADATA = 'metadata.yaml'
_ROOT = 'rosbag2_bagfile_information'
_LARGEST = 2**20        # bytes of metadata.yaml that are parsed


def files_of(path: Path) -> list[Path]:
    """Return the .mcap files of a bag in their order. Raises MissingError or BagError.

    ``path`` is a file, a folder, or the metadata.yaml in it. A folder without metadata.yaml, as a
    killed recorder leaves it, consists of the parts in it.
    """
    folder = path.parent if path.name == METADATA else path
    if not folder.is_dir():
        return [path]
    listed = folder / METADATA
    parts = _listed(listed) if listed.is_file() else _found(folder)
    if not parts:
        raise BagError(f'{folder}: is a folder without .mcap files; give a bag (rosbag2 folders in sqlite3 can be '
                       'turned into MCAP with `ros2 bag convert`)')
    return parts


def _found(folder: Path) -> list[Path]:
    def number(path: Path) -> tuple[int, str]:
        digits = re.search(r'_(\d+)$', path.stem)
        return int(digits[1]) if digits else -1, path.name
    return sorted(folder.glob('*.mcap'), key=number)


def _listed(path: Path) -> list[Path]:
    """Return what metadata.yaml lists; paths outside its folder are rejected."""
    if path.stat().st_size > _LARGEST:
        raise BagError(f'{path}: has {path.stat().st_size} bytes; the largest that is read has {_LARGEST}')
    section = read_document(path).values.get(_ROOT)
    section = section if isinstance(section, dict) else {}
    names = section.get('relative_file_paths')
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BagError(f'{path}: has no list {_ROOT}.relative_file_paths; it is not the metadata of a bag')
    if str(section.get('compression_mode')).lower() == 'message':
        raise BagError(f'{path}: its messages are compressed one by one, which is not supported; compress the storage '
                       'instead (`ros2 bag convert`)')
    for name in names:
        if not name.endswith('.mcap') or Path(name).name != name:
            raise BagError(f'{path}: lists {name!r}; expected the names of .mcap files in its folder')
    for name in names:
        if not (path.parent / name).exists():
            raise MissingError(f'{path}: lists {name}, which is not there')
    return [path.parent / name for name in names]
