"""Near misses: local minima over time of the gap between two benches, below a threshold, before the first contact.

They are sampled and refined, not proved: the gaps of all pairs that come close are evaluated every two centimetres of
the leader's travel, and each minimum between three samples is refined by golden-section search. Pairs that stand
exactly as another pair stood earlier (``repeats``) are not sampled: they have the same minima, at their own times. Near
misses between a bench and an obstacle of the venue are included. When the leader reverses, a closing gap also has a
minimum. A dip that is narrower than the spacing of the samples, or shallower than a nanometre, may be missed.
"""
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.chain.commanded import passed_s
from dragon_ros.core.geometry.broad_phase import boxes_within, candidates
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps, seen_from, signed_gap
from dragon_ros.core.model import Simulation, compile_scene
from dragon_ros.core.numerics.types import Array, Floats, Ints, complex_of
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.core.search.conservative_advancement import ChainIntervals
from dragon_ros.core.search.repeats import Repeats
from dragon_ros.core.search.search_domain import Pair, RangeOfTravel, SearchDomain

MOST = 1000             # maximum number of listed near misses; the others are only counted
_SPACING_M = 0.02       # spacing of samples in leader travel; where corners pass benches, dips are decimetres long
# The approximate change of a gap per metre of leader travel, which limits how far the samples of a dip may exceed the
# threshold.
_LIPSCHITZ = 2.0
_SHALLOW_M = 1e-9       # far above the error of gaps; shallower dips cannot be distinguished from a constant gap
_AT_ONCE = 64           # number of samples that are evaluated together
_GOLDEN = 0.5 * (5**0.5 - 1)
_ROUNDS = 34            # number of golden-section steps: 0.618^34 of 4 cm is 3 nm, and flat minima are less precise
_REFINED = 1024         # maximum number of minima that are refined together, to save memory
_SAME_M = 1e-4          # minima of the same pair that are closer than this, in leader travel, count as one minimum
_SAME_GAP_M = 1e-8      # an edge whose gap exceeds that of the obstacle by more is not the nearest edge
_CLOSING_M = 1e-6       # leader travel before a reversal during which the gap must decrease
_NEWTON = 8             # maximum number of iterations; three suffice if handles are about as fast as the leader
_THERE_M = 1e-9         # tolerance for a position found by Newton's method


@dataclass(frozen=True)
class NearMiss:
    """A local minimum of the gap between two benches (the inner one first), or between a bench and an obstacle."""

    benches: tuple[int, ...]
    t_s: float
    gap_m: float
    obstacle: str | None = None

    @property
    def bench(self) -> int:
        """The outer of the two benches, or the bench near an obstacle."""
        return self.benches[-1]


@dataclass(frozen=True)
class NearMisses:
    """The nearest ``MOST`` of ``count`` near misses, sorted by gap."""

    nearest: tuple[NearMiss, ...]
    count: int


@dataclass(frozen=True)
class _Dip:
    """A local minimum of a pair's gap over leader positions; edges of obstacles are numbered after the benches."""

    pair: Pair
    place: float
    gap_m: float


def near_misses(scene: Scene, found: Contact | NoContact, below_m: float,
                progress: Callable[[int], object] = lambda states: None) -> NearMisses:
    """Return the near misses with gaps below ``below_m`` before the contact or end; times are accurate to about 1e-5 s.

    A position that the leader passes several times yields one near miss per passage. ``progress(states)`` is called
    with the number of states evaluated since the last call.
    """
    simulation, misses = compile_scene(scene.exactly), list[NearMiss]()
    travel = RangeOfTravel.of(simulation)
    travel = travel.until(found.t_s) if isinstance(found, Contact) else travel
    for sense in travel.senses:
        domain = SearchDomain(simulation, travel, sense, progress)
        dips = _nearest_edges(domain, _distinct(_dips_of(domain, below_m)))
        passed = passages_s(travel, [dip.place for dip in dips])
        misses += [_miss(domain, dip.pair, t_s, dip.gap_m)
                   for dip, times in zip(dips, passed, strict=True) for t_s in times]
    misses += _at_reversals(simulation, travel, below_m)
    misses.sort(key=lambda miss: (miss.gap_m, miss.t_s))
    return NearMisses(tuple(misses[:MOST]), len(misses))


def passages_s(travel: RangeOfTravel, places_m: Sequence[float]) -> list[list[float]]:
    """Return, for each position, the times at which the leader passes it, except where the leader may reverse."""
    legs = [(one, two, travel.travel_m(one), travel.travel_m(two)) for one, two in pairwise(travel.times_s)]
    return [[passed_s(travel.law, place, *leg[:2]) for leg in legs if min(leg[2:]) <= place <= max(leg[2:]) and
             leg[2] != place != leg[3]] for place in places_m]


def _miss(domain: SearchDomain, pair: Pair, t_s: float, gap_m: float) -> NearMiss:
    """Return a near miss of two benches, or of a bench and an obstacle."""
    edge, around = domain.edge_of(pair), domain.around
    if edge is None or around is None:
        return NearMiss(pair, t_s, gap_m)
    return NearMiss(pair[:1], t_s, gap_m, around.names[around.owner[edge]])


def _distinct(dips: list[_Dip]) -> list[_Dip]:
    """Return the dips without duplicates of the same pair."""
    out: list[_Dip] = []
    for dip in sorted(dips, key=lambda dip: (dip.pair, dip.place)):
        if not out or out[-1].pair != dip.pair or dip.place - out[-1].place > _SAME_M:
            out.append(dip)
    return out


def _nearest_edges(domain: SearchDomain, dips: list[_Dip]) -> list[_Dip]:
    """Return the dips without those of an edge that is not the nearest edge of its obstacle, each corner once."""
    around, out, corners = domain.around, list[_Dip](), dict[tuple[int, int], list[float]]()
    for dip in dips:
        edge = domain.edge_of(dip.pair)
        if edge is not None and around is not None:
            number, bench = int(around.owner[edge]), dip.pair[0]
            known, every = corners.setdefault((bench, number), []), around.edges_of(number)
            least_m = np.min(around.gaps(domain.benches(dip.place), np.full(every.size, bench), every))
            if dip.gap_m > least_m + _SAME_GAP_M or any(abs(dip.place - place) <= _SAME_M for place in known):
                continue
            known.append(dip.place)
        out.append(dip)
    return out


def _dips_of(domain: SearchDomain, below_m: float) -> list[_Dip]:
    """Return the dips of a domain, with leader positions."""
    def gaps_at(places: Floats, pairs: Ints) -> Floats:
        return _gaps(domain, domain.chains(places), pairs)

    space, repeats, brackets = ChainIntervals(domain), Repeats(domain, 2 * _SPACING_M), []
    phases = domain.phases(domain.start_m, domain.stop_m)
    for start_m, stop_m in phases:
        for blocks in _grids(min(start_m, stop_m), max(start_m, stop_m)):
            one, two = (space.sample(np.array([places[end] for places in blocks])) for end in (0, -1))
            apart = space.layers_m(one, two) > below_m
            first = np.where(apart, domain.dragon.benches, repeats.first(one.along_m, two.along_m))
            for n, places in enumerate(blocks):
                if domain.around is None and np.all(first[n, :-2] >= domain.dragon.benches):
                    continue
                chain = domain.chains(places)
                domain.count(places.size)
                pairs = _near(domain, chain, first[n], below_m)
                new = ~repeats.repeated(one.along_m[n], two.along_m[n], *np.minimum(pairs, domain.dragon.benches - 1).T)
                pairs = pairs[new | (pairs[:, 1] >= domain.dragon.benches)]
                if pairs.size:
                    brackets.append(_bracketed(places, pairs, _gaps(domain, chain, pairs), below_m))
    dips = _dips(gaps_at, brackets, below_m)
    return [*dips, *(again for phase in phases for again in _repeated(domain, repeats, dips, phase))]


def _near(domain: SearchDomain, chain: Chain, first: Ints, below_m: float) -> Ints:
    """Return the pairs (K, 2) whose boxes come closer than ``below_m`` in some chains, from bench ``first`` (N,) on."""
    corners = benches_of(chain, domain.dragon, axes_of(chain)).corners
    low, high = corners.min(axis=0).min(axis=1), corners.max(axis=0).max(axis=1)     # faster than one reduction
    ((i, j),) = boxes_within(low[None], high[None], np.array([below_m]), first[None])
    pairs = np.stack((i, j), axis=1)
    if domain.around is None:
        return pairs
    bench, edge = domain.around.in_boxes(low - below_m, high + below_m)
    return np.concatenate((pairs, np.stack((bench, edge + domain.dragon.benches), axis=1)))


def _repeated(domain: SearchDomain, repeats: Repeats, dips: list[_Dip], phase: tuple[float, float]) -> list[_Dip]:
    """Return the dips of the pairs that repeat the pairs of some dips, in one phase of the leader's motion."""
    out, (here_m, there_m) = list[tuple[_Dip, Pair, int, float, float]](), (domain.along_m(end) for end in phase)
    for dip in dips:
        if domain.edge_of(dip.pair) is None:
            all_m = domain.along_m(dip.place)
            along_m = all_m[repeats.place_of(dip.pair)]
            for pair in repeats.all_of(dip.pair)[1:]:
                handle = repeats.place_of(pair)
                if (here_m[handle] - along_m) * (there_m[handle] - along_m) < 0:
                    guess_m = dip.place - domain.leader.direction * (along_m - all_m[handle])
                    out.append((dip, pair, handle, along_m, guess_m))
    if not out:
        return []
    same, pairs, handles, along, guesses = zip(*out, strict=True)
    travel_m = _travel_at(domain, np.array(handles), np.array(along), np.array(guesses), phase).tolist()
    return [_Dip(pair, place, dip.gap_m) for dip, pair, place in zip(same, pairs, travel_m, strict=True)]


def _travel_at(domain: SearchDomain, handle: Ints, along_m: Floats, guess_m: Floats,
             within: tuple[float, float]) -> Floats:
    """Return the leader positions at which handles (M,) are at distances (M,) along the track."""
    row, travel_m = np.arange(handle.size), np.clip(guess_m, min(within), max(within))
    missing = np.zeros(handle.size)
    for _ in range(_NEWTON):
        chain = domain.chains(travel_m)
        speed = np.sum(chain.velocities(np.ones(handle.size)) * chain.headings, axis=-1)[row, handle]
        missing = along_m - domain.track.distances(chain.segment, chain.u)[row, handle]
        if np.all(np.abs(missing) < _THERE_M):
            break
        travel_m = np.clip(travel_m + missing / np.where(speed == 0, 1.0, speed), min(within), max(within))
    for n in np.flatnonzero(np.abs(missing) >= _THERE_M).tolist():
        travel_m[n] = domain.travel_at(int(handle[n]), float(along_m[n]), within)
    return travel_m


def _gaps(domain: SearchDomain, chain: Chain, pairs: Ints) -> Floats:
    """Return the gaps (M, K) of pairs (K, 2), or (M, 1) of pairs (M, 1, 2), in M chains."""
    row, i, j = np.broadcast_arrays(np.arange(len(chain.p))[:, None], pairs[..., 0], pairs[..., 1])
    out, two = np.empty(row.shape), j < domain.dragon.benches
    one, other = (_rectangles(domain, chain, row[two], bench[two]) for bench in (i, j))
    out[two] = signed_gap(seen_from((one[0], other[0]), (one[1], other[1]), one[2], other[2]))
    if domain.around is not None and not np.all(two):
        edge = j[~two] - domain.dragon.benches
        out[~two] = domain.around.gaps_of(*_rectangles(domain, chain, row[~two], i[~two]), edge)
    return out


def _rectangles(domain: SearchDomain, chain: Chain, row: Ints, bench: Ints
                ) -> tuple[Array, Array, tuple[Floats, Floats]]:
    """Return the centres, axes and half sizes of benches in the given chains."""
    front, rear = (complex_of(chain.p[row, handle]) for handle in (bench, bench + 1))
    middle, link, (half_length, half_width) = 0.5 * (front + rear), front - rear, domain.dragon.half_sizes_m
    return middle, link / np.abs(link), (half_length[bench], half_width[bench])


def _grids(low: float, high: float) -> Iterator[list[Floats]]:
    """Yield groups of blocks of equidistant positions; blocks overlap by two, so that no dip falls between them."""
    places = np.linspace(low, high, max(3, 2 + int((high - low) / _SPACING_M)), dtype=np.float64)
    starts = range(0, places.size - 2, _AT_ONCE - 2)
    for group in range(0, len(starts), _AT_ONCE):
        yield [places[start:start + _AT_ONCE] for start in starts[group:group + _AT_ONCE]]


def _bracketed(places: Floats, pairs: Ints, gap_m: Floats, below_m: float) -> tuple[Ints, Floats, Floats]:
    """Return the pairs (D, 2) with minima in gaps (M, K) at positions (M,), and the positions around each minimum."""
    low, sides = gap_m[1:-1], (gap_m[:-2], gap_m[2:])
    dip = (low <= sides[0]) & (low <= sides[1]) & (low + _SHALLOW_M < np.maximum(*sides))
    row, column = np.nonzero(dip & (low < below_m + _LIPSCHITZ * _SPACING_M))
    return pairs[column], places[row], places[row + 2]


def _dips(gaps_at: Callable[[Floats, Ints], Floats], brackets: list[tuple[Ints, Floats, Floats]],
          below_m: float) -> list[_Dip]:
    """Return the minima in brackets whose gaps are below the threshold.

    ``gaps_at`` maps positions (M,) and pairs (M, 1, 2) to gaps (M, 1).
    """
    out: list[_Dip] = []
    if not brackets:
        return out
    pairs, left, right = (np.concatenate(part) for part in zip(*brackets, strict=True))
    for start in range(0, len(pairs), _REFINED):
        part = slice(start, start + _REFINED)
        own = pairs[part, None]

        def gap_of(places: Floats, own: Ints = own) -> Floats:
            return gaps_at(places, own)[:, 0]

        found, least = lowest(gap_of, left[part], right[part])
        rows = zip(pairs[part].tolist(), found.tolist(), least.tolist(), strict=True)
        out += [_Dip((i, j), place, gap_m) for (i, j), place, gap_m in rows if gap_m < below_m]
    return out


def lowest(function: Callable[[Floats], Floats], left: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return the minimum of each function in its interval, and its value, by golden-section search."""
    a, b = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
    at_a, at_b = function(a), function(b)
    for _ in range(_ROUNDS):
        lower = at_a < at_b
        left, right = np.where(lower, left, a), np.where(lower, b, right)
        new = np.where(lower, right - _GOLDEN * (right - left), left + _GOLDEN * (right - left))
        value = function(new)
        a, b, at_a, at_b = (np.where(lower, new, b), np.where(lower, a, new), np.where(lower, value, at_b),
                            np.where(lower, at_a, value))
    lower = at_a < at_b
    return np.where(lower, a, b), np.where(lower, at_a, at_b)


def reversals(travel: RangeOfTravel) -> list[tuple[float, int]]:
    """Return when the leader reverses, and its direction before each reversal; a rest is not a reversal."""
    out, going, turned_s = list[tuple[float, int]](), 0, travel.start_s
    for before, after in pairwise(travel.times_s):
        moved = travel.travel_m(after) - travel.travel_m(before)
        sense = (moved > 0) - (moved < 0)
        if sense and going and sense != going:
            out.append((turned_s, going))
        if sense:
            going, turned_s = sense, after
    return out


def _at_reversals(simulation: Simulation, travel: RangeOfTravel, below_m: float) -> Iterator[NearMiss]:
    """Yield the near misses at the positions where the leader reverses."""
    for t_s, sense in reversals(travel):
        domain, travel_m = SearchDomain(simulation, travel, sense, lambda states: None), travel.travel_m(t_s)
        benches, earlier = domain.benches(travel_m), domain.benches(travel_m - sense * _CLOSING_M)
        unsure_m = 2 * domain.tolerance_m
        i, j = candidates(domain.chain(travel_m).p, benches, below_m)
        gap, before = gaps(benches, i, j), gaps(earlier, i, j)
        for n in np.flatnonzero((gap < below_m) & (before - gap > unsure_m)).tolist():
            yield NearMiss((int(i[n]), int(j[n])), t_s, float(gap[n]))
        if domain.around:
            bench, number, gap = domain.around.closest(benches, below_m)
            before = np.array([domain.around.gap_to(earlier, *pair) for pair in zip(
                bench.tolist(), number.tolist(), strict=True)])
            for n in np.flatnonzero((gap < below_m) & (before - gap > unsure_m)).tolist():
                yield NearMiss((int(bench[n]),), t_s, float(gap[n]), domain.around.names[number[n]])
