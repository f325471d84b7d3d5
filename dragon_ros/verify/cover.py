"""Clears all places that all benches go through: intervals, halved until each is proved, within a budget.

What follows a bench depends only on where its front handle is, and on the benches behind it. So the benches from which
the dragon goes on alike form a set: the first of them clears the track for all of its set, at each place as many benches
behind as any of the set that comes there has behind it. A certificate's intervals are hints where to cut, and no more.
"""
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flint import arb

from dragon_ros.verify.balls import above, below
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.interval import Interval, Overlap
from dragon_ros.verify.posture import Dragon, Posture
from dragon_ros.verify.ranges import Range
from dragon_ros.verify.segments import HALF
from dragon_ros.verify.track import Track

_FINEST = 2.0**-44      # of a metre, or of the distance along the track: an interval is not halved below it
Progress = Callable[[float, float], None]


@dataclass
class Budget:
    """How many links may still be placed before the proof is given up, and how many intervals were proved."""

    links: int
    intervals: int = 0

    def spend(self, links: int) -> None:
        """Take links from the budget. Raises Refused where none are left."""
        self.links -= links
        if self.links < 0:
            raise Refused('it was not proved within the budget; give a larger --effort')


@dataclass(frozen=True)
class Way:
    """What a set of benches goes through: its first bench, and for each bench of it where its front handle is."""

    lead: int
    members: tuple[tuple[int, Range], ...]

    def most(self, low: arb, high: arb) -> int | None:
        """Return the first bench that comes between two places: it has most behind it. None if none does."""
        return next((bench for bench, (least, last) in self.members if not last < low and not least > high), None)

    @property
    def parts(self) -> list[Range]:
        """The places in pieces that do not touch each other."""
        out: list[Range] = []
        for low, high in sorted((place for _, place in self.members), key=lambda place: float(place[0])):
            if out and not low > out[-1][1]:
                out[-1] = out[-1][0].min(low), out[-1][1].max(high)
            else:
                out.append((low, high))
        return out


def ways(dragon: Dragon, places: Sequence[Range]) -> list[Way]:
    """Return the sets of benches from which the dragon goes on alike, with what they go through."""
    lengths, count = dragon.lengths_m, len(dragon.lengths_m)
    sets: dict[int, list[int]] = {}
    for bench in range(count - 2):
        lead = next((lead for lead in sets if lengths[lead:lead + count - bench] == lengths[bench:]), bench)
        sets.setdefault(lead, []).append(bench)
    return [Way(lead, tuple((bench, places[bench]) for bench in sets[lead])) for lead in sets]


class Cover:
    """Clears the ways of all sets of benches on a track."""

    def __init__(self, track: Track, dragon: Dragon, bend: float | None, budget: Budget, progress: Progress) -> None:
        """Take the track's largest curvature, or None where handles may turn back; ``progress`` is told metres."""
        self._track, self._dragon, self._bend, self.budget, self._tell = track, dragon, bend, budget, progress

    def clear(self, every: Sequence[Way], hints: dict[int, list[float]]) -> None:
        """Clear all ways. Raises Refused for the first place that cannot be proved clear."""
        parts = [(way, part) for way in every for part in way.parts]
        whole = sum(above(high - low) for _, (low, high) in parts)
        done = 0.0
        for way, (low, high) in parts:
            cuts = sorted({cut for cut in hints.get(way.lead, ()) if above(low) < cut < below(high)}
                          | {cut for joint in self._track.joints for cut in (below(joint), above(joint))
                             if above(low) < cut < below(high)})
            done = self._clear(way, [low, *map(arb, cuts), high], done, whole)

    def _clear(self, way: Way, cuts: list[arb], done: float, whole: float) -> float:
        """Clear the places between cuts: many at once where that can be proved, else halved."""
        end = self._posture(way, cuts[-1])
        stack = [(0, len(cuts) - 1, cuts[0], cuts[-1], end)]
        begin = self._posture(way, cuts[0])
        while stack:
            first, last, low, high, end = stack.pop()
            if self._proved(way, low, high, begin, end):
                begin = end
                done += above(high - low)
                self.budget.intervals += 1
                self._tell(done, whole)
                continue
            if last - first > 1:
                half = (first + last) // 2
                middle, numbers = cuts[half], ((first, half), (half, last))
            else:
                middle, numbers = (HALF * (low + high)).mid(), ((0, 0), (0, 0))
                if not above(high - low) > _FINEST * (1 + abs(float(low))):
                    raise Refused(f'benches {self._stuck[0]} and {self._stuck[1]} could not be proved apart where '
                                  f'the front handle of the former is {float(low):.12g} m along the track')
            between = self._posture(way, middle)
            stack += [(*numbers[1], middle, high, end), (*numbers[0], low, middle, between)]
        return done

    def _posture(self, way: Way, place: arb) -> Posture:
        return Posture(self._track, self._dragon, way.lead, self._track.place_at(place))

    def _proved(self, way: Way, low: arb, high: arb, begin: Posture, end: Posture) -> bool:
        """Return whether the leading bench is proved clear between two places of all that may be behind it there."""
        bench = way.most(low, high)
        if bench is None:
            return True
        behind = len(self._dragon.benches) - 1 - bench
        placed = begin.placed + end.placed
        try:
            stuck = Interval(self._track, self._dragon, way.lead, (begin, end), self._bend).clear(2, behind)
        except Overlap as found:
            self._check_overlap(way, found, (low, high)[found.end])
            stuck = found.benches[1] - found.benches[0]
        self.budget.spend(begin.placed + end.placed - placed + 2)
        if stuck is not None:
            self._stuck = bench, bench + stuck
        return stuck is None

    def _check_overlap(self, way: Way, found: Overlap, place: arb) -> None:
        """Refuse an overlap of benches that are there at all when the leading bench is at a place."""
        bench = way.most(place, place)
        if bench is not None and bench + found.benches[1] - found.benches[0] < len(self._dragon.benches):
            raise Refused(f'benches {bench} and {bench + found.benches[1] - found.benches[0]} overlap where the front '
                          f'handle of the former is {float(place):.12g} m along the track')
