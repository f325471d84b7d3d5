"""The leader's approach to a claimed contact: earlier positions, and the times at which it is within the slack.

The slack allows for an error in the position, not in the time. The slack therefore applies only while the leader moves
in one direction, to the contact and beyond. No slack applies to earlier positions of the leader.
"""
from dataclasses import dataclass
from fractions import Fraction
from math import ulp

from dragon_ros.verify.errors import Refused
from dragon_ros.verify.law import Extent, Law, Leg

_LAST_PLACES = 4        # a float solver's error, in ulps, in the time at which the leader turns or rests
_SOON_S = Fraction(1, 10**6)    # time before and after a contact; a slack that takes longer is reported
_HALVINGS = 80          # number of bisections for times that are only printed


@dataclass(frozen=True)
class Approach:
    """The leg of the law on which the leader reaches a contact at ``travel_m`` or rests there.

    ``earlier`` is the range of the leader's earlier positions in the run, or None if there are none.
    """

    law: Law
    leg: Leg
    t_s: Fraction
    travel_m: Fraction
    earlier: Extent | None

    @property
    def sense(self) -> int:
        """The direction in which the leader moves."""
        return self.leg.sense

    @property
    def was_beyond_m(self) -> Fraction:
        """How far the leader was earlier beyond the contact's position, at most; negative if it never was."""
        if self.earlier is None:
            return Fraction(-1)
        return (self.earlier[1] - self.travel_m) if self.sense > 0 else (self.travel_m - self.earlier[0])

    def after_m(self, slack_m: Fraction) -> Fraction:
        """Return how far the leader moves beyond the contact's position, but at most one slack."""
        if self.leg.until_s is None:
            return slack_m * abs(self.sense)
        return min(slack_m, (self.law.travel_m(self.leg.until_s) - self.travel_m) * self.sense)

    def takes_s(self, start_s: float, slack_m: Fraction) -> tuple[float, float] | None:
        """Return the time interval in which the leader is within the slack of the contact; None if it is short."""
        first, last = max(self.leg.since_s, Fraction(start_s)), self.leg.until_s
        before, after = self.t_s - _SOON_S, self.t_s + _SOON_S
        early = before > first and self._on_m(before) > -slack_m
        late = (last is None or after < last) and self._on_m(after) < slack_m
        if not self.sense or not (early or late):
            return None
        return float(self._reached_s(-slack_m, first, self.t_s)), float(self._reached_s(slack_m, self.t_s, last))

    def _on_m(self, t_s: Fraction) -> Fraction:
        """Return how far the leader is beyond the contact's position at a time, in its direction of motion."""
        return (self.law.travel_m(t_s) - self.travel_m) * self.sense

    def _reached_s(self, on_m: Fraction, low: Fraction, high: Fraction | None) -> Fraction:
        """Return the approximate time at which the leader is ``on_m`` beyond the contact, or the nearer end."""
        if high is None:
            high = low + 1
            while self._on_m(high) < on_m:
                high += high - low
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if self._on_m(middle) >= on_m else (middle, high)
        return high


def approaches(law: Law, start_s: float, t_s: float) -> list[Approach]:
    """Return the possible approaches to a contact at a time. Raises Refused if the leader has already rested there."""
    start, at, unsure = Fraction(start_s), Fraction(t_s), _LAST_PLACES * Fraction(ulp(t_s))
    legs = law.legs_at(at, unsure)
    moving = [leg for leg in legs if leg.sense]
    if not moving and at > start + unsure:
        raise Refused(f'contact.t_s: at {t_s!r} s the leader has rested since {float(max(start, legs[0].since_s))!r} s')
    return [Approach(law, leg, at, law.travel_m(at),
                     law.extent_m(start, min(leg.since_s, at)) if leg.since_s > start else None)
            for leg in moving or legs]
