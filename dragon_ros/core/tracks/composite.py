"""Tracks (segments joined end to end) and positions on tracks.

A track is a sequence of segments in the head's direction; a single spiral is a track of one segment. A position
(``Place``) consists of the index of a segment and a coordinate on that segment. The next handle is at the first
position behind (or ahead of) the previous handle at which the straight distance between them equals the length of the
link. A composite track is rejected unless its largest curvature times the longest link is below 2. The chord then grows
along the track until it reaches the length of the link, so exactly one such position exists within ``reach_m``. This
position moves forward when the preceding handle does, and no link ever locks. A single spiral leads to its centre,
where links may lock and followers may turn back; ``may_lock`` is true for such a track.
"""
import cmath
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import degrees, hypot, inf, pi, radians, remainder, sqrt
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.checks import number
from dragon_ros.core.domain import TRACK
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.numerics.types import Array, Floats, Ints, read_only
from dragon_ros.core.tracks.s_turn import s_turn_segments
from dragon_ros.core.tracks.segments import BEHIND, LARGEST_BEND, ArcSegment, LineSegment, Segment, reach_m
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Piece, Spiral, SpiralArc, STurn, TrackSpec
from dragon_ros.core.tracks.spiral import BEYOND_M, TIGHT, TINY, SpiralCurve, SpiralSegment

_ULPS = 2.0**-49    # bound on the sum of a few rounding errors, relative to a coordinate and its distance
_NEAR_M, _NEAR_RAD = 1e-6, 1e-6     # largest difference between the end of a piece and the stated start of the next

SAG_M = 0.002               # on a screen that shows tens of metres, smaller deviations are invisible
_MOST_POINTS = 100_000      # maximum number of points of a polyline per segment
_MOST_IN_ALL = 1_000_000    # and in all

Places = tuple[Ints, Floats]        # indices of the segments, and the coordinates on them


class Place(NamedTuple):
    """A position on a track: the index of a segment and a coordinate on that segment."""

    segment: int
    u: float

    @classmethod
    def of(cls, segment: Any, u: Any) -> 'Place':
        """Return the position given by array elements or plain numbers."""
        return cls(int(segment), float(u))


def least_radius_m(links_m: Floats) -> float:
    """Return the radius of the tightest bend that links of these lengths can follow."""
    return float(np.max(links_m)) / LARGEST_BEND


@dataclass(frozen=True, eq=False)
class Track:
    """Segments in the head's direction; ``origins_m`` holds the distances of their anchors along the track."""

    segments: tuple[Segment, ...]
    origins_m: tuple[float, ...]
    may_lock: bool = False

    @cached_property
    def bend(self) -> float:
        """Largest curvature (1/m)."""
        return max(segment.bend for segment in self.segments)

    @cached_property
    def begin_m(self) -> float:
        """Distance along the track at its start; -inf if the track has no start."""
        return self._distance(0, self.segments[0].first)

    @cached_property
    def end_m(self) -> float:
        """Distance along the track at its end; inf if the track has no end."""
        return self._distance(len(self.segments) - 1, self.segments[-1].last)

    @cached_property
    def from_afar(self) -> SpiralSegment | None:
        """The first segment if it is an unbounded inward spiral, else None; followers never leave such a spiral."""
        first = self.segments[0]
        return first if isinstance(first, SpiralSegment) and first.winding == BEHIND and first.first == inf else None

    @property
    def lap_m(self) -> float:
        """Circumference of the circle with which an endless track begins; infinite if there is no such circle."""
        first = self.segments[0]
        return 2 * pi * first.radius_m if isinstance(first, ArcSegment) and first.first == -inf else inf

    @property
    def end_of_first_m(self) -> float:
        """Distance along the track at the end of the first segment."""
        return self._distance(0, self.segments[0].last)

    def _distance(self, k: int, u: float) -> float:
        if abs(u) == inf:
            return inf if k else -inf
        return float(self.origins_m[k] + self.segments[k].metres(u))

    def distance_of(self, place: Place) -> float:
        """Return the distance of a position along the track."""
        return self._distance(place.segment, place.u)

    def check_links(self, links_m: Floats) -> None:
        """Reject links that are too long for the tightest bend of a composite track; the error names the bend."""
        least = least_radius_m(links_m)
        if not self.may_lock and self.bend * least > 1:
            tight = max(range(len(self.segments)), key=lambda k: self.segments[k].bend)
            raise FieldError(f'track.pieces.{tight + 1}', f'radius {1 / self.bend:.6g} m', f'it bends tighter than '
                             f'{least:.6g} m, 1.01 times half the longest link, and the chain could lock there',
                             'use a larger radius or shorter benches')

    def place_at(self, metres: float) -> Place:
        """Return the position at a distance along the track. Raises TrackEndError more than BEYOND_M beyond an end."""
        if not self.begin_m <= metres <= self.end_m:
            limit_m = self.begin_m if metres < self.begin_m else self.end_m
            if not abs(metres - limit_m) <= BEYOND_M:
                raise TrackEndError(f'the distance {metres:.9g} m is not on the track, which extends from '
                                    f'{self.begin_m:.9g} to '
                                    f'{self.end_m:.9g} m', distance_m=metres, limit_m=self.end_m)
        k = bisect_right(self.joints_m, metres)
        return Place(k, self.segments[k].after(metres - self.origins_m[k]))

    def places_at(self, metres: Floats) -> Places:
        """Return the positions at many distances, all of which must be on the track (see ``place_at``)."""
        number = np.searchsorted(np.array(self.joints_m), metres, side='right')
        here, u = metres - np.array(self.origins_m)[number], np.empty_like(metres)
        for k in self.present(number):
            u[number == k] = self.segments[k].after(here[number == k])
        return number, u

    def present(self, number: Ints) -> list[int]:
        """Return the segment indices that occur in ``number``, in ascending order."""
        if len(self.segments) == 1:
            return [0]
        occurring: list[int] = np.flatnonzero(np.bincount(number.reshape(-1))).tolist()
        return occurring

    @cached_property
    def joints_m(self) -> list[float]:
        """Distances along the track at the starts of all segments but the first."""
        return [self._distance(k, self.segments[k].first) for k in range(1, len(self.segments))]

    def between(self, low_m: float, high_m: float) -> list[tuple[Segment, float, float]]:
        """Return the segments between two distances, each as (segment, u at its beginning, u at its end)."""
        first, last = self.place_at(low_m), self.place_at(high_m)
        return [(segment, first.u if k == first.segment else segment.first,
                 last.u if k == last.segment else segment.last)
                for k, segment in enumerate(self.segments) if first.segment <= k <= last.segment]

    def polyline(self, low_m: float, high_m: float, sag_m: float = SAG_M) -> Floats:
        """Return points (m, shape (n, 2)) along the track between two distances, in the head's direction.

        The polyline deviates from the track by at most ``sag_m`` (R phi^2 / 8 for an angle phi), unless this requires
        more than 100,000 points in a segment, or more than an equal share of 1,000,000 points. The largest curvature on
        each segment determines the density of its points.
        """
        parts, segments = [], self.between(low_m, high_m)
        most = min(_MOST_POINTS, max(2, _MOST_IN_ALL // len(segments)))
        for segment, first, last in segments:
            bend = float(np.max(np.abs(segment.curvature(np.array([first, last])))))
            count = float(segment.metres_between(first, last)) * sqrt(bend / (8 * sag_m))
            places = segment.at(np.linspace(first, last, min(most, 2 + int(count))))
            parts.append(np.stack((places.real, places.imag), axis=1))
        out: Floats = np.concatenate(parts)
        return out

    def far_m(self, low_m: float, high_m: float) -> float:
        """Return an upper bound on the distance from the origin to any point between two distances along the track."""
        return max(min(segment.far_m(a, b), abs(complex(segment.at(0.5 * (a + b))))     # a centre may be far away
                       + 0.5 * float(segment.metres_between(a, b)))
                   for segment, a, b in self.between(low_m, high_m))

    def edge(self, k: int, direction: int) -> float:
        """Return the coordinate at which segment k ends behind or ahead (slightly beyond it at an end of the track)."""
        segment = self.segments[k]
        edge = segment.first if direction == BEHIND else segment.last
        if 0 <= k + direction < len(self.segments) or abs(edge) == inf:
            return edge
        return float(edge + direction * BEYOND_M / segment.rate(edge))

    def across(self, place: Place, chord_m: float, direction: int) -> tuple[Place, int]:
        """Return the next position, which is on another segment, and the number of evaluations.

        Raises TrackEndError if there is no such position.
        """
        k, segment = place.segment, self.segments[place.segment]
        here = complex(segment.at(place.u))
        arc_m = float(segment.metres_between(place.u, segment.first if direction == BEHIND else segment.last))
        reach = reach_m(self.bend, chord_m)
        while 0 <= (k := k + direction) < len(self.segments):
            segment = self.segments[k]
            near, far = segment.last if direction == BEHIND else segment.first, self.edge(k, direction)
            longest = float(segment.metres_between(near, far)) if abs(far) < inf else inf
            if arc_m + longest >= reach or abs(complex(segment.at(far)) - here) >= chord_m:
                return self._cut(k, here, chord_m, direction, (arc_m, reach))
            arc_m += longest
        raise TrackEndError(f'a link of {chord_m:.6g} m does not fit on the track, which is too short there; start the '
                            'head further along, or lengthen the first piece', distance_m=self.distance_of(place))

    def _cut(self, k: int, here: complex, chord_m: float, direction: int,
             arcs_m: tuple[float, float]) -> tuple[Place, int]:
        """Return the position on segment k that is one chord away from a point, and the number of evaluations.

        ``arcs_m`` holds the arc length from the point to the near end of the segment, and the largest possible arc
        length to the position. The solver's tolerance is relative to the unknown, which is therefore offset so that
        it is not close to 0 near the joint.
        """
        arc_m, reach = arcs_m
        segment = self.segments[k]
        near, far = segment.last if direction == BEHIND else segment.first, self.edge(k, direction)
        left, sense = max(reach - arc_m, 0.0), 1.0 if far > near else -1.0
        margin = self._joint_margin_m / abs(segment.rate(near))
        most = min(abs(segment.after(segment.metres(near) + direction * left) - near) + margin, abs(far - near))
        base = most + margin

        def excess(x: float) -> tuple[float, float]:
            u = near + sense * (x - base)
            link = complex(segment.at(u)) - here
            growth = (link.conjugate() * complex(segment.heading(u))).real * segment.rate(u) * sense
            return 0.5 * (link.real * link.real + link.imag * link.imag - chord_m * chord_m), growth

        start = base + most * min(max((chord_m - arc_m) / left, 0.0), 1.0) if left else base
        x, spent = bracketed_newton(excess, most, base + most, start, TIGHT)
        return Place(k, near + sense * (x - base)), spent

    @cached_property
    def _joint_margin_m(self) -> float:
        """Upper bound on the distance by which rounding may move a position away from a joint."""
        ends = [(segment, u) for segment in self.segments for u in (segment.first, segment.last) if abs(u) < inf]
        return _ULPS * max((abs(float(m)) for segment, u in ends for m in (u * segment.rate(u), segment.metres(u))),
                           default=0.0)

    def across_many(self, k: int, u: Floats, chord_m: float, direction: int) -> tuple[Places, int]:
        """Return the next positions on other segments (see ``across``) for many positions on segment k."""
        start, segment, spent = k, self.segments[k], 0
        here = np.asarray(segment.at(u), dtype=np.complex128)
        arc_m = np.asarray(segment.metres_between(u, segment.first if direction == BEHIND else segment.last))
        reach = reach_m(self.bend, chord_m)
        out: Places = np.full(here.shape, k), np.empty(here.shape)
        left = np.arange(here.size)
        while left.size and 0 <= (k := k + direction) < len(self.segments):
            segment = self.segments[k]
            near, far = segment.last if direction == BEHIND else segment.first, self.edge(k, direction)
            longest = float(segment.metres_between(near, far)) if abs(far) < inf else inf
            hit = np.full(left.shape, True) if longest == inf else (
                (arc_m[left] + longest >= reach) | (np.abs(complex(segment.at(far)) - here[left]) >= chord_m))
            on = left[hit]
            if on.size:
                out[0][on] = k
                out[1][on], evaluations = _cuts(segment, (near, far), here[on], chord_m, direction,
                                                (arc_m[on], reach, self._joint_margin_m))
                spent += evaluations
            arc_m, left = arc_m + longest, left[~hit]
        for n in left[:1]:      # raises the error
            self.across(Place.of(start, u[n]), chord_m, direction)
        return out, spent

    @cached_property
    def bends(self) -> tuple[Floats, Floats]:
        """Smallest and largest signed curvatures (1/m) of any two segments and all those between them, each (P, P)."""
        ends = np.array([segment.curvature(np.array([segment.first, segment.last])) for segment in self.segments])
        low, high = np.empty((2, len(ends), len(ends)))
        for k in range(len(ends)):
            low[k, k:] = low[k:, k] = np.minimum.accumulate(np.min(ends[k:], axis=1))
            high[k, k:] = high[k:, k] = np.maximum.accumulate(np.max(ends[k:], axis=1))
        return low, high

    def distances(self, segment: Ints, u: Floats) -> Floats:
        """Return the distances of many positions along the track; ``segment`` has the same meaning as in ``poses``."""
        return self._each(segment, u, lambda k, u: self.origins_m[k] + self.segments[k].metres(u))

    def rates(self, segment: Ints, u: Floats) -> Floats:
        """Return the changes of distance along the track (m) with the coordinate, at many positions."""
        return self._each(segment, u, lambda k, u: self.segments[k].rate(u))

    def curvatures(self, segment: Ints, u: Floats) -> Floats:
        """Return the signed curvatures (1/m) at many positions."""
        return self._each(segment, u, lambda k, u: self.segments[k].curvature(u))

    def _each(self, segment: Ints, u: Floats, value: Callable[[int, Floats], Any]) -> Floats:
        if len(self.segments) == 1:
            only: Floats = np.asarray(value(0, u), dtype=np.float64)
            return only
        out: Floats = np.empty(u.shape)
        u, flat = self._flattened(segment, u, out)
        for k, here in self._groups(segment):
            flat[here] = value(k, u[here])
        return out

    def points(self, segment: Ints, u: Floats) -> Floats:
        """Return the points at many positions (m, shape (..., 2))."""
        return self._vectors(segment, u, lambda k, u: self.segments[k].at(u))

    def headings(self, segment: Ints, u: Floats) -> Floats:
        """Return the unit tangents (shape (..., 2)) in the head's direction."""
        return self._vectors(segment, u, lambda k, u: self.segments[k].heading(u))

    def poses(self, segment: Ints, u: Floats) -> tuple[Floats, Floats]:
        """Return the results of ``points`` and ``headings``; computing both takes little longer than computing one.

        If ``segment`` lacks the last axes of ``u``, each index applies to all positions along these axes.
        """
        points, headings = (np.empty(u.shape, dtype=np.complex128) for _ in range(2))
        u, p, h = self._flattened(segment, u, points, headings)
        for k, here in self._groups(segment):
            p[here], h[here] = self.segments[k].poses(u[here])
        return _vectors_of(points), _vectors_of(headings)

    def _vectors(self, segment: Ints, u: Floats, value: Callable[[int, Floats], Array]) -> Floats:
        out = np.empty(u.shape, dtype=np.complex128)
        u, flat = self._flattened(segment, u, out)
        for k, here in self._groups(segment):
            flat[here] = value(k, u[here])
        return _vectors_of(out)

    def _flattened(self, segment: Ints, *values: Array) -> tuple[Array, ...]:
        """Return arrays with the axes of ``segment`` flattened into one, to match the indices of ``_groups``."""
        if len(self.segments) == 1:
            return values
        return tuple(np.ascontiguousarray(each).reshape(segment.size, *each.shape[segment.ndim:]) for each in values)

    def _groups(self, segment: Ints) -> Iterator[tuple[int, Any]]:
        """Yield the index of each segment that contains positions, with the indices of these positions in flat order.

        All groups are found with one sort, because comparing all positions with each segment would take longer than the
        geometry itself.
        """
        occurring = self.present(segment)
        if len(occurring) == 1:
            yield occurring[0], ...
            return
        flat = segment.reshape(-1)
        order = np.argsort(flat.astype(np.uint16) if len(self.segments) <= 65_536 else flat, kind='stable')
        begin = 0
        for k, count in zip(occurring, np.bincount(flat)[occurring].tolist(), strict=True):
            yield k, order[begin:begin + count]
            begin += count


def _vectors_of(points: Array) -> Floats:
    """Return complex numbers of shape (...) as real vectors of shape (..., 2)."""
    return read_only(points.view(np.float64).reshape(*points.shape, 2))


def _guessed(segment: Segment, near: float, here: Array, chord_m: float, direction: int) -> Floats:
    """Return the approximate distances from a segment's near end to the points one chord away from given points.

    The segment is replaced by its osculating circle at the near end, which is exact for lines and arcs. If the chord
    does not reach that circle, the tangent is used.
    """
    link = (complex(segment.at(near)) - here) / (direction * complex(segment.heading(near)))
    aside = np.abs(link.imag)
    out: Floats = np.sqrt(np.maximum(0.0, (chord_m - aside) * (chord_m + aside))) - link.real
    if bend := direction * float(segment.curvature(near)):
        centre = link + 1j / bend       # the point after x m on the circle is centre - 1j / bend * exp(1j * bend * x)
        far = np.abs(centre)
        cosine = 0.5 * ((far - chord_m) * (far + chord_m) * bend * bend + 1) / np.maximum(far * abs(bend), TINY)
        begin, angle = np.angle(centre * (bend / 1j)), np.arccos(np.clip(cosine, -1.0, 1.0))
        both = np.array((begin - angle, begin + angle)) / bend % (2 * pi / abs(bend))
        nearer = np.abs(both[0] - out) <= np.abs(both[1] - out)
        out = np.where(np.abs(cosine) <= 1, np.where(nearer, *both), out)
    return out


def _cuts(segment: Segment, ends: tuple[float, float], here: Array, chord_m: float, direction: int,
          arcs_m: tuple[Floats, float, float]) -> tuple[Floats, int]:
    """Find the positions that ``Track._cut`` would return for many points, using bracketed Newton iteration."""
    (near, far), (arc_m, reach, margin_m) = ends, arcs_m
    rate, sense = abs(float(segment.rate(near))), 1.0 if far > near else -1.0
    left, margin = np.maximum(reach - arc_m, 0.0), margin_m / rate
    along = np.abs(segment.after(segment.metres(near) + direction * left) - near)
    most = np.minimum(along + margin, abs(far - near))
    low, high = np.full_like(arc_m, -margin), most
    x = np.clip(_guessed(segment, near, here, chord_m, direction) / rate, low, most)
    last, spent = most + margin, 0
    for _ in range(80):
        u = near + sense * x
        point, heading = segment.poses(u)
        link = point - here
        value = 0.5 * (link.real * link.real + link.imag * link.imag - chord_m * chord_m)
        slope = (link.conjugate() * heading).real * segment.rate(u) * sense
        low, high, spent = np.where(value <= 0, x, low), np.where(value >= 0, x, high), spent + x.size
        change = value / np.where(slope > 0, slope, TINY)
        small = np.abs(change) <= TIGHT * (most + margin)
        newton = small | ((low <= x - change) & (x - change <= high) & (np.abs(change) <= 0.5 * last))
        following = np.clip(np.where(newton, x - change, low + 0.5 * (high - low)), low, high)
        last, x = np.abs(following - x), following
        if np.all(small | (high - low <= 4e-16 * (most + margin))):
            break
    return near + sense * x, spent


def track_of(spec: TrackSpec, direction: int = BEHIND) -> Track:
    """Return the track that a spec describes. Raises FieldError with the name of the joint if pieces do not meet.

    A single spiral ends at its centre or, if the tail leads (``direction`` AHEAD), at the head's initial position.
    Distances are measured from the head's initial position on a spiral, from the entry on an S-turn, and from the start
    of the first piece on a composite track.
    """
    if isinstance(spec, Spiral):
        last, may_lock = (0.0, True) if direction == BEHIND else (spec.start, False)
        return Track((SpiralSegment(SpiralCurve.of(spec), 0j, 1 + 0j, 1, BEHIND, inf, last),), (0.0,), may_lock)
    if isinstance(spec, STurn):
        return Track(*s_turn_segments(spec))
    track = _composite(spec)
    number('track.start_m', spec.start_m, high=track.end_m, low=max(track.begin_m, -TRACK.high))
    return track


def _composite(spec: Composite) -> Track:
    segments: list[Segment] = []
    origins, rest_m, rest = [0.0], 0.0, 0j      # what rounding has left out of distances and points (Kahan's summation)
    first = spec.pieces[0]
    point, heading = complex(*(first.at_m or (0.0, 0.0))), cmath.rect(1.0, radians(first.heading_deg or 0.0))
    for k, piece in enumerate(spec.pieces):
        _check_joint(k, piece, point, heading)
        one = _segment(piece, point, heading, open_ended=k == 0)
        segments.append(one)
        length_m = one.metres(one.last) + rest_m
        origins.append(origins[-1] + length_m)
        rest_m = length_m - (origins[-1] - origins[-2])
        moved, heading = _end_of(piece, _segment(piece, 0j, heading, open_ended=False))
        moved += rest
        rest, point = moved - ((point + moved) - point), point + moved
    return Track(tuple(segments), tuple(origins[:-1]))


def _segment(piece: Piece, start: complex, heading: complex, open_ended: bool) -> Segment:
    """Return the segment for a piece that begins at a given point.

    An open-ended piece extends backwards indefinitely, as a line, a circle that is traversed repeatedly, or a spiral
    that winds in. A spiral that winds out cannot be extended.
    """
    if isinstance(piece, Line):
        return LineSegment(start, heading, -inf if open_ended else 0.0, piece.length_m)
    if isinstance(piece, Arc):
        side = 1 if piece.angle_deg > 0 else -1
        return ArcSegment(start, heading, piece.radius_m, side, -inf if open_ended else 0.0,
                          abs(radians(piece.angle_deg)))
    curve = SpiralCurve(piece.pitch_m, 2 * pi * piece.from_turns)
    winding = BEHIND if piece.to_turns < piece.from_turns else 1
    side = 1 if (piece.side == 'left') == (winding == 1) else -1
    theta, last = curve.start, 2 * pi * piece.to_turns
    bare = SpiralSegment(curve, 0j, 1 + 0j, side, winding, theta, last)
    point, direction = bare.posed(theta, _turned(side * piece.from_turns))
    rotation = heading / direction
    rotation /= abs(rotation)
    centre = start - rotation * point
    first = inf if open_ended and winding == BEHIND else theta
    return SpiralSegment(curve, centre, rotation, side, winding, first, last)


def _end_of(piece: Piece, segment: Segment) -> tuple[complex, complex]:
    """Return the point and the unit tangent at the end of a piece.

    Whole turns are left out, because the rounding of large angles would turn all later pieces.
    """
    if isinstance(segment, SpiralSegment) and isinstance(piece, SpiralArc):
        point, heading = segment.posed(segment.last, _turned(segment.side * piece.to_turns))
        return complex(point), complex(heading)
    u = radians(abs(piece.angle_deg) % 360) if isinstance(piece, Arc) else segment.last
    return complex(segment.at(u)), complex(segment.heading(u))


def _turned(turns: float) -> complex:
    """Return exp(2 pi i turns)."""
    return cmath.rect(1.0, 2 * pi * remainder(turns, 1.0))


def _check_joint(k: int, piece: Piece, point: complex, heading: complex) -> None:
    """Reject a piece whose stated start or heading differs from the end of the preceding piece."""
    if piece.at_m is not None:
        x, y = piece.at_m
        gap = hypot(x - point.real, y - point.imag)
        if gap > _NEAR_M:
            raise FieldError(f'track.pieces.{k + 1}.at_m', [x, y], f'joint {k}: piece {k} ends {gap:.6g} m from there, '
                             f'at [{point.real:.9g}, {point.imag:.9g}]',
                             'remove this key, or change the preceding pieces')
    if piece.heading_deg is not None:
        off = remainder(radians(piece.heading_deg) - cmath.phase(heading), 2 * pi)
        if abs(off) > _NEAR_RAD:
            raise FieldError(f'track.pieces.{k + 1}.heading_deg', piece.heading_deg, f'joint {k}: piece {k} ends '
                             f'{degrees(-off):.6g} degrees from there, at {degrees(cmath.phase(heading)):.9g}',
                             'remove this key, or change the preceding pieces')
