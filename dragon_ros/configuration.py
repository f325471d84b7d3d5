"""Locate the configuration files of the package."""
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from dragon_ros.core.errors import MissingError


def folder() -> Path:
    """Return the ``msg_configs`` folder that belongs to the running code.

    The search order is: a source tree (a checkout, ``--symlink-install``, ``pip install -e``), the install prefix of
    this file, the ament index, and the Python prefix. Therefore, an older installed copy never shadows a checkout.
    """
    for candidate in _candidates():
        if (candidate / 'topics.yaml').is_file():
            return candidate
    raise MissingError('msg_configs/topics.yaml was not found near the package; reinstall dragon_ros with '
                       'pip, or build it with colcon and source its setup file')


def scene_names() -> list[str]:
    """Return the names of the scenes that come with the package."""
    return sorted(path.stem for path in (folder() / 'scenes').glob('*.yaml'))


def _candidates() -> Iterator[Path]:
    here = Path(__file__).resolve()
    yield here.parents[1] / 'msg_configs'
    prefixes = [*here.parents[2:6], *map(Path, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)),
                Path(sys.prefix)]
    for prefix in prefixes:
        yield prefix / 'share' / 'dragon_ros' / 'msg_configs'
