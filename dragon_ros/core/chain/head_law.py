"""The head law: the leading handle's speed and distance travelled along the track, as functions of time.

Speeds are positive inwards, in the head's direction. If the tail leads, speeds are positive outwards: the dragon is
wound up behind the head's initial position, the tail moves out along the track, and each handle is placed one link
ahead of the next handle towards the tail.
"""
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import accumulate, pairwise
from math import isfinite
from typing import Any

import numpy as np

from dragon_ros.core.checks import Settings, number, settle
from dragon_ros.core.domain import KNOTS, SPEED, TIME
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.double_double import product
from dragon_ros.core.numerics.exact_polynomial import ExactPolynomial
from dragon_ros.core.numerics.roots import bracketed_newton

LEADERS = ('head', 'tail')
RAMPS = ('linear', 'smooth')

Knot = tuple[float, float]      # (time in s, speed in m/s)


@dataclass(frozen=True)
class Head:
    """Constant speed; the leader has travelled the arc length ``speed_m_s * t`` at time t (the paper's eq. 4)."""

    speed_m_s: float = 1.0
    lead: str = 'head'

    def __post_init__(self) -> None:
        """Reject an invalid speed or leader."""
        settle(self, speed_m_s=SPEED.checked('head.speed_m_s', self.speed_m_s))
        check_lead(self.lead)

    @property
    def breaks_s(self) -> list[float]:
        """Times between which the speed is monotone and does not change sign."""
        return []

    def travelled_m(self, t_s: Any) -> tuple[Any, Any]:
        """Return the arc length that the leader has travelled by ``t_s`` (one time or many), as (hi, lo)."""
        return product(self.speed_m_s, t_s)

    def speed_at_m_s(self, t_s: float) -> float:
        """Return the leader's speed."""
        return self.speed_m_s

    def acceleration_at_m_s2(self, t_s: float) -> float:
        """Return 0, the rate of change of the leader's speed."""
        return 0.0

    def acceleration_range_m_s2(self, start_s: float, stop_s: float) -> tuple[float, float]:
        """Return the smallest and largest rates of change of the leader's speed between two times; both are 0."""
        return 0.0, 0.0

    def passage_s(self, distance_m: float, sense: int = 1) -> float | None:
        """Return the first time at which the leader has travelled ``distance_m``, or None if it never does.

        ``sense`` is 1 forwards and -1 backwards; ``distance_m`` must have the same sign, or be 0.
        """
        return distance_m / self.speed_m_s if sense * self.speed_m_s > 0 else None

    def extent_m(self, t_s: float) -> tuple[float, float]:
        """Return the smallest and largest distances that the leader has travelled up to ``t_s``, including 0."""
        gone = self.speed_m_s * t_s
        return min(0.0, gone), max(0.0, gone)


@dataclass(frozen=True)
class Profile(Settings):
    """Speed over time, given by ``knots`` (t_s, speed_m_s) with ``ramps`` between them; the last speed is maintained.

    A ramp is ``linear`` or ``smooth``. A smooth ramp is v0 + (v1 - v0) (3 x^2 - 2 x^3), with zero acceleration at
    both ends. Two knots at the same time define a jump. Distances are the exact integrals, computed in rational
    arithmetic and rounded once.
    """

    knots: tuple[tuple[float, float], ...]
    ramps: str = 'linear'
    lead: str = 'head'

    def __post_init__(self) -> None:
        """Reject a profile that has no knots, too many knots or decreasing times."""
        check_lead(self.lead)
        if self.ramps not in RAMPS:
            raise FieldError('head.ramps', self.ramps, f'ramps are {" or ".join(RAMPS)}', 'give one of these')
        if not KNOTS.low <= len(self.knots) <= KNOTS.high:
            raise FieldError('head.knots', len(self.knots), f'a profile has 1 to {KNOTS.high} knots',
                             'list pairs [time, speed]')
        settle(self, knots=tuple(
            (number(f'head.knots.{n + 1}', t_s, low=self.knots[n - 1][0] if n else 0.0, high=TIME.high),
             SPEED.checked(f'head.knots.{n + 1}', speed)) for n, (t_s, speed) in enumerate(self.knots)))
        if self.knots[0][0] != 0:
            raise FieldError('head.knots.1', self.knots[0], 'the first knot must be at 0 s', 'add the speed at 0 s')

    @cached_property
    def _times(self) -> list[float]:
        return [t_s for t_s, _ in self.knots]

    @cached_property
    def _reached(self) -> list[Fraction]:
        """Distance at each knot."""
        return [*accumulate((ramp_m(*pair) for pair in pairwise(self.knots)), initial=Fraction(0))]

    def _knot_before(self, t_s: float) -> int:
        return bisect_right(self._times, t_s) - 1

    def travelled_m(self, t_s: Any) -> tuple[Any, Any]:
        """Return the arc length that the leader has travelled by ``t_s`` (one time or many), as (hi, lo)."""
        if isinstance(t_s, np.ndarray):
            gone = np.array([self._gone(t) for t in t_s.tolist()], dtype=np.float64).reshape(-1, 2)
            return gone[:, 0], gone[:, 1]
        return self._gone(t_s)

    def _gone(self, t_s: float) -> tuple[float, float]:
        return self._polynomials_at(t_s)[0].halves_at(t_s)

    def speed_at_m_s(self, t_s: float) -> float:
        """Return the leader's speed; at a jump, the speed after the jump."""
        return self._polynomials_at(t_s)[1].at(t_s)

    def _polynomials_at(self, t_s: float) -> tuple[ExactPolynomial, ...]:
        """Return distance, speed and acceleration from the knot before ``t_s`` to the next, as polynomials in time."""
        n = self._knot_before(t_s)
        return self._polynomials.get(n) or self._polynomials_from(n)

    @cached_property
    def _polynomials(self) -> dict[int, tuple[ExactPolynomial, ...]]:
        return {}

    def _polynomials_from(self, n: int) -> tuple[ExactPolynomial, ...]:
        out = self._polynomials[n] = ramp(self.knots[n:n + 2], self._reached[n], self.ramps == 'smooth')
        return out

    def speed_before_m_s(self, t_s: float) -> float:
        """Return the leader's speed just before a time; at a jump, the speed before the jump."""
        n = bisect_left(self._times, t_s)
        return self.knots[n][1] if n < len(self.knots) and self._times[n] == t_s else self.speed_at_m_s(t_s)

    def acceleration_at_m_s2(self, t_s: float) -> float:
        """Return the rate of change (m/s^2) of the leader's speed; at a knot, the rate just after the knot."""
        return self._polynomials_at(t_s)[2].at(t_s)

    def acceleration_range_m_s2(self, start_s: float, stop_s: float) -> tuple[float, float]:
        """Return the smallest and largest rates of change of the speed between two times without a knot in between."""
        n = self._knot_before(start_s)
        ends = [Fraction(t_s) for t_s, _ in self.knots[n:n + 2]]
        middle = (ends[0] + ends[-1]) / 2       # where a smooth ramp is steepest
        times: list[float | Fraction] = [start_s, stop_s]
        if start_s < middle < stop_s:
            times.append(middle)
        rate = self._polynomials_at(start_s)[2]
        rates = [rate.at(t_s) for t_s in times]
        return min(rates), max(rates)

    @cached_property
    def breaks_s(self) -> list[float]:
        """Times between which the speed is monotone and does not change sign: the knots, and zeros of the speed."""
        out = list(self._times)
        for (t0, v0), (t1, v1) in pairwise(self.knots):
            if v0 * v1 < 0:
                x = v0 / (v0 - v1)
                out.append(t0 + (x if self.ramps == 'linear' else _smooth_share(x)) * (t1 - t0))
        return sorted(set(out))

    def passage_s(self, distance_m: float, sense: int = 1) -> float | None:
        """Return the first time at which the leader has travelled ``distance_m``, or None if it never does.

        ``sense`` is 1 forwards and -1 backwards; ``distance_m`` must have the same sign, or be 0. For 0, the result is
        the time at which the leader departs.
        """
        def beyond(t_s: float) -> tuple[float, float]:
            hi, lo = self.travelled_m(t_s)
            return sense * ((hi - distance_m) + lo), sense * self.speed_at_m_s(t_s)

        for before, after in pairwise(self.breaks_s):
            if beyond(after)[0] > 0:
                return bracketed_newton(beyond, before, after, 0.5 * (before + after))[0]
        last, speed = self.breaks_s[-1], sense * self.knots[-1][1]
        left = -beyond(last)[0]
        return last + left / speed if speed > 0 and isfinite(left / speed) else None

    def extent_m(self, t_s: float) -> tuple[float, float]:
        """Return the smallest and largest distances that the leader has travelled up to ``t_s``, including 0."""
        gone = [0.0, *(self.travelled_m(t)[0] for t in (*self.breaks_s, t_s) if t <= t_s)]
        return min(gone), max(gone)


def ramp(knots: Sequence[Knot], reached_m: Fraction, smooth: bool = False) -> tuple[ExactPolynomial, ...]:
    """Return distance, speed and acceleration after the first knot, at distance ``reached_m``, as polynomials in time.

    If there is no second knot, the first knot is the last knot of the law, and its speed is maintained.
    """
    (t_s, speed), (end_s, then) = knots[0], knots[-1]
    length, change = Fraction(end_s) - Fraction(t_s), Fraction(then) - Fraction(speed)
    rise: list[Fraction] = []       # coefficients of speed in powers of time since the knot, except the constant
    if change:
        rise = [Fraction(0), 3 * change / length**2, -2 * change / length**3] if smooth else [change / length]
    speeds = [Fraction(speed), *rise]
    way = [reached_m, *(one / power for power, one in enumerate(speeds, 1))]
    rates = [power * one for power, one in enumerate(rise, 1)] or [Fraction(0)]
    return tuple(ExactPolynomial(t_s, values) for values in (way, speeds, rates))


def _smooth_share(rise: float) -> float:
    """Return the fraction of its duration at which a smooth ramp has completed the fraction ``rise`` of its change."""
    return bracketed_newton(lambda x: (x * x * (3 - 2 * x) - rise, 6 * x * (1 - x)), 0.0, 1.0, rise)[0]


def ramp_m(one: Knot, two: Knot) -> Fraction:
    """Return the distance travelled on a ramp between two knots; its mean speed is the mean of its end speeds."""
    return (Fraction(two[0]) - Fraction(one[0])) * (Fraction(one[1]) + Fraction(two[1])) / 2


def check_lead(lead: str) -> None:
    """Raise FieldError if ``lead`` is not an end of the dragon."""
    if lead not in LEADERS:
        raise FieldError('head.lead', lead, 'the leader is the head or the tail', 'give head or tail')
