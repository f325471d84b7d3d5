"""The first contact of a run: this one exactly, and a certificate that none came before.

The leader's range of travel is searched in each sense. Pairs whose inner bench lies on a first spiral are cleared by
``leading_benches``, over the track once for all benches with the same links behind them; all others by ``WholeChain``,
state after state. The obstacles of a venue are cleared by ``obstacle_contact``, over the track once for all benches of
one length. The first interval that cannot be cleared is solved for the zero of the gap, and everything is cleared up to
there.
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
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Certificate, Contact, Interval, NoContact
from dragon_ros.core.search.conservative_advancement import WholeChain
from dragon_ros.core.search.leading_benches import (
    BodyBenches,
    LeadingBenches,
    classes_of,
    provable_m,
    searchable_m,
)
from dragon_ros.core.search.search_domain import Bracket, RangeOfTravel, SearchDomain
from dragon_ros.core.tiers import EXACT

_BEFORE_M = 1e-9        # of the leader's way, or of the longest bench if it is shorter: so far before a contact all is
                        # cleared
_TOLD_APART = 4         # gaps there are at least so many times the error that a bound must exceed
_AHEAD_M = 1e-8         # and doubled: how far ahead of a place that cannot be cleared a contact is looked for
_AHEAD = 24             # times, so up to 8 cm
_STEADY = 4             # times as long as a gap takes to close at its last speed may it take
_ASIDE = 1e3            # times that, to either side of a contact, over which the checker takes how fast a gap closes
_LAST_PLACES = 4        # of a contact's time, times the leader's speed: so far the place may be off
_WIDEST_M = 1e-6        # of the leader's way, or of the longest bench if it is shorter: the largest slack
_GRAZING_M = 1e-7       # likewise: so near to each other benches come that graze
_HARDLY = 0.99          # of that: a place and its time round
_TOO_FAR = 'the leader goes too far to be searched'

Pair = tuple[int, int]


class BenchPairs(Protocol):
    """Some of the pairs of a domain, cleared by one of the bounds."""

    @property
    def tolerance_m(self) -> float:
        """The error of the positions, which a bound must exceed."""
        ...

    def clear(self, stop_m: float) -> Bracket | None:
        """Clear up to a place of the leader; return the first bracket of places that is not clear."""
        ...

    def prove(self, stop_m: float) -> Bracket | None:
        """Clear up to an earlier place; return the first bracket of places that is not clear."""
        ...

    def intervals(self) -> Iterator[Interval]:
        """Yield the cleared intervals."""
        ...


def first_contact(scene: Scene, progress: Callable[[int], object] = lambda states: None) -> Contact | NoContact:
    """Return the first contact of the scene's run, at the exact tier, or how the run ended without one.

    ``progress(states)`` is called with every number of states just evaluated. Raises FieldError, with the time to stop
    at, where there is none before a place beyond which none can be ruled out (docs/contact.md, limits of the search).
    In a venue the first touch of an obstacle counts too; FieldError where the dragon starts in one, or not inside.
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
    # What the leader has gone through in the other sense by then is proved apart.
    rest = [_ContactSearch(SearchDomain(scene, before, other, progress)) for other in before.senses if other != sense]
    proof = _together([hit.certificate, *(search.cleared() for search in rest)])
    return replace(hit, certificate=proof, states=sum(search.states for search in (*searches.values(), *rest)))


def head_passes(scene: Scene, progress: Callable[[int], object] = lambda states: None) -> bool:
    """Return whether it is proved that the head, which comes in on a spiral, touches no bench in the scene's run.

    Other benches may touch each other. For long mixed dragons this takes at most a tenth of the time of
    ``first_contact``. Raises as that does.
    """
    travel = RangeOfTravel(scene.head, scene.run.start_s, compile_scene(scene).end.t_s)
    domain = SearchDomain(scene, travel, 1, progress)
    head, *_ = parts_of(domain)
    assert isinstance(head, LeadingBenches)
    return _ContactSearch(domain, [head]).bracket() is None


class _ContactSearch:
    """The cleared part of a domain so far, and the first place that is not clear."""

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
        """Return the first bracket that is not clear: at the start, if benches touch there."""
        domain = self._domain
        least = 0.0 if domain.start_m != domain.stop_m else self._error_m
        if np.min(domain.near(domain.start_m)[1], initial=inf) <= least:
            return Bracket(domain.start_m, domain.start_m)
        return self._clear()

    def cleared(self) -> Certificate:
        """Return the certificate of the domain, which has no contact."""
        self._complete = self._clear() is None
        return self.certificate()

    def certificate(self) -> Certificate:
        """Return the cleared intervals."""
        return Certificate(tuple(each for part in self._parts for each in part.intervals()), self._complete)

    def _clear(self) -> Bracket | None:
        """Clear the domain, or up to the first bracket that is not; raises FieldError where no proof goes so far."""
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
        """Return the leader's place up to which contacts can be ruled out, and why no further; '' at the end."""
        domain, ends = self._domain, [(self._domain.stop_m, '')]
        if domain.track.from_afar:
            ends.append((searchable_m(domain), _TOO_FAR))
            ends.append((provable_m(domain), 'a long bench behind the second may turn back near the centre, and '
                         'contacts cannot be ruled out there'))
        ends += [(part.searchable_m, _TOO_FAR) for part in self._parts if isinstance(part, WholeChain)]
        return min(ends, key=lambda end: domain.sense * end[0])

    def _contact(self, bracket: Bracket) -> Contact:
        """Return the contact in a bracket of places, or where nobody can say if the closest pair touches."""
        domain = self._domain
        claim, later, grazing_m = self._touching(bracket)
        gone_m, pair = claim.gone_m, claim.pair
        cleared_m, earlier = self._prove(bracket.clear_m, claim, _HARDLY * claim.near_m if grazing_m else inf)
        if earlier and domain.sense * earlier.clear_m < domain.sense * bracket.clear_m:
            return self._contact(earlier)       # the proof found one
        self._complete = claim.grazes(cleared_m) if grazing_m else claim.touches(cleared_m, earlier is None)
        speed = claim.slope * domain.speed_m_s(claim.t_s)
        unsure = EXACT.promise_for_m(domain.simulation.size_m) / speed if speed > 0 else inf
        times = {place: domain.time_s(place) for place, _ in later}
        met = [pair, *(other for place, other in later if times[place] - claim.t_s <= unsure)]
        names = [*dict.fromkeys(self._named(each) for each in met)]
        obstacle, seen = self._seen(pair, domain.benches(gone_m))
        return Contact(claim.t_s, pair[:1] if obstacle else pair, seen, grazing_m, tuple(names[1:]), speed, unsure,
                       domain.states, self.certificate(), obstacle)

    def _named(self, pair: Pair) -> tuple[int, int | str]:
        """Return a pair with the name of its obstacle in place of an edge."""
        edge, around = self._domain.edge_of(pair), self._domain.around
        return pair if edge is None or around is None else (pair[0], around.names[around.owner[edge]])

    def _seen(self, pair: Pair, benches: Benches) -> tuple[ObstacleTouch | None, Witness]:
        """Return what a pair touches of an obstacle, None of two benches; and corner and edge."""
        edge, around = self._domain.edge_of(pair), self._domain.around
        if edge is None or around is None:
            return None, witness(benches, *pair)
        return around.touch(benches, pair[0], edge)

    def _touching(self, bracket: Bracket) -> tuple['_Claim', list[tuple[float, Pair]], tuple[float, float] | None]:
        """Return the first contact in a bracket, where others begin to touch, and None; or a grazing, and its bounds.

        Where none touches at the bracket's other end, one may just ahead: if its gap closes from there without a
        detour, about as fast as it does where it vanishes. A pair that touches where the leader turns back grazes.
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
        """Return where pairs begin to touch just beyond a bracket, in order; none where it is far or another gap."""
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
        """Return where the gaps of the pairs that touch at a bracket's other end vanish, in the leader's order.

        Those that do so at one place, such as at the start of a run, come in the order of their benches.
        """
        pairs, gap = self._domain.near(bracket.other_m)
        touching = sorted((i, j) for i, j in pairs[gap <= 0].tolist())
        if bracket.clear_m == bracket.other_m:
            return [(bracket.other_m, pair) for pair in touching]
        found = [(self._domain.root(pair, bracket), pair) for pair in touching]
        return sorted(found, key=lambda row: (self._domain.sense * row[0], row[1]))

    def _grazing(self, bracket: Bracket) -> tuple[float, Pair, tuple[float, float]]:
        """Return from where on nobody can say if the closest pair touches, that pair, and bounds of its gap."""
        domain, error = self._domain, self._error_m
        pairs, gap = domain.near(bracket.other_m)
        closest = int(np.argmin(gap))
        least, (i, j) = float(gap[closest]), pairs[closest].tolist()
        at_clear, place = domain.gap((i, j), bracket.clear_m), bracket.other_m
        if at_clear <= max(least, error):
            place = bracket.clear_m
        elif least <= error:
            place = illinois(lambda gone_m: domain.gap((i, j), gone_m) - error, *bracket[:2], at_clear - error,
                             least - error)
        low = bracket.bound_m if np.isfinite(bracket.bound_m) else least
        return place, (i, j), (min(low, least) - error, least + error)

    def _prove(self, clear_m: float, claim: '_Claim', most_m: float) -> tuple[float, Bracket | None]:
        """Clear up to a nanometre before a contact, or as near as its gap can be told from zero, or to a grazing.

        That is no further than ``most_m`` before it. Return up to where all is clear, and the first bracket that is
        not.
        """
        sense, slope = self._domain.sense, claim.slope
        back = max(_BEFORE_M * self._domain.unit, _TOLD_APART * self._error_m / slope if slope > 0 else inf)
        stop_m = sense * max(sense * clear_m, sense * claim.gone_m - min(back, most_m))
        hits = [hit for part in self._parts if (hit := part.prove(stop_m))]
        cleared_m = sense * min((sense * hit.clear_m for hit in hits), default=sense * stop_m)
        return cleared_m, min(hits, key=lambda hit: sense * hit.other_m, default=None)

    @property
    def _error_m(self) -> float:
        """The error of positions, which bounds must exceed."""
        return max(part.tolerance_m for part in self._parts)


@dataclass(frozen=True)
class _Claim:
    """A pair of benches that is said to touch, or to graze, at a place of the leader; and whether that can be proved.

    It is if no benches touch up to a slack before, and the pair overlaps a slack after or is near where it grazes
    (docs/contact.md, what the checker proves).
    """

    domain: SearchDomain
    pair: Pair
    gone_m: float

    @cached_property
    def t_s(self) -> float:
        """The time when the leader is there."""
        return self.domain.time_s(self.gone_m)

    @cached_property
    def slope(self) -> float:
        """How much the gap closes per metre of the leader's way."""
        return self.domain.slope(self.pair, self.gone_m)

    @cached_property
    def _told_m(self) -> float:
        """The distance travelled by the leader at the contact's time, which is rounded."""
        return self.domain.gone_m(self.t_s)

    @cached_property
    def _coarse(self) -> float:
        """How many times coarser floats are there than near the origin."""
        return self.domain.coarse(self.pair, self._told_m)

    @cached_property
    def _rounding_m(self) -> float:
        """How much rounding alone may change the gap."""
        return self.domain.rounding_of(self.pair)

    @cached_property
    def slack_m(self) -> float:
        """The error of positions and times in metres of the leader's way."""
        domain = self.domain
        step = max(_BEFORE_M * domain.unit, _LAST_PLACES * ulp(self.t_s) * domain.speed_m_s(self.t_s))
        slack = max(step, 2 * self._rounding_m / self.slope) if self.slope > 0 else step
        error_m = _TOLD_APART * EXACT.promise_m * self._coarse
        if abs(domain.gap(self.pair, self._told_m)) + self._rounding_m < 2 * (error_m + step):
            slack = max(slack, error_m / self._steepest)
        return min(slack, _WIDEST_M * domain.unit * self._coarse)

    @cached_property
    def near_m(self) -> float:
        """How near grazing benches come to each other, and how far before that everything is clear."""
        return _GRAZING_M * self.domain.unit * self._coarse

    @cached_property
    def _steepest(self) -> float:
        """How much the gap closes per metre at most, as the checker takes it; infinite at an end of the model."""
        step_m, wide_m = _ASIDE * _BEFORE_M * self.domain.unit, self.domain.step_m
        steepest = self._closing(step_m)
        if wide_m <= step_m or steepest == inf:
            return steepest
        # Of benches of kilometres positions err by more than they go in a step of a micrometre.
        wide, wider = self._closing(wide_m), self._closing(4 * wide_m)
        return steepest if wider == inf else min(steepest, wide + abs(wider - wide))

    def _closing(self, step_m: float) -> float:
        """Return how much the gap closes for each metre at most over a step to either side; infinite at an end."""
        domain = self.domain
        if min(domain.left_m(self._told_m, sense) for sense in (-1, 1)) <= step_m:
            return inf
        early, late = (domain.gap(self.pair, self._told_m + sense * step_m) for sense in (-1, 1))
        return (abs(early - late) + 2 * self._rounding_m) / (2 * step_m)

    @cached_property
    def onwards_m(self) -> float:
        """How far the leader continues from there."""
        return self.domain.onwards_m(self.t_s)

    @cached_property
    def overlaps(self) -> bool:
        """Whether the pair certainly overlaps a slack further on, or where the leader turns back before."""
        after_m = min(self.slack_m, self.onwards_m)
        return self.domain.gap(self.pair, self._told_m + self.domain.sense * after_m) < -self._rounding_m

    def touches(self, cleared_m: float, as_asked: bool) -> bool:
        """Return whether a contact is proved if all is clear up to a place, ``as_asked`` or not so far."""
        return self.overlaps and (as_asked or self._within(cleared_m, self.slack_m))

    def grazes(self, cleared_m: float) -> bool:
        """Return whether a grazing is proved if all is clear up to a place."""
        away_m = abs(self.domain.gap(self.pair, self._told_m)) + self._rounding_m
        return away_m < self.near_m and self._within(cleared_m, self.near_m)

    def _within(self, cleared_m: float, slack_m: float) -> bool:
        return self.domain.sense * (self._told_m - cleared_m) <= slack_m


def _together(proofs: Iterable[Certificate]) -> Certificate:
    """Return the certificates of the search domains from one start as one."""
    kept = list(proofs)
    return Certificate(tuple(each for proof in kept for each in proof.intervals), all(proof.complete for proof in kept))


def _all_parts(domain: SearchDomain) -> list[BenchPairs]:
    """Return the parts of a domain that are cleared separately: its obstacles, if it has any, and pairs of benches."""
    if domain.scene.venue is None:
        return parts_of(domain)
    from dragon_ros.core.search.obstacle_contact import Obstacles
    return [Obstacles(domain), *parts_of(domain)]


def parts_of(domain: SearchDomain) -> list[BenchPairs]:
    """Return the parts that pairs of benches are cleared in: head and body on a first spiral, and the whole chain."""
    parts = list[BenchPairs]()
    if domain.track.from_afar:
        head, *body = classes_of(domain)
        parts = [head, BodyBenches(domain, body)] if body else [head]
    if len(domain.track.segments) > 1 or not parts:
        parts.append(WholeChain(domain, bool(parts)))
    return parts
