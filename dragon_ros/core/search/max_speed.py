"""The speed of the fastest handle over a whole run, and the largest leader speed that keeps all handles under a limit.

Speeds relative to the leader's speed depend on the leader's position, not on time. Branch and bound therefore searches
intervals of time in which the leader moves in one direction, and cuts those whose bound exceeds the largest speed found
so far. If handles are equally fast at many positions, as on a circle, the search would never end; the allowed excess of
a bound therefore grows with the number of intervals that would be cut.

The bound on an interval is computed as follows. Between two states, ``enclosures.on_track`` bounds the slope of log |v|
of each handle with respect to the leader's distance. If all slopes lie between a lowest and a highest value, log |v|
lies below the two lines through its values at the ends, so the intersection of these lines is a bound. The logarithm of
the leader's own speed is added; its slope is the acceleration divided by the squared speed. If a slope is unbounded,
because a handle turns back or the leader comes to rest, the product of the largest speed ratios of the links bounds the
speed. As intervals shrink, the excess of the bound decreases with the square of their length, or with the length itself
if a handle passes a joint, where the curvature jumps.

If a leading head winds in on the first segment, no handle on this segment is faster than the preceding handle. The
reason is that the curvature increases towards the front, and that a chord of an arc that turns by less than pi makes
its larger angle with the arc at the more curved end (Vogt 1914). The search therefore examines only the handles beyond
the first segment or, on a single spiral, those beyond the point where a link's arc could turn by pi.
"""
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, inf, isfinite

import numpy as np

from dragon_ros.core.chain.chain import Chain, marched_many
from dragon_ros.core.chain.commanded import passed_s, times_between
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.chain.kinematics import RigidLinks
from dragon_ros.core.checks import number
from dragon_ros.core.enclosures.ball_arithmetic import Ball, between
from dragon_ros.core.enclosures.on_track import LinkStates, link_states, speeds_enclosed
from dragon_ros.core.errors import FieldError
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.driver import Boxes, InOrder, divisible, run
from dragon_ros.core.tracks.composite import Place, Track
from dragon_ros.core.tracks.segments import BEHIND, LARGEST_BEND
from dragon_ros.core.tracks.spiral import BENT

_SPACING_M = 0.2        # length of the first intervals, in leader travel
_PARTS = 4              # number of parts into which an interval is cut
_AT_ONCE = 256          # number of intervals that are bounded together
_SAME = 1e-12           # speeds with a smaller relative difference count as equal
# The distance of a cut from the end of the inward segment; at the end itself, rounding would decide which segment
# applies.
_APART_M = 1e-9
_MOST = 2_000_000       # maximum number of first intervals


@dataclass(frozen=True)
class MaxSpeed:
    """The ratio of the largest speed of any handle in a run to the leader's largest speed, and where it occurs.

    ``travel_m`` is the distance that the leader has travelled since t = 0 when this speed occurs, and ``along_m`` the
    leader's distance along the track at the same time (for an S-turn, from the entry). If several handles are equally
    fast, ``handle`` is the first of them. No handle exceeds ``bound`` times the leader's largest speed anywhere in the
    run; this is proved, including the rounding of speeds. ``looks`` is the number of states evaluated.

    A speed profile is scaled as a whole: all its speeds by one factor and all its times by the inverse factor, so that
    the leader passes the same positions. If the leader rests for the whole run, ``ratio`` is the speed ratio at the
    leader's position.
    """

    ratio: float
    handle: int
    travel_m: float
    along_m: float
    bound: float
    looks: int

    def leader_m_s(self, limit_m_s: float) -> tuple[float, float]:
        """Return the largest leader speed at which no handle exceeds a limit, and by how much it may be too large.

        Raises FieldError if the limit is not positive.
        """
        limit = number('limit_m_s', limit_m_s, above=0.0, high=1e9)
        return limit / self.ratio, limit / self.ratio - limit / self.bound


def max_speed(scene: Scene, progress: Callable[[int], object] = lambda looks: None) -> MaxSpeed:
    """Find the fastest handle during the scene's run, and bound its speed.

    ``progress(looks)`` is called with the number of states evaluated since the last call. Raises FieldError if the run
    reaches a lock, where speeds are unbounded.
    """
    end = compile_scene(scene).end
    if end.reason == 'lock':
        raise FieldError('run.stop_s', scene.run.stop_s, f'the run reaches a lock at {end.t_s:.6f} s, and speeds '
                         'near a lock are unbounded', 'stop earlier')
    return _Speeding(scene, progress).run()


class _Speeding(InOrder):
    """A search over times, with the best result so far: the log of the largest speed, its time, and its handle."""

    at_once = _MOST     # no limit; bounds exclude most intervals once the largest speed of all states is known

    def __init__(self, scene: Scene, progress: Callable[[int], object]) -> None:
        self._scene, self._leader, self._law = scene, compile_scene(scene).model.leader, _law_of(scene)
        self._looks, self._tell = 0, progress
        self._best, self._bound = (-inf, scene.run.start_s, 0), -inf
        leader = self._leader
        self._behind_m = np.concatenate(([0.0], np.cumsum(leader.links_m)))    # lower bounds on distances
        self._no_faster_m = _no_faster_m(leader.track, leader.links_m) if leader.direction == BEHIND else -inf

    def run(self) -> MaxSpeed:
        """Search all times, and return the fastest handle with its bound."""
        run(self, Boxes(*self._first()[:, None]))
        top, t_s, handle = self._best
        leader, travel_m = self._leader, self._scene.head.travelled_m(t_s)
        with np.errstate(over='ignore'):
            ratio, bound = (float(np.exp(log)) for log in (top, max(self._bound, top)))
        number = handle if leader.direction == BEHIND else leader.links_m.size - handle
        return MaxSpeed(ratio, number, float(travel_m) + 0.0,
                        leader.track.distance_of(leader.place(travel_m)), bound, self._looks)

    def judge(self, boxes: Boxes) -> Boxes:
        """Bound intervals, record the bounds of those that contain no faster handle, and cut the others."""
        intervals = np.stack((boxes.low[0], boxes.high[0]))
        tops, sure, *ends_m = np.concatenate([self._bounds(part) for part in np.array_split(
            intervals, ceil(boxes.size / _AT_ONCE), axis=1)], axis=1)
        more = tops - self._best[0]
        near = _SAME * max(1.0, (np.count_nonzero(more > _SAME) / _AT_ONCE)**2)
        higher = (more > near) & divisible(*intervals) & divisible(*ends_m)
        self._bound = max(self._bound, float(np.max(sure[~higher], initial=-inf)))
        return boxes.some(higher).cut(_PARTS)

    def _first(self) -> Floats:
        """Return short first time intervals (s, shape (2, M)), cut at the law's breaks and where handles turn back."""
        start_s, stop_s = self._scene.run.start_s, compile_scene(self._scene).end.t_s
        times = times_between(self._scene.head, start_s, stop_s)
        travels_m = [self._travel_m(t_s) for t_s in times]
        cuts = self._leader.turning_m(min(travels_m), max(travels_m))
        if isfinite(self._no_faster_m):
            cuts.append(self._no_faster_m - _APART_M - self._leader.start_m)
        parts, count = list[tuple[float, float, int]](), 0
        for pair, ends_m in zip(pairwise(times), pairwise(travels_m), strict=True):
            inner = sorted(passed_s(self._scene.head, cut, *pair) for cut in cuts if min(ends_m) < cut < max(ends_m))
            for low_s, high_s in pairwise([pair[0], *inner, pair[1]]):
                part = self._count(low_s, high_s)
                parts.append((low_s, high_s, part))
                count += part
        parts.append((stop_s, stop_s, 1))       # the law may jump there
        if count > _MOST:
            raise FieldError('run.stop_s', self._scene.run.stop_s, f'the leader travels {count * _SPACING_M:.3g} m; '
                             f'at most {_MOST * _SPACING_M:.3g} m can be searched', 'stop earlier')
        nodes = [np.linspace(low_s, high_s, part + 1) for low_s, high_s, part in parts]
        return np.concatenate([np.stack((one[:-1], one[1:])) for one in nodes], axis=1)

    def _count(self, low_s: float, high_s: float) -> int:
        ends = [self._travel_m(t_s) for t_s in (low_s, high_s)]
        if not self._links(max(ends)):
            return 1        # the leader is the fastest handle there
        return max(1, ceil(abs(ends[1] - ends[0]) / _SPACING_M))

    def _travel_m(self, t_s: float) -> float:
        return float(self._scene.head.travelled_m(t_s))

    def _links(self, travel_m: float) -> int:
        """Return the number of links behind the leader whose rear handles may be faster than all preceding handles."""
        if self._leader.direction != BEHIND:
            return self._leader.links_m.size
        beyond = self._leader.start_m + travel_m - self._no_faster_m
        return int(np.searchsorted(self._behind_m[:-1], beyond))

    def _bounds(self, intervals: Floats) -> Floats:
        """Return bounds on log speeds in intervals (2, M), and the leader's distances at both ends; record the speeds.

        The rows of the result (4, M) are the bounds without rounding, the bounds with rounding, and the leader's
        distances (m) at the starts and at the stops.
        """
        times, index = np.unique(intervals, return_inverse=True)
        states = self._states(times)
        starts, stops = index.reshape(2, -1)
        law = self._law.between(*intervals)
        for rows, speed, t_s in ((starts, law.start, intervals[0]), (stops, law.stop, intervals[1])):
            self._note(states.log[rows] + speed[:, None], t_s)
        back = states.travel_m[starts] > states.travel_m[stops]
        tops = bounds(states.rows(np.where(back, stops, starts)), states.rows(np.where(back, starts, stops)),
                      law.swapped(back))
        with np.errstate(over='ignore', divide='ignore', invalid='ignore'):
            ratio = np.exp(tops)
            off = compile_scene(self._scene).speed_promise(ratio, 1 + ratio)
            sure = np.where(off < 1, np.log(ratio + off), np.inf)     # otherwise rounding may hide an unbounded speed
        return np.stack((np.max(tops, axis=1), np.max(sure, axis=1), states.travel_m[starts], states.travel_m[stops]))

    def _states(self, times_s: Floats) -> 'SpeedStates':
        self._looks += times_s.size
        self._tell(times_s.size)
        leader, travel_m = self._leader, self._scene.head.travelled_m(times_s)
        links = leader.links_m[:self._links(float(np.max(travel_m)))]
        chains = marched_many(leader.track, links, leader.places(travel_m), leader.direction)
        return states_of(chains, travel_m, leader.direction)

    def _note(self, log: Floats, times_s: Floats) -> None:
        tops = np.max(log, axis=1)
        row = int(np.argmax(tops))
        if tops[row] > self._best[0]:
            self._best = float(tops[row]), float(times_s[row]), int(np.argmax(log[row] > tops[row] - _SAME))


def _no_faster_m(track: Track, links_m: Floats) -> float:
    """Return the distance along the track up to which no handle is faster than the preceding one; -inf if unknown."""
    if track.from_afar is None:
        return -inf
    if not track.may_lock:       # every link's arc turns by less than pi
        return track.end_of_first_m
    return track.distance_of(Place(0, BENT * float(np.max(links_m)) / (LARGEST_BEND * track.from_afar.curve.b_m)))


@dataclass(frozen=True)
class LawBetween:
    """The log of the leader's relative speed at both ends of M intervals, and bounds on its slope along the track."""

    start: Floats
    stop: Floats
    slope: Ball

    def swapped(self, which: Array) -> 'LawBetween':
        """Return the intervals with start and stop swapped where ``which`` is True."""
        return LawBetween(np.where(which, self.stop, self.start), np.where(which, self.start, self.stop), self.slope)


@dataclass(frozen=True)
class _Steady:
    """A constant speed."""

    def between(self, start_s: Floats, stop_s: Floats) -> LawBetween:
        """Return zero logs and slopes, because the relative speed is always 1."""
        none = np.zeros(start_s.shape)
        return LawBetween(none, none, Ball(none, none))


@dataclass(frozen=True)
class _Varying:
    """The speeds of a profile, relative to the largest speed during the run."""

    law: Profile
    largest_m_s: float

    def between(self, start_s: Floats, stop_s: Floats) -> LawBetween:
        """Return logs and slopes on intervals between the law's breaks; at a jump, use the speed inside the interval.

        The slope of log |v| with respect to distance is dv/dt / v^2. At rest the slope is unbounded, and log |v| is
        -inf.
        """
        pairs = list(zip(start_s.tolist(), stop_s.tolist(), strict=True))
        at, before = self.law.speed_at_m_s, self.law.speed_before_m_s
        v = np.abs([[at(low), before(high) if low < high else at(high)] for low, high in pairs])
        rate = np.array([self.law.acceleration_range_m_s2(*pair) for pair in pairs])
        with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
            log = np.log(v / self.largest_m_s)
            slopes = (rate[:, :, None] / (v * v)[:, None, :]).reshape(-1, 4)
            slope = between(np.min(slopes, axis=1), np.max(slopes, axis=1))
        bounded = np.isfinite(slope.mid) & np.isfinite(slope.rad)
        return LawBetween(log[:, 0], log[:, 1], Ball(np.where(bounded, slope.mid, 0.0),
                                                     np.where(bounded, slope.rad, np.inf)))


def _law_of(scene: Scene) -> _Steady | _Varying:
    """Return the leader's law relative to its largest speed in the run, or a steady law if the leader always rests."""
    if isinstance(scene.head, Head):
        return _Steady()
    start_s, stop_s = scene.run.start_s, compile_scene(scene).end.t_s
    ends = times_between(scene.head, start_s, stop_s)
    assert isinstance(scene.head, Profile)      # the breaks of a commanded law are not known in advance
    at, before = scene.head.speed_at_m_s, scene.head.speed_before_m_s
    largest = max(*(abs(at(t_s)) for t_s in ends), *(abs(before(t_s)) for t_s in ends[1:] if start_s < stop_s))
    return _Varying(scene.head, largest) if largest else _Steady()


@dataclass(frozen=True)
class SpeedStates:
    """M states of a chain with K links, and the speeds of its handles in order from the leader.

    ``log`` (M, K+1) holds the logs of speeds relative to the leader's speed, and ``bends`` the smallest and largest
    curvatures over two segments of the track and all segments between them. ``direction`` is -1 if the head leads and 1
    if the tail leads.
    """

    links_m: Floats
    bends: tuple[Floats, Floats]
    direction: int
    travel_m: Floats
    log: Floats
    links: LinkStates

    def rows(self, index: Ints) -> 'SpeedStates':
        """Return a subset of the states."""
        return replace(self, travel_m=self.travel_m[index], log=self.log[index], links=self.links.rows(index))


def states_of(chains: Chain, travel_m: Floats, direction: int) -> SpeedStates:
    """Return the states of M chains whose leaders have travelled the distances ``travel_m``."""
    track, segment, u = chains.track, chains.segment, chains.u
    axis = RigidLinks(chains.p, chains.links_m, chains.headings, chains.leader).axis
    links = link_states(track.distances(segment, u), segment, track.curvatures(segment, u), chains.headings, axis,
                        chains.leader)
    with np.errstate(divide='ignore'):      # a handle is at rest when it turns back
        log = np.cumsum(np.log(np.abs(np.cos(links.near))) - np.log(np.abs(np.cos(links.far))), axis=1)
    order = slice(None, None, -direction)
    return SpeedStates(chains.links_m[order], track.bends, direction, travel_m, np.insert(log, 0, 0.0, axis=1), links)


def bounds(a: SpeedStates, b: SpeedStates, law: LawBetween) -> Floats:
    """Return upper bounds (M, K+1) on the logs of speeds between states a and b; the leader is further along in b."""
    with np.errstate(all='ignore'):
        r, v_rate = speeds_enclosed(a.links, b.links, a.links_m, a.bends, -a.direction)
        slope = -a.direction * v_rate + Ball(law.slope.mid[:, None], law.slope.rad[:, None])
        low, high = slope.mid - slope.rad, slope.mid + slope.rad
        start, stop, step = a.log + law.start[:, None], b.log + law.stop[:, None], (b.travel_m - a.travel_m)[:, None]
        meet = start + high * (stop - start - low * step) / (high - low)
        lines = np.maximum(np.maximum(start, stop), np.where((low < 0) & (high > 0), meet, -np.inf))
        most = np.insert(np.cumsum(np.log(r.most), axis=1), 0, 0.0, axis=1)
        crude = most + np.maximum(law.start, law.stop)[:, None]
    sure = np.isfinite(slope.rad) & np.isfinite(slope.mid) & np.isfinite(lines)
    out: Floats = np.fmin(np.where(sure, lines, np.inf), np.where(np.isnan(crude), np.inf, crude))
    return out
