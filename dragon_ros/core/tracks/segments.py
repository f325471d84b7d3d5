"""Segments of a track in the plane: the common interface, lines and arcs.

Points and directions are complex numbers or complex arrays; ``heading`` is the head's direction along the segment.
The coordinate u along a segment is the distance in metres on a line, the angle turned in radians on an arc and the
polar angle on a spiral (``spiral``).
"""
import cmath
from collections.abc import Iterable
from dataclasses import dataclass
from math import asin
from typing import Any, NamedTuple, Protocol

import numpy as np

from dragon_ros.core.numerics.types import Array, Floats

BEHIND, AHEAD = -1, 1         # against and along the head's direction
LARGEST_BEND = 1.98     # limit on curvature times chord: links may lock at 2; roots are well conditioned 1 % below that


class Past(NamedTuple):
    """What is known of many positions (M,): differences of squared angles over up to three links, the latest first.

    ``rest`` is what rounding has left out of the coordinates (Kahan's summation).
    """

    squares: tuple[Floats, ...]
    rest: Floats | float

    def some(self, which: Array) -> 'Past':
        """Return what is known of a subset of the positions."""
        return Past(tuple(each[which] for each in self.squares), np.asarray(self.rest)[which])


NEW = Past((), 0.0)


class Segment(Protocol):
    """The interface that all segments implement; the coordinate of an open end is infinite."""

    @property
    def first(self) -> float:
        """Coordinate at the start of the segment."""
        ...

    @property
    def last(self) -> float:
        """Coordinate at the end of the segment."""
        ...

    @property
    def bend(self) -> float:
        """Largest curvature (1/m)."""
        ...

    def at(self, u: Any) -> Any:
        """Return the point."""
        ...

    def poses(self, u: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents at many positions."""
        ...

    def heading(self, u: Any) -> Any:
        """Return the unit tangent in the head's direction."""
        ...

    def rate(self, u: Any) -> Any:
        """Return the distance in metres in the head's direction per unit of u (negative if u decreases that way)."""
        ...

    def metres(self, u: Any) -> Any:
        """Return the distance from the anchor to u, positive in the head's direction."""
        ...

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length of the segment between two coordinates, computed without cancellation."""
        ...

    def curvature(self, u: Any) -> Any:
        """Return the curvature (1/m), positive if the head turns left; it is monotone along the segment."""
        ...

    def after(self, metres: Any) -> Any:
        """Return the coordinate at a distance in metres from the anchor, measured in the head's direction."""
        ...

    def far_m(self, a: float, b: float) -> float:
        """Return an upper bound on the distance from the origin to the segment between two coordinates."""
        ...

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past = NEW) -> tuple[Floats, int]:
        """Return the coordinate changes to the next positions (inf if there is none), and the number of evaluations.

        The changes are predicted from ``past``. Raises ChainLockError if a link locks.
        """
        ...

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return the input of the predictor for the given coordinate changes."""
        ...

    def march(self, u: float, links_m: list[float], direction: int, edge: float) -> tuple[list[float], int]:
        """Return the coordinates of the next handles, one for each link, and the number of evaluations.

        The march stops before the first handle that is beyond ``edge`` or cannot be placed.
        """
        ...


@dataclass(frozen=True)
class LineSegment:
    """A straight line from ``start`` along ``direction``; the anchor is at ``start``."""

    start: complex
    direction: complex
    first: float
    last: float
    bend = 0.0

    def at(self, u: Any) -> Any:
        """Return the point."""
        return self.start + self.direction * u

    def heading(self, u: Any) -> Any:
        """Return the unit tangent in the head's direction."""
        return self.direction + 0 * u

    def poses(self, u: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents at many positions."""
        return self.at(u), self.heading(u)

    def rate(self, u: Any) -> Any:
        """Return the distance in metres per unit of u."""
        return 1.0

    def metres(self, u: Any) -> Any:
        """Return the distance from the start to u."""
        return u

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between two coordinates."""
        return abs(a - b)

    def curvature(self, u: Any) -> Any:
        """Return 0."""
        return np.zeros_like(u)

    def after(self, metres: Any) -> Any:
        """Return the coordinate at a distance in metres from the start."""
        return metres

    def far_m(self, a: float, b: float) -> float:
        """Return an upper bound on the distance from the origin to the segment between two coordinates."""
        return max(abs(complex(self.at(a))), abs(complex(self.at(b))))

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past = NEW) -> tuple[Floats, int]:
        """Return the coordinate changes to the next positions, and the number of evaluations."""
        return np.full_like(u, direction * chord_m), 0

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return ``shift`` itself: the changes have a closed form, so no predictor is needed."""
        return shift

    def march(self, u: float, links_m: list[float], direction: int, edge: float) -> tuple[list[float], int]:
        """Return the coordinates of at most ``len(links_m)`` further handles."""
        return _shifted(u, links_m, direction, edge)


@dataclass(frozen=True)
class ArcSegment:
    """An arc from ``start``, the anchor, in the unit direction ``direction``.

    ``side`` is 1 if the arc turns left and -1 if it turns right. Points are computed from the start, not from the
    centre, which may be far away: after an angle u, the chord 2 R sin(u / 2) has turned by u / 2.
    """

    start: complex
    direction: complex
    radius_m: float
    side: int
    first: float
    last: float

    @property
    def bend(self) -> float:
        """Curvature (1/m)."""
        return 1 / self.radius_m

    def at(self, u: Any) -> Any:
        """Return the point."""
        half = direction_at(0.5 * self.side * u)
        return self.start + 2 * self.side * self.radius_m * self.direction * (half.imag * half)

    def heading(self, u: Any) -> Any:
        """Return the unit tangent in the head's direction."""
        return self.direction * direction_at(self.side * u)

    def poses(self, u: Floats) -> tuple[Array, Array]:
        """Return points and unit tangents at many positions."""
        return self.at(u), self.heading(u)

    def rate(self, u: Any) -> Any:
        """Return the distance in metres per unit of u."""
        return self.radius_m

    def metres(self, u: Any) -> Any:
        """Return the distance from the start to u."""
        return self.radius_m * u

    def metres_between(self, a: Any, b: float) -> Any:
        """Return the length between two coordinates."""
        return self.radius_m * abs(a - b)

    def curvature(self, u: Any) -> Any:
        """Return the signed curvature."""
        return np.full_like(u, self.side / self.radius_m)

    def after(self, metres: Any) -> Any:
        """Return the coordinate at a distance in metres from the start."""
        return metres / self.radius_m

    def far_m(self, a: float, b: float) -> float:
        """Return an upper bound on the distance from the origin to the segment between two coordinates."""
        return abs(self.start + 1j * self.side * self.radius_m * self.direction) + self.radius_m

    def shifts(self, u: Floats, chord_m: float, direction: int, past: Past = NEW) -> tuple[Floats, int]:
        """Return the coordinate changes to the next positions, and the number of evaluations."""
        return np.full_like(u, direction * arc_span(self.radius_m, chord_m)), 0

    def squares(self, u: Floats, shift: Floats) -> Floats:
        """Return ``shift`` itself: the changes have a closed form, so no predictor is needed."""
        return shift

    def march(self, u: float, links_m: list[float], direction: int, edge: float) -> tuple[list[float], int]:
        """Return the coordinates of at most ``len(links_m)`` further handles."""
        spans = {link_m: arc_span(self.radius_m, link_m) for link_m in set(links_m)}
        return _shifted(u, map(spans.__getitem__, links_m), direction, edge)


def reach_m(bend: float, chord_m: float) -> float:
    """Return the longest arc that a chord can span on a track with a curvature of at most ``bend`` (1/m).

    If the curvature times the chord is below 2, the chord from a fixed position grows along the track until the arc
    length is pi / bend. The tangents at two arc lengths sigma < s differ by an angle of at most bend (s - sigma), so
    the chord grows at a rate of at least sin(bend s) / (bend chord) > 0. By Schur's comparison with a circle, the
    chord is at least 2 sin(bend s / 2) / bend. The chord therefore reaches ``chord_m`` exactly once, at an arc length
    of at most 2 asin(bend chord_m / 2) / bend.
    """
    return 2 * asin(0.5 * bend * chord_m) / bend if bend else chord_m


def arc_span(radius_m: float, chord_m: float) -> float:
    """Return the angle that a chord spans on a circle."""
    return 2 * asin(chord_m / (2 * radius_m))


def _shifted(u: float, shifts: Iterable[float], direction: int, edge: float) -> tuple[list[float], int]:
    """Return the coordinates that are the given shifts apart, up to an edge, and their count.

    Kahan's summation: equal shifts would round alike, and 20,000 equal errors would exceed the promise.
    """
    out, rest = list[float](), 0.0
    for shift in shifts:
        change = direction * shift + rest
        following = u + change
        if (edge - following) * direction < 0:
            break
        u, rest = following, change - (following - u)
        out.append(u)
    return out, len(out)


def direction_at(angle: Any) -> Any:
    """Return exp(i angle) for one angle or many; for a single angle, ``cmath`` is several times faster than numpy."""
    return cmath.rect(1.0, angle) if type(angle) is float else np.exp(1j * angle)
