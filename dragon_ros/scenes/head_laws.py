"""Custom head laws: Python entry points in the group ``dragon_ros.head_laws``.

An entry point is a function that receives the settings from a scene file as keyword arguments and returns a ``Head`` or
a ``Profile`` of ``dragon_ros.core.chain.head_law``. The function must return the same law for the same settings. The
scene stores the returned law instead of the entry point's name, so a bag can be recomputed without the plug-in. Entry
points are loaded only for scene files and command lines, never for bags or topics.
"""
from typing import TYPE_CHECKING, Any

from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.scenes.yaml import Document

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = 'dragon_ros.head_laws'
PLUGIN = 'plugin'
KEYS = ('kind', 'law', 'settings')


def plugged(document: Document) -> Head | Profile:
    """Return the custom head law named in the section head. Raises InputError if the law is missing or invalid."""
    given = document.section('head')
    document.check_keys('head.', given, KEYS)
    name, settings = given.get('law'), given.get('settings', {})
    if not isinstance(settings, dict) or not all(isinstance(key, str) for key in settings):
        document.refuse('head.settings', f'its value is {settings!r}; write a mapping of names to values')
    found = _found(document, name)
    try:
        make = found.load()
        laws = [make(**settings) for _ in range(2)]
    except Exception as error:      # noqa: BLE001 - third-party code may raise anything
        document.refuse('head.law', f'{name} ({found.value}) failed: {type(error).__name__}: {error}')
    law: Any = laws[0]
    if type(law) not in (Head, Profile):
        document.refuse('head.law', f'{name} ({found.value}) returned {type(law).__name__}; it must return a Head or '
                        'a Profile of dragon_ros.core.chain.head_law')
    if law != laws[1]:
        document.refuse('head.law', f'{name} ({found.value}) returned two different laws for the same settings, so the '
                        'run would not be reproducible')
    return law      # type: ignore[no-any-return]


def _found(document: Document, name: Any) -> 'EntryPoint':
    """Return the entry point with the given name, without loading it."""
    from importlib.metadata import entry_points  # imported lazily: the import takes a tenth of the run time of `table`
    known = entry_points(group=GROUP)
    found = [one for one in known if one.name == name]
    if len(found) != 1:
        names = ', '.join(sorted({one.name for one in known})) or 'none is installed'
        document.refuse('head.law', f'{name!r} is {"defined twice" if found else "unknown"}; entry points in {GROUP}: '
                        f'{names}')
    return found[0]
