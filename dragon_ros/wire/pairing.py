"""Messages of one tick come on two topics: pair them by stamp, in bounded memory."""
from collections import OrderedDict

_LEAST = 128                # stamps that may wait for their partner, however large the messages
_MOST_BYTES = 64 * 2**20    # beyond those, as many as fit: one topic may run ahead while the other is sent again


class Pairing:
    """Keeps what has no partner yet; what a later pair overtook, or what is too old, is given up."""

    def __init__(self) -> None:
        """Start with nothing."""
        self._handles: OrderedDict[int, bytes] = OrderedDict()
        self._benches: OrderedDict[int, bytes] = OrderedDict()
        self._unmatched: list[int] = []

    def add_handles(self, t_ns: int, data: bytes) -> tuple[bytes, bytes] | None:
        """Add handles; return (handles, benches) if both are there."""
        return self._match(t_ns, data, self._handles, self._benches)

    def add_benches(self, t_ns: int, data: bytes) -> tuple[bytes, bytes] | None:
        """Add benches; return (handles, benches) if both are there."""
        return self._match(t_ns, data, self._benches, self._handles)

    def take_unmatched(self) -> list[int]:
        """Return the stamps of handles given up since the last call."""
        out, self._unmatched = self._unmatched, []
        return out

    def _match(self, t_ns: int, data: bytes, own: OrderedDict[int, bytes],
               other: OrderedDict[int, bytes]) -> tuple[bytes, bytes] | None:
        own.pop(t_ns, None)
        own[t_ns] = data
        if t_ns not in other:
            if len(own) > _LEAST and len(own) * len(data) > _MOST_BYTES:
                self._give_up(own, next(iter(own)))
            return None
        pair = self._handles[t_ns], self._benches[t_ns]
        for waiting in (self._handles, self._benches):
            while (oldest := next(iter(waiting))) != t_ns:
                self._give_up(waiting, oldest)
            del waiting[t_ns]
        return pair

    def _give_up(self, waiting: OrderedDict[int, bytes], t_ns: int) -> None:
        del waiting[t_ns]
        if waiting is self._handles:
            self._unmatched.append(t_ns)
