"""Messages of many chunks in the order of their times, in bounded memory however the chunks overlap."""
from array import array
from bisect import bisect_left
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Sequence
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from dragon_ros.bags.read.chunk import Row, row_of
from dragon_ros.bags.read.index import Piece

_KEEP = 64 * 2**20      # bytes of open chunks; one that is needed again is opened again


class Chosen(NamedTuple):
    """A message and the records that it stands in."""

    piece: Piece
    row: Row
    data: bytes


class _Open(NamedTuple):
    """Records of a piece, and the times and places of its chosen messages, by time."""

    data: bytes
    times: 'array[int]'
    starts: 'array[int]'
    ends: 'array[int]'

    @property
    def size(self) -> int:
        return len(self.data) + 24 * len(self.times)


class InOrder:
    """Yields the messages that ``choose`` wants, by time and then by their place in the bag."""

    def __init__(self, pieces: Sequence[Piece], choose: Callable[[Piece, Row], bool]) -> None:
        """Take the pieces in the order of the bag."""
        self._pieces, self._choose = pieces, choose
        self._open: OrderedDict[int, _Open] = OrderedDict()

    def between(self, start_ns: int, end_ns: int) -> Iterator[Chosen]:
        """Yield messages with start_ns <= t < end_ns. Raises BagError where a chunk is damaged."""
        waiting = deque(sorted((piece.start_ns, number) for number, piece in enumerate(self._pieces)
                               if piece.end_ns >= start_ns and piece.start_ns < end_ns))
        heap: list[tuple[int, int, int]] = []
        while waiting or heap:
            while waiting and (not heap or waiting[0][0] <= heap[0][0]):
                number = waiting.popleft()[1]
                self._push(heap, number, bisect_left(self._opened(number).times, start_ns), end_ns)
            if heap:
                _, number, position = heappop(heap)
                opened = self._opened(number)
                yield Chosen(self._pieces[number],
                             row_of(opened.data, opened.starts[position], opened.ends[position]), opened.data)
                self._push(heap, number, position + 1, end_ns)

    def _push(self, heap: list[tuple[int, int, int]], number: int, position: int, end_ns: int) -> None:
        times = self._opened(number).times
        if position < len(times) and times[position] < end_ns:
            heappush(heap, (times[position], number, position))

    def _opened(self, number: int) -> _Open:
        """Return an open piece; where they get too much, those that were not used for longest are closed."""
        if number in self._open:
            self._open.move_to_end(number)
            return self._open[number]
        opened = self._open[number] = self._read(self._pieces[number])
        while len(self._open) > 1 and sum(one.size for one in self._open.values()) > _KEEP:
            self._open.popitem(last=False)
        return opened

    def _read(self, piece: Piece) -> _Open:
        data, times, starts, ends = piece.records(), array('Q'), array('Q'), array('Q')
        for row in piece.inside(data):
            if isinstance(row, Row) and self._choose(piece, row):
                times.append(row.t_ns)
                starts.append(row.start)
                ends.append(row.end)
        if times and not piece.start_ns <= min(times) <= max(times) <= piece.end_ns:
            raise piece.file.fault(piece.place.offset, f'a chunk claims messages from {piece.start_ns} to '
                                   f'{piece.end_ns} ns and has some from {min(times)} to {max(times)} ns')
        order = np.argsort(np.frombuffer(times, np.uint64), kind='stable')
        return _Open(data, *(array('Q', np.frombuffer(column, np.uint64)[order].tobytes())
                             for column in (times, starts, ends)))
