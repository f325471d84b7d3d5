"""Near misses: local minima over time of the gap between two benches, below a threshold, before the first contact.

Near misses between a bench and an obstacle of the venue are included; each is found along the track once for all
benches of one length.

Only intervals whose certified bound is below the threshold are sampled. Benches with the same remaining link sequence
have the same gaps at the same positions. If the first segment is a spiral, each minimum on it is therefore found once
for its class, and each bench of the class reaches that position at its own time. When the leader reverses, a closing
gap also has a minimum. A dip narrower than the sample spacing, or shallower than a nanometre, may be missed.
"""
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from dragon_ros.core.chain.chain import Chain, marched_many
from dragon_ros.core.geometry.broad_phase import candidates, swept_pairs
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Complexes, Floats, Ints
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import ALL, Certificate, Contact, Interval, NoContact
from dragon_ros.core.search.leading_benches import LeadingBenches, classes_of
from dragon_ros.core.search.search_domain import RangeOfTravel, SearchDomain
from dragon_ros.core.tracks.segments import BEHIND

if TYPE_CHECKING:       # scenes without a venue do not need this module
    from dragon_ros.core.search.obstacle_bounds import ObstacleBounds

MOST = 1000             # maximum number of listed near misses; the others are only counted
_COARSE_M = 1.0         # spacing of positions for the coarse search for obstacles
_SPACING_M = 0.02       # spacing of samples along the track; where corners pass benches, dips are decimetres long
# The approximate change of a gap per metre of leader travel, which limits how far the samples of a dip may exceed the
# threshold.
_LIPSCHITZ = 2.0
_SHALLOW_M = 1e-9       # far above the error of gaps; shallower dips cannot be distinguished from a constant gap
_AT_ONCE = 64           # number of samples that are evaluated together
_GOLDEN = 0.5 * (5**0.5 - 1)
_ROUNDS = 34            # number of golden-section steps: 0.618^34 of 4 cm is 3 nm, and flat minima are less precise
_REFINED = 1024         # maximum number of minima that are refined together, to save memory
_SAME_M = 1e-4          # minima of the same pair that are closer than this, in leader travel, count as one minimum
_CLOSING_M = 1e-6       # leader travel before a reversal during which the gap must decrease
_NEWTON = 8             # maximum number of iterations; three suffice if handles are about as fast as the leader
_THERE_M = 1e-9         # tolerance for a position found by Newton's method

Pair = tuple[int, int]
Gaps = Callable[[Floats, Ints], Floats]     # maps positions (M,) and pairs (..., 2) to gaps (M, K) or (M,)


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
    """A local minimum of a pair's gap over positions; the venue's obstacles are numbered after the benches."""

    pair: Pair
    place: float
    gap_m: float


@dataclass(frozen=True)
class _ClassDip:
    """A dip of a class's first bench, transferred to one bench of the class in one phase of the leader's motion."""

    dip: _Dip
    bench: int
    phase: tuple[float, float]


def near_misses(scene: Scene, found: Contact | NoContact, below_m: float,
                progress: Callable[[int], object] = lambda states: None) -> NearMisses:
    """Return the near misses with gaps below ``below_m`` before the contact or end; times are accurate to about 1e-5 s.

    A position that the leader passes several times yields one near miss per passage. ``progress(states)`` is called
    with the number of states evaluated since the last call.
    """
    end_s = found.t_s if isinstance(found, Contact) else compile_scene(scene).end.t_s
    travel = RangeOfTravel(scene.head, scene.run.start_s, end_s)
    dips, count = list[_Dip](), 0
    for sense in travel.senses:
        more, left_out = _in_domain(SearchDomain(scene, travel, sense, progress), found.certificate, below_m)
        dips, count = dips + more, count + left_out
    dips = _distinct(dips)
    passed = travel.passages_s([dip.place for dip in dips])
    names = scene.venue.names if scene.venue else ()
    misses = [_miss(dip.pair, t_s, dip.gap_m, scene.dragon.benches, names)
              for dip, times in zip(dips, passed, strict=True) for t_s in times]
    misses += _at_reversals(scene, travel, below_m)
    misses.sort(key=lambda miss: (miss.gap_m, miss.t_s))
    return NearMisses(tuple(misses[:MOST]), count + len(misses))


def _miss(pair: Pair, t_s: float, gap_m: float, benches: int, names: Sequence[str]) -> NearMiss:
    """Return a near miss of two benches, or of a bench and an obstacle."""
    if pair[1] < benches:
        return NearMiss(pair, t_s, gap_m)
    return NearMiss(pair[:1], t_s, gap_m, names[pair[1] - benches])


def _distinct(dips: list[_Dip]) -> list[_Dip]:
    """Return the dips without duplicates of the same pair."""
    out: list[_Dip] = []
    for dip in sorted(dips, key=lambda dip: (dip.pair, dip.place)):
        if not out or out[-1].pair != dip.pair or dip.place - out[-1].place > _SAME_M:
            out.append(dip)
    return out


def _in_domain(domain: SearchDomain, proof: Certificate, below_m: float) -> tuple[list[_Dip], int]:
    """Return the dips of a domain, with leader positions, and the number of dips that were omitted."""
    out = _of_chain(domain, [each for each in proof.led_by(ALL) if each.bound_m < below_m], below_m)
    alike: list[_ClassDip] = []
    out += _of_obstacles(domain, below_m) if domain.around else []
    for part in classes_of(domain) if domain.track.from_afar else []:
        dips = [*_of_class(domain, part, proof.led_by(part.lead), below_m)]
        alike += _reached(domain, part, dips) if dips else []
    alike.sort(key=lambda each: each.dip.gap_m)
    for phase in dict.fromkeys(each.phase for each in alike[:MOST]):
        out += _at_places(domain, phase, [each for each in alike[:MOST] if each.phase == phase])
    return out, max(0, len(alike) - MOST)


def _of_chain(domain: SearchDomain, near: list[Interval], below_m: float) -> list[_Dip]:
    """Return the dips of all pairs that were cleared with the whole chain."""
    out: list[_Dip] = []
    ends = domain.start_m, domain.stop_m
    for span in _spans([(each.start_m, each.stop_m) for each in near]):
        low, high = sorted(domain.gone_at(0, along_m, ends) for along_m in span)

        def gaps_at(places: Floats, pairs: Ints) -> Floats:
            return _gaps(domain.chains(places), domain, 0, pairs)

        brackets = []
        for places in _grids(max(low - _SPACING_M, min(ends)), min(high + _SPACING_M, max(ends)), _SPACING_M):
            chain = domain.chains(places)
            pairs = np.stack(swept_pairs(benches_of(chain, domain.dragon, axes_of(chain)).corners, below_m), axis=1)
            if pairs.size:
                brackets.append(_bracketed(places, pairs, _gaps(chain, domain, 0, pairs), below_m))
        out += _dips(gaps_at, brackets, below_m)
    return out


def _of_class(domain: SearchDomain, part: LeadingBenches, proof: Sequence[Interval], below_m: float) -> Iterator[_Dip]:
    """Yield the dips between a class's first bench and the benches behind it, at polar angles of its front handle."""
    segment, origin_m, lead = domain.track.segments[0], domain.track.origins_m[0], part.lead
    links_m = domain.dragon.link_lengths_m
    ends = [(segment.after(each.start_m - origin_m).hi, segment.after(each.stop_m - origin_m).hi) for each in proof]
    if not ends:
        return
    least, most = min(map(min, ends)), max(map(max, ends))
    for low, high in _spans([pair for pair, each in zip(ends, proof, strict=True) if each.bound_m < below_m]):
        step = _SPACING_M / abs(segment.rate(high))
        behind = part.sampler(np.array([low, high])).follow

        def gaps_at(places: Floats, pairs: Ints, behind: int = behind) -> Floats:
            leaders = np.zeros(places.size, dtype=np.int64), places, np.zeros_like(places)
            chain = marched_many(domain.track, links_m[lead:lead + behind], leaders, BEHIND)
            return _gaps(chain, domain, lead, pairs)

        pairs = np.stack((np.full(behind - 2, lead), lead + 2 + np.arange(behind - 2)), axis=1)
        grids = _grids(max(low - step, least), min(high + step, most), step) if pairs.size else ()
        yield from _dips(gaps_at, [_bracketed(places, pairs, gaps_at(places, pairs), below_m) for places in grids],
                         below_m)


def _gaps(chain: Chain, domain: SearchDomain, first: int, pairs: Ints) -> Floats:
    """Return the gaps (M, K) of pairs (K, 2), or (M, 1) of pairs (M, 1, 2), in M chains behind bench ``first``."""
    dragon, count = domain.dragon, chain.links_m.size
    centre = 0.5 * (chain.p[:, :-1] + chain.p[:, 1:])
    half_length = np.broadcast_to(0.5 * dragon.bench_lengths_m[first:first + count], centre.shape[:2])
    benches = Benches(centre, axes_of(chain), half_length, np.full(centre.shape[:2], 0.5 * dragon.width_m))
    row = np.arange(centre.shape[0])[:, None]
    return gaps(benches, (row, pairs[..., 0] - first), (row, pairs[..., 1] - first))


def _spans(ends: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return intervals in increasing order, merged if they overlap or adjoin."""
    out: list[tuple[float, float]] = []
    for low, high in sorted((min(pair), max(pair)) for pair in ends):
        if out and low <= out[-1][1]:
            out[-1] = out[-1][0], max(high, out[-1][1])
        else:
            out.append((low, high))
    return out


def _grids(low: float, high: float, step: float) -> Iterator[Floats]:
    """Yield equidistant positions in parts that overlap by two positions, so that no dip falls between parts."""
    places = np.linspace(low, high, max(3, 2 + int((high - low) / step)), dtype=np.float64)
    for start in range(0, places.size - 2, _AT_ONCE - 2):
        yield places[start:start + _AT_ONCE]


def _bracketed(places: Floats, pairs: Ints, gap_m: Floats, below_m: float) -> tuple[Ints, Floats, Floats]:
    """Return the pairs (D, 2) with minima in gaps (M, K) at positions (M,), and the positions around each minimum."""
    low, sides = gap_m[1:-1], (gap_m[:-2], gap_m[2:])
    dip = (low <= sides[0]) & (low <= sides[1]) & (low + _SHALLOW_M < np.maximum(*sides))
    row, column = np.nonzero(dip & (low < below_m + _LIPSCHITZ * _SPACING_M))
    return pairs[column], places[row], places[row + 2]


def _dips(gaps_at: Gaps, brackets: list[tuple[Ints, Floats, Floats]], below_m: float) -> list[_Dip]:
    """Return the minima in brackets whose gaps are below the threshold."""
    out: list[_Dip] = []
    if not brackets:
        return out
    pairs, left, right = (np.concatenate(part) for part in zip(*brackets, strict=True))
    for start in range(0, len(pairs), _REFINED):
        part = slice(start, start + _REFINED)
        own = pairs[part, None]

        def gap_of(places: Floats, own: Ints = own) -> Floats:
            return gaps_at(places, own)[:, 0]

        found, least = _lowest(gap_of, left[part], right[part])
        rows = zip(pairs[part].tolist(), found.tolist(), least.tolist(), strict=True)
        out += [_Dip((i, j), place, gap_m) for (i, j), place, gap_m in rows if gap_m < below_m]
    return out


def _lowest(function: Callable[[Floats], Floats], left: Floats, right: Floats) -> tuple[Floats, Floats]:
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


def _reached(domain: SearchDomain, part: LeadingBenches, dips: list[_Dip]) -> list[_ClassDip]:
    """Return each dip of a class's first bench for all benches of the class that reach it, phase by phase."""
    out: list[_ClassDip] = []
    phases, ends = domain.phases(domain.stop_m)
    for (start, stop), here, there in zip(pairwise(phases), ends[:-1], ends[1:], strict=True):
        for dip in dips:
            last = domain.dragon.benches - 1 - (dip.pair[1] - dip.pair[0])
            bench = np.array([each for each in part.benches if each <= last])
            crossed = bench[(here[bench] - dip.place) * (there[bench] - dip.place) < 0]
            out += [_ClassDip(dip, one, (start, stop)) for one in crossed.tolist()]
    return out


def _at_places(domain: SearchDomain, phase: tuple[float, float], alike: list[_ClassDip]) -> list[_Dip]:
    """Return dips with the leader positions at which benches reach them during a phase."""
    segment, origin_m = domain.track.segments[0], domain.track.origins_m[0]
    along_m = origin_m + segment.metres(np.array([each.dip.place for each in alike]))
    gone_m = _gone_at(domain, np.array([each.bench for each in alike]), along_m, phase)
    return [_Dip((each.bench, each.bench + each.dip.pair[1] - each.dip.pair[0]), place, each.dip.gap_m)
            for each, place in zip(alike, gone_m.tolist(), strict=True)]


def _gone_at(domain: SearchDomain, bench: Ints, along_m: Floats, within: tuple[float, float]) -> Floats:
    """Return the leader positions at which front handles of benches (M,) are at distances (M,) along the track."""
    row, gone_m = np.arange(bench.size), np.full(bench.size, 0.5 * sum(within))
    missing = np.zeros(bench.size)
    for _ in range(_NEWTON if bench.size else 0):
        chain = domain.chains(gone_m)
        speed = np.sum(chain.velocities(np.ones(bench.size)) * chain.headings, axis=-1)[row, bench]
        missing = along_m - domain.track.distances(chain.segment, chain.u)[row, bench]
        if np.all(np.abs(missing) < _THERE_M):
            break
        gone_m = np.clip(gone_m + missing / np.where(speed == 0, 1.0, speed), min(within), max(within))
    for n in np.flatnonzero(np.abs(missing) >= _THERE_M).tolist():
        gone_m[n] = domain.gone_at(int(bench[n]), float(along_m[n]), within)
    return gone_m


def _of_obstacles(domain: SearchDomain, below_m: float) -> list[_Dip]:
    """Return the ``MOST`` deepest dips between benches and obstacles in each phase, with leader positions."""
    from dragon_ros.core.search.bounding_box import by_length
    from dragon_ros.core.search.obstacle_bounds import ObstacleBounds
    from dragon_ros.core.search.obstacle_contact import phases, swept_bench, windows_of
    out: list[_Dip] = []
    assert domain.around
    for phase in phases(domain, domain.stop_m):
        here, there = (domain.along_m(end) for end in phase)
        alike: list[tuple[float, int, int, float]] = []
        for benches in by_length(domain.dragon.bench_lengths_m):
            windows = windows_of(domain, benches, phase, _COARSE_M) if benches.size else []
            bounds = ObstacleBounds(swept_bench(domain, int(benches[0])), domain.around) if windows else None
            for span in _spans([(window.places[0], window.places[-1]) for window in windows]):
                assert bounds
                for number, place, gap_m in _obstacle_dips(bounds, span, below_m):
                    there_too = benches[(here[benches] - place) * (there[benches] - place) < 0].tolist()
                    alike += [(gap_m, bench, number, place) for bench in there_too]
        alike = sorted(alike)[:MOST]
        gone_m = _gone_at(domain, np.array([one[1] for one in alike], dtype=np.int64),
                          np.array([one[3] for one in alike]), phase)
        out += [_Dip((bench, domain.dragon.benches + number), gone, gap_m)
                for (gap_m, bench, number, _), gone in zip(alike, gone_m.tolist(), strict=True)]
    return out


def _obstacle_dips(bounds: 'ObstacleBounds', span: tuple[float, float], below_m: float
                   ) -> Iterator[tuple[int, float, float]]:
    """Yield the obstacle, the front handle's position and the gap of each dip of a bench on a span of the track."""
    from dragon_ros.core.search.obstacle_bounds import corners_of
    places = np.linspace(*span, 2 + int((span[1] - span[0]) / _COARSE_M))
    states = bounds.bench.states(places)
    corners, first = corners_of(states), np.arange(places.size - 1)
    way = 0.5 * np.max(bounds.ways(states.rows(first), states.rows(first + 1)), axis=1)
    near, _ = bounds.around.in_boxes(*_boxes(np.concatenate((corners[:-1], corners[1:]), axis=1), way + below_m))
    for low, high in _spans([(places[n], places[n + 1]) for n in np.unique(near).tolist()]):
        for fine in _grids(max(low - _SPACING_M, span[0]), min(high + _SPACING_M, span[1]), _SPACING_M):
            row, edge = bounds.around.in_boxes(*_boxes(corners_of(bounds.bench.states(fine)),
                                                       np.full(fine.size, below_m + _LIPSCHITZ * _SPACING_M)))
            number = bounds.around.owner[edge]
            gap_m = np.full((fine.size, len(bounds.around.names)), np.inf)
            np.minimum.at(gap_m, (row, number), bounds.gaps(bounds.bench.states(fine).rows(row), edge))
            pairs = np.stack((np.zeros(gap_m.shape[1], dtype=np.int64), np.arange(gap_m.shape[1])), axis=1)
            found, left, right = _bracketed(fine, pairs, gap_m, below_m)
            for (_, n), a, b in zip(found.tolist(), left.tolist(), right.tolist(), strict=True):
                own = np.unique(edge[number == n])
                place, least = _lowest(partial(_least, bounds, own), np.array([a]), np.array([b]))
                if least[0] < below_m:
                    yield n, float(place[0]), float(least[0])


def _least(bounds: 'ObstacleBounds', edges: Ints, places: Floats) -> Floats:
    """Return the smallest gap to a set of edges at positions (M,)."""
    row = np.repeat(np.arange(places.size), edges.size)
    gap_m = bounds.gaps(bounds.bench.states(places).rows(row), np.tile(edges, places.size))
    out: Floats = np.min(gap_m.reshape(places.size, -1), axis=1)
    return out


def _boxes(corners: Complexes, reach_m: Floats) -> tuple[Floats, Floats]:
    """Return the lower left and upper right corners (M, 2) of boxes around points (M, K), widened by ``reach_m``."""
    low = np.stack((np.min(corners.real, axis=1), np.min(corners.imag, axis=1)), axis=1) - reach_m[:, None]
    high = np.stack((np.max(corners.real, axis=1), np.max(corners.imag, axis=1)), axis=1) + reach_m[:, None]
    return low, high


def _at_reversals(scene: Scene, travel: RangeOfTravel, below_m: float) -> Iterator[NearMiss]:
    """Yield the near misses at the positions where the leader reverses."""
    for t_s, sense in travel.reversals:
        domain, gone_m = SearchDomain(scene, travel, sense, lambda states: None), travel.gone_m(t_s)
        benches = domain.benches(gone_m)
        i, j = candidates(domain.chain(gone_m).p, benches, below_m)
        gap, before = gaps(benches, i, j), gaps(domain.benches(gone_m - sense * _CLOSING_M), i, j)
        unsure = 2 * domain.error_m * (domain.levers[i] + domain.levers[j])
        for n in np.flatnonzero((gap < below_m) & (before - gap > unsure)).tolist():
            yield NearMiss((int(i[n]), int(j[n])), t_s, float(gap[n]))
        if domain.around:
            bench, number, gap = domain.around.closest(benches, below_m)
            earlier = domain.benches(gone_m - sense * _CLOSING_M)
            before = np.array([domain.around.gap_to(earlier, *pair) for pair in zip(
                bench.tolist(), number.tolist(), strict=True)])
            unsure = 2 * domain.error_m * domain.levers[bench]
            for n in np.flatnonzero((gap < below_m) & (before - gap > unsure)).tolist():
                yield NearMiss((int(bench[n]),), t_s, float(gap[n]), domain.around.names[number[n]])
