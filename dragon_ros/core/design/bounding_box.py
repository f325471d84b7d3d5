"""How much room a run takes: the largest x, -x, y and -y that any corner of any bench reaches, between bounds.

Where a bench is depends on its length and on where its front handle is, not on which it is or when. So what has to be
searched is a few ways along the track: that of the head's bench, and that of all others of one length together. They
are cut up where their bound (``sweep``) exceeds the best value that was met. docs/model.md says what is proved.
"""
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.chain.rectangles import axes_of, benches_of
from dragon_ros.core.contact.signed_distance import CORNERS
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state
from dragon_ros.core.sweep import SIDES, Sweep
from dragon_ros.core.tiers import EXACT
from dragon_ros.core.visits import Visits

_AT_ONCE = 128      # stretches
_FINEST = 1e-14     # of a distance along the track: closer looks are the same
_MOST = 200_000     # looks


@dataclass(frozen=True)
class Reach:
    """The farthest corner on one side: ``low_m`` at ``t_s``, and nowhere in the run above ``high_m``."""

    side: str
    low_m: float
    high_m: float
    bench: int
    corner: str
    t_s: float
    point_m: tuple[float, float]


@dataclass(frozen=True)
class Extent:
    """The reaches on the four sides, in the order of SIDES; ``looks`` counts the benches looked at."""

    reaches: tuple[Reach, ...]
    looks: int

    @property
    def centred_m(self) -> tuple[float, float]:
        """Bounds on the side of the smallest square about the origin, along the axes, that holds the run."""
        return 2 * max(reach.low_m for reach in self.reaches), 2 * max(reach.high_m for reach in self.reaches)

    @property
    def free_m(self) -> tuple[float, float]:
        """Bounds on the side of the smallest square along the axes that holds the run, wherever its centre is."""
        low, high = ([getattr(reach, name) for reach in self.reaches] for name in ('low_m', 'high_m'))
        return max(low[0] + low[1], low[2] + low[3]), max(high[0] + high[1], high[2] + high[3])

    @property
    def touching(self) -> Reach:
        """The reach that makes the centred square as large as it is."""
        return max(self.reaches, key=lambda reach: reach.low_m)


def fits(bounds_m: tuple[float, float], side_m: float) -> bool | None:
    """Return whether a square with a side between bounds is no larger than another; None where it cannot be told."""
    return True if bounds_m[1] <= side_m else False if bounds_m[0] > side_m else None


def extent(scene: Scene, within_m: float = 1e-10, progress: Callable[[int], object] = lambda looks: None) -> Extent:
    """Return the room that the scene's run takes; bounds differ by ``within_m`` and what positions may err.

    They differ by more where floats are too coarse for that, or where ``_MOST`` looks were not enough.
    ``progress(looks)`` is called with every number of benches just looked at.
    """
    visits = Visits(scene)
    search = _Search(progress, within_m)
    kinds = _alike(scene.dragon.bench_lengths_m)
    for kind, benches in enumerate(kinds):
        search.sweep(_bench(visits, int(benches[0])), _stretches(visits, benches), kind)
    return Extent(tuple(_reach(visits, kinds, search, side) for side in range(len(SIDES))), search.looks)


def _alike(lengths_m: Floats) -> list[Ints]:
    """Return the numbers of the benches of one length, for each length: the head's alone, then those behind it."""
    behind = dict.fromkeys(lengths_m[1:].tolist())
    return [np.array([0]), *(1 + np.flatnonzero(lengths_m[1:] == length) for length in behind)]


def _bench(visits: Visits, number: int) -> Sweep:
    dragon = visits.scene.dragon
    return Sweep(visits.walk, float(dragon.link_lengths_m[number]), 0.5 * float(dragon.bench_lengths_m[number]),
                 0.5 * dragon.width_m)


def _stretches(visits: Visits, benches: Ints) -> Floats:
    """Return where the front handles of some benches go, (2, M) distances: joined where they overlap, cut at turns.

    Of the laps of a circle that the track begins with, the last holds all.
    """
    low, high = visits.ranges_m[:, benches]
    order = np.argsort(low)
    low, high = low[order], np.maximum.accumulate(high[order])
    begins = np.flatnonzero(np.concatenate(([True], low[1:] > high[:-1])))
    ends = np.concatenate((begins[1:] - 1, [low.size - 1]))
    low, high = low[begins], high[ends]
    out: Floats = np.stack((np.maximum(low, np.minimum(high, visits.walk.end_of_first_m) - visits.lap_m), high))
    for turn in visits.turns_m(int(benches[0])):
        inside = (out[0] < turn) & (turn < out[1])
        cut = np.array([[turn] * int(np.sum(inside)), out[1, inside]])
        out[1, inside] = turn
        out = np.concatenate((out, cut), axis=1)
    return out


class _Search:
    """The best value on each side so far, where it was met, and the largest bound of what was put aside."""

    def __init__(self, progress: Callable[[int], object], within_m: float) -> None:
        self.looks, self._tell, self._within_m = 0, progress, within_m
        self.best: Floats = np.full(len(SIDES), -np.inf)
        self.high: Floats = np.full(len(SIDES), -np.inf)
        self.where = [(0, 0.0, 0)] * len(SIDES)

    def sweep(self, bench: Sweep, stretches: Floats, kind: int) -> None:
        """Search stretches (2, M) of the way of one kind of bench."""
        tops: Floats = np.array([[bench.cap_m(*ends)] * len(SIDES) for ends in stretches.T.tolist()])
        while tops.size and self.looks < _MOST:
            order = np.argsort(-np.max(tops - self.best, axis=1), kind='stable')
            now, later = order[:_AT_ONCE], order[_AT_ONCE:]
            halves, above = self._halves(bench, stretches[:, now], kind)
            stretches, tops = np.concatenate((stretches[:, later], halves), 1), np.concatenate((tops[later], above))
            stretches, tops = self._put_aside(stretches, tops, np.all(tops <= self.best + self._within_m, axis=1))
        self._put_aside(stretches, tops, np.ones(len(tops), dtype=bool))

    def _put_aside(self, stretches: Floats, tops: Floats, done: Array) -> tuple[Floats, Floats]:
        """Return the stretches that are not done, and their bounds."""
        self.high = np.maximum(self.high, np.max(tops[done], axis=0, initial=-np.inf))
        return stretches[:, ~done], tops[~done]

    def _halves(self, bench: Sweep, stretches: Floats, kind: int) -> tuple[Floats, Floats]:
        """Return the halves of stretches, but for those too short to be cut again, and bounds (M, 4) on them."""
        middle = 0.5 * (stretches[0] + stretches[1])
        halves: Floats = np.concatenate((np.stack((stretches[0], middle)), np.stack((middle, stretches[1]))), axis=1)
        places, index = np.unique(halves, return_inverse=True)
        seen, ends = bench.look(places), index.reshape(2, -1)
        self.looks += places.size
        self._tell(places.size)
        self._note(seen.value, places, kind)
        tops: Floats = np.max(bench.tops(seen.rows(ends[0]), seen.rows(ends[1])), axis=1)
        return self._put_aside(halves, tops, halves[1] - halves[0] <= _FINEST * (1 + np.max(np.abs(halves), axis=0)))

    def _note(self, value: Floats, places: Floats, kind: int) -> None:
        for side, values in enumerate(np.moveaxis(value, -1, 0)):
            place, corner = np.unravel_index(int(np.argmax(values)), values.shape)
            if values[place, corner] > self.best[side]:
                self.best[side] = values[place, corner]
                self.where[side] = kind, float(places[place]), int(corner)


def _reach(visits: Visits, kinds: list[Ints], search: _Search, side: int) -> Reach:
    """Return what was found on a side, with a bench that is there, and when."""
    kind, along_m, corner = search.where[side]
    low, high = visits.ranges_m[:, kinds[kind]]
    bench = int(kinds[kind][np.argmax(np.minimum(along_m - low, high - along_m))])
    t_s = visits.when_s(bench, along_m)
    chain = state(visits.scene, t_s)
    x, y = benches_of(chain, visits.scene.dragon, axes_of(chain)).corners[bench, corner].tolist()
    low_m = (x, -x, y, -y)[side]
    high_m = max(low_m, float(search.best[side]), float(search.high[side]))
    high_m += EXACT.promise_for_m(max(visits.scene.size_m, abs(high_m)))
    return Reach(SIDES[side], low_m, high_m, bench, CORNERS[corner], t_s, (x, y))
