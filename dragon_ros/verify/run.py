"""Prove the leader's range of travel in a run, and the end of the run.

A run ends at its stop, when a link locks, or when a handle reaches an end of the track. The positions of handles depend
only on the distance travelled by the leader, so everything in this module is expressed in terms of that distance
instead of time.
"""
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import cos, pi, sin

from flint import arb

from dragon_ros.verify.balls import PI, certainly, exact
from dragon_ros.verify.cover import Budget
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.law import Extent, Law, Mark
from dragon_ros.verify.posture import Dragon
from dragon_ros.verify.ranges import Range
from dragon_ros.verify.reading import Scene
from dragon_ros.verify.segments import HALF, TWO, Link, SpiralSegment, about_span
from dragon_ros.verify.track import Place, Track

_SAMPLES = 4000         # number of positions of the head at which the search tests for a lock
_HALVINGS = 80          # number of bisections for times and positions that are only printed or are proved later
_BEFORE_LOCK_M = Fraction(1, 10**6)     # a run ends this far before a lock
_SHARE = 10             # number of links that, placed in floats, count as one step of the budget


@dataclass(frozen=True)
class Limit:
    """An end of the model: the distance travelled by the leader, the slack of the proof, and the reason."""

    gone: arb
    slack_m: float
    why: str


@dataclass(frozen=True)
class Run:
    """A run up to a time: bounds on the leader's travel since 0 s and since the start, and the reason for the end."""

    whole: Range
    part: Range
    end_s: float
    why: str
    slack_m: float


class Leader:
    """The leader on the track: the head's position for each distance travelled, and the ends of the model."""

    def __init__(self, track: Track, dragon: Dragon, tail_leads: bool, budget: Budget) -> None:
        """Place the chain at 0 s. Raises Refused if the chain does not fit on the track."""
        self._track, self._dragon, self._budget = track, dragon, budget
        place = track.place_at(track.start)
        self._tail: arb | None = None
        if tail_leads:
            budget.spend(len(dragon.benches))
            for bench in dragon.benches:
                place = track.next(place, bench.link, -1)
            self._tail = track.distance(place)

    def head(self, gone: arb) -> arb:
        """Return the distance of the head along the track when the leader has travelled ``gone``."""
        if self._tail is None:
            return self._track.start + gone
        return self._ahead(self._tail - gone) if not gone.is_zero() else self._track.start

    def _ahead(self, tail: arb) -> arb:
        """Return the distance of the head along the track when the tail is at a given distance."""
        self._budget.spend(len(self._dragon.benches))
        place = self._track.place_at(tail)
        for bench in reversed(self._dragon.benches):
            place = self._track.next(place, bench.link, 1)
        return self._track.distance(place)

    def limits(self, slack_m: float, furthest: arb | None) -> tuple[Limit | None, Limit | None]:
        """Return the ends of the model behind and ahead of the leader (None if there is no end).

        ``furthest`` is a bound on how far the leader moves forwards, or None.
        """
        track, begin, end = self._track, self._track.begin, self._track.end
        if self._tail is not None:
            on = None if begin is None else Limit(self._tail - begin, slack_m, 'the tail leaves the track')
            return Limit(arb(0), 0.0, 'the head is back at the end of the track'), on
        back = None if begin is None else Limit(self._ahead(begin) - track.start, slack_m, 'the tail leaves the track')
        if track.to_centre:
            return back, self._lock(slack_m, furthest)
        return back, None if end is None else Limit(end - track.start, slack_m, 'the head leaves the track')

    def _lock(self, slack_m: float, furthest: arb | None) -> Limit:
        """Return the end before the first lock on a spiral that leads to its centre, or the centre without a lock.

        This proves that no chain exists one slack beyond the lock; its existence up to the end is proved later.
        """
        track, segment = self._track, self._track.segments[0]
        assert isinstance(segment, SpiralSegment)
        assert track.end is not None
        centre = track.end - track.start
        until = 0.0 if furthest is None or not furthest < centre else float(track.place_at(track.start + furthest).u)
        b = float(segment.b)
        chords = [bench.link.near / b for bench in self._dragon.benches]
        search = _Locks(chords, [link_m / b for link_m in self._dragon.longest_links], self._budget)
        theta = search.first(float(track.place_at(track.start).u), until)
        if theta is None:
            return Limit(centre, slack_m, 'the head reaches the centre')
        gone = track.distance(Place(0, arb(theta))) - track.start
        link = self._locking(segment, gone + exact(slack_m))
        return Limit(gone - exact(_BEFORE_LOCK_M), slack_m, f'the chain locks at link {link}')

    def _locking(self, segment: SpiralSegment, gone: arb) -> int:
        """Return the first link that provably cannot be placed when the leader has travelled ``gone``."""
        u = self._track.place_at(self._track.start + gone).u
        for number, bench in enumerate(self._dragon.benches):
            try:
                u = u + segment.span(u, bench.link)
            except Refused:
                certainly(never_reaches(segment, u, bench.link),
                          f'the end of the run: link {number} seems to lock, but this could not be proved')
                return number
        raise Refused('the end of the run: a link seemed to lock but can be placed')


class _Locks:
    """A search for locks in floats; ``chords``, and ``longest`` from each chord on, are in units of b."""

    def __init__(self, chords: Sequence[float], longest: Sequence[float], budget: Budget) -> None:
        self._chords, self._longest, self._budget = chords, longest, budget

    def first(self, start: float, until: float) -> float | None:
        """Return the approximate outermost position of the head at which the chain does not exist, or None.

        If the front handle of the longest link is so far out that this link can be placed, every link can be placed.
        """
        outer = min(start, 0.5 * (self._longest[0] - pi))
        last = outer
        for n in range(_SAMPLES + 1 if outer > until else 0):
            theta = outer + (until - outer) * n / _SAMPLES
            if not self._stands(theta):
                return self._between(theta, last)
            last = theta
        return None

    def _between(self, low: float, high: float) -> float:
        """Return the approximate boundary between positions at which the chain does not exist and does exist."""
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (low, middle) if self._stands(middle) else (middle, high)
        return high

    def _stands(self, theta: float) -> bool:
        """Return whether all links can be placed, as computed in floats."""
        for number, (chord, most) in enumerate(zip(self._chords, self._longest, strict=True)):
            if number % _SHARE == 0:
                self._budget.spend(1)
            if most <= 2 * theta + pi:
                return True
            span = about_span(theta, chord)
            if span is None:
                return False
            theta += span
        return True


def never_reaches(segment: SpiralSegment, theta: arb, link: Link) -> bool:
    """Return whether the chord from a handle provably decreases before it reaches the length of a link.

    The chord grows up to a span of pi. The claim therefore holds if the chord decreases at a larger span and is
    shorter than the link at all spans from pi up to that span. Close to the peak, where the chord hardly grows, the
    mean value theorem bounds the chord.
    """
    half_square, near = segment.chord(link).half_square, segment.chord(link).near
    at, delta = float(theta), pi
    while delta < near and delta + 2 * at * sin(0.5 * delta) * (
            sin(0.5 * delta) + (at + delta) * cos(0.5 * delta)) > 0:
        delta += 1e-3
    last = arb(delta + 1e-3)
    if not _slope(theta, last) < 0:
        return False
    parts = [(PI.lower(), last)]
    while parts:
        low, high = parts.pop()
        both, middle = low.union(high), (HALF * (low + high)).mid()
        if not (_half_square(theta, both) < half_square
                or _half_square(theta, middle) + _slope(theta, both) * (both - middle) < half_square):
            if not high - low > 1e-12:
                return False
            parts += [(low, middle), (middle, high)]
    return True


def _half_square(theta: arb, delta: arb) -> arb:
    """Return half the squared chord."""
    sine = (HALF * delta).sin()
    return HALF * delta * delta + TWO * theta * (theta + delta) * (sine * sine)


def _slope(theta: arb, delta: arb) -> arb:
    """Return the derivative of half the squared chord with respect to the span."""
    sine, cosine = (HALF * delta).sin_cos()
    return delta + TWO * theta * sine * (sine + (theta + delta) * cosine)


def run_of(law: Law, leader: Leader, scene: Scene, until_s: float | None, slack_m: float) -> Run:
    """Return the leader's travel up to a time or, if ``until_s`` is None, up to the end of the run.

    Raises Refused if nothing ends the run, or if the model ends before it starts.
    """
    stop_s = scene.stop_s if until_s is None else until_s
    start, stop = Fraction(scene.start_s), None if stop_s is None else Fraction(stop_s)
    limits = leader.limits(slack_m, None if stop is None else exact(law.extent_m(Fraction(0), stop)[1]))
    for before, after in law.pieces(stop):
        for limit, sense in zip(limits, (-1, 1), strict=True):
            if limit and exact(after.travel_m) * sense > limit.gone * sense:
                return _ended(law, start, before, after, limit, sense)
    if stop is not None:
        whole, part = (_within(law.extent_m(first, stop), limits) for first in (Fraction(0), start))
        return Run(whole, part, float(stop), 'it stops', 0.0)
    knot, speed = law.last
    ahead = limits[1] if speed > 0 else limits[0] if speed < 0 else None
    if ahead is None:
        raise Refused('scene.run.stop_s: nothing ends the run')
    return _ended(law, start, knot, None, ahead, 1 if speed > 0 else -1)


def _within(extent: Extent, limits: tuple[Limit | None, Limit | None]) -> Range:
    """Return an extent that is rounded outwards and limited to the ends of the model."""
    low, high = map(exact, extent)
    back, on = limits
    return (low if back is None else low.max(back.gone)).lower(), (high if on is None else high.min(on.gone)).upper()


def _ended(law: Law, start: Fraction, before: Mark, after: Mark | None, limit: Limit, sense: int) -> Run:
    """Return a run that ends one slack before a limit; from ``before`` on, the leader moves in one direction."""
    end_s = _passage(law, before, after, Fraction(float(limit.gone)), sense)
    if end_s < start:
        raise Refused(f'scene.run.start_s: the model ends before it, at {float(end_s):.12g} s: {limit.why}')
    end = limit.gone - exact(limit.slack_m) * sense
    whole, part = (_up_to(law.extent_m(first, max(first, before.t_s)), end, sense) for first in (Fraction(0), start))
    return Run(whole, part, float(end_s), limit.why, limit.slack_m)


def _up_to(extent: Extent, end: arb, sense: int) -> Range:
    """Return an extent that is rounded outwards and extended in one direction to an end."""
    low, high = map(exact, extent)
    return (low.lower(), high.max(end).upper()) if sense > 0 else (low.min(end).lower(), high.upper())


def _passage(law: Law, before: Mark, after: Mark | None, travel_m: Fraction, sense: int) -> Fraction:
    """Return the approximate time at which the leader has travelled this far, on a piece without a reversal."""
    if (before.travel_m - travel_m) * sense >= 0:
        return before.t_s
    if after is None:
        return before.t_s + (travel_m - before.travel_m) / law.last[1]
    low, high = before.t_s, after.t_s
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if (law.travel_m(middle) - travel_m) * sense > 0 else (middle, high)
    return high
