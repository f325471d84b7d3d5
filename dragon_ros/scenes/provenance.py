"""Provenance of a run: its complete scene as a scene file, with versions, git state and settings."""
import platform
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dragon_ros.core.errors import DragonError, shown
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.scenes.load import scene_values
from dragon_ros.scenes.yaml import parse_document
from dragon_ros.version import __version__

RECORD = 'dragon_ros'
ATTACHMENT = 'scene.yaml'


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Return the versions of the software, and the git commit in a checkout (``+`` where modified)."""
    found = {'dragon_ros': __version__, 'python': platform.python_version(), 'numpy': np.__version__}
    commit = _git('rev-parse', 'HEAD')
    if commit:
        found['git'] = commit + ('+' if _git('status', '--porcelain', '--untracked-files=no') else '')
    return found


def scene_file(scene: Scene, settings: Mapping[str, Any] | None = None) -> str:
    """Return the complete scene as a scene file; its section ``about`` holds versions and other settings."""
    return yaml.safe_dump({**scene_values(scene), 'about': {**versions(), **(settings or {})}}, sort_keys=False)


def run_metadata(text: str, scene: Scene | None, recorder: Mapping[str, str]) -> dict[str, str]:
    """Return the metadata record of a bag with the scene file ``text``; ``recorder`` holds settings of its recorder.

    ``scene`` is what the text describes, None where this version cannot read it.
    """
    record = {'scene': text, **{f'about.{_text(key)}': _text(value) for key, value in _about(text).items()}}
    if scene is not None:
        model = compile_scene(scene)
        record |= {'tier': model.tier.name, 'promise_m': repr(model.promise_m),
                   'effects': ', '.join(scene.effects.names)}
    return record | {f'recorder.{key}': value for key, value in recorder.items()}


def _about(text: str) -> dict[str, Any]:
    with suppress(DragonError):
        return parse_document(ATTACHMENT, text).section('about')
    return {}


def _text(value: Any) -> str:
    return value if isinstance(value, str) else shown(value)


def _git(*arguments: str) -> str:
    """Return the git commit of the checkout that holds this code; '' outside of one."""
    root = Path(__file__).resolve().parents[2]
    if not (root / '.git').exists():
        return ''
    import subprocess  # who reads a bag starts nothing
    with suppress(OSError, subprocess.SubprocessError):
        return subprocess.run(['git', '-C', str(root), *arguments], capture_output=True, text=True, check=True,
                              timeout=5).stdout.strip()
    return ''
