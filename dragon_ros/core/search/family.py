"""The time up to which no dragon of a family touches itself; a family is all dragons within given tolerances.

The track is a single spiral. Every bench of a dragon may have its own width, length and hole inset, within tolerances
of the scene's values; the pitch of the track is the same for all benches. Larger rectangles contain smaller ones, so
the search uses the largest width and overhang. A link may have any length from the smallest to the largest. The chain
behind a bench depends only on that bench's position. The search therefore covers the positions of the inner and the
other bench of a pair, their two links, and the pitches (``enclosures.sliding_pair``). The lengths of the links between
the two benches are bounded; for each number of benches in between, the other bench's position therefore lies in a
strip. The search ignores everything outside these strips. The search has two parts: the head with all benches behind
it, and any other bench with all benches behind it (docs/contact.md).

Boxes are cleared, discarded or halved in the order in which the leader could reach them. The leader's travel up to the
first remaining box is therefore proved clear.
"""
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import nextafter, pi, sqrt

import numpy as np

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.checks import number
from dragon_ros.core.enclosures.sliding_pair import (
    AHEAD,
    LINK,
    OTHER,
    SCALE,
    THETA,
    Separations,
    gaps,
    largest_span,
    least_span,
    separations,
    span_bounds,
)
from dragon_ros.core.errors import DragonError, FieldError, InputError, did_you_mean
from dragon_ros.core.numerics.double_double import from_turns
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.search.search_domain import RangeOfTravel
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.core.tracks.spiral import SpiralCurve, arc_between

TOLERANCES = ('dragon.width_m', 'dragon.head_length_m', 'dragon.body_length_m', 'dragon.hole_inset_m', 'track.pitch_m')
_WITHIN = 0.01          # largest leader travel from the end of a proof to a contact, relative to min(1 m, shorter link)
_AT_ONCE, _MOST = 1000, 200_000     # maximum numbers of boxes judged together and in total
_FIRST_RAD = 2.0        # angle by which the inner bench moves about the centre in a first box
_MOST_FIRST = 10_000    # maximum number of first boxes
_DOWN, _UP = 1 - 2.0**-51, 1 + 2.0**-51     # factors that cover the rounding of a sum of two positive numbers
_OUT = 1 + 2.0**-40     # factor that covers the rounding of a dozen sums and products of positive numbers
_BENT = 1.09            # the curvature of any spiral is at most 1.09 / r (``min_pitch``)
_INNER_STEPS = 6        # number of iterations that bound the head's position, given the position of the next bench
_HEAD, _BODY = 0, 1     # kinds of the inner bench of a pair


@dataclass(frozen=True)
class FamilyProof:
    """Proof that no dragon of a family touches itself from the start of the run to ``proved_s``.

    ``why`` states why the proof ends: 'contact' (some dragons may touch from ``limit_s`` on, for example at
    ``benches``), 'run' (the run of the nominal dragon ends), 'bend' (the order of handles is not proved closer to the
    centre) or 'effort' (the limit on the number of boxes is reached). ``nominal`` is the result for the scene itself;
    ``states`` is the number of boxes examined.
    """

    within: tuple[tuple[str, float], ...]
    proved_s: float
    limit_s: float | None
    benches: tuple[int, int] | None
    why: str
    nominal: Contact | NoContact
    states: int


@dataclass(frozen=True)
class Family:
    """The dimensions of a family's dragons as ranges (smallest, largest) in metres; ``scale`` is the range of 1 / b."""

    benches: int
    turns: float
    pitch_m: tuple[float, float]
    head_link_m: tuple[float, float]
    body_link_m: tuple[float, float]
    half_width_m: float
    overhang_m: float

    @cached_property
    def scale(self) -> tuple[float, float]:
        """The smallest and the largest value of 1 / b, in 1/m."""
        least_m, most_m = self.pitch_m
        return 2 * pi / most_m / _OUT, 2 * pi / least_m * _OUT

    @property
    def start_rad(self) -> float:
        """The polar angle at which the head starts at 0 s, rounded up."""
        return from_turns(self.turns).hi * _OUT

    @property
    def within_m(self) -> float:
        """The leader travel (m) just before a contact that a proof may omit."""
        return _WITHIN * min(1.0, self.head_link_m[1], self.body_link_m[1])

    @property
    def innermost_rad(self) -> float:
        """The polar angle beyond which the curvature times the link length is below 2 for every link."""
        return 0.5 * _BENT * self.scale[1] * max(self.head_link_m[1], self.body_link_m[1]) * _OUT

    def gone_m(self, theta: Floats | float, scale: Floats | float) -> Floats:
        """Return the shortest distances the head travels to reach polar angles, for scales of at most ``scale``."""
        start = self.start_rad
        out: Floats = np.maximum(arc_between(start, np.maximum(start - np.asarray(theta), 0.0)) / scale / _OUT - (
            (_OUT - 1) * start**2 / self.scale[0]), 0.0)
        return out

    def inward_rad(self, gone_m: float) -> float:
        """Return a polar angle that no head of the family has passed after travelling a given distance."""
        low_m = self.pitch_m[0]
        return SpiralCurve(low_m, from_turns(self.turns)).inward(gone_m * _OUT).hi / _OUT

    def outward_rad(self, gone_m: float) -> float:
        """Return a polar angle that every head of the family has passed after travelling a given distance."""
        return min(self.start_rad, SpiralCurve(self.pitch_m[1], from_turns(self.turns)).inward(gone_m / _OUT).hi * _OUT)


def first_contact_within(scene: Scene, within: Mapping[str, float],
                         progress: Callable[[int], object] = lambda states: None) -> FamilyProof:
    """Prove that no dragon whose benches and pitch are within tolerances touches itself up to a certain time.

    ``within`` maps names from ``TOLERANCES`` to values in metres; each tolerance applies in both directions.
    ``progress(boxes)`` is called with the number of boxes examined since the last call. Raises FieldError for unknown
    tolerances and for unsupported scenes. Raises DragonError if nothing can be proved; the error names the tolerance to
    blame.
    """
    family = family_of(scene, within)
    nominal = first_contact(scene)
    search, why = _search(scene, family, nominal, progress)
    proved_m = search.frontier_m - (family.within_m if search.limit_m < np.inf or search.gave_up else 0.0)
    if proved_m <= search.begin_m:
        raise DragonError(f'--within: nothing can be proved about this family{_blame(scene, within, nominal)}')
    if search.limit_m < np.inf:
        why = 'contact'
    elif search.gave_up:
        why = 'effort'
    travel = _travel(scene, nominal)
    limit_s = travel.arrival_s(search.limit_m, 1) if why == 'contact' else None
    proved_s = min(_time_to(travel, proved_m), travel.end_s)
    return FamilyProof(tuple(sorted(within.items())), proved_s, limit_s, search.benches, why, nominal, search.states)


def family_of(scene: Scene, within: Mapping[str, float]) -> Family:
    """Return the family of a scene. Raises FieldError for unknown tolerances and unsupported scenes."""
    for key, tolerance in within.items():
        if key not in TOLERANCES:
            raise FieldError(f'--within {key}', tolerance, f'tolerances are supported for {", ".join(TOLERANCES)}',
                             did_you_mean(key, TOLERANCES, 'give one of these'))
        number(f'--within {key}', tolerance, low=0.0)
    dragon, track = _covered(scene)
    pitch = _around('track.pitch_m', track.pitch_m, within)
    width = _around('dragon.width_m', dragon.width_m, within)
    inset = _around('dragon.hole_inset_m', dragon.hole_inset_m, within, zero=True)
    head, body = (_link(key, length, within, inset) for key, length in (
        ('dragon.head_length_m', dragon.head_length_m), ('dragon.body_length_m', dragon.body_length_m)))
    return Family(dragon.benches, track.start_turns, pitch, head, body, 0.5 * width[1] * _OUT, inset[1])


def _covered(scene: Scene) -> tuple[Dragon, Spiral]:
    """Return the dragon and the track of a scene. Raises FieldError if families of this scene are not supported."""
    dragon, track, law = scene.dragon, scene.track, scene.head
    if scene.venue is not None:
        raise FieldError('venue', scene.venue, 'family searches cover only contacts between benches',
                         'omit the venue (--set venue=null) to search for these contacts only')
    if not isinstance(dragon, Dragon):
        raise FieldError('dragon.groups', f'{dragon.benches} mixed benches', 'families require equal '
                         'benches behind the head', 'make the benches equal, and give a tolerance for each dimension '
                         'that differs')
    if dragon.benches < 3:
        raise FieldError('dragon.benches', dragon.benches, 'only benches that are not neighbours can touch',
                         'give at least 3')
    if not isinstance(track, Spiral):
        raise FieldError('track.kind', type(track).__name__.lower(), 'families are supported only on a single spiral',
                         'use track.kind: spiral')
    speeds = [law.speed_m_s] if isinstance(law, Head) else [v for _, v in law.knots] if isinstance(law, Profile) else []
    if not speeds or min(speeds) < 0 or law.lead != 'head':
        raise FieldError('head', type(law).__name__.lower(), 'families are supported only if the head leads, '
                         'with a speed law that never moves it back', 'use a head law with speeds of at least 0')
    return dragon, track


def _around(key: str, value: float, within: Mapping[str, float], zero: bool = False) -> tuple[float, float]:
    """Return a value's interval. Raises FieldError if it contains 0 or, with ``zero``, a negative number."""
    tolerance = within.get(key, 0.0)
    if tolerance and (tolerance > value if zero else tolerance >= value):
        raise FieldError(f'--within {key}', tolerance, f'the value itself is {value:g} m', 'give a smaller tolerance')
    return (value - tolerance) / _OUT, (value + tolerance) * _OUT


def _link(key: str, length_m: float, within: Mapping[str, float], inset: tuple[float, float]) -> tuple[float, float]:
    """Return the interval of a link's length."""
    low, high = _around(key, length_m, within)
    link = (low - 2 * inset[1]) / _OUT, (high - 2 * inset[0]) * _OUT
    if link[0] <= 0:
        raise FieldError(key, length_m, 'within the tolerances, a link may have zero length',
                         'give smaller tolerances')
    return link


def _travel(scene: Scene, nominal: Contact | NoContact) -> RangeOfTravel:
    """Return the range of travel up to the nominal contact, or to the end of the run."""
    end_s = nominal.t_s if isinstance(nominal, Contact) else nominal.end.t_s
    return RangeOfTravel(scene.head, scene.run.start_s, end_s)


def _time_to(travel: RangeOfTravel, gone_m: float) -> float:
    """Return a time at which the leader has travelled at most a given distance."""
    t_s = travel.arrival_s(gone_m, 1)
    while travel.gone_m(t_s) > gone_m:
        t_s = nextafter(t_s, -np.inf)
    return t_s


def _search(scene: Scene, family: Family, nominal: Contact | NoContact,
            progress: Callable[[int], object]) -> tuple['_FamilySearch', str]:
    """Return the finished search, and the reason why it ended."""
    travel = _travel(scene, nominal)
    begin_m, end_m, why = travel.gone_m(travel.start_s), travel.gone_m(travel.end_s), 'run'
    bend_m = float(family.gone_m(family.innermost_rad, family.scale[1]))
    if bend_m < end_m:
        end_m, why = bend_m, 'bend'
    if begin_m >= end_m:
        raise InputError('--within: there is nothing to prove, because the head rests, or starts where links may '
                         'lock or benches touch; start earlier or further out')
    search = _FamilySearch(family, begin_m, end_m, progress)
    search.run()
    return search, why


def _blame(scene: Scene, within: Mapping[str, float], nominal: Contact | NoContact) -> str:
    """Return a sentence that names the tolerance to blame: the one whose removal extends the proof the most."""
    best: tuple[float, str] | None = None
    for key in within:
        family = family_of(scene, {**within, key: 0.0})
        search = _search(scene, family, nominal, lambda states: None)[0]
        proved_m = search.frontier_m - family.within_m
        if proved_m > search.begin_m and (best is None or proved_m > best[0]):
            best = proved_m, key
    if best is None:
        return '; each tolerance alone is too wide, or some benches always touch: give smaller tolerances'
    until_s = _time_to(_travel(scene, nominal), best[0])
    return (f'; the tolerance of {best[1]}, {within[best[1]]:g} m, is too wide: without it the proof would hold up to '
            f'{until_s:.6g} s')


@dataclass(frozen=True)
class _PairBoxes:
    """Boxes (5, n) in the variables of ``sliding_pair``, the kinds (n,) of their inner benches, and ``gone_m`` (n,).

    ``gone_m`` holds, for each box, the smallest distance that the leader travels before a pair in the box can occur.
    """

    low: Floats
    high: Floats
    inner: Ints
    gone_m: Floats

    def some(self, which: Array | slice) -> '_PairBoxes':
        """Return a subset of the boxes."""
        return _PairBoxes(self.low[:, which], self.high[:, which], self.inner[which], self.gone_m[which])

    def __add__(self, other: '_PairBoxes') -> '_PairBoxes':
        """Return the union of two sets of boxes."""
        low, high = (np.concatenate(ends, axis=1) for ends in ((self.low, other.low), (self.high, other.high)))
        return _PairBoxes(low, high, np.concatenate((self.inner, other.inner)),
                          np.concatenate((self.gone_m, other.gone_m)))


class _FamilySearch:
    """Branch and bound over boxes, in the order in which the leader can reach them.

    ``frontier_m`` is the distance that the leader can travel before it reaches a box that has not been cleared. At the
    distance ``limit_m`` the leader reaches a position at which the two ``benches`` overlap.
    """

    def __init__(self, family: Family, begin_m: float, end_m: float, progress: Callable[[int], object]) -> None:
        self.family, self.begin_m, self._end_m, self._tell = family, begin_m, end_m, progress
        self.limit_m, self.frontier_m, self.states, self.gave_up = np.inf, end_m, 0, False
        self.benches: tuple[int, int] | None = None

    def run(self) -> None:
        """Clear boxes until the first remaining box is near an overlapping pair."""
        boxes = self._first()
        while boxes.gone_m.size:
            boxes = boxes.some(np.argsort(boxes.gone_m, kind='stable'))
            self.frontier_m = float(boxes.gone_m[0])
            if self.limit_m - self.frontier_m <= self.family.within_m:
                return
            if self.states >= _MOST:
                self.gave_up = True
                return
            halves = self._halves(boxes.some(slice(_AT_ONCE)))
            boxes = boxes.some(slice(_AT_ONCE, None)) + halves
            boxes = boxes.some(boxes.gone_m < min(self.limit_m, self._end_m))
        self.frontier_m = min(self.limit_m, self._end_m)

    def _first(self) -> _PairBoxes:
        """Return boxes that together contain all pairs up to the end, split along the inner bench's position."""
        family, scale = self.family, self.family.scale
        inner = max(family.inward_rad(self._end_m), family.innermost_rad)
        outer = family.outward_rad(self.begin_m)
        chord = np.array([scale[0] * family.head_link_m[0] * _DOWN])
        rear = (inner + float(least_span(np.array([inner]), chord)[0])) * _DOWN
        tail = sqrt(outer**2 + pi * scale[1] * (family.head_link_m[1] + family.benches * family.body_link_m[1])) * _OUT
        if tail - inner > _FIRST_RAD * _MOST_FIRST:
            raise FieldError('track.start_turns', family.turns, f'the tail lies {tail / (2 * pi):.6g} turns from '
                             f'the centre, but families are searched only up to '
                             f'{int(_FIRST_RAD * _MOST_FIRST / (2 * pi))} turns',
                             'start closer to the centre, or give fewer benches')
        parts = [self._row(_HEAD, inner, outer, family.head_link_m), self._row(_BODY, rear, tail, family.body_link_m)]
        return parts[0] + parts[1]

    def _row(self, inner: int, first: float, last: float, link_m: tuple[float, float]) -> _PairBoxes:
        ends = np.linspace(first, last, 2 + int((last - first) / _FIRST_RAD))
        scale, other_m = self.family.scale, self.family.body_link_m
        low = np.array(np.broadcast_arrays(ends[:-1], 0.0, scale[0], link_m[0], other_m[0]))
        high = np.array(np.broadcast_arrays(ends[1:], np.inf, scale[1], link_m[1], other_m[1]))
        return self._reached(low, high, np.full(ends.size - 1, inner))

    def _reached(self, low: Floats, high: Floats, inner: Ints) -> _PairBoxes:
        """Return boxes, each with the smallest distance that the leader has travelled when an inner bench reaches it.

        Among the body benches, bench 1 reaches each box first. The head is closer to the centre by at least the span of
        the shortest link, which is smallest when the head is furthest out; each iteration moves the bound closer to the
        centre.
        """
        body = inner == _BODY
        rear, chord = high[THETA, body], low[SCALE, body] * self.family.head_link_m[0] / _OUT
        head = rear
        for _ in range(_INNER_STEPS if rear.size else 0):
            head = (rear - least_span(head, chord)) * _OUT
        theta = high[THETA].copy()
        theta[body] = head
        return _PairBoxes(low, high, inner, self.family.gone_m(theta, high[SCALE]))

    def _halves(self, boxes: _PairBoxes) -> _PairBoxes:
        """Return the halves of the boxes that are not clear."""
        self.states += boxes.gone_m.size
        self._tell(boxes.gone_m.size)
        near = self._near(boxes)
        if not near.gone_m.size:
            return near
        found = separations(near.low, near.high, self.family.half_width_m, self.family.overhang_m)
        unclear = ~(found.low > 0)
        near = near.some(unclear)
        if not near.gone_m.size:
            return near
        kept = Separations(found.low[unclear], found.middle[unclear], found.slope[:, unclear], found.spread[:, unclear])
        self._note(near, kept)
        wide = near.high - near.low     # selects the axis to cut if a box is too wide for derivatives
        return self._cut(near, np.where(np.all(np.isfinite(kept.spread), axis=0), np.argmax(kept.spread, axis=0),
                                        np.argmax(wide[[THETA, AHEAD]], axis=0)))

    def _cut(self, boxes: _PairBoxes, rows: Ints) -> _PairBoxes:
        each = np.arange(rows.size)
        low, high = boxes.low.copy(), boxes.high.copy()
        low[rows, each] = high[rows, each] = 0.5 * (boxes.low[rows, each] + boxes.high[rows, each])
        lower = self._reached(boxes.low, high, boxes.inner)
        return lower + self._reached(low, boxes.high, boxes.inner)

    def _near(self, boxes: _PairBoxes) -> _PairBoxes:
        """Restrict boxes to the positions of the other bench that are possible and close enough for a contact.

        A link with chord c whose front handle is at theta comes no closer to the centre than sqrt(theta^2 - c^2 / 4)
        (docs/contact.md). The link of the inner bench lies within the radius of its rear handle, and the rectangles of
        both benches overhang their links.
        """
        family, low, high = self.family, boxes.low, boxes.high
        most = high[SCALE] * _OUT
        rear = high[THETA] + largest_span(low[THETA], most * high[LINK])
        over = most * np.hypot(family.overhang_m, family.half_width_m)
        far = np.sqrt((rear + 2 * over) ** 2 + (0.5 * most * high[OTHER]) ** 2) * _OUT - low[THETA]
        first, last, _ = self._strips(low, np.vstack((high[:1], np.minimum(high[AHEAD], far)[None], high[2:])),
                                      boxes.inner)
        which = first <= last
        low, high = low.copy(), high.copy()
        low[AHEAD], high[AHEAD] = first, last
        return _PairBoxes(low, high, boxes.inner, boxes.gone_m).some(which)

    def _strips(self, low: Floats, high: Floats, inner: Ints) -> tuple[Floats, Floats, Ints]:
        """Return the range of the angle AHEAD in each box, and the number of the nearest bench within this range.

        By lemma 1 of docs/contact.md, the angle from a handle to the handle a given number of links behind decreases as
        theta increases, and increases with the length of each link. If a range is empty, its first end is larger than
        its last end.
        """
        family, out = self.family, _OUT
        last_bench = np.where(inner == _HEAD, family.benches - 1, family.benches - 2)
        near, far = _behind(high[THETA], low[SCALE] * low[LINK] / out, low[THETA], high[SCALE] * high[LINK] * out)
        shortest, longest = low[SCALE] * family.body_link_m[0] / out, high[SCALE] * family.body_link_m[1] * out
        first, last = np.full(inner.shape, np.inf), np.full(inner.shape, -np.inf)
        nearest = np.zeros(inner.shape, dtype=np.int64)
        for bench in range(2, int(np.max(last_bench)) + 1):
            near, far = _behind(near, shortest, far, longest)
            least, most = (near - high[THETA]) / out, (far - low[THETA]) * out
            if np.all(least > high[AHEAD]):
                break
            met = (least <= high[AHEAD]) & (most >= low[AHEAD]) & (bench <= last_bench)
            first = np.where(met, np.minimum(first, np.maximum(least, low[AHEAD])), first)
            last = np.where(met, np.maximum(last, np.minimum(most, high[AHEAD])), last)
            nearest = np.where(met & (nearest == 0), bench, nearest)
        return first, last, nearest

    def _note(self, boxes: _PairBoxes, found: Separations) -> None:
        """Record the first leader position at which a pair overlaps; each box is tested at its worst corner.

        This position only limits how far a proof can reach; no proof depends on it, so ordinary float arithmetic
        suffices.
        """
        worst = np.where(found.slope > 0, boxes.low, boxes.high)
        places = 0.5 * (boxes.low + boxes.high)
        places[SCALE:] = worst[SCALE:]
        first, last, nearest = self._strips(places, places, boxes.inner)
        here = (first <= last) & (self.family.gone_m(places[THETA], places[SCALE]) < self.limit_m)
        if not np.any(here):
            return
        some = places[:, here]
        overlap = gaps(some, self.family.half_width_m, self.family.overhang_m) < 0
        met = self._reached(some[:, overlap], some[:, overlap], boxes.inner[here][overlap])
        if met.gone_m.size and (gone_m := float(np.min(met.gone_m))) < self.limit_m:
            n = int(np.argmin(met.gone_m))
            self.limit_m, one = gone_m, int(met.inner[n])
            self.benches = one, one + int(nearest[here][overlap][n])


def _behind(near: Floats, shortest: Floats, far: Floats, longest: Floats) -> tuple[Floats, Floats]:
    """Return bounds on the polar angle of the next handle behind, given bounds on a handle and on its link's chord."""
    least, most = span_bounds(near, shortest, far, longest)
    return (near + least) * _DOWN, (far + most) * _UP
