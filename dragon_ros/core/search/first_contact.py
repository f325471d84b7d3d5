"""The first contact of a run, located exactly, with a certificate that no contact occurs before it.

The leader's range of travel is searched in each direction, from the start on (``search_domain``). One engine clears all
pairs of benches, interval by interval (``conservative_advancement``); ``obstacle_contact`` clears the obstacles of a
venue. In the first interval that cannot be cleared, the search solves for the zero of the gap, and everything is
cleared up to one slack before it.
"""
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import inf, ulp
from typing import TYPE_CHECKING

import numpy as np

from dragon_ros.core.chain.chain import marched
from dragon_ros.core.chain.commanded import onwards_m
from dragon_ros.core.geometry.broad_phase import candidates, default_reach_m
from dragon_ros.core.geometry.contacts import ObstacleTouch
from dragon_ros.core.geometry.rectangles import Benches, axes_of
from dragon_ros.core.geometry.signed_distance import Witness, gap_of, gaps, witness
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.numerics.types import Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Certificate, Contact, NoContact
from dragon_ros.core.search.conservative_advancement import WholeChain
from dragon_ros.core.search.driver import Bracket
from dragon_ros.core.search.search_domain import Pair, RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.segments import BEHIND

if TYPE_CHECKING:       # scenes without a venue do not need this module
    from dragon_ros.core.search.obstacle_contact import Obstacles

_CLOSER = 0.8           # clearing stops this fraction of a slack before a touch, to allow for the rounding of its time
_AHEAD_M = 1e-8         # first step of the search for a contact just beyond a position that cannot be cleared
_AHEAD = 24             # number of doublings of this step, up to 8 cm
# An approach to a contact is separate if the leader travels more than this multiple of the distance in which the gap
# would close at its final rate.
_STEADY = 4
_WIDEST, _NEAR = 1000, 100      # largest slack of a slow approach, and largest gap of a grazing, in slacks
_ULPS = 4               # rounding error of a contact's time, in ulps
_STEP = 1000            # step to either side for slopes, in slacks


def first_contact(scene: Scene, progress: Callable[[int], object] = lambda states: None) -> Contact | NoContact:
    """Return the first contact of the scene's run, placed accurately, or NoContact if the run ends without a contact.

    ``progress(states)`` is called with the number of states evaluated since the last call. In a venue, touching an
    obstacle also counts as a contact. Raises FieldError if the dragon does not start inside its venue and clear of
    obstacles.
    """
    simulation = compile_scene(scene.exactly)
    if scene.venue is not None:
        from dragon_ros.core.search.venue import check_sides
        check_sides(simulation)
    travel = RangeOfTravel.of(simulation)
    searches = {sense: ContactSearch(SearchDomain(simulation, travel, sense, progress))
                for sense in travel.senses or [1]}
    hits = {sense: hit for sense, search in searches.items() if (hit := search.first())}
    if not hits:
        proof = _together(search.certificate(True) for search in searches.values())
        return NoContact(simulation.end, sum(search.states for search in searches.values()), proof)
    sense = min(hits, key=lambda sense: hits[sense].t_s)
    hit, before = hits[sense], travel.until(hits[sense].t_s)
    # The travel in the other direction before this contact is cleared separately.
    rest = [ContactSearch(SearchDomain(simulation, before, other, progress))
            for other in before.senses if other != sense]
    proof = _together([hit.certificate, *(search.certificate(search.bracket() is None) for search in rest)])
    return replace(hit, certificate=proof, states=sum(search.states for search in (*searches.values(), *rest)))


class ContactSearch:
    """The part of a domain cleared so far, and the first position that is not clear."""

    def __init__(self, domain: SearchDomain) -> None:
        """Prepare the search of a domain."""
        self._domain, self._chain = domain, WholeChain(domain)
        self._parts: list[WholeChain | Obstacles] = [self._chain]
        if domain.scene.venue is not None:
            from dragon_ros.core.search import obstacle_contact
            self._parts = [obstacle_contact.Obstacles(domain), self._chain]

    @property
    def states(self) -> int:
        """The number of states evaluated."""
        return self._domain.states

    def first(self) -> Contact | None:
        """Return the first contact in the domain."""
        hit = self.bracket()
        return self._contact(hit) if hit else None

    def bracket(self) -> Bracket | None:
        """Clear the domain; return the first bracket that is not clear, which is the start if benches touch there."""
        domain, hit = self._domain, None
        rests = domain.start_m == domain.stop_m
        if (pairs_near(domain, domain.start_m)[1] <= (domain.tolerance_m if rests else 0.0)).any():
            return Bracket(domain.start_m, domain.start_m)
        for part in self._parts:
            hit = part.clear(hit.other_m if hit else domain.stop_m) or hit
        return hit

    def certificate(self, complete: bool) -> Certificate:
        """Return the cleared intervals as a certificate."""
        return Certificate(tuple(self._chain.intervals()), complete)

    def _contact(self, bracket: Bracket) -> Contact:
        """Return the contact in a bracket of positions, or a grazing if it is open whether the closest pair touches."""
        domain, touch = self._domain, touch_in(self._domain, bracket)
        cleared_m, earlier = self._prove(bracket.clear_m, touch)
        if earlier and domain.sense * earlier.clear_m < domain.sense * bracket.clear_m:
            return self._contact(earlier)       # the proof found an earlier contact
        proof = self.certificate(touch.holds_if_clear(domain, cleared_m))
        speed = touch.slope * domain.speed_m_s(touch.t_s)
        unsure_s = domain.gap_error_m / speed if speed > 0 else inf
        obstacle, seen = self._seen(touch.pair, domain.benches(touch.travel_m))
        return Contact(touch.t_s, touch.pair[:1] if obstacle else touch.pair, seen, touch.grazing_m,
                       tuple(dict.fromkeys(self._named(each) for each in touch.simultaneous
                                           if self._named(each) != self._named(touch.pair))),
                       speed, unsure_s, domain.states, proof, obstacle)

    def _prove(self, clear_m: float, touch: 'Touch') -> tuple[float, Bracket | None]:
        """Clear up to a little less than one slack before a touch.

        Return the position up to which everything is clear, and the first bracket that is not clear.
        """
        sense = self._domain.sense
        stop_m = sense * max(sense * clear_m, sense * touch.travel_m - _CLOSER * touch.slack_m)
        hits = [hit for part in self._parts if (hit := part.prove(stop_m))]
        cleared_m = sense * min((sense * hit.clear_m for hit in hits), default=sense * stop_m)
        return cleared_m, min(hits, key=lambda hit: sense * hit.other_m, default=None)

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


def _together(proofs: Iterable[Certificate]) -> Certificate:
    """Merge the certificates of search domains with the same start."""
    kept = list(proofs)
    return Certificate(tuple(each for proof in kept for each in proof.intervals), all(proof.complete for proof in kept))


@dataclass(frozen=True)
class Touch:
    """A pair whose gap is zero at a leader position, with the claim that follows from it.

    ``slope`` is the decrease of the gap per metre of leader travel. If ``grazing_m`` is None, the claim is that no
    benches touch up to ``slack_m`` before the position, and that the pair ``overlaps`` so far after it (or where the
    leader turns back, if that comes first). Otherwise it is open whether the pair touches: the claim is that nothing
    touches up to ``slack_m`` before, and that the gap, between the two bounds in ``grazing_m``, is smaller than that.
    ``simultaneous`` lists the other pairs that touch within ``unsure_s``.
    """

    pair: Pair
    travel_m: float
    t_s: float
    slope: float
    slack_m: float
    holds: bool
    grazing_m: tuple[float, float] | None = None
    simultaneous: tuple[Pair, ...] = ()

    def holds_if_clear(self, domain: SearchDomain, cleared_m: float) -> bool:
        """Return whether the claim is proved if nothing touches up to a leader position."""
        return self.holds and domain.sense * (domain.travel_m(self.t_s) - cleared_m) <= self.slack_m


def touch_in(domain: SearchDomain, bracket: Bracket) -> Touch:
    """Return the first touch in a bracket, or a grazing of its closest pair.

    If no pair touches at the bracket's other end, a pair may touch just beyond that end. Such a touch counts if the gap
    closes steadily from the bracket's end, about as fast as at its zero. A touch where the leader turns back counts as
    a grazing.
    """
    roots = _roots(domain, bracket) or _ahead(domain, bracket)
    return (_crossing(domain, roots) if roots else None) or _grazing(domain, bracket)


def _crossing(domain: SearchDomain, roots: list[tuple[float, Pair]]) -> Touch | None:
    """Return the contact of the first of some pairs, or None if the leader turns back before they overlap."""
    (travel_m, pair), *later = roots
    t_s, slope = domain.time_s(travel_m), slope_of(domain, pair, travel_m)
    slack_m, on_m = slack_at_m(domain, t_s, slope), _onwards_m(domain, t_s)
    after_m = domain.travel_m(t_s) + domain.sense * min(slack_m, on_m)
    overlaps = gap_at(domain, pair, after_m) < -domain.error_m
    if not overlaps and on_m < slack_m:
        return None
    unsure_m = domain.gap_error_m / slope if slope > 0 else np.inf
    at_once = tuple(other for place, other in later if domain.sense * (place - travel_m) <= unsure_m)
    return Touch(pair, travel_m, t_s, slope, slack_m, overlaps, None, at_once)


def _ahead(domain: SearchDomain, bracket: Bracket) -> list[tuple[float, Pair]]:
    """Return where pairs begin to touch just beyond a bracket, in order, or nothing if the approach is separate."""
    for power in range(_AHEAD):
        ahead = bracket.other_m + domain.sense * _AHEAD_M * 2**power
        ahead = domain.sense * min(domain.sense * ahead, domain.sense * domain.stop_m)
        roots = _roots(domain, Bracket(bracket.other_m, ahead)) if ahead != bracket.other_m else []
        if roots:
            (travel_m, pair), gap = roots[0], gap_at(domain, roots[0][1], bracket.other_m)
            steady = domain.sense * (travel_m - bracket.other_m) * slope_of(domain, pair, travel_m) <= _STEADY * gap
            return roots if steady else []
        if ahead == domain.stop_m:
            break
    return []


def _roots(domain: SearchDomain, bracket: Bracket) -> list[tuple[float, Pair]]:
    """Return where the gaps of pairs that touch at a bracket's other end become zero, in the order of the travel.

    Pairs whose gaps become zero at the same position, for example at the start of a run, are sorted by bench number.
    """
    pairs, gap = pairs_near(domain, bracket.other_m)
    touching = sorted((i, j) for i, j in pairs[gap <= 0].tolist())
    if bracket.clear_m == bracket.other_m:
        return [(bracket.other_m, pair) for pair in touching]
    found = [(_root(domain, pair, bracket), pair) for pair in touching]
    return sorted(found, key=lambda row: (domain.sense * row[0], row[1]))


def _grazing(domain: SearchDomain, bracket: Bracket) -> Touch:
    """Return the closest pair in a bracket, at the position from which it is undecided whether it touches."""
    pairs, gap = pairs_near(domain, bracket.other_m)
    closest, error_m = int(np.argmin(gap)), domain.tolerance_m
    least, (i, j) = float(gap[closest]), pairs[closest].tolist()
    at_clear, travel_m = gap_at(domain, (i, j), bracket.clear_m), bracket.other_m
    if at_clear <= max(least, error_m):
        travel_m = bracket.clear_m
    elif least <= error_m:
        travel_m = illinois(lambda place: gap_at(domain, (i, j), place) - error_m, *bracket[:2], at_clear - error_m,
                          least - error_m)
    low = bracket.bound_m if np.isfinite(bracket.bound_m) else least
    t_s, near_m = domain.time_s(travel_m), _NEAR * domain.slack_m
    is_near = abs(gap_at(domain, (i, j), domain.travel_m(t_s))) + domain.error_m < near_m
    return Touch((i, j), travel_m, t_s, slope_of(domain, (i, j), travel_m), near_m, is_near,
                 (min(low, least) - error_m, least + error_m))


def _onwards_m(domain: SearchDomain, t_s: float) -> float:
    """Return how far the leader moves on after a time until it turns or rests or the model ends; 0 in an empty run.

    The end of this motion may be beyond the end of the run.
    """
    if domain.start_m == domain.stop_m:
        return 0.0
    limit = domain.simulation.model.limits[domain.sense > 0]
    left_m = domain.sense * (limit.travel_m - domain.travel_m(t_s)) if limit else inf
    return max(0.0, min(left_m, onwards_m(domain.scene.head, t_s, domain.sense)))


def pairs_near(domain: SearchDomain, travel_m: float) -> tuple[Ints, Floats]:
    """Return the pairs (M, 2) that can touch at a leader position, and their gaps."""
    benches, around = domain.benches(travel_m), domain.around
    i, j = candidates(domain.chain(travel_m).p, benches)
    pairs, gap = np.stack((i, j), axis=1), gaps(benches, i, j)
    if around is None:
        return pairs, gap
    bench, edge = around.near(benches, default_reach_m(benches))
    return (np.concatenate((pairs, np.stack((bench, edge + domain.dragon.benches), axis=1))),
            np.concatenate((gap, around.gaps(benches, bench, edge))))


def gap_at(domain: SearchDomain, pair: Pair, travel_m: float) -> float:
    """Return the gap of a pair at a leader position; only the handles from the leader to the pair are placed."""
    edge = domain.edge_of(pair)
    last_bench = pair[0] if edge is not None else pair[1]
    first, last = (0, last_bench + 1) if domain.leader.direction == BEHIND else (pair[0], domain.dragon.benches)
    chain = marched(domain.track, domain.dragon.link_lengths_m[first:last], domain.leader.place(travel_m),
                    domain.leader.direction)
    half_length, half_width = (half[first:last] for half in domain.dragon.half_sizes_m)
    benches = Benches(0.5 * (chain.p[:-1] + chain.p[1:]), axes_of(chain), half_length, half_width)
    if edge is not None and domain.around is not None:
        return float(domain.around.gaps(benches, np.array([pair[0] - first]), np.array([edge]))[0])
    return gap_of(benches, pair[0] - first, pair[1] - first)


def _root(domain: SearchDomain, pair: Pair, bracket: Bracket) -> float:
    """Return the position in a bracket where a pair's gap becomes zero; if there is none, return an end."""
    low, high = (gap_at(domain, pair, end) for end in bracket[:2])
    if high > 0:
        return bracket.other_m
    return bracket.clear_m if low <= 0 else illinois(
        lambda travel_m: gap_at(domain, pair, travel_m), *bracket[:2], low, high)


def slope_of(domain: SearchDomain, pair: Pair, travel_m: float) -> float:
    """Return the decrease of a gap per metre of leader travel."""
    (low, high), step_m = sorted((domain.start_m, domain.stop_m)), _STEP * domain.slack_m
    early, late = max(low, travel_m - step_m), min(high, travel_m + step_m)
    return domain.sense * (gap_at(domain, pair, early) - gap_at(domain, pair, late)) / (late - early) if (
        late > early) else 0.0


def slack_at_m(domain: SearchDomain, t_s: float, slope: float) -> float:
    """Return how far before and after a contact nothing is claimed, for a gap that closes by ``slope`` per metre.

    This is one slack, or more if the time is not known as precisely, or if the gap closes so slowly that it stays
    within its error for longer.
    """
    slow_m = 2 * domain.tolerance_m / slope if slope > 0 else 0.0
    return min(max(domain.slack_m, _ULPS * ulp(t_s) * domain.speed_m_s(t_s), slow_m), _WIDEST * domain.slack_m)
