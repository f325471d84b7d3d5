"""The head law: the leading handle's speed and distance travelled along the track, as functions of time.

Speeds are positive inwards, in the head's direction. If the tail leads, speeds are positive outwards: the dragon is
wound up behind the head's initial position, the tail moves out along the track, and each handle is placed one link
ahead of the next handle towards the tail.
"""
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf, isfinite
from typing import Any

import numpy as np

from dragon_ros.core.checks import Settings, number, settle
from dragon_ros.core.domain import KNOTS, SPEED, TIME
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.roots import bracketed_newton
from dragon_ros.core.numerics.types import Floats

LEADERS = ('head', 'tail')
RAMPS = ('linear', 'smooth')

Knot = tuple[float, float]      # (time in s, speed in m/s)
Reached = tuple[float, float]   # (distance in m, what rounding has left out of it)


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

    def travelled_m(self, t_s: Any) -> Any:
        """Return the arc length (m) that the leader has travelled by ``t_s`` (one time or many)."""
        return self.speed_m_s * t_s

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
        travel_m = self.speed_m_s * t_s
        return min(0.0, travel_m), max(0.0, travel_m)


@dataclass(frozen=True, eq=False)
class Legs:
    """Knots with the distances reached there, and ramps between them; the last speed is maintained.

    Each distance is a sum (m) and what rounding has left out of it (Kahan), so thousands of legs add up without error.
    At a knot, the legs before and after it yield the same bits.
    """

    knots: Sequence[Knot]
    reached: Sequence[Reached]
    smooth: bool = False

    def _leg(self, t_s: float) -> tuple[float, ...]:
        """Return the leg from the knot at or before a time: its time, distance, speed, duration and change of speed."""
        n = max(bisect_right(self.knots, (t_s, inf)) - 1, 0)
        (begin_s, speed), (end_s, then) = self.knots[n], self.knots[min(n + 1, len(self.knots) - 1)]
        return begin_s, *self.reached[n], speed, end_s - begin_s or 1.0, then - speed

    @cached_property
    def _legs(self) -> tuple[Floats, Floats]:
        """The times of the knots (K,), and the values (6, K) of the legs from them on."""
        times = np.array([t_s for t_s, _ in self.knots])
        return times, np.array([self._leg(t_s) for t_s in times.tolist()]).T

    def travelled_m(self, t_s: Any) -> Any:
        """Return the distance travelled by a time (one or many)."""
        leg: Any
        if isinstance(t_s, np.ndarray):
            times, legs = self._legs
            leg = legs[:, np.maximum(np.searchsorted(times, t_s, side='right') - 1, 0)]
        else:
            leg = self._leg(t_s)
        begin_s, reached_m, rest_m, speed, duration_s, change = leg
        since_s = t_s - begin_s
        x = since_s / duration_s
        return reached_m + (rest_m + since_s * (speed + change * (x * x * (1 - 0.5 * x) if self.smooth else 0.5 * x)))

    def speed_m_s(self, t_s: float) -> float:
        """Return the speed; at a jump, the speed after the jump."""
        begin_s, _, _, speed, duration_s, change = self._leg(t_s)
        x = (t_s - begin_s) / duration_s
        return speed + change * (x * x * (3 - 2 * x) if self.smooth else x)

    def acceleration_m_s2(self, t_s: float, from_s: float | None = None) -> float:
        """Return the rate of change of the speed at a time, on the leg that begins at or before ``from_s`` if given."""
        begin_s, _, _, _, duration_s, change = self._leg(t_s if from_s is None else from_s)
        x = (t_s - begin_s) / duration_s
        return change / duration_s * (6 * x * (1 - x) if self.smooth else 1.0)


def arrived(reached: Reached, one: Knot, two: Knot) -> Reached:
    """Return the distance reached at a knot from that at the knot before; the mean speed is that of both ends."""
    leg = reached[1] + (two[0] - one[0]) * (one[1] + (two[1] - one[1]) * 0.5)
    total = reached[0] + leg
    part = total - reached[0]       # Knuth's sum without an error, since either term may be the larger one
    return total, (reached[0] - (total - part)) + (leg - part)


@dataclass(frozen=True)
class Profile(Settings):
    """Speed over time, given by ``knots`` (t_s, speed_m_s) with ``ramps`` between them; the last speed is maintained.

    A ramp is ``linear`` or ``smooth``. A smooth ramp is v0 + (v1 - v0) (3 x^2 - 2 x^3), with zero acceleration at
    both ends. Two knots at the same time define a jump. Distances are integrals.
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
    def _legs(self) -> Legs:
        reached: list[Reached] = [(0.0, 0.0)]
        for one, two in pairwise(self.knots):
            reached.append(arrived(reached[-1], one, two))
        return Legs(self.knots, reached, self.ramps == 'smooth')

    def travelled_m(self, t_s: Any) -> Any:
        """Return the arc length (m) that the leader has travelled by ``t_s`` (one time or many)."""
        return self._legs.travelled_m(t_s)

    def speed_at_m_s(self, t_s: float) -> float:
        """Return the leader's speed; at a jump, the speed after the jump."""
        return self._legs.speed_m_s(t_s)

    def speed_before_m_s(self, t_s: float) -> float:
        """Return the leader's speed just before a time; at a jump, the speed before the jump."""
        n = bisect_left(self._times, t_s)
        return self.knots[n][1] if n < len(self.knots) and self._times[n] == t_s else self.speed_at_m_s(t_s)

    def acceleration_at_m_s2(self, t_s: float) -> float:
        """Return the rate of change (m/s^2) of the leader's speed; at a knot, the rate just after the knot."""
        return self._legs.acceleration_m_s2(t_s)

    def acceleration_range_m_s2(self, start_s: float, stop_s: float) -> tuple[float, float]:
        """Return the smallest and largest rates of change of the speed between two times without a knot in between."""
        n = bisect_right(self._times, start_s)
        middle_s = 0.5 * (self._times[n - 1] + self._times[n]) if n < len(self._times) else start_s
        times = start_s, stop_s, min(max(start_s, middle_s), stop_s)     # a smooth ramp is steepest in the middle
        rates = [self._legs.acceleration_m_s2(t_s, start_s) for t_s in times]
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
            return sense * (self.travelled_m(t_s) - distance_m), sense * self.speed_at_m_s(t_s)

        for before, after in pairwise(self.breaks_s):
            if beyond(after)[0] > 0:
                return bracketed_newton(beyond, before, after, 0.5 * (before + after))[0]
        last, speed = self.breaks_s[-1], sense * self.knots[-1][1]
        left = -beyond(last)[0]
        return last + left / speed if speed > 0 and isfinite(left / speed) else None

    def extent_m(self, t_s: float) -> tuple[float, float]:
        """Return the smallest and largest distances that the leader has travelled up to ``t_s``, including 0."""
        travels_m = [0.0, *(self.travelled_m(t) for t in (*self.breaks_s, t_s) if t <= t_s)]
        return min(travels_m), max(travels_m)


def _smooth_share(rise: float) -> float:
    """Return the fraction of its duration at which a smooth ramp has completed the fraction ``rise`` of its change."""
    return bracketed_newton(lambda x: (x * x * (3 - 2 * x) - rise, 6 * x * (1 - x)), 0.0, 1.0, rise)[0]


def check_lead(lead: str) -> None:
    """Raise FieldError if ``lead`` is not an end of the dragon."""
    if lead not in LEADERS:
        raise FieldError('head.lead', lead, 'the leader is the head or the tail', 'give head or tail')
