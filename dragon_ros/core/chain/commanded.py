"""A leader that is commanded externally: its settings, its next allowed speed, and the law that it has followed.

The leader's speed is linear between ticks. The speeds at the ticks are recorded. They determine the distance travelled
at each tick as a profile with the same knots does, to the last bit. A recording of the speeds is therefore sufficient
to reproduce every handle bit for bit.
"""
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import copysign, inf, sqrt
from typing import Any, NoReturn

from dragon_ros.core.chain.head_law import Head, Knot, Legs, Profile, Reached, arrived, check_lead
from dragon_ros.core.checks import number, settle
from dragon_ros.core.domain import SPEED
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.roots import illinois

SHORT_M = 0.01  # smallest distance that the leader keeps from an end of the track, or from a lock, where speeds diverge


@dataclass(frozen=True)
class Commanded:
    """Speed commanded externally on `cmd_vel`, within limits; the leader stops `timeout_s` after the last command.

    The leader starts at rest. The distance that it travels is known only from a recording (the topic `leader` in a
    bag).
    """

    lead: str = 'head'
    timeout_s: float = 0.5
    max_speed_m_s: float = 2.0
    max_acceleration_m_s2: float = 1.0

    def __post_init__(self) -> None:
        """Reject invalid limits."""
        check_lead(self.lead)
        settle(self, timeout_s=number('head.timeout_s', self.timeout_s, above=0.0, high=3600.0),
               max_speed_m_s=number('head.max_speed_m_s', self.max_speed_m_s, above=0.0, high=SPEED.high),
               max_acceleration_m_s2=number('head.max_acceleration_m_s2', self.max_acceleration_m_s2, above=0.0,
                                            high=1e6))

    @property
    def breaks_s(self) -> list[float]:
        """Raise FieldError, because speeds are unknown before the run."""
        _unknown()

    def travelled_m(self, t_s: Any) -> Any:
        """Raise FieldError, because the distance travelled is known only from the bag of a run."""
        _unknown()

    def speed_at_m_s(self, t_s: float) -> float:
        """Raise FieldError, like ``travelled_m``."""
        _unknown()

    def acceleration_at_m_s2(self, t_s: float) -> float:
        """Raise FieldError, like ``travelled_m``."""
        _unknown()

    def acceleration_range_m_s2(self, start_s: float, stop_s: float) -> tuple[float, float]:
        """Raise FieldError, like ``travelled_m``."""
        _unknown()

    def passage_s(self, distance_m: float, sense: int = 1) -> float | None:
        """Return None, because the leader stops short of every end."""
        return None

    def extent_m(self, t_s: float) -> tuple[float, float]:
        """Return the smallest and largest distances that the leader can have travelled by ``t_s``."""
        return -self.max_speed_m_s * t_s, self.max_speed_m_s * t_s


def _unknown() -> NoReturn:
    raise FieldError('head.kind', 'commanded', 'the travel of a commanded leader is known only from a recorded run',
                     'give its bag, or choose another kind of head law')


@dataclass(frozen=True)
class Walked:
    """The law of a commanded leader up to the last tick; ``knots`` holds the most recent pairs (t_s, speed_m_s).

    ``reached`` holds the distance travelled at each knot (see ``Legs``). The leader is at rest before the first knot.
    """

    settings: Commanded
    knots: tuple[Knot, ...]
    reached: tuple[Reached, ...] = ((0.0, 0.0),)

    @cached_property
    def _legs(self) -> Legs:
        return Legs(self.knots, self.reached)

    @property
    def travel_m(self) -> float:
        """The distance travelled at the last knot, in metres."""
        return self.reached[-1][0]

    @property
    def lead(self) -> str:
        """The end of the dragon that leads: 'head' or 'tail'."""
        return self.settings.lead

    @property
    def breaks_s(self) -> list[float]:
        """Times between which the speed is monotone."""
        return [t_s for t_s, _ in self.knots]

    def walked_on(self, t_s: float, speed_m_s: float, keep_s: float = 0.0) -> 'Walked':
        """Return the law with one more knot; knots older than ``keep_s`` seconds are dropped."""
        new, knots = (t_s, speed_m_s), self.knots[:-1] if _is_redundant(self.knots, speed_m_s) else self.knots
        reached = arrived(self.reached[len(knots) - 1], knots[-1], new)
        first = max(0, bisect_right(knots, (t_s - keep_s, inf)) - 1)
        return Walked(self.settings, (*knots[first:], new), (*self.reached[first:len(knots)], reached))

    def travelled_m(self, t_s: Any) -> Any:
        """Return the arc length (m) that the leader has travelled by ``t_s`` (one time or many)."""
        return self._legs.travelled_m(t_s)

    def speed_at_m_s(self, t_s: float) -> float:
        """Return the leader's speed at a tick, or on the ramp between two ticks."""
        return self._legs.speed_m_s(t_s)

    def acceleration_at_m_s2(self, t_s: float) -> float:
        """Return the rate of change (m/s^2) of the leader's speed; at a tick, the rate just before the tick."""
        n = max(1, next((n for n, (at_s, _) in enumerate(self.knots) if at_s >= t_s), len(self.knots)))
        return _rate(self.knots[n - 1:n + 1])

    def acceleration_range_m_s2(self, start_s: float, stop_s: float) -> tuple[float, float]:
        """Return the smallest and largest rates of change of the leader's speed over all known ramps."""
        rates = [0.0, *map(_rate, pairwise(self.knots))]
        return min(rates), max(rates)

    def passage_s(self, distance_m: float, sense: int = 1) -> float | None:
        """Return None, because the leader stops short of every end."""
        return None

    def extent_m(self, t_s: float) -> tuple[float, float]:
        """Return the smallest and largest distances that the leader can have travelled by ``t_s``."""
        return self.settings.extent_m(t_s)


HeadLaw = Head | Profile | Commanded | Walked


def times_between(law: HeadLaw, start_s: float, end_s: float) -> list[float]:
    """Return the start, the breaks of a law, and the end: times between which the leader moves in one direction."""
    return [start_s, *(t_s for t_s in law.breaks_s if start_s < t_s < end_s), end_s]


def passed_s(law: HeadLaw, travel_m: float, low_s: float, high_s: float) -> float:
    """Return when the leader has travelled a distance, between two times on different sides of it."""
    def beyond_m(t_s: float) -> float:
        return float(law.travelled_m(t_s)) - travel_m

    return illinois(beyond_m, low_s, high_s, beyond_m(low_s), beyond_m(high_s))


def onwards_m(law: HeadLaw, t_s: float, sense: int) -> float:
    """Return how far the leader moves in one sense (1 or -1) after a time, until it turns or rests."""
    here_m, most_m, last_s = float(law.travelled_m(t_s)), 0.0, t_s
    for last_s in (break_s for break_s in law.breaks_s if break_s > t_s):
        on_m = sense * (float(law.travelled_m(last_s)) - here_m)
        if on_m <= most_m:
            return most_m
        most_m = on_m
    return inf if sense * law.speed_at_m_s(last_s) > 0 else most_m


def walked_from(settings: Commanded, start_s: float) -> Walked:
    """Return the law of a leader that is at rest at the start of the run."""
    return Walked(settings, ((start_s, 0.0),))


def next_speed_m_s(settings: Commanded, speed_m_s: float, wanted_m_s: float, step_s: float,
                   left_m: tuple[float, float]) -> float:
    """Return the speed at the next tick: as close to the commanded speed as the limits and the stopping distance allow.

    ``left_m`` holds the distances that remain behind and ahead of the leader, in metres. From the speed v at the next
    tick, the leader can stop in time if

        (speed + v) / 2 step + v^2 / (2 a) <= left - SHORT_M - a step^2.

    A leader that satisfies this condition at one tick can satisfy it at the next tick by braking alone. The last term
    allows for the final braking step, which is as long as the other steps.
    """
    most = settings.max_acceleration_m_s2 * step_s
    top = settings.max_speed_m_s
    out = min(max(wanted_m_s, speed_m_s - most, -top), speed_m_s + most, top)
    sense = copysign(1.0, out)
    back_m, on_m = left_m
    left = (on_m if out > 0 else back_m) - SHORT_M - most * step_s - 0.5 * sense * speed_m_s * step_s
    half = 0.5 * most
    most_on = sqrt(max(0.0, half * half + 2 * settings.max_acceleration_m_s2 * left)) - half
    return sense * min(abs(out), max(0.0, most_on)) + 0.0


def next_law(law: Walked, t_s: float, wanted_m_s: float, ends_m: tuple[float, float],
             keep_s: float = 0.0) -> tuple[Walked, int]:
    """Return the law up to the next tick, and the direction of the limit that makes the leader brake.

    The direction is -1 (backwards), 1 (forwards), or 0 if the leader need not brake. ``ends_m`` holds the limits of
    travel backwards and forwards (m); a missing limit is infinite. Knots older than ``keep_s`` seconds are dropped.
    """
    (before_s, speed), travel_m = law.knots[-1], law.travel_m
    step = law.settings, speed, wanted_m_s, t_s - before_s
    left_m = travel_m - ends_m[0], ends_m[1] - travel_m
    free, walked = next_speed_m_s(*step, (inf, inf)), next_speed_m_s(*step, left_m)
    return law.walked_on(t_s, walked, keep_s), 0 if walked == free else 1 if free > 0 else -1


def profile_of(settings: Commanded, walked: Iterable[tuple[float, float]]) -> Profile:
    """Return a profile with the pairs (t_s, speed_m_s) of the ticks; its distances are bit-identical to those walked.

    Redundant knots are omitted. Raises FieldError if too many knots remain.
    """
    knots = [(0.0, 0.0)]
    for t_s, speed_m_s in walked:
        if t_s == knots[-1][0]:
            continue
        if _is_redundant(knots, speed_m_s):
            knots.pop()
        knots.append((t_s, speed_m_s))
    return Profile(tuple(knots), 'linear', settings.lead)


def _is_redundant(knots: Sequence[Knot], speed_m_s: float) -> bool:
    """Return whether the last knot has the same speed as the knot before it and the next knot."""
    return len(knots) > 1 and knots[-2][1] == knots[-1][1] == speed_m_s


def _rate(knots: Sequence[Knot]) -> float:
    (t_s, speed), (end_s, then) = knots[0], knots[-1]
    return (then - speed) / (end_s - t_s) if end_s > t_s else 0.0
