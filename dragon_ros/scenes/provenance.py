"""Provenance of a run: its complete scene as a scene file, with versions, kernels, git state and settings."""
import ctypes
import os
import platform
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from importlib.util import find_spec
from math import inf
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
_DISTRIBUTIONS = {'3': 'humble', '7': 'jazzy', '9': 'kilted', '10': 'lyrical'}      # by major version of rclpy
ATTACHMENT = 'scene.yaml'
CLAIM = 'first_contact'     # key of ``about`` for the certificate's claim, if the run ends in its first contact
# Names of the OpenBLAS function that returns the kernel in use, in distribution builds and in numpy's wheels.
_CORE_NAMES = ('openblas_get_corename', 'openblas_get_corename64_', 'scipy_openblas_get_corename64_',
               'scipy_openblas_get_corename')


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Return the software versions and, in a checkout, the git commit (followed by ``+`` if files are modified)."""
    found = {'dragon_ros': __version__, 'python': platform.python_version(), 'numpy': np.__version__}
    commit = _git('rev-parse', 'HEAD')
    if commit:
        found['git'] = commit + ('+' if _git('status', '--porcelain', '--untracked-files=no') else '')
    return found


def ros_distro() -> str:
    """Return the ROS distribution that runs, by the version of its rclpy, or otherwise by ROS_DISTRO."""
    from importlib import metadata  # imported lazily: only a recorded run needs it
    with suppress(metadata.PackageNotFoundError):
        major = metadata.version('rclpy').partition('.')[0]
        if major in _DISTRIBUTIONS:
            return _DISTRIBUTIONS[major]
    return os.environ.get('ROS_DISTRO', 'unknown')


@lru_cache(maxsize=1)
def kernels() -> dict[str, str]:
    """Return this machine's kernels of BLAS and numpy and its C library, which determine the last bits of results.

    The entry for BLAS contains the name, the version and the kernel (``unknown`` if BLAS reports none); the entry for
    numpy lists its CPU features.
    """
    about: Mapping[str, Any] = np.show_config(mode='dicts')
    blas = about.get('Build Dependencies', {}).get('blas', {})
    simd = about.get('SIMD Extensions', {})
    name = ' '.join(str(blas[key]) for key in ('name', 'version') if key in blas) or 'unknown'
    return {'blas': f'{name}, kernel {_blas_kernel()}',
            'cpu_features': ' '.join([*simd.get('baseline', ()), *simd.get('found', ())]) or 'unknown',
            'libc': _libc()}


def _libc() -> str:
    """Return the name and version of the C library, whose sine and cosine the solvers use."""
    with suppress(AttributeError, ValueError, OSError):     # only Unix has it, and not all C libraries do
        return os.confstr('CS_GNU_LIBC_VERSION') or 'unknown'
    return 'unknown'


def other_kernel(made: Mapping[str, str]) -> str | None:
    """Describe how this machine's kernels differ from those that made a bag, given the bag's metadata record.

    Returns None if nothing differs or nothing is recorded.
    """
    here = {'numpy': np.__version__, **kernels()}
    return '; '.join(f'{key} {_only_in(there, value)}, here {_only_in(value, there)}' for key, value in here.items()
                     if (there := made.get(f'about.{key}', value)) != value) or None


def scene_file(scene: Scene, settings: Mapping[str, Any] | None = None) -> str:
    """Return the complete scene as a scene file; its section ``about`` lists versions, kernels and settings."""
    about = {**versions(), **kernels(), **(settings or {})}
    values = {**scene_values(scene), 'about': about}
    if scene.venue is None:
        return yaml.safe_dump(values, sort_keys=False)
    values['venue'] = _with_short_points(values['venue'])
    return yaml.safe_dump(values, sort_keys=False, width=inf)       # one line per list of points


def _with_short_points(value: Any) -> Any:
    """Return a venue's values with each list of points as text, which is much faster to read and write."""
    if isinstance(value, dict):
        return {key: _with_short_points(one) for key, one in value.items()}
    if isinstance(value, list) and value and all(isinstance(one, list) and len(one) == 2 and
                                                 all(isinstance(part, float) for part in one) for one in value):
        return ', '.join(f'{x!r} {y!r}' for x, y in value)
    return [_with_short_points(one) for one in value] if isinstance(value, list) else value


def differing_scene_file(scene: Scene, about: Mapping[str, Any]) -> str:
    """Return a scene file with the track and all non-default keys; ``about`` records its origin."""
    usual = scene_values(Scene())
    values = {key: value for key, value in scene_values(scene).items() if key == 'track' or value != usual.get(key)}
    return yaml.safe_dump({'about': {**about}, **values}, sort_keys=False, default_flow_style=None, width=120)


def run_metadata(text: str, scene: Scene | None, recorder: Mapping[str, str]) -> dict[str, str]:
    """Return the metadata record of a bag with the scene file ``text``; ``recorder`` lists its recorder's settings.

    ``scene`` is the scene described by the text, or None if this version cannot read it.
    """
    record = {'scene': text, **{f'about.{_text(key)}': _text(value) for key, value in _about(text).items()}}
    if scene is not None:
        model = compile_scene(scene)
        record |= {'promise_m': repr(model.promise_m),
                   'effects': ', '.join(scene.effects.names)}
    return record | {f'recorder.{key}': value for key, value in recorder.items()}


def _only_in(words: str, others: str) -> str:
    """Return the words that the other list lacks, because two lists of CPU features differ in only a few words."""
    known = set(others.split())
    left = [word for word in words.split() if word not in known]
    return shown(' '.join(left)) if left else 'fewer'


def _blas_kernel() -> str:
    """Return the kernel of OpenBLAS, found through the libraries that numpy's linear algebra links to."""
    linked = find_spec('numpy.linalg._umath_linalg')
    with suppress(OSError):
        library = ctypes.CDLL(linked.origin if linked else None)
        for name in _CORE_NAMES:
            if hasattr(library, name):
                function = getattr(library, name)
                function.restype = ctypes.c_char_p
                return (function() or b'unknown').decode(errors='replace')
    return 'unknown'


def _about(text: str) -> dict[str, Any]:
    with suppress(DragonError):
        return parse_document(ATTACHMENT, text).section('about')
    return {}


def _text(value: Any) -> str:
    return value if isinstance(value, str) else shown(value)


def _git(*arguments: str) -> str:
    """Return the output of a git command in the checkout that contains this code, or '' outside a checkout."""
    root = Path(__file__).resolve().parents[2]
    if not (root / '.git').exists():
        return ''
    import subprocess  # imported lazily: reading a bag must not start a process
    with suppress(OSError, subprocess.SubprocessError):
        # With a lock, a status that is killed or finds a full disk would leave index.lock behind, which blocks git.
        return subprocess.run(['git', '--no-optional-locks', '-C', str(root), *arguments], capture_output=True,
                              text=True, check=True, timeout=5).stdout.strip()
    return ''
