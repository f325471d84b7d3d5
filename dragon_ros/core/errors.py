"""Errors with a cure: each states the value, the limit and the cure, and also stores them as fields."""
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

_OPTION = re.compile('--([a-z][a-z-]*)')

_MOST_SHOWN = 100       # maximum length, in characters, of a value in an error
_NEAR = 0.65            # minimum difflib ratio: pich_m is close to pitch_m (0.92), obstacles not close to trails (0.53)


def shown(value: object) -> str:
    """Return a value as text for an error message: its ``repr``, abbreviated if it is long."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):        # an integer with thousands of digits, or endless nesting
        return f'a huge {type(value).__name__}'
    return text if len(text) <= _MOST_SHOWN else f'{text[:_MOST_SHOWN // 2]}...{text[-_MOST_SHOWN // 4:]}'


def did_you_mean(word: object, known: Iterable[str], otherwise: str, alike: float = _NEAR) -> str:
    """Return a question suggesting the known name most similar to a word, or ``otherwise`` if none is similar."""
    from difflib import get_close_matches  # rarely needed
    names = {name.lower(): name for name in known}
    near = get_close_matches((word if isinstance(word, str) else shown(word)).lower(), names, n=1, cutoff=alike)
    return f'did you mean {names[near[0]]}?' if near else otherwise


@contextmanager
def naming_arguments() -> Iterator[None]:
    """In errors of the Python API, name arguments instead of options, except in commands, which stand in backquotes.

    A command that is built on the API shows the message with its options, ``naming_options``.
    """
    try:
        yield
    except DragonError as error:
        error.naming_options = error.naming_options or str(error)
        parts = error.naming_options.split('`')
        parts[::2] = [_OPTION.sub(lambda found: found[1].replace('-', '_'), part) for part in parts[::2]]
        error.args = ('`'.join(parts),)
        raise


class DragonError(Exception):
    """Base class of all errors that dragon_ros raises deliberately.

    ``fields`` holds the values in the message, for use by programs.
    """

    def __init__(self, message: str, **fields: Any) -> None:
        """Store the message for people and the fields for programs."""
        super().__init__(message)
        self.fields = fields
        self.naming_options = ''


class InputError(DragonError):
    """An external value (file, parameter, command line, message, bag) is not acceptable."""


class FieldError(InputError):
    """One named field has an unacceptable value."""

    def __init__(self, field: str, value: Any, limit: str, cure: str) -> None:
        """Name the field, its value, the allowed values and the cure."""
        super().__init__(f'{field}: {shown(value)} is not valid: {limit}; {cure}',
                         field=field, value=value, limit=limit, cure=cure)


class MissingError(InputError):
    """Something requested by name or path does not exist or cannot be read."""


class DiskError(DragonError):
    """Writing cannot continue: the disk is full, a limit is reached, or the file has vanished."""


class ModelEnd(DragonError):
    """The model has no state at the requested time; ``fields`` holds ``t_s`` and the limit."""


class TrackEndError(ModelEnd):
    """A handle would be beyond the end of the track."""


class ChainLockError(ModelEnd):
    """A link can no longer be placed on the track: the smallest root of its chord equation has vanished."""


class CrowdError(InputError):
    """Too many benches are so close together that testing their pairs one by one would take too long."""
