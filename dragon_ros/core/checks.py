"""Checks of single values, shared by the dataclasses of the core; each error names the field, the value and the limit.

Python and numpy numbers are treated alike.
"""
from cmath import exp
from math import isfinite, pi
from numbers import Integral, Real
from typing import Any

from dragon_ros.core.errors import FieldError, did_you_mean

_KINDS = {type(None): 'empty', str: 'text', bool: 'true or false', float: 'a fraction', list: 'a list',
          tuple: 'a list', dict: 'a mapping'}


def number(field: str, value: Any, *, low: float | None = None, above: float | None = None,
           high: float | None = None) -> float:
    """Return the value as a float (0.0 for -0.0) if it is a finite number within the limits, else raise FieldError."""
    is_number = isinstance(value, (int, float, Real)) and not isinstance(value, bool)
    if not is_number:
        raise FieldError(field, value, f'it is {_kind(value)}, not a number', _unquoted(value) or 'give a number')
    if not _is_finite(value):
        raise FieldError(field, value, 'it is not finite', 'give a finite number')
    if low is not None and value < low:
        raise FieldError(field, value, f'the smallest is {low:g}', f'give at least {low:g}')
    if above is not None and value <= above:
        raise FieldError(field, value, 'it is not positive' if above == 0 else f'it is not above {above:g}',
                         f'use a number above {above:g}')
    if high is not None and value > high:
        raise FieldError(field, value, f'the largest is {high:g}', f'give at most {high:g}')
    return float(value) + 0.0


def whole(field: str, value: Any, *, low: int, high: int) -> int:
    """Return the value if it is an integer within the limits, else raise FieldError."""
    if isinstance(value, float) and number(field, value) % 1 == 0:
        raise FieldError(field, value, 'it has a decimal point or exponent', f'write {value:.0f}')
    if isinstance(value, bool) or not isinstance(value, (int, Integral)):
        raise FieldError(field, value, f'it is {_kind(value)}, not a whole number',
                         _unquoted(value) or 'give a whole number')
    number(field, value, low=low, high=high)
    return int(value)


def plane_pose(field: str, text: str) -> tuple[complex, complex]:
    """Return the position (m) and the x axis of a pose X,Y,DEGREES as complex numbers. Raises FieldError."""
    try:
        x, y, degrees = map(float, text.split(','))
    except ValueError:
        raise FieldError(field, text, 'it must be X,Y,DEGREES', 'write for example 1.5,-2,90') from None
    x, y = (number(field, one, low=-1e9, high=1e9) for one in (x, y))
    return complex(x, y), exp(1j * number(field, degrees, low=-1e6, high=1e6) * pi / 180)


def choice(field: str, value: Any, choices: tuple[str, ...]) -> str:
    """Return the value if it is one of the choices, else raise FieldError."""
    if value not in choices:
        raise FieldError(field, value, f'the choices are {", ".join(choices)}',
                         did_you_mean(value, choices, 'give one of these'))
    return str(value)


def settle(settings: object, **values: Any) -> None:
    """Assign checked and normalised values to a frozen dataclass; call it only from ``__post_init__``.

    Equivalent settings then compare equal, have equal hashes and are written identically: 1 becomes 1.0, and -0.0
    becomes 0.0.
    """
    for name, value in values.items():
        object.__setattr__(settings, name, value)


class Settings:
    """A frozen dataclass that pickles only its fields, not its cached properties."""

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        """Return the class and its fields in order."""
        from dataclasses import fields  # importing dataclasses takes a sixth of the time that --help takes
        return type(self), tuple(getattr(self, one.name) for one in fields(self))      # type: ignore[arg-type]


def _is_finite(value: float) -> bool:
    try:
        return isfinite(value)
    except OverflowError:       # an integer beyond the largest float
        return False


def _kind(value: Any) -> str:
    """Return the type of a value, named as in a scene file."""
    return _KINDS.get(type(value), f'a {type(value).__name__}')


def _unquoted(value: Any) -> str | None:
    """Return a suggestion if the value is a number in quotes, otherwise None."""
    if not isinstance(value, str):
        return None
    try:
        return f'write {float(value):g} without quotes'
    except ValueError:
        return None
