"""Clear intervals of a search domain of contact, with the bound that clears each: the driver of every bound.

A domain is sampled at places. Between two of them a bound (``on_spiral`` for a bench on a spiral segment,
``conservative_advancement`` for the whole chain) says how near benches can come. An interval whose bound does not
exceed what positions may err is cut into parts, at once into as many as the bound asks for, until each is cleared or is
as short as is asked for. The parts of one interval are at most half as long as it is, so an interval of length L takes
no more than log2(L / finest) rounds, and the whole search ends.
"""
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dragon_ros.core.numerics.types import Floats, Ints

_SHARE = 0.9        # of the room for an interval: gaps shrink on the way
_MOST_PARTS = 3     # that an interval is cut into at once: shorter ones have more room than that of a long one says
_AT_ONCE = 4096     # intervals that are bounded together; later ones wait, so that a long search keeps to its memory
_FINEST = 1e-14     # of a time or a distance: intervals this short are not cut
Bools = NDArray[np.bool_]


class Samples(Protocol):
    """States at M places of a domain."""

    @property
    def places(self) -> Floats:
        """Places (M,)."""
        ...

    def rows(self, index: Ints) -> Any:
        """Return some of them."""
        ...


@dataclass(frozen=True)
class Judgement:
    """Of M intervals: lower bounds of the gaps, whether benches touch at either end (2, M), and parts to cut into.

    ``group`` (M,) is what the parts are judged with: a space may leave out of them what is settled for the whole.
    """

    bound_m: Floats
    touching: Bools
    parts: Ints
    group: Ints


class Space(Protocol):
    """What is searched: it samples places, and bounds the gaps between two of them.

    The first intervals are the ``roots``, which are judged with their own numbers; all others are parts of them.
    Windows are told by their numbers in the list that ``clear`` was given.
    """

    @property
    def tolerance_m(self) -> float:
        """What a bound must exceed for the positions that it was computed from."""
        ...

    def sample(self, places: Floats, window: Ints) -> Any:
        """Return the samples of places (M,) of windows (M,)."""
        ...

    def joined(self, parts: list[Any]) -> Any:
        """Return several samples as one."""
        ...

    def begin(self, samples: Any, pairs: Ints, window: Ints) -> None:
        """Take the roots: ``pairs`` (2, R) of rows of the samples, and the numbers (R,) of their windows."""
        ...

    def judge(self, a: Any, b: Any, group: Ints) -> Judgement:
        """Judge the intervals between samples a and b; ``group`` is a root's number or one from a judgement."""
        ...

    def lengths_m(self, start: Floats, stop: Floats) -> Floats:
        """Return the lengths of intervals in metres, or bounds on them."""
        ...


@dataclass(frozen=True)
class Cleared:
    """What of a window is cleared, from its start on, as rows (start, stop, bound).

    ``hit`` brackets the first place that is not, as (cleared end, other end, bound), None where all is; ``touching``
    says that benches touch at its other end.
    """

    rows: list[tuple[float, float, float]]
    hit: tuple[float, float, float] | None
    touching: bool


def parts_for(room: Floats) -> Ints:
    """Return how many parts to cut intervals into that could be so many times as long, below 1, to be cleared."""
    parts = np.ceil(1 / (_SHARE * np.maximum(room, 0.5 / _MOST_PARTS)))
    return np.clip(parts, 2, _MOST_PARTS).astype(np.int64)


def clear(space: Space, windows: list[Floats], finest_m: tuple[float, ...]) -> list[Cleared]:
    """Clear windows, given as places (monotone), each up to the first place that cannot be cleared.

    Intervals are cut down to the first of ``finest_m``; where one is still neither cleared nor touching, the rest of
    its window is cleared again from there on, down to the next.
    """
    out, left = [Cleared([], None, False) for _ in windows], dict(enumerate(windows))
    for finest in finest_m:
        if not left:
            break
        for n, more in _cleared(space, left, finest).items():
            out[n] = Cleared([*out[n].rows, *more.rows], more.hit, more.touching)
        left = {n: _after(window, out[n].hit) for n, window in left.items() if out[n].hit and not out[n].touching}
    return out


def _after(window: Floats, hit: tuple[float, float, float] | None) -> Floats:
    """Return what is left of a window."""
    assert hit
    sign = 1.0 if window[-1] > window[0] else -1.0
    return np.concatenate(([hit[0]], window[sign * window > sign * hit[0]]))


def _cleared(space: Space, windows: dict[int, Floats], finest_m: float) -> dict[int, Cleared]:
    search = _Search(space, windows)
    while search.waiting:
        search.judge(finest_m)
    return {number: search.result(number) for number in windows}


@dataclass(frozen=True)
class _Batch:
    """Intervals: ``pairs`` (2, M) of rows of samples, their windows and what they are judged with (M,)."""

    samples: Any
    pairs: Ints
    window: Ints
    group: Ints

    def some(self, keep: Bools | Ints) -> '_Batch':
        """Return some intervals with the samples that they need."""
        used, rows = np.unique(self.pairs[:, keep], return_inverse=True)
        return _Batch(self.samples.rows(used), rows.reshape(2, -1), self.window[keep], self.group[keep])


class _Search:
    """Intervals of windows that are still to be cleared, and what has been found of them."""

    def __init__(self, space: Space, windows: dict[int, Floats]) -> None:
        self._space, size = space, 1 + max(windows)
        of = np.repeat([*windows], [window.size for window in windows.values()])
        self._sign = np.ones(size)
        self._sign[[*windows]] = [1.0 if window[-1] >= window[0] else -1.0 for window in windows.values()]
        self._touch: Floats = np.full(size, np.inf)      # progress to the first touching place
        self._limit: Floats = np.full(size, np.inf)      # and to the first place that cannot be cleared
        self._done: list[tuple[Floats, Ints]] = []
        self._stuck: list[tuple[Floats, Ints]] = []
        samples, first = space.sample(np.concatenate([*windows.values()]), of), np.flatnonzero(np.diff(of) == 0)
        pairs = np.stack((first, first + 1))
        space.begin(samples, pairs, of[first])
        self.waiting = [_Batch(samples, pairs, of[first], np.arange(first.size))] if first.size else []

    def judge(self, finest_m: float) -> None:
        """Judge the intervals that are next, keep those that are clear, and cut the others."""
        batch = self._next()
        if not batch.window.size:
            return
        places = batch.samples.places[batch.pairs]
        space, progress = self._space, self._sign[batch.window] * places
        first, second = (batch.samples.rows(rows) for rows in batch.pairs)
        judged = space.judge(first, second, batch.group)
        for end in (0, 1):
            touching = judged.touching[end]
            np.minimum.at(self._touch, batch.window[touching], progress[end, touching])
        good = judged.bound_m > space.tolerance_m
        short = (space.lengths_m(*places) <= finest_m) | ~_between(*places)
        fine = ~good & short
        np.minimum.at(self._limit, batch.window[fine], progress[0, fine])
        np.minimum(self._limit, self._touch, out=self._limit)
        self._done.append((np.stack((*places[:, good], judged.bound_m[good]), axis=1), batch.window[good]))
        self._stuck.append((np.stack((*places[:, fine], judged.bound_m[fine]), axis=1), batch.window[fine]))
        rest = ~good & ~short & (progress[0] < self._limit[batch.window])
        if np.any(rest):
            self._cut(replace(batch, group=judged.group).some(rest), judged.parts[rest])

    def _next(self) -> _Batch:
        """Take the intervals that come first; too many for one time are taken in the order of progress."""
        batch = self.waiting.pop()
        ahead = self._sign[batch.window] * batch.samples.places[batch.pairs[0]] < self._limit[batch.window]
        batch = batch if np.all(ahead) else batch.some(ahead)
        if batch.window.size <= _AT_ONCE:
            return batch
        order = np.argsort(self._sign[batch.window] * batch.samples.places[batch.pairs[0]], kind='stable')
        self.waiting.append(batch.some(np.sort(order[_AT_ONCE:])))
        return batch.some(np.sort(order[:_AT_ONCE]))

    def _cut(self, batch: _Batch, parts: Ints) -> None:
        """Cut intervals, each into so many equal parts."""
        count, (start, stop) = batch.window.size, batch.samples.places[batch.pairs]
        of, nth = np.repeat(np.arange(count), parts - 1), _counted(parts - 1) + 1
        share = nth / parts[of]
        places = np.where(parts[of] == 2, 0.5 * (start + stop)[of], start[of] + share * (stop - start)[of])
        new = batch.samples.places.size + np.arange(of.size)
        samples = self._space.joined([batch.samples, self._space.sample(places, batch.window[of])])
        # Each interval's rows in order: its start, the new ones, its stop.
        fronts, owner = np.empty(of.size + count, dtype=np.int64), np.repeat(np.arange(count), parts)
        heads = np.cumsum(parts) - parts
        inner = np.ones(fronts.size, dtype=bool)
        inner[heads] = False
        fronts[heads], fronts[inner] = batch.pairs[0], new
        backs = np.empty_like(fronts)
        backs[:-1], backs[-1] = fronts[1:], batch.pairs[1, -1]
        backs[np.cumsum(parts) - 1] = batch.pairs[1]
        self.waiting.append(_Batch(samples, np.stack((fronts, backs)), batch.window[owner], batch.group[owner]))

    def result(self, number: int) -> Cleared:
        """Return what of a window is cleared up to the first interval that is not."""
        sign, touch = self._sign[number], self._touch[number]
        stuck = [row for row in self._rows(self._stuck, number) if sign * row[0] < touch]
        end = sign * stuck[0][0] if stuck else touch
        kept = [(start, stop, bound) for start, stop, bound in self._rows(self._done, number) if sign * start < end]
        if end == np.inf:
            return Cleared(kept, None, False)
        start, stop, bound = stuck[0] if stuck else (float(sign * touch), float(sign * touch), -np.inf)
        hit = start, stop, bound
        return Cleared(kept, hit, bool(sign * hit[1] >= touch))

    def _rows(self, parts: list[tuple[Floats, Ints]], number: int) -> list[list[float]]:
        """Return a window's rows in order."""
        rows = [row for values, window in parts for row in values[window == number].tolist()]
        return sorted(rows, key=lambda row: float(self._sign[number] * row[0]))


def _between(start: Floats, stop: Floats) -> Bools:
    """Return whether floats lie between two."""
    middle = 0.5 * (start + stop)
    out: Bools = (middle != start) & (middle != stop)
    return out


def divisible(starts: Floats, stops: Floats) -> Bools:
    """Return which intervals of time or distance between starts and stops (M,) are long enough to be cut."""
    out: Bools = np.abs(stops - starts) > _FINEST * (1 + np.maximum(np.abs(starts), np.abs(stops)))
    return out


def _counted(sizes: Ints) -> Ints:
    """Return 0, 1, ... up to each size in turn."""
    out: Ints = np.arange(int(np.sum(sizes))) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return out
