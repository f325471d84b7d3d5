"""The loop shared by all searches, which judges cells of a space in batches and subdivides them until all are settled.

``run`` takes the search as a parameter. A ``Search`` selects the cells that may still matter, orders and judges them,
keeps the settled ones and returns the parts of the others. The loop stores the waiting cells and limits the number of
cells that are judged together. If too many cells are waiting, the loop settles the first cells and all their parts
before it continues with the others. Four searches use ``run``. ``clear`` advances through positions up to the first
position that is not clear; ``bounding_box``, ``max_speed`` and ``venue_fit`` search for extreme values. Every search
terminates: a cell is cut into parts at most half as long, until it is as short as requested or as floats allow.

``clear`` clears intervals of the domain of a contact search. The domain is sampled at discrete positions. A bound
(``conservative_advancement`` for pairs of benches, ``obstacle_contact`` for obstacles) limits how close they can come
between two adjacent positions. An interval whose bound does not exceed the position error is cut into as many parts as
the bound suggests, and each part is cut again until it is cleared or as short as requested. An interval of length L
therefore takes at most log2(L / finest) rounds. Adjacent intervals share the samples at their ends, because computing
states is expensive.
"""
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from dragon_ros.core.numerics.types import Floats, Ints

_SHARE = 0.9        # length of a part, relative to its room; below 1 because gaps shrink within an interval
_MOST_PARTS = 3     # maximum number of parts per cut; shorter intervals have more room than a long one suggests
_AT_ONCE = 4096     # maximum number of intervals that are bounded together; the others wait, which limits memory
_FINEST = 1e-14     # intervals shorter than this, relative to their times or distances, are not cut
Bools = NDArray[np.bool_]


class Cells(Protocol):
    """Cells of a space that a search examines."""

    @property
    def size(self) -> int:
        """The number of cells."""
        ...

    def some(self, which: Any) -> Any:
        """Return a subset of the cells."""
        ...


C = TypeVar('C', bound=Cells)


class Search(Protocol[C]):
    """A search that judges at most ``at_once`` cells together."""

    @property
    def at_once(self) -> int:
        """The largest number of cells that are judged together."""
        ...

    def ahead(self, cells: C) -> Bools:
        """Return whether each cell may still matter."""
        ...

    def order(self, cells: C) -> Floats:
        """Return sort keys of the cells; the cells with the smallest keys are judged first."""
        ...

    def judge(self, cells: C) -> C:
        """Judge cells and keep those that are settled; return the parts of the others."""
        ...


class InOrder:
    """A search for an extreme value over cells along a track or in time, which judges all cells in order."""

    def ahead(self, cells: Cells) -> Bools:
        """Return True for all cells, because their bounds are unknown until they are judged."""
        return np.ones(cells.size, dtype=bool)

    def order(self, cells: Any) -> Floats:
        """Return the start of each cell."""
        out: Floats = cells.low[0]
        return out


def run(search: Search[C], cells: C) -> None:
    """Judge cells and their parts until none are left."""
    waiting = [cells]
    while waiting:
        cells = waiting.pop()
        ahead = search.ahead(cells)
        cells = cells if np.all(ahead) else cells.some(ahead)
        if cells.size > search.at_once:
            order = np.argsort(search.order(cells), kind='stable')
            waiting.append(cells.some(np.sort(order[search.at_once:])))
            cells = cells.some(np.sort(order[:search.at_once]))
        if cells.size and (parts := search.judge(cells)).size:
            waiting.append(parts)


@dataclass(frozen=True)
class Boxes:
    """Cells without samples: M boxes in a space of D dimensions, from ``low`` to ``high`` (D, M)."""

    low: Floats
    high: Floats

    @property
    def size(self) -> int:
        """The number of boxes."""
        return int(self.low.shape[1])

    def some(self, which: Bools | Ints) -> 'Boxes':
        """Return a subset of the boxes."""
        return Boxes(self.low[:, which], self.high[:, which])

    def cut(self, parts: int, axis: Ints | int = 0) -> 'Boxes':
        """Cut each box into equal parts along one axis, which may differ from box to box."""
        axis, each = np.broadcast_to(axis, self.size), np.arange(self.size)
        ends = np.linspace(self.low[axis, each], self.high[axis, each], parts + 1, axis=1)
        low, high = (np.repeat(one, parts, axis=1) for one in (self.low, self.high))
        axis, each = np.repeat(axis, parts), np.arange(parts * self.size)
        low[axis, each], high[axis, each] = ends[:, :-1].ravel(), ends[:, 1:].ravel()
        return Boxes(low, high)


@dataclass(frozen=True)
class Judgement:
    """The judgement of M intervals: lower bounds on gaps, contacts at both ends (2, M), and numbers of parts.

    ``group`` (M,) holds the groups for which the parts are judged; a space may omit pairs that are settled for the
    whole interval.
    """

    bound_m: Floats
    touching: Bools
    parts: Ints
    group: Ints


class Space(Protocol):
    """A search space, which samples positions and bounds gaps over the intervals between them.

    The first intervals are the roots: each root is its own group, and every other interval is part of a root.
    """

    @property
    def tolerance_m(self) -> float:
        """The position error, which a bound must exceed."""
        ...

    def sample(self, places: Floats) -> Any:
        """Return the samples at positions (M,)."""
        ...

    def joined(self, parts: list[Any]) -> Any:
        """Concatenate samples."""
        ...

    def begin(self, samples: Any, pairs: Ints) -> None:
        """Receive the roots as ``pairs`` (2, R) of sample indices."""
        ...

    def judge(self, a: Any, b: Any, group: Ints) -> Judgement:
        """Judge the intervals from samples a to b; each group is the index of a root or from an earlier judgement."""
        ...


class Bracket(NamedTuple):
    """The position where the clear part ends, another position, and a lower bound on the gaps in between."""

    clear_m: float
    other_m: float
    bound_m: float = -np.inf


@dataclass(frozen=True)
class Cleared:
    """The cleared part of a window, from its start, as rows (start, stop, bound).

    ``hit`` brackets the first position that is not clear; it is None if the whole window is clear. ``touching`` is True
    if benches touch at its other end.
    """

    rows: list[tuple[float, float, float]]
    hit: Bracket | None
    touching: bool


def parts_for(room: Floats) -> Ints:
    """Return the number of parts of each interval, given the fraction ``room`` of its length that would be cleared."""
    parts = np.ceil(1 / (_SHARE * np.maximum(room, 0.5 / _MOST_PARTS)))
    return np.clip(parts, 2, _MOST_PARTS).astype(np.int64)


def clear(space: Space, windows: list[Floats], finest_m: tuple[float, ...]) -> list[Cleared]:
    """Clear windows, given as monotone positions, each up to the first position that cannot be cleared.

    Intervals are cut down to the first length in ``finest_m``. If an interval of this length is neither cleared nor
    touching, the rest of its window is searched again from there, with intervals down to the next length.
    """
    out, left = [Cleared([], None, False) for _ in windows], dict(enumerate(windows))
    for finest in finest_m:
        if not left:
            break
        search = _Clearing(space, left, finest)
        run(search, search.roots)
        for n in left:
            more = search.result(n)
            out[n] = Cleared([*out[n].rows, *more.rows], more.hit, more.touching)
        left = {n: _after(window, out[n].hit) for n, window in left.items() if out[n].hit and not out[n].touching}
    return out


def _after(window: Floats, hit: Bracket | None) -> Floats:
    """Return the rest of a window after a hit."""
    assert hit
    sign = 1.0 if window[-1] > window[0] else -1.0
    return np.concatenate(([hit.clear_m], window[sign * window > sign * hit.clear_m]))


@dataclass(frozen=True)
class _Intervals:
    """Intervals as ``pairs`` (2, M) of sample indices, with their windows (M,) and groups (M,)."""

    samples: Any
    pairs: Ints
    window: Ints
    group: Ints

    @property
    def size(self) -> int:
        """The number of intervals."""
        return int(self.window.size)

    def some(self, keep: Bools | Ints) -> '_Intervals':
        """Return a subset of the intervals with its samples."""
        used, rows = np.unique(self.pairs[:, keep], return_inverse=True)
        return _Intervals(self.samples.rows(used), rows.reshape(2, -1), self.window[keep], self.group[keep])


class _Clearing:
    """A search that clears windows in the order of their positions, together with its results."""

    at_once = _AT_ONCE

    def __init__(self, space: Space, windows: dict[int, Floats], finest_m: float) -> None:
        self._space, self._finest_m, size = space, finest_m, 1 + max(windows)
        of = np.repeat([*windows], [window.size for window in windows.values()])
        self._sign = np.ones(size)
        self._sign[[*windows]] = [1.0 if window[-1] >= window[0] else -1.0 for window in windows.values()]
        self._touch: Floats = np.full(size, np.inf)      # progress at the first touching position
        self._limit: Floats = np.full(size, np.inf)      # progress at the first position that cannot be cleared
        self._done: list[tuple[Floats, Ints]] = []
        self._stuck: list[tuple[Floats, Ints]] = []
        samples, first = space.sample(np.concatenate([*windows.values()])), np.flatnonzero(np.diff(of) == 0)
        pairs = np.stack((first, first + 1))
        space.begin(samples, pairs)
        self.roots = _Intervals(samples, pairs, of[first], np.arange(first.size))

    def ahead(self, batch: _Intervals) -> Bools:
        """Return whether each interval begins before the first position that cannot be cleared."""
        out: Bools = self.order(batch) < self._limit[batch.window]
        return out

    def order(self, batch: _Intervals) -> Floats:
        """Return the progress at which each interval begins."""
        out: Floats = self._sign[batch.window] * batch.samples.places[batch.pairs[0]]
        return out

    def judge(self, batch: _Intervals) -> _Intervals:
        """Judge intervals, keep the clear ones, and cut the others."""
        places = batch.samples.places[batch.pairs]
        space, progress = self._space, self._sign[batch.window] * places
        first, second = (batch.samples.rows(rows) for rows in batch.pairs)
        judged = space.judge(first, second, batch.group)
        for end in (0, 1):
            touching = judged.touching[end]
            np.minimum.at(self._touch, batch.window[touching], progress[end, touching])
        good = judged.bound_m > space.tolerance_m
        short = (np.abs(places[1] - places[0]) <= self._finest_m) | ~_between(*places)
        fine = ~good & short
        np.minimum.at(self._limit, batch.window[fine], progress[0, fine])
        np.minimum(self._limit, self._touch, out=self._limit)
        self._done.append((np.stack((*places[:, good], judged.bound_m[good]), axis=1), batch.window[good]))
        self._stuck.append((np.stack((*places[:, fine], judged.bound_m[fine]), axis=1), batch.window[fine]))
        rest = ~good & ~short & (progress[0] < self._limit[batch.window])
        left = replace(batch, group=judged.group).some(rest)
        return self._cut(left, judged.parts[rest]) if np.any(rest) else left

    def _cut(self, batch: _Intervals, parts: Ints) -> _Intervals:
        """Cut each interval into its own number of equal parts."""
        count, (start, stop) = batch.window.size, batch.samples.places[batch.pairs]
        of, nth = np.repeat(np.arange(count), parts - 1), counted(parts - 1) + 1
        share = nth / parts[of]
        places = np.where(parts[of] == 2, 0.5 * (start + stop)[of], start[of] + share * (stop - start)[of])
        new = batch.samples.places.size + np.arange(of.size)
        samples = self._space.joined([batch.samples, self._space.sample(places)])
        # Order the rows of each interval: start, new rows, stop.
        fronts, owner = np.empty(of.size + count, dtype=np.int64), np.repeat(np.arange(count), parts)
        heads = np.cumsum(parts) - parts
        inner = np.ones(fronts.size, dtype=bool)
        inner[heads] = False
        fronts[heads], fronts[inner] = batch.pairs[0], new
        backs = np.roll(fronts, -1)
        backs[np.cumsum(parts) - 1] = batch.pairs[1]
        return _Intervals(samples, np.stack((fronts, backs)), batch.window[owner], batch.group[owner])

    def result(self, number: int) -> Cleared:
        """Return the cleared part of a window, up to the first interval that is not clear."""
        sign, touch = self._sign[number], self._touch[number]
        stuck = [row for row in self._rows(self._stuck, number) if sign * row[0] < touch]
        end = sign * stuck[0][0] if stuck else touch
        kept = [(start, stop, bound) for start, stop, bound in self._rows(self._done, number) if sign * start < end]
        if end == np.inf:
            return Cleared(kept, None, False)
        start, stop, bound = stuck[0] if stuck else (float(sign * touch), float(sign * touch), -np.inf)
        return Cleared(kept, Bracket(start, stop, bound), bool(sign * stop >= touch))

    def _rows(self, parts: list[tuple[Floats, Ints]], number: int) -> list[list[float]]:
        """Return a window's rows in order."""
        rows = [row for values, window in parts for row in values[window == number].tolist()]
        return sorted(rows, key=lambda row: float(self._sign[number] * row[0]))


def _between(start: Floats, stop: Floats) -> Bools:
    """Return whether there is a float between start and stop."""
    middle = 0.5 * (start + stop)
    out: Bools = (middle != start) & (middle != stop)
    return out


def divisible(starts: Floats, stops: Floats) -> Bools:
    """Return whether intervals of time or distance from starts to stops (M,) are long enough to be cut."""
    out: Bools = np.abs(stops - starts) > _FINEST * (1 + np.maximum(np.abs(starts), np.abs(stops)))
    return out


def counted(sizes: Ints) -> Ints:
    """Return the numbers from 0 to size - 1 for each size, concatenated."""
    out: Ints = np.arange(int(np.sum(sizes))) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return out
