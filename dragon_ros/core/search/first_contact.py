"""The first contact of a run, located exactly, with a certificate that no contact occurs before it.

The leader's range of travel is searched in each direction, from the start on (``search_domain``). One engine clears all
pairs of benches, interval by interval (``conservative_advancement``); ``obstacle_contact`` clears the obstacles of a
venue. In the first interval that cannot be cleared, the search solves for the zero of the gap (``touch``), and
everything is cleared up to one slack before it.
"""
from collections.abc import Callable, Iterable
from dataclasses import replace
from math import inf
from typing import Protocol

from dragon_ros.core.geometry.contacts import ObstacleTouch
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import Witness, witness
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Certificate, Contact, NoContact
from dragon_ros.core.search.conservative_advancement import WholeChain
from dragon_ros.core.search.search_domain import Bracket, Pair, RangeOfTravel, SearchDomain
from dragon_ros.core.search.touch import Touch, touch_in

_CLOSER = 0.8           # clearing stops this fraction of a slack before a touch, to allow for the rounding of its time


class Part(Protocol):
    """One kind of pairs of a domain: those of benches, or those of benches and obstacles."""

    def clear(self, stop_m: float) -> Bracket | None:
        """Clear up to a leader position; return the first bracket that is not clear."""
        ...

    def prove(self, stop_m: float) -> Bracket | None:
        """Clear up to an earlier position; return the first bracket that is not clear."""
        ...


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
    searches = {sense: _ContactSearch(SearchDomain(simulation, travel, sense, progress))
                for sense in travel.senses or [1]}
    hits = {sense: hit for sense, search in searches.items() if (hit := search.first())}
    if not hits:
        proof = _together(search.certificate(True) for search in searches.values())
        return NoContact(simulation.end, sum(search.states for search in searches.values()), proof)
    sense = min(hits, key=lambda sense: hits[sense].t_s)
    hit, before = hits[sense], travel.until(hits[sense].t_s)
    # The travel in the other direction before this contact is cleared separately.
    rest = [_ContactSearch(SearchDomain(simulation, before, other, progress))
            for other in before.senses if other != sense]
    proof = _together([hit.certificate, *(search.certificate(search.bracket() is None) for search in rest)])
    return replace(hit, certificate=proof, states=sum(search.states for search in (*searches.values(), *rest)))


class _ContactSearch:
    """The part of a domain cleared so far, and the first position that is not clear."""

    def __init__(self, domain: SearchDomain) -> None:
        self._domain, self._chain = domain, WholeChain(domain)
        self._parts: list[Part] = [self._chain]
        if domain.scene.venue is not None:
            from dragon_ros.core.search.obstacle_contact import Obstacles
            self._parts = [Obstacles(domain), self._chain]

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
        if (domain.near(domain.start_m)[1] <= (domain.tolerance_m if rests else 0.0)).any():
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

    def _prove(self, clear_m: float, touch: Touch) -> tuple[float, Bracket | None]:
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
