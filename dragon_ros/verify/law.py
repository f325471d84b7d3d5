"""The head law in exact rational arithmetic: the distance that the leader has travelled.

Times and speeds in a certificate are floats, which are rational numbers. The speed on a ramp is a polynomial in time,
so distances are also rational. The only exception is the distance at a reversal on a smooth ramp, which has bounds that
are rounded outwards.
"""
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import asin, sin
from typing import NamedTuple

_NEAR = Fraction(1, 2**50)      # accuracy of a smooth ramp's reversal in floats, relative to its duration

Extent = tuple[Fraction, Fraction]


class Mark(NamedTuple):
    """A knot, or the approximate time of a reversal: the distance travelled by then, and a bound on its error.

    Until the next mark, the leader moves forwards (``sense`` 1), moves backwards (-1) or rests (0).
    """

    t_s: Fraction
    travel_m: Fraction
    sense: int
    more_m: Fraction = Fraction(0)


class Leg(NamedTuple):
    """A period in which the leader moves forwards (``sense`` 1), moves backwards (-1) or rests (0).

    ``until_s`` is None if the period has no end.
    """

    since_s: Fraction
    until_s: Fraction | None
    sense: int


@dataclass(frozen=True)
class Law:
    """A law defined by ``knots`` (t_s, speed_m_s), the first at 0 s; the last speed continues after the last knot."""

    knots: tuple[tuple[Fraction, Fraction], ...]
    smooth: bool = False

    @cached_property
    def _times(self) -> list[Fraction]:
        return [t_s for t_s, _ in self.knots]

    @cached_property
    def _reached(self) -> list[Fraction]:
        """Distance travelled at each knot; on both kinds of ramps, the mean speed is the mean of the end speeds."""
        out = [Fraction(0)]
        for (t0, v0), (t1, v1) in pairwise(self.knots):
            out.append(out[-1] + (t1 - t0) * (v0 + v1) / 2)
        return out

    def _share(self, n: int, t_s: Fraction) -> Fraction:
        """Return the fraction of the ramp after knot n that has elapsed; 0 if the speed is constant."""
        t0, _ = self.knots[n]
        return (t_s - t0) / (self.knots[n + 1][0] - t0) if n + 1 < len(self.knots) else Fraction(0)

    def _gone(self, n: int, t_s: Fraction) -> Fraction:
        (t0, v0), x = self.knots[n], self._share(n, t_s)
        gone = self._reached[n] + v0 * (t_s - t0)
        if x:
            t1, v1 = self.knots[n + 1]
            gone += (v1 - v0) * (t1 - t0) * (x**3 * (1 - x / 2) if self.smooth else x * x / 2)
        return gone

    def _speed(self, n: int, t_s: Fraction) -> Fraction:
        v0, x = self.knots[n][1], self._share(n, t_s)
        return v0 + (self.knots[n + 1][1] - v0) * (x * x * (3 - 2 * x) if self.smooth else x) if x else v0

    def travel_m(self, t_s: Fraction) -> Fraction:
        """Return how far the leader has travelled since 0 s."""
        return self._gone(bisect_right(self._times, t_s) - 1, t_s)

    def speed_m_s(self, t_s: Fraction) -> Fraction:
        """Return the leader's speed; at a jump, the speed after the jump."""
        return self._speed(bisect_right(self._times, t_s) - 1, t_s)

    @cached_property
    def marks(self) -> list[Mark]:
        """All knots and reversals, in order; between them the leader moves in one direction."""
        out = []
        for n, ((t_s, speed), (next_s, following)) in enumerate(pairwise((*self.knots, self.knots[-1]))):
            turns = speed * following < 0 and t_s < next_s
            out.append(Mark(t_s, self._reached[n], _sign(speed if turns else speed + following)))
            if turns:
                out.append(self._turn(n))
        return out

    def _turn(self, n: int) -> Mark:
        (t0, v0), (t1, v1) = self.knots[n:n + 2]
        share, width = _smooth_turn(v0 / (v0 - v1)) if self.smooth else (v0 / (v0 - v1), Fraction(0))
        t_s = t0 + share * (t1 - t0)
        return Mark(t_s, self._gone(n, t_s), _sign(v1), abs(self._speed(n, t_s)) * width * (t1 - t0))

    @cached_property
    def legs(self) -> list[Leg]:
        """All legs from 0 s on; a leg does not end if the leader stops for only an instant."""
        out: list[Leg] = []
        for mark, until_s in zip(self.marks, (*self._mark_times[1:], None), strict=True):
            if until_s == mark.t_s:
                continue
            if out and out[-1].sense == mark.sense:
                out[-1] = out[-1]._replace(until_s=until_s)
            else:
                out.append(Leg(mark.t_s, until_s, mark.sense))
        return out

    def legs_at(self, t_s: Fraction, unsure_s: Fraction) -> list[Leg]:
        """Return the legs that come within ``unsure_s`` of a time, in order."""
        return [leg for leg in self.legs
                if leg.since_s <= t_s + unsure_s and (leg.until_s is None or leg.until_s >= t_s - unsure_s)]

    @cached_property
    def _mark_times(self) -> list[Fraction]:
        return [mark.t_s for mark in self.marks]

    def extent_m(self, start_s: Fraction, end_s: Fraction) -> Extent:
        """Return bounds, rounded outwards, on the leader's distance at any time from start to end."""
        inside = self.marks[bisect_left(self._mark_times, start_s):bisect_right(self._mark_times, end_s)]
        gone = [self.travel_m(start_s), self.travel_m(end_s), *(mark.travel_m for mark in inside)]
        more = max((mark.more_m for mark in inside), default=Fraction(0))
        return min(gone) - more, max(gone) + more

    def pieces(self, end_s: Fraction | None) -> Iterator[tuple[Mark, Mark]]:
        """Yield the periods from 0 s on in which the leader moves in one direction, without an endless last period."""
        for before, after in pairwise(self.marks):
            if end_s is not None and after.t_s >= end_s:
                break
            yield before, after
        if end_s is not None and end_s > 0:
            yield self.marks[bisect_left(self._mark_times, end_s) - 1], Mark(end_s, self.travel_m(end_s), 0)

    @property
    def last(self) -> tuple[Mark, Fraction]:
        """The last knot, and the constant speed after it."""
        return self.marks[-1], self.knots[-1][1]


def _sign(value: Fraction) -> int:
    return (value > 0) - (value < 0)


def _smooth_turn(share: Fraction) -> tuple[Fraction, Fraction]:
    """Return x just below the root of 3 x^2 - 2 x^3 = share in (0, 1), and a bound on the difference.

    The root is computed in floats, by trisecting an angle; its bracket is checked exactly.
    """
    about, width = Fraction(0.5 - sin(asin(1 - 2 * float(share)) / 3)), _NEAR
    while True:
        low, high = max(about - width, Fraction(0)), min(about + width, Fraction(1))
        if low * low * (3 - 2 * low) <= share <= high * high * (3 - 2 * high):
            return low, high - low
        width *= 4
