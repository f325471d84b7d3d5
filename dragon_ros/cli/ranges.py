"""Parse the times and handles given on a command line: numbers and ranges, separated by commas."""
from collections.abc import Callable, Iterator
from re import compile as pattern

from dragon_ros.core.checks import number
from dragon_ros.core.errors import InputError, shown

_LATEST_S = 1e10        # later than any time stamp
_MOST = 10**7           # largest number of values that one option can specify
_DASHED = pattern(r'([\d.]+)-([\d.]+)')


def times_of(text: str, option: str = '--times') -> list[float]:
    """Return the times (s) that ``text`` specifies, such as ``0,60,300``, ``0-10`` or ``0:300:10``.

    Ranges include both ends.
    """
    return list(_values(text, option, lambda part: number(f'{option}: t_s', float(part), low=-_LATEST_S,
                                                          high=_LATEST_S)))


def handles_of(text: str | None, benches: int, option: str = '--handles') -> list[int]:
    """Return the handles that ``text`` specifies, such as ``0,1,51``, ``0-10`` or ``0:223:10``; None means all."""
    if text is None:
        return list(range(benches + 1))
    handles = [int(value) for value in _values(text, option, int)]
    for handle in handles:
        if not 0 <= handle <= benches:
            raise InputError(f'{option} {shown(handle)}: the dragon has handles 0 to {benches}',
                             field=option.removeprefix('--'))
    return handles


def _values(text: str, option: str, read: Callable[[str], float]) -> Iterator[float]:
    """Yield the values of all comma-separated parts of ``text``.

    Raises InputError for an invalid part or too many values.
    """
    room = _MOST
    for part in text.split(','):
        try:
            start, step, count = _range(part, option, read)
        except ValueError:
            raise InputError(f'{option} {shown(text)}: {shown(part)} is neither a number nor a range; write 0,60,300 '
                             'or 0-10 or START:STOP:STEP', field=option.removeprefix('--')) from None
        room -= count
        if room < 0:
            raise InputError(f'{option} {text}: it gives more than {_MOST} values; use a larger step',
                             field=option.removeprefix('--'))
        yield from (start + k * step for k in range(count))


def _range(part: str, option: str, read: Callable[[str], float]) -> tuple[float, float, int]:
    """Return the first value, the step and the number of values of a number, FIRST-LAST or START:STOP[:STEP]."""
    dashed = _DASHED.fullmatch(part)
    ends = dashed.groups() if dashed else part.split(':')
    if len(ends) == 1:
        return read(part), 0, 1
    start, stop, step = (*map(read, ends), 1) if len(ends) == 2 else map(read, ends)
    if not (step > 0 and stop >= start):
        raise InputError(f'{option} {part}: the step must be positive, and the stop must not be before the start',
                         field=option.removeprefix('--'))
    return start, step, int(min((stop - start) / step * (1 + 1e-12), _MOST)) + 1
