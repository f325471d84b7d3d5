"""Convert a drawn line into a track: round corners, fit arcs to curves, and make every bend walkable.

A drawn line is a sequence of parts, straight or smooth, that meet at points; if they meet at an angle, the point is a
corner. Each corner, and each bend that is too tight for the links, is replaced by the shortest biarc around it that
has the requested radius. All other parts are straight lines, or curves to which biarcs are fitted. Consecutive pieces
are tangent, because each piece begins at the end point and heading of the preceding piece.
"""
import cmath
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import ceil, degrees, inf, pi, sqrt, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely import LineString, STRtree, get_coordinates, linestrings
from shapely import points as shapely_points

from dragon_ros.core.domain import PIECES
from dragon_ros.core.errors import InputError
from dragon_ros.core.limits import DRAWING_WORK
from dragon_ros.core.numerics.types import Complexes, Floats, Ints
from dragon_ros.core.tracks.biarcs import Bow, biarc, fitted
from dragon_ros.core.tracks.spec import Arc, Line, Piece

LEAD_IN_M = 1.0         # length of the line added before a track that would otherwise begin with a bend
_MOST_SAMPLES = 20_000  # maximum number of samples per curve
_FINE = 0.002           # sampling error of a piece when its deviation is measured, relative to the tolerance
_THINNED = 0.05         # limit on the deviation caused by thinning the points, relative to the tolerance
_EASED = (0.0, 0.25, 0.5, 0.75)     # limits on the displacement by smoothing, relative to the tolerance, tried in order
_SIMPLIFIED = 0.1       # limit on the deviation caused by simplifying smoothed waves, relative to the tolerance
_SMOOTHED = (0.9, 0.6, 0.3)       # likewise, for smoothing waves of any length
_FEWEST, _FINER = 6, 1.7     # number of blocks at first; factor by which blocks are made smaller
_MANY = 1500            # maximum number of points that are followed one by one; more are averaged in blocks
_RECORDED = 50          # minimum number of points of a recording
_MEDIAN_OF_NOISE = 1.44     # median of |p0 - 2 p1 + p2| / 2 of points with a noise of 1 in x and y
_MORE = 1e-3            # relative error of a measured deviation
_SPARSE = 16            # one point in so many is looked at first, because most blocks are too large
_ATTEMPT = 200          # the work of an attempt besides its points: the time of so many points
_RETRIES = 4
_TAUBIN, _PASSES, _TINY_M = (0.5, -0.53), 300, 1e-300
_KINK_RAD = 0.05        # a curve is bent by up to this angle to meet its neighbour; a larger angle is a corner
_SAME = 1e-9            # tolerance for rounding, relative to a length
_ALIKE = 1e-7           # largest difference in radius at which arcs are merged, relative to the radius
_MEASURED = 1e-5        # sampling error of a blend when its deviation is measured, relative to its radius
_ROUNDS = 12            # maximum number of searches for bends that are too tight
_DECIMALS = 11          # decimal places of metres and degrees in a scene file
_GROWTH, _CLOSE = 1.2, 1e-6     # growth factor of a blend until its radius is sufficient; relative error of its size


@dataclass(frozen=True, eq=False)
class SmoothPart:
    """A smooth part of a drawn line: its points (n,), as complex numbers in metres, and unit headings (n,).

    ``drawn`` (k,) holds the original points of the drawing, and ``drawn_at_m`` (k,) their distances along the part.
    """

    points: Complexes
    headings: Complexes
    drawn: Complexes
    drawn_at_m: Floats

    @property
    def is_straight(self) -> bool:
        """Whether the part is a line; a shortened curve may also have only two points, but its headings differ."""
        chord = self.points[-1] - self.points[0]
        return len(self.points) == 2 and bool(np.all(np.abs(self.headings - chord / abs(chord)) < _SAME))

    @cached_property
    def points_at_m(self) -> Floats:
        """Distances (n,) of the points along the part."""
        return along_line_m(self.points)


def along_line_m(points: Complexes) -> Floats:
    """Return the distances of points (n,) along the line through them."""
    return np.concatenate(([0.0], np.cumsum(np.abs(np.diff(points)))))


def _stretch(points: Complexes, headings: Complexes) -> SmoothPart:
    """Return a smooth part that keeps all drawn points."""
    return SmoothPart(points, headings, points, along_line_m(points))


@dataclass(frozen=True)
class Change:
    """A bend at which a track deliberately leaves the drawing: position, smallest radius and largest deviation."""

    place_m: tuple[float, float]
    radius_m: float
    off_m: float
    is_corner: bool


@dataclass(frozen=True)
class Route:
    """The pieces of a track, the deliberate changes, and the deviation of fitted curves from the drawing.

    The first piece states its position. The first ``lead_in_m`` metres are a line before the start of the drawing.
    """

    pieces: tuple[Piece, ...]
    changes: tuple[Change, ...]
    strays_m: float
    lead_in_m: float

    @property
    def off_m(self) -> float:
        """The largest deviation from the drawing at bends (not corners) that were too tight; 0 if there were none."""
        return max((change.off_m for change in self.changes if not change.is_corner), default=0.0)


class Cubic(NamedTuple):
    """A cubic Bézier curve, given by its four control points as complex numbers in metres."""

    controls: tuple[complex, complex, complex, complex]

    def stretch(self, sag_m: float) -> SmoothPart:
        """Return samples whose chords deviate from the curve by at most ``sag_m``.

        Between two samples, the deviation is at most 1/8 of the second derivative times the squared step.
        """
        a, b, c, d = self.controls
        bend = 6 * max(abs(a - 2 * b + c), abs(b - 2 * c + d))
        t = np.linspace(0.0, 1.0, _samples(sqrt(bend / (8 * sag_m))))
        s = 1 - t
        points = s * s * s * a + 3 * s * s * t * b + 3 * s * t * t * c + t * t * t * d
        return _sampled(points, s * s * (b - a) + 2 * s * t * (c - b) + t * t * (d - c))


class EllipseArc(NamedTuple):
    """An arc of the ellipse centre + a cos u + b sin u, from u = start_rad to start_rad + sweep_rad."""

    centre: complex
    axes: tuple[complex, complex]
    start_rad: float
    sweep_rad: float

    def stretch(self, sag_m: float) -> SmoothPart:
        """Return samples whose chords deviate from the curve by at most ``sag_m``."""
        a, b = self.axes
        count = _samples(abs(self.sweep_rad) * sqrt((abs(a) + abs(b)) / (8 * sag_m)))
        u = self.start_rad + self.sweep_rad * np.linspace(0.0, 1.0, count)
        return _sampled(self.centre + a * np.cos(u) + b * np.sin(u), self.sweep_rad * (b * np.cos(u) - a * np.sin(u)))


DrawnPart = Complexes | Cubic | EllipseArc      # ordered points, or a curve


def _samples(count: float) -> int:
    return min(_MOST_SAMPLES, 9 + ceil(count))


def _sampled(points: Complexes, rates: Complexes) -> SmoothPart:
    """Return a smooth part from points and derivatives; where a derivative vanishes, chords determine the heading."""
    chords = np.diff(points)
    small = np.abs(rates) <= _SAME * float(np.max(np.abs(rates), initial=0.0))
    if np.any(small):
        both = np.concatenate((chords[:1], chords)) + np.concatenate((chords, chords[-1:]))
        rates = np.where(small, both, rates)
    kept = np.append(True, chords != 0) & (rates != 0)
    return _stretch(points[kept], rates[kept] / np.abs(rates[kept]))


class Work:
    """Counts the work on a drawing, in points examined, and ends it at a limit."""

    def __init__(self, limit: int = DRAWING_WORK, shares: int = 1) -> None:
        """Start at zero, with one of so many equal shares of the limit."""
        self.spent, self.limit, self.shares = 0, limit, shares

    def spend(self, points: int) -> None:
        """Count an attempt that examines so many points. Raises WorkError beyond the limit."""
        self.spent += _ATTEMPT + points
        if self.spent * self.shares > self.limit:
            raise WorkError(f'the drawing takes more than {self.limit} steps of work; give a larger --tolerance, or '
                            'draw a simpler or shorter line', field='tolerance')


class WorkError(InputError):
    """A drawing takes too much work to follow within a tolerance."""


def along(parts: Sequence[DrawnPart], radius_m: float, least_m: float, tolerance_m: float,
          limit: int = DRAWING_WORK) -> Route:
    """Return a track of lines and arcs along a drawn line, whose parts must be joined end to end.

    Corners are rounded with the radius ``radius_m``. If the legs are too short for this radius, the largest radius
    that fits is used, down to ``least_m``, the smallest that the links can follow. Curves are fitted within
    ``tolerance_m``. If points are noisy, part of the tolerance is used to smooth them. Raises InputError with the
    position if a bend does not fit, and WorkError if the work, in points examined, exceeds ``limit``.
    """
    best: Route | None = None
    refused: InputError | None = None
    attempts = _attempts(parts)
    for share, smoothing in attempts:
        work = Work(limit, len(attempts))
        try:
            stretches = [stretch for one in parts
                         for stretch in _stretches(one, share * tolerance_m, tolerance_m, smoothing, work)]
            found = _within_tolerance(stretches, radius_m, least_m, (1 - share - _THINNED) * tolerance_m, tolerance_m,
                                      work)
        except WorkError as error:
            refused = error
            continue
        except InputError as error:
            refused = refused or error
            continue
        if found.strays_m > tolerance_m:
            refused = refused or InputError(
                f'the track deviates by {found.strays_m:.3g} m from the drawing, and the tolerance is {tolerance_m:g} '
                f'm; give --tolerance {1.05 * found.strays_m:.2g}, or draw a smoother line', field='tolerance')
        elif best is None or found.off_m < best.off_m:
            best = found
        if best is not None and not best.off_m:
            break
    if best is None:
        raise refused or InputError('the drawing has no points; draw a line', field='drawing')
    return best


def _attempts(parts: Sequence[DrawnPart]) -> list[tuple[float, str]]:
    """Return the shares of the tolerance for smoothing, each with what is smoothed, in the order to try them.

    'points' smooths waves of a few points; 'waves' those of any length, and draws few straight lines; 'corners' keeps
    the points, as corners.
    """
    counts = [len(one) for one in parts if isinstance(one, np.ndarray)]
    if max(counts, default=0) <= 2:
        return [(0.0, 'points')]
    points, waves = [(share, 'points') for share in _EASED], [(share, 'waves') for share in _SMOOTHED]
    corners = [(0.0, 'corners')] if sum(counts) <= PIECES.high // 2 else []
    if not any(isinstance(one, np.ndarray) and noise_m(one) for one in parts):
        return [*points, *waves, *corners]
    return waves if max(counts) > 2 * _MANY else [*waves, *points, *corners]


def _within_tolerance(stretches: Sequence[SmoothPart], radius_m: float, least_m: float, fit_m: float,
                      tolerance_m: float, work: Work) -> Route:
    """Return the route with the largest error of fit (m) for which the measured deviation is within the tolerance.

    If there is none, return the route with the smallest deviation.
    """
    best = None
    for _ in range(_RETRIES):
        found = _routed(stretches, radius_m, least_m, fit_m, work)
        if best is None or found.strays_m < best.strays_m:
            best = found
        if found.strays_m <= tolerance_m:
            break
        fit_m *= 0.8 * tolerance_m / found.strays_m
    return best or found


def _stretches(part: DrawnPart, eased_m: float, tolerance_m: float, smoothing: str, work: Work) -> list[SmoothPart]:
    if isinstance(part, Cubic | EllipseArc):
        stretch = part.stretch(_FINE * tolerance_m)
        work.spend(len(stretch.points))
        return [stretch]
    if smoothing == 'corners':
        return _through(part, part, np.arange(len(part)), 0.0, 0.0, work)
    if smoothing == 'waves':
        eased, owners = _smoothed(part, eased_m, work)
        return _through(part, eased, owners, 0.0, _SIMPLIFIED * tolerance_m, work)
    work.spend(_PASSES * len(part) // 10 if eased_m else 0)
    left_m = tolerance_m - eased_m
    return _through(part, _eased(part, eased_m), np.arange(len(part)), left_m, _THINNED * left_m, work)


def noise_m(points: Complexes) -> float:
    """Return the noise (m, one standard deviation) of recorded points (n,), or 0 for a drawn line.

    Noise turns at random: at a third of all points or more, the line turns by more than 60 degrees.
    """
    legs = np.diff(points)
    legs = legs[legs != 0]
    if len(legs) < _RECORDED or np.mean(np.abs(np.angle(legs[1:] / legs[:-1])) > pi / 3) < 1 / 3:
        return 0.0
    return float(np.median(np.abs(legs[1:] - legs[:-1])) / 2 / _MEDIAN_OF_NOISE)


def _smoothed(points: Complexes, within_m: float, work: Work) -> tuple[Complexes, Ints]:
    """Return a smooth line (m,) along points (n,), and for each point its place (a point of the line) on it.

    The points are averaged in blocks of equal size, the largest for which all points stay within a distance of the
    line; if there is no such size, in the smallest blocks.
    """
    size = max(len(points) // _FEWEST, 1)
    least = -(-len(points) // _MANY)
    while True:
        size = max(int(size / _FINER), least)
        work.spend(len(points) // 10)
        owners = np.arange(len(points)) // size
        count = np.bincount(owners)
        blocks: Complexes = np.bincount(owners, points.real) / count + 1j * (np.bincount(owners, points.imag) / count)
        if len(blocks) < 4:
            return points, np.arange(len(points))
        inner = 0.25 * blocks[:-2] + 0.5 * blocks[1:-1] + 0.25 * blocks[2:]
        eased = np.concatenate(([1.5 * blocks[0] - 0.5 * inner[0]], inner, [1.5 * blocks[-1] - 0.5 * inner[-1]]))
        legs = _Legs(eased)
        if size == least or all(np.max(legs.nearest(some).away_m) <= within_m for some in (points[::_SPARSE], points)):
            return eased, owners


class _Legs:
    """The legs of a line, in a tree that finds the nearest."""

    def __init__(self, line: Complexes) -> None:
        self.begin, self.stop = line[:-1], line[1:]
        pairs = np.stack((self.begin.real, self.begin.imag, self.stop.real, self.stop.imag), axis=1)
        self.tree = STRtree(linestrings(pairs.reshape(-1, 2, 2)))

    def nearest(self, points: Complexes) -> '_Nearest':
        """Return points (n,), the nearest leg of each, and their distances (m) from it."""
        with np.errstate(invalid='ignore'):     # raised by old versions of GEOS if points of the line coincide
            leg = self.tree.query_nearest(shapely_points(points.real, points.imag), all_matches=False)[1]
        return _Nearest(points, leg, self.distances_m(points, leg))

    def distances_m(self, points: Complexes, leg: Ints) -> Floats:
        """Return the distances of points (n,) from as many legs."""
        chord, here = self.stop[leg] - self.begin[leg], points - self.begin[leg]
        share = np.clip((here * chord.conjugate()).real / np.maximum(np.abs(chord) ** 2, _TINY_M), 0.0, 1.0)
        out: Floats = np.abs(here - share * chord)
        return out


@dataclass(frozen=True, eq=False)
class _Nearest:
    """Points (n,), the nearest leg of each, and their distances (m) from it."""

    points: Complexes
    leg: Ints
    away_m: Floats

    def some(self, which: slice | NDArray[np.bool_]) -> '_Nearest':
        """Return some of the points."""
        return _Nearest(self.points[which], self.leg[which], self.away_m[which])

    def joined(self, other: '_Nearest') -> '_Nearest':
        """Return these points, followed by others."""
        return _Nearest(np.append(self.points, other.points), np.append(self.leg, other.leg),
                        np.append(self.away_m, other.away_m))


def _through(drawn: Complexes, eased: Complexes, owners: Ints, tolerance_m: float, thin_m: float,
             work: Work) -> list[SmoothPart]:
    """Split a line through points (m,) at its corners, and return the smooth parts.

    ``eased`` holds the smoothed points, ``drawn`` the original points (n,), and ``owners`` the smoothed point of each
    of these. Points within ``thin_m`` of the line through the other points are removed first. An arc over a leg of
    length h between headings that differ by phi deviates from the leg by h phi / 8; a point is a corner if this
    deviation exceeds the tolerance.
    """
    numbers = _kept(eased, thin_m)
    if len(numbers) < 2:
        return []
    legs = np.diff(eased[numbers])
    long, turns = np.abs(legs), np.abs(np.angle(legs[1:] / legs[:-1]))
    corners = np.flatnonzero(np.maximum(long[1:], long[:-1]) * turns / 8 > tolerance_m) + 1
    work.spend(_ATTEMPT * len(corners))
    ends = [0, *corners.tolist(), len(numbers) - 1]
    along_m, eased_m = _along_m(drawn, eased, owners), along_line_m(eased)
    return [_curve(drawn, along_m, eased, eased_m, numbers[first:last + 1]) for first, last in pairwise(ends)]


def _along_m(drawn: Complexes, eased: Complexes, owners: Ints) -> Floats:
    """Return the distances (n,) along a smoothed line of the places next to the original points, in order."""
    at_m, legs = along_line_m(eased), np.diff(eased)
    long = np.maximum(np.abs(legs), _TINY_M)
    best, away = np.zeros(len(drawn)), np.full(len(drawn), inf)
    for side in (-1, 0):
        leg = np.clip(owners + side, 0, len(legs) - 1)
        direction = legs[leg] / long[leg]
        along = np.clip(((drawn - eased[leg]) * direction.conjugate()).real, 0.0, long[leg])
        off = np.abs(drawn - eased[leg] - along * direction)
        best, away = np.where(off < away, at_m[leg] + along, best), np.minimum(off, away)
    out: Floats = np.maximum.accumulate(best)
    return out


def _kept(points: Complexes, away_m: float) -> Ints:
    """Return the indices of the points (n,) that the Douglas-Peucker algorithm keeps with the tolerance ``away_m``."""
    if len(points) < 2:
        return np.arange(len(points))
    rows = np.stack((points.real, points.imag, np.arange(len(points))), axis=1)
    thin = LineString(rows).simplify(away_m, preserve_topology=False)
    out: Ints = get_coordinates(thin, include_z=True)[:, 2].astype(int)
    kept: Ints = out[np.append(True, np.diff(points[out]) != 0)]
    return kept


def _eased(points: Complexes, within_m: float) -> Complexes:
    """Return points (n,) without waves shorter than about 18 points; no point is moved by more than ``within_m``.

    This is Taubin's filter, which smooths without shrinking (A signal processing approach to fair surface design,
    1995).
    """
    out: Complexes = points.copy()
    for weight in _TAUBIN * (_PASSES if within_m else 0):
        out[1:-1] += weight * (0.5 * (out[2:] + out[:-2]) - out[1:-1])
        moved = out - points
        out = points + moved * np.minimum(1.0, within_m / np.maximum(np.abs(moved), _TINY_M))
    return out


def _curve(drawn: Complexes, along_m: Floats, eased: Complexes, eased_m: Floats, numbers: Ints) -> SmoothPart:
    """Return a smooth part through points; headings are tangent to circles through each point and its neighbours."""
    points = eased[numbers]
    legs = np.diff(points)
    long, directions = np.abs(legs), legs / np.abs(legs)
    ends_m = eased_m[numbers]
    between = np.arange(np.searchsorted(along_m, ends_m[0]), np.searchsorted(along_m, ends_m[-1], side='right'))
    at_m = np.interp(along_m[between], ends_m, along_line_m(points))
    if len(points) == 2:
        return SmoothPart(points, np.repeat(directions, 2), drawn[between], at_m)
    inner = directions[:-1] * long[1:] + directions[1:] * long[:-1]
    inner = np.where(np.abs(inner) > _SAME * (long[1:] + long[:-1]), inner, 1j * directions[:-1])
    inner /= np.abs(inner)
    # the same angle on the other side of the leg
    first, last = directions[0] ** 2 / inner[0], directions[-1] ** 2 / inner[-1]
    return SmoothPart(points, np.concatenate(([first], inner, [last])), drawn[between], at_m)


def _one_of(parts: list[SmoothPart]) -> SmoothPart:
    """Return successive parts as one."""
    begins_m = np.cumsum([0.0, *(one.points_at_m[-1] for one in parts[:-1])])
    return SmoothPart(np.concatenate([parts[0].points[:1], *(one.points[1:] for one in parts)]),
                      np.concatenate([parts[0].headings[:1], *(one.headings[1:] for one in parts)]),
                      np.concatenate([one.drawn for one in parts]),
                      np.concatenate([at + one.drawn_at_m for at, one in zip(begins_m, parts, strict=True)]))


class _SmoothLine:
    """Smooth parts joined end to end; distances (m) are measured along them."""

    def __init__(self, stretches: Sequence[SmoothPart], work: Work) -> None:
        self.work = work
        self.stretches = [one for one in stretches if len(one.points) > 1]
        self.reaches_m: dict[tuple[tuple[float, float], float], float | None] = {}      # keyed by position and radius
        self._absorb_kinks()
        self._join_curves()
        self.begins_m = np.concatenate(([0.0], np.cumsum([one.points_at_m[-1] for one in self.stretches])))

    @property
    def length_m(self) -> float:
        return float(self.begins_m[-1])

    def _absorb_kinks(self) -> None:
        """Bend the ends of curves slightly to make them tangent to their neighbours."""
        for k in range(len(self.stretches) - 1):
            before, after = self.stretches[k:k + 2]
            left, right = before.headings[-1], after.headings[0]
            if abs(cmath.phase(right / left)) > _KINK_RAD or (before.is_straight and after.is_straight):
                continue
            common = left if before.is_straight else right if after.is_straight else (left + right) / abs(left + right)
            self.stretches[k] = replace(before, headings=np.append(before.headings[:-1], common))
            self.stretches[k + 1] = replace(after, headings=np.append(common, after.headings[1:]))

    def _join_curves(self) -> None:
        """Make one part of successive curves that are tangent, so that an arc can follow several."""
        groups = list[list[SmoothPart]]()
        for one in self.stretches:
            is_next = groups and not one.is_straight and not groups[-1][-1].is_straight
            if is_next and groups[-1][-1].headings[-1] == one.headings[0]:
                groups[-1].append(one)
            else:
                groups.append([one])
        self.stretches = [group[0] if len(group) == 1 else _one_of(group) for group in groups]

    def corners(self) -> list[tuple[float, float]]:
        """Return the intervals (first, last) of distances that the corners occupy."""
        return [(float(at), float(at)) for at, (before, after) in zip(
            self.begins_m[1:], pairwise(self.stretches), strict=False) if before.headings[-1] != after.headings[0]]

    def pose(self, at_m: float, after: bool) -> tuple[complex, complex]:
        """Return the point and heading at a distance; where two parts meet, ``after`` selects the next part."""
        k = int(np.searchsorted(self.begins_m, at_m, side='right' if after else 'left')) - 1
        k = min(max(k, 0), len(self.stretches) - 1)
        one, here = self.stretches[k], at_m - self.begins_m[k]
        n = min(max(int(np.searchsorted(one.points_at_m, here)) - 1, 0), len(one.points) - 2)
        low, high = one.points_at_m[n:n + 2]
        part = min(max((here - low) / (high - low), 0.0), 1.0)
        heading = one.headings[n] + part * (one.headings[n + 1] - one.headings[n])
        if not heading:
            heading = 1j * one.headings[n]
        return complex(one.points[n] + part * (one.points[n + 1] - one.points[n])), complex(heading / abs(heading))

    def between(self, low_m: float, high_m: float) -> list[tuple[float, SmoothPart]]:
        """Return the smooth parts between two distances, clipped to them, each with the distance at which it begins."""
        out, same_m, near = [], _SAME * self.length_m, self._near(low_m, high_m)
        for begin, one in zip(self.begins_m[near].tolist(), self.stretches[near], strict=False):
            first, last = max(low_m, begin), min(high_m, begin + float(one.points_at_m[-1]))
            if last - first > same_m:
                out.append((first, self._cut(begin, one, first, last)))
        return out

    def _cut(self, begin: float, one: SmoothPart, first: float, last: float) -> SmoothPart:
        (a, at), (b, to) = self.pose(first, True), self.pose(last, False)
        same_m = _SAME * self.length_m
        inner = (one.points_at_m > first - begin + same_m) & (one.points_at_m < last - begin - same_m)
        points, headings = one.points[inner], one.headings[inner]
        return _stretch(np.concatenate(([a], points, [b])), np.concatenate(([at], headings, [to])))

    def _near(self, low_m: float, high_m: float) -> slice:
        """Return the indices of all parts that reach between two distances, and one more, since these are rounded."""
        first, stop = np.searchsorted(self.begins_m, low_m), np.searchsorted(self.begins_m, high_m, side='right')
        return slice(max(int(first) - 2, 0), int(stop) + 1)

    def drawn_between(self, low_m: float, high_m: float) -> Complexes:
        """Return the original line between two distances, including its points at both ends."""
        near = self._near(low_m, high_m)
        at, drawn = list[Floats](), list[Complexes]()
        for begin, one in zip(self.begins_m[near].tolist(), self.stretches[near], strict=False):
            at.append(begin + one.drawn_at_m)
            drawn.append(one.drawn)
        at_m, points = np.concatenate(at), np.concatenate(drawn)
        ends = [complex(np.interp(end, at_m, points.real), np.interp(end, at_m, points.imag))
                for end in (low_m, high_m)]
        first, stop = np.searchsorted(at_m, low_m), np.searchsorted(at_m, high_m, side='right')
        return np.concatenate((ends[:1], points[first:stop], ends[1:]))


@dataclass(frozen=True)
class _Blend:
    """Two arcs that replace the drawn line between two distances."""

    low_m: float
    high_m: float
    bows: tuple[Bow, Bow]
    is_corner: bool

    @property
    def radius_m(self) -> float:
        return min(bow.radius_m for bow in self.bows)


def _routed(stretches: Sequence[SmoothPart], radius_m: float, least_m: float, tolerance_m: float,
            work: Work) -> Route:
    drawn = _SmoothLine(stretches, work)
    if not drawn.stretches:
        raise InputError('the drawing has no length; draw a line', field='drawing')
    corners = drawn.corners()
    for _ in range(_ROUNDS):
        blends = _blends(drawn, corners, radius_m, least_m)
        parts, tight = _fit(drawn, blends, tolerance_m, least_m)
        if not tight:
            route = _laid(drawn, blends, parts, tolerance_m)
            for blend, change in zip(blends, route.changes, strict=True):
                if not change.is_corner and change.off_m > radius_m:
                    raise _unwalkable(drawn, blend.low_m, blend.high_m, least_m)
            return route
        corners = _joined([*corners, *tight])
    raise _unwalkable(drawn, *corners[0], least_m)


def _joined(places: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the intervals in ascending order; intervals that touch are merged."""
    out = list[tuple[float, float]]()
    for low, high in sorted(places):
        if out and low <= out[-1][1]:
            out[-1] = out[-1][0], max(out[-1][1], high)
        else:
            out.append((low, high))
    return out


def _blends(drawn: _SmoothLine, corners: list[tuple[float, float]], radius_m: float, least_m: float) -> list[_Blend]:
    """Return a blend for each corner; corners that are too close together for two blends share one."""
    while corners:
        drawn.work.spend(len(corners))
        slim = [_reach_m(drawn, place, least_m) for place in corners]
        for place, reach in zip(corners, slim, strict=True):
            if reach is None:
                raise _unwalkable(drawn, *place, least_m)
        wide = [_widest_m(drawn, place, least_m, radius_m) for place in corners]
        gaps = [inf, *(after[0] - before[1] for before, after in pairwise(corners)), inf]
        shares = _shares(gaps, wide, slim)
        crowded = [k for k, share in enumerate(shares) if share is None and 0 < k < len(corners)]
        if not crowded:
            return [_blend(drawn, place, (_between(low, high, shares[k:k + 2]), low or 0.0), least_m)
                    for k, (place, low, high) in enumerate(zip(corners, slim, wide, strict=True))]
        k = crowded[0]
        corners = [*corners[:k - 1], (corners[k - 1][0], corners[k][1]), *corners[k + 1:]]
    return []


def _shares(gaps: list[float], wide: list[float | None], slim: list[float | None]) -> list[float | None]:
    """Return, for each gap, how far its blends can grow from slim (0) to wide (1); None if slim blends do not fit."""
    out: list[float | None] = []
    for gap, big, small in zip(gaps, pairwise([0.0, *wide, 0.0]), pairwise([0.0, *slim, 0.0]), strict=True):
        least = sum(one or 0.0 for one in small)
        most = sum(max(b if b is not None else inf, s or 0.0) for b, s in zip(big, small, strict=True))
        room = gap - least
        out.append(None if room < 0 else 1.0 if most <= gap else 0.0 if most == inf else room / (most - least))
    return out


def _between(low: float | None, high: float | None, shares: list[float | None]) -> float:
    share = min(one or 0.0 for one in shares)
    small = low or 0.0
    return small if high is None or high < small else small + share * (high - small)


def _reach_m(drawn: _SmoothLine, place: tuple[float, float], radius_m: float) -> float | None:
    """Return the distance from a corner to either end of the biarc with this radius, or None if the biarc does not fit.

    Between two lines, the biarc is one arc with a reach of R tan(phi / 2).
    """
    if (place, radius_m) not in drawn.reaches_m:
        drawn.reaches_m[place, radius_m] = _shortest_m(drawn, place, radius_m)
    return drawn.reaches_m[place, radius_m]


def _widest_m(drawn: _SmoothLine, place: tuple[float, float], least_m: float, radius_m: float) -> float | None:
    """Return the reach of the biarc with a radius or, if it does not fit, with the largest smaller radius that fits."""
    if (reach_m := _reach_m(drawn, place, radius_m)) is not None:
        return reach_m
    while radius_m - least_m > _CLOSE * radius_m:
        middle_m = 0.5 * (least_m + radius_m)
        least_m, radius_m = (least_m, middle_m) if _reach_m(drawn, place, middle_m) is None else (middle_m, radius_m)
    return _reach_m(drawn, place, least_m)


def _shortest_m(drawn: _SmoothLine, place: tuple[float, float], radius_m: float) -> float | None:
    room = max(place[0], drawn.length_m - place[1])
    reach, failed = _tangent_m(drawn, place, radius_m), 0.0
    while _bent(drawn, place, reach, radius_m) is None:
        failed, reach = reach, reach * _GROWTH
        if reach > room:
            return None
    while failed and reach - failed > _CLOSE * reach:
        middle = 0.5 * (failed + reach)
        failed, reach = (failed, middle) if _bent(drawn, place, middle, radius_m) is not None else (middle, reach)
    return min(reach, room)


def _tangent_m(drawn: _SmoothLine, place: tuple[float, float], radius_m: float) -> float:
    """Return the exact reach of a corner between two lines; for other corners, a small initial value."""
    low, high = place
    turn = abs(cmath.phase(drawn.pose(high, True)[1] / drawn.pose(low, False)[1]))
    if low == high and turn < 0.99 * pi:
        return radius_m * tan(0.5 * turn)
    return max(0.05 * radius_m, 0.05 * (high - low))


def _bent(drawn: _SmoothLine, place: tuple[float, float], reach_m: float, radius_m: float) -> tuple[Bow, Bow] | None:
    """Return the biarc around a corner if its radii are large enough and no arc makes half a turn, else None."""
    drawn.work.spend(0)
    low, high = _ends(drawn, place, reach_m)
    found = biarc(*drawn.pose(low, False), *drawn.pose(high, True))
    if found is None or any(bow.radius_m < radius_m * (1 - _SAME) or abs(bow.angle_rad) > pi for bow in found):
        return None
    return found


def _blend(drawn: _SmoothLine, place: tuple[float, float], reaches_m: tuple[float, float], least_m: float) -> _Blend:
    """Return the blend with the first reach whose radii are large enough; a larger reach may have smaller radii."""
    for reach_m in reaches_m:
        if (bows := _bent(drawn, place, reach_m, least_m)) is not None:
            return _Blend(*_ends(drawn, place, reach_m), bows, place[0] == place[1])
    raise _unwalkable(drawn, *place, least_m)


def _ends(drawn: _SmoothLine, place: tuple[float, float], reach_m: float) -> tuple[float, float]:
    """Return the distances that are ``reach_m`` before and after a corner, clipped to the ends of the drawing."""
    return max(0.0, place[0] - reach_m), min(drawn.length_m, place[1] + reach_m)


def _unwalkable(drawn: _SmoothLine, low_m: float, high_m: float, least_m: float) -> InputError:
    """Return the error for a position at which no arc fits."""
    at, _ = drawn.pose(0.5 * (low_m + high_m), True)
    return InputError(
        f'the drawing cannot be walked at ({at.real:.3f}, {at.imag:.3f}) m, {0.5 * (low_m + high_m):.2f} m along it: '
        f'there is no room for a bend of radius {least_m:.4g} m, the tightest that these benches can walk; draw a '
        f'larger radius or longer legs, or use shorter benches', field='drawing', place_m=(at.real, at.imag))


class _FittedArcs(NamedTuple):
    """Arcs fitted to the drawn line between two distances."""

    low_m: float
    high_m: float
    bows: tuple[Bow, ...]


def _fit(drawn: _SmoothLine, blends: list[_Blend], tolerance_m: float,
         least_m: float) -> tuple[list[_FittedArcs], list[tuple[float, float]]]:
    """Return the parts of the track between blends, and the intervals in which the track would bend too tightly."""
    parts, tight = list[_FittedArcs](), list[tuple[float, float]]()
    ends = [0.0, *(end for blend in blends for end in (blend.low_m, blend.high_m)), drawn.length_m]
    for low, high in zip(ends[::2], ends[1::2], strict=True):
        for begin, one in drawn.between(low, high):
            if one.is_straight:
                line = complex(one.points[1] - one.points[0])
                bow = Bow(complex(one.points[0]), line / abs(line), abs(line), 0.0)
                parts.append(_FittedArcs(begin, begin + abs(line), (bow,)))
                continue
            found = fitted(one.points, one.headings, tolerance_m, least_m, drawn.work.spend)
            for (first, last), bows in zip(found.spans, found.biarcs, strict=True):
                span = begin + float(one.points_at_m[first]), begin + float(one.points_at_m[last])
                if bows is None:
                    tight.append(span)
                else:
                    parts.append(_FittedArcs(*span, bows))
    return parts, _joined(tight)


def _laid(drawn: _SmoothLine, blends: list[_Blend], parts: list[_FittedArcs], tolerance_m: float) -> Route:
    """Return the route through blends and parts in order; each piece starts at the end of the previous piece."""
    order = sorted([*((part.low_m, part.bows) for part in parts), *((blend.low_m, blend.bows) for blend in blends)],
                   key=lambda some: some[0])
    bows = _merged([bow for _, some in order for bow in some])
    lead_in_m = 0.0 if bows[0].is_straight else LEAD_IN_M
    if lead_in_m:
        heading = bows[0].heading
        bows = [Bow(bows[0].start - lead_in_m * heading, heading, lead_in_m, 0.0), *bows]
    if len(bows) > PIECES.high:
        raise InputError(f'the drawing requires {len(bows)} pieces; the limit is {PIECES.high}; give a larger '
                         '--tolerance, or draw a shorter line', field='tolerance', pieces=len(bows))
    shift_m = _shift_m([bow for _, some in order for bow in some], bows[1:] if lead_in_m else bows)
    apart_m = max((_apart_m(drawn, part, _FINE * tolerance_m) for part in parts), default=0.0)
    return Route(_pieces(bows), tuple(_change(drawn, blend) for blend in blends), apart_m + shift_m, lead_in_m)


def _apart_m(drawn: _SmoothLine, part: _FittedArcs, sag_m: float) -> float:
    """Return the Hausdorff distance between arcs and the part of the drawn line that they replace.

    It is never too small, and too large by at most ``sag_m`` and a thousandth.
    """
    line = drawn.drawn_between(part.low_m, part.high_m)
    arcs = np.concatenate([bow.points(sag_m) for bow in part.bows])
    off_m = max(_farthest_m(line, arcs), _farthest_m(arcs, line))
    if off_m <= _SAME * float(np.sum(np.abs(np.diff(line)))):
        return off_m
    return off_m if all(bow.is_straight for bow in part.bows) else off_m + sag_m


def _farthest_m(line: Complexes, other: Complexes) -> float:
    """Return the largest distance of the line through points (n,) from the line through other points.

    It is never too small, and too large by at most a thousandth. Between two points, the distance from any one leg of
    the other line is at most that of the farther point; parts for which this is too little are halved.
    """
    legs = _Legs(other)
    near = legs.nearest(line)
    first, last = near.some(slice(None, -1)), near.some(slice(1, None))
    least_m = most_m = float(np.max(near.away_m))
    while len(first.points):
        bound_m = np.minimum(*(np.maximum(one.away_m, legs.distances_m(two.points, one.leg))
                               for one, two in ((first, last), (last, first))))
        is_open = bound_m > (1 + _MORE) * least_m + _TINY_M + _SAME * np.abs(last.points - first.points)
        most_m = max(most_m, float(np.max(bound_m[~is_open], initial=0.0)))
        first, last = first.some(is_open), last.some(is_open)
        if len(first.points):
            middle = legs.nearest(0.5 * (first.points + last.points))
            least_m = max(least_m, float(np.max(middle.away_m)))
            first, last = first.joined(middle), middle.joined(last)
    return max(least_m, most_m)


def _shift_m(bows: list[Bow], laid: list[Bow]) -> float:
    """Return how far the ends of pieces move when each piece starts at the end pose of the previous piece."""
    ends_m = np.cumsum([bow.length_m for bow in bows])
    ends = np.array([bow.end for bow in bows])
    at, heading, along, worst = laid[0].start, laid[0].heading, 0.0, 0.0
    for one in laid:
        bow = Bow(at, heading, one.length_m, one.angle_rad)
        at, heading, along = bow.end, bow.leaving, along + one.length_m
        k = int(np.clip(np.searchsorted(ends_m, along), 1, len(ends_m) - 1)) if len(ends_m) > 1 else 0
        k -= bool(k and along - ends_m[k - 1] < ends_m[k] - along)
        worst = max(worst, abs(ends[k] - at))
    return worst


def _change(drawn: _SmoothLine, blend: _Blend) -> Change:
    at, _ = drawn.pose(0.5 * (blend.low_m + blend.high_m), True)
    off_m = _apart_m(drawn, _FittedArcs(blend.low_m, blend.high_m, blend.bows), _MEASURED * blend.radius_m)
    return Change((at.real, at.imag), blend.radius_m, off_m, blend.is_corner)


def _merged(bows: list[Bow]) -> list[Bow]:
    """Return the arcs and lines, with adjacent arcs of equal radius and adjacent lines merged."""
    out = list[Bow]()
    for bow in bows:
        if out and _are_one(out[-1], bow):
            last = out.pop()
            bow = Bow(last.start, last.heading, last.length_m + bow.length_m, last.angle_rad + bow.angle_rad)
        out.append(bow)
    return out


def _are_one(first: Bow, second: Bow) -> bool:
    if first.is_straight or second.is_straight:
        return first.is_straight and second.is_straight
    alike = abs(first.radius_m - second.radius_m) <= _ALIKE * first.radius_m
    return alike and (first.angle_rad > 0) == (second.angle_rad > 0)


def _pieces(bows: list[Bow]) -> tuple[Piece, ...]:
    """Return arcs as the pieces of a spec; the first piece states its position."""
    x, y, heading = bows[0].start.real, bows[0].start.imag, degrees(cmath.phase(bows[0].heading))
    first, *others = (Line(_plain(bow.length_m)) if bow.is_straight else
                      Arc(_plain(bow.radius_m), _plain(degrees(bow.angle_rad))) for bow in bows)
    return replace(first, at_m=(_plain(x), _plain(y)), heading_deg=_plain(heading)), *others


def _plain(value: float) -> float:
    """Round off the noise in the last digits of a number; this moves a kilometre of track by a nanometre."""
    return round(value, _DECIMALS)
