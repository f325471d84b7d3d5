"""A cache of values that take long to build and much memory, shared by threads."""
from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

_Key = TypeVar('_Key', bound=Hashable)
_Value = TypeVar('_Value')


class BuildCache(Generic[_Key, _Value]):
    """Values by key, built on first use; the least recently used values are dropped while there are too many.

    Threads that need a value wait while another thread builds one, so that nothing is built twice.
    """

    def __init__(self, are_too_many: Callable[[list[_Value]], bool]) -> None:
        """Store the function that decides whether there are too many values."""
        self._are_too_many = are_too_many
        self._values: OrderedDict[_Key, _Value] = OrderedDict()
        self._building = Lock()

    def get(self, key: _Key, build: Callable[[_Key], _Value]) -> _Value:
        """Return a value, built on first use; the latest value is never dropped.

        The cache does not store ``build``, which is usually a method of its owner: both would wait for the garbage
        collector.
        """
        try:
            self._values.move_to_end(key)
            return self._values[key]
        except KeyError:        # not yet built, or dropped
            pass
        with self._building:
            if key in self._values:
                return self._values[key]
            value = self._values[key] = build(key)
            while len(self._values) > 1 and self._are_too_many(self.values):
                self._values.popitem(last=False)
            return value

    @property
    def values(self) -> list[_Value]:
        """The values, the least recently used first."""
        return list(self._values.values())
