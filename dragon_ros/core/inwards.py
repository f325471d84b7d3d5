"""A single spiral to its centre as a walk: links may lock there, and their rear handles turn back."""
from dataclasses import dataclass
from math import inf, pi

from dragon_ros.core.march import first_guess, first_peak, step
from dragon_ros.core.numerics.double_double import DoubleDouble, plus
from dragon_ros.core.path import Spiral
from dragon_ros.core.placed import PlacedSpiral
from dragon_ros.core.walk import Place, Walk


@dataclass(frozen=True)
class Inwards(Walk):
    """The walk of ``inwards``."""

    may_lock = True

    def next(self, place: Place, chord_m: float, way: int, tolerance: float) -> tuple[Place, int]:
        """Return the place of the next handle behind, and evaluations."""
        (piece,) = self.pieces
        assert isinstance(piece, PlacedSpiral)
        delta, spent = span(place.u.hi, chord_m / piece.spiral.b_m, tolerance)
        return Place(0, DoubleDouble(*plus(*place.u, delta))), spent


def inwards(spiral: Spiral) -> Inwards:
    """Return a spiral from afar to its centre; distances count from where the head starts."""
    return Inwards((PlacedSpiral(spiral, 0j, 1 + 0j, 1, -1, inf, 0.0),), (0.0,))


def span(theta: float, chord: float, tolerance: float) -> tuple[float, int]:
    """Return ``march.step``; at a lock itself, where rounding may leave no root, where the chord is longest."""
    delta, spent = step(theta, chord, first_guess(theta, chord), tolerance)
    return (delta, spent) if delta < inf else first_peak(theta, pi)
