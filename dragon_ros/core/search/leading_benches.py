"""Pairs of benches on a first segment that is a spiral; benches with the same remaining links are cleared together.

If the first segment winds in from afar, the chain behind a bench on this segment depends only on the position of that
bench and on the links behind it. Benches are therefore grouped into classes with identical remaining link sequences.
The first bench of a class is its lead, and the class is cleared as a whole over the part of the track that its front
handles pass through. If that fails, each bench is cleared over its own part of the track, which no other bench of its
class has passed before. Mixed benches form many classes, and all classes behind the head are sampled and bounded
together.

Far enough from the centre, a bound on the layers of the spiral (``layers``) clears the positions of any bench without
samples. Only the positions closer to the centre are searched.
"""
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dragon_ros.core.chain.dragon import is_even
from dragon_ros.core.chain.lock import turning_places
from dragon_ros.core.enclosures.layers import Layers
from dragon_ros.core.enclosures.on_spiral import BenchSampler, BenchSamples, bounds, comes_in, joined
from dragon_ros.core.numerics.double_double import DoubleDouble
from dragon_ros.core.numerics.types import Floats, Ints, distinct
from dragon_ros.core.search.certificate import Interval
from dragon_ros.core.search.driver import Cleared, Judgement, clear, parts_for
from dragon_ros.core.search.search_domain import Bracket, SearchDomain
from dragon_ros.core.tracks.composite import Place

# The spacing of the first samples, as a multiple of the longest bench and in rad; the larger spacing is used. The
# interaction of adjacent layers depends on the angle: far from a contact, an interval of 2 rad is cleared without cuts.
_FIRST, _FIRST_RAD = 1.173, 2.0
_FINEST = 1e-3, 1e-8    # shortest intervals near a contact and near a grazing, relative to min(1 m, longest bench)
_MOST_PLACES = 50_000   # maximum number of first samples per window, to save memory
_MOST_RAD = 2e6         # maximum length of a domain; one of this length begins with a million samples
# To save memory, ``_TOGETHER`` limits the number of handles at the first samples of windows that are cleared together.
# At most ``_USUAL`` benches are counted behind each lead, because benches further behind rarely matter.
_TOGETHER, _USUAL = 2**20, 256
_POINT = 1e-6           # fraction of the longest link; both handles of a shorter link may round to the same position
_IN_CACHE = 2**14       # number of pairs that are bounded together
_CLOSER = 20            # number of halvings of a domain, down to a millionth, to find how far the proof can reach
_Row = tuple[float, float, float]       # start, stop and bound of a cleared interval


class Touching(Exception):
    """Benches touch at a sample; raised in searches that only decide whether there is a contact."""


class _SpiralIntervals:
    """The space of leading benches for ``clear``; each window has its own positions and its own number of followers."""

    def __init__(self, sampler: BenchSampler, windows: 'list[_ClassWindow]', tolerance_m: float) -> None:
        self.sampler, self.tolerance_m = sampler, tolerance_m
        self._behind = np.array([window.behind for window in windows])
        self._lead = np.array([sampler.leads.index(window.of.lead) for window in windows])
        self._window: Ints = np.empty(0, dtype=np.int64)
        self._until_touch = any(window.of.until_touch for window in windows)

    def sample(self, places: Floats, window: Ints) -> BenchSamples:
        """Return the samples at the given positions."""
        return self.sampler.sample(places, self._lead[window])

    def joined(self, parts: list[BenchSamples]) -> BenchSamples:
        """Concatenate samples."""
        return joined(parts)

    def begin(self, _: BenchSamples, __: Ints, window: Ints) -> None:
        """Store the windows of the roots."""
        self._window = window

    def judge(self, a: BenchSamples, b: BenchSamples, group: Ints) -> Judgement:
        """Judge intervals by their second-order bounds, and choose their numbers of parts by their room."""
        behind = self._behind[self._window[group]]
        there = np.arange(2, a.apart.shape[1] + 2) <= behind[:, None]
        touching = np.stack([np.any((each.apart <= 0) & there, axis=1) for each in (a, b)])
        if self._until_touch and np.any(touching):
            raise Touching
        rows = 1 + _IN_CACHE // a.delta.shape[1]
        parts = [slice(at, at + rows) for at in range(0, behind.size, rows)]
        found = [bounds(a.rows(part), b.rows(part), self.sampler.sizes, behind[part]) for part in parts]
        bound_m, room = (np.concatenate(each) for each in zip(*found, strict=True))
        return Judgement(bound_m, touching, parts_for(room), group)

    def lengths_m(self, start: Floats, stop: Floats) -> Floats:
        """Return upper bounds on the lengths of intervals."""
        out: Floats = self.sampler.b_m * np.abs(start - stop) * (1 + np.maximum(start, stop))
        return out


@dataclass(frozen=True)
class _ClassWindow:
    """Monotone positions that the front handle of a bench of class ``of`` passes, with ``behind`` followers."""

    of: 'LeadingBenches'
    bench: int
    places: Floats
    behind: int

    @property
    def goes_in(self) -> bool:
        """Whether the front handle moves inwards."""
        return bool(self.places[0] > self.places[-1])

    def outermost(self, bound_m: Floats, tolerance_m: float) -> list[_Row]:
        """Return the intervals between adjacent positions, from the outer end on, whose bounds exceed a tolerance."""
        clear = bound_m > tolerance_m
        kept = np.logical_and.accumulate(clear if self.goes_in else clear[::-1])[::1 if self.goes_in else -1]
        rows = zip(self.places[:-1].tolist(), self.places[1:].tolist(), bound_m.tolist(), kept.tolist(), strict=True)
        return [(start, stop, bound) for start, stop, bound, keep in rows if keep]

    def after(self, rows: list[_Row]) -> '_ClassWindow':
        """Return the window without its outermost intervals, and with the positions at which handles turn back."""
        places = self.places[len(rows):] if self.goes_in else self.places[:self.places.size - len(rows)]
        return replace(self, places=self.of.with_turns(places) if places.size > 1 else places)


@dataclass(frozen=True)
class _ClearedInterval:
    """A cleared interval between two positions."""

    start_rad: float
    stop_rad: float
    bound_m: float
    behind: int

    def between(self, inner_rad: float, outer_rad: float) -> '_ClearedInterval':
        """Return the part of the interval between two positions; it has no length if the interval is beyond them."""
        if inner_rad <= min(self.start_rad, self.stop_rad) and max(self.start_rad, self.stop_rad) <= outer_rad:
            return self
        return replace(self, start_rad=min(max(self.start_rad, inner_rad), outer_rad),
                       stop_rad=min(max(self.stop_rad, inner_rad), outer_rad))


class LeadingBenches:
    """A class of benches over a domain, with ``rows``, the cleared intervals of its pairs with benches behind it."""

    def __init__(self, domain: SearchDomain, benches: tuple[int, ...], until_touch: bool = False) -> None:
        """Represent the class of ``benches``, which are in order from the head; the first bench is the ``lead``.

        With ``until_touch``, clearing raises Touching at the first sample in which benches touch.
        """
        self._domain, self.benches, self.lead, self.until_touch = domain, benches, benches[0], until_touch
        self._behind = domain.dragon.benches - 1 - self.lead
        assert domain.track.from_afar
        self._spiral = domain.track.from_afar.curve
        longest_m = float(np.max(domain.dragon.bench_lengths_m))
        self._first_m, self.finest_m = _FIRST * longest_m, tuple(one * min(1.0, longest_m) for one in _FINEST)
        self.rows: list[_ClearedInterval] = []
        self._hit: Bracket | None = None

    @property
    def tolerance_m(self) -> float:
        """The error that a bound must exceed: the position errors of two handles."""
        return 2 * self._domain.error_m

    @property
    def _single(self) -> bool:
        """Whether the class consists of the head alone, whose positions are in the order of the leader's motion."""
        return self.benches == (0,)

    def clear(self, stop_m: float) -> Bracket | None:
        """Clear the pairs of the class up to a leader position; return the first bracket that is not clear."""
        self.forget()
        for window in self.whole(stop_m):
            (cleared,) = _cleared(self._domain, [window])
            if cleared.hit:
                self.clear_apart(stop_m, cleared)
        return self._hit

    def whole(self, stop_m: float) -> Iterator['_ClassWindow']:
        """Yield the window of all positions that the class passes up to a leader position, if there are any."""
        outer, inner = self._track(self._domain.phases(stop_m)[1])
        if self._single and self._domain.angles(self._domain.start_m)[0] < self._domain.angles(stop_m)[0]:
            outer, inner = inner, outer
        yield from self._window(self.lead, outer, inner, self._behind)

    def clear_apart(self, stop_m: float, whole: Cleared) -> Bracket | None:
        """Clear an uncleared window bench by bench; return the first bracket that is not clear."""
        if self._single:
            self._hit = self._bracket(self.lead, whole.hit, (self._domain.start_m, stop_m)) if whole.hit else None
            return self._hit
        phases, ends = self._domain.phases(stop_m)
        self.rows = []
        for n in range(len(phases) - 1):
            self._hit = self._hit or self._clear_phase((phases[n], phases[n + 1]), ends[n], ends[n + 1])
        return self._hit

    def forget(self) -> None:
        """Discard all results."""
        self.rows, self._hit = [], None

    def keep(self, cleared: Cleared, behind: int) -> None:
        """Add cleared intervals, with the number of followers for which they were cleared."""
        self.rows += [_ClearedInterval(*row, behind) for row in cleared.rows]

    def prove(self, stop_m: float) -> Bracket | None:
        """Clear up to an earlier position than before; return the first bracket that is not clear."""
        if self._hit is None:
            self._trim(stop_m)
        elif self._single:
            self._go_on(stop_m)
        else:
            self.clear(stop_m)
        return self._hit

    def intervals(self) -> Iterator[Interval]:
        """Yield the cleared intervals for the certificate."""
        return _intervals(self._domain, [self])

    def _go_on(self, stop_m: float) -> None:
        """Clear the rest of the head's track up to a position, or drop the cleared intervals beyond this position."""
        start, stop = (float(self._domain.angles(place)[0]) for place in (self._domain.start_m, stop_m))
        sign = 1.0 if stop > start else -1.0
        self.rows = [row for row in self.rows if sign * row.stop_rad <= sign * stop]
        last, self._hit = self.rows[-1].stop_rad if self.rows else start, None
        for rest in _cleared(self._domain, [*self._window(0, last, stop, self._behind)]):
            self._hit = self._bracket(0, rest.hit, (self._domain.start_m, stop_m)) if rest.hit else None

    def _trim(self, stop_m: float) -> None:
        """Drop the cleared parts that the class has not yet reached when the leader is at a given position."""
        outer, inner = self._track(self._domain.phases(stop_m)[1])
        clipped = (row.between(inner, outer) for row in self.rows)
        self.rows = [row for row in clipped if row.start_rad != row.stop_rad]

    def all_come_in(self, stop_m: float) -> bool:
        """Return whether, up to a leader position, all links from the third on follow their front handles inwards."""
        links = self._domain.dragon.link_lengths_m[2:]
        for theta in self._domain.phases(stop_m)[1]:
            front, span = theta[2:], np.diff(theta[2:])
            if not np.all((links == 0) | (span <= np.pi) & (comes_in(front, span) > 0)):
                return False
        return True

    def _track(self, ends: list[Floats]) -> tuple[float, float]:
        """Return the outermost and innermost positions of the class, given all polar angles at the ends of phases."""
        return (max(float(theta[self.benches[-1]]) for theta in ends),
                min(float(theta[self.lead]) for theta in ends))

    def _clear_phase(self, phase: tuple[float, float], here: Floats, there: Floats) -> Bracket | None:
        """Clear the part of the track that each bench passes through in one phase of the leader's motion."""
        windows = [*self._parts(here, there)]
        hits = [self._bracket(window.bench, cleared.hit, phase)
                for window, cleared in zip(windows, _cleared(self._domain, windows), strict=True) if cleared.hit]
        return min(hits, key=lambda hit: self._domain.sense * hit.other_m, default=None)

    def _parts(self, here: Floats, there: Floats) -> Iterator[_ClassWindow]:
        """Yield each bench's part of the track, without the parts that another bench of its class passes before it."""
        last = self._domain.dragon.benches - 1
        reach = self.sampler(np.array(self._track([here, there]))).follow
        for before, bench, after in zip([0, *self.benches], self.benches, [*self.benches[1:], last], strict=False):
            start, stop = float(here[bench]), float(there[bench])
            if stop < start and before and there[before] <= here[before]:
                stop = max(stop, float(here[before]))
            elif stop > start and last - after >= reach:
                stop = min(stop, float(here[after]))
            yield from self._window(bench, start, stop, last - bench if last - bench < reach else self._behind)

    def _bracket(self, bench: int, hit: tuple[float, float, float], within: tuple[float, float]) -> Bracket:
        """Return the leader positions at which a bench's front handle is at the two ends of a hit."""
        segment, origin_m = self._domain.track.segments[0], self._domain.track.origins_m[0]
        one, two = (self._domain.gone_at(bench, float(origin_m + segment.metres(place)), within) for place in hit[:2])
        return Bracket(one, two, hit[2])

    def _window(self, bench: int, start: float, stop: float, behind: int) -> Iterator[_ClassWindow]:
        """Yield the window between two positions, unless it is empty."""
        if start == stop or behind < 2:
            return
        step = max(self._first_m / (self._spiral.b_m * (1 + max(start, stop))), _FIRST_RAD)
        count = 2 + int(abs(start - stop) / step)
        places: Floats = np.linspace(start, stop, min(count, _MOST_PLACES), dtype=np.float64)
        places = distinct(places)
        yield _ClassWindow(self, bench, places if stop > start else places[::-1], behind)

    def with_turns(self, places: Floats) -> Floats:
        """Return monotone positions, including those between them at which the second or third handle turns back."""
        if not self._domain.track.may_lock:
            return places
        low, high = sorted((float(places[0]), float(places[-1])))
        chords = (self._domain.dragon.link_lengths_m[self.lead:self.lead + 2] / self._spiral.b_m).tolist()
        grown = distinct(np.concatenate((places, turning_places(chords, low, high))))
        return grown if places[0] == low else grown[::-1]

    def sampler(self, ends: Floats) -> BenchSampler:
        """Return the sampler of the class between two positions, with only the followers that can matter there."""
        return _sampler(self._domain, (self.lead,)).reaching(ends)


class BodyBenches:
    """All classes of benches behind the head, whose windows are cleared together."""

    def __init__(self, domain: SearchDomain, classes: list[LeadingBenches]) -> None:
        """Store the classes."""
        self._domain, self._classes = domain, classes
        self.tolerance_m = 2 * domain.error_m

    def clear(self, stop_m: float) -> Bracket | None:
        """Clear the pairs of all classes up to a leader position; return the first bracket that is not clear."""
        hit: Bracket | None = None
        for each in self._classes:
            each.forget()
        for windows in self._together([window for each in self._classes for window in each.whole(stop_m)]):
            for window, cleared in zip(windows, _cleared(self._domain, windows), strict=True):
                if cleared.hit:
                    hit = window.of.clear_apart(hit.other_m if hit else stop_m, cleared) or hit
        return hit

    def prove(self, stop_m: float) -> Bracket | None:
        """Clear up to an earlier position than before; return the first bracket that is not clear."""
        hits = [hit for each in self._classes if (hit := each.prove(stop_m))]
        return min(hits, key=lambda hit: self._domain.sense * hit.other_m, default=None)

    def intervals(self) -> Iterator[Interval]:
        """Yield the cleared intervals for the certificate."""
        return _intervals(self._domain, self._classes)

    def _together(self, windows: list[_ClassWindow]) -> Iterator[list[_ClassWindow]]:
        """Yield groups of windows, each as large as memory allows, or single windows if links have zero length."""
        links_m = self._domain.dragon.link_lengths_m
        size, most, one_by_one = 0, list[_ClassWindow](), bool(np.min(links_m) <= _POINT * np.max(links_m))
        for window in windows:
            more = window.places.size * min(window.behind, _USUAL)
            if most and (one_by_one or size + more > _TOGETHER):
                yield most
                size, most = 0, []
            size, most = size + more, [*most, window]
        if most:
            yield most


def _intervals(domain: SearchDomain, classes: list[LeadingBenches]) -> Iterator[Interval]:
    """Yield the cleared intervals of classes; all positions are converted to distances together."""
    segment, origin_m = domain.track.segments[0], domain.track.origins_m[0]
    rows = [(each.lead, row) for each in classes for row in each.rows]
    places = np.array([(row.start_rad, row.stop_rad) for _, row in rows]).reshape(-1, 2)
    for (lead, row), (start_m, stop_m) in zip(rows, (origin_m + segment.metres(places)).tolist(), strict=True):
        yield Interval(lead, start_m, stop_m, row.behind, row.bound_m)


def _sampler(domain: SearchDomain, leads: tuple[int, ...]) -> BenchSampler:
    """Return the sampler of leading benches with all followers."""
    return BenchSampler(domain.track, domain.dragon, leads, domain.dragon.benches - min(leads),
                        domain.count, domain.error_m)


def _cleared(domain: SearchDomain, windows: list[_ClassWindow]) -> list[Cleared]:
    """Clear windows, and pass the cleared intervals to their classes.

    The outer part of a window, in which layers are provably apart, is cleared without samples.
    """
    apart = _apart(domain, windows)
    left = [window.after(rows) for window, rows in zip(windows, apart, strict=True)]
    searched = iter(_searched(domain, [window for window in left if window.places.size > 1]))
    out = []
    for window, rows, rest in zip(windows, apart, left, strict=True):
        more = next(searched) if rest.places.size > 1 else Cleared([], None, False)
        rows = [*rows, *more.rows] if window.goes_in else [*more.rows, *([] if more.hit else rows)]
        out.append(replace(more, rows=rows))
        window.of.keep(out[-1], window.behind)
    return out


def _apart(domain: SearchDomain, windows: list[_ClassWindow]) -> list[list[_Row]]:
    """Return the intervals of windows, from the outer end on, in which benches in different layers cannot touch."""
    if not windows:
        return []
    inner = [np.minimum(window.places[:-1], window.places[1:]) for window in windows]
    lead = np.repeat([window.of.lead for window in windows], [each.size for each in inner])
    assert domain.track.from_afar
    gaps_m = Layers(domain.track.from_afar.curve.b_m, domain.dragon).gaps_m(np.concatenate(inner), lead)
    parts = np.split(gaps_m, np.cumsum([each.size for each in inner])[:-1])
    return [window.outermost(part, 2 * domain.error_m) for window, part in zip(windows, parts, strict=True)]


def _searched(domain: SearchDomain, windows: list[_ClassWindow]) -> list[Cleared]:
    """Clear windows by sampling."""
    if not windows:
        return []
    leads = tuple(dict.fromkeys(window.of.lead for window in windows))
    ends = np.array([(lead, places[0], places[-1]) for window in windows
                     for lead, places in [(leads.index(window.of.lead), window.places)]])
    sampler = _sampler(domain, leads).reaching(ends[:, 1:].reshape(-1), np.repeat(ends[:, 0].astype(np.int64), 2))
    space = _SpiralIntervals(sampler, windows, 2 * domain.error_m)
    return clear(space, [window.places for window in windows], windows[0].of.finest_m)


def classes_of(domain: SearchDomain) -> list[LeadingBenches]:
    """Return the classes of benches with followers: the head, and body benches grouped by remaining link sequence."""
    return [LeadingBenches(domain, benches) for benches in domain.dragon.classes]


def searchable_m(domain: SearchDomain) -> float:
    """Return the leader position up to which the number of first samples on the spiral is acceptable."""
    here, there = (domain.leader.place((gone_m, 0.0)) for gone_m in (domain.start_m, domain.stop_m))
    gone_rad = there.u.hi - here.u.hi
    if here.segment or there.segment or abs(gone_rad) <= _MOST_RAD:
        return domain.stop_m
    limit = here.u.hi + (_MOST_RAD if gone_rad > 0 else -_MOST_RAD)
    return domain.leader.gone_m(Place(0, DoubleDouble(limit, 0.0)))


def provable_m(domain: SearchDomain) -> float:
    """Return the leader position up to which every handle behind the third moves in one direction.

    If links cannot lock or are equal, no such handle turns back, and the result is the end of the domain. Otherwise it
    suffices that each link spans at most half a turn, and that its rear handle moves inwards when its front handle is
    nearest to the centre (docs/contact.md, lemmas 1 and 2).
    """
    if not domain.track.may_lock or is_even(domain.dragon.link_lengths_m):
        return domain.stop_m
    head = LeadingBenches(domain, (0,))
    if head.all_come_in(domain.stop_m):
        return domain.stop_m
    good, bad = domain.start_m, domain.stop_m
    for _ in range(_CLOSER if head.all_come_in(good) else 0):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if head.all_come_in(middle) else (good, middle)
    return good
