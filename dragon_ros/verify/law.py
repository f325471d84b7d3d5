"""The head law, exactly: how far the leader has gone, in rational arithmetic.

Times and speeds in a certificate are floats, which are rational; a ramp's speed is a polynomial of time, so distances
are rational too. Only the instant at which a smooth ramp comes to rest is not; the distance there is bounded outwards.
"""
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise

_HALVINGS = 80      # of a smooth ramp, towards its rest: the speed left there is below 2^-78 of the ramp's

Extent = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class Law:
    """``knots`` are (t_s, speed_m_s), the first at 0 s; the last speed stays. A steady speed is one knot."""

    knots: tuple[tuple[Fraction, Fraction], ...]
    smooth: bool = False

    @cached_property
    def _reached(self) -> list[Fraction]:
        """Distance gone at each knot: a ramp's mean speed is the mean of its ends, for both kinds of ramps."""
        out = [Fraction(0)]
        for (t0, v0), (t1, v1) in pairwise(self.knots):
            out.append(out[-1] + (t1 - t0) * (v0 + v1) / 2)
        return out

    def _ramp(self, t_s: Fraction) -> int:
        """Return the number of the last knot that is not after a time."""
        low, high = 0, len(self.knots)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.knots[middle][0] <= t_s else (low, middle)
        return low

    def gone_m(self, t_s: Fraction) -> Fraction:
        """Return how far the leader has gone since 0 s."""
        n = self._ramp(t_s)
        t0, v0 = self.knots[n]
        gone = self._reached[n] + v0 * (t_s - t0)
        if n + 1 < len(self.knots):
            t1, v1 = self.knots[n + 1]
            x = (t_s - t0) / (t1 - t0)
            gone += (v1 - v0) * (t1 - t0) * (x**3 * (1 - x / 2) if self.smooth else x * x / 2)
        return gone

    def speed_m_s(self, t_s: Fraction) -> Fraction:
        """Return the leader's speed; at a jump, the one after it."""
        n = self._ramp(t_s)
        t0, v0 = self.knots[n]
        if n + 1 == len(self.knots):
            return v0
        t1, v1 = self.knots[n + 1]
        x = (t_s - t0) / (t1 - t0)
        return v0 + (v1 - v0) * (x * x * (3 - 2 * x) if self.smooth else x)

    @cached_property
    def _rests(self) -> list[tuple[Fraction, Fraction]]:
        """For each ramp on which the speed changes sign: a time next to the rest, and how far it may be from there."""
        out = []
        for (t0, v0), (t1, v1) in pairwise(self.knots):
            if v0 * v1 < 0 and t0 < t1:
                share, width = v0 / (v0 - v1), Fraction(0)
                if self.smooth:
                    share, width = _smooth_rest(share)
                t_s = t0 + share * (t1 - t0)
                out.append((t_s, abs(self.speed_m_s(t_s)) * width * (t1 - t0)))
        return out

    def turns_s(self, start_s: Fraction, end_s: Fraction) -> list[Fraction]:
        """Return the times from start to end between which the leader goes one way: both ends, knots and rests."""
        inner = {t_s for t_s, _ in (*self.knots, *self._rests) if start_s < t_s < end_s}
        return sorted({start_s, end_s} | inner)

    def extent_m(self, start_s: Fraction, end_s: Fraction) -> Extent:
        """Return bounds, rounded outwards, of how far the leader has gone at any time from start to end."""
        more = max((more for t_s, more in self._rests if start_s < t_s < end_s), default=Fraction(0))
        gone = [self.gone_m(t_s) for t_s in self.turns_s(start_s, end_s)]
        return min(gone) - more, max(gone) + more

    def pieces(self, end_s: Fraction | None) -> Iterator[tuple[Fraction, Fraction]]:
        """Yield (start, end) of pieces from 0 s on in which the leader goes one way; one without an end is left out."""
        last = self.knots[-1][0] if end_s is None else end_s
        yield from pairwise(self.turns_s(Fraction(0), last))

    @property
    def last(self) -> tuple[Fraction, Fraction, Fraction]:
        """Time, distance gone and speed at the last knot, from which on the speed stays."""
        return self.knots[-1][0], self._reached[-1], self.knots[-1][1]

    def rests_at(self, t_s: Fraction) -> Fraction | None:
        """Return since when the leader has rested, where it rests at a time and a while before; else None."""
        since = None
        for (t0, v0), (t1, v1) in pairwise((*self.knots, (max(t_s, self.knots[-1][0]) + 1, self.knots[-1][1]))):
            if t0 >= t_s:
                break
            since = (t0 if since is None else since) if v0 == v1 == 0 and t0 < t1 else None
        return since


def _smooth_rest(share: Fraction) -> tuple[Fraction, Fraction]:
    """Return x just below the root of 3 x^2 - 2 x^3 = share in (0, 1), and how much below it is at most."""
    low, high = Fraction(0), Fraction(1)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if middle * middle * (3 - 2 * middle) <= share else (low, middle)
    return low, high - low
