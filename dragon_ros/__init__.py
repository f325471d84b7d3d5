"""Bench dragon simulator for ROS 2: the model without ROS, its nodes, and their tools.

What this module offers is the public Python API (``docs/python.md``); it is imported when it is first used, so that a
node or a command pays for what it uses alone.
"""
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dragon_ros.api import Bag, Motion, Simulated, compile, design, plot, read_bag, scene  # noqa: A004

__version__ = '0.2.0'
__all__ = ['Bag', 'Motion', 'Simulated', 'compile', 'design', 'plot', 'read_bag', 'scene']


def __getattr__(name: str) -> Any:
    """Import the public API when one of its names is first asked for (PEP 562)."""
    if name in __all__:
        return getattr(import_module('dragon_ros.api'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted([*globals(), *__all__])
