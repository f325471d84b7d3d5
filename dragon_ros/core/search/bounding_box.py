"""The space that a run requires: bounds on the largest x, -x, y and -y of any corner of any bench.

The pose of a bench depends only on its length and on the position of its front handle, not on the time, the leader, or
the index of the bench. Branch and bound therefore searches only a few intervals of the track: one interval for the
head's front handle, and, for each length of the other benches, the intervals that their front handles pass through.
Intervals whose bound exceeds the largest value found so far are cut.

The bound on an interval is derived as follows. Let s and t be the distances of a bench's front and rear handles along
the track, q and r the positions of the two handles, and h and l the distances that they move over the interval. A
corner at the complex offset a from the bench's middle (a is real along the link) lies at A q + B r, where A = 1/2 + a /
link and B = 1/2 - a / link. The derivative of this position with respect to s is

    g' = (A q') + (B r') cos alpha / cos beta,

where alpha and beta are the link's angles with the track's tangents. A value that changes from x0 to x1 with a total
variation of at most X never deviates from the mean of x0 and x1 by more than X / 2. If the curvature at the handles is
at most k, the tangent at the front handle turns by at most k h and the tangent at the rear handle by at most k l;
``enclosures.on_track`` bounds the ratio of the cosines. All factors of g' therefore lie in known balls, so g' also lies
in a ball, which gives a bound |g'| <= G. Each coordinate of the corner changes by at most V = min(G h, |A| h + |B| l),
and never exceeds the mean of its values at the two ends by more than V / 2. As intervals shrink, the excess of the
bound decreases with the square of their length, or with the length itself if a handle passes a joint, where the
curvature jumps. The bound holds only if the rear handle moves in one direction.
"""
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from dragon_ros.core.chain.chain import Chain, marched
from dragon_ros.core.chain.commanded import passed_s, times_between
from dragon_ros.core.chain.dragon import AnyDragon
from dragon_ros.core.chain.forward import next_places
from dragon_ros.core.chain.lock import turns
from dragon_ros.core.enclosures.ball_arithmetic import Ball
from dragon_ros.core.enclosures.on_track import LinkStates, enclosed, link_states
from dragon_ros.core.geometry.rectangles import axes_of, benches_of, corner_levers
from dragon_ros.core.geometry.signed_distance import CORNERS
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Array, Floats, Index, Ints, complex_of
from dragon_ros.core.promise import PER_METRE
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.driver import Boxes, InOrder, divisible, run
from dragon_ros.core.tracks.composite import Track
from dragon_ros.core.tracks.segments import BEHIND

SIDES = ('x', '-x', 'y', '-y')
_TOWARDS = np.array([1, -1, 1j, -1j])
_AT_ONCE = 512      # number of intervals that are bounded together
_FIRST, _PARTS = 32, 6      # numbers of parts of a first and of a later interval; fewer parts need more rounds
_SAME = 1e-13       # positions closer than this, relative to the distance along the track, count as equal
_MOST = 200_000     # maximum number of benches to place


@dataclass(frozen=True)
class Reach:
    """The reach on one side: a corner reaches ``low_m`` at ``t_s``, and no corner exceeds ``high_m`` during the run."""

    side: str
    low_m: float
    high_m: float
    bench: int
    corner: str
    t_s: float
    point_m: tuple[float, float]


@dataclass(frozen=True)
class BoundingBox:
    """The reaches on the four sides, in the order of SIDES; ``looks`` is the number of benches placed."""

    reaches: tuple[Reach, ...]
    looks: int

    @property
    def centred_m(self) -> tuple[float, float]:
        """Bounds on the side of the smallest axis-aligned square, centred on the origin, that contains the run."""
        return 2 * max(reach.low_m for reach in self.reaches), 2 * max(reach.high_m for reach in self.reaches)

    @property
    def free_m(self) -> tuple[float, float]:
        """Bounds on the side of the smallest axis-aligned square, centred anywhere, that contains the run."""
        low, high = ([getattr(reach, name) for reach in self.reaches] for name in ('low_m', 'high_m'))
        return max(low[0] + low[1], low[2] + low[3]), max(high[0] + high[1], high[2] + high[3])

    def fits_centred(self, side_m: float) -> bool | None:
        """Return whether the run fits into a square centred on the origin; None if the side is between the bounds."""
        return fits(self.centred_m, side_m)

    def fits_free(self, side_m: float) -> bool | None:
        """Return whether the run fits into an axis-aligned square anywhere; None if the side is between the bounds."""
        return fits(self.free_m, side_m)

    @property
    def touching(self) -> Reach:
        """The reach that determines the size of the square centred on the origin."""
        return max(self.reaches, key=lambda reach: reach.low_m)


def fits(bounds_m: tuple[float, float], side_m: float) -> bool | None:
    """Return whether a square with a side between ``bounds_m`` fits into one of side ``side_m``; None if undecided."""
    return True if bounds_m[1] <= side_m else False if bounds_m[0] > side_m else None


def bounding_box(scene: Scene, within_m: float = 1e-10,
                 progress: Callable[[int], object] = lambda looks: None) -> BoundingBox:
    """Return the space that a run requires, with bounds that are ``within_m`` plus the corners' error apart.

    The difference is larger if floats are too coarse, or if ``_MOST`` placed benches are not enough.
    ``progress(looks)`` is called with the number of benches placed since the last call.
    """
    ranges = HandleRanges(scene)
    search = _Reaching(progress, within_m)
    kinds = by_length(scene.dragon.bench_lengths_m)
    for kind, benches in enumerate(kinds):
        search.run(SweptBench.of(ranges.track, scene.dragon, int(benches[0])), intervals_of(ranges, benches), kind)
    return BoundingBox(tuple(_reach(ranges, kinds, search, side) for side in range(len(SIDES))), search.looks)


def by_length(lengths_m: Floats) -> list[Ints]:
    """Return the indices of the benches, grouped by length: first the head alone, then the benches behind it."""
    behind = dict.fromkeys(lengths_m[1:].tolist())
    return [np.array([0]), *(1 + np.flatnonzero(lengths_m[1:] == length) for length in behind)]


def intervals_of(ranges: 'HandleRanges', benches: Ints) -> Floats:
    """Return the intervals of the track (m, shape (2, M)), merged, that front handles of benches pass through.

    The intervals are cut where the rear handle turns back. If the track begins with laps of a circle, the last lap
    represents all of them.
    """
    low, high = ranges.ranges_m[:, benches]
    order = np.argsort(low)
    low, high = low[order], np.maximum.accumulate(high[order])
    begins = np.flatnonzero(np.concatenate(([True], low[1:] > high[:-1])))
    ends = np.concatenate((begins[1:] - 1, [low.size - 1]))
    low, high = low[begins], high[ends]
    track = ranges.track
    out: Floats = np.stack((np.maximum(low, np.minimum(high, track.end_of_first_m) - track.lap_m), high))
    for turn in turning_m(track, float(ranges.scene.dragon.link_lengths_m[benches[0]])):
        inside = (out[0] < turn) & (turn < out[1])
        cut = np.array([[turn] * int(np.sum(inside)), out[1, inside]])
        out[1, inside] = turn
        out = np.concatenate((out, cut), axis=1)
    return out


def turning_m(track: Track, link_m: float) -> list[float]:
    """Return where along the track (m) a link's front handle is when its rear handle turns back."""
    if not (track.may_lock and track.from_afar):
        return []
    angles = np.array(turns(link_m / track.from_afar.curve.b_m))
    return [float(along_m) for along_m in track.distances(np.zeros(angles.size, dtype=np.int64), angles)]


class _Reaching(InOrder):
    """A search for the farthest corner on each side, with the best corners so far and bounds on finished intervals."""

    at_once = _AT_ONCE

    def __init__(self, progress: Callable[[int], object], within_m: float) -> None:
        self.looks, self._tell, self._within_m = 0, progress, within_m
        self.best: Floats = np.full(len(SIDES), -np.inf)
        self.high: Floats = np.full(len(SIDES), -np.inf)
        self.where = [(0, 0.0, 0)] * len(SIDES)
        self._kind: int
        self._bench: SweptBench | None = None

    def run(self, bench: 'SweptBench', intervals: Floats, kind: int) -> None:
        """Search intervals (2, M) of the track for one kind of bench."""
        self._bench, self._kind = bench, kind
        run(self, Boxes(*intervals[:, None]).cut(_FIRST))

    def judge(self, boxes: Boxes) -> Boxes:
        """Bound intervals, record the bounds of those that cannot exceed the best value, and cut the others."""
        assert self._bench
        ends = np.stack((boxes.low[0], boxes.high[0]))
        places, index = np.unique(ends, return_inverse=True)
        states, (low, high) = self._bench.states(places), index.reshape(2, -1)
        self.looks += places.size
        self._tell(places.size)
        self._note(states.value, places, self._kind)
        tops: Floats = np.max(self._bench.bounds(states.rows(low), states.rows(high)), axis=1)
        more = np.any(tops > self.best + self._within_m, axis=1) & divisible(*ends) & (self.looks < _MOST)
        self.high = np.maximum(self.high, np.max(tops[~more], axis=0, initial=-np.inf))
        return boxes.some(more).cut(_PARTS)

    def _note(self, value: Floats, places: Floats, kind: int) -> None:
        for side, values in enumerate(np.moveaxis(value, -1, 0)):
            place, corner = np.unravel_index(int(np.argmax(values)), values.shape)
            if values[place, corner] > self.best[side]:
                self.best[side] = values[place, corner]
                self.where[side] = kind, float(places[place]), int(corner)


def _reach(ranges: 'HandleRanges', kinds: list[Ints], search: _Reaching, side: int) -> Reach:
    """Return the result for one side, including the bench that reaches farthest and the time when it does so."""
    kind, along_m, corner = search.where[side]
    low, high = ranges.ranges_m[:, kinds[kind]]
    bench = int(kinds[kind][np.argmax(np.minimum(along_m - low, high - along_m))])
    t_s, scene = ranges.when_s(bench, along_m), ranges.scene
    chain = ranges.chain(scene.head.travelled_m(t_s))
    x, y = benches_of(chain, scene.dragon, axes_of(chain)).corners[bench, corner].tolist()
    low_m = (x, -x, y, -y)[side]
    high_m = max(low_m, float(search.best[side]), float(search.high[side]))
    simulation = compile_scene(scene)
    lever = float(corner_levers(scene.dragon)[bench])
    # Corners beyond the handles have larger rounding errors.
    high_m += lever * simulation.promise_m + PER_METRE * max(0.0, abs(high_m) - simulation.size_m)
    return Reach(SIDES[side], low_m, high_m, bench, CORNERS[corner], t_s, (x, y))


@dataclass(frozen=True)
class BenchStates:
    """A bench at M positions: the states of its link for ``on_track``, and the coordinates of its corners.

    ``value`` (M, 4, 4) holds the coordinates of the corners along SIDES; ``front`` and ``rear`` hold the two terms of
    the derivatives of these coordinates, without the factor cos alpha / cos beta.
    """

    link: LinkStates
    value: Floats
    front: Floats
    rear: Floats

    def rows(self, index: Index) -> 'BenchStates':
        """Return a subset of the states."""
        return BenchStates(self.link.rows(index), self.value[index], self.front[index], self.rear[index])


@dataclass(frozen=True)
class SweptBench:
    """A bench that moves along a track: its corners, and bounds on the corners between two positions of the bench."""

    track: Track
    link_m: float
    half_length_m: float
    half_width_m: float

    @classmethod
    def of(cls, track: Track, dragon: AnyDragon, number: int) -> 'SweptBench':
        """Return the bench of a dragon with the given number."""
        return cls(track, float(dragon.link_lengths_m[number]), 0.5 * float(dragon.bench_lengths_m[number]),
                   0.5 * dragon.width_m)

    @cached_property
    def _lever(self) -> Array:
        """The vectors from the middle of the bench to its corners as complex numbers, in the order of CORNERS."""
        along, aside = self.half_length_m, 1j * self.half_width_m
        return np.array([along + aside, -along + aside, -along - aside, along - aside])

    @cached_property
    def _shares(self) -> tuple[Array, Array]:
        """The factors A and B of the corners."""
        return 0.5 + self._lever / self.link_m, 0.5 - self._lever / self.link_m

    def states(self, along_m: Floats) -> BenchStates:
        """Return the states of the bench when its front handle is at the given distances along the track."""
        track, link = self.track, self.link_m
        fronts = track.places_at(along_m)
        rears = next_places(track, fronts, link, BEHIND)[0]
        segment, u = (np.stack(pair, axis=1) for pair in zip(fronts, rears, strict=True))
        (q, r), headings = complex_of(track.points(segment, u)).T, track.headings(segment, u)
        to, to_rear = complex_of(headings).T
        axis = (q - r) / link
        states = link_states(track.distances(segment, u), segment, track.curvatures(segment, u), headings,
                             np.stack((axis.real, axis.imag), axis=-1)[:, None], 0)
        one, two = self._shares
        value = (0.5 * (q + r))[:, None] + self._lever * axis[:, None]
        return BenchStates(states, _sides(value), _sides(one * to[:, None]),
                           _sides(two * to_rear[:, None]))

    def bounds(self, a: BenchStates, b: BenchStates) -> Floats:
        """Return upper bounds (M, 4, 4) on corners' coordinates between a state and one further along the track."""
        slope, crude = self.slopes(a, b)
        with np.errstate(all='ignore'):
            goes = np.fmin(crude, slope.most * _each(np.abs(b.link.along_m - a.link.along_m)[:, 0]))
        out: Floats = 0.5 * (a.value + b.value + goes)
        return out

    def slopes(self, a: BenchStates, b: BenchStates) -> tuple[Ball, Floats]:
        """Enclose the coordinates' derivatives with respect to the front handle's distance, and bound their changes."""
        with np.errstate(all='ignore'):
            moving = enclosed(a.link, b.link, np.array([self.link_m]), self.track.bends, passes=0)
            front_m, rear_m = np.abs(b.link.along_m - a.link.along_m).T
            turned, other = (moving.k.most * np.stack((front_m, rear_m), axis=1)).T
            ratio = moving.r[:, 0]
            one, two = (np.abs(share)[:, None] for share in self._shares)
            front = _mean(a.front, b.front, one * _each(turned))
            rear = _mean(a.rear, b.rear, two * _each(other))
            return (front + rear * Ball(_each(ratio.mid), _each(ratio.rad)),
                    one * _each(front_m) + two * _each(rear_m))


def _sides(z: Array) -> Floats:
    """Return the coordinates (M, 4, 4) of complex numbers (M, 4) along the directions SIDES."""
    out: Floats = (z[..., None] * _TOWARDS.conj()).real
    return out


def _each(value: Floats) -> Floats:
    """Return one value per state, broadcast to all corners and sides."""
    return value[:, None, None]


def _mean(a: Floats, b: Floats, variation: Floats) -> Ball:
    """Return a ball that contains a value while it changes from a to b with at most this total variation."""
    return Ball(0.5 * (a + b), 0.5 * variation)


class HandleRanges:
    """The ranges of front handles along the track during a run, and the times at which handles reach given positions.

    Each handle moves in one direction while the leader moves from one of ``_stops_m`` to the next. The stops are the
    smallest and the largest distance travelled by the leader, and the distances in between at which a handle turns
    back. Each handle therefore reaches its smallest and its largest distance along the track at a stop.
    """

    def __init__(self, scene: Scene) -> None:
        """Compile a scene."""
        self.scene = scene.exactly
        simulation = compile_scene(self.scene)
        self._model, self.track = simulation.model, simulation.model.track
        self._times_s = times_between(scene.head, scene.run.start_s, simulation.end.t_s)
        self._travel_m: list[float] = [scene.head.travelled_m(t_s) for t_s in self._times_s]

    @cached_property
    def _stops_m(self) -> list[float]:
        least, most = min(self._travel_m), max(self._travel_m)
        return [least, *self._model.leader.turning_m(least, most), most]

    @cached_property
    def _at_stops_m(self) -> Floats:
        """The distances (S, N) of the front handles along the track at the stops."""
        chains = [self.chain(travel_m) for travel_m in self._stops_m]
        return np.array([self.track.distances(chain.segment, chain.u)[:-1] for chain in chains])

    @cached_property
    def ranges_m(self) -> Floats:
        """The smallest and the largest distance of each front handle along the track (m, shape (2, N))."""
        return np.stack((np.min(self._at_stops_m, axis=0), np.max(self._at_stops_m, axis=0)))

    def chain(self, travel_m: float) -> Chain:
        """Return the chain after the leader has travelled ``travel_m``."""
        return self._model.march(travel_m)

    def when_s(self, handle: int, along_m: float) -> float:
        """Return a time at which a handle is at a given distance along the track."""
        travel_m = self._leader_m(handle, along_m)
        pairs = zip(pairwise(self._times_s), pairwise(self._travel_m), strict=True)
        times, ends_m = min(pairs, key=lambda pair: max(min(pair[1]) - travel_m, travel_m - max(pair[1])))
        low, high = (end_m - travel_m for end_m in ends_m)
        if low * high >= 0:
            return times[0] if abs(low) <= abs(high) else times[1]
        return passed_s(self.scene.head, travel_m, *times)

    def _leader_m(self, handle: int, along_m: float) -> float:
        """Return the distance travelled by the leader when a handle is at a given distance along the track."""
        stops = self._stops_m
        over, same = (self._at_stops_m[:, handle] - along_m).tolist(), _SAME * (1 + abs(along_m))
        nearest = min(range(len(stops)), key=lambda n: abs(over[n]))
        if abs(over[nearest]) <= same:
            return stops[nearest]

        def beyond_m(travel_m: float) -> float:
            beyond = self._handle_m(handle, travel_m) - along_m
            return beyond if abs(beyond) > same else 0.0

        for n in range(len(stops) - 1):
            if over[n] * over[n + 1] < 0:
                return illinois(beyond_m, stops[n], stops[n + 1], *over[n:n + 2])
        return stops[nearest]

    def _handle_m(self, handle: int, travel_m: float) -> float:
        """Return a handle's distance along the track when the leader has travelled a given distance."""
        leader = self._model.leader
        links, index = (leader.links_m[:handle], -1) if leader.direction == BEHIND else (leader.links_m[handle:], 0)
        chain = marched(leader.track, links, leader.place(travel_m), leader.direction)
        return float(self.track.distances(chain.segment, chain.u)[index])
