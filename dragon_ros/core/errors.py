"""Errors that a person can act on: each states the value, the limit and the cure, and carries them as fields."""
from collections.abc import Iterable
from typing import Any

_MOST_SHOWN = 100       # characters of a value in an error
_NEAR = 0.65            # of difflib: pich_m is near pitch_m (0.92), obstacles is not near trails (0.53)


def shown(value: object) -> str:
    """Return a value as an error shows it: its Python form, abbreviated where it is long."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):        # an integer of thousands of digits, or nested without end
        return f'a huge {type(value).__name__}'
    return text if len(text) <= _MOST_SHOWN else f'{text[:_MOST_SHOWN // 2]}...{text[-_MOST_SHOWN // 4:]}'


def did_you_mean(word: object, known: Iterable[str], otherwise: str, alike: float = _NEAR) -> str:
    """Return a question with the name that is nearest to a word, or ``otherwise`` where none is as much ``alike``."""
    from difflib import get_close_matches  # rarely needed
    near = get_close_matches(str(word), known, n=1, cutoff=alike)
    return f'did you mean {near[0]}?' if near else otherwise


class DragonError(Exception):
    """Root of every error that dragon_ros raises on purpose.

    ``fields`` holds the numbers behind the message, for programs.
    """

    def __init__(self, message: str, **fields: Any) -> None:
        """Keep the message for people and the fields for programs."""
        super().__init__(message)
        self.fields = fields


class InputError(DragonError):
    """A value from outside (file, parameter, command line, message, bag) is not acceptable."""


class FieldError(InputError):
    """One named field has an unacceptable value."""

    def __init__(self, field: str, value: Any, limit: str, cure: str) -> None:
        """Say which field, what it was, what it may be and what to do."""
        super().__init__(f'{field}: {shown(value)} is not possible, {limit}; {cure}',
                         field=field, value=value, limit=limit, cure=cure)


class MissingError(InputError):
    """Something that was asked for by name or path is not there or cannot be read."""


class DiskError(DragonError):
    """What was being written cannot go on: the disk is full, a limit is reached, the file has vanished."""


class ModelEnd(DragonError):
    """The model has no state at the asked time; ``fields`` has ``t_s`` and the limit."""


class TrackEndError(ModelEnd):
    """The head would have left the track."""


class ChainLockError(ModelEnd):
    """A link finds no place on the track any more: the smallest root of its chord equation has vanished."""


class CrowdError(InputError):
    """So many benches lie in one place that their pairs cannot be tested one by one."""
