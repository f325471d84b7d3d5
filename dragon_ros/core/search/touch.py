"""Where benches touch in a bracket of leader positions that could not be cleared, and what can be claimed about it."""
from dataclasses import dataclass

import numpy as np

from dragon_ros.core.numerics.roots import illinois
from dragon_ros.core.search.search_domain import Bracket, Pair, SearchDomain

_AHEAD_M = 1e-8         # first step of the search for a contact just beyond a position that cannot be cleared
_AHEAD = 24             # number of doublings of this step, up to 8 cm
# An approach to a contact is separate if the leader travels more than this multiple of the distance in which the gap
# would close at its final rate.
_STEADY = 4


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
    return (_contact(domain, roots) if roots else None) or _grazing(domain, bracket)


def _contact(domain: SearchDomain, roots: list[tuple[float, Pair]]) -> Touch | None:
    """Return the contact of the first of some pairs, or None if the leader turns back before they overlap."""
    (travel_m, pair), *later = roots
    t_s, slope = domain.time_s(travel_m), domain.slope(pair, travel_m)
    slack_m, onwards_m = domain.slack_at_m(t_s, slope), domain.onwards_m(t_s)
    after_m = domain.travel_m(t_s) + domain.sense * min(slack_m, onwards_m)
    overlaps = domain.gap(pair, after_m) < -domain.error_m
    if not overlaps and onwards_m < slack_m:
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
            (travel_m, pair), gap = roots[0], domain.gap(roots[0][1], bracket.other_m)
            near = domain.sense * (travel_m - bracket.other_m) * domain.slope(pair, travel_m) <= _STEADY * gap
            return roots if near else []
        if ahead == domain.stop_m:
            break
    return []


def _roots(domain: SearchDomain, bracket: Bracket) -> list[tuple[float, Pair]]:
    """Return where the gaps of pairs that touch at a bracket's other end become zero, in the order of the travel.

    Pairs whose gaps become zero at the same position, for example at the start of a run, are sorted by bench number.
    """
    pairs, gap = domain.near(bracket.other_m)
    touching = sorted((i, j) for i, j in pairs[gap <= 0].tolist())
    if bracket.clear_m == bracket.other_m:
        return [(bracket.other_m, pair) for pair in touching]
    found = [(domain.root(pair, bracket), pair) for pair in touching]
    return sorted(found, key=lambda row: (domain.sense * row[0], row[1]))


def _grazing(domain: SearchDomain, bracket: Bracket) -> Touch:
    """Return the closest pair in a bracket, at the position from which it is undecided whether it touches."""
    pairs, gap = domain.near(bracket.other_m)
    closest, error_m = int(np.argmin(gap)), domain.tolerance_m
    least, (i, j) = float(gap[closest]), pairs[closest].tolist()
    at_clear, travel_m = domain.gap((i, j), bracket.clear_m), bracket.other_m
    if at_clear <= max(least, error_m):
        travel_m = bracket.clear_m
    elif least <= error_m:
        travel_m = illinois(lambda place: domain.gap((i, j), place) - error_m, *bracket[:2], at_clear - error_m,
                          least - error_m)
    low = bracket.bound_m if np.isfinite(bracket.bound_m) else least
    t_s = domain.time_s(travel_m)
    near = abs(domain.gap((i, j), domain.travel_m(t_s))) + domain.error_m < domain.near_m
    return Touch((i, j), travel_m, t_s, domain.slope((i, j), travel_m), domain.near_m, near,
                 (min(low, least) - error_m, least + error_m))
