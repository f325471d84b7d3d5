"""Find the closest two benches and all benches that touch at successive samples, using a list of near pairs.

``closeness`` searches from scratch. ``NearPairs`` returns the same results, bit for bit, but uses the state of earlier
samples: a list of near pairs (Verlet, Phys. Rev. 159, 98, 1967), and bounds on how much all gaps have changed since.
This state affects only the time that a sample takes.

The method uses three bounds. The signed gap of two convex figures is the largest of -(h_A(n) + h_B(-n)) over all
directions n, where h_A and h_B are their support functions. A support function changes by at most the displacement of
the farthest-moving point. Therefore:

1. The gap of a pair is at least its separation along any one direction. Each listed pair stores one direction:
   whichever axis of the two benches separated them best when the list was last measured. This axis turns with its
   bench. Benches of neighbouring layers slide along each other, which does not change the separation along this axis.
   The separation therefore quickly excludes most pairs that are not the closest.
2. The gap of a pair changes by at most the displacement of its points in any frame, including the frame of a third
   bench k. With centres c and turns w since the reference state (unit complex numbers), the points of a bench with
   half diagonal r move by at most m = |(c - c_k) conj(w_k) - (c' - c_k')| + r |w - w_k|, and a gap changes by at most
   2 max m. If all benches move as one rigid body, m is 0. If the gaps of unlisted pairs exceeded the current clearance
   by more than that amount, none of these pairs touches or is the closest.
3. In a large dragon, the inner layers turn much faster than the outer layers, so the dragon is split into parts. Each
   part has its own list and its own bench k; the list contains the pairs of the part's benches with each other and
   with the following benches up to an end. In all pairs across an end, the two benches differ in their distance from
   the origin. If each bench is turned back about the origin by its own turn, no point of the bench moves by more than
   e = |c conj(w) - c'|, and such a turn does not change the distance from the origin.

The current gap of the closest pair of the previous sample is an upper bound on the clearance. Gaps are computed only
for pairs that these bounds do not exclude; these include the closest pair and all touching pairs. To allow for
rounding, a bound is lowered by ``_MARGIN`` times coordinates and sizes, which is 64 times the error of a gap
(``rounding_m``).
"""
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np

from dragon_ros.core.errors import CrowdError
from dragon_ros.core.geometry.broad_phase import candidates, default_reach_m
from dragon_ros.core.geometry.contacts import Closeness
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.geometry.signed_distance import PartedPairs, gap_of, gaps, parted_pairs
from dragon_ros.core.numerics.types import Complexes, Floats, Ints, complex_of

TOUCH_M = 1e-10         # a smaller gap counts as contact; positions are accurate to 2e-12 m
_SKIN = 0.45            # margin of lists, relative to the mean half length; longer lists last longer but take more time
_MARGIN = 2.0**-40        # tolerance for rounding, relative to coordinates and sizes
_MOST_EACH = 32         # maximum number of listed pairs per bench; with more, each sample is searched from scratch
_FEW = 8                # up to this many pairs are computed one by one; more pairs are computed as arrays
_FIRST_PART = 512       # number of benches in the innermost part; each further part extends twice as far
_OVERLAP = 2.5          # maximum number of benches in all lists, per bench; above it, the dragon is not split
_WORTH = 0.02           # smallest margin, relative to the skin, at which a part need not be measured at each sample

_NONE: Ints = np.empty(0, dtype=np.int64)
_NOTHING = Closeness(inf, None, _NONE, _NONE, np.empty(0))


def closeness(p: Floats, benches: Benches) -> Closeness:
    """Return the closest two benches and all benches that touch, by a full search; ``p`` (N+1, 2) holds the handles.

    Raises CrowdError if too many benches are close together.
    """
    reach = default_reach_m(benches)
    i, j = candidates(p, benches, reach)
    gap_m = gaps(benches, i, j)
    if i.size and float(np.min(gap_m)) > reach:     # an unlisted pair may have a smaller gap
        i, j = candidates(p, benches, float(np.min(gap_m)))
        gap_m = gaps(benches, i, j)
    return _of(i, j, gap_m)


def _of(i: Ints, j: Ints, gap_m: Floats) -> Closeness:
    """Return the closeness, given sorted pairs that include the closest pair and all pairs that touch."""
    if not i.size:
        return _NOTHING
    gap_m = gap_m + 0.0         # turns a negative zero into zero
    least = int(np.argmin(gap_m))
    closest = int(i[least]), int(j[least])
    if gap_m[least] > TOUCH_M:
        return Closeness(float(gap_m[least]), closest, _NONE, _NONE, _NOTHING.gap_m)
    rows = np.flatnonzero(gap_m <= TOUCH_M)
    rows = rows[np.argsort(gap_m[rows], kind='stable')]
    return Closeness(float(gap_m[least]), closest, i[rows], j[rows], gap_m[rows])


class _ComplexBenches(NamedTuple):
    """The benches of one sample: centres, axes and conjugate axes as complex numbers (N,), and half diagonals (N,).

    The arrays of complex numbers may also hold several samples (K, N). If the sample is row ``row`` of ``ahead``, its
    bounds are computed together with those of the samples that follow it.
    """

    centre: Complexes
    axis: Complexes
    back: Complexes
    far: Floats
    ahead: '_Ahead | None' = None
    row: int = 0

    def change_m(self, part: '_NearList') -> float:
        """Return an upper bound on the change of a part's gaps since its reference state."""
        return self.ahead.change_m(part, self.row) if self.ahead else float(part.change_m(self))

    def separations(self, pairs: PartedPairs) -> Floats:
        """Return the separation of each pair along its axis."""
        return self.ahead.separations(pairs, self.row) if self.ahead else pairs.separations(*self[:3])

    def samples(self, rows: int | slice) -> '_ComplexBenches':
        """Return some of several samples."""
        return _ComplexBenches(self.centre[rows], self.axis[rows], self.back[rows], self.far)


@dataclass(frozen=True, slots=True)
class _NearList:
    """The near pairs (i, j) of benches ``first`` <= i < ``stop`` with benches j < ``end``, and their reference state.

    ``held`` is the reference bench, ``from_held`` (M,) holds all centres relative to the reference bench, and
    ``turned_back`` (M,) holds the conjugate axes. When the list was built, pairs with gaps larger than ``beyond_m``
    were omitted. Between then and the reference state, gaps changed by at most ``spent_m``. In the reference state, no
    listed pair was closer than ``nearest_m``. ``close`` is the number of gaps that had to be computed when the list was
    last measured.
    """

    first: int
    stop: int
    end: int
    held: int
    from_held: Complexes
    turned_back: Complexes
    spent_m: float
    beyond_m: float
    nearest_m: float
    close: int
    list: PartedPairs

    def change_m(self, bodies: _ComplexBenches) -> Floats:
        """Return an upper bound on the change of gaps since the reference state (bound 2 in the module's docstring)."""
        turn = bodies.axis[..., self.first:self.end] * self.turned_back
        held = bodies.centre[..., self.held, None]
        turn_held = turn[..., self.held - self.first, None].copy()
        back = turn_held.conjugate()
        moved = bodies.centre[..., self.first:self.end] * back
        moved -= self.from_held
        moved -= held * back
        turn -= turn_held
        away: Floats = np.abs(turn)
        away *= bodies.far[self.first:self.end]
        away += np.abs(moved)
        out: Floats = 2 * np.maximum.reduce(away, axis=-1)
        return out

    def moved(self, bodies: _ComplexBenches, spent_m: float, nearest_m: float) -> '_NearList':
        """Return the part with the current state as its reference."""
        centre = bodies.centre[self.first:self.end]
        return replace(self, from_held=centre - bodies.centre[self.held],
                       turned_back=bodies.back[self.first:self.end].copy(), spent_m=spent_m, nearest_m=nearest_m)


def _listed(bodies: _ComplexBenches, p: Floats, benches: Benches, part: tuple[int, int, int], reach_m: float,
            above_m: float) -> tuple[_NearList, Floats] | None:
    """Return the list of a part's pairs with gaps up to ``reach_m``, and their separations, or None if too many exist.

    ``above_m`` is an upper bound on the clearance.
    """
    first, stop, end = part
    try:
        i, j = candidates(p[first:end + 1], benches.some(slice(first, end)), reach_m)
    except CrowdError:
        return None
    i, j = i + first, j + first
    if end > stop:
        i, j = i[i < stop], j[i < stop]
    found, apart = parted_pairs(bodies.centre, bodies.axis, benches, i, j)
    near = np.flatnonzero(apart <= reach_m)
    if near.size > _MOST_EACH * (stop - first):
        return None
    found, apart = found.rows(near), apart[near]
    close = int(np.count_nonzero(apart <= above_m))
    blank = _NearList(first, stop, end, _middle(bodies, first, end), bodies.centre, bodies.back, 0.0, reach_m, -inf,
                      close, found)
    return blank.moved(bodies, 0.0, float(np.min(apart, initial=inf))), apart


def _middle(bodies: _ComplexBenches, first: int, end: int) -> int:
    """Return the reference bench, whose distance from the origin is closest to the middle of the part's range."""
    radius = np.abs(bodies.centre[first:end])
    return first + int(np.argmin(np.abs(radius - 0.5 * (np.min(radius) + np.max(radius)))))


def _seen_part(part: _NearList, bodies: _ComplexBenches, p: Floats, benches: Benches, limit_m: float,
               skin_m: float) -> tuple[_NearList, Ints] | None:
    """Return a part after another sample, and the rows of pairs that may be within a limit, or None if too many may."""
    change_m = bodies.change_m(part)
    if not part.beyond_m - part.spent_m - change_m > limit_m:
        listed = _listed(bodies, p, benches, (part.first, part.stop, part.end), max(limit_m, 0.0) + skin_m, limit_m)
        return None if listed is None else (listed[0], np.flatnonzero(listed[1] <= limit_m))
    if part.nearest_m - change_m > limit_m:
        return part, _NONE
    apart = bodies.separations(part.list)
    rows = (apart <= limit_m).nonzero()[0]
    if rows.size > 2 * part.close + _FEW:       # by now, other axes may separate the pairs better
        found, apart = parted_pairs(bodies.centre, bodies.axis, benches, *part.list.pairs)
        rows = np.flatnonzero(apart <= limit_m)
        part = replace(part, list=found, close=rows.size)
    if not rows.size and (nearest_m := float(np.min(apart, initial=inf))) > limit_m + _WORTH * skin_m:
        part = part.moved(bodies, part.spent_m + change_m, nearest_m)
    return part, rows


def _decided(benches: Benches, known: tuple[tuple[int, int], float], pairs: list[tuple[int, int]]) -> Closeness:
    """Return the closeness, given one known gap, and pairs that include the closest pair and all pairs that touch."""
    if len(pairs) > _FEW:
        i, j = np.array(pairs).T
        return _of(i, j, gaps(benches, i, j))
    gap_m = [(known[1] if pair == known[0] else gap_of(benches, *pair)) + 0.0 for pair in pairs]
    least_m = min(gap_m)
    if least_m > TOUCH_M:
        return Closeness(least_m, pairs[gap_m.index(least_m)], _NONE, _NONE, _NOTHING.gap_m)
    i, j = np.array(pairs).T
    return _of(i, j, np.array(gap_m))


@dataclass(frozen=True, slots=True)
class _Kept:
    """The state stored between samples: the parts, the closest pair, and the ``sizes`` of the benches.

    ``centre`` (N,) and ``turned_back`` (N,) hold the centres and conjugate axes of the benches at a time when pairs
    across the ends of parts were at least ``apart_m`` apart.
    """

    sizes: bytes
    far: Floats
    skin_m: float
    clearance_m: float
    closest: tuple[int, int]
    parts: tuple[_NearList, ...]
    apart_m: float
    centre: Complexes
    turned_back: Complexes

    def across_m(self, bodies: _ComplexBenches) -> float:
        """Return a lower bound on the gap of pairs across the ends of parts (bound 3 in the module's docstring)."""
        if len(self.parts) == 1:
            return inf
        moved = bodies.axis * self.turned_back
        moved *= self.centre
        moved -= bodies.centre
        return self.apart_m - 2 * float(np.maximum.reduce(np.abs(moved)))


def _first_kept(p: Floats, benches: Benches, found: Closeness) -> _Kept | None:
    """Return the state after a search from scratch, or None if too many pairs are near."""
    assert found.closest
    skin_m = _SKIN * float(np.mean(benches.half_length))
    bodies = _bodies(benches, np.hypot(benches.half_length, benches.half_width))
    reach_m = max(found.clearance_m, 0.0) + skin_m
    parts = list[_NearList]()
    for part in _cuts(bodies, reach_m + skin_m):
        listed = _listed(bodies, p, benches, part, reach_m, found.clearance_m)
        if listed is None:
            return None
        parts.append(listed[0])
    return _Kept(benches.sizes, bodies.far, skin_m, found.clearance_m, found.closest, tuple(parts), reach_m + skin_m,
                 bodies.centre.copy(), bodies.back)


def _cuts(bodies: _ComplexBenches, apart_m: float) -> list[tuple[int, int, int]]:
    """Return (first, stop, end) of each part; across an end, distances from the origin differ by at least ``apart_m``.

    There is a single part unless the dragon is large and winds about the origin.
    """
    count, radius = bodies.far.size, np.abs(bodies.centre)
    stops = [*(_FIRST_PART << n for n in range((count // _FIRST_PART).bit_length() - 1)), count]
    if radius[0] > radius[-1]:
        radius, stops = -radius, [*(count - stop for stop in stops[-2::-1]), count]
    within = np.maximum.accumulate(radius + bodies.far)[np.array(stops) - 1]
    beyond = np.minimum.accumulate((radius - bodies.far)[::-1])[::-1]
    ends: list[int] = np.searchsorted(beyond, within + apart_m, side='right').tolist()
    firsts = [0, *stops[:-1]]
    if sum(ends) - sum(firsts) > _OVERLAP * count:
        return [(0, count, count)]
    return list(zip(firsts, stops, ends, strict=True))


def _bodies(benches: Benches, far: Floats) -> _ComplexBenches:
    centre, axis = complex_of(benches.centre), complex_of(benches.axis)
    return _ComplexBenches(centre, axis, axis.conjugate(), far)


class _Ahead:
    """Samples that are expected next, with benches of equal sizes.

    A bound is computed for a sample together with all later ones. It is computed again once the state that it refers to
    has been replaced.
    """

    def __init__(self, samples: Sequence[Benches], sizes: bytes, far: Floats) -> None:
        """Start without bounds; ``sizes`` and ``far`` belong to all samples."""
        self.sizes, self._samples = sizes, samples
        self._rows = {id(benches): row for row, benches in enumerate(samples)}
        centre, axis = (complex_of(np.array(values)) for values in (
            [benches.centre for benches in samples], [benches.axis for benches in samples]))
        self._bodies = _ComplexBenches(centre, axis, axis.conjugate(), far)
        self._changes: dict[int, tuple[Complexes, int, list[float]]] = {}
        self._separations: dict[int, tuple[PartedPairs, int, Floats]] = {}

    def find(self, benches: Benches) -> _ComplexBenches | None:
        """Return a sample, or None if it was not expected."""
        row = self._rows.get(id(benches))
        return None if row is None else self._bodies.samples(row)._replace(ahead=self, row=row)

    def change_m(self, part: _NearList, row: int) -> float:
        """Return ``part.change_m`` of a sample."""
        known = self._changes.get(part.first)
        if known is None or known[0] is not part.from_held or row < known[1]:
            changes: list[float] = part.change_m(self._bodies.samples(slice(row, None))).tolist()
            known = self._changes[part.first] = part.from_held, row, changes
        return known[2][row - known[1]]

    def separations(self, pairs: PartedPairs, row: int) -> Floats:
        """Return ``pairs.separations`` of a sample."""
        known = self._separations.get(id(pairs))
        if known is None or row < known[1]:
            rest = self._bodies.samples(slice(row, None))
            known = self._separations[id(pairs)] = pairs, row, pairs.separations(*rest[:3])
        out: Floats = known[2][row - known[1]]
        return out


class NearPairs:
    """Evaluates successive samples with the results of ``closeness``, but faster if consecutive samples are similar.

    The state is replaced as a whole, so samples from several threads may interleave without affecting the results.
    """

    def __init__(self) -> None:
        """Start without a state."""
        self._kept: _Kept | None = None
        self._ahead: _Ahead | None = None

    def expect(self, samples: Sequence[Benches]) -> None:
        """Prepare for samples that will probably be looked at next, in this order; this saves time."""
        kept, self._ahead = self._kept, None
        alike = len(samples) > 1 and all(benches.half_length is samples[0].half_length
                                         and benches.half_width is samples[0].half_width for benches in samples)
        if kept and alike and kept.sizes == samples[0].sizes:
            self._ahead = _Ahead(samples, kept.sizes, kept.far)

    def look(self, p: Floats, benches: Benches) -> Closeness:
        """Return the closest two benches and all benches that touch, given the handles ``p`` (N+1, 2).

        Raises CrowdError if too many benches are close together.
        """
        kept, ahead = self._kept, self._ahead
        bodies = ahead.find(benches) if kept and ahead and ahead.sizes == kept.sizes else None
        if kept and (bodies or kept.sizes == benches.sizes):
            found = self._again(kept, p, benches, bodies or _bodies(benches, kept.far))
            if found:
                return found
        self._kept, found = None, closeness(p, benches)
        if found.closest and isfinite(found.clearance_m):
            self._kept = _first_kept(p, benches, found)
        return found

    def _again(self, kept: _Kept, p: Floats, benches: Benches, bodies: _ComplexBenches) -> Closeness | None:
        """Return the result for a sample, computed from the previous state, or None if that state is of no use."""
        above_m = gap_of(benches, *kept.closest)
        size_m = sqrt(np.vdot(bodies.centre, bodies.centre).real)   # one call yields an upper bound on all coordinates
        limit_m = max(above_m, TOUCH_M) + _MARGIN * (size_m + kept.skin_m)
        if not (above_m <= max(kept.clearance_m, 0.0) + kept.skin_m and kept.across_m(bodies) > limit_m):
            return None
        parts, pairs = list[_NearList](), {kept.closest}
        for part in kept.parts:
            seen = _seen_part(part, bodies, p, benches, limit_m, kept.skin_m)
            if seen is None:
                return None
            parts.append(seen[0])
            if seen[1].size:
                owner, other = (values[seen[1]].tolist() for values in seen[0].list[:2])
                pairs.update((i, j) if i < j else (j, i) for i, j in zip(owner, other, strict=True))
        found = _decided(benches, (kept.closest, above_m), sorted(pairs))
        assert found.closest
        self._kept = replace(kept, clearance_m=found.clearance_m, closest=found.closest, parts=tuple(parts))
        return found
