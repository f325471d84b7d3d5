"""The functions that compute the effects; the modules of effects that are off are not imported."""
from collections.abc import Callable
from importlib import import_module
from typing import Any

_MODULES = {'closeness': 'proximity', 'contacts': 'proximity', 'accelerations': 'dynamics', 'tensions': 'dynamics',
            'noisy_handles': 'noise', 'trail': 'trails', 'chain_health': 'health', 'leader_motion': 'leading',
            'joint_angles': 'joints'}


def __getattr__(name: str) -> Callable[..., Any]:
    """Import a function on first access (PEP 562), and store it in this module."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    found: Callable[..., Any] = getattr(import_module(f'dragon_ros.core.effects.{_MODULES[name]}'), name)
    globals()[name] = found
    return found
