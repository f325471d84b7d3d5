"""The first contact of a run, located exactly, with a certificate that no contact occurs before it.

The leader's range of travel is searched in each direction. If the track's first segment is a spiral,
``leading_benches`` clears the pairs whose inner bench lies on it; all benches with identical remaining link sequences
are cleared together along the track. ``WholeChain`` clears all other pairs, state by state. ``obstacle_contact`` clears
the obstacles of a venue; all benches of one length are cleared together along the track. In the first interval that
cannot be cleared, the search solves for the zero of the gap, and everything is cleared up to this position.
"""
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import floor, inf, ulp
from typing import Protocol

import numpy as np

from dragon_ros.core.errors import FieldError
from dragon_ros.core.geometry.contacts import ObstacleTouch
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import Witness, witness
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Certificate, Contact, Interval, NoContact
from dragon_ros.core.search.conservative_advancement import WholeChain
from dragon_ros.core.search.leading_benches import (
    BodyBenches,
    LeadingBenches,
    Touching,
    classes_of,
    provable_m,
    searchable_m,
)
from dragon_ros.core.search.search_domain import Bracket, RangeOfTravel, SearchDomain
from dragon_ros.core.tiers import EXACT

_BEFORE_M = 1e-9        # clearing stops this far before a contact, relative to min(1 m, longest bench)
_TOLD_APART = 4         # where clearing stops, gaps are at least this multiple of the error that a bound must exceed
_AHEAD_M = 1e-8         # first step of the search for a contact just beyond a position that cannot be cleared
_AHEAD = 24             # number of doublings of this step, up to 8 cm
# An approach to a contact is separate if the leader travels more than this multiple of the distance in which the gap
# would close at its final rate.
_STEADY = 4
_ASIDE = 1e3            # the checker's step on each side of a contact, relative to ``_BEFORE_M``, for the closing rate
_LAST_PLACES = 4        # rounding error of a contact's time, in ulps; it determines the error of the position
_WIDEST_M = 1e-6        # largest slack, relative to min(1 m, longest bench)
_GRAZING_M = 1e-7       # largest gap of grazing benches, relative to min(1 m, longest bench)
_HARDLY = 0.99          # proved fraction of the clear distance before a grazing; the rest allows for rounding
_TOO_FAR = 'the leader travels too far for a search'

Pair = tuple[int, int]


class BenchPairs(Protocol):
    """The pairs of a domain that one kind of bound clears."""

    @property
    def tolerance_m(self) -> float:
        """The error that a bound must exceed if the corners of benches have the same errors as their handles."""
        ...

    def clear(self, stop_m: float) -> Bracket | None:
        """Clear up to a leader position; return the first bracket that is not clear."""
        ...

    def prove(self, stop_m: float) -> Bracket | None:
        """Clear up to an earlier position; return the first bracket that is not clear."""
        ...

    def intervals(self) -> Iterator[Interval]:
        """Yield the cleared intervals."""
        ...


def first_contact(scene: Scene, progress: Callable[[int], object] = lambda states: None) -> Contact | NoContact:
    """Return the first contact of the scene's run, at the exact tier, or NoContact if the run ends without a contact.

    ``progress(states)`` is called with the number of states evaluated since the last call. In a venue, touching an
    obstacle also counts as a contact. Raises FieldError, with the latest possible stop, if no contact occurs before the
    position beyond which contacts cannot be ruled out (docs/contact.md, limits of the search). Also raises FieldError
    if the dragon does not start inside its venue and clear of obstacles.
    """
    if scene.venue is not None:
        from dragon_ros.core.search.venue import check_sides
        check_sides(scene)
    travel = RangeOfTravel(scene.head, scene.run.start_s, compile_scene(scene).end.t_s)
    searches = {sense: _ContactSearch(SearchDomain(scene, travel, sense, progress)) for sense in travel.senses or [1]}
    hits = {sense: hit for sense, search in searches.items() if (hit := search.first())}
    if not hits:
        proof = _together(search.certificate() for search in searches.values())
        return NoContact(compile_scene(scene).end, sum(search.states for search in searches.values()), proof)
    sense = min(hits, key=lambda sense: hits[sense].t_s)
    hit, before = hits[sense], travel.until(hits[sense].t_s)
    # The travel in the other direction before this contact is cleared separately.
    rest = [_ContactSearch(SearchDomain(scene, before, other, progress)) for other in before.senses if other != sense]
    proof = _together([hit.certificate, *(search.cleared() for search in rest)])
    return replace(hit, certificate=proof, states=sum(search.states for search in (*searches.values(), *rest)))


def head_passes(scene: Scene, progress: Callable[[int], object] = lambda states: None) -> bool:
    """Return whether the head, winding in on a spiral, provably touches no bench during the scene's run.

    Other benches may touch each other. The search ends at the first sample in which the head touches a bench, so it
    evaluates fewer states than ``first_contact``. It raises the same errors.
    """
    travel = RangeOfTravel(scene.head, scene.run.start_s, compile_scene(scene).end.t_s)
    domain = SearchDomain(scene, travel, 1, progress)
    try:
        return _ContactSearch(domain, [LeadingBenches(domain, (0,), until_touch=True)]).bracket() is None
    except Touching:
        return False


class _ContactSearch:
    """The part of a domain cleared so far, and the first position that is not clear."""

    def __init__(self, domain: SearchDomain, parts: list[BenchPairs] | None = None) -> None:
        self._domain, self._complete = domain, True
        self._parts = _all_parts(domain) if parts is None else parts

    @property
    def states(self) -> int:
        """The number of states evaluated."""
        return self._domain.states

    def first(self) -> Contact | None:
        """Return the first contact in the domain."""
        hit = self.bracket()
        return self._contact(hit) if hit else None

    def bracket(self) -> Bracket | None:
        """Return the first bracket that is not clear; this bracket is at the start if benches touch there."""
        domain = self._domain
        pairs, gap = domain.near(domain.start_m)
        if np.any(gap <= (0.0 if domain.start_m != domain.stop_m else self._errors_m(pairs))):
            return Bracket(domain.start_m, domain.start_m)
        return self._clear()

    def cleared(self) -> Certificate:
        """Clear the domain, which must have no contact, and return its certificate."""
        self._complete = self._clear() is None
        return self.certificate()

    def certificate(self) -> Certificate:
        """Return the cleared intervals as a certificate."""
        return Certificate(tuple(each for part in self._parts for each in part.intervals()), self._complete)

    def _clear(self) -> Bracket | None:
        """Clear up to the first bracket that is not clear. Raises FieldError if contacts cannot be ruled out there."""
        domain, hit = self._domain, None
        last_m, why = self._last()
        if why is not _TOO_FAR and (last_m == domain.stop_m or last_m != domain.start_m):
            for part in self._parts:
                hit = part.clear(hit.other_m if hit else last_m) or hit
        if hit is None and last_m != domain.stop_m:
            last_s = domain.time_s(last_m)
            raise FieldError('run.stop_s', domain.scene.run.stop_s, f'from {last_s:.6f} s on {why}',
                             f'stop at {floor(last_s * 1e6) / 1e6:.6f} s or before')
        return hit

    def _last(self) -> tuple[float, str]:
        """Return the leader position up to which contacts can be ruled out, and the reason for this limit (or '')."""
        domain, ends = self._domain, [(self._domain.stop_m, '')]
        if domain.track.from_afar:
            ends.append((searchable_m(domain), _TOO_FAR))
            ends.append((provable_m(domain), 'a long bench behind the second may turn back near the centre, and '
                         'contacts cannot be ruled out there'))
        ends += [(part.searchable_m, _TOO_FAR) for part in self._parts if isinstance(part, WholeChain)]
        return min(ends, key=lambda end: domain.sense * end[0])

    def _contact(self, bracket: Bracket) -> Contact:
        """Return the contact in a bracket of positions, or a grazing if it is open whether the closest pair touches."""
        domain = self._domain
        claim, later, grazing_m = self._touching(bracket)
        gone_m, pair = claim.gone_m, claim.pair
        cleared_m, earlier = self._prove(bracket.clear_m, claim, _HARDLY * claim.near_m if grazing_m else inf)
        if earlier and domain.sense * earlier.clear_m < domain.sense * bracket.clear_m:
            return self._contact(earlier)       # the proof found an earlier contact
        self._complete = claim.grazes(cleared_m) if grazing_m else claim.touches(cleared_m, earlier is None)
        speed = claim.slope * domain.speed_m_s(claim.t_s)
        error_m = float(domain.levers_of(np.array(pair))) * EXACT.promise_for_m(domain.simulation.size_m)
        unsure = error_m / speed if speed > 0 else inf
        times = {place: domain.time_s(place) for place, _ in later}
        met = [pair, *(other for place, other in later if times[place] - claim.t_s <= unsure)]
        names = [*dict.fromkeys(self._named(each) for each in met)]
        obstacle, seen = self._seen(pair, domain.benches(gone_m))
        return Contact(claim.t_s, pair[:1] if obstacle else pair, seen, grazing_m, tuple(names[1:]), speed, unsure,
                       domain.states, self.certificate(), obstacle)

    def _named(self, pair: Pair) -> tuple[int, int | str]:
        """Return a pair, with the name of the obstacle instead of the number of an edge."""
        edge, around = self._domain.edge_of(pair), self._domain.around
        return pair if edge is None or around is None else (pair[0], around.names[around.owner[edge]])

    def _seen(self, pair: Pair, benches: Benches) -> tuple[ObstacleTouch | None, Witness]:
        """Return the obstacle that a pair touches, or None for two benches, and the corner and edge that meet."""
        edge, around = self._domain.edge_of(pair), self._domain.around
        if edge is None or around is None:
            return None, witness(benches, *pair)
        return around.touch(benches, pair[0], edge)

    def _touching(self, bracket: Bracket) -> tuple['_Claim', list[tuple[float, Pair]], tuple[float, float] | None]:
        """Return either a contact in a bracket, later touches and None, or a grazing, an empty list and gap bounds.

        If no pair touches at the bracket's other end, a pair may touch just beyond that end. Such a touch counts if the
        gap closes steadily from the bracket's end, about as fast as at its zero. A touch where the leader turns back
        counts as a grazing.
        """
        domain = self._domain
        roots = self._roots(bracket) or self._ahead(bracket)
        if roots:
            (gone_m, pair), *later = roots
            claim = _Claim(domain, pair, gone_m)
            if claim.onwards_m >= claim.slack_m or claim.overlaps:
                return claim, later, None
        gone_m, pair, gap_m = self._grazing(bracket)
        return _Claim(domain, pair, gone_m), [], gap_m

    def _ahead(self, bracket: Bracket) -> list[tuple[float, Pair]]:
        """Return where pairs begin to touch just beyond a bracket, in order, or nothing if the approach is separate."""
        domain = self._domain
        for power in range(_AHEAD):
            ahead = bracket.other_m + domain.sense * _AHEAD_M * 2**power
            ahead = domain.sense * min(domain.sense * ahead, domain.sense * domain.stop_m)
            roots = self._roots(Bracket(bracket.other_m, ahead)) if ahead != bracket.other_m else []
            if roots:
                (gone_m, pair), gap = roots[0], domain.gap(roots[0][1], bracket.other_m)
                near = domain.sense * (gone_m - bracket.other_m) * domain.slope(pair, gone_m) <= _STEADY * gap
                return roots if near else []
            if ahead == domain.stop_m:
                break
        return []

    def _roots(self, bracket: Bracket) -> list[tuple[float, Pair]]:
        """Return where the gaps of pairs that touch at a bracket's other end become zero, in the order of the travel.

        Pairs whose gaps become zero at the same position, for example at the start of a run, are sorted by bench
        number.
        """
        pairs, gap = self._domain.near(bracket.other_m)
        touching = sorted((i, j) for i, j in pairs[gap <= 0].tolist())
        if bracket.clear_m == bracket.other_m:
            return [(bracket.other_m, pair) for pair in touching]
        found = [(self._domain.root(pair, bracket), pair) for pair in touching]
        return sorted(found, key=lambda row: (self._domain.sense * row[0], row[1]))

    def _grazing(self, bracket: Bracket) -> tuple[float, Pair, tuple[float, float]]:
        """Return the position from which contact of the closest pair is undecided, the pair, and bounds on its gap."""
        domain = self._domain
        pairs, gap = domain.near(bracket.other_m)
        errors = self._errors_m(pairs)
        closest = int(np.argmin(gap - errors))
        least, error, (i, j) = float(gap[closest]), float(errors[closest]), pairs[closest].tolist()
        at_clear, place = domain.gap((i, j), bracket.clear_m), bracket.other_m
        if at_clear <= max(least, error):
            place = bracket.clear_m
        elif least <= error:
            place = illinois(lambda gone_m: domain.gap((i, j), gone_m) - error, *bracket[:2], at_clear - error,
                             least - error)
        low = bracket.bound_m if np.isfinite(bracket.bound_m) else least
        return place, (i, j), (min(low, least) - error, least + error)

    def _prove(self, clear_m: float, claim: '_Claim', most_m: float) -> tuple[float, Bracket | None]:
        """Clear up to a position just before a contact or a grazing.

        Clearing stops a nanometre before the contact, or earlier if the gap there cannot be proved to differ from zero,
        but at most ``most_m`` before the contact. Return the position up to which everything is clear, and the first
        bracket that is not clear.
        """
        sense, slope, error_m = self._domain.sense, claim.slope, float(self._errors_m(np.array(claim.pair)))
        back = max(_BEFORE_M * self._domain.unit, _TOLD_APART * error_m / slope if slope > 0 else inf)
        stop_m = sense * max(sense * clear_m, sense * claim.gone_m - min(back, most_m))
        hits = [hit for part in self._parts if (hit := part.prove(stop_m))]
        cleared_m = sense * min((sense * hit.clear_m for hit in hits), default=sense * stop_m)
        return cleared_m, min(hits, key=lambda hit: sense * hit.other_m, default=None)

    def _errors_m(self, pairs: Ints) -> Floats:
        """Return the errors that bounds on the gaps of pairs (..., 2) must exceed."""
        out: Floats = 0.5 * max(part.tolerance_m for part in self._parts) * self._domain.levers_of(pairs)
        return out


@dataclass(frozen=True)
class _Claim:
    """A claim that a pair of benches touches or grazes at a leader position, and whether it can be proved.

    A contact is proved if no benches touch up to one slack before the position, and the pair overlaps one slack after
    it. A grazing is proved if no benches touch up to ``near_m`` before the position, and the gap there is less than
    ``near_m`` (docs/contact.md, what the checker proves).
    """

    domain: SearchDomain
    pair: Pair
    gone_m: float

    @cached_property
    def t_s(self) -> float:
        """The time when the leader is at the position."""
        return self.domain.time_s(self.gone_m)

    @cached_property
    def slope(self) -> float:
        """The decrease of the gap per metre of leader travel."""
        return self.domain.slope(self.pair, self.gone_m)

    @cached_property
    def _told_m(self) -> float:
        """The distance travelled by the leader at the rounded time of the contact."""
        return self.domain.gone_m(self.t_s)

    @cached_property
    def _coarse(self) -> float:
        """The ratio of the float spacing at the pair to the spacing near the origin."""
        return self.domain.coarse(self.pair, self._told_m)

    @cached_property
    def _rounding_m(self) -> float:
        """The largest change of the gap due to rounding alone."""
        return self.domain.rounding_of(self.pair)

    @cached_property
    def slack_m(self) -> float:
        """The error of positions and times, expressed as leader travel in metres."""
        domain = self.domain
        step = max(_BEFORE_M * domain.unit, _LAST_PLACES * ulp(self.t_s) * domain.speed_m_s(self.t_s))
        slack = max(step, 2 * self._rounding_m / self.slope) if self.slope > 0 else step
        lever = max(float(domain.levers[bench]) for bench in self.pair if bench < domain.dragon.benches)
        error_m = _TOLD_APART * EXACT.promise_m * self._coarse * lever
        if abs(domain.gap(self.pair, self._told_m)) + self._rounding_m < 2 * (error_m + step):
            slack = max(slack, error_m / self._steepest)
        return min(slack, _WIDEST_M * domain.unit * self._coarse)

    @cached_property
    def near_m(self) -> float:
        """The largest gap of a grazing, and the leader travel before a grazing that need not be clear."""
        return _GRAZING_M * self.domain.unit * self._coarse

    @cached_property
    def _steepest(self) -> float:
        """The largest decrease of the gap per metre, as the checker measures it; infinite at an end of the model."""
        step_m, wide_m = _ASIDE * _BEFORE_M * self.domain.unit, self.domain.step_m(self.pair)
        steepest = self._closing(step_m)
        if wide_m <= step_m or steepest == inf:
            return steepest
        # For benches of several kilometres, the position error exceeds their motion over a step of a micrometre.
        wide, wider = self._closing(wide_m), self._closing(4 * wide_m)
        return steepest if wider == inf else min(steepest, wide + abs(wider - wide))

    def _closing(self, step_m: float) -> float:
        """Return the largest decrease of the gap per metre over a step to either side; infinite at the model's end."""
        domain = self.domain
        if min(domain.left_m(self._told_m, sense) for sense in (-1, 1)) <= step_m:
            return inf
        early, late = (domain.gap(self.pair, self._told_m + sense * step_m) for sense in (-1, 1))
        return (abs(early - late) + 2 * self._rounding_m) / (2 * step_m)

    @cached_property
    def onwards_m(self) -> float:
        """How far the leader continues beyond the position."""
        return self.domain.onwards_m(self.t_s)

    @cached_property
    def overlaps(self) -> bool:
        """Whether the pair certainly overlaps one slack further on, or at the leader's reversal if that comes first."""
        after_m = min(self.slack_m, self.onwards_m)
        return self.domain.gap(self.pair, self._told_m + self.domain.sense * after_m) < -self._rounding_m

    def touches(self, cleared_m: float, as_asked: bool) -> bool:
        """Return whether a contact is proved if all is clear up to ``cleared_m`` (as requested, if ``as_asked``)."""
        return self.overlaps and (as_asked or self._within(cleared_m, self.slack_m))

    def grazes(self, cleared_m: float) -> bool:
        """Return whether a grazing is proved if everything is clear up to a position."""
        away_m = abs(self.domain.gap(self.pair, self._told_m)) + self._rounding_m
        return away_m < self.near_m and self._within(cleared_m, self.near_m)

    def _within(self, cleared_m: float, slack_m: float) -> bool:
        return self.domain.sense * (self._told_m - cleared_m) <= slack_m


def _together(proofs: Iterable[Certificate]) -> Certificate:
    """Merge the certificates of search domains with the same start."""
    kept = list(proofs)
    return Certificate(tuple(each for proof in kept for each in proof.intervals), all(proof.complete for proof in kept))


def _all_parts(domain: SearchDomain) -> list[BenchPairs]:
    """Return the separately cleared parts of a domain: obstacles, if it has any, and pairs of benches."""
    if domain.scene.venue is None:
        return parts_of(domain)
    from dragon_ros.core.search.obstacle_contact import Obstacles
    return [Obstacles(domain), *parts_of(domain)]


def parts_of(domain: SearchDomain) -> list[BenchPairs]:
    """Return the parts that clear pairs of benches: head and body on an initial spiral, and the whole chain."""
    parts = list[BenchPairs]()
    if domain.track.from_afar:
        head, *body = classes_of(domain)
        parts = [head, BodyBenches(domain, body)] if body else [head]
    if len(domain.track.segments) > 1 or not parts:
        parts.append(WholeChain(domain, bool(parts)))
    return parts
