"""Clear all positions of all benches: intervals are halved until each is proved or the budget is spent.

The positions of the benches behind a bench depend only on its front handle and on their lengths. Benches that are
followed by matching sequences of lengths therefore form a class. The first bench of a class clears the track for the
whole class: at each position it is tested against as many benches behind it as any bench of the class has there.
"""
import time
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import ceil

from flint import arb

from dragon_ros.verify.balls import above, below
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.interval import Interval, Overlap
from dragon_ros.verify.posture import Dragon, Posture
from dragon_ros.verify.ranges import Range
from dragon_ros.verify.segments import HALF
from dragon_ros.verify.track import Track

_FINEST = 2.0**-70      # length of the shortest interval, relative to 1 m plus the distance along the track
_EARLY = 30_000         # number of steps before which no proof is abandoned
_NOTHING = 1e-9         # smallest cleared share for an estimate; the first interval may be one float spacing long
_SPARE = 2              # safety factor for the suggested effort, because the rate of a proof changes
_HOPELESS = 3           # longer proofs, relative to the budget, are abandoned early; valid ones need at most 1.8
Progress = Callable[[float, float, str], object]    # arguments: metres cleared, metres in total, advice on the budget


@dataclass
class Budget:
    """The budget in steps (links placed and pairs of benches tested), ``effort`` times the usual budget.

    ``spent`` is the number of steps used and ``intervals`` the number of intervals proved; a fraction ``share`` of
    the track has been cleared since step ``since``.
    """

    steps: int
    effort: float = 1.0
    spent: int = 0
    intervals: int = 0
    since: int = 0
    share: float = 0.0
    _begun_s: float = field(default_factory=time.monotonic)

    def spend(self, steps: int) -> None:
        """Deduct steps from the budget. Raises Refused if the budget is exceeded."""
        self.spent += steps
        if self.spent > self.steps:
            raise Refused(f'it was not proved within the budget of {self.steps} steps; {self._cure}')

    def check(self) -> None:
        """Raise Refused if the proof would take many times the budget at its current rate."""
        if self.spent - self.since > _EARLY and self.spent - self.since > _HOPELESS * self.steps * self.share:
            raise Refused(f'only {100 * self.share:.2g} % was proved in {self.spent} of {self.steps} steps; '
                          f'{self._cure}')

    @property
    def advice(self) -> str:
        """A suggestion to increase the budget; empty if the budget is sufficient at the current rate."""
        if not self._whole > self.steps:
            return ''
        return f'at this rate more than the budget: --effort {self._enough:.12g} is enough'

    @property
    def _whole(self) -> float:
        """Estimated steps of the whole proof, from the current rate; 0 if unknown."""
        return self.since + (self.spent - self.since) / self.share if self.share > _NOTHING else 0.0

    @property
    def _enough(self) -> float:
        """A sufficient effort, with a margin."""
        return ceil(10 * _SPARE * self.effort * self._whole / self.steps) / 10

    @property
    def _cure(self) -> str:
        """A suggested effort that is sufficient at the current rate, and the time that the proof would take."""
        if not self._whole:
            return f'give --effort above {self.effort:.3g}'
        return f'give --effort {self._enough:.12g} (at this rate the proof takes about {self._takes_s:.2g} s)'

    @property
    def _takes_s(self) -> float:
        """Time in seconds that the whole proof takes at the current rate."""
        return (time.monotonic() - self._begun_s) * self._whole / max(self.spent, 1)


@dataclass(frozen=True)
class Way:
    """The positions of a class of benches: the first bench, and for each bench the range of its front handle.

    A bench is always behind the preceding benches, so both the lower and the upper limits of the ranges are in order.
    """

    lead: int
    members: tuple[tuple[int, Range], ...]

    def most(self, low: arb, high: arb) -> int | None:
        """Return the first bench that moves between two positions, or None; this bench has the most benches behind it.

        A bench that only reaches the boundary between two intervals belongs to the other interval.
        """
        n = self._first(lambda place: not (place[0] >= high if low < high else place[0] > high))
        if n == len(self.members):
            return None
        bench, (_, last) = self.members[n]
        return None if (last <= low if low < high else last < low) else bench

    def _first(self, holds: Callable[[Range], bool]) -> int:
        """Return the index of the first member that meets a condition that all later members also meet."""
        first, after = 0, len(self.members)
        while first < after:
            n = (first + after) // 2
            first, after = (first, n) if holds(self.members[n][1]) else (n + 1, after)
        return first

    def ends(self, low: arb, high: arb) -> list[arb]:
        """Return the limits of the benches' ranges that lie between two positions, in ascending order."""
        return sorted([*self._ends(0, low, high), *self._ends(1, low, high)], key=float)

    def _ends(self, end: int, low: arb, high: arb) -> Iterator[arb]:
        first, after = (self._first(lambda place: not place[end] >= high), self._first(lambda place: place[end] <= low))
        return (place[end] for _, place in self.members[first:after])

    @property
    def parts(self) -> list[Range]:
        """The positions as disjoint ranges."""
        out: list[Range] = []
        for _, (low, high) in reversed(self.members):
            if out and not low > out[-1][1]:
                out[-1] = out[-1][0].min(low), out[-1][1].max(high)
            else:
                out.append((low, high))
        return out


def ways(dragon: Dragon, places: Sequence[Range]) -> list[Way]:
    """Return the classes of benches that are followed by matching sequences of lengths, with their positions."""
    sets: dict[int, list[int]] = {}
    for bench, lead in enumerate(_leads(dragon.lengths_m)[:-2]):
        sets.setdefault(lead, []).append(bench)
    return [Way(lead, tuple((bench, places[bench]) for bench in sets[lead])) for lead in sets]


def repeated(lengths: Sequence[float]) -> list[int]:
    """Return, for each index counted from the tail, how many lengths from there on equal the first lengths.

    This is the Z-algorithm. The lengths from bench i to the tail equal the first lengths from bench k <= i on if the
    value at index N - k - m is at least m = N - i.
    """
    count, text = len(lengths), lengths[::-1]
    same, left, right = [count] + [0] * (count - 1), 0, 0
    for n in range(1, count):
        length = min(same[n - left], right - n) if n < right else 0
        while n + length < count and text[length] == text[n + length]:
            length += 1
        same[n] = length
        if n + length > right:
            left, right = n, n + length
    return same


def _leads(lengths: Sequence[float]) -> list[int]:
    """Return, for each bench, the first bench whose lengths begin with those from this bench to the tail."""
    count, same = len(lengths), repeated(lengths)
    last = [0] * (count + 1)        # the last position whose value is at least the index
    for place, length in enumerate(same):
        last[length] = place
    for length in range(count - 1, 0, -1):
        last[length] = max(last[length], last[length + 1])
    return [bench - last[count - bench] for bench in range(count)]


class Cover:
    """Clears the positions of all classes of benches on a track."""

    def __init__(self, track: Track, dragon: Dragon, bend: float | None, budget: Budget, progress: Progress) -> None:
        """Store the track and the dragon; ``bend`` is the largest curvature, or None if handles may turn back."""
        self._track, self._dragon, self._bend, self.budget, self._tell = track, dragon, bend, budget, progress

    def clear(self, every: Sequence[Way]) -> None:
        """Clear all positions. Raises Refused for the first position that cannot be proved clear."""
        parts = [(way, part) for way in every for part in way.parts]
        whole_m = sum(above(high - low) for _, (low, high) in parts)
        joints = sorted({cut for joint in self._track.joints for cut in (below(joint), above(joint))})
        self.budget.since, self.budget.share, done_m = self.budget.spent, 0.0, 0.0
        self._tell(0.0, whole_m, self.budget.advice)
        for way, (low, high) in parts:
            for cleared_m in self._clear(way, low, high, joints):
                self.budget.intervals += 1
                done_m += cleared_m
                self.budget.share = done_m / whole_m if whole_m else 1.0
                self._tell(done_m, whole_m, self.budget.advice)

    def _clear(self, way: Way, low: arb, high: arb, joints: list[float]) -> Iterator[float]:
        """Clear the interval between two positions in the longest provable parts; yield the parts' lengths (m)."""
        begin, stack = self._posture(way, low), [(low, high, self._posture(way, high))]
        while stack:
            low, high, end = stack.pop()
            stuck = self._stuck(way, low, high, begin, end)
            if not stuck:
                begin = end
                yield above(high - low)
                continue
            if not above(high - low) > _FINEST * (1 + abs(float(low))):
                raise Refused(f'{stuck}, while the front handle of the former is {float(low):.12g} m along the track')
            short = stuck.absent or not high - low > self._dragon.longest_m
            middle = _middle(low, high, joints, way.ends(low, high) if short else [])
            stack += [(middle, high, end), (low, middle, self._posture(way, middle))]

    def _posture(self, way: Way, place: arb) -> Posture:
        return Posture(self._track, self._dragon, way.lead, self._track.place_at(place))

    def _stuck(self, way: Way, low: arb, high: arb, begin: Posture, end: Posture) -> 'Stuck | None':
        """Return why a class of benches is not proved clear between two positions of its first bench, or None."""
        bench = way.most(low, high)
        if bench is None:
            return None
        placed = begin.placed + end.placed
        interval = Interval(self._track, self._dragon, way.lead, (begin, end), self._bend)
        try:
            behind = interval.clear(2, len(self._dragon.benches) - 1 - bench)
        except Overlap as found:
            self._check_overlap(way, found, (low, high)[found.end])
            return Stuck(f'bench {bench} and those behind it: {found}', absent=True)
        except Refused as why:
            return Stuck(f'bench {bench} and those behind it: {why}', absent=True)
        finally:
            self.budget.spend(begin.placed + end.placed - placed + interval.tested)
            self.budget.check()
        return None if behind is None else Stuck(
            f'benches {bench} and {bench + behind} could not be proved to be apart')

    def _check_overlap(self, way: Way, found: Overlap, place: arb) -> None:
        """Raise Refused if the overlapping benches exist when the first bench is at the given position."""
        bench = way.most(place, place)
        if bench is not None and bench + found.benches[1] - found.benches[0] < len(self._dragon.benches):
            raise Refused(f'benches {bench} and {bench + found.benches[1] - found.benches[0]} overlap when the front '
                          f'handle of the former is {float(place):.12g} m along the track')


@dataclass(frozen=True)
class Stuck:
    """Why an interval is not proved clear; ``absent`` means that the reason may concern benches that do not exist."""

    why: str
    absent: bool = False

    def __str__(self) -> str:
        """Return the reason."""
        return self.why


def _middle(low: arb, high: arb, joints: list[float], ends: list[arb]) -> arb:
    """Return where to cut: at one of the limits ``ends`` of ranges, else at a joint of the track, else in the middle.

    Floats on both sides of each joint are given.
    """
    if ends:
        return ends[len(ends) // 2]
    first, last = bisect_right(joints, above(low)), bisect_left(joints, below(high))
    return arb(joints[(first + last) // 2]) if first < last else (HALF * (low + high)).mid()
