"""How the leader comes to a claimed contact: where it was before, and when it is within the slack of that place.

The slack excuses a place and not a time. So it counts only while the leader goes one way to the contact and on; where
it has been before, nothing is excused.
"""
from dataclasses import dataclass
from fractions import Fraction
from math import ulp

from dragon_ros.verify.errors import Refused
from dragon_ros.verify.law import Extent, Law, Leg

_LAST_PLACES = 4        # of a time, within which a solver in floats may say that the leader turns, goes on or rests
_SOON_S = Fraction(1, 10**6)    # to either side of a contact; where the slack takes longer, the answer says how long
_HALVINGS = 80          # of times that are only told


@dataclass(frozen=True)
class Approach:
    """The leg of the law on which the leader comes to a contact at ``gone_m``, or rests there from the start on.

    ``earlier`` is where the leader has been before in the run, if anywhere.
    """

    law: Law
    leg: Leg
    t_s: Fraction
    gone_m: Fraction
    earlier: Extent | None

    @property
    def sense(self) -> int:
        """Which way the leader goes."""
        return self.leg.sense

    @property
    def was_beyond_m(self) -> Fraction:
        """How far beyond the contact's place the leader has been before; negative if it has not."""
        if self.earlier is None:
            return Fraction(-1)
        return (self.earlier[1] - self.gone_m) if self.sense > 0 else (self.gone_m - self.earlier[0])

    def after_m(self, slack_m: Fraction) -> Fraction:
        """Return how far on from the contact's place the leader goes, up to a slack."""
        if self.leg.until_s is None:
            return slack_m * abs(self.sense)
        return min(slack_m, (self.law.gone_m(self.leg.until_s) - self.gone_m) * self.sense)

    def takes_s(self, start_s: float, slack_m: Fraction) -> tuple[float, float] | None:
        """Return from when to when the leader is within the slack of the contact; None if that is soon over."""
        first, last = max(self.leg.since_s, Fraction(start_s)), self.leg.until_s
        before, after = self.t_s - _SOON_S, self.t_s + _SOON_S
        early = before > first and self._on_m(before) > -slack_m
        late = (last is None or after < last) and self._on_m(after) < slack_m
        if not self.sense or not (early or late):
            return None
        return float(self._reached_s(-slack_m, first, self.t_s)), float(self._reached_s(slack_m, self.t_s, last))

    def _on_m(self, t_s: Fraction) -> Fraction:
        """Return how far beyond the contact's place the leader is at a time."""
        return (self.law.gone_m(t_s) - self.gone_m) * self.sense

    def _reached_s(self, on_m: Fraction, low: Fraction, high: Fraction | None) -> Fraction:
        """Return about when the leader is so far on; an end of the time where it is not in it."""
        if high is None:
            high = low + 1
            while self._on_m(high) < on_m:
                high += high - low
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if self._on_m(middle) >= on_m else (middle, high)
        return high


def approaches(law: Law, start_s: float, t_s: float) -> list[Approach]:
    """Return the ways in which the leader may come to a contact at a time. Raises Refused where it rested before."""
    start, at, unsure = Fraction(start_s), Fraction(t_s), _LAST_PLACES * Fraction(ulp(t_s))
    legs = law.legs_at(at, unsure)
    moving = [leg for leg in legs if leg.sense]
    if not moving and at > start + unsure:
        raise Refused(f'contact.t_s: at {t_s!r} s the leader has rested since {float(max(start, legs[0].since_s))!r} s')
    return [Approach(law, leg, at, law.gone_m(at),
                     law.extent_m(start, min(leg.since_s, at)) if leg.since_s > start else None)
            for leg in moving or legs]
