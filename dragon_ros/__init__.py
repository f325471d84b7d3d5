"""A bench dragon simulator for ROS 2: nodes, tools, and a model that does not need ROS.

This module provides the public Python API (``docs/python.md``). Its names are imported on first use, so that nodes and
commands load only the modules that they need.
"""
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dragon_ros.api.bag import Bag, inspect_bag, read_bag, repair_bag
    from dragon_ros.api.design import Room, design
    from dragon_ros.api.plot import plot
    from dragon_ros.api.simulated import (
        Clearance,
        Motion,
        Simulated,
        compile,  # noqa: A004
        gaps,
        scene,
        scene_from,
        scene_values,
        write_bag,
    )
    from dragon_ros.bags.check.compare import Comparison
    from dragon_ros.bags.check.summary import BagSummary
    from dragon_ros.core.chain.dragon import Dragon
    from dragon_ros.core.errors import DiskError, DragonError, FieldError, InputError, MissingError, ModelEnd
    from dragon_ros.core.scene import Run, Scene
    from dragon_ros.core.search.certificate import Contact, NoContact
    from dragon_ros.core.search.venue_fit import VenueFit
    from dragon_ros.core.tracks.spec import Spiral, STurn
    from dragon_ros.version import __version__ as __version__

__all__ = ['Bag', 'BagSummary', 'Clearance', 'Comparison', 'Contact', 'DiskError', 'Dragon', 'DragonError',
           'FieldError', 'InputError', 'MissingError', 'ModelEnd', 'Motion', 'NoContact', 'Room', 'Run', 'STurn',
           'Scene', 'Simulated', 'Spiral', 'VenueFit', 'compile', 'design', 'gaps', 'inspect_bag', 'plot', 'read_bag',
           'repair_bag', 'scene', 'scene_from', 'scene_values', 'write_bag']
_FROM = {
    'api.bag': 'Bag inspect_bag read_bag repair_bag',
    'api.design': 'Room design',
    'api.plot': 'plot',
    'api.simulated': 'Clearance Motion Simulated compile gaps scene scene_from scene_values write_bag',
    'bags.check.compare': 'Comparison',
    'bags.check.summary': 'BagSummary',
    'core.chain.dragon': 'Dragon',
    'core.errors': 'DiskError DragonError FieldError InputError MissingError ModelEnd',
    'core.scene': 'Run Scene',
    'core.search.certificate': 'Contact NoContact',
    'core.search.venue_fit': 'VenueFit',
    'core.tracks.spec': 'STurn Spiral',
    'version': '__version__',
}
_MODULES = {name: f'dragon_ros.{module}' for module, names in _FROM.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """Import a name of the public API, or the version, on first use (PEP 562)."""
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted([*__all__, '__version__'])
