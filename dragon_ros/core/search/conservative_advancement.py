"""Lower bounds on the gap between any two benches of the whole chain while the leader moves over a step.

The larger of two bounds is used. Both bounds hold if no link can lock. All handles then move along the track in the
leader's direction, so between two states handle i moves by exactly the distance D_i between its positions. A point of a
bench at a fraction t of the way between its handles moves by at most (1 - t) D_i + t D_(i+1). A point at a distance e
beside or beyond the link moves further by at most e times the bench's rotation, which is at most (D_i + D_(i+1)) / 2
times the track's largest curvature. If two benches met between the two states, the points that meet would be at least
the gap apart in each state, so together they would have to move by at least the sum of both gaps.

The further benches move, the looser the first bound becomes, even if they move together. The second bound is used for
pairs that the first bound does not clear. The second bound becomes looser with the square of the step, and only if
benches move relative to each other: over a step h no corner deviates from the line between its positions at both ends
by more than B h^2 / 8, with B from ``on_track``. The proofs are in docs/contact.md. All bounds are rounded outwards:
gaps and separations by ``signed_distance.rounding_m``, motions by the factor ABOVE.
"""
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from dragon_ros.core.enclosures.on_spiral import ABOVE
from dragon_ros.core.geometry.broad_phase import pairs_on_steps
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps, parted_between, placement, rounding_m
from dragon_ros.core.numerics.types import Array, Floats, Ints
from dragon_ros.core.search.certificate import ALL, Interval
from dragon_ros.core.search.driver import Judgement, clear, parts_for
from dragon_ros.core.search.search_domain import Bracket, SearchDomain
from dragon_ros.core.tracks.segments import BEHIND

_TOLERANCE = 4          # tolerance as a multiple of the position error: two benches, each at two states
# The spacing of the first states, relative to the longest bench; with a larger spacing, pairs two benches apart could
# not be cleared.
_SPACING = 0.3
# The smallest fraction of this spacing for later roots. Roots are cut anyway, and still shorter roots would have few
# pairs within reach.
_LEAST_SPACING = 0.05
_PARTS_OF_ROOT = 1.05  # desired number of parts per root; the length of roots is adapted to it from block to block
_FINER = 0.25           # smallest factor by which the length of roots is adapted; the largest factor is the inverse
_MOST = 2_000_000       # maximum number of first intervals; a search with so many takes a few hours
_FINEST = 1e-3, 1e-8    # shortest intervals near a contact and near a grazing, relative to min(1 m, longest bench)
_REACH = 1.25           # reach of a root, relative to the motion of two benches; other pairs keep a fifth of their gap
_SHORTEST = 0.1    # shortest interval of ``prove``, relative to the tolerance; gaps before a contact are larger
_FAR = 0.05             # added to the reach, relative to the longest bench, for a positive bound if benches rest
_AT_ONCE = 2**17        # maximum number of benches that are sampled together, to save memory
_FEW = 8                # number of roots in the first block; each later block has twice as many
_SETTLED = 0.5          # a bound above this fraction of the gap is not recomputed for the parts of its interval
_STILL_M = 1e-200       # avoids a division by zero if two states round to the same position


@dataclass(frozen=True)
class ChainSamples:
    """States of a chain with N benches at M leader positions: handles (M, N+1) and the rectangles of the benches.

    ``along_m`` holds each handle's distance along the track; ``headings``, ``curvature`` (1/m) and ``segment`` (an
    index) describe the track at each handle.
    """

    places: Floats
    p: Floats
    along_m: Floats
    headings: Floats
    curvature: Floats
    segment: Ints
    centre: Floats
    axis: Floats

    def rows(self, index: Ints) -> 'ChainSamples':
        """Return a subset of the states."""
        return ChainSamples(*(getattr(self, name)[index] for name in _FIELDS))


_FIELDS = tuple(each.name for each in fields(ChainSamples))


class _ChainIntervals:
    """The space of leader positions for ``clear``; pairs are found once per root and filtered for each of its parts.

    A group is a set of pairs, with a bound on the gaps of all other pairs in an interval. The group of a root holds the
    pairs within reach. If the bound on a pair's gap in an interval is not far below the gaps at both ends, the pair
    counts as cleared on all parts of the interval and is left out of the groups of these parts.
    """

    def __init__(self, domain: SearchDomain, only_beyond: bool, heads_m: dict[float, float]) -> None:
        dragon = domain.dragon
        self._domain, self._only_beyond, self._heads_m = domain, only_beyond, heads_m
        self.tolerance_m = _TOLERANCE * domain.error_m
        self._excess_m = 2 * domain.error_m * (domain.levers - 1)      # errors of corners in excess of those of handles
        self._half = 0.5 * dragon.bench_lengths_m, np.full(dragon.benches, 0.5 * dragon.width_m)
        overhang = np.hypot(0.5 * (dragon.bench_lengths_m - dragon.link_lengths_m), 0.5 * dragon.width_m)
        self._turning, self._far_m = 0.5 * domain.track.bend * overhang, _FAR * float(np.max(dragon.bench_lengths_m))
        self._rounding_m = float(rounding_m(domain.simulation.size_m, 0.5 * float(np.max(
            dragon.bench_lengths_m + dragon.width_m))))
        self._pairs: tuple[Ints, Ints] = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        self._first: Ints = np.empty(0, dtype=np.int64)     # the index of each group's first pair
        self._count: Ints = np.empty(0, dtype=np.int64)
        self._others_m: Floats                              # bounds on the gaps of the pairs outside each group

    def sample(self, places: Floats, _: Ints) -> ChainSamples:
        """Return the samples at leader positions."""
        at_once = max(1, _AT_ONCE // self._domain.dragon.benches)
        return self.joined([self._sample(places[n:n + at_once]) for n in range(0, places.size, at_once)])

    def _sample(self, places: Floats) -> ChainSamples:
        domain = self._domain
        domain.count(places.size)
        chain = domain.chains(places)
        benches = benches_of(chain, domain.dragon, axes_of(chain))
        along_m = domain.track.distances(chain.segment, chain.u)
        self._heads_m.update(zip(places.tolist(), along_m[:, 0].tolist(), strict=True))
        return ChainSamples(places, chain.p, along_m, chain.headings, domain.track.curvatures(chain.segment, chain.u),
                            chain.segment, benches.centre, benches.axis)

    def joined(self, parts: list[ChainSamples]) -> ChainSamples:
        """Concatenate samples."""
        return ChainSamples(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))

    def begin(self, samples: ChainSamples, pairs: Ints, _: Ints) -> None:
        """Find the pairs that come close to each other on each root."""
        moved_m = np.max(self._moved(samples.rows(pairs[0]), samples.rows(pairs[1])), axis=1)
        reach_m = _REACH * 2 * moved_m + self._far_m
        found = [*self._near(samples, pairs, reach_m)]
        self._count = np.array([i.size for i, _ in found])
        self._first = np.cumsum(self._count) - self._count
        self._pairs = np.concatenate([i for i, _ in found]), np.concatenate([j for _, j in found])
        self._others_m = reach_m - 2 * moved_m - 2 * np.max(self._excess_m)

    def _near(self, samples: ChainSamples, pairs: Ints, reach_m: Floats) -> Iterator[tuple[Ints, Ints]]:
        """Yield the pairs to examine on each root: all pairs within reach that no other part of the search covers."""
        corners = Benches(samples.centre, samples.axis, *self._half).corners
        low, high = corners.min(axis=2), corners.max(axis=2)
        low, high = np.minimum(*(low[rows] for rows in pairs)), np.maximum(*(high[rows] for rows in pairs))
        beyond = np.any(samples.segment[pairs] > 0, axis=0)
        for (i, j), there in zip(pairs_on_steps(low, high, reach_m), beyond, strict=True):
            keep = there[i] if self._only_beyond else slice(None)
            yield i[keep], j[keep]

    def _moved(self, a: ChainSamples, b: ChainSamples) -> Floats:
        """Return bounds (M, N) on the distance that any point of each bench moves between samples."""
        way_m = np.abs(b.along_m - a.along_m)
        out: Floats = np.maximum(way_m[:, :-1], way_m[:, 1:]) + self._turning * (way_m[:, :-1] + way_m[:, 1:])
        return ABOVE * out

    def judge(self, a: ChainSamples, b: ChainSamples, group: Ints) -> Judgement:
        """Bound the gaps on each interval, and choose the number of its parts from its room.

        The room of an interval is the fraction of its length to which it would have to shrink to be cleared.
        """
        moved_m, size = self._moved(a, b), self._count[group]
        row = np.repeat(np.arange(group.size), size)
        at = np.arange(row.size) - np.repeat(np.cumsum(size) - size, size) + np.repeat(self._first[group], size)
        i, j = self._pairs[0][at], self._pairs[1][at]
        gap_a, gap_b, moving_m = self._gaps(a, row, i, j), self._gaps(b, row, i, j), moved_m[row, i] + moved_m[row, j]
        excess_m = self._excess_m[i] + self._excess_m[j]
        low_m = 0.5 * (gap_a + gap_b - moving_m) - self._rounding_m - excess_m
        room = (gap_a + gap_b) / np.maximum(moving_m, _STILL_M)
        left = np.flatnonzero(low_m <= self.tolerance_m)
        if left.size:
            bent_m, bent_room = self._bent(a, b, row[left], i[left], j[left])
            low_m[left] = np.maximum(low_m[left], bent_m - excess_m[left])
            room[left] = np.maximum(room[left], bent_room)
        bound_m, least = self._others_m[group], np.full(group.size, 1.0)
        np.minimum.at(bound_m, row, low_m)
        np.minimum.at(least, row, room)
        touching = np.zeros((2, group.size), dtype=bool)
        for end, gap in enumerate((gap_a, gap_b)):
            touching[end, row[gap <= 0]] = True
        settled = low_m > np.maximum(self.tolerance_m, _SETTLED * np.minimum(gap_a, gap_b))
        rest = self._without(settled, at, row, low_m, group, np.flatnonzero(bound_m <= self.tolerance_m))
        return Judgement(bound_m, touching, parts_for(least), rest)

    def _without(self, settled: Array, at: Ints, row: Ints, low_m: Floats, group: Ints, which: Ints) -> Ints:
        """Return the groups (M,) of intervals; the intervals ``which`` get new groups without the settled pairs."""
        out: Ints = group.copy()
        others_m = self._others_m[group]
        np.minimum.at(others_m, row[settled], low_m[settled])
        left = ~settled & np.isin(row, which)
        count = np.bincount(row[left], minlength=group.size)[which]
        out[which] = self._count.size + np.arange(which.size)
        self._first = np.concatenate((self._first, self._pairs[0].size + np.cumsum(count) - count))
        self._count = np.concatenate((self._count, count))
        self._others_m = np.concatenate((self._others_m, others_m[which]))
        i, j = self._pairs
        self._pairs = np.concatenate((i, i[at[left]])), np.concatenate((j, j[at[left]]))
        return out

    def _bent(self, a: ChainSamples, b: ChainSamples, row: Ints, i: Ints, j: Ints) -> tuple[Floats, Floats]:
        """Return second-order lower bounds on the gaps of pairs, and the room of each pair."""
        # Imported here because dragons that wind in on one spiral need only ``leading_benches``.
        from dragon_ros.core.enclosures.on_track import kinematics, link_states, second_derivatives, views
        domain = self._domain
        used, row = np.unique(row, return_inverse=True)
        a, b = a.rows(used), b.rows(used)
        leader = 0 if domain.leader.direction == BEHIND else -1
        one, two = (link_states(each.along_m, each.segment, each.curvature, each.headings, each.axis, leader)
                    for each in (a, b))
        moving = kinematics(one, two, domain.dragon.link_lengths_m, domain.track.bends, leader, domain.error_m)
        gone_m = np.abs(b.places - a.places)[row]
        seen = [views(each.p, each.axis, each.headings, row, i, j) for each in (a, b)]
        most = second_derivatives(moving, seen[0], seen[1], row, i, j, gone_m, np.hypot(*self._half))
        first, second = (ABOVE * each * (gone_m * gone_m / 8) + self._rounding_m for each in most)
        low_m, ratio = parted_between([placement(*self._rectangles(each, row, i, j)) for each in (a, b)],
                                      (first, second))
        return low_m, np.sqrt(ratio)

    def _gaps(self, samples: ChainSamples, row: Ints, i: Ints, j: Ints) -> Floats:
        return gaps(*self._rectangles(samples, row, i, j))

    def _rectangles(self, samples: ChainSamples, row: Ints, i: Ints, j: Ints) -> tuple[Benches, Ints, Ints]:
        """Return the benches of all states as one ``Benches``, and each pair's two indices in it."""
        states, count = samples.places.size, self._domain.dragon.benches
        half_length, half_width = (np.tile(half, states) for half in self._half)
        benches = Benches(samples.centre.reshape(-1, 2), samples.axis.reshape(-1, 2), half_length, half_width)
        return benches, row * count + i, row * count + j

    def lengths_m(self, start: Floats, stop: Floats) -> Floats:
        """Return how far the leader moves on each interval."""
        return np.abs(stop - start)


class WholeChain:
    """All pairs of a domain, or those not covered by ``LeadingBenches``, with the part cleared so far."""

    def __init__(self, domain: SearchDomain, only_beyond: bool) -> None:
        """Cover a domain; ``only_beyond`` excludes pairs whose inner bench is on the first segment."""
        self._domain, self._only_beyond, self.tolerance_m = domain, only_beyond, _TOLERANCE * domain.error_m
        longest_m = float(np.max(domain.dragon.bench_lengths_m))
        self._spacing_m, self._finest_m = _SPACING * longest_m, tuple(one * min(1.0, longest_m) for one in _FINEST)
        self._rows: list[tuple[float, float, float]] = []
        self._heads_m: dict[float, float] = {}      # the head's distance along the track at each leader position
        self._hit: Bracket | None = None

    @property
    def searchable_m(self) -> float:
        """The leader position up to which the number of first intervals is acceptable."""
        domain, most_m = self._domain, _MOST * self._spacing_m
        near = abs(domain.stop_m - domain.start_m) <= most_m
        return domain.stop_m if near else domain.start_m + domain.sense * most_m

    def clear(self, stop_m: float) -> Bracket | None:
        """Clear all pairs up to a leader position; return the first bracket that is not clear."""
        self._rows, self._hit = [], None
        self._go_on(self._domain.start_m, stop_m)
        return self._hit

    def prove(self, stop_m: float) -> Bracket | None:
        """Clear up to an earlier position than before; return the first bracket that is not clear."""
        sense = self._domain.sense
        kept = [row for row in self._rows if sense * row[0] < sense * stop_m]
        self._rows = [(start, sense * min(sense * stop, sense * stop_m), bound) for start, stop, bound in kept]
        if self._hit:
            self._hit = None
            self._go_on(self._rows[-1][1] if self._rows else self._domain.start_m, stop_m,
                        (_SHORTEST * self.tolerance_m,))
        return self._hit

    def intervals(self) -> Iterator[Interval]:
        """Yield the cleared intervals for the certificate."""
        for start, stop, bound_m in self._rows:
            yield Interval(ALL, self._head_m(start), self._head_m(stop), self._domain.dragon.benches - 1, bound_m)

    def _head_m(self, place: float) -> float:
        """Return the head's distance along the track at a leader position."""
        if place not in self._heads_m:
            self._heads_m[place] = float(self._domain.along_m(place)[0])
        return self._heads_m[place]

    def _go_on(self, start_m: float, stop_m: float, finest_m: tuple[float, ...] | None = None) -> None:
        """Clear from one position to another, block by block, until a position cannot be cleared."""
        here_m, stop_m = (self._within(place) for place in (start_m, stop_m))
        most, spacing_m = max(1, _AT_ONCE // self._domain.dragon.benches), self._spacing_m
        size = min(_FEW, most)
        while here_m != stop_m and not self._hit:
            left = max(1, int(abs(stop_m - here_m) / spacing_m + 0.5))
            count = min(size, left)
            end_m = stop_m if count == left else here_m + count / left * (stop_m - here_m)
            places = np.linspace(here_m, end_m, count + 1)
            space = _ChainIntervals(self._domain, self._only_beyond, self._heads_m)
            cleared = clear(space, [places], finest_m or self._finest_m)[0]
            self._rows += cleared.rows
            self._hit = Bracket(*cleared.hit) if cleared.hit else None
            finer = min(max(_PARTS_OF_ROOT * count / max(1, len(cleared.rows)), _FINER), 1 / _FINER)
            spacing_m = min(max(spacing_m * finer, _LEAST_SPACING * self._spacing_m), self._spacing_m)
            here_m, size = end_m, min(2 * size, most)

    def _within(self, place_m: float) -> float:
        """Return a position or, if only benches beyond the first segment count, the nearest one with such benches."""
        domain = self._domain
        if not self._only_beyond:
            return place_m
        ends = domain.start_m, domain.stop_m
        joint_m = domain.track.joints_m[0] if domain.track.joints_m else np.inf
        inside = [float(domain.along_m(end)[0]) <= joint_m for end in ends]
        if all(inside):
            return domain.start_m
        if not any(inside):
            return place_m
        crossing = domain.gone_at(0, joint_m, ends)
        return (max if domain.leader.direction == BEHIND else min)(place_m, crossing)
