"""The world in which every promise holds, declared once, in units of the street.

Scenes, calls, messages and studies share these limits. The checker has its own copy (``verify/world.py``), which a test
holds equal. Inside the world, no scale needs a special case; outside, an error states value, limit and cure.
"""
from dataclasses import dataclass
from typing import Any

from dragon_ros.core.checks import number, whole
from dragon_ros.core.errors import FieldError


@dataclass(frozen=True)
class Quantity:
    """A quantity with its smallest and largest value; ``unit`` is empty for counts."""

    what: str
    unit: str
    low: float
    high: float
    cure: str = ''

    def checked(self, field: str, value: Any) -> float:
        """Return the value as a float. Raises FieldError outside the limits."""
        out = number(field, value)
        if self.cure and not self.low <= out <= self.high:
            raise FieldError(field, value, f'the world reaches from {self.low:g} to {self.high:g} {self.unit}',
                             self.cure)
        return number(field, value, low=self.low, high=self.high)

    def counted(self, field: str, value: Any) -> int:
        """Return the value as an integer. Raises FieldError outside the limits."""
        return whole(field, value, low=int(self.low), high=int(self.high))


LINK = Quantity('the link of a bench (the distance between its two handles)', 'm', 0.05, 50.0)
LONGEST_BENCH = Quantity('the length of a bench', 'links', 1.0, 20.0)
WIDTH = Quantity('the width of a bench', 'm', 0.001, 100.0)
BENCHES = Quantity('the benches of a dragon', '', 1, 20_000)
PITCH = Quantity('the pitch of a spiral', 'm', 0.01, 100.0)
COORDINATE = Quantity('a coordinate of a handle', 'm', -1e4, 1e4,
                      'give coordinates relative to an origin near the track (--origin)')
TRACK = Quantity('the length of a track', 'm', 0.0, 1e6)
RADIUS = Quantity('the radius of an arc', 'm', 0.01, 1e9)
PIECES = Quantity('the pieces of a track', '', 1, 1000)
SPEED = Quantity('the speed of the leader', 'm/s', -100.0, 100.0)
KNOTS = Quantity('the knots of a speed profile', '', 1, 10_000)
TIME = Quantity('the time of a run', 's', 0.0, 1e6)
RATE = Quantity('the ticks in a second', 'Hz', 1e-3, 1e4)
VENUE = Quantity('a coordinate of an obstacle, as maps of whole cities have them', 'm', -1e5, 1e5,
                 'relative to an origin near the track (--origin)')

WORLD = (LINK, LONGEST_BENCH, WIDTH, BENCHES, PITCH, COORDINATE, TRACK, RADIUS, PIECES, SPEED, KNOTS, TIME, RATE, VENUE)
