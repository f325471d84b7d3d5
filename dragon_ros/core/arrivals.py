"""Sights come late, twice or from a run that started again: the order in which a watcher looks at them."""
from collections import deque
from typing import Generic, Protocol, TypeVar

from dragon_ros.core.numerics.types import Floats

_LAST = 8           # a sight that is not older than the last so many may just be late
_LATE_NS = 10**9    # by no more than this
_IN_A_ROW = 3       # so many late ones in a row are a run that started again


class _Timed(Protocol):
    @property
    def t_ns(self) -> int: ...

    @property
    def p(self) -> Floats: ...


T = TypeVar('T', bound=_Timed)


class Arrivals(Generic[T]):
    """Lets sights through by growing time; a late or repeated one is left out, time that goes back starts afresh."""

    def __init__(self) -> None:
        """Start having seen nothing."""
        self._times: deque[int] = deque(maxlen=_LAST)
        self._shape: tuple[int, ...] = ()
        self._late: list[T] = []

    def take(self, sight: T) -> tuple[bool, list[T]]:
        """Return whether time starts afresh, and the sights to look at now, in order.

        It starts afresh with another number of handles, with a time before the last few or more than a second back,
        and with a few late sights in a row; those are then handed out, so that nothing of a run that started again
        is lost.
        """
        if not self._times or sight.p.shape != self._shape:
            return self._pass(bool(self._times), [sight])
        if sight.t_ns > self._times[-1]:
            return self._pass(False, [sight])
        if sight.t_ns < max(self._times[0], self._times[-1] - _LATE_NS):
            return self._pass(True, [sight])
        return self._hold(sight)

    def _hold(self, sight: T) -> tuple[bool, list[T]]:
        repeated = sight.t_ns == self._times[-1] or (self._late and sight.t_ns == self._late[-1].t_ns)
        if not repeated:
            grows = self._late and sight.t_ns > self._late[-1].t_ns
            self._late = [*self._late, sight] if grows else [sight]
        return self._pass(True, self._late) if len(self._late) >= _IN_A_ROW else (False, [])

    def _pass(self, afresh: bool, sights: list[T]) -> tuple[bool, list[T]]:
        if afresh:
            self._times.clear()
        self._times.extend(sight.t_ns for sight in sights)
        self._shape, self._late = sights[-1].p.shape, []
        return afresh, sights
