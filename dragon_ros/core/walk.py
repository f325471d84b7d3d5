"""Handle after handle along pieces of track joined end to end.

The next handle is the first place behind at the chord's length. The largest curvature times the longest link is below 2
(else the track is refused): then the chord grows along the track until it is reached, there is one such place within
``chord.reach_m``, it moves on as the handle before it moves on, and no link ever locks.
"""
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Any, NamedTuple

import numpy as np

from dragon_ros.core.angle import Angle, plus
from dragon_ros.core.chord import reach_m
from dragon_ros.core.errors import FieldError, TrackEndError
from dragon_ros.core.march import Effort
from dragon_ros.core.march import place as place_on_spiral
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.numerics.types import Floats, Ints, read_only
from dragon_ros.core.path import Spiral
from dragon_ros.core.placed import BACK, Placed, PlacedSpiral, metres_between

_LARGEST = 1.98     # of curvature times link: 2 is where a link may lock
_HAIR = 1e-9        # of a distance: the leader may be so far beyond the track's end by rounding
_SLACK = 0.02       # of a link: a follower may be so far beyond it by what the coarsest tier errs


class Place(NamedTuple):
    """A place on a walk: the piece's number and its coordinate."""

    piece: int
    u: Angle

    @classmethod
    def of(cls, piece: Any, u: Any, lo: Any) -> 'Place':
        """Return the place of numbers from arrays."""
        return cls(int(piece), Angle(float(u), float(lo)))


def least_radius_m(links_m: Floats) -> float:
    """Return the radius of the tightest bend that links can follow."""
    return float(np.max(links_m)) / _LARGEST


@dataclass(frozen=True)
class Walk:
    """Pieces in the order of the head's way; ``origins_m`` are the distances along the way at their anchors."""

    pieces: tuple[Placed, ...]
    origins_m: tuple[float, ...]

    may_lock = False     # where links may lock, on a spiral to its centre

    @cached_property
    def bend(self) -> float:
        """Largest curvature in 1/m."""
        return max(piece.bend for piece in self.pieces)

    @cached_property
    def begin_m(self) -> float:
        """Distance along the way where the track begins; -inf if it is open."""
        return self._distance(0, self.pieces[0].first)

    @cached_property
    def end_m(self) -> float:
        """Distance along the way where the track ends; inf if it is open."""
        return self._distance(len(self.pieces) - 1, self.pieces[-1].last)

    @property
    def winds_in(self) -> bool:
        """Whether the first piece is a spiral that winds in from afar."""
        return self.afar is not None

    @property
    def end_of_first_m(self) -> float:
        """Distance along the way where the first piece ends."""
        return self._distance(0, self.pieces[0].last)

    def _distance(self, k: int, u: float) -> float:
        if abs(u) == inf:
            return inf if k else -inf
        return float(self.origins_m[k] + self.pieces[k].metres(u))

    def distance_of(self, place: Place) -> tuple[float, float]:
        """Return the distance of a place along the way, as (hi, lo)."""
        piece = self.pieces[place.piece]
        return plus(piece.metres(place.u.hi), piece.rate(place.u.hi) * place.u.lo, self.origins_m[place.piece])

    def check_links(self, links_m: Floats) -> None:
        """Refuse links that are too long for the track's tightest bend."""
        least = least_radius_m(links_m)
        if self.bend * least > 1:
            tight = max(range(len(self.pieces)), key=lambda k: self.pieces[k].bend)
            raise FieldError('track', f'radius {1 / self.bend:.6g} m', f'piece {tight + 1} bends tighter than '
                             f'{least:.6g} m, a hair over half the longest link, and the chain could lock there',
                             'use larger radii or shorter benches')

    def place_at(self, metres: float, lo: float = 0.0) -> Place:
        """Return the place so far along the way. Raises TrackEndError where there is no track."""
        k = bisect_right(self.joints_m, metres)
        hair = _HAIR * (1 + abs(metres))
        if not self.begin_m - hair <= metres <= self.end_m + hair:
            raise TrackEndError(f'{metres:.9g} m along the track is not on it: it goes from {self.begin_m:.9g} to '
                                f'{self.end_m:.9g} m', distance_m=metres, limit_m=self.end_m)
        here, here_lo = plus(metres, lo, -self.origins_m[k])
        return Place(k, self.pieces[k].after(here, here_lo))

    @cached_property
    def joints_m(self) -> list[float]:
        """Distances along the way at the beginnings of all pieces but the first."""
        return [self._distance(k, self.pieces[k].first) for k in range(1, len(self.pieces))]

    def between(self, low_m: float, high_m: float) -> list[tuple[Placed, float, float]]:
        """Return the pieces on a stretch of the way, with u where each begins and ends on it."""
        first, last = self.place_at(low_m), self.place_at(high_m)
        return [(piece, first.u.hi if k == first.piece else piece.first, last.u.hi if k == last.piece else piece.last)
                for k, piece in enumerate(self.pieces) if first.piece <= k <= last.piece]

    def next(self, place: Place, chord_m: float, way: int, tolerance: float) -> tuple[Place, int]:
        """Return the place of the next handle, behind (``way`` BACK) or ahead, and evaluations."""
        piece, u = self.pieces[place.piece], place.u
        edge = self.edge(place.piece, chord_m, way)
        following, spent = piece.next(u, chord_m, way, tolerance)
        if min(u.hi, edge) <= following.hi <= max(u.hi, edge) and abs(following.hi) < inf:
            return Place(place.piece, following), spent
        found, more = self._across(place, chord_m, way, tolerance)
        return found, spent + more

    def edge(self, k: int, chord_m: float, way: int) -> float:
        """Return where piece k ends behind or ahead; a little further at the track's own ends."""
        piece = self.pieces[k]
        edge = piece.first if way == BACK else piece.last
        if 0 <= k + way < len(self.pieces) or abs(edge) == inf:
            return edge
        return edge + way * _SLACK * chord_m / piece.rate(edge)

    def _across(self, place: Place, chord_m: float, way: int, tolerance: float) -> tuple[Place, int]:
        """Return the next place beyond one joint or more."""
        k, piece = place.piece, self.pieces[place.piece]
        here = complex(piece.at(*place.u))
        gone = metres_between(piece, place.u.hi, piece.first if way == BACK else piece.last)
        reach = reach_m(self.bend, chord_m)
        while 0 <= (k := k + way) < len(self.pieces):
            piece = self.pieces[k]
            near, far = piece.last if way == BACK else piece.first, self.edge(k, chord_m, way)
            longest = metres_between(piece, near, far) if abs(far) < inf else inf
            if gone + longest >= reach or abs(complex(piece.at(far)) - here) >= chord_m:
                return self._cut(k, here, chord_m, way, (gone, reach), tolerance)
            gone += longest
        raise TrackEndError(f'a link of {chord_m:.6g} m finds no track: it begins or ends too close; start the head '
                            'further along, or lengthen the first piece', distance_m=self.distance_of(place)[0])

    def _cut(self, k: int, here: complex, chord_m: float, way: int, arcs_m: tuple[float, float],
             tolerance: float) -> tuple[Place, int]:
        """Return where piece k is at a chord's length from a point; arcs from there to it: to its near end, at most.

        Solved for ``most`` more than the way from the near end, so that a step next to the joint is not relative to 0.
        """
        gone, reach = arcs_m
        piece = self.pieces[k]
        near, far = piece.last if way == BACK else piece.first, self.edge(k, chord_m, way)
        most = min(abs(piece.after(piece.metres(near) + way * (reach - gone)).hi - near), abs(far - near))
        sense = 1.0 if far > near else -1.0

        def excess(x: float) -> tuple[float, float]:
            u = near + sense * (x - most)
            link = complex(piece.at(u)) - here
            growth = (link.conjugate() * complex(piece.heading(u))).real * piece.rate(u) * sense
            return 0.5 * (link.real * link.real + link.imag * link.imag - chord_m * chord_m), growth

        start = most + most * min(max((chord_m - gone) / (reach - gone), 0.0), 1.0)
        x, spent = bracketed_newton(excess, most, 2 * most, start, tolerance)
        return Place(k, Angle(*plus(near, 0.0, sense * (x - most)))), spent

    def follow(self, links_m: Floats, leader: Place, way: int, effort: Effort) -> tuple[list[Place], int]:
        """Return the places of all handles from the leader on, and evaluations."""
        places, spent = [leader], 0
        for i, chord_m in enumerate(links_m.tolist()):
            place = places[-1]
            if way == BACK and place.piece == 0 and self.afar:
                rest = place_on_spiral(self.afar, links_m[i:], place.u, effort)
                places += [Place(0, Angle(*u)) for u in zip(rest.theta[1:].tolist(), rest.theta_lo[1:].tolist(),
                                                            strict=True)]
                return places, spent + rest.evaluations
            place, more = self.next(place, chord_m, way, effort.newton)
            places.append(place)
            spent += more
        return places, spent

    @cached_property
    def afar(self) -> Spiral | None:
        """The spiral of the first piece, where it winds in from afar: all that reaches it stays on it."""
        first = self.pieces[0]
        return first.spiral if isinstance(first, PlacedSpiral) and first.way == BACK and first.first == inf else None

    @cached_property
    def bends(self) -> tuple[Floats, Floats]:
        """Smallest and largest signed curvature in 1/m on all pieces from one to another, (P, P) each."""
        ends = np.array([piece.curvature(np.array([piece.first, piece.last])) for piece in self.pieces])
        count = range(len(self.pieces))
        rows = [[ends[min(i, j):max(i, j) + 1] for j in count] for i in count]
        return (np.array([[np.min(part) for part in row] for row in rows]),
                np.array([[np.max(part) for part in row] for row in rows]))

    def distances(self, piece: Ints, u: Floats) -> Floats:
        """Return the distances of many places along the way."""
        return self._each(piece, u, lambda k, u: self.origins_m[k] + self.pieces[k].metres(u))

    def curvatures(self, piece: Ints, u: Floats) -> Floats:
        """Return the signed curvatures at many places in 1/m."""
        return self._each(piece, u, lambda k, u: self.pieces[k].curvature(u))

    @staticmethod
    def _each(piece: Ints, u: Floats, value: Callable[[int, Floats], Any]) -> Floats:
        out: Floats = np.empty(u.shape)
        for k in np.unique(piece).tolist():
            out[piece == k] = value(k, u[piece == k])
        return out

    def points(self, piece: Ints, u: Floats, lo: Floats) -> tuple[Floats, Floats]:
        """Return coordinates and unit tangents in the head's way, shapes (..., 2)."""
        p, t = np.empty((*u.shape, 2)), np.empty((*u.shape, 2))
        for k in np.unique(piece).tolist():
            here = piece == k
            for out, z in ((p, self.pieces[k].at(u[here], lo[here])), (t, self.pieces[k].heading(u[here]))):
                out[here, 0], out[here, 1] = z.real, z.imag
        return read_only(p), read_only(t)
