"""The functions that compute the effects; the modules of effects that are off are not imported."""
from importlib import import_module
from importlib.util import find_spec
from typing import Any


def __getattr__(name: str) -> Any:
    """Import a module of this folder on first access (PEP 562), after which it is an attribute of the package."""
    if not name.startswith('_') and find_spec(f'{__name__}.{name}'):
        return import_module(f'{__name__}.{name}')
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
