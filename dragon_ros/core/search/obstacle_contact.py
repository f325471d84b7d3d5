"""The search for contacts between benches and a venue, along the track and once for all benches of one length.

The pose of a bench depends on its length and on the position of its front handle. For each length, an obstacle
therefore blocks positions on the track, and the first bench of that length to reach a blocked position is the bench
that starts next to it. Each bench therefore has a window: the positions that its front handle passes, up to the start
of the next bench of its length, which is the first to pass the rest of the track. Each window is cleared separately, up
to the first position that cannot be cleared (``driver``, with the bounds of ``obstacle_bounds``); of these positions,
the result is the position that the leader reaches first. If handles turn back near the centre of a spiral, the leader's
travel is split into phases in which each handle moves in one direction.
"""
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from dragon_ros.core.numerics.types import Floats, Ints, distinct
from dragon_ros.core.search.bounding_box import BenchStates, SweptBench, by_length, turning_m
from dragon_ros.core.search.driver import Bracket, Judgement, clear
from dragon_ros.core.search.obstacle_bounds import ObstacleBounds, corners_of
from dragon_ros.core.search.search_domain import SearchDomain

_SPACING = 0.5          # spacing of the first positions, relative to the longest bench
_MOST_PLACES = 50_000   # maximum number of first positions per window, to save memory
_FINEST_M = 1e-3, 1e-8  # shortest intervals near a contact and near a grazing
_SHORTEST = 0.1         # shortest interval of ``prove``, relative to the tolerance; gaps before a contact are larger
_FAR = 0.05             # edges that stay further away than this multiple of the longest bench are not examined
_PARTS = 3              # number of parts into which an interval is cut
_LONG = 6.0             # longest bounded move, relative to the longest bench; longer moves would involve too many edges


@dataclass(frozen=True)
class _Samples:
    """The states of a bench whose front handle is at positions (M,) on the track."""

    places: Floats
    states: BenchStates

    def rows(self, index: Ints) -> '_Samples':
        """Return a subset of the samples."""
        return _Samples(self.places[index], self.states.rows(index))


class _SweptIntervals:
    """The space of track intervals for ``clear``; the edges near a bench are found with bounding boxes of intervals."""

    def __init__(self, bounds: ObstacleBounds, tolerance_m: float, longest_m: float,
                 count: Callable[[int], None]) -> None:
        self.tolerance_m, self._bounds, self._longest_m, self._count = tolerance_m, bounds, longest_m, count

    def sample(self, places: Floats) -> _Samples:
        """Return the samples at the given positions."""
        self._count(places.size)
        return _Samples(places, self._bounds.bench.states(places))

    def joined(self, parts: list[_Samples]) -> _Samples:
        """Concatenate samples."""
        return _Samples(np.concatenate([part.places for part in parts]), _joined([part.states for part in parts]))

    def begin(self, samples: _Samples, pairs: Ints) -> None:
        """Ignore the roots, because the edges near a bench are searched for in each interval."""

    def judge(self, a: _Samples, b: _Samples, group: Ints) -> Judgement:
        """Bound the gaps of benches to edges; edges that stay further away than ``_FAR`` are not examined."""
        far_m, bounds = _FAR * self._longest_m + 2 * self.tolerance_m, self._bounds
        moved_m = np.max(bounds.motions_m(a.states, b.states), axis=1)
        short = np.flatnonzero(moved_m <= _LONG * self._longest_m)
        bound_m = np.where(moved_m <= _LONG * self._longest_m, far_m, -np.inf)
        touching = np.zeros((2, group.size), dtype=bool)
        if short.size:
            row, edge = self._near(a.states.rows(short), b.states.rows(short), 0.5 * moved_m[short] + far_m)
            row = short[row]
            ends = a.states.rows(row), b.states.rows(row)
            gaps = bounds.gaps(ends[0], edge), bounds.gaps(ends[1], edge)
            np.minimum.at(bound_m, row, bounds.bounds(*ends, gaps, edge))
            for end, gap_m in enumerate(gaps):
                touching[end, row[gap_m <= 0]] = True
        return Judgement(bound_m, touching, np.full(group.size, _PARTS), group)

    def _near(self, a: BenchStates, b: BenchStates, reach_m: Floats) -> tuple[Ints, Ints]:
        """Return pairs of an interval and an edge that the bench may come close to in that interval."""
        corners = np.concatenate((corners_of(a), corners_of(b)), axis=1)
        ends = [op(part, axis=1) for op in (np.min, np.max) for part in (corners.real, corners.imag)]
        low, high = np.stack(ends[:2], axis=1) - reach_m[:, None], np.stack(ends[2:], axis=1) + reach_m[:, None]
        return self._bounds.around.in_boxes(low, high)


def _joined(parts: list[Any]) -> Any:
    """Concatenate states, field by field."""
    first = parts[0]
    if isinstance(first, np.ndarray):
        return np.concatenate(parts)
    return type(first)(*(_joined([getattr(part, each.name) for part in parts]) for each in fields(first)))


@dataclass(frozen=True)
class Window:
    """Monotone positions that the front handle of a bench passes before that of any other bench of the same length."""

    bench: int
    places: Floats


class Obstacles:
    """All pairs of a bench and an obstacle in a domain, with the first bracket that is not clear."""

    def __init__(self, domain: SearchDomain) -> None:
        """Prepare the search of a domain whose scene has a venue."""
        assert domain.around
        self._domain, self._around = domain, domain.around
        self._longest_m = float(np.max(domain.dragon.bench_lengths_m))
        self._hit: Bracket | None = None

    def clear(self, stop_m: float) -> Bracket | None:
        """Clear up to a leader position; return the first bracket that is not clear."""
        self._hit = self._first(stop_m, _FINEST_M)
        return self._hit

    def prove(self, stop_m: float) -> Bracket | None:
        """Clear up to an earlier position than before; return the first bracket that is not clear."""
        if self._hit:
            self._hit = self._first(stop_m, (*_FINEST_M, _SHORTEST * self._domain.tolerance_m))
        return self._hit

    def _first(self, stop_m: float, finest_m: tuple[float, ...]) -> Bracket | None:
        """Return the first bracket of leader positions that is not clear, phase by phase."""
        hit: Bracket | None = None
        for start, stop in self._domain.phases(self._domain.start_m, stop_m):
            for benches in by_length(self._domain.dragon.bench_lengths_m):
                hit = self._first_of(benches, (start, hit.other_m if hit else stop), finest_m) or hit
            if hit:
                return hit
        return None

    def _first_of(self, benches: Ints, phase: tuple[float, float], finest_m: tuple[float, ...]) -> Bracket | None:
        """Return the first bracket of a phase in which one of the given benches, all of one length, is not clear."""
        domain = self._domain
        windows = windows_of(domain, benches, phase, _SPACING * self._longest_m)
        if not windows:
            return None
        bench = SweptBench.of(domain.track, domain.dragon, int(benches[0]))
        bounds = ObstacleBounds(bench, self._around, domain.error_m)
        space = _SweptIntervals(bounds, domain.tolerance_m, self._longest_m, domain.count)
        cleared = clear(space, [window.places for window in windows], finest_m)
        hits = [(window.bench, one.hit) for window, one in zip(windows, cleared, strict=True) if one.hit]
        return self._earliest(hits, phase)

    def _earliest(self, hits: list[tuple[int, Bracket]], phase: tuple[float, float]
                  ) -> Bracket | None:
        """Return the bracket that the leader reaches first, given the hits of front handles."""
        domain, first = self._domain, None
        while hits:
            bench, (clear_m, other_m, bound_m) = hits[0]
            one, two = (domain.travel_at(bench, along_m, phase) for along_m in (clear_m, other_m))
            if first is None or domain.sense * two < domain.sense * first.other_m:
                first = Bracket(one, two, bound_m)
            here, there = domain.along_m(phase[0]), domain.along_m(first.other_m)
            hits = [(b, hit) for b, hit in hits[1:] if abs(hit.other_m - here[b]) < abs(there[b] - here[b])]
        return first


def windows_of(domain: SearchDomain, benches: Ints, phase: tuple[float, float], spacing_m: float) -> list[Window]:
    """Return the windows of the benches of one length in a phase; each position that is passed is in one window.

    The window of a bench holds the positions that no preceding bench of the same length has passed.
    """
    here, there = (domain.along_m(end)[benches] for end in phase)
    turns = turning_m(domain.track, float(domain.dragon.link_lengths_m[benches[0]]))
    out = list[Window]()
    for n, bench in enumerate(benches.tolist()):
        start, stop, sense = float(here[n]), float(there[n]), 1.0 if there[n] > here[n] else -1.0
        ahead = n - 1 if sense > 0 else n + 1       # distances along the track decrease from the head to the tail
        if 0 <= ahead < benches.size and sense * (there[ahead] - here[ahead]) > 0:
            stop = sense * min(sense * stop, sense * float(here[ahead]))
        if start == stop:
            continue
        count = 2 + int(abs(stop - start) / spacing_m)
        places: Floats = np.linspace(start, stop, min(count, _MOST_PLACES))
        inside = [turn for turn in turns if min(start, stop) < turn < max(start, stop)]
        places = distinct(np.concatenate((places, inside)))
        out.append(Window(bench, places if sense > 0 else places[::-1]))
    return out
