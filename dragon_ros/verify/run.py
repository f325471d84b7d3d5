"""What the leader goes through in a run, and where the run ends: proved, not believed.

A run ends when it stops, when a link locks, or when a handle comes to an end of the track. Where handles are depends on
how far the leader has gone and not on when, so all of this is about distances that the leader has gone.
"""
from dataclasses import dataclass
from fractions import Fraction
from math import cos, pi, sin

from flint import arb

from dragon_ros.verify.balls import exact
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.law import Law
from dragon_ros.verify.posture import Dragon
from dragon_ros.verify.reading import Scene
from dragon_ros.verify.segments import HALF, PI, TWO, Link, SpiralSegment, about_span
from dragon_ros.verify.track import Place, Track

_SAMPLES = 4000         # places at which a lock is looked for
_HALVINGS = 200


@dataclass(frozen=True)
class Limit:
    """Where the model itself ends: how far the leader has gone there, how near to that is proved, and why it ends."""

    gone: arb
    slack_m: float
    why: str


@dataclass(frozen=True)
class Run:
    """A run up to a time: bounds of how far the leader goes from 0 s on, and from the start on; and how it ends."""

    whole: tuple[arb, arb]
    part: tuple[arb, arb]
    end_s: float
    why: str
    slack_m: float


class Leader:
    """The leader on the track: where the head is when the leader has gone so far."""

    def __init__(self, track: Track, dragon: Dragon, tail_leads: bool) -> None:
        """Place the chain as it is at 0 s where the tail leads."""
        self._track, self._dragon, self.tail_leads = track, dragon, tail_leads
        self._tail: arb | None = None
        if tail_leads:
            place = track.place_at(track.start)
            for bench in dragon.benches:
                place = track.next(place, bench.link, -1)
            self._tail = track.distance(place)

    def head(self, gone: arb) -> arb:
        """Return the distance of the head along the track when the leader has gone so far."""
        if self._tail is None:
            return self._track.start + gone
        return self._ahead(self._tail - gone) if not gone.is_zero() else self._track.start

    def _ahead(self, tail: arb) -> arb:
        place = self._track.place_at(tail)
        for bench in reversed(self._dragon.benches):
            place = self._track.next(place, bench.link, 1)
        return self._track.distance(place)

    def limits(self, slack_m: float, deepest: arb | None) -> tuple[Limit | None, Limit | None]:
        """Return where the model ends while the leader goes back, and while it goes on; None where it does not.

        ``deepest`` bounds how far on the leader goes at all (None: without end).
        """
        track, begin = self._track, self._track.begin
        if self._tail is not None:
            back = Limit(arb(0), 0.0, 'the head is back at its end of the track')
            return back, None if begin is None else Limit(self._tail - begin, slack_m, 'the tail leaves the track')
        back_m = None if begin is None else self._ahead(begin) - track.start
        back = None if back_m is None else Limit(back_m, slack_m, 'the tail leaves the track')
        if track.to_centre:
            return back, self._lock(slack_m, deepest)
        return back, None if track.end is None else Limit(track.end - track.start, slack_m, 'the head leaves the track')

    def _lock(self, slack_m: float, deepest: arb | None) -> Limit:
        """Return the lock on a spiral to its centre, proved from both sides later on, or the centre if none locks."""
        segment = self._track.segments[0]
        assert isinstance(segment, SpiralSegment)
        start = float(self._track.place_at(self._track.start).u)
        until = 0.0 if deepest is None or deepest >= self._centre else float(self._track.place_at(self._track.start + deepest).u)
        chords = [bench.link.near / float(segment.b) for bench in self._dragon.benches]
        longest = [link_m / float(segment.b) for link_m in self._dragon.longest_links]
        theta = _first_lock(chords, longest, start, until)
        if theta is None:
            return Limit(self._centre, slack_m, 'the head reaches the centre')
        gone = self._track.distance(Place(0, arb(theta))) - self._track.start
        link = self._locking(gone + exact(slack_m))
        return Limit(gone, slack_m, f'the chain locks at link {link}')

    @property
    def _centre(self) -> arb:
        end = self._track.end
        assert end is not None
        return end - self._track.start

    def _locking(self, gone: arb) -> int:
        """Return the first link that is proved to have no place when the leader has gone so far."""
        segment = self._track.segments[0]
        assert isinstance(segment, SpiralSegment)
        u = self._track.place_at(self._track.start + gone).u
        for number, bench in enumerate(self._dragon.benches):
            try:
                span = segment.span(u, bench.link)
            except Refused:
                if never_reaches(segment, u, bench.link):
                    return number
                raise Refused(f'the end of the run: link {number} could not be proved to lock') from None
            u = u + span
        raise Refused('the end of the run: no link could be proved to lock')


def _first_lock(chords: list[float], longest: list[float], start: float, until: float) -> float | None:
    """Return about the outermost polar angle of the head, from the start inwards, at which a link has no place."""
    outer = min(start, 0.5 * (longest[0] - pi))
    if outer <= until:
        return None if _stands(chords, longest, until) else start
    last = outer
    for n in range(_SAMPLES + 1):
        theta = outer + (until - outer) * n / _SAMPLES
        if not _stands(chords, longest, theta):
            return _between(chords, longest, theta, last)
        last = theta
    return None


def _between(chords: list[float], longest: list[float], low: float, high: float) -> float:
    """Return about the place between one at which the chain does not stand and one at which it does."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        low, high = (low, middle) if _stands(chords, longest, middle) else (middle, high)
    return high


def _stands(chords: list[float], longest: list[float], theta: float) -> bool:
    """Return whether all links seem to have a place; further out than the longest needs they have."""
    for chord, most in zip(chords, longest, strict=True):
        if most <= 2 * theta + pi:
            return True
        span = about_span(theta, chord) if chord else 0.0
        if span is None:
            return False
        theta += span
    return True


def never_reaches(segment: SpiralSegment, theta: arb, link: Link) -> bool:
    """Return whether the chord from a handle is proved to turn back before it reaches a link's length."""
    half_square, near = segment.chord(link).half_square, segment.chord(link).near
    at, delta = float(theta), pi

    def slope(delta: float) -> float:
        s = sin(0.5 * delta)
        return delta + 2 * at * s * (s + (at + delta) * cos(0.5 * delta))

    while slope(delta) > 0 and delta < near:
        delta += 1e-3
    last = arb(delta + 1e-3)
    sine, cosine = (HALF * last).sin_cos()
    if not last + TWO * theta * sine * (sine + (theta + last) * cosine) < 0:
        return False
    parts = [(PI.lower(), last)]
    while parts:
        low, high = parts.pop()
        both = low.union(high)
        sine = (HALF * both).sin()
        if HALF * both * both + TWO * theta * (theta + both) * (sine * sine) < half_square:
            continue
        # Nearer to the peak by the mean value theorem: what the chord gains there is small.
        middle = (HALF * (low + high)).mid()
        sine, cosine = (HALF * both).sin_cos()
        slope_of = both + TWO * theta * sine * (sine + (theta + both) * cosine)
        sine = (HALF * middle).sin()
        here = HALF * middle * middle + TWO * theta * (theta + middle) * (sine * sine)
        if here + slope_of * (both - middle) < half_square:
            continue
        if float(high - low) < 1e-12:
            return False
        parts += [(low, middle), (middle, high)]
    return True


def run_of(law: Law, leader: Leader, scene: Scene, until_s: float | None, slack_m: float) -> Run:
    """Return what the leader goes through up to a time, or up to the end of the run (``until_s`` None).

    Raises Refused where the model ends before the run starts, or before that time.
    """
    stop_s = scene.stop_s if until_s is None else until_s
    start, stop = Fraction(scene.start_s), None if stop_s is None else Fraction(stop_s)
    deepest = None
    if stop is not None:
        deepest = exact(law.extent_m(Fraction(0), stop)[1])
    limits = leader.limits(slack_m, deepest)
    for before, after in law.pieces(stop):
        for limit, sign in zip(limits, (-1, 1), strict=True):
            if limit and sign * exact(law.gone_m(after)) > sign * limit.gone:
                return _ended(law, start, before, after, limit, sign)
    if stop is not None:
        ends = [tuple(map(exact, law.extent_m(first, stop))) for first in (Fraction(0), start)]
        return Run(_pair(ends[0]), _pair(ends[1]), float(stop), 'it stops', 0.0)
    knot, gone, speed = law.last
    ahead = limits[1] if speed > 0 else limits[0] if speed < 0 else None
    if ahead is None:
        raise Refused('scene.run.stop_s: nothing ends the run')
    sign = 1 if speed > 0 else -1
    return _ended(law, start, knot, None, ahead, sign)


def _pair(values: tuple[arb, ...]) -> tuple[arb, arb]:
    low, high = values
    return low.lower(), high.upper()


def _ended(law: Law, start: Fraction, before: Fraction, after: Fraction | None, limit: Limit, sign: int) -> Run:
    """Return a run that a limit ends while the leader goes one way from ``before`` on."""
    end = (limit.gone - sign * exact(limit.slack_m)) if limit.slack_m else limit.gone
    end_s = _passage(law, before, after, float(limit.gone), sign)
    if end_s < start:
        raise Refused(f'scene.run.start_s: the model ends before, at {float(end_s):.9g} s: {limit.why}')
    out = []
    for first in (Fraction(0), start):
        low, high = map(exact, law.extent_m(first, max(first, before)))
        out.append((low.min(end).lower(), high.max(end).upper()))
    # Where the leader is already within the slack, nothing is left to be shown beyond where it was.
    return Run(out[0], out[1], float(end_s), limit.why, limit.slack_m)


def _passage(law: Law, before: Fraction, after: Fraction | None, gone_m: float, sign: int) -> Fraction:
    """Return about when the leader has gone so far, on a piece of the law on which it goes one way."""
    if after is None:
        at, here, speed = law.last
        return at + (Fraction(gone_m) - here) / speed
    low, high = before, after
    if sign * (law.gone_m(before) - Fraction(gone_m)) >= 0:
        return before
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (low, middle) if sign * (law.gone_m(middle) - Fraction(gone_m)) > 0 else (middle, high)
    return high


