"""A bench dragon simulator for ROS 2: nodes, tools, and a model that does not need ROS.

This module provides the public Python API (``docs/python.md``). Its names are imported on first use, so that nodes and
commands load only the modules that they need.
"""
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dragon_ros.api import (
        Bag,
        Clearance,
        Contact,
        DiskError,
        Dragon,
        DragonError,
        FieldError,
        InputError,
        MissingError,
        ModelEnd,
        Motion,
        NoContact,
        Run,
        Scene,
        Simulated,
        Spiral,
        STurn,
        compile,  # noqa: A004
        design,
        gaps,
        plot,
        read_bag,
        scene,
        scene_from,
        scene_values,
    )
    from dragon_ros.version import __version__ as __version__

__all__ = ['Bag', 'Clearance', 'Contact', 'DiskError', 'Dragon', 'DragonError', 'FieldError', 'InputError',
           'MissingError', 'ModelEnd', 'Motion', 'NoContact', 'Run', 'STurn', 'Scene', 'Simulated', 'Spiral', 'compile',
           'design', 'gaps', 'plot', 'read_bag', 'scene', 'scene_from', 'scene_values']


def __getattr__(name: str) -> Any:
    """Import a name of the public API, or the version, on first use (PEP 562)."""
    if name == '__version__':
        return import_module('dragon_ros.version').__version__
    if name in __all__:
        return getattr(import_module('dragon_ros.api'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted([*__all__, '__version__'])
