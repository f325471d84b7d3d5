"""The files of a bag: a single .mcap file, or a rosbag2 folder with metadata.yaml and its parts."""
import re
from pathlib import Path

from dragon_ros.bags.read.mcap import BagError
from dragon_ros.core.errors import MissingError, shown
from dragon_ros.core.limits import FOLDER_BYTES, FOLDER_FILES
from dragon_ros.scenes.yaml import read_document

METADATA = 'metadata.yaml'
_ROOT = 'rosbag2_bagfile_information'
_PART = re.compile(r'(.*)_(\d{1,9})')


def files_of(path: Path) -> list[Path]:
    """Return the .mcap files of a bag in order. Raises MissingError or BagError.

    ``path`` is a file, a folder, or the metadata.yaml in it. A killed recorder leaves parts that metadata.yaml does not
    list, or no metadata.yaml at all; these parts still belong to the bag.
    """
    folder = _folder_of(path)
    if folder is None:
        return [path]
    listed, others = _parts(folder)
    if not listed and not others:
        raise BagError(f'{folder}: is a folder without .mcap files; give a bag (a rosbag2 folder in sqlite3 format can '
                       'be converted to MCAP with `ros2 bag convert`)')
    if len(listed) + len(others) > FOLDER_FILES:
        raise BagError(f'{folder}: has {len(listed) + len(others)} files; the limit is {FOLDER_FILES}')
    return listed + others


def unlisted(path: Path) -> list[Path]:
    """Return the parts that a bag's metadata.yaml does not list, or [] if there is no such file. Raises BagError."""
    folder = _folder_of(path)
    return [] if folder is None or not (folder / METADATA).is_file() else _parts(folder)[1]


def _folder_of(path: Path) -> Path | None:
    folder = path.parent if path.name == METADATA else path
    try:
        return folder if folder.is_dir() else None
    except OSError as error:        # for example, the name is too long
        raise MissingError(f'{shown(str(path))}: cannot be read: {error.strerror}') from None


def _parts(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return the parts that metadata.yaml lists, and similarly named files (all files if there is no metadata.yaml)."""
    listed = _listed(folder / METADATA) if (folder / METADATA).is_file() else None
    stems = {_number(part)[0] for part in listed or ()}
    others = [part for part in folder.glob('*.mcap')
              if listed is None or (part not in listed and _number(part)[0] in stems - {''})]
    return listed or [], sorted(others, key=lambda part: (_number(part)[1], part.name))


def _number(part: Path) -> tuple[str, int]:
    """Return the name of a part without its number, and its number."""
    found = _PART.fullmatch(part.stem)
    return (found[1], int(found[2])) if found else ('', -1)


def _listed(path: Path) -> list[Path]:
    """Return the parts that metadata.yaml lists; reject paths outside its folder and duplicates."""
    if path.stat().st_size > FOLDER_BYTES:
        raise BagError(f'{path}: has {path.stat().st_size} bytes; the limit is {FOLDER_BYTES}')
    section = read_document(path).values.get(_ROOT)
    section = section if isinstance(section, dict) else {}
    names = section.get('relative_file_paths')
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BagError(f'{path}: has no list {_ROOT}.relative_file_paths, so it is not the metadata of a bag')
    if str(section.get('compression_mode')).lower() == 'message':
        raise BagError(f'{path}: its messages are compressed individually, which is not supported; compress the '
                       'storage instead (`ros2 bag convert`)')
    for name in names:
        if not name.endswith('.mcap') or Path(name).name != name:
            raise BagError(f'{path}: lists {shown(name)}; expected the names of .mcap files in its folder')
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise BagError(f'{path}: lists {twice} {names.count(twice)} times; each file may be listed only once')
    for name in names:
        if not (path.parent / name).exists():
            raise MissingError(f'{path}: lists {name}, which does not exist')
    return [path.parent / name for name in names]
