"""Read the ticks of a long bag in parts, optionally in several processes."""
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from typing import Generic, TypeVar

from dragon_ros.bags.read.frames import BagFrame, frames, frames_of_part
from dragon_ros.bags.read.reader import END_OF_TIME_NS, BagReader
from dragon_ros.messages.decode import read_stamp_ns

_TICKS = 64         # number of ticks per part if a single process reads the bag
R = TypeVar('R')
_Span = tuple[int, int]
Mapped = Callable[[Callable[[_Span], R], Sequence[_Span]], Generator[R, None, None]]


@dataclass(frozen=True)
class _PartReader(Generic[R]):
    """Applies ``body`` to the ticks in a span of log times; a pickled copy reopens the bag."""

    bag: BagReader
    root: str
    body: Callable[[Iterator[BagFrame]], R]
    end_ns: int

    def __call__(self, span: _Span) -> tuple[R, bool]:
        """Return the result, and whether reading the whole bag would give the same result for these ticks."""
        whole = False

        def ticks() -> Iterator[BagFrame]:
            nonlocal whole
            whole = yield from frames_of_part(self.bag, self.root, *span, span[1] == self.end_ns)
        result = self.body(ticks())
        return result, whole


def in_parts(bag: BagReader, root: str, body: Callable[[Iterator[BagFrame]], R], mapped: 'Mapped[tuple[R, bool]]',
             start_ns: int = 0, end_ns: int = END_OF_TIME_NS) -> Generator[R, None, None]:
    """Apply ``body`` to each part of a bag, or of a range of its log times, and yield the results in order.

    ``body`` receives the ticks of a part and must consume all of them. ``mapped(work, jobs)`` processes the parts, in
    this process or in others. If a tick straddles two parts, as may happen with wall-clock log times, this process
    reads the rest of the bag alone.
    """
    spans = bag.spans(start_ns, end_ns)
    made = mapped(_PartReader(bag, root, body, end_ns), spans)
    begin_ns = end_ns
    with closing(made):
        for span, (result, whole) in zip(spans, made, strict=True):
            if not whole:
                begin_ns = span[0]
                break
            yield result
    left = frames(bag, root, begin_ns, end_ns)
    while some := list(islice(left, _TICKS)):
        yield body(iter(some))


def stamps_of(bag: BagReader, topic: str, mapped: Mapped[list[tuple[int, int]]]) -> Iterator[tuple[int, int]]:
    """Yield the stamp and the log time, in ns, of each message of a topic; for ``mapped``, see ``in_parts``."""
    return chain.from_iterable(mapped(partial(_stamps, bag, topic), bag.spans(0, END_OF_TIME_NS)))


def _stamps(bag: BagReader, topic: str, span: _Span) -> list[tuple[int, int]]:
    return [(read_stamp_ns(one.data), one.t_ns) for one in bag.messages([topic], *span)]
