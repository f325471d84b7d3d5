"""Messages of one tick come on two topics: pair them by stamp, in bounded memory and bounded time."""
from collections import OrderedDict
from typing import Any, NamedTuple

from dragon_ros.wire.cdr_read import Poses
from dragon_ros.wire.sights import Shown

_LEAST = 128                # stamps that may wait for their partner, however large the messages
_MOST_VALUES = 8 * 2**20    # beyond those, as many as fit: one topic may run ahead while the other is sent again


class _Waiting(NamedTuple):
    message: Any
    since_s: float


class Unmatched(NamedTuple):
    """A message that was given up: its topic and its stamp."""

    topic: str
    t_ns: int


class Pairing:
    """Keeps what has no partner yet; what a later pair overtook, is too old or too much, is given up."""

    def __init__(self) -> None:
        """Start with nothing."""
        self._handles: OrderedDict[int, _Waiting] = OrderedDict()
        self._benches: OrderedDict[int, _Waiting] = OrderedDict()
        self._unmatched: list[Unmatched] = []

    def add_handles(self, poses: Poses, now_s: float) -> tuple[Poses, Shown] | None:
        """Add handles that came at ``now_s``; return (handles, benches) if both are there."""
        return self._match(poses.t_ns, self._put(self._handles, poses.t_ns, poses, poses.poses.size, now_s))

    def add_benches(self, shown: Shown, now_s: float) -> tuple[Poses, Shown] | None:
        """Add benches that came at ``now_s``; return (handles, benches) if both are there."""
        return self._match(shown.t_ns, self._put(self._benches, shown.t_ns, shown, shown.size, now_s))

    def expire(self, before_s: float) -> None:
        """Give up what has waited since before ``before_s``."""
        for waiting in (self._handles, self._benches):
            while waiting and next(iter(waiting.values())).since_s < before_s:
                self._give_up(waiting, next(iter(waiting)))

    def take_unmatched(self) -> list[Unmatched]:
        """Return what was given up since the last call."""
        out, self._unmatched = self._unmatched, []
        return out

    def _put(self, own: OrderedDict[int, _Waiting], t_ns: int, message: Any, values: int, now_s: float) -> bool:
        own.pop(t_ns, None)
        own[t_ns] = _Waiting(message, now_s)
        paired = t_ns in self._handles and t_ns in self._benches
        if not paired and len(own) > _LEAST and len(own) * values > _MOST_VALUES:
            self._give_up(own, next(iter(own)))
        return paired

    def _match(self, t_ns: int, paired: bool) -> tuple[Poses, Shown] | None:
        if not paired:
            return None
        pair = self._handles[t_ns].message, self._benches[t_ns].message
        for waiting in (self._handles, self._benches):
            while (oldest := next(iter(waiting))) != t_ns:
                self._give_up(waiting, oldest)
            del waiting[t_ns]
        return pair

    def _give_up(self, waiting: OrderedDict[int, _Waiting], t_ns: int) -> None:
        del waiting[t_ns]
        self._unmatched.append(Unmatched('handles' if waiting is self._handles else 'benches', t_ns))
