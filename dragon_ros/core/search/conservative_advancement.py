"""Clears all pairs of benches while the leader moves, interval by interval: conservative advancement of the chain.

An interval is clear if, for each pair, one of these lower bounds on the gap exceeds the search's tolerance. They are
tried in this order, and the proofs are in docs/contact.md.

*Layers:* far enough from the centre of a first spiral, a bench cannot touch any bench behind it (``layers``). Stretches
of travel on which this holds for all benches are cleared without further states. *Repeats:* a pair that stands exactly
as another pair stood earlier in the search is clear already (``repeats``). *By motion:* between two states handle i
moves by exactly the distance D_i between its places, so a point of a bench at a fraction t of the way between its
handles moves by at most (1 - t) D_i + t D_(i+1), and a point at a distance e beside or beyond the link by at most e
times the bench's rotation more (``swing_rad``). If two benches met between the states, the points that meet would
together have to move by at least the sum of both gaps. *By acceleration:* over a step h no corner deviates from the
line between its positions at both ends by more than B h^2 / 8, with B from ``on_track``. This deviation shrinks with
the square of the step, and only matters if benches move relative to each other.

All bounds are rounded outwards: gaps and separations by ``signed_distance.rounding_m``, motions by the factor ABOVE.
They require that each handle moves in one direction, so the travel is split where a handle turns back.
"""
from collections.abc import Iterator
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from dragon_ros.core.enclosures.ball_arithmetic import ABOVE
from dragon_ros.core.enclosures.layers import Layers
from dragon_ros.core.enclosures.on_track import (
    LinkStates,
    kinematics,
    largest_curvatures,
    link_states,
    second_derivatives,
    swing_rad,
    views,
)
from dragon_ros.core.geometry.broad_phase import boxes_within
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.geometry.signed_distance import gaps, parted_between, placement, rounding_m
from dragon_ros.core.numerics.types import Array, Floats, Index, Ints
from dragon_ros.core.search.certificate import Interval
from dragon_ros.core.search.driver import Bracket, Judgement, clear, counted, parts_for
from dragon_ros.core.search.repeats import Repeats
from dragon_ros.core.search.search_domain import SearchDomain
from dragon_ros.core.tracks.segments import BEHIND

# The spacing of the first states, relative to the longest bench; with a larger spacing, pairs two benches apart could
# not be cleared.
_SPACING = 0.3
# The smallest fraction of this spacing for later roots. Roots are cut anyway, and still shorter roots would have few
# pairs within reach.
_LEAST_SPACING = 0.05
_PARTS_OF_ROOT = 1.05  # desired number of parts per root; the length of roots is adapted to it from block to block
_FINER = 0.25           # smallest factor by which the length of roots is adapted; the largest factor is the inverse
_FAR_APART = 8          # shortest stretch that is halved to find where layers are apart, relative to the spacing
_FINEST_M = 1e-3, 1e-8  # shortest intervals near a contact and near a grazing
_REACH = 1.25           # reach of a root, relative to the motion of two benches; other pairs keep a fifth of their gap
_SHORTEST = 0.1    # shortest interval of ``prove``, relative to the tolerance; gaps before a contact are larger
_FAR = 0.05             # added to the reach, relative to the longest bench, for a positive bound if benches rest
_AT_ONCE = 2**17        # maximum number of benches that are sampled together, to save memory
_FEW = 32               # number of roots in the first block; each later block has twice as many
_SETTLED = 0.5          # a bound above this fraction of the gap is not recomputed for the parts of its interval
_STILL_M = 1e-200       # avoids a division by zero if two states round to the same position
_PAIRS = 2**12          # number of pairs that are bounded together, so that intermediate results fit the cache
_LINKS = 2**14          # number of links whose motion is enclosed together


@dataclass(frozen=True)
class ChainSamples:
    """States of a chain with N benches at M leader positions: handles (M, N+1) and the rectangles of the benches.

    ``u`` holds each handle's coordinate on its segment (the polar angle on a spiral), ``along_m`` its distance along
    the track; ``headings``, ``curvature`` (1/m) and ``segment`` (an index) describe the track there.
    """

    places: Floats
    p: Floats
    u: Floats
    along_m: Floats
    headings: Floats
    curvature: Floats
    segment: Ints
    centre: Floats
    axis: Floats

    def rows(self, index: Index) -> 'ChainSamples':
        """Return a subset of the states."""
        return ChainSamples(*(getattr(self, name)[index] for name in _FIELDS))

    def between(self, first: int, after: int) -> 'ChainSamples':
        """Return the states of the benches from ``first`` to ``after`` - 1."""
        handles, links = slice(first, after + 1), slice(first, after)
        return ChainSamples(self.places, self.p[:, handles], self.u[:, handles], self.along_m[:, handles],
                            self.headings[:, handles], self.curvature[:, handles], self.segment[:, handles],
                            self.centre[:, links], self.axis[:, links])


_FIELDS = tuple(each.name for each in fields(ChainSamples))


class ChainIntervals:
    """The space of leader positions for ``clear``; pairs are found once per root and filtered for each of its parts.

    A group is a set of pairs, with a bound on the gaps of all other pairs in an interval. The group of a root holds the
    pairs within reach. If the bound on a pair's gap in an interval is not far below the gaps at both ends, the pair
    counts as cleared on all parts of the interval and is left out of the groups of these parts.
    """

    def __init__(self, domain: SearchDomain) -> None:
        """Prepare the bounds of a domain."""
        dragon, afar = domain.dragon, domain.track.from_afar
        self._domain, self.tolerance_m = domain, domain.tolerance_m
        self._behind = domain.leader.direction == BEHIND
        self._half = dragon.half_sizes_m
        self._arm = np.hypot(*self._half)
        self._overhang_m = np.hypot(0.5 * (dragon.bench_lengths_m - dragon.link_lengths_m), 0.5 * dragon.width_m)
        self._far_m = _FAR * float(np.max(dragon.bench_lengths_m))
        self._rounding_m = float(rounding_m(domain.simulation.size_m, 0.5 * float(np.max(
            dragon.bench_lengths_m + dragon.width_m))))
        self._layers = Layers(afar.curve.b_m, dragon) if afar else None
        self._repeats = Repeats(domain)
        self.forget()

    def forget(self) -> None:
        """Discard all groups."""
        self._pairs: tuple[Ints, Ints] = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
        self._first: Ints = np.empty(0, dtype=np.int64)     # the index of each group's first pair
        self._count: Ints = np.empty(0, dtype=np.int64)
        self._others_m: Floats = np.empty(0)                # bounds on the gaps of the pairs outside each group

    def sample(self, places: Floats) -> ChainSamples:
        """Return the samples at leader positions."""
        at_once = max(1, _AT_ONCE // self._domain.dragon.benches)
        return self.joined([self._sample(places[n:n + at_once]) for n in range(0, places.size, at_once)])

    def _sample(self, places: Floats) -> ChainSamples:
        domain = self._domain
        domain.count(places.size)
        chain = domain.chains(places)
        benches, track = benches_of(chain, domain.dragon, axes_of(chain)), domain.track
        return ChainSamples(places, chain.p, chain.u, track.distances(chain.segment, chain.u), chain.headings,
                            track.curvatures(chain.segment, chain.u), chain.segment, benches.centre, benches.axis)

    def joined(self, parts: list[ChainSamples]) -> ChainSamples:
        """Concatenate samples."""
        return ChainSamples(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))

    def layers_m(self, a: ChainSamples, b: ChainSamples) -> Floats:
        """Return bounds (M, N) on the gaps of benches to all benches behind them, from layers alone, between samples.

        A bound is minus infinity if nothing is proved, and infinite if no bench behind a bench counts.
        """
        bench = np.arange(max(0, self._domain.dragon.benches - 2))
        out: Floats = np.full(a.centre.shape[:2], np.inf)
        out[:, bench] = -np.inf
        if self._layers:
            on_spiral = np.maximum(a.segment, b.segment)[:, bench] == 0
            inner = np.minimum(a.u, b.u)[:, bench]
            out[:, bench] = np.where(on_spiral, self._layers.gaps_m(inner, bench), -np.inf)
        return out

    def begin(self, samples: ChainSamples, pairs: Ints) -> None:
        """Find the pairs that come close to each other on each root."""
        self.forget()
        a, b = (samples.rows(rows) for rows in pairs)
        moved_m, layers_m = np.max(self._moved(a, b), axis=1), self.layers_m(a, b)
        reach_m = _REACH * 2 * moved_m + self._far_m
        found = [*self._near(a, b, reach_m, layers_m > self.tolerance_m)]
        self._count = np.array([i.size for i, _ in found])
        self._first = np.cumsum(self._count) - self._count
        self._pairs = np.concatenate([i for i, _ in found]), np.concatenate([j for _, j in found])
        apart_m = np.min(layers_m, axis=1, where=layers_m > self.tolerance_m, initial=np.inf)
        self._others_m = np.minimum(reach_m - 2 * moved_m, apart_m)

    def _near(self, a: ChainSamples, b: ChainSamples, reach_m: Floats, apart: Array) -> Iterator[tuple[Ints, Ints]]:
        """Yield the pairs to examine on each root: all within reach, except those that layers or repeats clear."""
        corners = [Benches(each.centre, each.axis, *self._half).corners for each in (a, b)]
        low = np.minimum(*(each.min(axis=2) for each in corners))
        high = np.maximum(*(each.max(axis=2) for each in corners))
        first = np.where(apart, self._domain.dragon.benches, self._repeats.first(a.along_m, b.along_m))
        for n, (i, j) in enumerate(boxes_within(low, high, reach_m, first)):
            new = ~self._repeats.repeated(a.along_m[n], b.along_m[n], i, j)
            yield i[new], j[new]

    def _moved(self, a: ChainSamples, b: ChainSamples) -> Floats:
        """Return bounds (M, N) on the distance that any point of each bench moves between samples (lemmas 3 and 4)."""
        domain = self._domain
        moved_m = np.abs(b.along_m - a.along_m) + 2 * domain.error_m
        bend = largest_curvatures(a, b, domain.track.bends)
        swing = swing_rad(bend * (1 + bend * domain.error_m), domain.dragon.link_lengths_m,
                          moved_m[:, :-1] + moved_m[:, 1:])
        return ABOVE * (np.maximum(moved_m[:, :-1], moved_m[:, 1:]) + self._overhang_m * swing)

    def judge(self, a: ChainSamples, b: ChainSamples, group: Ints) -> Judgement:
        """Bound the gaps on each interval, and choose the number of its parts from its room.

        The room of an interval is the fraction of its length to which it would have to shrink to be cleared.
        """
        size = self._count[group]
        row, at = np.repeat(np.arange(group.size), size), np.repeat(self._first[group], size) + counted(size)
        i, j = self._pairs[0][at], self._pairs[1][at]
        gap_a, gap_b, low_m, room = self._by_motion(a, b, row, i, j)
        left = np.flatnonzero(low_m <= self.tolerance_m)
        for some in self._blocks(left, row):
            bent_m, bent_room = self._by_acceleration(a, b, row[some], i[some], j[some])
            low_m[some], room[some] = np.maximum(low_m[some], bent_m), np.maximum(room[some], bent_room)
        bound_m, least = self._others_m[group], np.full(group.size, 1.0)
        np.minimum.at(bound_m, row, low_m)
        np.minimum.at(least, row, room)
        touching = np.zeros((2, group.size), dtype=bool)
        for end, gap in enumerate((gap_a, gap_b)):
            touching[end, row[gap <= 0]] = True
        settled = low_m > np.maximum(self.tolerance_m, _SETTLED * np.minimum(gap_a, gap_b))
        rest = self._without(settled, at, row, low_m, group, np.flatnonzero(bound_m <= self.tolerance_m))
        return Judgement(bound_m, touching, parts_for(least), rest)

    def _by_motion(self, a: ChainSamples, b: ChainSamples, row: Ints, i: Ints, j: Ints
                   ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the gaps of pairs (P,) at both samples, first-order lower bounds on their gaps, and their room."""
        moved_m, out = self._moved(a, b), np.empty((4, row.size))
        for part in _slices(row.size, _PAIRS):
            pairs = row[part], i[part], j[part]
            gap_a, gap_b = (gaps(*self._rectangles(each, *pairs)) for each in (a, b))
            moving_m = moved_m[pairs[0], pairs[1]] + moved_m[pairs[0], pairs[2]]
            both_m = gap_a + gap_b
            out[:, part] = (gap_a, gap_b, 0.5 * (both_m - moving_m) - self._rounding_m,
                            both_m / np.maximum(moving_m, _STILL_M))
        gap_a, gap_b, low_m, room = out
        return gap_a, gap_b, low_m, room

    def _blocks(self, left: Ints, row: Ints) -> Iterator[Ints]:
        """Yield the indices ``left`` of pairs, whose rows ascend, for a limited number of rows at a time."""
        rows, starts = np.unique(row[left], return_index=True)
        most = max(1, _LINKS // self._domain.dragon.benches)
        ends = [*starts[::most].tolist(), left.size]
        for start, stop in pairwise(ends if rows.size else []):
            yield left[start:stop]

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

    def _by_acceleration(self, a: ChainSamples, b: ChainSamples, row: Ints, i: Ints, j: Ints
                         ) -> tuple[Floats, Floats]:
        """Return second-order lower bounds (P,) on the gaps of pairs, and the room of each pair.

        Only the links from the leader to the last bench of any pair are enclosed.
        """
        domain, (used, row) = self._domain, np.unique(row, return_inverse=True)
        first, after = (0, int(j.max()) + 1) if self._behind else (int(i.min()), domain.dragon.benches)
        one, two = (each.rows(used).between(first, after) for each in (a, b))
        i, j = i - first, j - first
        moving = kinematics(self._links(one), self._links(two), domain.dragon.link_lengths_m[first:after],
                            domain.track.bends, 0 if self._behind else -1, domain.error_m)
        moved_m, out = np.abs(two.places - one.places), np.empty((2, row.size))
        for part in _slices(row.size, _PAIRS):
            pairs = row[part], i[part], j[part]
            step_m = moved_m[pairs[0]]
            before, later = (views(each.p, each.axis, each.headings, *pairs) for each in (one, two))
            most = second_derivatives(moving, before, later, *pairs, step_m, self._arm[first:after])
            in_first, in_second = (ABOVE * each * (step_m * step_m / 8) + self._rounding_m for each in most)
            low_m, ratio = parted_between([placement(*self._rectangles(each, *pairs, first)) for each in (one, two)],
                                          (in_first, in_second))
            out[:, part] = low_m, np.sqrt(ratio)
        return out[0], out[1]

    def _links(self, samples: ChainSamples) -> LinkStates:
        return link_states(samples.along_m, samples.segment, samples.curvature, samples.headings, samples.axis,
                           0 if self._behind else -1)

    def _rectangles(self, samples: ChainSamples, row: Ints, i: Ints, j: Ints, first: int = 0
                    ) -> tuple[Benches, Ints, Ints]:
        """Return the benches of all states as one ``Benches``, and each pair's two indices in it.

        The samples start at bench ``first``.
        """
        states, count = samples.centre.shape[:2]
        half_length, half_width = (np.tile(half[first:first + count], states) for half in self._half)
        benches = Benches(samples.centre.reshape(-1, 2), samples.axis.reshape(-1, 2), half_length, half_width)
        return benches, row * count + i, row * count + j


def _slices(size: int, most: int) -> Iterator[slice]:
    """Yield slices of at most ``most`` items."""
    return (slice(start, start + most) for start in range(0, size, most))


class WholeChain:
    """All pairs of benches of a domain, with the part cleared so far."""

    def __init__(self, domain: SearchDomain) -> None:
        """Prepare the search of a domain."""
        self._domain, self._space = domain, ChainIntervals(domain)
        self._spacing_m = _SPACING * float(np.max(domain.dragon.bench_lengths_m))
        self._rows: list[tuple[float, float, float]] = []
        self._hit: Bracket | None = None

    def clear(self, stop_m: float) -> Bracket | None:
        """Clear all pairs up to a leader position; return the first bracket that is not clear."""
        self._rows, self._hit = [], None
        self._go_on(self._domain.start_m, stop_m, _FINEST_M)
        return self._hit

    def prove(self, stop_m: float) -> Bracket | None:
        """Clear up to an earlier position than before; return the first bracket that is not clear."""
        sense = self._domain.sense
        kept = [row for row in self._rows if sense * row[0] < sense * stop_m]
        self._rows = [(start, sense * min(sense * stop, sense * stop_m), bound) for start, stop, bound in kept]
        if self._hit:
            self._hit = None
            self._go_on(self._rows[-1][1] if self._rows else self._domain.start_m, stop_m,
                        (_SHORTEST * self._domain.tolerance_m,))
        return self._hit

    def intervals(self) -> Iterator[Interval]:
        """Yield the cleared intervals for the certificate."""
        if not self._rows:
            return
        domain, ends_m = self._domain, np.array([row[:2] for row in self._rows])
        if self._domain.leader.direction == BEHIND:
            heads_m = domain.leader.start_m + ends_m
        else:
            chain = domain.chains(ends_m.ravel())
            heads_m = domain.track.distances(chain.segment[:, 0], chain.u[:, 0]).reshape(-1, 2)
        for (start_m, stop_m), (_, _, bound_m) in zip(heads_m.tolist(), self._rows, strict=True):
            yield Interval(start_m, stop_m, bound_m)

    def _go_on(self, start_m: float, stop_m: float, finest_m: tuple[float, ...]) -> None:
        """Clear from one position to another, in order, until a position cannot be cleared."""
        for phase in self._domain.phases(start_m, stop_m):
            for here_m, there_m, bound_m in self._stretches(*phase):
                if self._hit:
                    return
                if bound_m > self._domain.tolerance_m:
                    self._rows.append((here_m, there_m, bound_m))
                else:
                    self._search(here_m, there_m, finest_m)

    def _stretches(self, start_m: float, stop_m: float) -> Iterator[tuple[float, float, float]]:
        """Yield stretches in order, each with the bound from layers alone; it is not positive if this proves nothing.

        A stretch is halved as long as layers clear one of its ends, but not the whole stretch.
        """
        if not self._domain.track.from_afar:
            yield start_m, stop_m, -np.inf
            return
        one, two = (self._space.sample(np.array([end])) for end in (start_m, stop_m))
        bound_m = float(np.min(self._space.layers_m(one, two)))
        apart = any(np.min(self._space.layers_m(each, each)) > self._domain.tolerance_m for each in (one, two))
        if bound_m > self._domain.tolerance_m or not apart or abs(stop_m - start_m) <= _FAR_APART * self._spacing_m:
            yield start_m, stop_m, bound_m
            return
        middle_m = 0.5 * (start_m + stop_m)
        yield from self._stretches(start_m, middle_m)
        yield from self._stretches(middle_m, stop_m)

    def _search(self, here_m: float, stop_m: float, finest_m: tuple[float, ...]) -> None:
        """Clear a stretch block by block, until a position cannot be cleared."""
        most, spacing_m = max(1, _AT_ONCE // self._domain.dragon.benches), self._spacing_m
        size = min(_FEW, most)
        while here_m != stop_m and not self._hit:
            left = max(1, int(abs(stop_m - here_m) / spacing_m + 0.5))
            count = min(size, left)
            end_m = stop_m if count == left else here_m + count / left * (stop_m - here_m)
            cleared = clear(self._space, [np.linspace(here_m, end_m, count + 1)], finest_m)[0]
            self._rows += cleared.rows
            self._hit = cleared.hit
            finer = min(max(_PARTS_OF_ROOT * count / max(1, len(cleared.rows)), _FINER), 1 / _FINER)
            spacing_m = min(max(spacing_m * finer, _LEAST_SPACING * self._spacing_m), self._spacing_m)
            here_m, size = end_m, min(2 * size, most)
