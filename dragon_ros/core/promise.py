"""The promise: how far any handle may be from its true position, in metres, at all times of a scene.

Positions are computed from coordinates along the track, which floats round to 2^-53 of their size. The leader's has up
to 16 such errors, and the links add them up without more (Kahan's summation); near a lock, the handles move
``chain.conditioning`` times as fast as the leader, and so do their errors. Points are rounded, too: by at most 1e-13 of
their distance from the origin, or 2e-12 m. The promise is tested against 50 digits in every case of ``hard_cases``, not
proved.
"""
from typing import Any

from dragon_ros.core.errors import FieldError, did_you_mean

LEAST_M, PER_METRE = 2e-12, 1e-13
REQUESTS = {'preview': 1e-3, 'standard': 1e-6, 'fine': 1e-9, 'exact': 0.0}      # 'exact': as accurate as floats allow


def promise_m(along_m: float, size_m: float) -> float:
    """Return the promise for coordinates along the track up to ``along_m`` and points up to ``size_m`` from the origin.

    Near a lock, it is multiplied by the conditioning of the chain.
    """
    return max(LEAST_M, PER_METRE * size_m, 2.0**-49 * along_m)


def speed_promise(promise: float, mean_link_m: float, ratio: Any, lock_m: float, lag: Any) -> Any:
    """Return the promised error of the speed of handles, relative to the leader's speed.

    Handles are at most ``ratio`` times as fast as the leader, and their speeds along the track differ from the
    leader's by at most ``lag`` times its speed. Errors of positions change speeds over the length of a link. At a
    distance d before the lock of a spiral r = b theta, where the link is almost a diameter, the lag is sqrt(2 b / d),
    so an error of d changes it by error * lag^3 / (4 b); ``lock_m`` is 4 b, or infinite on other tracks.
    """
    return promise * (ratio * ratio * ratio / mean_link_m + lag * lag * lag / lock_m)


def check_request(accuracy: str | float, promise: float) -> None:
    """Raise FieldError if the requested accuracy (m, or an old name for it) is finer than the promise."""
    wanted_m = REQUESTS[accuracy] if isinstance(accuracy, str) else accuracy
    if accuracy != 'exact' and wanted_m < promise:
        raise FieldError('accuracy', accuracy, f'floats keep {promise:.3g} m in this scene',
                         f'give {promise:.3g} or more, or exact')


def checked_name(accuracy: str) -> str:
    """Return the name of a requested accuracy. Raises FieldError if it is unknown."""
    if accuracy not in REQUESTS:
        raise FieldError('accuracy', accuracy, f'the names are {", ".join(REQUESTS)}',
                         did_you_mean(accuracy, REQUESTS, 'give metres or one of these'))
    return accuracy
