"""Parameter studies: many scenes, each with a row of answers, stored as Parquet."""
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dragon_studies.api import Rows, study

__all__ = ['Rows', 'study']


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name in __all__:
        from dragon_studies import api
        return getattr(api, name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
